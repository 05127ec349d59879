"""The solver `ros2`: its order, what it does to stiff modes, and a matrix that cannot be solved.

In C and in Python.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from solver_runs import in_c, in_python

from build_fmus.component import Component
from build_fmus.reference import Evaluator
from build_fmus.stability import SolverStepError, amplification, check_solver

Advance = Callable[[Component, float, float], np.ndarray]


def declare(step: float = 1e-3) -> Component:
    return Component(
        "Stiff", kind="continuous", description="test of ros2", source="none", solver="ros2", solver_step=step
    )


def nonlinear(step: float) -> Component:
    """Prothero-Robinson with a nonlinear partner: y follows cos(t), z a product; depends on time explicitly."""
    c = declare(step)
    y = c.state("y", None, start=1.0)
    z = c.state("z", None, start=1.0)
    c.derivative(y, -2.0 * (y - ca.cos(c.time)) - ca.sin(c.time))
    c.derivative(z, -z * z - z * (y - ca.cos(c.time)))
    return c


def exact(t: float) -> np.ndarray:
    return np.array([math.cos(t), 1.0 / (1.0 + t)])


def test_order_two() -> None:
    """Halving the step divides the error by four, with nonlinear terms and explicit time."""
    errors = [np.abs(in_python(nonlinear(h), 0.1, 1.0) - exact(1.0)) for h in (0.01, 0.005, 0.0025)]
    for coarse, fine in pairwise(errors):
        np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.08)
    assert errors[-1].max() < 1e-5


def test_c_and_python_take_the_same_steps(tmp_path: Path) -> None:
    """Ten coupled states, so that rows are exchanged; time-dependent, and with nominal values far from 1."""
    rng = np.random.default_rng(7)
    matrix = rng.normal(size=(10, 10)) * 300.0
    matrix -= 900.0 * np.eye(10)
    matrix[0, 0] = 0.0
    c = declare()
    x = c.state("x", None, start=np.linspace(-1, 1, 10), shape=(10,), nominal=1.0)
    p = c.state("p", None, start=1e6, nominal=1e7)
    c.derivative(x, matrix @ x + 30.0 * ca.cos(20 * c.time) + 1e-5 * p)
    c.derivative(p, -5e3 * p - 1e8 * x[0] ** 2)
    ours, theirs = in_python(c, 2e-3, 0.04), in_c(c, 2e-3, 0.04, tmp_path)
    np.testing.assert_allclose(theirs, ours, rtol=1e-11, atol=1e-12 * np.abs(ours[:10]).max())


def test_stiff_modes_die_out_and_slow_ones_stay_accurate() -> None:
    """Eigenvalues -1e8 and -1 1/s at a step of 10 ms: explicit solvers would need 20 ns."""
    c = declare(0.01)
    slow = c.state("slow", "1", start=1.0)
    fast = c.state("fast", "1", start=5.0)
    c.derivative(slow, -slow)
    c.derivative(fast, -1e8 * (fast - slow))
    check_solver(c.model())
    run = Evaluator(c.model())
    run.step(0.01)
    assert abs(run.x[1] - run.x[0]) < 0.1  # the initial layer, 4 high, is gone after one step
    assert in_python(c, 0.01, 1.0) == pytest.approx([math.exp(-1), math.exp(-1)], rel=2e-5)


def test_amplification() -> None:
    """A-stable, L-stable, and of order 2: R(z) - exp(z) = O(z^3)."""
    y = np.concatenate([np.logspace(-6, 8, 400), [0.0]])
    for x in (0.0, -1e-6, -1e-3, -1.0, -1e3):
        assert amplification("ros2", x + 1j * y).max() <= 1.0 + 1e-12
    assert amplification("ros2", np.array([-1e8]))[0] < 1e-7
    z = np.array([-0.02, -0.01])
    error = np.abs(amplification("ros2", z) - np.exp(z))
    assert np.log2(error[0] / error[1]) == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize(("rate", "fine"), [(50.0, True), (-1e9, True), (2500.0, False)])
def test_solver_check(rate: float, fine: bool) -> None:
    """A mode that truly grows is accepted as long as the step resolves its growth."""
    c = declare()
    x = c.state("x", "1", start=1.0)
    c.derivative(x, rate * x)
    if fine:
        check_solver(c.model())
    else:
        with pytest.raises(SolverStepError, match="solver ros2 with step"):
            check_solver(c.model())


def growing(step: float) -> Component:
    """A mode whose true growth makes `1 - gamma h lambda` zero at this step."""
    c = declare(step)
    calm = c.state("calm", None, start=1.0)
    x = c.state("wild", None, start=1.0)
    c.derivative(calm, -calm)
    c.derivative(x, x / ((1 - math.sqrt(0.5)) * 1e-3))
    return c


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")  # the reference run in the documentation
def test_a_singular_matrix_ends_the_step_with_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("build_fmus.package.check_solver", lambda _: None, raising=False)
    log: list[str] = []
    with pytest.raises(FMICallException):
        in_c(growing(1e-3), 1e-3, 1e-3, tmp_path, log)
    message = next(m for m in log if "singular" in m)
    for words in ("solver ros2 of Stiff is singular", "at time 0 s", "state wild", "solver.step"):
        assert words in message


def test_a_singular_matrix_in_python(raises) -> None:
    c = declare()
    x = c.state("x", "1", start=1.0)
    c.derivative(x, x)
    run = Evaluator(c.model(), {"solver.step": 1 / (1 - math.sqrt(0.5))})
    with raises(ArithmeticError):
        run.step(1 / (1 - math.sqrt(0.5)))
