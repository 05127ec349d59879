"""Compiled parts of a batch for one kind of processor: the engine for groups of copies, and the lanes of each FMU."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cffi

from build_fmus.base import safe_files
from build_fmus.base.checks import unknown
from build_fmus.compile import CompileError, ObjectCache, find_toolchain, host
from cosim.batch.lane_source import MUSL, LaneSource
from cosim.batch.lane_source import RUNTIME as OF_FMUS
from cosim.batch.unread_outputs import without_unread_outputs
from cosim.core.c_headers import declarations
from cosim.core.errors import CosimError
from cosim.engine import library as engine
from cosim.fmu.environment import HEADER as ENVIRONMENT

STEP_DIRECTIONS = 16  # along which the derivatives of a step are computed together
_HERE = Path(__file__).parent / "runtime"
_HEADER = _HERE / "batch.h"
STEP_HEADER = _HERE / "step_derivatives.h"
_EXPORTED = """
void cosim_batch_run(Batch *b, BatchWorker *w, int64_t tick, int64_t end, bool final);
void cosim_batch_settle(Batch *b, BatchWorker *w);
size_t cosim_lanes_rows(void);
size_t cosim_lanes_sides(void);
size_t cosim_lanes_numbers(void);
size_t cosim_lanes_memory(void);
void cosim_use_tape(Tape *of);
void cosim_sweep_back(const Tape *t, double *of, TapeCount first, int32_t n);
void cosim_lanes_prepare(void *memory);
unsigned cosim_lanes_begin(void *memory, double t, double h, unsigned of);
unsigned cosim_lanes_step(void *memory, double t, double h, unsigned of);
unsigned cosim_processor(void);
"""
_PROFILES = """#include "model.c"

const double *lane_profiles(const double *p) {
    static __thread double work[N_WORK];
    const FmuArguments at = {.p = p, .w = work};
    return profiles(&at);
}
"""


@dataclass(frozen=True)
class Target:
    """Vector instructions: name, copies side by side, LANES_TARGET, and the processor flags that they require.

    `directions`: in which each number has derivatives (tangents.h), `part` of them in a vector; copies are then alone.
    `adjoints`: a number has an index in their place (adjoints.h).
    """

    name: str
    lanes: int
    number: int
    needs: int
    directions: int = 0
    part: int = 0
    adjoints: bool = False

    @property
    def width(self) -> int:
        """Numbers of a value of a group; derivatives are the last."""
        return self.first + self.directions

    @property
    def first(self) -> int:
        """Number of a value's first derivative."""
        return self.part or self.lanes

    def with_tangents(self, directions: int) -> Target:
        """Of copies that have derivatives in so many directions, in whole vectors."""
        return replace(self, name=f"{self.name}_tangents_{directions}", lanes=1, directions=directions, part=self.lanes)

    def with_adjoints(self) -> Target:
        """Of one copy whose operations are kept."""
        return replace(self, name=f"{self.name}_adjoints", lanes=1, directions=1, adjoints=True)

    @property
    def settings(self) -> dict[str, int]:
        """Its names in C."""
        told = {"LANES": self.lanes, "LANES_TARGET": self.number}
        if self.adjoints:
            return told | {"ADJOINTS": 1}
        return told | ({"TANGENTS": self.directions, "PART": self.part} if self.directions else {})


TARGETS = {t.name: t for t in (Target("avx512", 8, 512, 2), Target("avx2", 4, 2, 1), Target("baseline", 2, 0, 0))}


def choose_target(name: str = "auto") -> Target:
    """Choose the vector instructions to compile for; "auto" is the widest that this processor has.

    Raises CosimError for instructions that the processor does not have, and without a compiler.
    """
    found = _processor()
    if name == "auto":
        return next(t for t in TARGETS.values() if found & t.needs == t.needs)
    if name not in TARGETS:
        raise CosimError(unknown("kind of vector instructions", name, ("auto", *TARGETS)))
    target = TARGETS[name]
    if found & target.needs != target.needs:
        raise CosimError(f"this processor has no {name}; vectors='auto' takes what it has")
    return target


@lru_cache
def interface() -> cffi.FFI:
    """The types of `engine.h` and `batch.h`."""
    ffi = cffi.FFI()
    ffi.include(engine.interface())
    ffi.cdef(declarations(_HEADER) + _EXPORTED)
    return ffi


@lru_cache
def _processor() -> int:
    source = (_HERE / "processor.c").read_bytes()
    return int(_loaded_from({"processor.c": source}, ("processor.c",), "processor").cosim_processor())


@lru_cache
def batch_library(target: Target) -> Any:
    """The engine of groups."""
    own = ("engine.c", "algebraic_loop.c")
    name, code = _over(target, "batch", [], ["VALUEs.h", "batch.c"])
    sources = {name: code, **{n: engine.HEADER.with_name(n).read_bytes() for n in own}}
    return _loaded_from(sources, (name, *own), f"batch_{target.name}")


