"""RideComfort says during a run what `fmu_sources.models.comfort` says afterwards."""

import math

import numpy as np
import pytest

from build_fmus.reference import Evaluator
from fmu_sources.models import comfort
from fmu_sources.sensing import ride_comfort

RATE = 1000.0
HRF_AT_5_HZ = 12 * 10 * math.pi / math.hypot(901.3 - (10 * math.pi) ** 2, 30.02 * 10 * math.pi)


@pytest.fixture(scope="module")
def component():
    return ride_comfort().model()


def run(component, az, **parameters):
    """Outputs by name, one value per sample of the acceleration."""
    evaluator = Evaluator(component, {n.replace("__", "."): v for n, v in parameters.items()})
    slot = next(e.slot for e in component.elements("input"))
    rows = []
    for k, a in enumerate(az):
        evaluator.u[slot] = a
        evaluator.time = k * component.sample_time
        evaluator.step(component.sample_time)
        rows.append(evaluator.outputs())
    return dict(zip([e.name for e in component.output_elements()], np.array(rows).T, strict=True))


def check(y, az, rate=RATE, window=1.0, limit=6.0):
    """All figures at every sample, or at the end where that is what the metric is for."""
    moving = comfort.absorbed_power_window(az, rate, window)
    weighted = comfort.weighted_acceleration(az, rate)
    count = np.arange(1, len(az) + 1)
    nrmm = comfort.absorbed_power_series(az, rate, comfort.HUMAN_RESPONSE_NRMM)
    expected = {
        "absorbed_power.nrmm": nrmm,
        "absorbed_power.nrmm.mean": np.cumsum(nrmm) / count,
        "absorbed_power": comfort.absorbed_power_series(az, rate),
        "absorbed_power.window": moving,
        "absorbed_power.mean": np.cumsum(comfort.absorbed_power_series(az, rate)) / count,
        "absorbed_power.peak": np.maximum.accumulate(moving),
        "absorbed_power.above_limit": moving > limit,
        "iso2631.acceleration": weighted,
        "iso2631.rms": np.sqrt(np.cumsum(weighted**2) / count),
        "vdv": (np.cumsum(weighted**4) / rate) ** 0.25,
    }
    assert set(y) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(y[name], values, rtol=1e-9, atol=1e-12 * np.abs(values).max(), err_msg=name)
    assert y["absorbed_power.mean"][-1] == pytest.approx(comfort.absorbed_power(az, rate))
    assert y["absorbed_power.peak"][-1] == pytest.approx(comfort.absorbed_power_peak(az, rate, window))
    assert y["iso2631.rms"][-1] == pytest.approx(comfort.iso2631_rms(az, rate))
    assert y["vdv"][-1] == pytest.approx(comfort.vdv(az, rate))


@pytest.mark.parametrize("window", [0.001, 0.0034, 0.25, 1.0])
def test_equals_the_offline_metrics(component, window):
    az = 4.0 * np.random.default_rng(7).standard_normal(2600)
    check(run(component, az, window__length=window), az, window=window)


def test_window_longer_than_the_run(component):
    az = 4.0 * np.random.default_rng(8).standard_normal(700)
    y = run(component, az, window__length=3.0)
    check(y, az, window=3.0)
    assert y["absorbed_power.window"][-1] == pytest.approx(y["absorbed_power.mean"][-1] * 700 / 3000)


def test_absorbed_power_of_a_sine(component):
    """2 m/s2 at 5 Hz: (3.2808 a |HRF|)^2 / 2 to 0.1 %."""
    az = 2.0 * np.sin(2 * np.pi * 5.0 * np.arange(4000) / RATE)
    y = run(component, az)
    expected = (2.0 / 0.3048 * HRF_AT_5_HZ) ** 2 / 2
    assert y["absorbed_power.window"][-1] == pytest.approx(expected, rel=1e-3)
    assert y["absorbed_power.above_limit"][-1] == (expected > 6.0)
    assert y["absorbed_power.above_limit"][0] == 0


def test_zero_input_is_exactly_zero(component):
    for values in run(component, np.zeros(1500)).values():
        assert not values.any()


def test_no_rounding_is_left_of_a_shock(component):
    """Two windows after it the mean over the window is that of the last samples alone."""
    az = np.zeros(6000)
    az[:20] = 1e6
    y = run(component, az, window__length=0.5)
    assert np.all(y["absorbed_power.window"] >= 0)
    np.testing.assert_allclose(
        y["absorbed_power.window"][2000:], comfort.absorbed_power_window(az, RATE, 0.5)[2000:], rtol=1e-6, atol=1e-9
    )
    assert y["absorbed_power.window"][-1] < 1e-30


def test_limit_is_a_parameter(component):
    az = np.sin(2 * np.pi * 5.0 * np.arange(1500) / RATE)
    check(run(component, az, absorbed_power__limit=0.2), az, limit=0.2)


def test_another_period(component, raises):
    az = np.random.default_rng(9).standard_normal(900)
    slow = ride_comfort("RideComfort2ms", period=2e-3).model()
    check(run(slow, az), az, rate=500.0)
    assert slow.size("state") < component.size("state")
    with raises(ValueError):
        ride_comfort(period=5e-3)


def test_outputs_act_on_the_sample_at_t(component):
    assert all(component.dependencies[e.name] == ["body.az"] for e in component.output_elements())
    assert run(component, [1.0])["absorbed_power"][0] > 0
