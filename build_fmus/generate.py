"""C code of one component: CasADi functions, variable table, start values."""

from __future__ import annotations

import hashlib
import json
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from importlib import metadata
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np

from build_fmus import qp, random_profiles
from build_fmus.base.escape import c_comment, c_string
from build_fmus.component import Model, Variable
from build_fmus.equations.functions import Functions
from build_fmus.equations.names import WIDTH, Struct
from build_fmus.equations.operators import constant
from build_fmus.mathematics import math_files
from build_fmus.qp_sources import THIRD_PARTY, ThirdParty

RUNTIME_DIR = Path(__file__).parent / "runtime"
RUNTIME_SOURCES = ("fmu_base.c", "fmu_core.c", "integrators.c", "stability.c")
RUNTIME_HEADERS = (
    "equations.h",
    "fmu_base.h",
    "fmu_core.h",
    "fmu_math.h",
    "fmu_model.h",
    "integrators.h",
    "saved_state.h",
    "stability.h",
)

_ROLES = {
    "time": "FMU_TIME",
    "parameter": "FMU_PARAMETER",
    "input": "FMU_INPUT",
    "state": "FMU_STATE",
    "derivative": "FMU_DERIVATIVE",
    "output": "FMU_OUTPUT",
}
# A state this many times its nominal value has blown up. The largest legal ones are 1e5 times theirs (start.x = 1e6 m
# with a nominal value of 10 m), those of the reference runs 10 times. Where no nominal value is declared, a
# state may be anything (a pressure in Pa), and only what no unit explains is refused.
_BLOWN_UP, _BLOWN_UP_UNKNOWN = 1e6, 1e12
_TYPES = {"Float64": "FMU_FLOAT64", "Int32": "FMU_INT32", "Boolean": "FMU_BOOLEAN"}


@dataclass(frozen=True)
class Reference:
    """One FMI variable: a declared variable (FMI 3 arrays) or one of its elements (default)."""

    name: str
    variable: Variable
    index: int | None  # None: the whole variable

    @property
    def shape(self) -> tuple[int, ...]:
        """Dimensions the FMI variable has."""
        return self.variable.shape if self.index is None else ()

    @property
    def slot(self) -> int:
        """First position in the vector of the variable's role."""
        return self.variable.slot + (self.index or 0)

    @property
    def start(self) -> tuple[float, ...] | None:
        """Start values, None when calculated."""
        start = self.variable.start
        return start if start is None or self.index is None else (start[self.index],)

    @property
    def element_names(self) -> list[str]:
        """Names of the scalar elements behind this FMI variable."""
        names = self.variable.element_names()
        return names if self.index is None else [names[self.index]]


def references(component: Model, *, arrays: bool) -> list[Reference]:
    """All FMI variables; the position in the list is the value reference."""
    result = []
    for v in component.variables:
        if arrays:
            result.append(Reference(v.name, v, None))
        else:
            result.extend(Reference(n, v, i) for i, n in enumerate(v.element_names()))
    return result


def is_exact(v: Variable) -> bool:
    """Whether the variable has a start value that the user may set."""
    return v.role in ("parameter", "input") or (v.role == "state" and v.start is not None)


def _number(x: float | None, default: float = 0.0) -> str:
    return constant(default if x is None else float(x)).code


def _table(kind: str, name: str, items: Iterable[str]) -> str:
    """A constant array, one item to a line."""
    return "\n".join([f"static const {kind} {name}[] = {{", *(f"    {item}," for item in items), "};", ""])


def _numbers(kind: str, name: str, items: Iterable[str]) -> str:
    """A constant array of short items."""
    return "\n".join([f"static const {kind} {name}[] = {{", _wrapped(", ".join(items)), "};", ""])


def _wrapped(text: str, indent: str = "    ") -> str:
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)


def _fields(**values: object) -> str:
    """A struct by the fields that are not 0, in their order."""
    return (
        "{"
        + ", ".join(f".{k} = {v}" if v != "FMU_NO_LIMITS" else str(v) for k, v in values.items() if v not in (0, None))
        + "}"
    )


