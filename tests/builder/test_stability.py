"""The runtime's check of the solver step: eigenvalues in C, points in the FMU, bounds of the states."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from built import OBJECTS
from fmpy.fmi1 import FMICallException
from solver_runs import in_c, run_fmu

from build_fmus.compile import find_toolchain, host
from build_fmus.component import Component
from build_fmus.generate import RUNTIME_DIR, RUNTIME_HEADERS, with_mathematics
from build_fmus.stability import amplification, check_solver

_EXPORT = """
#include "stability.h"
#if defined(_WIN32)
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
int eigenvalues(double *a, int n, double *real, double *imag) { return stability_eigenvalues(a, n, real, imag); }
"""


@pytest.fixture(scope="module")
def eigenvalues(tmp_path_factory: pytest.TempPathFactory) -> Callable[[np.ndarray], np.ndarray | None]:
    """The runtime's eigenvalues of a matrix, None when it says that there are none."""
    folder, tools = tmp_path_factory.mktemp("stability"), find_toolchain(host())
    headers = {n: (RUNTIME_DIR / n).read_bytes() for n in RUNTIME_HEADERS}
    sources = {n: (RUNTIME_DIR / n).read_bytes() for n in ("stability.c", "integrators.c")} | {
        "export.c": _EXPORT.encode()
    }
    for name, data in (with_mathematics(sources) | headers).items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    library = OBJECTS.library(tools, sorted(folder.rglob("*.c")), [folder], "stability")
    function = ctypes.CDLL(str(library)).eigenvalues

    def call(matrix: np.ndarray) -> np.ndarray | None:
        n = len(matrix)
        a, real, imag = np.array(matrix, dtype=float).ravel(order="F"), np.zeros(n), np.zeros(n)
        pointers = [v.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for v in (a, real, imag)]
        return real + 1j * imag if function(pointers[0], n, *pointers[1:]) else None

    return call


