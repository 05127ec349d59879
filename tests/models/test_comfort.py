"""Comfort figures against analytic values and published tables."""

import math

import numpy as np
import pytest
from oracles.comfort import analog_response
from scipy import signal
from scipy.optimize import minimize_scalar

from fmu_sources.models import comfort

RATE = 1000.0
# ISO 2631-1, table 3: factors of Wk (x 1000) at the nominal third-octave centers [Hz].
WK = {
    0.5: 418, 0.63: 459, 0.8: 477, 1: 482, 1.25: 484, 1.6: 494, 2: 531, 2.5: 631, 3.15: 804, 4: 967, 5: 1039, 6.3: 1054,
    8: 1036, 10: 988, 12.5: 902, 16: 768, 20: 636, 25: 513, 31.5: 405, 40: 314, 50: 246, 63: 186, 80: 132,
}  # fmt: skip
# Power of the filter of third order over that of second order by frequency [Hz], from the transfer functions.
POWER_RATIOS = {1: 1.06, 2: 1.17, 3: 1.33, 4: 1.38, 5: 1.24, 8: 1.07, 20: 1.31}


def digital_gain(sections, frequency, rate=RATE):
    return np.abs(signal.sosfreqz(comfort.digital_sections(sections, rate), np.atleast_1d(frequency), fs=rate)[1])


def decibel(ratio):
    return 20 * np.log10(ratio)


def hrf(frequency):
    """|HRF| of (1.19), written out once more."""
    w = 2 * np.pi * np.asarray(frequency)
    return 12 * w / np.hypot(901.3 - w**2, 30.02 * w)


def sine(frequency, amplitude=1.0, seconds=40.0):
    return amplitude * np.sin(2 * np.pi * frequency * np.arange(round(seconds * RATE)) / RATE)


class TestHumanResponse:
    @pytest.mark.parametrize(
        "gain",
        [
            lambda f: abs(analog_response(comfort.HUMAN_RESPONSE, f)),
            lambda f: digital_gain(comfort.HUMAN_RESPONSE, f)[0],
        ],
        ids=["analog", "digital"],
    )
    def test_peak(self, gain):
        top = minimize_scalar(lambda f: -gain(f), bounds=(1, 10), method="bounded")
        assert top.x == pytest.approx(4.78, abs=0.005)
        assert -top.fun == pytest.approx(0.400, abs=0.002)

    def test_digital_is_the_analog_one(self):
        for f, tolerance in ((np.geomspace(0.1, 12, 50), 1e-3), (np.geomspace(12, 20, 20), 3e-3)):
            assert np.all(np.abs(digital_gain(comfort.HUMAN_RESPONSE, f) ** 2 / hrf(f) ** 2 - 1) < tolerance)

    def test_agrees_with_the_established_filter(self):
        """14.5 s (s + 44) / ((s + 63) (s2 + 24 s + 750)), also on ft/s2: 3 to 15 % below it over 1 to 10 Hz."""
        f = np.geomspace(1, 10, 30)
        s = 2j * np.pi * f
        established = np.abs(14.5 * s * (s + 44) / ((s + 63) * (s**2 + 24 * s + 750)))
        ratio = np.abs(analog_response(comfort.HUMAN_RESPONSE, f)) / established
        assert np.all((ratio > 0.845) & (ratio < 0.975))


