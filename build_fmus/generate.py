"""C code of one component: CasADi functions, variable table, start values."""

from __future__ import annotations

import hashlib
import json
import math
import re
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np

from build_fmus import extras, qp
from build_fmus.component import Model, Variable
from build_fmus.mathematics import math_files
from build_fmus.qp_sources import THIRD_PARTY, ThirdParty

with extras.needed("build", extras.BUILDING):
    import casadi as ca

RUNTIME_DIR = Path(__file__).parent / "runtime"
RUNTIME_SOURCES = ("fmu_core.c", "integrators.c", "stability.c")
RUNTIME_HEADERS = ("fmu_core.h", "fmu_math.h", "fmu_model.h", "integrators.h", "stability.h")

_ROLES = {
    "time": "FMU_TIME", "parameter": "FMU_PARAMETER", "input": "FMU_INPUT", "state": "FMU_STATE",
    "derivative": "FMU_DERIVATIVE", "output": "FMU_OUTPUT",
}  # fmt: skip
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


_CAST = r"(?<!sizeof)\((?:casadi_)?int\)(?! ?sizeof) ?"  # a number to an index
_TO_INDEX = """
/* The index that a number means; one that is no index of any array for NaN and numbers beyond all integers, which C leaves
 * undefined. Lookups clip it; reading there gives NaN, and writing there does nothing. */
static int fmu_index(double x) { return x >= -1.0 && x <= 2147483646.0 ? (int)x : x > 0.0 ? 2147483646 : -1; }
"""


def _with_safe_casts(code: str, name: str) -> str:
    """Generated code in which every conversion of a number to an index is defined for every number."""
    safe = re.sub(_CAST + r"(?:(\*cr\+\+)|(?=\())", lambda m: f"fmu_index({m[1]})" if m[1] else "fmu_index", code)
    left = re.search(_CAST + ".{0,40}", safe)
    if left:
        raise RuntimeError(f"{name}: generated code converts numbers in a way this version does not know: {left[0]}")
    return (_TO_INDEX if safe != code else "") + safe


def _number(x: float | None, default: float = 0.0) -> str:
    x = default if x is None else float(x)
    if math.isinf(x):
        return "INFINITY" if x > 0 else "-INFINITY"
    return repr(x)


def _array(kind: str, name: str, items: list[str]) -> str:
    body = ",\n    ".join(items) if items else "0"
    return f"static const {kind} {name}[] = {{\n    {body}\n}};\n"


def _string(text: str) -> str:
    return json.dumps(text)