def _variable(r: Reference) -> str:
    """Row of the table of variables."""
    v = r.variable
    limits: dict[str, object] = {"limits": "FMU_NO_LIMITS"}
    if v.min is not None or v.max is not None:
        limits = {"min": _number(v.min, -math.inf), "max": _number(v.max, math.inf)}
    constant = {} if v.must_equal is None else {"must_equal": _number(v.must_equal), "tolerance": _number(v.tolerance)}
    return _fields(
        name=c_string(r.name),
        type=None if v.type == "Float64" else _TYPES[v.type],
        role=_ROLES[v.role],
        slot=str(r.slot),
        size=str(math.prod(r.shape)),
        is_exact=int(v.role == "state" and v.start is not None),
        is_tunable=int(v.tunable),
        **limits,
        **constant,
    )


def _start(component: Model, structs: Mapping[str, Struct]) -> str:
    """Start values of parameters, inputs and states, those other than 0."""
    kinds, values = [], []
    for pointer, role in (("p", "parameter"), ("u", "input"), ("x", "state")):
        if pointer not in structs:
            continue
        kinds.append(f"    {structs[pointer].name} {pointer};")
        vector = component.vector(role)  # type: ignore[arg-type]
        fields = [(m, vector[m.slot : m.slot + m.size]) for m in structs[pointer].fields]
        given = [f"        .{m.name} = {_initial(x, m.shape)}," for m, x in fields if x.any()]
        if given:
            values.append("\n".join([f"    .{pointer} = {{", *given, "    },"]))
    if not kinds:
        return ""
    head = ["static const struct {", *kinds]
    return "\n".join([*head, "} start = {", *values, "};", ""] if values else [*head, "} start = {0};", ""])


def _initial(values: np.ndarray, shape: tuple[int, ...]) -> str:
    if not shape:
        return _number(values[0])
    if len(shape) == 2:
        rows = [_initial(row, shape[1:]) for row in values.reshape(shape)]
        return "{\n" + "\n".join(_wrapped(f"{row},", " " * 12) for row in rows) + "\n        }"
    text = "{" + ", ".join(_number(x) for x in values) + "}"
    return text if len(text) < WIDTH - 40 else "{\n" + _wrapped(text[1:-1], " " * 12) + "\n        }"


def _head(component: Model) -> str:
    """What a reader should know before the first line of code."""
    papers = [f"{name}: {title}" for name, title in cited(component).items()]
    about = "c" if component.kind == "continuous" else "d"
    reading = {
        "c": "fmu_core.c calls the functions below, integrators.c that of the derivatives",
        "d": "fmu_core.c calls the functions below, at each sample instant first for the outputs and the next states",
    }[about]
    paragraphs = [
        f"{component.name}. Generated from its declaration, do not edit.",
        f"Equations: {component.source}.",
        *papers,
        f"{reading}; modelDescription.xml says what it is, and where the values of parameters come from.",
    ]
    lines = [line for p in paragraphs for line in textwrap.wrap(c_comment(p), WIDTH - 3, break_long_words=False)]
    return "/* " + "\n * ".join(lines) + " */"


_written: WeakKeyDictionary[Model, Functions] = WeakKeyDictionary()


def written_functions(component: Model) -> Functions:
    """The C functions of a component, written once for all versions of FMI."""
    if component not in _written:
        _written[component] = Functions(component)
    return _written[component]


def ticks(component: Model) -> Fraction:
    """The sample time of a discrete component, exactly [s]."""
    near = Fraction(component.sample_time or 0).limit_denominator(10**6)
    return near if float(near) == component.sample_time else Fraction(repr(component.sample_time))


FIRST_INSTANCE = "first_instance"  # a global variable of model.c
MARK = b"first instance:\0"
"""How the memory of the first instance begins in a binary."""


