"""One mathematics: the library inside every binary is right, complete, and the same bits from every compiler."""

from __future__ import annotations

import ctypes
import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from built import OBJECTS

from build_fmus.compile import find_toolchain, host
from build_fmus.component import Component
from build_fmus.generate import RUNTIME_DIR, generate_c
from build_fmus.mathematics import FOLDER, HEADERS, THIRD_PARTY, copyright_notice, math_files

WIDE = (-700.0, 700.0)
# name: range of x, range of y; all functions that CasADi's generated code can call, but those exact in the processor
ONE: dict[str, tuple[float, float]] = {
    "acos": (-1.0, 1.0),
    "acosh": (1.0, 1e3),
    "asin": (-1.0, 1.0),
    "asinh": (-1e3, 1e3),
    "atan": (-1e3, 1e3),
    "atanh": (-1.0, 1.0),
    "ceil": (-1e6, 1e6),
    "cos": (-1e6, 1e6),
    "cosh": (-700.0, 700.0),
    "erf": (-6.0, 6.0),
    "exp": WIDE,
    "expm1": (-700.0, 700.0),
    "floor": (-1e6, 1e6),
    "log": (0.0, 1e9),
    "log1p": (-1.0, 1e9),
    "sin": (-1e6, 1e6),
    "sinh": (-700.0, 700.0),
    "tan": (-1e6, 1e6),
    "tanh": (-30.0, 30.0),
}
TWO: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "atan2": ((-1e3, 1e3), (-1e3, 1e3)),
    "fmax": (WIDE, WIDE),
    "fmin": (WIDE, WIDE),
    "fmod": ((-1e9, 1e9), (-10.0, 10.0)),
    "hypot": ((-1e3, 1e3), (-1e3, 1e3)),
    "pow": ((1e-3, 1e3), (-90.0, 90.0)),
    "remainder": ((-1e9, 1e9), (-10.0, 10.0)),
}
NAMES = [*ONE, *TWO]
EXACT = {"ceil", "floor", "fmax", "fmin", "fmod", "remainder"}
SPECIAL = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    5e-324,
    2.2250738585072014e-308,
    1.7976931348623157e308,
    np.inf,
    -np.inf,
    np.nan,
    1e22,
]
Evaluate = Callable[[str, np.ndarray, np.ndarray], np.ndarray]


