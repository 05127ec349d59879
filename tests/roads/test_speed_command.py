"""Speed as commanded: limited accelerations, and the distance that belongs to it."""

import numpy as np
import pytest

from build_fmus.reference import simulate
from fmu_sources.roads import speed_command

PERIOD = 1e-3


def drive(target, steps, **parameters):
    result = simulate(
        speed_command().model(),
        signals={"target.speed": target},
        parameters={k.replace("__", "."): v for k, v in parameters.items()},
        steps=steps,
    )
    return tuple(result.outputs[1:, result.output_names.index(n)] for n in ("x", "speed"))


def test_it_begins_at_the_target_and_stays_there():
    x, speed = drive(lambda t: 12.0, 2000, start__x=3.0)
    assert speed == pytest.approx(12.0, abs=0)
    assert x == pytest.approx(3.0 + 12.0 * PERIOD * np.arange(2000), rel=1e-12)


def test_accelerations_are_limited():
    def target(t):
        return 10.0 if t < 0.1 else 14.0 if t < 3.0 else 4.0

    x, speed = drive(target, 6000, acceleration__max=2.0, deceleration__max=5.0, start__x=0.0)
    t = PERIOD * np.arange(6000)
    assert np.diff(speed).max() == pytest.approx(2.0 * PERIOD)
    assert np.diff(speed).min() == pytest.approx(-5.0 * PERIOD)
    rising = (t > 0.1) & (t < 2.1)
    assert speed[rising] == pytest.approx(10.0 + 2.0 * (t[rising] - 0.1), abs=3e-3)
    assert speed[(t > 2.2) & (t < 3.0)] == pytest.approx(14.0, abs=1e-12)
    assert speed[-1] == pytest.approx(4.0, abs=1e-12)
    distance = np.concatenate([[0.0], np.cumsum(PERIOD * (speed[1:] + speed[:-1]) / 2)])
    assert x == pytest.approx(distance, abs=1e-9)  # exact for a speed that is linear in between


def test_without_a_limit_there_is_none():
    _, speed = drive(lambda t: 0.0 if t >= 0.5 else 1.0, 1000, deceleration__max=0.0)
    assert speed == pytest.approx(1.0, abs=0)