def generate_c(component: Model, *, arrays: bool, token: str, clocks: bool = False, first: bool = False) -> str:
    """The complete `model.c` of a component; deterministic for a given CasADi version.

    Args:
        component: to write.
        arrays: array variables instead of scalar elements.
        token: instantiation token.
        clocks: of FMI 3.0, a discrete component may be sampled by a clock.
        first: a discrete component has the memory of the first instance in the binary.
    """
    functions = written_functions(component)
    headers = ["equations.h", "fmu_model.h", *(random_profiles.HEADERS if component.profiles else ())]
    refs = references(component, arrays=arrays)
    states = component.of("state")
    hidden = [v for v in states if not v.exposed]
    continuous, solver = component.kind == "continuous", component.solver
    points = _operating_points(component) if continuous else []
    start = _start(component, functions.structs)
    tables = [_table("FmuVariable", "variables", map(_variable, refs)), start]
    numbers = []
    fields: dict[str, object] = {
        "name": c_string(component.name),
        "token": c_string(token),
        "is_continuous": int(continuous),
        "solver": f"FMU_{solver.upper()}" if continuous else None,
        "sample_time": _number(component.sample_time) if component.sample_time else None,
        "variables": "variables",
        "n_variables": len(refs),
    }
    if clocks and not continuous:
        every = ticks(component)
        fields |= {"has_clock": 1, "clock_counter": f"{every.numerator}u", "clock_resolution": f"{every.denominator}u"}
    if first and not continuous:
        tables.append(_first_instance(component))
        fields["first"] = f"&{FIRST_INSTANCE}.head"
    if hidden:
        rows = (_fields(name=c_string(v.name), slot=str(v.slot), size=str(v.size)) for v in hidden)
        tables.append(_table("FmuHidden", "hidden", rows))
        fields |= {"hidden": "hidden", "n_hidden": len(hidden)}
    fields |= {f"n_{k}": n for k, n in _sizes(component).items()}
    fields |= {"start": "(const double *)&start" if start else None}
    fields |= {name: name for name in functions.names if name not in random_profiles.FUNCTIONS}
    if continuous and states:
        for name, each in (("nominals", lambda v: v.nominal or 1.0), ("bounds", _bound)):
            numbers.append(_numbers("double", name, map(_number, _of_each(states, each))))
            fields[name] = name
    if solver == "semi_implicit" and states:
        numbers.append(_numbers("int", "velocity_of", map(str, component.velocity_of)))
        fields["velocity_of"] = "velocity_of"
    if points:
        tables += [_table("FmuSetting", f"point_{i}", settings) for i, (_, settings) in enumerate(points) if settings]
        rows = (
            _fields(name=c_string(name), settings=f"point_{i}" if settings else None, n_settings=len(settings))
            for i, (name, settings) in enumerate(points)
        )
        tables.append(_table("FmuPoint", "points", rows))
        fields |= {"points": "points", "n_points": len(points)}
    if component.check_messages:
        tables.append(_table("char *const", "check_messages", map(c_string, component.check_messages)))
        fields |= {"check_messages": "check_messages", "n_checks": len(component.check_messages)}
    if component.programs:
        fields["qp"] = "&fmu_qp_functions"
    given = [f"    .{k} = {v}," for k, v in fields.items() if v not in (0, None)]
    return "\n".join(
        [
            _head(component),
            *(f'#include "{name}"' for name in headers),
            "",
            functions.declarations,
            "",
            *functions.in_lanes,
            *numbers,
            "#ifndef LANES /* copies side by side need nothing of what follows */",
            "",
            *functions.sections,
            f"/* {'-' * 66} what the runtime has to know */",
            "",
            *(t for t in tables if t),
            "const FmuModel fmu_model = {",
            *given,
            "};",
            "#endif",
            "",
        ]
    )


def lane_table(component: Model, code: bytes, *, arrays: bool, token: str) -> bytes:
    """What lanes have to know of `code`, which is `generate_c` of the same arguments: `sources/lanes.json`."""
    functions, states = written_functions(component), component.of("state")
    continuous = component.kind == "continuous"
    return json.dumps(
        {
            "token": token,
            "code": hashlib.sha256(code).hexdigest(),
            "continuous": continuous,
            "solver": component.solver,
            "sample_time": component.sample_time or 0.0,
            "functions": functions.names,
            "vectorized": functions.vectorized,
            "sizes": _sizes(component),
            "bounds": _of_each(states, _bound) if continuous else [],
            "variables": [(v.role, v.slot, 1 if arrays else v.size) for v in component.variables],
            "hidden": [(v.name, v.slot, v.size) for v in states if not v.exposed],
            "kept": functions.kept,
            "solves": functions.solves,
            "approximates": any(p.solvers[-1].name == "osqp" for p in component.programs),
        },
        separators=(",", ":"),
    ).encode()


def _sizes(component: Model) -> dict[str, int]:
    """Lengths of the runtime's vectors."""
    functions = written_functions(component)
    return {
        **{f"{role}s": component.size(role) for role in ("parameter", "input", "state", "output")},
        "work": functions.n_work,
        "fixed": len(functions.known),
        **{f"qp_{k}": sum(getattr(q, f"n_{k}") for q in component.programs) for k in ("data", "solution", "memory")},
    }


