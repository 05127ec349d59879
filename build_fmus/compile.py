"""Toolchains and the object cache: C sources to one shared library per platform.

The host's C compiler is used when there is one, otherwise `ziglang` from PyPI, which also builds for every other
platform. The flags fix the floating-point semantics (no fused or reordered operations), so that a platform and
toolchain give one result.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform as host_platform
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from build_fmus.base import safe_files
from build_fmus.base.interpreters import PYTHON

_INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"]+)"', re.MULTILINE)
# For whoever compiles the sources. -fno-math-errno makes sqrt the processor's instruction alone; it changes no value.
SOURCE_FLAGS = ("-O2", "-ffp-contract=off", "-fno-math-errno")
CFLAGS = (*SOURCE_FLAGS, "-std=c99", "-fvisibility=hidden", "-g0")
_CPP_FLAGS = (*(f for f in CFLAGS if not f.startswith("-std")), "-std=c++17", "-fno-exceptions", "-fno-rtti")


class CompileError(RuntimeError):
    """No toolchain, or a compiler that failed; the message carries the compiler's own words."""


@dataclass(frozen=True)
class Platform:
    """One target of FMU binaries."""

    name: str  # FMI 3.0 platform tuple
    fmi2_name: str
    zig_target: str
    suffix: str

    @property
    def is_windows(self) -> bool:
        """Whether the binaries are for Windows."""
        return self.suffix == ".dll"

    @property
    def compiler(self) -> str | None:
        """The usual compiler there, as far as it knows `SOURCE_FLAGS`."""
        return {".so": "gcc", ".dylib": "clang"}.get(self.suffix)


PLATFORMS: dict[str, Platform] = {
    p.name: p
    for p in (
        Platform("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so"),
        Platform("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu.2.17", ".so"),
        Platform("x86_64-windows", "win64", "x86_64-windows-gnu", ".dll"),
        Platform("x86_64-darwin", "darwin64", "x86_64-macos.11.0", ".dylib"),
        Platform("aarch64-darwin", "aarch64-darwin", "aarch64-macos.11.0", ".dylib"),
    )
}
WASM = Platform("wasm32", "wasm32", "wasm32-wasi", ".wasm")
"""Web pages, which ziglang alone compiles for. A module is a library whose functions the page calls."""


def host() -> str:
    """FMI 3.0 platform tuple of this machine.

    Raises:
        CompileError: a machine that is not among `PLATFORMS`.
    """
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(host_platform.machine(), host_platform.machine())
    system = {"Linux": "linux", "Windows": "windows", "Darwin": "darwin"}.get(host_platform.system(), "unknown")
    name = f"{machine}-{system}"
    if name not in PLATFORMS:
        raise CompileError(f"no FMU platform for this machine ({name}); choose --platform from {', '.join(PLATFORMS)}")
    return name


def resolve_platforms(choice: str) -> list[Platform]:
    """`all`, or a comma-separated list of platform tuples and `host`."""
    if choice == "all":
        return list(PLATFORMS.values())
    names = [host() if n.strip() == "host" else n.strip() for n in choice.split(",")]
    for n in names:
        if n not in PLATFORMS:
            raise CompileError(f"unknown platform {n!r}; choose from host, all, {', '.join(PLATFORMS)}")
    return [PLATFORMS[n] for n in names]


