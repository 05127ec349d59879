"""The sources that an FMU of this project carries, as far as lanes need them, and why an FMU cannot have lanes."""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from build_fmus import compile as building
from cosim.fmu.file import FmuFile

RUNTIME, _THIRD_PARTY = (Path(building.__file__).with_name(n) for n in ("runtime", "third_party"))
MUSL = _THIRD_PARTY / "musl"
_SAME = (
    "equations.h",
    "fmu_core.c",
    "fmu_math.h",
    "integrators.c",
    "saved_state.h",
)  # of which lanes carry out the operations
_MODEL = re.compile(r"const FmuModel fmu_model = \{\n(.*?)\n\};", re.DOTALL)
_FIELD = re.compile(r"^ *\.(\w+) = (.+),$", re.MULTILINE)
_ROW = re.compile(r"^ *\{(\.name = .*)\},$", re.MULTILINE)
_IN_ROW = re.compile(r"\.(\w+) = (\"(?:[^\"\\]|\\.)*\"|[^,]+)")
_NUMBERS = re.compile(r"static const (?:double|int) (bounds|velocity_of)\[\] = \{[^}]*\};\n")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


class NoLanes(Exception):  # noqa: N818
    """An FMU that is not vectorizable; the argument says why."""


@dataclass(frozen=True)
class Row:
    """A variable of the FMU, at its value reference: in which vector, where, and its limits."""

    name: str
    type: str
    role: str
    slot: int
    size: int
    least: float
    most: float


@dataclass(frozen=True)
class LaneSource:
    """What lanes of an FMU are made of.

    Attributes:
        model: text of its `model.c` without comments.
        fields: of the runtime's FmuModel that are not 0, as text.
        rows: its variables, by value reference.
        files: C files and headers by path below `sources/`.
    """

    model: str = field(repr=False)
    fields: dict[str, str]
    rows: tuple[Row, ...] = field(repr=False)
    files: dict[str, bytes] = field(repr=False)

    @property
    def continuous(self) -> bool:
        """Whether the component is continuous."""
        return "is_continuous" in self.fields

    @property
    def solver(self) -> str:
        """Its name in C."""
        return self.fields.get("solver", "FMU_RK4")

    @property
    def one_at_a_time(self) -> str:
        """Why copies cannot lie side by side; empty where they can."""
        if "qp" in self.fields:
            return "it solves quadratic programs"
        return "its solver (ros2) chooses pivots, each copy its own" if self.solver == "FMU_ROS2" else ""

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
        return self.continuous or "checks" in self.fields

    def size(self, role: str) -> int:
        """Length of the vector of a role: parameters, inputs, states, outputs."""
        return int(self.fields.get(f"n_{role}", "0"))

    def first(self, role: str) -> int:
        """Where the vector of a role begins among the values of an instance."""
        counts = [self.size(r) for r in ("parameters", "inputs", "states", "states")]
        return sum(counts[: ("FMU_PARAMETER", "FMU_INPUT", "FMU_STATE", "FMU_DERIVATIVE", "FMU_OUTPUT").index(role)])

    @property
    def n_values(self) -> int:
        """Number of values of an instance, from its parameters to its outputs."""
        return self.first("FMU_OUTPUT") + self.size("outputs")

    def name_of(self, role: str, slot: int) -> str:
        """Name of a variable, or of a hidden state, by its slot."""
        for r in self.rows:
            if r.role == role and r.slot <= slot < r.slot + r.size:
                return r.name
        for text in re.findall(r"FmuHidden hidden\[\] = \{\n(.*?)\n\};", self.model, re.DOTALL):
            for found in _ROW.findall(text):
                row = dict(_IN_ROW.findall(found))
                if int(row["slot"]) <= slot < int(row["slot"]) + int(row["size"]):
                    return row["name"].strip('"')
        return ""

    def bound(self, state: int) -> float:
        """Magnitude beyond which a state has blown up."""
        text = next(m[0] for m in _NUMBERS.finditer(self.model) if m[1] == "bounds")
        return float(text[text.index("{") + 1 : text.index("}")].split(",")[state])

    def settings(self, outputs: tuple[int, ...]) -> list[str]:
        """Settings in C of its lanes, of which the outputs with these slots are read. Raises NoLanes."""
        there = self.model.partition("#ifndef LANES")[0]
        jacobian = ["jacobian"] if self.solver == "FMU_ROS2" else []
        for name in ("start_states", "derivatives", "outputs", "program_data", "sample", *jacobian):
            if name in self.fields and f"static void {name}(" not in there:
                raise NoLanes(f"lanes cannot follow its sources: there is no function {name}")
        constants = {
            "N_PARAMETERS": self.size("parameters"),
            "N_INPUTS": self.size("inputs"),
            "N_STATES": self.size("states"),
            "N_OUTPUTS": self.size("outputs"),
            "N_WORK": self.size("work"),
            "N_FIXED": self.size("fixed"),
            **{f"N_QP_{k.upper()}": self.size(f"qp_{k}") for k in ("data", "solution", "memory")},
            "N_SHOWN": len(outputs),
            "IS_CONTINUOUS": int(self.continuous),
            "HAS_START": int("start_states" in self.fields),
            "HAS_PROFILES": int(self.profiles),
            "SAMPLE_TIME": self.fields.get("sample_time", "0.0"),
            "SOLVER": self.solver,
            "IS_ROS2": int(self.solver == "FMU_ROS2"),
            **{k.upper(): k if k in self.fields else "NULL" for k in ("nominals", "velocity_of")},
            "SHOWN(each)": " ".join(f"each({slot})" for slot in outputs),
        }
        return [
            *(f"#define {k} {v}" for k, v in constants.items()),
            f"static const int shown[] = {{{', '.join(map(str, outputs)) or '0'}}};",
        ]