class TestBothDefinitions:
    def test_third_order_is_that_of_the_literature(self):
        f = np.geomspace(0.1, 30, 60)
        s = 2j * np.pi * f
        written_out = np.abs(14.5 * s * (s + 44) / ((s + 63) * (s**2 + 24 * s + 750)))
        assert np.abs(analog_response(comfort.HUMAN_RESPONSE_NRMM, f)) == pytest.approx(written_out, rel=1e-12)
        digital = np.abs(digital_gain(comfort.HUMAN_RESPONSE_NRMM, f))
        assert np.abs(digital / written_out - 1).max() < 5e-3

    def test_each_section_is_exact_at_its_own_frequency(self):
        """That of s2 + 24 s + 750 at 750^(1/2) rad/s, and s / (s + 63) at 63 rad/s.

        There the latter passes 1/2^(1/2) / 63.
        """
        rows = comfort.digital_sections(comfort.HUMAN_RESPONSE_NRMM, RATE)
        for row, w, gain in (
            (rows[0], math.sqrt(750), abs(14.5 * 1j * math.sqrt(750) + 14.5 * 44) / 24),
            (rows[1], 63.0, 1 / (63 * math.sqrt(2))),
        ):
            (digital,) = np.abs(signal.sosfreqz(row[None], [w], fs=2 * math.pi * RATE)[1])
            assert digital == pytest.approx(gain, rel=1e-9)

    @pytest.mark.parametrize(("frequency", "ratio"), POWER_RATIOS.items())
    def test_power_differs_by_frequency(self, frequency, ratio):
        az = sine(frequency, seconds=20.0)
        one, other = (
            comfort.absorbed_power(az, RATE, r) for r in (comfort.HUMAN_RESPONSE_NRMM, comfort.HUMAN_RESPONSE)
        )
        assert one / other == pytest.approx(ratio, abs=0.012)

    def test_a_section_of_first_order_forgets(self):
        """After a pulse its output dies away; with a pole on the unit circle it would not."""
        _, slow = comfort.digital_sections(comfort.HUMAN_RESPONSE_NRMM, RATE)
        assert slow[2] == slow[5] == 0.0
        pulse = np.zeros(4000)
        pulse[0] = 1.0
        assert np.abs(comfort.absorbed_power_series(pulse, RATE, comfort.HUMAN_RESPONSE_NRMM)[-1]) < 1e-25


class TestWk:
    def test_table_of_the_standard(self):
        """The analog weighting rounds to the table (within a digit at one center), the digital one is within 0.2 dB."""
        f, table = np.array([*WK]), np.array([*WK.values()]) / 1000
        analog = np.abs(analog_response(comfort.WEIGHTING_WK, f))
        assert np.abs(analog - table).max() <= 1.01e-3
        assert np.abs(decibel(digital_gain(comfort.WEIGHTING_WK, f) / table)).max() < 0.2

    @pytest.mark.parametrize(("rate", "tolerance"), [(500.0, 0.55), (1000.0, 0.2), (2000.0, 0.1), (5000.0, 0.06)])
    def test_third_octaves_are_within_the_tolerance(self, rate, tolerance):
        """The standard allows 1 dB."""
        f = 10 ** (np.arange(-3, 20) / 10)
        gain = digital_gain(comfort.WEIGHTING_WK, f, rate)
        assert np.abs(decibel(gain / np.abs(analog_response(comfort.WEIGHTING_WK, f)))).max() < tolerance
        assert np.abs(decibel(gain / (np.array([*WK.values()]) / 1000))).max() < 1.0

    def test_band_limits(self):
        assert digital_gain(comfort.WEIGHTING_WK, 0.02) < 0.01
        assert digital_gain(comfort.WEIGHTING_WK, 400.0) < 0.01
        assert np.sum(comfort.digital_sections(comfort.WEIGHTING_WK, RATE)[0, :3]) == pytest.approx(0, abs=1e-15)