@dataclass(frozen=True)
class Toolchain:
    """A compiler command for one platform, with the identity that enters cache keys."""

    platform: Platform
    command: tuple[str, ...]
    version: str

    def compile(self, source: Path, output: Path, include: Iterable[Path]) -> None:
        """One file of C, or of C++ that needs no library, to one object file."""
        pic = [] if self.platform.is_windows or self.platform == WASM else ["-fPIC"]
        folders = [f"-I{i.absolute()}" for i in include]
        self._run([*_flags(source), *pic, *folders, "-c", source.absolute(), "-o", output.absolute()])

    def link(self, objects: Sequence[Path], output: Path, *, loads: bool = False) -> None:
        """Link objects to a shared library without undefined symbols; loaders know it by the name of `output`.

        `loads`: the library opens other libraries itself.

        The system's mathematical library is not linked: the objects carry their own (`build_fmus.mathematics`).
        """
        flags = ["-mexec-model=reactor" if self.platform == WASM else "-shared", "-s"]
        if self.platform.suffix == ".so":
            flags += ["-Wl,--no-undefined", "-Wl,--build-id=none"]
        elif self.platform.suffix == ".dylib":
            flags += [f"-Wl,-install_name,@rpath/{output.name}"]
        more = self._loader() if loads and self.platform.suffix == ".so" else []
        self._run([*flags, *(o.absolute() for o in objects), *more, "-o", output.absolute()])

    def _loader(self) -> list[str]:
        """Flags for the functions that open libraries.

        Until glibc 2.34 they are in a library of their own, which must be named for these older systems also where a
        newer glibc links.
        """
        ours = "ziglang" not in self.version and host_platform.libc_ver()[0] == "glibc"
        return ["-Wl,--no-as-needed", "-l:libdl.so.2", "-Wl,--as-needed"] if ours else ["-ldl"]

    def link_program(self, objects: Sequence[Path], output: Path) -> None:
        """Objects to a program that opens libraries and has threads."""
        more = ("-ldl", "-lpthread", "-lm") if self.platform.suffix == ".so" else ()
        self._run(["-s", *(o.absolute() for o in objects), *more, "-o", output.absolute()])

    def _run(self, arguments: Sequence[str | Path]) -> None:
        """Run the compiler; paths are absolute.

        ziglang links libraries of its own, which it compiles again in another working folder: all its runs have one.
        """
        environment = dict(os.environ)
        environment.setdefault("ZIG_GLOBAL_CACHE_DIR", str(safe_files.cache_directory() / "zig"))
        folder = Path(__file__).anchor if "ziglang" in self.version else None
        command = [*self.command, *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=folder)
        if done.returncode != 0:
            raise CompileError(f"{' '.join(command)}\n{done.stderr.strip()}")


def _flags(source: Path) -> tuple[str, ...]:
    return _CPP_FLAGS if source.suffix == ".cpp" else CFLAGS


def find_toolchain(platform_name: str) -> Toolchain:
    """The host compiler (`CC`, which may have arguments; cc, gcc, clang) for the host platform, else ziglang.

    Raises:
        CompileError: neither is there; the message says how to get one.
    """
    target = PLATFORMS[platform_name]
    if platform_name == host():
        candidates = [_chosen_command()] if os.environ.get("CC") else [("cc",), ("gcc",), ("clang",)]
        for program, *arguments in candidates:
            path = shutil.which(program)
            if path:
                command = (path, *arguments)
                return Toolchain(target, command, " ".join([_compiler_version(command), *arguments]))
        if os.environ.get("CC"):
            program = "" if len(candidates[0]) == 1 else f": {candidates[0][0]}"
            raise CompileError(f"CC={os.environ['CC']}{program} is not in PATH")
    if (zig := find_zig(target)) is not None:
        return zig
    raise CompileError(
        f"no C compiler for {platform_name}: install gcc or clang, or `pip install ziglang` (works without "
        "administrator rights)"
    )


def find_zig(target: Platform) -> Toolchain | None:
    """The compiler of ziglang for a platform, if it is installed."""
    if importlib.util.find_spec("ziglang") is None:
        return None
    baseline = ("-mcpu=x86_64",) if target.name.startswith("x86_64") else ()
    command = (*PYTHON, "-m", "ziglang", "cc", "-target", target.zig_target, *baseline)
    return Toolchain(target, command, f"ziglang {metadata.version('ziglang')}")