def _over(target: Target, name: str, settings: Sequence[str], included: Sequence[str]) -> tuple[str, bytes]:
    """Name and content of a file of code over vectors, or over numbers with derivatives, which is C++."""
    value = "number" if target.directions else "lane"
    before, *rest = (f'#include "{file}"'.replace("VALUE", value) for file in included)
    lines = ['extern "C" {', *rest, "}"] if target.directions else rest
    code = [*(f"#define {k} {v}" for k, v in target.settings.items()), before, *settings, *lines, ""]
    return f"{name}_of_{value}s.{'cpp' if target.directions else 'c'}", "\n".join(code).encode()


@lru_cache(maxsize=256)
def lane_library(source: LaneSource, outputs: tuple[int, ...], target: Target, *, still: bool = False) -> Any:
    """Lanes of an FMU, of which outputs with these slots are read, and where nothing may move if it is `still`.

    Raises CosimError without a compiler.
    """
    return _loaded_from(*_lane_files(source, outputs, target, (), still=still))


def step_library(source: LaneSource) -> Path:
    """The library of step_derivatives.h for an FMU, for every processor. Raises CosimError without a C++ compiler."""
    outputs = tuple(range(source.sizes["outputs"]))
    return _compiled(
        *_lane_files(source, outputs, TARGETS["baseline"].with_tangents(STEP_DIRECTIONS), ["step_component.h"])
    )


def _lane_files(
    source: LaneSource, outputs: tuple[int, ...], target: Target, further: Sequence[str], *, still: bool = False
) -> tuple[dict[str, bytes], tuple[str, ...], str]:
    """Files of a library, those that are compiled, and its name."""
    included = ["VALUE_equations.h", "lane_profiles.h", "model.c", "lane_component.h", *further]
    plain = bool(target.directions) and not further and not source.one_at_a_time
    settings = [*source.settings(outputs), f"#define HAS_PLAIN {int(plain)}", f"#define STILL {int(plain and still)}"]
    name, code = _over(target, "component", settings, included)
    files = {n: d for n, d in source.files.items() if n.startswith("musl/") or n.endswith(".h")}
    if target.directions:
        files |= {f"musl/{p.name}": p.read_bytes() for p in MUSL.glob("*.[ch]")}  # derivatives call others
    mathematics = [n for n in files if n.startswith("musl/") and n.endswith(".c")]
    sources = [name, *mathematics]
    if target.directions:
        files |= {n: source.files[n] for n in source.solvers}
        sources += source.solvers
    files["model.c"] = without_unread_outputs(source.files["model.c"].decode(), outputs).encode()
    if plain:  # where nothing moves (lane_component.h)
        names = [f"#define cosim_lanes_{n} plain_{n}" for n in re.findall(r"cosim_lanes_(\w+)", _EXPORTED)]
        of_plain, code_of_plain = _over(TARGETS["baseline"], "component", [*source.settings(outputs), *names], included)
        files[of_plain] = code_of_plain
        sources.append(of_plain)
    if source.profiles:  # each copy has its own, which the FMU's own code computes
        files |= {
            "random_profiles.c": source.files["random_profiles.c"],
            "profiles.c": f"#define N_WORK {source.sizes['work']}\n{_PROFILES}".encode(),
        }
        sources += ["profiles.c", "random_profiles.c"]
    return files | {name: code}, tuple(sources), f"lanes_{target.name}"


_loaded: dict[bytes, Any] = {}  # by the digest of what a library is compiled from


def _loaded_from(files: Mapping[str, bytes], sources: tuple[str, ...], name: str) -> Any:
    """A library of these files, looked for once per process."""
    digest = hashlib.sha256(repr((name, sources)).encode())
    for path, data in sorted(files.items()):
        digest.update(f"{path} {len(data)} ".encode() + data)
    known = _loaded.get(digest.digest())
    if known is None:
        known = _loaded[digest.digest()] = interface().dlopen(str(_compiled(files, sources, name)))
    return known


def _compiled(files: Mapping[str, bytes], sources: tuple[str, ...], name: str) -> Path:
    """A library of these files, compiled once per machine and content."""
    try:
        with safe_files.scratch_files(files) as folder:
            include = [folder, _HERE, engine.HEADER.parent, ENVIRONMENT.parent, OF_FMUS]
            paths = [folder / s for s in sources]
            return ObjectCache.of_user().library(find_toolchain(host()), paths, include, name)
    except (CompileError, OSError) as error:
        said = str(error).splitlines()
        why = next((line for line in said if "error" in line), said[0])
        needs = "a gradient needs a C++" if any(s.endswith(".cpp") for s in sources) else "a batch needs a C"
        raise CosimError(f"{needs} compiler, and that failed: {why}") from error
