"""The folder of a component for a target: C file, header, static library, metrics.json."""

from __future__ import annotations

import hashlib
import json
import re
import warnings
from pathlib import Path
from typing import Any

from build_fmus.base import safe_files
from build_fmus.component import Component, Model
from build_fmus.generate import RUNTIME_DIR, references, ticks
from build_fmus.target.a2l import a2l, example_places, example_program
from build_fmus.target.assemble import Library, TargetError, assemble, rename_externals
from build_fmus.target.cycles import core_of
from build_fmus.target.errors import single_errors
from build_fmus.target.stack import worst_stack
from build_fmus.target.toolchain import CFLAGS, Target, Tools, find_tools, library_frames

FUNCTIONS = ("init", "set_parameter", "step")
_REQUEST = 32768  # bytes of samples in one request of the host at most, if one sample is not larger
# Every C environment has these functions, which compilers call on their own, and arithmetic of the processor's family.
_ALLOWED = re.compile(r"mem(cpy|set|move|cmp)|__aeabi_\w+|_GLOBAL_OFFSET_TABLE_")


class SourceWarning(UserWarning):
    """A component whose C code has warnings of the compiler."""


def build_library(component: Component, target: Target, out: Path, precision: str = "double") -> Path:
    """Write the folder of a component to `out`, and return it. Two builds with one compiler are byte-identical.

    Args:
        component: what is built.
        target: the processor.
        out: folder with one folder per target; single precision has others, such as `cortex-m4f-single`.
        precision: "double" or "single".

    Raises:
        TargetError: the component cannot become a library, or the library breaks a rule: it calls another one, has
            global variables, or its stack is not known.
        CompileError: the compiler or a tool is missing or failed.
    """
    model = component.model()
    if failed := model.failed_checks():
        raise TargetError(f"{model.name}: its own start values fail a check: {failed[0]}")
    model.dimensions.check()
    tools, library = find_tools(target), assemble(model, precision)
    with safe_files.scratch_files({}) as tmp:
        content = _compile(library, tools, tmp)
        metrics = _measure(model, library, tools, tmp)
        if precision == "single":
            metrics["single_errors"] = single_errors(model, assemble(model), library, tmp)
        if target.prefix:
            content["example.elf"], content[f"{model.name}.a2l"] = _example(model, tools, tmp, precision)
        if target.board:
            interface = _interface(model, target) | {"precision": precision, "state_bytes": metrics["ram_bytes"]}
            content["firmware.elf"] = _firmware(library.name, interface["frame"], tools, tmp)
            content["interface.json"] = (json.dumps(interface, indent=1) + "\n").encode()
    content |= library.notices | {"metrics.json": (json.dumps(metrics, indent=1) + "\n").encode()}
    folder = out / (target.name if precision == "double" else f"{target.name}-{precision}") / library.name
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in content.items():
        safe_files.write(folder / name, data)
    return folder


def _compile(library: Library, tools: Tools, tmp: Path) -> dict[str, bytes]:
    """Header, C file and library, also as files in `tmp`; of the library only what the functions need."""
    name = library.name
    source, header, archive = f"{name}.c", f"{name}.h", f"lib{name}.a"
    (tmp / header).write_text(library.header)
    (tmp / source).write_text(library.code)
    tools.compile(source, "all.o", tmp)
    defined = tools.tool("nm", "-g", "--defined-only", "all.o", folder=tmp)
    names, known = {line.split()[-1] for line in defined.splitlines()}, set(re.findall(r"\w+", library.code))
    # Some platforms put an underscore in front of every name.
    (tmp / source).write_text(rename_externals(library, (n if n in known else n.removeprefix("_") for n in names)))
    graph = ("-fstack-usage", "-fcallgraph-info=su") if tools.is_gcc else ()
    if found := tools.compile(source, "all.o", tmp, *graph):
        more = f" ({len(found)} different warnings)" if found[1:] else ""
        warnings.warn(f"{name}: the compiler warns of its C code: {found[0]}{more}", SourceWarning, stacklevel=3)
    keep = [f"{name}_{f}" for f in FUNCTIONS]
    needed = [f"-u{k}" for k in keep]
    tools.tool("ld", "-r", "--gc-sections", *needed, "all.o", "-o", f"{name}.o", folder=tmp)
    tools.tool("objcopy", *(f"--keep-global-symbol={k}" for k in keep), f"{name}.o", folder=tmp)
    tools.tool("ar", "rcD", archive, f"{name}.o", folder=tmp)
    return {n: (tmp / n).read_bytes() for n in (source, header, archive)}