class TestAbsorbedPower:
    @pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 12.0])
    def test_of_a_settled_sine(self, frequency):
        """Amplitude a [m/s2]: (3.2808 a |HRF|)^2 / 2, to 0.1 %."""
        expected = (3.0 / 0.3048 * hrf(frequency)) ** 2 / 2
        az = sine(frequency, 3.0)
        assert np.mean(comfort.absorbed_power_series(az, RATE)[20_000:]) == pytest.approx(expected, rel=1e-3)
        assert comfort.absorbed_power_window(az, RATE, 2.0)[-1] == pytest.approx(expected, rel=1e-3)
        assert comfort.absorbed_power_peak(az, RATE, 10.0) == pytest.approx(expected, rel=2e-2)  # start-up included
        assert comfort.absorbed_power(az, RATE) == pytest.approx(expected, rel=2e-2)

    def test_six_watt_at_the_worst_frequency(self):
        """At 4.78 Hz an r.m.s. of 1.87 m/s2 is at the limit; a filter on m/s2 would show 0.56 W."""
        rms = math.sqrt(6.0) / 0.39973 * 0.3048
        assert rms == pytest.approx(1.868, abs=1e-3)
        assert comfort.absorbed_power(sine(4.78, rms * math.sqrt(2)), RATE) == pytest.approx(6.0, rel=5e-3)

    @pytest.mark.parametrize("window", [0.001, 0.0499, 0.05, 0.3, 1.0, 2.0, 7.0])
    @pytest.mark.parametrize("count", [1, 49, 50, 51, 1000])
    def test_window_is_the_plain_sum(self, window, count):
        az = np.random.default_rng(3).standard_normal(count)
        power = comfort.absorbed_power_series(az, RATE)
        n = comfort.window_samples(window, RATE)
        plain = [power[max(0, k + 1 - n) : k + 1].sum() / n for k in range(count)]
        np.testing.assert_allclose(comfort.absorbed_power_window(az, RATE, window), plain, rtol=1e-12)

    def test_a_window_longer_than_the_run_shares_the_power_out(self):
        az = sine(4.0, seconds=3.0)
        assert comfort.absorbed_power_peak(az, RATE, 12.0) == pytest.approx(comfort.absorbed_power(az, RATE) / 4)

    def test_a_window_over_silence_after_a_shock(self):
        """The power has died away, and no rounding of the shock is left."""
        az = np.zeros(20_000)
        az[:20] = 1e6
        window = comfort.absorbed_power_window(az, RATE)
        assert 0 <= window[-1] < 1e-60 * window.max()


class TestIso2631:
    @pytest.mark.parametrize(("frequency", "factor"), [(1.0, 0.482), (6.3, 1.054), (16.0, 0.768), (31.5, 0.405)])
    def test_rms_of_a_sine(self, frequency, factor):
        assert comfort.iso2631_rms(sine(frequency, 2.0), RATE) == pytest.approx(math.sqrt(2) * factor, rel=2e-2)

    def test_rms_is_of_the_whole_run(self):
        """Three quarters of the run are silent: half of the rms is left, and nothing of a median."""
        az = np.concatenate([sine(6.3, 2.0), np.zeros(3 * 40_000)])
        assert comfort.iso2631_rms(az, RATE) == pytest.approx(comfort.iso2631_rms(sine(6.3, 2.0), RATE) / 2, rel=1e-3)

    def test_dose_of_a_sine(self):
        """(3/8 T)^(1/4) of the weighted amplitude."""
        expected = 2.0 * 1.036 * (3 / 8 * 40.0) ** 0.25
        assert comfort.vdv(sine(8.0, 2.0), RATE) == pytest.approx(expected, rel=5e-3)

    def test_weighted_acceleration_loses_gravity(self):
        settled = comfort.weighted_acceleration(np.full(40_000, 9.81), RATE)[-1]
        assert abs(settled) < 1e-6


class TestInput:
    @pytest.mark.parametrize(
        "figure", [comfort.absorbed_power, comfort.absorbed_power_peak, comfort.iso2631_rms, comfort.vdv]
    )
    def test_zero_and_refusals(self, figure, raises, refused):
        assert figure(np.zeros(50), RATE) == 0.0
        refused(ValueError, lambda: figure([], RATE), lambda: figure([0.0, math.nan], RATE))
        for rate in (0.0, 50.0, math.nan, math.inf):
            with raises(ValueError, match=f"{rate:g}"):
                figure(np.zeros(5), rate)

    def test_wk_needs_more_than_the_human_response(self, raises):
        assert comfort.absorbed_power(np.zeros(5), 100.0) == 0.0
        with raises(ValueError):
            comfort.vdv(np.zeros(5), 100.0)

    @pytest.mark.parametrize("window", [0.0, -1.0, math.nan, math.inf])
    def test_windows(self, window, raises):
        with raises(ValueError):
            comfort.absorbed_power_peak(np.zeros(5), RATE, window)