def lane_source(fmu: FmuFile) -> LaneSource:
    """What lanes of an FMU are made of. Raises NoLanes saying why it has none."""
    if fmu.description.kind is None:
        raise NoLanes("it is no FMU of this project")
    files = _sources(fmu.path)
    if "model.c" not in files:
        raise NoLanes("it has no sources" if not files else "it is a system in one FMU")
    model = _COMMENT.sub(" ", files["model.c"].decode())
    found = _MODEL.search(model)
    if found is None:
        raise NoLanes("its sources are those of another version of build-fmus")
    fields = dict(_FIELD.findall(found[1]))
    if fields.get("token", "").strip('"') != fmu.description.token:
        raise NoLanes("its sources are not those of its binary")
    if "is_continuous" not in fields and "sample" not in fields:
        raise NoLanes("it has no equations")
    if any(files.get(name) != data for name, data in _expected(frozenset(files)).items()):
        raise NoLanes("its sources are those of another version of build-fmus: build it again")
    rows = tuple(map(_row, _ROW.findall(model.partition("variables[] = {")[2].partition("\n};")[0])))
    if len(rows) != int(fields.get("n_variables", "0")):
        raise NoLanes("its sources are those of another version of build-fmus")
    source = LaneSource(model, fields, rows, files)
    source.settings(tuple(range(source.size("outputs"))))
    return source


@lru_cache
def _expected(names: frozenset[str]) -> dict[str, bytes]:
    """The runtime's own files, of which an FMU must have the same."""
    own = [*_SAME, *(n for n in names if n.startswith("qp") and (RUNTIME / n).exists())]
    return {
        n: (_THIRD_PARTY / n).read_bytes() for n in names if n.startswith("musl/") and (_THIRD_PARTY / n).exists()
    } | {n: (RUNTIME / n).read_bytes() for n in own}


def _row(text: str) -> Row:
    row = dict(_IN_ROW.findall(text))
    limits = {"INFINITY": "inf", "-INFINITY": "-inf"}
    least, most = (row.get(k, d).strip() for k, d in (("min", "-inf"), ("max", "inf")))
    return Row(
        row["name"].strip('"'),
        row.get("type", "FMU_FLOAT64"),
        row["role"],
        int(row["slot"]),
        int(row["size"]),
        float(limits.get(least, least)),
        float(limits.get(most, most)),
    )


def _sources(path: Path) -> dict[str, bytes]:
    """Files below `sources/` of an FMU or of the folder of one."""
    prefix = "sources/"
    if path.is_dir():
        folder = path / prefix
        return {f.relative_to(folder).as_posix(): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}
    try:
        with zipfile.ZipFile(path) as archive:
            names = [n for n in archive.namelist() if n.startswith(prefix) and not n.endswith("/")]
            return {n.removeprefix(prefix): archive.read(n) for n in names}
    except (OSError, zipfile.BadZipFile) as error:
        raise NoLanes(f"{path} cannot be read again ({error})") from None
