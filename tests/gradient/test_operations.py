"""Derivatives of single operations, of both kinds of numbers, beside extrapolated differences."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest

from build_fmus.compile import ObjectCache, find_toolchain, host
from cosim.batch import library
from cosim.batch.adjoint import Tape
from cosim.batch.lane_source import MUSL, RUNTIME
from cosim.engine import library as engine
from cosim.fmu.environment import HEADER as ENVIRONMENT

# By name: the operation on a and b, and where.
OPERATIONS: dict[str, tuple[str, tuple[float, float]]] = {
    "sum": ("a + b + 2.0 + (1.5 + a)", (0.7, -1.3)),
    "difference": ("(a - b) - (2.0 - a) - 1.0", (0.7, -1.3)),
    "product": ("a * b * 3.0 * (0.5 * a)", (0.7, -1.3)),
    "quotient": ("a / b + 2.0 / a + b / 3.0", (0.7, -1.3)),
    "negative": ("-a * -b", (0.7, -1.3)),
    "long statement": ("(a * b + b / a - 2.0) / (a * a - 0.25 * b) + a * (b - a * (1.0 + b))", (0.7, -1.3)),
    "added": ("a; z += a * b", (0.7, -1.3)),
    "multiplied": ("a; z *= a + b", (0.7, -1.3)),
    "square": ("square(a - b)", (0.7, -1.3)),
    "sign": ("sign(a) * b", (-0.7, -1.3)),
    "when": ("when(a < b, a) + when(a > b, b * b)", (0.7, -1.3)),
    "if_else": ("if_else(a < b, a, b * b)", (0.7, -1.3)),
    "fabs": ("fabs(b) * fabs(a)", (0.7, -1.3)),
    "copysign": ("copysign(a, b) + copysign(b, a)", (0.7, -1.3)),
    "fmax": ("fmax(a, b) * fmax(a, 2.0)", (0.7, -1.3)),
    "fmin": ("fmin(a, b) * fmin(a, 2.0)", (0.7, -1.3)),
    "limit": ("a; const Number c = fmin(a, 2.0); z = if_else(c == a, a * a, b)", (0.7, -1.3)),
    "floor": ("floor(a) * b", (1.7, -1.3)),
    "ceil": ("ceil(a) * b", (1.7, -1.3)),
    "sqrt": ("sqrt(a)", (0.7, 0.0)),
    "acos": ("acos(a)", (0.4, 0.0)),
    "acosh": ("acosh(a)", (1.4, 0.0)),
    "asin": ("asin(a)", (0.4, 0.0)),
    "asinh": ("asinh(a)", (0.4, 0.0)),
    "atan": ("atan(a)", (0.4, 0.0)),
    "atanh": ("atanh(a)", (0.4, 0.0)),
    "cos": ("cos(a)", (0.4, 0.0)),
    "cosh": ("cosh(a)", (0.4, 0.0)),
    "erf": ("erf(a)", (0.4, 0.0)),
    "erfc": ("erfc(a)", (0.4, 0.0)),
    "exp": ("exp(a)", (0.4, 0.0)),
    "expm1": ("expm1(a)", (0.4, 0.0)),
    "log": ("log(a)", (0.4, 0.0)),
    "log1p": ("log1p(a)", (0.4, 0.0)),
    "sin": ("sin(a)", (0.4, 0.0)),
    "sinh": ("sinh(a)", (0.4, 0.0)),
    "tan": ("tan(a)", (0.4, 0.0)),
    "tanh": ("tanh(a)", (0.4, 0.0)),
    "atan2": ("atan2(a, b)", (0.7, -1.3)),
    "hypot": ("hypot(a, b)", (0.7, -1.3)),
    "pow": ("pow(a, b)", (0.7, -1.3)),
    "pow of a number": ("pow(a, 3.0) + pow(2.0, b)", (-0.7, -1.3)),
    "fmod": ("fmod(a, b)", (4.7, -1.3)),
    "remainder": ("remainder(a, b)", (4.7, -1.3)),
    "look_up": ("look_up(array, 3, a)", (1.4, -1.3)),
    "store": ("a; store(array, 3, b, a * b); z = array[1]", (0.7, 1.3)),
    "smallest": ("smallest(array, 3)", (0.7, -1.3)),
    "largest": ("largest(array, 3)", (0.7, -1.3)),
    "matrices": (
        "a; product(array, array + 3, array + 3, 1, 2, 1); add_product(array, array + 3, numbers, 1, 2, 1);"
        " z = array[0]",
        (0.7, -1.3),
    ),
    "a scalar twice": ("s * s + t / s - s", (0.7, -1.3)),
    "a function of a scalar": ("sin(s) * cos(s) + exp(s * t)", (0.7, -1.3)),
    "a local": ("a; const local l = s * t + s; z = l * l + t", (0.7, -1.3)),
    "a local of a local": (
        "a; const local l = s * t + sin(s); const local m = l * l - t; z = m * l + square(m) / s",
        (0.7, -1.3),
    ),
    "a scalar of a branch": (
        "a; scalar r = {0}; if (0.0 < s) { const local l = s * t; r = l * l + s; } const local m = r * t;"
        " z = m + r * s",
        (0.7, -1.3),
    ),
    "what does not move": (
        "c * a + b / c - fmax(c, -4.0) + fmin(c, a) + when(c > b, c * b) + if_else(b < c, c, a) * sin(c) * a",
        (0.7, -1.3),
    ),
    "functions of what does not move": (
        "atan2(c, a) + hypot(b, c) + pow(a, c) + copysign(c, b) + fabs(c)",
        (0.7, -1.3),
    ),
    "a copy of what does not move": (
        "a; Number k = c; scalar l = k; const local m = l * s; z = m + l * t; k = a; k = c; z += k * a",
        (0.7, -1.3),
    ),
    "a limit of a local": ("a; const local l = s * t; z = fmax(l, t) + fmin(l, s) + l", (0.7, -1.3)),
}
# Where a number is equal to 0: derivatives are those of one side, of zeros by the sign that the result has.
AT_ZERO: dict[str, tuple[str, tuple[float, float], tuple[float, float]]] = {
    "both sides": ("fmax(a, 0.0) - fmax(-a, 0.0)", (0.0, 1.3), (1.0, 0.0)),
    "one side": ("fmax(a, 0.0) + fmin(-b, a)", (0.0, 0.0), (1.0, -1.0)),
}
# Where a slope is infinite, and what it is multiplied with does not move: both derivatives.
ROOTS: dict[str, tuple[str, tuple[float, float], tuple[float, float]]] = {
    "sqrt at 0": ("sqrt(square(a) + square(b))", (0.0, 0.0), (0.0, 0.0)),
    "sqrt of a scalar": ("t * sqrt(square(s))", (0.0, 1.3), (0.0, 0.0)),
    "sqrt of a sqrt": ("sqrt(sqrt(2.0 * square(s))) + t", (0.0, 1.3), (0.0, 1.0)),
    "sqrt of a local": ("a; const local l = 2.0 * square(s); z = sqrt(l) * t + sqrt(sqrt(l))", (0.0, 1.3), (0.0, 0.0)),
    "acos at 1": ("acos(cos(s)) * t", (0.0, 1.3), (0.0, 0.0)),
    "a condition": ("exp(-number(0.0 < s)) * t + square(number(0.0 < t)) * t", (0.0, 1.3), (0.0, 2.0)),
}
_ALL = {**OPERATIONS, **{name: at[:2] for name, at in (ROOTS | AT_ZERO).items()}}
CODE = """
#include "number_equations.h"

