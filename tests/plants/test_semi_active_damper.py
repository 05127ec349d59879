"""Semi-active damper: its curves, passivity, symmetry, lag, the published hysteresis, and curves that are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from named import Named

from fmu_sources.plants import semi_active_damper
from fmu_sources.plants.semi_active_damper import LARGEST_CURRENT, LEAST, MOST, VELOCITY

CURVES = {0.0: LEAST, LARGEST_CURRENT: MOST}
NO_HYSTERESIS = {"hysteresis.speed": 0.0}


@pytest.fixture(scope="module")
def damper():
    return semi_active_damper().model()


def force(damper, velocity: float, current: float, deflection: float = 0.0, **parameters: float) -> float:
    """Settled force [N] at a current [A]."""
    run = Named(damper, {**NO_HYSTERESIS, **parameters})
    run.x = np.array([current])
    return run.put(suspension__velocity=velocity, suspension__deflection=deflection).shown()["force"]


def test_curves_are_met_at_their_points(damper):
    """The resistance is the opposite of the force on the body."""
    for current, curve in CURVES.items():
        assert [-force(damper, v, current) for v in (0.0, *VELOCITY)] == pytest.approx([0.0, *curve])
        assert [force(damper, -v, current) for v in VELOCITY] == pytest.approx(curve)
    stiff = {f"curve.compression.most[{i + 1}]": 2 * f for i, f in enumerate(MOST)}
    assert force(damper, -0.3, LARGEST_CURRENT, **stiff) == 2 * force(damper, -0.3, LARGEST_CURRENT)
    assert force(damper, 0.3, LARGEST_CURRENT, **stiff) == force(damper, 0.3, LARGEST_CURRENT)


@pytest.mark.parametrize("velocity", [-3.0, -0.7, -0.02, 0.01, 0.1, 0.35, 1.4, 2.5])
def test_force_is_interpolated_between_the_curves(damper, velocity):
    least, most = (np.sign(velocity) * np.interp(abs(velocity), (0.0, *VELOCITY), (0.0, *c)) for c in (LEAST, MOST))
    for share in (0.0, 0.25, 0.6, 1.0):
        expected = -(least + share * (most - least))
        assert force(damper, velocity, share * LARGEST_CURRENT) == pytest.approx(expected, rel=1e-12)


def test_passive_and_symmetric(damper):
    """Without hysteresis the damper takes power at any velocity and current, the same in both directions."""
    rng = np.random.default_rng(3)
    run = Named(damper, NO_HYSTERESIS)
    for _ in range(500):
        velocity, deflection = rng.normal(0, 1), rng.normal(0, 0.05)
        run.x = np.array([rng.uniform(0, LARGEST_CURRENT)])
        one = run.put(suspension__velocity=velocity, suspension__deflection=deflection).shown()
        other = run.put(suspension__velocity=-velocity, suspension__deflection=-deflection).shown()
        assert one["power"] < 0
        assert one["power"] == pytest.approx(one["force"] * velocity)
        assert (other["force"], other["power"]) == pytest.approx((-one["force"], one["power"]))


def test_hysteresis_shifts_the_velocity_by_the_sign_of_the_deflection(damper):
    """Kwok et al.: tanh(beta v + delta sign(x)); far from x = 0 the shift is all of delta / beta."""
    shifted = {"hysteresis.speed": 0.04}
    for v, x in ((0.1, 0.05), (0.1, -0.05), (-0.3, 0.05), (0.0, -0.05)):
        expected = force(damper, v + math.copysign(0.04, x), 1.0)
        assert force(damper, v, 1.0, x, **shifted) == pytest.approx(expected, rel=2e-4)
    assert force(damper, 0.3, 1.0, 0.0, **shifted) == pytest.approx(force(damper, 0.3, 1.0))
    # Extended and still: the shift opens the loop of force over velocity, so it has a force at no velocity.
    assert force(damper, 0.0, 1.0, 0.05, **shifted) < -250


def test_current_lags_and_saturates(damper):
    run = Named(damper)
    step = 5e-4
    run.put(current=1.5)
    for _ in range(20):
        run.step(step)
    assert run.x[0] == pytest.approx(1.5 * (1 - math.exp(-1)), rel=1e-4)
    for command, end in ((50.0, LARGEST_CURRENT), (-3.0, 0.0)):
        run.put(current=command)
        for _ in range(400):
            run.step(step)
        assert run.x[0] == pytest.approx(end, abs=1e-6)
    assert run.put(current=2.0).shown()["coil.power"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"curve.extension.most[2]": 250.0}, "curve.extension.most[2] must not be less than"),
        ({"curve.compression.least[1]": 800.0}, "curve.compression.most[1] must not be less than"),
        ({"curve.velocity[2]": 0.5}, "curve.velocity[3] must be larger"),
    ],
)
def test_curves_of_no_damper_are_refused(damper, changed, says):
    values = damper.vector("parameter", changed)
    assert any(says in message for message in damper.failed_checks(p=values))
    assert not damper.failed_checks()