def _chosen_command() -> tuple[str, ...]:
    """The compiler that `CC` names, a program or a command with arguments (`ccache gcc`)."""
    chosen = os.environ["CC"]
    try:
        words = [chosen] if shutil.which(chosen) else shlex.split(chosen, posix=os.name != "nt")
    except ValueError as error:
        raise CompileError(f"CC={chosen} is not a valid command: {error}") from None
    return tuple(words) or (chosen,)


@lru_cache
def _compiler_version(command: tuple[str, ...]) -> str:
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=False)
    return done.stdout.splitlines()[0] if done.stdout else command[0]


def toolchain_identity(platforms: str) -> str:
    """Compilers that would build for a `--platform` choice, as text for cache keys; never fails."""
    try:
        return ", ".join(find_toolchain(p.name).version for p in resolve_platforms(platforms))
    except CompileError as error:
        return str(error)


def included_headers(source: Path, include: Sequence[Path]) -> list[Path]:
    """Files that `source` includes in quotes, and those that these include, sorted; conditions are not looked at.

    A file that is found neither beside the one that names it nor in `include` belongs to the compiler.
    """
    found: dict[Path, None] = {}
    open_ = [source]
    while open_:
        file = open_.pop()
        for name in _INCLUDE.findall(file.read_text(errors="replace")):
            path = next((p for d in (file.parent, *include) if (p := (d / name).resolve()).is_file()), None)
            if path is not None and path not in found:
                found[path] = None
                open_.append(path)
    return sorted(found)


class ObjectCache:
    """Compiled objects and libraries by content hash; each is checked by a hash of its bytes.

    Safe for concurrent builds: files appear atomically.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    @classmethod
    def of_user(cls) -> ObjectCache:
        """The user's: of everything but FMUs."""
        return cls(safe_files.cache_directory() / "objects")

    def library(
        self, toolchain: Toolchain, sources: Sequence[Path], include: Sequence[Path], name: str, *, loads: bool = False
    ) -> Path:
        """The shared library built from `sources`; every object is compiled once per content and toolchain.

        `loads`: it opens other libraries itself.
        """
        objects = [self.object(toolchain, s, include) for s in sources]
        key = self._key(toolchain, name.encode(), *(o.name.encode() for o in objects), *([b"loads"] if loads else []))

        def link(out: Path) -> None:
            named = out.with_name(f"{name}{out.suffix}")  # the name that the loader will find in the library
            toolchain.link(objects, named, loads=loads)
            named.replace(out)

        return self._kept(key, toolchain.platform.suffix, link)

    def program(self, toolchain: Toolchain, sources: Sequence[Path], include: Sequence[Path]) -> Path:
        """The program built from `sources`, which a process can run."""
        objects = [self.object(toolchain, s, include) for s in sources]
        key = self._key(toolchain, b"program", *(o.name.encode() for o in objects))
        path = self._kept(key, ".program", lambda out: toolchain.link_program(objects, out))
        path.chmod(0o755)
        return path

    def object(self, toolchain: Toolchain, source: Path, include: Sequence[Path]) -> Path:
        """The object file of one C file, compiled once per content and toolchain."""
        headers = included_headers(source, include)
        contents = [source.read_bytes(), *(h.name.encode() + b"\0" + h.read_bytes() for h in headers)]
        key = self._key(toolchain, *contents, flags=_flags(source))
        return self._kept(key, ".o", lambda out: toolchain.compile(source, out, include))

    @staticmethod
    def _key(toolchain: Toolchain, *parts: bytes, flags: tuple[str, ...] = CFLAGS) -> str:
        identity = f"{toolchain.platform.name}|{toolchain.version}|{flags}".encode()
        return hashlib.sha256(b"\0".join((identity, *parts))).hexdigest()[:32]

    def _kept(self, key: str, suffix: str, build: Callable[[Path], None]) -> Path:
        try:
            return safe_files.kept_file(self.directory, key, suffix)
        except safe_files.CacheMiss:
            return safe_files.keep_file(self.directory, key, suffix, build)
