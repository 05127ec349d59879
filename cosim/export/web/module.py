"""Systems as one WebAssembly module, compiled by ziglang: plans, engine, components and the functions for the page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from build_fmus.base import safe_files
from build_fmus.compile import WASM, CompileError, ObjectCache, find_toolchain, find_zig, host
from cosim.core.errors import CosimError
from cosim.export.code import CONTAINER, SystemCode, template
from cosim.export.parts import Part, defined_names, wrappers

_HERE = Path(__file__).parent
_OWN = tuple(_HERE / name for name in ("web.c", "web.h"))
_MODELS, _PLAN = "web_models.c", "plan.c"
_FMI = 3
# what is compiled once for each system, beside its plan
_PER_SYSTEM = (*(p.name for p in CONTAINER if p.suffix == ".c"), f"fmi{_FMI}.c", "fmu_base.c")


@dataclass(frozen=True)
class Module:
    """A compiled module. Its models: the systems in their order, then the FMUs that were asked for alone."""

    content: bytes
    n_systems: int
    alone: tuple[Part, ...]

    def model(self, part: Part) -> int:
        """The number by which a page asks for such an FMU; that of a system is its place."""
        return self.n_systems + self.alone.index(part)


def compile_module(codes: Sequence[SystemCode], alone: Iterable[Part] = ()) -> Module:
    """Compile one module of systems, which share the components that they have in common (their `known`).

    `alone`: FMUs of components that can also be instantiated by themselves.

    Raises:
        CosimError: a component without sources, or one in `alone` of another FMI version than the systems.
        CompileError: no ziglang, or sources that do not compile.
    """
    parts = tuple(dict.fromkeys(alone))
    for code in codes:
        for component, part in code.parts.items():
            if not part.linked:
                raise CosimError(
                    f"'{component.name}' ({part.fmu.path}) has no sources that a page could be compiled from; use an"
                    " FMU that build-fmus makes"
                )
    for part in parts:
        if part.version != _FMI:
            raise CosimError(f"{part.fmu.path} is an FMU of FMI {part.version}.0; a page needs FMUs of FMI {_FMI}.0")
    toolchain = find_zig(WASM)
    if toolchain is None:
        raise CompileError(
            "a web page is compiled by ziglang, which is not installed: pip install 'suspension-fmus[zig]'"
        )
    files = {name: data for code in codes for name, data in code.files().items()}
    own = {name: files.pop(name) for name in _PER_SYSTEM}
    files |= {p.name: p.read_bytes() for p in _OWN}
    systems = [f"system{i}" for i in range(len(codes))]
    for name, code in zip(systems, codes, strict=True):
        files |= {f"{name}/{n}": d for n, d in own.items()}
        files[f"{name}/{_PLAN}"] = code.plan_c(name).encode()
    models = {"systems": systems, "parts": parts}
    files[_MODELS] = template("web_models.c.j2").render(models).encode()
    each = [*_PER_SYSTEM, _PLAN]
    with safe_files.scratch_files(files) as folder:
        names = defined_names(folder / systems[0], each, [folder / systems[0], folder], find_toolchain(host()))
    for name in systems:
        files |= wrappers(name, _FMI, each, names)
    with safe_files.scratch_files(files) as folder:
        sources = [folder / n for n in sorted(files) if n.endswith(".c") and ("/" not in n or n.startswith("musl/"))]
        library = ObjectCache.of_user().library(toolchain, sources, [folder], "systems")
        return Module(library.read_bytes(), len(codes), parts)
