"""Speed profile: x is the integral of speed, at every sample and without drift."""

import numpy as np
import pytest

from build_fmus.reference import simulate
from fmu_sources.roads import speed_profile


@pytest.fixture(scope="module")
def profile():
    return speed_profile().model()


def at(profile, time, **parameters):
    p = profile.vector("parameter")
    names = [e.name for e in profile.elements("parameter")]
    for name, value in parameters.items():
        p[names.index(name.replace("__", "."))] = value
    return tuple(np.asarray(profile.functions["out"](time, [], [], p)).ravel())


def test_constant_speed_never_drifts(profile):
    assert at(profile, 0.0, start__speed=12.0) == (5.0, 12.0)
    assert at(profile, 1e6, start__speed=12.0) == (5.0 + 12e6, 12.0)
    assert at(profile, 3.7, start__speed=0.0) == (5.0, 0.0)


def test_ramp(profile):
    ramp = {"start__speed": 10.0, "ramp__change": -4.0, "ramp__start": 2.0, "ramp__duration": 5.0, "start__x": 0.0}
    assert at(profile, 2.0, **ramp) == (20.0, 10.0)
    assert at(profile, 4.5, **ramp) == pytest.approx((20 + 2.5 * 9, 8.0))
    assert at(profile, 7.0, **ramp) == pytest.approx((20 + 5 * 8, 6.0))
    assert at(profile, 9.0, **ramp) == pytest.approx((60 + 2 * 6, 6.0))


def test_jump(profile):
    jump = {"start__speed": 10.0, "ramp__change": 5.0, "ramp__start": 1.0, "start__x": 0.0}
    assert at(profile, 0.999, **jump) == pytest.approx((9.99, 10.0))
    assert at(profile, 1.0, **jump) == pytest.approx((10.0, 15.0))
    assert at(profile, 2.0, **jump) == pytest.approx((25.0, 15.0))


def test_x_is_the_integral_of_speed(profile):
    parameters = {"start.speed": 3.0, "ramp.change": 20.0, "ramp.start": 0.05, "ramp.duration": 0.1}
    result = simulate(profile, parameters=parameters, steps=300)
    x, speed = (result.outputs[1:, result.output_names.index(n)] for n in ("x", "speed"))
    assert np.diff(x) == pytest.approx(1e-3 * (speed[1:] + speed[:-1]) / 2, abs=1e-12)
