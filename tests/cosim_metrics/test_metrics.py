"""Published metrics against analytic values."""

import math

import numpy as np
import pytest
from scipy import signal

from cosim import Recording
from cosim.core.signals import columns, peak, rms
from cosim.experiments.metrics import response as metrics

RATE = 100.0


def butterworth_gain(frequency_hz, cutoff_hz=1.0, order=4, rate_hz=RATE):
    """|H| of the bilinear Butterworth low-pass, from its definition."""
    warp = np.tan(np.pi * frequency_hz / rate_hz) / np.tan(np.pi * cutoff_hz / rate_hz)
    return 1.0 / np.sqrt(1.0 + warp ** (2 * order))


class TestLowPass:
    @pytest.mark.parametrize("frequency", [0.2, 0.5, 1.0, 2.0, 5.0])
    def test_amplitude_of_a_settled_sine(self, frequency):
        t = np.arange(0.0, 40.0, 1 / RATE)
        settled = metrics.low_pass(3.0 * np.sin(2 * np.pi * frequency * t), RATE)[t >= 20.0]
        assert math.sqrt(2.0) * np.std(settled) == pytest.approx(3.0 * butterworth_gain(frequency), rel=1e-6)

    def test_equals_the_transfer_function_form_from_rest(self):
        x = np.random.default_rng(1).standard_normal(2000)
        b, a = signal.butter(4, 1.0 / 50.0)
        np.testing.assert_allclose(metrics.low_pass(x, RATE), signal.lfilter(b, a, x), atol=1e-8)

    def test_starts_from_zero_and_is_causal(self):
        x = np.ones(3000)
        y = metrics.low_pass(x, RATE)
        assert 0.0 < y[0] < 1e-5
        assert y[-1] == pytest.approx(1.0, abs=1e-12)
        x[1500:] = 50.0
        np.testing.assert_array_equal(metrics.low_pass(x, RATE)[:1500], y[:1500])

    def test_mean_of_a_constant_loses_only_the_group_delay(self):
        """Mean of the step response over T is 1 - delay/T; the delay at DC of order 4 is 2.6131 / (2 pi 1 Hz)."""
        duration = 60.0
        mean = metrics.low_pass_mean(np.full(int(duration * RATE), 7.0), RATE)
        assert mean == pytest.approx(7.0 * (1.0 - 2.6131 / (2 * np.pi) / duration), rel=1e-3)

    @pytest.mark.parametrize(("rate", "cutoff"), [(2.0, 1.0), (0.0, 1.0), (100.0, 0.0), (np.nan, 1.0), (100.0, -1.0)])
    def test_refuses_rates(self, rate, cutoff, raises):
        with raises(ValueError):
            metrics.low_pass(np.ones(10), rate, cutoff)

    def test_a_cutoff_just_below_half_the_rate(self):
        np.testing.assert_allclose(metrics.low_pass(np.ones(2000), 2.1)[-1], 1.0)

    def test_refuses_order_and_shapes(self, refused):
        refused(
            ValueError,
            lambda: metrics.low_pass(np.ones(10), RATE, order=0),
            lambda: metrics.low_pass([], RATE),
            lambda: metrics.low_pass(np.ones((5, 2)), RATE),
        )


class TestResponse:
    def test_units(self):
        """One g, three degrees and no roll at one instant: sqrt(1 + 9)."""
        magnitude = metrics.response_magnitude([-9.80665, 0.0], [math.radians(3.0), 0.0], [0.0, math.radians(-2.0)])
        np.testing.assert_allclose(magnitude, [math.sqrt(10.0), 2.0], rtol=1e-14)

    def test_sine_pitch_settles_to_its_mean_magnitude(self):
        """|sin| has the mean 2/pi and its first harmonic at twice the frequency, far above the cutoff."""
        t = np.arange(0.0, 40.0, 1 / RATE)
        pitch = np.radians(4.0 * np.sin(2 * np.pi * 7.0 * t))
        zero = np.zeros_like(t)
        series = metrics.low_pass(metrics.response_magnitude(zero, pitch, zero), RATE)
        # The sampled |sin| misses some of its peaks: compare with the exact mean of its samples over whole periods.
        expected = np.mean(np.degrees(np.abs(pitch[2000:3000])))
        assert expected == pytest.approx(4.0 * 2.0 / np.pi, rel=2e-3)
        np.testing.assert_allclose(series[2000:], expected, rtol=1e-3)
        assert metrics.response_objective(zero, pitch, zero, RATE) == pytest.approx(np.mean(series))

    def test_two_quadrature_outputs_have_a_constant_magnitude(self):
        t = np.arange(0.0, 30.0, 1 / RATE)
        pitch, roll = (np.radians(2.5 * f(2 * np.pi * 1.4 * t)) for f in (np.sin, np.cos))
        series = metrics.low_pass(metrics.response_magnitude(np.zeros_like(t), pitch, roll), RATE)
        assert series[-1] == pytest.approx(2.5, rel=1e-9)

    def test_signals_must_belong_together(self):
        with pytest.raises(ValueError, match="10, 9 and 10 samples"):
            metrics.response_objective(np.zeros(10), np.zeros(9), np.zeros(10), RATE)


