"""The sources that an FMU of this project carries, as far as lanes need them, and why an FMU cannot have lanes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from weakref import WeakKeyDictionary

from build_fmus import compile as building
from cosim.core.description import Variable
from cosim.core.errors import FmuError
from cosim.fmu.file import FmuFile
from cosim.fmu.own_states import fnv1a

RUNTIME, _THIRD_PARTY = (Path(building.__file__).with_name(n) for n in ("runtime", "third_party"))
MUSL = _THIRD_PARTY / "musl"
# files whose operations lanes carry out
_SAME = ("equations.h", "fmu_core.c", "fmu_math.h", "integrators.c", "saved_state.h")


class NoLanes(Exception):  # noqa: N818
    """An FMU that is not vectorizable; the argument says why."""


@dataclass(frozen=True, eq=False)
class LaneSource:
    """What lanes of an FMU are made of (`build_fmus.generate.lane_table`).

    Attributes:
        token: instantiation token.
        continuous: whether the component is continuous.
        solver: its name.
        sample_time: of a discrete component [s].
        functions: the C functions there are.
        vectorized: whether lanes can call them.
        sizes: lengths of its vectors.
        bounds: by state, the magnitude beyond which it has blown up.
        places: role and slot of its variables, by value reference: in which vector, and where.
        hidden: (name, slot, size) of the states that are no variables.
        files: C files and headers by path below `sources/`.
        kept: (slot, size) of states that samples leave as they are.
        solves: whether its equations hold linear ones that are solved.
        approximates: whether OSQP solves one of its quadratic programs without a fallback, to a tolerance.
    """

    token: str
    continuous: bool
    solver: str
    sample_time: float
    functions: list[str]
    vectorized: bool
    sizes: dict[str, int]
    bounds: list[float] = field(repr=False)
    places: tuple[tuple[str, int], ...] = field(repr=False)
    hidden: list[tuple[str, int, int]] = field(repr=False)
    files: dict[str, bytes] = field(repr=False)
    kept: list[tuple[int, int]] = field(repr=False)
    solves: bool
    approximates: bool

    @property
    def one_at_a_time(self) -> str:
        """Why copies cannot lie side by side; empty where they can."""
        if self.sizes["qp_solution"]:
            return "it solves quadratic programs"
        if self.solves:
            return "it solves linear equations, each copy with its own pivots"
        return "its solver (ros2) chooses pivots, each copy its own" if self.solver == "ros2" else ""

    @property
    def profiles(self) -> bool:
        """Whether it computes random profiles, with code for one copy."""
        return "random_profiles.c" in self.files

    @property
    def solvers(self) -> list[str]:
        """C files that solve its quadratic programs, with those of the solvers."""
        rest = {"model.c", *(p.name for p in RUNTIME.glob("*.c") if not p.name.startswith("qp"))}
        return [n for n in self.files if n.endswith(".c") and not n.startswith("musl/") and n not in rest]

    @property
    def checks(self) -> bool:
        """Whether its initialization checks more than ranges: relations of parameters, or its solver."""
        return self.continuous or "checks" in self.functions

    def place(self, variable: Variable) -> tuple[str, int]:
        """Role and slot of a variable of the FMU."""
        role, slot = self.places[variable.reference]
        return role, slot + variable.index

    def first(self, role: str) -> int:
        """Where the vector of a role begins among the values of an instance."""
        counts = [self.sizes[r] for r in ("parameters", "inputs", "states", "states")]
        return sum(counts[: ("parameter", "input", "state", "derivative", "output").index(role)])

    @property
    def n_values(self) -> int:
        """Number of values of an instance, from its parameters to its outputs."""
        return self.first("output") + self.sizes["outputs"]

    def name_of(self, role: str, slot: int, variables: Iterable[Variable]) -> str:
        """Name of one of these variables, or of a hidden state, by its slot."""
        named = [(v.declared or v.name, self.place(v)) for v in variables]
        hidden = ((n, ("state", k)) for n, at, size in self.hidden for k in range(at, at + size))
        return next((n for n, place in (*named, *hidden) if place == (role, slot)), "")

    def settings(self, outputs: tuple[int, ...]) -> list[str]:
        """Settings in C of its lanes, of which the outputs with these slots are read."""
        tables = {"nominals": bool(self.bounds), "velocity_of": self.solver == "semi_implicit" and bool(self.bounds)}
        ends = [0, *(k for slot, size in sorted(self.kept) for k in (slot, slot + size)), self.sizes["states"]]
        moving = [(a, b - a) for a, b in zip(ends[::2], ends[1::2], strict=True) if b > a]
        constants = {
            **{f"N_{k.upper()}": n for k, n in self.sizes.items()},
            "N_SHOWN": len(outputs),
            "IS_CONTINUOUS": int(self.continuous),
            "HAS_START": int("start_states" in self.functions),
            "HAS_PROFILES": int(self.profiles),
            "SAMPLE_TIME": self.sample_time,
            "SOLVER": f"FMU_{self.solver.upper()}",
            "MODEL": f"0x{fnv1a(self.token.encode()):x}ull",
            "IS_ROS2": int(self.solver == "ros2"),
            **{k.upper(): k if there else "NULL" for k, there in tables.items()},
            "SHOWN(each)": " ".join(f"each({slot})" for slot in outputs),
            "MOVING(each)": " ".join(f"each({slot}, {size})" for slot, size in moving),
        }
        return [
            *(f"#define {k} {v}" for k, v in constants.items()),
            f"static const int shown[] = {{{', '.join(map(str, outputs)) or '0'}}};",
        ]


_known: WeakKeyDictionary[FmuFile, LaneSource] = WeakKeyDictionary()


def lane_source(fmu: FmuFile) -> LaneSource:
    """What lanes of an FMU are made of. Raises NoLanes saying why it has none."""
    if (known := _known.get(fmu)) is not None:
        return known
    if fmu.description.kind is None:
        raise NoLanes("it is no FMU of this project")
    try:
        files = fmu.files("sources/")
    except FmuError as error:
        raise NoLanes(str(error)) from None
    if "model.c" not in files:
        raise NoLanes("it has no sources" if not files else "it is a system in one FMU")
    other = NoLanes("its sources are those of another version of build-fmus: build it again")
    try:
        table = json.loads(files["lanes.json"])
        if table["token"] != fmu.description.token:
            raise NoLanes("its sources are not those of its binary")
        if table.pop("code") != hashlib.sha256(files["model.c"]).hexdigest():
            raise NoLanes("its sources have been changed")
        places = tuple((role, slot + k) for role, slot, n in table.pop("variables") for k in range(n))
        source = LaneSource(**table, places=places, files=files)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise other from None
    if not source.continuous and "sample" not in source.functions:
        raise NoLanes("it has no equations")
    if not source.vectorized:
        raise NoLanes("CasADi generated part of its code, such as an interpolant")
    if any(files.get(name) != data for name, data in _expected(frozenset(files)).items()):
        raise other
    _known[fmu] = source
    return source


@lru_cache
def _expected(names: frozenset[str]) -> dict[str, bytes]:
    """The runtime's own files, of which an FMU must have the same."""
    own = [*_SAME, *(n for n in names if n.startswith("qp") and (RUNTIME / n).exists())]
    return {
        n: (_THIRD_PARTY / n).read_bytes() for n in names if n.startswith("musl/") and (_THIRD_PARTY / n).exists()
    } | {n: (RUNTIME / n).read_bytes() for n in own}