def distance(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest distance between eigenvalues, each paired with the nearest that is left."""
    left, worst = list(expected), 0.0
    for value in found:
        nearest = min(left, key=lambda e: abs(e - value))
        left.remove(nearest)
        worst = max(worst, abs(nearest - value))
    return worst


def bad_units(m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    scale = 10.0 ** rng.uniform(-6, 6, len(m))
    return m * scale[:, None] / scale


def shuffled(m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    order = rng.permutation(len(m))
    return m[np.ix_(order, order)]


KINDS: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
    "dense": lambda m, rng: m,
    "symmetric": lambda m, rng: m + m.T,
    "vibrations": lambda m, rng: m - m.T,
    "bad units": bad_units,
    "triangular": lambda m, rng: np.triu(m),
    "triangular, states in any order": lambda m, rng: shuffled(np.tril(m), rng),
}


@pytest.mark.parametrize("kind", KINDS)
def test_eigenvalues(kind: str, eigenvalues: Callable) -> None:
    rng = np.random.default_rng(4)
    for n in [*range(1, 12), 20, 33, 50]:
        for _ in range(5):
            matrix = KINDS[kind](rng.normal(size=(n, n)), rng)
            expected = np.diag(matrix) if "triangular" in kind else np.linalg.eigvals(matrix)
            # LAPACK is no more exact with matrices whose elements span 24 orders of magnitude.
            tolerance = 1e-9 if kind == "bad units" else 1e-12
            assert distance(eigenvalues(matrix), expected) <= tolerance * max(1.0, np.abs(matrix).sum(axis=0).max())


def test_eigenvalues_of_special_matrices(eigenvalues: Callable) -> None:
    """Chains of integrators and of equal lags, exactly.

    Also cycles, on which plain QR iteration stands still, and values that are not finite.
    """
    for n in (2, 5, 8):
        np.testing.assert_array_equal(eigenvalues(np.diag(np.ones(n - 1), 1)), 0)
        np.testing.assert_array_equal(eigenvalues(np.diag(np.full(n, -3.0)) + np.diag(np.full(n - 1, 3.0), -1)), -3)
        roots = np.exp(2j * np.pi * np.arange(n) / n)
        assert distance(eigenvalues(np.roll(np.eye(n), 1, axis=0)), roots) < 1e-14
    np.testing.assert_array_equal(eigenvalues(np.zeros((4, 4))), 0)
    for bad in (np.nan, np.inf):
        assert eigenvalues(np.full((3, 3), bad)) is None


# ------------------------------------------------------------------------------------------------------ amplification


def two_step_factor(z: np.ndarray) -> np.ndarray:
    """PECE with Adams-Bashforth-2 and the trapezoidal rule: x+ = x + z/2 (x + x + 1.5 z x - 0.5 z x_before)."""
    roots = [np.roots([1.0, -(1 + k + 0.75 * k**2), 0.25 * k**2]) for k in z]
    return np.abs(roots).max(axis=1)


GAMMA = 1 - np.sqrt(0.5)
FACTORS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "rk4": lambda z: np.abs(np.polyval([1 / 24, 1 / 6, 1 / 2, 1, 1], z)),  # Taylor polynomial of exp
    "am2": lambda z: np.maximum(np.abs(1 + z + z**2 / 2), two_step_factor(z)),  # first step: Euler predictor
    "ros2": lambda z: np.abs((1 + (1 - 2 * GAMMA) * z) / (1 - GAMMA * z) ** 2),
}


@pytest.mark.parametrize("solver", FACTORS)
def test_amplification_is_that_of_the_closed_forms(solver: str) -> None:
    """What steps of the solver in Python make of dx/dt = z x."""
    rng = np.random.default_rng(3)
    z = np.concatenate([rng.normal(scale=2.0, size=200) + 1j * rng.normal(scale=2.0, size=200), [0.0, -1e6, 1e-9j]])
    np.testing.assert_allclose(amplification(solver, z), FACTORS[solver](z), rtol=1e-9)


# ------------------------------------------------------------------------------------------------------------- points


def hardening(name: str = "Hardening") -> Component:
    """A spring that is far stiffer away from its middle; `idle` changes nothing."""
    c = Component(name, kind="continuous", description="test", source="none", solver_step=1e-3)
    c.parameter("idle", 1.0, "1", "a parameter without effect", source="none")
    stiff = c.parameter("stiff", 1.0, "N/m", "scale of the stiffness", min=0.0, source="none")
    force = c.input("force", "N", "force")
    x, v = c.state("x", None, start=0.0), c.state("v", None, start=0.0)
    c.derivative(x, v)
    c.derivative(v, force - stiff * (100.0 * x + 1e9 * ca.if_else(ca.fabs(x) < 1, 0, x**3)) - 5.0 * v)
    c.operating_point("pushed", {"x": 0.5, "force": 50.0})
    return c


def refusal(c: Component, folder: Path, start: dict[str, float]) -> str | None:
    """What an FMU says when it does not initialize with these start values."""
    path, log = folder / f"{c.name}.fmu", []
    if not path.exists():
        in_c(c, 1e-3, 1e-3, folder)
    try:
        run_fmu(path, ["x"], 1e-5, 1e-5, log, start)
    except FMICallException:
        return next(m for m in log if "unstable" in m)
    return None


def test_the_points_and_the_present_state_are_looked_at(tmp_path: Path) -> None:
    c = hardening()
    assert refusal(c, tmp_path, {"x": 2.0}) is None, "nothing was set: what the build has found holds"
    assert refusal(c, tmp_path, {"idle": 2.0}) is None
    there = refusal(c, tmp_path, {"idle": 2.0, "x": 2.0})
    assert there is not None
    assert "with solver.step 0.001 s is unstable at the present state (eigenvalue -2.5" in there
    everywhere = refusal(c, tmp_path, {"stiff": 1e6})
    assert everywhere is not None
    assert re.search(
        r"at operating point 'start' \(eigenvalue -2.5\+1e\+04i 1/s\); a solver.step of 0.000262 s", everywhere
    )
    assert "no solver.step within its limits would do" in (refusal(c, tmp_path, {"stiff": 1e12}) or "")


@pytest.mark.parametrize("growth", [1000.0, 3500.0])
def test_growing_modes(growth: float, tmp_path: Path) -> None:
    """ros2: a mode that grows is followed, until the step comes near the pole of the method."""
    c = Component("Growing", kind="continuous", description="test", source="none", solver="ros2", solver_step=1e-4)
    rate = c.parameter("rate", 1.0, "1/s", "growth", source="none")
    x = c.state("x", "m", start=1e-9)
    c.derivative(x, rate * x)
    check_solver(c.model())
    said = refusal(c, tmp_path, {"rate": growth, "solver.step": 1e-3})
    assert (said is None) == (growth == 1000.0), said


# ------------------------------------------------------------------------------------------------------------- bounds


@pytest.mark.parametrize(("nominal", "bound"), [(0.1, 1e5), (None, 1e12)])
def test_a_state_that_blows_up_is_named(nominal: float | None, bound: float, tmp_path: Path) -> None:
    """A million times its nominal value is the end; without a nominal value, what no unit explains."""
    c = Component("Escape", kind="continuous", description="test", source="none", solver_step=1e-3)
    c.derivative(c.state("calm", "m", start=1.0, nominal=1.0), 0.0)
    x = c.state("x", "m", start=1.0, nominal=nominal)
    c.derivative(x, c.constant("growth", 1000.0, "1/s", "of x", source="none") * x)
    log: list[str] = []
    with pytest.raises(FMICallException, match="fmi3DoStep"):
        in_c(c, 1e-3, 0.1, tmp_path, log)
    found = re.search(r"state x diverged at time (\S+) s: it is (\S+), beyond its bound (\S+);", log[-1])
    assert found, log[-1]
    assert float(found[3]) == bound
    assert bound < float(found[2]) < 3 * bound
    assert float(found[1]) == pytest.approx(np.log(bound) / 1000.0, abs=1.1e-3)