def library(compiler: str) -> Evaluate:
    """Every function of the library, called through C code that sees the header as generated code does."""
    cases = [f"case {i}: out[k] = {n}(x[k]); break;" for i, n in enumerate(ONE)]
    cases += [f"case {i + len(ONE)}: out[k] = {n}(x[k], y[k]); break;" for i, n in enumerate(TWO)]
    source = f"""#include "fmu_math.h"
#if defined(_WIN32)
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
void evaluate(int function, int n, const double *x, const double *y, double *out) {{
    for (int k = 0; k < n; k++) switch (function) {{ {" ".join(cases)} }}
}}
"""
    folder = Path(compiler)
    files = {"evaluate.c": source.encode()} | math_files([source.encode()])
    for name, data in files.items():
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_bytes(data)
    sources = [folder / n for n in files if n.endswith(".c")]
    path = OBJECTS.library(find_toolchain(host()), sources, [folder], "mathematics")
    function = ctypes.CDLL(str(path)).evaluate
    function.argtypes, function.restype = [ctypes.c_int, ctypes.c_int, *[ctypes.c_void_p] * 3], None

    def evaluate(name: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        x, y = np.ascontiguousarray(x, dtype=float), np.ascontiguousarray(y, dtype=float)
        out = np.empty(len(x))
        function(NAMES.index(name), len(x), x.ctypes.data, y.ctypes.data, out.ctypes.data)
        return out

    return evaluate


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Evaluate:
    """Compiled by the compiler of this machine."""
    return library(str(tmp_path_factory.mktemp("host")))


@pytest.fixture(scope="module")
def by_zig(tmp_path_factory: pytest.TempPathFactory) -> Evaluate:
    """Compiled by ziglang, as on a machine without a compiler."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(tmp_path_factory.mktemp("empty")))
        patch.delenv("CC", raising=False)
        assert "ziglang" in find_toolchain(host()).version
        return library(str(tmp_path_factory.mktemp("zig")))


def arguments(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Arguments in the ranges where the function is used, x near zero too."""
    rng = np.random.default_rng(0)
    xs, ys = TWO[name] if name in TWO else (ONE[name], (1.0, 1.0))
    x = rng.uniform(*xs, 4000)
    if xs[0] <= 0 <= xs[1]:
        x = np.concatenate([x, np.clip(x * 10.0 ** -rng.uniform(0, 12, 4000), *xs)])
    return x, rng.uniform(*ys, len(x))


@pytest.mark.parametrize("name", NAMES)
def test_values_are_right(name: str, ours: Evaluate) -> None:
    """Within 2.5 units in the last place of this machine's own library.

    That library is itself within one or two of the truth.
    """
    x, y = arguments(name)
    given = {"erf": np.vectorize(math.erf), "remainder": np.vectorize(math.remainder), "pow": np.power}
    reference = given.get(name) or getattr(np, re.sub("^a(?=cos|sin|tan)", "arc", name))
    expected = reference(x, y) if name in TWO else reference(x)
    error = np.abs(ours(name, x, y) - expected) / np.spacing(np.abs(expected))
    assert error.max() <= (0 if name in EXACT else 2.5)


@pytest.mark.parametrize("name", NAMES)
def test_two_compilers_give_the_same_bits(name: str, ours: Evaluate, by_zig: Evaluate) -> None:
    """Over the usual ranges, over all doubles (random bits), and for special values."""
    rng = np.random.default_rng(1)
    anything = rng.integers(0, 2**64, (2, 20000), dtype=np.uint64).view(float)
    special = np.array([(a, b) for a in SPECIAL for b in SPECIAL]).T
    x, y = np.concatenate([arguments(name), anything, special], axis=1)
    a, b = ours(name, x, y), by_zig(name, x, y)
    assert np.array_equal(np.isnan(a), np.isnan(b))
    assert a[~np.isnan(a)].tobytes() == b[~np.isnan(b)].tobytes()


@pytest.mark.parametrize("name", ["floor", "sin", "__rem_pio2"])
def test_processors_with_half_precision(name: str, tmp_path: Path) -> None:
    """Compilers for them say FLT_EVAL_METHOD 16 where ISO C is not asked for; their double is a double all the same."""
    source = tmp_path / "half.c"
    shutil.copytree(THIRD_PARTY / FOLDER, tmp_path / FOLDER)
    shutil.copy(RUNTIME_DIR / "fmu_math.h", tmp_path)
    source.write_text(
        f'#include <float.h>\n#undef FLT_EVAL_METHOD\n#define FLT_EVAL_METHOD 16\n#include "{FOLDER}/{name}.c"\n'
    )
    find_toolchain(host()).compile(source, tmp_path / "half.o", [tmp_path / FOLDER])
    assert (tmp_path / "half.o").stat().st_size > 0


def test_every_function_that_generated_code_can_call_is_there() -> None:
    """A component that uses all of CasADi's mathematics calls nothing that the header does not rename."""
    c = Component("Everything", kind="discrete", sample_time=0.1, description="all functions", source="none")
    x, y = c.input("x", "1", "x"), c.input("y", "1", "y")
    one = (
        ca.sin,
        ca.cos,
        ca.tan,
        ca.asin,
        ca.acos,
        ca.atan,
        ca.sinh,
        ca.cosh,
        ca.tanh,
        ca.asinh,
        ca.acosh,
        ca.atanh,
        ca.exp,
        ca.expm1,
        ca.log,
        ca.log1p,
        ca.log10,
        ca.sqrt,
        ca.fabs,
        ca.floor,
        ca.ceil,
        ca.sign,
        ca.erf,
    )
    two = (ca.atan2, ca.fmod, ca.remainder, ca.fmin, ca.fmax, ca.copysign, ca.hypot, lambda a, b: a**b)
    c.output("all", ca.vertcat(*(f(x) for f in one), *(f(x, y) for f in two)), "1", "results")
    code = generate_c(c.model(), arrays=False, token="")
    bodies = re.sub(r"^#.*$", "", code, flags=re.MULTILINE)
    called = {n for n in re.findall(r"\b([a-z]\w*)\(", bodies) if not n.startswith(("casadi_", "model_", "fmu_"))}
    functions = called - {"if", "switch", "sizeof", "defined"} - set(re.findall(r"(\w+)\([^()]*\)\s*\{", bodies))
    exact = {"sqrt", "fabs", "copysign"}
    functions -= set(re.findall(r"static inline double (\w+)\(", (RUNTIME_DIR / "equations.h").read_text()))
    header = (RUNTIME_DIR / "fmu_math.h").read_text()
    renamed = set(re.findall(r"^#define (\w+)\(.*\) FMU_MATH\(\1\)\(", header, re.MULTILINE))
    assert {"sin", "pow", "remainder", "erf"} <= functions
    assert functions - exact <= renamed
    assert set(NAMES) <= renamed
    inlined = {"fmin", "fmax"}
    assert {f"{FOLDER}/{n}.c" for n in functions - exact - inlined} <= set(math_files([code.encode()]))


def test_only_what_is_called_comes_along() -> None:
    nothing = math_files([b'#include "fmu_math.h"\nint f(void) { return 0; }'])
    assert set(nothing) == set(HEADERS)
    assert set(math_files([b"void (*log)(int); void g(void) { log(1); }"])) == set(HEADERS)  # another ``log``
    sine = math_files([b'#include "fmu_math.h"\n/* tan(x) */ double f(double x) { return sin (x); } // exp(x)'])
    added = {n.removeprefix(f"{FOLDER}/") for n in set(sine) - set(HEADERS)}
    assert added == {"sin.c", "__sin.c", "__cos.c", "__rem_pio2.c", "__rem_pio2_large.c", "scalbn.c", "floor.c"}
    assert {f"{FOLDER}/{n}" for n in ("log_data.h", "log_data.c")} <= set(
        math_files([b'#include "fmu_math.h"\ndouble f(double x) { return log(x); }'])
    )
    assert b"standard MIT license" in copyright_notice()


def test_extremes_of_numbers_that_the_compiler_knows(tmp_path: Path) -> None:
    """They take a shorter way, with the same bits for zeros of both signs, infinities and NaN."""
    constants = ["0.0", "-0.0", "1.0", "-2.5", "INFINITY", "-INFINITY", "NAN", "5e-324"]
    calls = [(f, x) for f in ("fmax", "fmin") for x in constants]
    cases = "\n".join(
        f"        case {k}: return known ? {f}({x}, y) : {f}(at_run_time[{k}], y);" for k, (f, x) in enumerate(calls)
    )
    numbers = ", ".join(x for _, x in calls)
    source = tmp_path / "extremes.c"
    source.write_text(
        f'#include "fmu_math.h"\nstatic volatile double at_run_time[] = {{{numbers}}};\n'
        '__attribute__((visibility("default"))) double extreme(int k, int known, double y) {\n'
        f"    switch (k) {{\n{cases}\n    }}\n    return 0.0;\n}}\n"
    )
    library = OBJECTS.library(find_toolchain(host()), [source], [RUNTIME_DIR], "extremes")
    extreme = ctypes.CDLL(str(library)).extreme
    extreme.restype, extreme.argtypes = ctypes.c_double, (ctypes.c_int, ctypes.c_int, ctypes.c_double)
    for k, (f, x) in enumerate(calls):
        for y in (0.0, -0.0, 1.0, -1.0, 1.5, -3.0, 5e-324, -5e-324, math.inf, -math.inf, math.nan):
            a, b = extreme(k, 1, y), extreme(k, 0, y)
            same = a == b and math.copysign(1.0, a) == math.copysign(1.0, b)
            assert same or (math.isnan(a) and math.isnan(b)), (f, x, y, a, b)
