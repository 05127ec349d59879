"""The solver `semi_implicit` for mechanical systems with contacts, and checks of relations between parameters."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from solver_runs import in_c, in_python, run_fmu

from build_fmus.component import Component, DeclarationError
from build_fmus.reference import Evaluator
from build_fmus.stability import SolverStepError, check_solver, matrices_by_point, step_matrix


def declare(step: float = 1e-3, name: str = "Mechanism", **kwargs: Any) -> Component:
    return Component(
        name, kind="continuous", description="test", source="none", solver="semi_implicit", solver_step=step, **kwargs
    )


def vibration(step: float, *, omega: float = 1.0, damping: float = 0.0) -> Component:
    c = declare(step)
    x = c.state("x", "m", start=1.0)
    v = c.state("v", "m/s", start=0.0)
    c.derivative(x, v)
    c.derivative(v, -(omega**2) * x - damping * v)
    return c


def pendulum(step: float) -> Component:
    """Large swings, damped by the square of speed, driven in time, with a filter of the speed: all kinds of states."""
    c = declare(step)
    filtered = c.state("filtered", None, start=0.0)
    angle = c.state("angle", None, start=1.5)
    rate = c.state("rate", None, start=0.3)
    c.derivative(filtered, 3.0 * (rate - filtered) + angle**2)
    c.derivative(angle, rate)
    c.derivative(rate, -9.81 * ca.sin(angle) - 0.3 * rate * ca.fabs(rate) + ca.cos(3 * c.time))
    return c


def test_order_two() -> None:
    """Halving the step divides the error by four, with forces of velocity, filters and explicit time."""
    fine = in_python(pendulum(1e-4), 0.1, 1.0)
    errors = [np.abs(in_python(pendulum(h), 0.1, 1.0) - fine) for h in (0.01, 0.005, 0.0025)]
    for coarse, finer in pairwise(errors):
        np.testing.assert_allclose(np.log2(coarse / finer), 2.0, atol=0.25)
    assert errors[-1].max() < 1e-4


def test_c_and_python_take_the_same_steps(tmp_path: Path) -> None:
    c = pendulum(2e-3)
    np.testing.assert_allclose(in_c(c, 7e-3, 0.7, tmp_path), in_python(c, 7e-3, 0.7), rtol=1e-11)


def test_positions_are_found() -> None:
    """What another state drives alone is a position: not scaled, not filtered, not driven by an input or by itself."""
    c = declare()
    names = ("position", "velocity", "scaled", "by_input", "growing", "twice")
    s = {n: c.state(n, "1") for n in names}
    u = c.input("u", "1", "force")
    c.derivative(s["position"], s["velocity"])
    c.derivative(s["velocity"], u - s["position"])
    c.derivative(s["scaled"], 2 * s["velocity"])
    c.derivative(s["by_input"], u)
    c.derivative(s["growing"], s["growing"])
    c.derivative(s["twice"], s["velocity"])
    assert dict(zip(names, c.model().velocity_of, strict=True)) == {
        "position": 1,
        "velocity": -1,
        "scaled": -1,
        "by_input": -1,
        "growing": -1,
        "twice": 1,
    }


def test_a_position_never_drives_a_position() -> None:
    """Jerk drives acceleration, acceleration velocity, velocity position.

    Of a chain every other state is a position.
    """
    c = declare()
    s = [c.state(n, "1") for n in ("position", "velocity", "acceleration", "jerk")]
    for a, b in pairwise(s):
        c.derivative(a, b)
    c.derivative(s[-1], -s[0])
    moving = np.flatnonzero(c.model().velocity_of >= 0)
    assert moving.size
    assert (c.model().velocity_of[c.model().velocity_of[moving]] == -1).all()
    run = Evaluator(c.model())
    run.x = np.array([0.0, 0.0, 0.0, 6.0])
    run.step(0.5)
    assert run.x[0] == pytest.approx(0.5**3, rel=0.01)


@pytest.mark.parametrize("phase", [0.1, 1.0, 1.9])
def test_a_vibration_keeps_its_energy(phase: float) -> None:
    """At any step below 2 / omega the amplitude neither grows nor decays, where explicit methods feed it."""
    omega = 200.0
    c = vibration(phase / omega, omega=omega)
    check_solver(c.model())
    step = step_matrix(matrices_by_point(c.model())["start"], c.model().velocity_of, phase / omega)
    assert np.abs(np.linalg.eigvals(step)) == pytest.approx(1.0, abs=1e-12)
    run = Evaluator(c.model())
    energies = []
    for _ in range(3000):
        run.step(phase / omega)
        energies.append(run.x[0] ** 2 + (1 - phase**2 / 4) * (run.x[1] / omega) ** 2)  # the method's own invariant
    np.testing.assert_allclose(energies, energies[0], rtol=1e-9)


@pytest.mark.parametrize("damping", [5.0, 100.0, 390.0, 1500.0])
def test_damping_takes_energy_out(damping: float) -> None:
    c = vibration(1e-3, omega=195.0, damping=damping)
    check_solver(c.model())
    run = Evaluator(c.model())
    for _ in range(2000):
        run.step(1e-3)
    assert np.abs(run.x / [1.0, 195.0]).max() < 0.01


def test_the_matrix_of_a_step_is_the_step() -> None:
    c = vibration(1e-3, omega=300.0, damping=40.0)
    matrix = step_matrix(matrices_by_point(c.model())["start"], c.model().velocity_of, 1e-3)
    np.testing.assert_allclose(in_python(c, 1e-3, 0.02), np.linalg.matrix_power(matrix, 20) @ [1.0, 0.0], rtol=1e-10)


@pytest.mark.parametrize(("omega", "damping"), [(2100.0, 0.0), (100.0, 2100.0)])
def test_a_step_too_long_is_refused(omega: float, damping: float) -> None:
    with pytest.raises(
        SolverStepError, match=r"solver semi_implicit with step 0.001 s is unstable .* is stable"
    ) as error:
        check_solver(vibration(1e-3, omega=omega, damping=damping).model())
    better = float(str(error.value).split("a step of ")[1].split()[0])
    check_solver(vibration(better, omega=omega, damping=damping).model())


def ball(step: float, *, damping: float) -> Component:
    """A ball of 500 kg falls on stiff ground, 4 MN/m."""
    c = declare(step)
    z = c.state("z", "m", start=0.2)
    v = c.state("v", "m/s", start=0.0)
    depth = ca.fmax(0, -z)
    c.derivative(z, v)
    c.derivative(v, -9.81 + ca.fmax(0, 4e6 * depth - damping * ca.fmin(1, depth / 1e-3) * v) / 500)
    return c


def test_bounces_do_not_grow() -> None:
    """Ten bounces without any damping return to where they began, though contact begins in the middle of steps."""
    run = Evaluator(ball(5e-4, damping=0.0).model())
    highest = 0.0
    for _ in range(8000):
        run.step(5e-4)
        highest = max(highest, run.x[0])
    assert 0.19 < highest < 0.2 * 1.01


def test_peaks_hardly_depend_on_the_step() -> None:
    def peak(step: float) -> float:
        run, force = Evaluator(ball(step, damping=2e4).model()), 0.0
        while run.time < 0.3:
            run.step(step)
            force = max(force, float(run.rhs(0.0, run.x)[1]))
        return force

    assert peak(5e-4) == pytest.approx(peak(2.5e-4), rel=0.02)


# ------------------------------------------------------------------------------------- relations between parameters


def related() -> Component:
    c = declare(name="Related")
    low = c.parameter("low", 1.0, "m", "lower end", source="none")
    high = c.parameter("high", 2.0, "m", "upper end", source="none")
    u = c.input("u", "m", "place", start=1.5)
    x = c.state("x", "m", start=u)
    c.derivative(x, (low - x) / c.constant("second", 1.0, "s", "time constant", source="none"))
    c.check(high - low, "high must exceed low: raise high")
    c.check(ca.vertcat(u - low, high - u), "u must lie between low and high")
    return c


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ({}, None),
        ({"high": 0.5}, "high must exceed low: raise high"),
        ({"high": 1.0}, "high must exceed low: raise high"),  # 0 is not positive
        ({"u": 2.5}, "u must lie between low and high"),
        ({"u": 2.5, "high": 3.0}, None),
    ],
)
def test_checks(start: dict[str, float], message: str | None, tmp_path: Path) -> None:
    """Initialization of the FMU, and of the Python evaluation, fails with the message of the first check that fails."""
    c = related()
    in_c(c, 1e-3, 1e-3, tmp_path)
    run = Evaluator(c.model(), {k: v for k, v in start.items() if k != "u"})
    run.u[0] = start.get("u", 1.5)
    log: list[str] = []
    path = tmp_path / "Related.fmu"
    if message is None:
        run_fmu(path, ["x"], 1e-3, 2e-3, log, start)
        run.step(1e-3)
    else:
        with pytest.raises(FMICallException, match="fmi3ExitInitializationMode"):
            run_fmu(path, ["x"], 1e-3, 2e-3, log, start)
        assert message in log
        with pytest.raises(ValueError, match=f"Related: {message}"):
            run.step(1e-3)


def test_start_values_that_fail_a_check_are_not_built(tmp_path: Path, raises) -> None:
    c = declare()
    gap = c.parameter("gap", 0.0, "m", "gap", source="none")
    c.derivative(c.state("x", "m"), gap)
    c.check(gap, "gap must be positive")
    with raises(DeclarationError):
        in_c(c, 1e-3, 1e-3, tmp_path)


def test_a_check_of_states_is_refused(raises) -> None:
    c = declare()
    x = c.state("x", "m", start=1.0)
    c.derivative(x, -x)
    c.check(x, "x must be positive")
    with raises(DeclarationError):
        _ = c.model().functions