extern "C" EXPORT void compute(int which, const double *x, double *result) {
    Number a(x[0]), b(x[1]), c(0.9), z(0.0);
    const double numbers[2] = {2.0, -3.0};
#ifdef ADJOINTS
    double of[1 << 8] = {0.0};
    a.index = 1;
    b.index = 2;
    tape->n = 2;
    tape->n_operands = tape->ends[2] = 0;
#else
    memset(a.d, 0, sizeof a.d);
    memset(b.d, 0, sizeof b.d);
    memset(c.d, 0xff, sizeof c.d); /* NaN, which nothing may read */
    a.d[0][0] = b.d[0][1] = 1.0;
    note_moves(&a, 1);
    note_moves(&b, 1);
#endif
    Number array[5] = {a * a, a * b, b * b, a, b};
    const scalar s = a;
    const scalar t = b;
    (void)numbers;
    switch (which) {
CASES
    }
    result[0] = z.v;
#ifdef ADJOINTS
    of[z.index] = 1.0;
    of[0] = 0.0;
    cosim_sweep_back(tape, of, 2, 1);
    result[1] = of[1];
    result[2] = of[2];
#else
    result[1] = slope_of(z, 0);
    result[2] = slope_of(z, 1);
#endif
}
"""
Compute = Callable[[str, Any], Any]


def compiled(kind: str, folder: Path) -> Compute:
    """A function of the operation's name, a and b: its value and derivatives by both."""
    cases = (f"case {i}: {{ z = {code}; break; }}" for i, (code, _) in enumerate(_ALL.values()))
    (folder / "musl").mkdir()
    for file in MUSL.glob("*.[ch]"):
        (folder / "musl" / file.name).write_bytes(file.read_bytes())
    (folder / "fmu_math.h").write_bytes((RUNTIME / "fmu_math.h").read_bytes())
    baseline = library.TARGETS["baseline"]
    target = baseline.with_adjoints() if kind == "ADJOINTS" else baseline.with_tangents(8)
    settings = "".join(f"#define {name} {value}\n" for name, value in target.settings.items())
    (folder / "operations.cpp").write_text(settings + CODE.replace("CASES", "\n".join(cases)))
    runtime = Path(library.__file__).with_name("runtime")
    include = [folder, runtime, engine.HEADER.parent, ENVIRONMENT.parent, RUNTIME]
    sources = [folder / "operations.cpp", *sorted((folder / "musl").glob("*.c"))]
    ffi = cffi.FFI()
    ffi.include(library.interface())
    ffi.cdef("void compute(int which, const double *x, double *result); void cosim_use_tape(Tape *of);")
    code = ffi.dlopen(str(ObjectCache(folder).library(find_toolchain(host()), sources, include, "operations")))
    tape = Tape(1 << 8)
    if kind == "ADJOINTS":
        code.cosim_use_tape(tape.struct)

    def compute(name: str, x: Any, _keep: Tape = tape) -> Any:
        result = ffi.new("double[3]")
        code.compute(list(_ALL).index(name), ffi.new("double[2]", list(x)), result)
        return np.array(list(result))

    return compute


