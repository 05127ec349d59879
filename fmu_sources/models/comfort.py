"""What a rider feels: absorbed power, ISO 2631-1 weighted acceleration, vibration dose.

Absorbed power has two definitions, and 6 W by one is not 6 W by the other: Donahue and Hedrick's filter of second order
(`HUMAN_RESPONSE`) and the one of third order of the ride-quality literature, which mobility models such as NRMM
use (`HUMAN_RESPONSE_NRMM`). On one acceleration the power of the latter is 1.06 times that of the former at 1 Hz,
1.38 times at 4 Hz, 1.07 times at 8 Hz. Functions take either as `response`.

The filters are given once, as analog sections (also `WEIGHTING_WK`), and become
digital by the bilinear transformation; every section is prewarped at its own frequency, where its digital gain and
phase are exact. Online components and the functions of this module use the same coefficients
(`digital_sections`), the same start (filters at rest) and the same sums (a sample stands for the sampling
interval before it).

"Donahue and Hedrick" stands for "Implementation of an Active Suspension, Preview Controller for Improved Ride Comfort".
Accelerations are vertical, in m/s2, and finite; an error names the sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import number
from cosim.core.signals import Array, finite_series, rms

__all__ = [
    "ABSORBED_POWER_LIMIT",
    "FEET_PER_METRE",
    "HUMAN_RESPONSE",
    "HUMAN_RESPONSE_NRMM",
    "WEIGHTING_WK",
    "Section",
    "absorbed_power",
    "absorbed_power_peak",
    "absorbed_power_series",
    "absorbed_power_window",
    "digital_sections",
    "iso2631_rms",
    "vdv",
    "weighted_acceleration",
    "window_samples",
]

FEET_PER_METRE = 1 / 0.3048
ABSORBED_POWER_LIMIT = 6.0  # W, what a driver bears for long; Donahue and Hedrick, section 1.6
LOWEST_RATE = 100.0  # Hz, for accelerations that a rider feels up to about 10 Hz


@dataclass(frozen=True)
class Section:
    """Section `(b[0] + b[1] s + b[2] s2) / (a[0] + a[1] s + a[2] s2)` of a filter.

    Exact at `frequency` [Hz] when made digital; of first order where `b[2]` and `a[2]` are 0.
    """

    b: tuple[float, float, float]
    a: tuple[float, float, float]
    frequency: float


def _human_response() -> tuple[Section, ...]:
    b, a = (0.0, 12.0, 0.0), (901.3, 30.02, 1.0)
    return (Section(b, a, math.sqrt(a[0]) / (2 * math.pi)),)  # prewarped where it peaks


def _human_response_nrmm() -> tuple[Section, ...]:
    resonance, slow = (750.0, 24.0, 1.0), (63.0, 1.0, 0.0)
    return (
        Section((0.0, 14.5 * 44.0, 14.5), resonance, math.sqrt(resonance[0]) / (2 * math.pi)),
        Section((1.0, 0.0, 0.0), slow, slow[0] / (2 * math.pi)),
    )


def _weighting_wk() -> tuple[Section, ...]:
    q = math.sqrt(0.5)
    high, low, transition, lower, upper = (2 * math.pi * f for f in (0.4, 100.0, 12.5, 2.37, 3.35))
    q_transition, q_step = 0.63, 0.91
    return (
        Section((0.0, 0.0, 1.0), (high**2, high / q, 1.0), 0.4),
        Section((low**2, 0.0, 0.0), (low**2, low / q, 1.0), 100.0),
        Section((transition**2, transition, 0.0), (transition**2, transition / q_transition, 1.0), 12.5),
        Section((lower**2, lower / q_step, 1.0), (upper**2, upper / q_step, 1.0), 3.35),
    )


HUMAN_RESPONSE = _human_response()
"""Donahue and Hedrick, (1.19): acceleration in ft/s2 in, square root of the absorbed power in W out."""

HUMAN_RESPONSE_NRMM = _human_response_nrmm()
"""Ride-quality literature: 14.5 s (s + 44) / ((s + 63) (s2 + 24 s + 750)), of the same units."""

WEIGHTING_WK = _weighting_wk()
"""Wk of ISO 2631-1, annex A (ISO 8041): band limits 0.4 and 100 Hz, transition at 12.5 Hz, step from 2.37 to 3.35 Hz.
"""


def digital_sections(sections: tuple[Section, ...], rate_hz: float) -> Array:
    """One row `b0 b1 b2 1 a1 a2` per section, as `scipy.signal.sosfilt` takes them.

    At 1 kHz the human response is within 0.1 % in power up to 12 Hz and 0.3 % at 20 Hz, Wk within 0.2 dB up to 80 Hz;
    at the lowest rates they are 6 % (10 Hz) and 0.5 dB (80 Hz) low.

    Raises:
        ValueError: the rate is too low for the filter: below 100 Hz or five times its highest frequency.
    """
    least = max(LOWEST_RATE, 5 * max(s.frequency for s in sections))
    number("sampling rate of this filter", rate_hz, "Hz", least=least)
    rows = []
    for section in sections:
        w = 2 * math.pi * section.frequency
        c = w / math.tan(w / (2 * rate_hz))  # s = c (1 - 1/z) / (1 + 1/z)
        first_order = section.b[2] == section.a[2] == 0  # one memory: with two it would have a pole on the unit circle
        (b0, b1, b2), (a0, a1, a2) = (
            (
                (p0 + p1 * c, p0 - p1 * c, 0.0)
                if first_order
                else (p0 + p1 * c + p2 * c * c, 2 * (p0 - p2 * c * c), p0 - p1 * c + p2 * c * c)
            )
            for p0, p1, p2 in (section.b, section.a)
        )
        rows.append([b0 / a0, b1 / a0, b2 / a0, 1.0, a1 / a0, a2 / a0])
    return np.array(rows)


def absorbed_power_series(
    az_m_s2: npt.ArrayLike, rate_hz: float, response: tuple[Section, ...] = HUMAN_RESPONSE
) -> Array:
    """Square of the human response [W] at every sample. Donahue and Hedrick, (1.19), with the acceleration in ft/s2."""
    az = finite_series("vertical acceleration", az_m_s2)
    from scipy import signal  # slow to import

    felt = signal.sosfilt(digital_sections(response, rate_hz), FEET_PER_METRE * az)
    return np.asarray(felt * felt, dtype=float)


def absorbed_power(az_m_s2: npt.ArrayLike, rate_hz: float, response: tuple[Section, ...] = HUMAN_RESPONSE) -> float:
    """Mean absorbed power of the run [W], to be compared with `ABSORBED_POWER_LIMIT`.

    Source: Donahue and Hedrick, (1.19).
    """
    return float(np.mean(absorbed_power_series(az_m_s2, rate_hz, response)))


def window_samples(window_s: float, rate_hz: float) -> int:
    """Samples in a moving window of that length [s], at least one."""
    number("length of the window", window_s, "s", above=0)
    return max(1, math.floor(window_s * rate_hz + 0.5))


def absorbed_power_window(az_m_s2: npt.ArrayLike, rate_hz: float, window_s: float = 1.0) -> Array:
    """Mean of the absorbed power [W] over the last `window_s` seconds, at every sample. Donahue and Hedrick, (1.19).

    The vehicle counts as at rest before the run: the sum is divided by the whole window from the first sample on.
    """
    power = absorbed_power_series(az_m_s2, rate_hz)
    n = window_samples(window_s, rate_hz)
    # Sums over whole windows and over what is left and right of their borders: no difference of large numbers.
    padded = np.concatenate([np.zeros(n - 1), power, np.zeros(-(len(power) + n - 1) % n)]).reshape(-1, n)
    ahead = np.cumsum(padded, axis=1).ravel()
    behind = np.cumsum(padded[:, ::-1], axis=1)[:, ::-1].ravel()
    first = np.arange(len(power))  # each window covers padded[first : first + n]
    sums = np.where(first % n == 0, behind[first], behind[first] + ahead[first + n - 1])
    return np.asarray(sums / n, dtype=float)


def absorbed_power_peak(az_m_s2: npt.ArrayLike, rate_hz: float, window_s: float = 1.0) -> float:
    """Largest `absorbed_power_window` of the run [W]: the figure for single bumps. Donahue and Hedrick, section 1.6."""
    return float(np.max(absorbed_power_window(az_m_s2, rate_hz, window_s)))


def weighted_acceleration(az_m_s2: npt.ArrayLike, rate_hz: float) -> Array:
    """Wk-weighted vertical acceleration [m/s2]. ISO 2631-1, 6.4 and annex A."""
    az = finite_series("vertical acceleration", az_m_s2)
    from scipy import signal  # slow to import

    return np.asarray(signal.sosfilt(digital_sections(WEIGHTING_WK, rate_hz), az), dtype=float)


def iso2631_rms(az_m_s2: npt.ArrayLike, rate_hz: float) -> float:
    """Root mean square of the Wk-weighted acceleration over the run [m/s2]. ISO 2631-1, 6.1, equation (1)."""
    return rms(weighted_acceleration(az_m_s2, rate_hz))


def vdv(az_m_s2: npt.ArrayLike, rate_hz: float) -> float:
    """Fourth-power vibration dose value of the run [m/s1.75]. ISO 2631-1, 6.3.2, equation (5)."""
    return float((np.sum(weighted_acceleration(az_m_s2, rate_hz) ** 4) / rate_hz) ** 0.25)
