"""Targets, and the compilers and binary tools for them."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from build_fmus.compile import SOURCE_FLAGS, CompileError, find_toolchain, host

_ARM = ("-mthumb", "-mfloat-abi=hard")


@dataclass(frozen=True)
class Target:
    """A processor.

    Attributes:
        prefix: of the names of its compiler and binary tools; "" for this machine's.
        board: that QEMU emulates with this processor; "" for none.
    """

    name: str
    prefix: str
    flags: tuple[str, ...]
    board: str = ""


TARGETS = {
    t.name: t
    for t in (
        Target("cortex-m4f", "arm-none-eabi-", ("-mcpu=cortex-m4", *_ARM, "-mfpu=fpv4-sp-d16"), "mps2-an386"),
        Target("cortex-m7", "arm-none-eabi-", ("-mcpu=cortex-m7", *_ARM, "-mfpu=fpv5-d16"), "mps2-an500"),
        Target("cortex-r5", "arm-none-eabi-", ("-mcpu=cortex-r5", "-marm", "-mfloat-abi=hard", "-mfpu=vfpv3-d16")),
        Target("host-static", "", ("-fPIC", "-fvisibility=hidden")),
    )
}
WARNINGS = ("-Wall", "-Wextra", "-Wconversion")
CFLAGS = (*SOURCE_FLAGS, "-std=c99", "-g0", "-ffunction-sections", "-fdata-sections", *WARNINGS)


@dataclass(frozen=True)
class Tools:
    """Compiler and binary tools for a target; all run in one folder, so that no path gets into what they write."""

    target: Target
    compiler: tuple[str, ...]
    version: str

    @property
    def is_gcc(self) -> bool:
        """Whether the compiler tells the stack of each function and who calls whom."""
        return "clang" not in self.version and "zig" not in self.version

    def compile(self, source: str, output: str, folder: Path, *more: str) -> list[str]:
        """One C file to one object file; returns the warnings, without their places."""
        more = more if self.is_gcc else (*more, "-Wno-unused-function")  # Clang means inline functions, too
        command = [*self.compiler, *CFLAGS, *self.target.flags, *more, "-c", source, "-o", output]
        found = re.findall(r"^\S+: warning: (.*)", self._run(command, folder).stderr, re.MULTILINE)
        return list(dict.fromkeys(found))

    def link(self, arguments: Sequence[str], output: str, folder: Path) -> None:
        """Anything that the compiler links."""
        self.run([*self.compiler, *self.target.flags, *arguments, "-o", output], folder)

    def tool(self, name: str, *arguments: str, folder: Path) -> str:
        """What a binary tool (nm, objdump, ...) prints."""
        return self.run([f"{self.target.prefix}{name}", *arguments], folder)

    @staticmethod
    def run(command: Sequence[str], folder: Path) -> str:
        """Run a command and return what it prints.

        Raises:
            CompileError: the command failed.
        """
        return Tools._run(command, folder).stdout

    @staticmethod
    def _run(command: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise CompileError(f"{' '.join(command)}\n{done.stderr.strip()}")
        return done


def find_tools(target: Target) -> Tools:
    """The compiler and the binary tools for a target.

    Raises:
        CompileError: one of them is missing; the message says which package has it.
    """
    if target.prefix:
        program, package = f"{target.prefix}gcc", "gcc-arm-none-eabi"
        path = shutil.which(program)
        if path is None:
            raise CompileError(f"no compiler for {target.name}: install {program} (Debian package {package})")
        compiler: tuple[str, ...] = (path,)
    else:
        compiler, package = find_toolchain(host()).command, "binutils"
    for name in ("nm", "ar", "ld", "objcopy", "objdump"):
        if shutil.which(f"{target.prefix}{name}") is None:
            raise CompileError(f"{target.prefix}{name} is not in PATH: install it (Debian package {package})")
    version = Tools.run([*compiler, "--version"], Path.cwd()).splitlines()[0]
    return Tools(target, compiler, version)


_FRAME = re.compile(r"^(?:push|stmdb|stmfd|vpush|vstmdb)")
_ENDS = re.compile(r"^(?:b(?:\.[nw])?|bx|pop(?:\.w)?|ldmia(?:\.w)?|ldr(?:\.w)?|udf)$")


def library_frames(listing: str, symbols: str) -> dict[str, tuple[int, set[str]]]:
    """Stack [bytes] and calls of each function in a disassembly of ARM code.

    The stack is the sum of all that any instruction of the function takes, as in code without loops over them. A
    function that does not end in a jump runs into the next one.

    Args:
        listing: what `objdump -d` prints.
        symbols: what `nm` prints, with all names of an address.
    """
    frames: dict[str, tuple[int, set[str]]] = {}
    at: dict[int, str] = {}
    name = last = ""
    for line in listing.splitlines():
        if found := re.match(r"([0-9a-f]+) <([^>]+)>:", line):
            if name and not _ENDS.match(last):
                frames[name][1].add(found[2])
            name = found[2]
            at[int(found[1], 16)] = name
            frames[name] = (0, set())
        elif name and (found := re.match(r"\s+[0-9a-f]+:\t[0-9a-f ]+\t([a-z][\w.]*)\s*(.*)", line)):
            last = last if found[1].startswith("nop") else found[1]
            frame, calls = frames[name]
            frames[name] = (frame + _taken(found[1], found[2]), calls)
            if found[1].startswith("b") and (jump := re.search(r"<([^>+]+)", found[2])) and jump[1] != name:
                calls.add(jump[1])
    for line in symbols.splitlines():
        address, kind, symbol = line.split()[-3:]
        if kind in "tTwW" and (same := at.get(int(address, 16) & ~1)):
            frames.setdefault(symbol, (0, {same}))
    return frames


def _taken(instruction: str, operands: str) -> int:
    """Stack that one instruction takes [bytes]."""
    if _FRAME.match(instruction) and (instruction.lstrip("v").startswith("push") or operands.startswith("sp!")):
        registers = re.search(r"\{([^}]*)\}", operands)
        each = 8 if registers and registers[1].lstrip().startswith("d") else 4
        return each * sum(_count(r) for r in (registers[1] if registers else "").split(","))
    if instruction.startswith("sub") and (found := re.match(r"(?:sp, )?sp, #(\d+)", operands)):
        return int(found[1])
    if instruction.startswith("str") and (found := re.search(r"\[sp, #-(\d+)\]!", operands)):
        return int(found[1])
    return 0


def _count(register: str) -> int:
    numbers = [int(n) for n in re.findall(r"[a-z](\d+)", register)]
    return numbers[1] - numbers[0] + 1 if len(numbers) == 2 else 1