def _measure(component: Model, library: Library, tools: Tools, tmp: Path) -> dict[str, Any]:
    """What `metrics.json` says; refuses a library that breaks a rule."""
    name = library.name
    undefined = {n.split()[-1] for n in tools.tool("nm", "-u", f"{name}.o", folder=tmp).splitlines()}
    if foreign := sorted(n for n in undefined if not _ALLOWED.fullmatch(n)):
        raise TargetError(f"{name} calls {foreign[0]} of a library; a target has its own mathematics only")
    flash = ram = 0
    for line in tools.tool("objdump", "-h", "-w", f"{name}.o", folder=tmp).splitlines():
        words = line.split()
        if len(words) < 7 or "ALLOC" not in line or ".eh_frame" in line:
            continue
        constant = "READONLY" in line or words[1].startswith(".data.rel.ro")
        flash, ram = (flash + int(words[2], 16), ram) if constant else (flash, ram + int(words[2], 16))
    if ram:
        raise TargetError(f"{name} has {ram} bytes of global variables; all variables belong into its struct")
    arm, core = bool(tools.target.prefix), core_of(tools.target.name)
    if arm and (fused := re.search(r"\tvfn?m[as]\S*", tools.tool("objdump", "-d", f"{name}.o", folder=tmp))):
        raise TargetError(f"{name} has the fused multiplication {fused[0].strip()}, which would change bits")
    (tmp / "size.c").write_text(f'#include "{name}.h"\nchar instance[sizeof({name})];\n')
    tools.compile("size.c", "size.o", tmp)
    size = int(tools.tool("nm", "-S", "size.o", folder=tmp).split()[1], 16)
    stack: int | None = None
    # DAQP moves the best pivot to the end of the active rows, of which there is one less each time inside another.
    rows = 1 + max((q.n for q in component.programs), default=0)
    recursions = {f"{name}_daqp_pivot_last": rows} if component.programs else {}
    if tools.is_gcc:
        frames = _frames(name, undefined, tools, tmp) if arm else None
        code = (tmp / f"{name}.c").read_text()
        entries = [f"{name}_{f}" for f in FUNCTIONS]
        stack = worst_stack((tmp / "all.ci").read_text(), code, entries, frames, recursions)
    return {
        "component": name,
        "target": tools.target.name,
        "compiler": tools.version,
        "flags": [*CFLAGS, *tools.target.flags],
        "precision": library.precision,
        "source_sha256": hashlib.sha256((tmp / f"{name}.c").read_bytes()).hexdigest(),
        "sample_time_s": component.sample_time,
        "flash_bytes": flash,
        "ram_bytes": size,
        "stack_bytes": stack,
        "stack_assumes": [f"{n} is called inside itself at most {k} times" for n, k in recursions.items()],
        "stack_without": [] if arm else sorted(undefined),
        "needs": sorted(undefined),
        "cycles_estimate": core.estimate(float(ticks(component))) if core else None,
    }


def _frames(name: str, undefined: set[str], tools: Tools, tmp: Path) -> dict[str, tuple[int, set[str]]]:
    """Stack of the functions of the C environment that a library needs."""
    needed = [f"-Wl,-u{n}" for n in (*sorted(undefined), *(f"{name}_{f}" for f in FUNCTIONS))]
    tools.link([f"{name}.o", "-nostartfiles", "-Wl,--gc-sections", "-Wl,-e0", *needed], "all.elf", tmp)
    symbols = tools.tool("nm", "--defined-only", "all.elf", folder=tmp)
    return library_frames(tools.tool("objdump", "-d", "all.elf", folder=tmp), symbols)


def _example(component: Model, tools: Tools, tmp: Path, precision: str) -> tuple[bytes, bytes]:
    """A program with an instance, which is linked but does nothing, and the A2L file with its addresses."""
    name = component.name
    (tmp / "example.c").write_text(example_program(name))
    (tmp / "offset.c").write_text(f'#include <stddef.h>\n#include "{name}.h"\nchar at[offsetof({name}, prepared)];\n')
    for part in ("example", "offset"):
        tools.compile(f"{part}.c", f"{part}.o", tmp)
    prepared = int(tools.tool("nm", "-S", "offset.o", folder=tmp).split()[1], 16)
    place = ["-nostartfiles", "-Wl,-e0", "-Wl,-Tbss=0x20000000", "-Wl,--build-id=none"]
    tools.link(["example.o", f"{name}.o", *place], "example.elf", tmp)
    symbols = (line.split() for line in tools.tool("nm", "example.elf", folder=tmp).splitlines())
    addresses = {words[-1]: int(words[0], 16) for words in symbols if len(words) == 3}
    places = example_places(component, addresses, prepared, precision)
    return (tmp / "example.elf").read_bytes(), a2l(component, places, precision).encode("ascii")


def _firmware(name: str, frame: int, tools: Tools, tmp: Path) -> bytes:
    """A program that takes samples for a host, for the board that QEMU emulates."""
    text = (RUNTIME_DIR / "firmware.c").read_text()
    (tmp / "firmware.c").write_text(re.sub(r"\bComponent(?=_|\b)", name, text))
    (tmp / "firmware.ld").write_bytes((RUNTIME_DIR / "firmware.ld").read_bytes())
    tools.compile("firmware.c", "firmware.o", tmp, f"-DFRAME={frame}")
    objects = ["firmware.o", f"{name}.o", "-nostartfiles", "-Wl,--gc-sections", "-Wl,-Tfirmware.ld", "-Wl,-s"]
    tools.link([*objects, "-Wl,--build-id=none"], "firmware.elf", tmp)
    return (tmp / "firmware.elf").read_bytes()


def _interface(component: Model, target: Target) -> dict[str, Any]:
    """What a host has to know of the firmware: variables in the order of the structs."""

    def named(role: Any) -> list[list[str]]:
        return [[e.name, e.variable.unit or ""] for e in component.elements(role)]

    parameters = []
    for i, r in enumerate(references(component, arrays=True)):
        if r.variable.role == "parameter":
            for k, (name, start) in enumerate(zip(r.element_names, r.start or (), strict=True)):
                parameters.append([name, r.variable.unit or "", float(start), i, k])
    return {
        "component": component.name,
        "board": target.board,
        "sample_time": str(ticks(component)),
        "has_addresses": bool(component.programs),
        "frame": max(1, _REQUEST // (8 * max(component.size("input"), component.size("output") + 1))),
        "inputs": named("input"),
        "input_starts": [float(x) for x in component.vector("input")],
        "outputs": named("output"),
        "parameters": parameters,
    }