@pytest.fixture(scope="module", params=["TANGENTS", "ADJOINTS", "ADJOINTS by ziglang"])
def compute(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Compute:
    kind, _, compiler = request.param.partition(" by ")
    with pytest.MonkeyPatch.context() as patch:
        if compiler:
            patch.setenv("CC", shlex.join([sys.executable, "-m", compiler, "cc"]))
        return compiled(kind, tmp_path_factory.mktemp("operations"))


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_has_the_slopes_of_its_values(compute: Compute, name: str) -> None:
    at = np.array(OPERATIONS[name][1])
    found = compute(name, at)
    assert np.isfinite(found).all()
    assert found[1:].any()
    for k in range(2):
        slopes = []
        for h in (4e-3, 2e-3, 1e-3):
            step = h * np.eye(2)[k]
            slopes.append((compute(name, at + step)[0] - compute(name, at - step)[0]) / (2.0 * h))
        once = [(4.0 * fine - coarse) / 3.0 for coarse, fine in pairwise(slopes)]
        exact = (16.0 * once[1] - once[0]) / 15.0
        assert found[1 + k] == pytest.approx(exact, rel=1e-9, abs=1e-10)


@pytest.mark.parametrize("name", ROOTS)
def test_an_infinite_slope_of_what_does_not_move_counts_for_nothing(compute: Compute, name: str) -> None:
    _, at, expected = ROOTS[name]
    assert compute(name, np.array(at))[1:].tolist() == list(expected)


@pytest.mark.parametrize("name", AT_ZERO)
def test_of_equal_zeros_one_is_followed(compute: Compute, name: str) -> None:
    _, at, expected = AT_ZERO[name]
    assert compute(name, np.array(at))[1:].tolist() == list(expected)


def test_a_limit_that_does_not_act_is_the_number_itself(compute: Compute) -> None:
    """Both move alike, so that they are not equal by chance."""
    assert compute("limit", np.array([0.7, -1.3]))[0] == 0.7 * 0.7