class TestActuator:
    def test_constant_forces(self):
        forces = np.tile([300.0, -400.0, 0.0, 1200.0], (6000, 1))
        reference = metrics.low_pass_mean(np.full(6000, 1300.0), RATE)
        assert metrics.actuator_force(forces, RATE) == pytest.approx(reference, rel=1e-12)
        assert metrics.actuator_force(forces, RATE) == pytest.approx(1300.0, rel=0.01)

    def test_power_has_no_sign(self):
        powers = np.random.default_rng(2).standard_normal((500, 4))
        assert metrics.actuator_power(powers, RATE) == metrics.actuator_power(-powers, RATE) > 0.0

    def test_zero(self):
        assert metrics.actuator_force(np.zeros((100, 4)), RATE) == 0.0
        assert metrics.actuator_power(np.zeros((100, 4)), RATE) == 0.0

    def test_refuses_one_dimension(self, refused):
        refused(
            ValueError,
            lambda: metrics.actuator_force(np.zeros(100), RATE),
            lambda: metrics.actuator_power(np.zeros((0, 4)), RATE),
        )


class TestRatios:
    def test_values(self):
        assert metrics.improvement(0.43, 1.0) == pytest.approx(0.57)
        assert metrics.improvement(3.0, 2.0) == pytest.approx(-0.5)
        assert metrics.force_normalized_effectiveness(0.57, 5700.0) == pytest.approx(1e-4)
        assert metrics.power_normalized_effectiveness(0.5, 250.0) == pytest.approx(2e-3)

    def test_undefined_is_nan(self):
        undefined = metrics.improvement(0.0, 0.0)
        assert math.isnan(undefined)
        assert math.isnan(metrics.force_normalized_effectiveness(0.0, 0.0))
        assert math.isnan(metrics.power_normalized_effectiveness(0.2, 0.0))
        assert math.isnan(metrics.force_normalized_effectiveness(undefined, 10.0))

    @pytest.mark.parametrize("bad", [math.nan, math.inf, -1.0])
    def test_refuses_what_no_run_can_give(self, bad, refused):
        with pytest.raises(ValueError, match=r"^J is"):
            metrics.improvement(bad, 1.0)
        refused(
            ValueError,
            lambda: metrics.improvement(1.0, bad),
            lambda: metrics.force_normalized_effectiveness(0.1, bad),
            lambda: metrics.power_normalized_effectiveness(0.1, bad),
        )

    def test_refuses_infinite_improvement(self, raises):
        with raises(ValueError):
            metrics.force_normalized_effectiveness(-math.inf, 1.0)


class TestPeak:
    def test_largest_magnitude(self):
        assert peak([1.0, -3.0, 2.0]) == 3.0
        assert peak([[1.0, -3.0], [5.0, 2.0]]) == 5.0

    def test_refuses_empty(self, raises):
        with raises(ValueError):
            peak([])


class TestRms:
    def test_of_all_samples_and_channels(self):
        assert rms([1.0, -1.0, 1.0]) == 1.0
        assert rms([[3.0, 0.0], [0.0, -4.0]]) == 2.5
        t = np.arange(1000) / 1000
        assert rms(2 * np.sin(2 * np.pi * 5 * t)) == pytest.approx(np.sqrt(2.0), rel=1e-12)


class TestNonFinite:
    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    def test_names_signal_and_sample(self, value, raises):
        good, bad = np.zeros(50), np.zeros(50)
        bad[12] = value
        wide = np.zeros((50, 4))
        wide[12, 3] = value
        for call in (
            lambda: metrics.low_pass_mean(bad, RATE),
            lambda: metrics.response_objective(bad, good, good, RATE),
            lambda: metrics.response_objective(good, bad, good, RATE),
            lambda: metrics.response_objective(good, good, bad, RATE),
            lambda: metrics.actuator_force(wide, RATE),
            lambda: metrics.actuator_power(wide, RATE),
            lambda: peak(bad, name="yaw"),
        ):
            with raises(ValueError, match=f"{value} at sample 12"):
                call()


def test_signals_of_corners_are_columns_in_this_order():
    recording = Recording(np.arange(3.0), ["f.b", "f.a"], np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]), {})
    np.testing.assert_array_equal(columns(recording, "f.{}", ["a", "b"]), [[2.0, 1.0], [4.0, 3.0], [6.0, 5.0]])
    np.testing.assert_array_equal(columns(recording, "g.{}", ["a", "b"], optional=True), np.zeros((3, 2)))
    for pattern, optional in (("g.{}", False), ("f.{}", True)):
        with pytest.raises(KeyError, match="was not recorded"):
            columns(recording, pattern, ["a", "c"], optional=optional)