def generate_c(component: Model, *, arrays: bool, token: str) -> str:
    """The complete ``model.c`` of a component; deterministic for a given CasADi version."""
    functions = component.functions
    names = ["start", "out", *(("rhs", "fwd", "fwd_start") if component.kind == "continuous" else ("tick",))]
    names += [n for n in ("jac", "programs", "check") if n in functions]
    generator = ca.CodeGenerator("model", {"with_header": False, "casadi_int": "int", "verbose": False})
    for n in names:
        generator.add(functions[n])
    code = generator.dump()
    for forbidden in ("malloc(", "calloc(", "free("):
        if forbidden in code:
            raise RuntimeError(f"{component.name}: generated code calls {forbidden[:-1]}, which doStep must not")
    code = _with_safe_casts(code, component.name)

    refs = references(component, arrays=arrays)
    table = [
        "{"
        + ", ".join(
            [
                _string(r.name),
                _TYPES[r.variable.type],
                _ROLES[r.variable.role],
                str(r.slot),
                str(math.prod(r.shape)),
                str(int(is_exact(r.variable))),
                str(int(r.variable.tunable)),
                _number(r.variable.min, -math.inf),
                _number(r.variable.max, math.inf),
                _number(r.variable.must_equal),
                _number(r.variable.tolerance),
            ]
        )
        + "}"
        for r in refs
    ]
    states = [v for v in component.all_variables if v.role == "state"]
    state_names = [_string(n) for v in states for n in v.element_names()]
    nominals = [_number(v.nominal, 1.0) for v in states for _ in range(v.size)]
    velocity_of = component.velocity_of if component.solver == "semi_implicit" else np.full(len(nominals), -1)
    start = [_number(x) for role in ("parameter", "input", "state") for x in component.vector(role)]  # type: ignore[arg-type]
    used = [functions[n] for n in names]
    sizes = [max(getattr(f, f"sz_{k}")() for f in used) for k in ("arg", "res", "iw", "w")]
    continuous = component.kind == "continuous"
    points = _operating_points(component) if continuous else []
    fields = [
        _string(component.name),
        _string(token),
        str(int(continuous)),
        f"FMU_{component.solver.upper()}",
        _number(component.sample_time),
        str(len(refs)),
        "variables",
        ", ".join(str(component.size(r)) for r in ("parameter", "input", "state", "output")),  # type: ignore[arg-type]
        "start",
        "nominals",
        "state_names",
        str(sum(v.size for v in states if v.start is None)),
        "fmu_start",
        "fmu_out",
        "fmu_rhs" if continuous else "fmu_tick",
        "fmu_fwd" if continuous else "NULL",
        "fmu_fwd_start" if continuous else "NULL",
        "fmu_jac" if "jac" in functions else "NULL",
        "&fmu_qp_functions, fmu_programs" if component.programs else "NULL, NULL",
        ", ".join(str(sum(getattr(q, k) for q in component.programs)) for k in ("n_data", "n_solution", "n_memory")),
        ", ".join(map(str, sizes)),
        "velocity_of",
        "fmu_check" if "check" in functions else "NULL",
        str(len(component.check_messages)),
        "check_messages",
        "bounds",
        "points",
        str(len(points)),
    ]
    return "\n".join(
        [
            f"/* {component.name}: generated, do not edit. */",
            "#include <stddef.h>",
            '#include "fmu_math.h"',
            '#include "fmu_model.h"',
            "",
            "#if defined(__GNUC__)",
            "#define CASADI_SYMBOL_EXPORT static __attribute__((unused))",
            "#else",
            "#define CASADI_SYMBOL_EXPORT static",
            "#endif",
            code,
            _array("FmuVariable", "variables", table),
            _array("double", "start", start),
            _array("double", "nominals", nominals),
            _array("double", "bounds", [_number(_bound(v)) for v in states for _ in range(v.size)]),
            _array("char *const", "state_names", state_names or ['""']),
            _array("int", "velocity_of", [str(j) for j in velocity_of]),
            _array("char *const", "check_messages", [_string(m) for m in component.check_messages] or ['""']),
            *(_array("FmuSetting", f"point_{i}", settings) for i, (_, settings) in enumerate(points) if settings),
            _array(
                "FmuPoint",
                "points",
                [
                    f"{{{_string(name)}, {f'point_{i}' if settings else 'NULL'}, {len(settings)}}}"
                    for i, (name, settings) in enumerate(points)
                ],
            ),
            "const FmuModel fmu_model = {\n    " + ",\n    ".join(fields) + "\n};",
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
        (name, [f"{{{slots[k]}, {_number(v)}}}" for k, v in values.items()])
        for name, values in component.operating_points.items()
    ]


def runtime_files(component: Model) -> tuple[str, ...]:
    """Hand-written C files and headers that a component needs, whatever its FMI version."""
    files = [*RUNTIME_SOURCES, *RUNTIME_HEADERS]
    if component.programs:
        files += [*qp.SOURCES, *qp.HEADERS, *(f for q in component.programs for b in q.solvers for f in b.sources)]
    return tuple(dict.fromkeys(files))


def third_party(component: Model) -> list[ThirdParty]:
    """Solvers of others that go into the FMU of a component."""
    return [THIRD_PARTY[name]() for name in dict.fromkeys(b.name for q in component.programs for b in q.solvers)]


def solver_files(component: Model) -> dict[str, bytes]:
    """C files and headers of the quadratic programs of a component by their path in ``sources/``."""
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


def identity(component: Model, *, arrays: bool) -> str:
    """Instantiation token of a component: a hash of everything that determines its behaviour and interface."""
    files = {n: (RUNTIME_DIR / n).read_bytes() for n in (*RUNTIME_SOURCES, *RUNTIME_HEADERS, "fmi2.c", "fmi3.c")}
    files |= solver_files(component) | {"model.c": generate_c(component, arrays=arrays, token="").encode()}
    digest = hashlib.sha256()
    for _, data in sorted(with_mathematics(files).items()):
        digest.update(data)
    for v in component.variables:
        digest.update(f"{v.name}|{v.unit}|{v.display_unit}|{v.description}|{v.nominal}|{v.output}".encode())
    digest.update(metadata.version("suspension-fmus").encode())
    h = digest.hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"