def _of_each(states: Iterable[Variable], of: Callable[[Variable], float]) -> list[float]:
    """A number of each state, for all elements."""
    return [of(v) for v in states for _ in range(v.size)]


def _first_instance(component: Model) -> str:
    n = _sizes(component)
    numbers = sum(n[k] for k in ("parameters", "inputs", "states", "states", "outputs", "qp_memory"))
    return "\n".join(
        [
            "static struct {",
            "    FmuFirstInstance head;",
            f"    double state[FMU_STATE_HEAD + {numbers}];",
            f"}} {FIRST_INSTANCE} = {{.head = {{.mark = {c_string(MARK.decode().rstrip(chr(0)))}}}}};",
            "",
        ]
    )


def _bound(v: Variable) -> float:
    """Magnitude beyond which a state has blown up."""
    return _BLOWN_UP * v.nominal if v.nominal else _BLOWN_UP_UNKNOWN


def _operating_points(component: Model) -> list[tuple[str, list[str]]]:
    """Names of the operating points, and for each the values that differ from those of the start."""
    slots = {e.name: e.slot for e in component.elements("input")}
    slots |= {e.name: component.size("input") + e.slot for e in component.elements("state")}
    return [
        (name, [f"{{.slot = {slots[k]}, .value = {_number(v)}}}" for k, v in values.items()])
        for name, values in component.operating_points.items()
    ]


def cited(component: Model) -> dict[str, str]:
    """Entries of the bibliography that the component's sources mention."""
    parts = [component.source, component.description, *component.notes, *component.equations.values()]
    parts += [*component.value_sources.values(), *(v.source for v in component.variables)]
    text = " ".join(parts)
    return {k: t for k, t in component.bibliography.items() if re.search(rf"\b{re.escape(k)}\b", text)}


def runtime_files(component: Model) -> tuple[str, ...]:
    """Hand-written C files and headers that a component needs, whatever its FMI version."""
    files = [*RUNTIME_SOURCES, *RUNTIME_HEADERS]
    if component.programs:
        files += [*qp.SOURCES, *qp.HEADERS, *(f for q in component.programs for b in q.solvers for f in b.sources)]
    if component.profiles:
        files += [*random_profiles.SOURCES, *random_profiles.HEADERS]
    return tuple(dict.fromkeys(files))


def third_party(component: Model) -> list[ThirdParty]:
    """Solvers of others that go into the FMU of a component."""
    return [THIRD_PARTY[name]() for name in dict.fromkeys(b.name for q in component.programs for b in q.solvers)]


def profile_files(component: Model) -> dict[str, bytes]:
    """C files and headers of the random profiles of a component by their path in `sources/`."""
    names = (*random_profiles.SOURCES, *random_profiles.HEADERS) if component.profiles else ()
    return {name: (RUNTIME_DIR / name).read_bytes() for name in names}


def solver_files(component: Model) -> dict[str, bytes]:
    """C files and headers of the quadratic programs of a component by their path in `sources/`."""
    if not component.programs:
        return {}
    files = {"qp_data.c": qp.generate_data(component.programs).encode()}
    files |= {name: (RUNTIME_DIR / name).read_bytes() for name in runtime_files(component) if name.startswith("qp")}
    for part in third_party(component):
        files |= part.files
    return files


def with_mathematics(files: dict[str, bytes]) -> dict[str, bytes]:
    """C files with those of the mathematical functions that they call."""
    return files | math_files(data for name, data in files.items() if name.endswith(".c"))


def identity(component: Model, *, arrays: bool, clocks: bool = False) -> str:
    """Instantiation token of a component: a hash of everything that determines its behavior and interface."""
    files = {n: (RUNTIME_DIR / n).read_bytes() for n in (*RUNTIME_SOURCES, *RUNTIME_HEADERS, "fmi2.c", "fmi3.c")}
    files |= solver_files(component) | profile_files(component)
    files["model.c"] = generate_c(component, arrays=arrays, token="", clocks=clocks).encode()
    digest = hashlib.sha256()
    for _, data in sorted(with_mathematics(files).items()):
        digest.update(data)
    for v in component.variables:
        digest.update(f"{v.name}|{v.unit}|{v.display_unit}|{v.description}|{v.nominal}|{v.output}".encode())
    digest.update(metadata.version("suspension-fmus").encode())
    h = digest.hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"
