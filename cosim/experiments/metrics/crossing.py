"""How hard a vehicle crosses an obstacle: peaks, pass or fail, cost and score.

"Kale" stands for the thesis behind paper 003 (trench crossing of a 6x6 vehicle). The quantities are those of its Table
5.3, in the units of that table: accelerations in m/s2, pitch in deg, hub forces in kN (printed there as N), "A2/Hz rms"
in m/s2.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import number
from cosim.core.signals import Array, finite_series, peak

PSD_RATE = 1000.0  # Hz, sampling of the accelerations


@dataclass(frozen=True)
class Crossing:
    """The eight quantities of one run; largest magnitudes, except for the two root mean squares."""

    az: float  # m/s2, vertical acceleration of the body
    ax: float  # m/s2, longitudinal acceleration of the body
    az_rms: float  # m/s2, root of the integral of the power spectral density
    ax_rms: float  # m/s2
    pitch: float  # deg
    hub_front: float  # kN, longitudinal force on a wheel hub of axle 1
    hub_middle: float  # kN, axle 2
    hub_rear: float  # kN, axle 3

    def as_dict(self) -> dict[str, float]:
        """Values by field name, in the order of the table."""
        return asdict(self)


QUANTITIES: Mapping[str, tuple[str, float, float]] = {
    "az": ("peak vertical acceleration [m/s2]", 150.0, 12.5),
    "ax": ("peak longitudinal acceleration [m/s2]", 100.0, 17.5),
    "az_rms": ("vertical acceleration rms [m/s2]", 5.0, 12.5),
    "ax_rms": ("longitudinal acceleration rms [m/s2]", 5.0, 15.0),
    "pitch": ("peak pitch [deg]", 15.0, 17.5),
    "hub_front": ("peak front hub force [kN]", 225.0, 10.0),
    "hub_middle": ("peak middle hub force [kN]", 225.0, 7.5),
    "hub_rear": ("peak rear hub force [kN]", 225.0, 7.5),
}
"""Words, limit (Kale, Table 5.3) and share of the cost function in per cent (Kale, Table 5.10), by field."""
LABELS = {name: words for name, (words, _, _) in QUANTITIES.items()}
LIMITS = Crossing(*(limit for _, limit, _ in QUANTITIES.values()))
"""What a crossing must not exceed."""
WEIGHTS = {name: share for name, (_, _, share) in QUANTITIES.items()}
BEST, WORST = 5.0, 1.0  # scores; Kale, Table 5.9


def psd(
    acceleration_m_s2: npt.ArrayLike, rate_hz: float = PSD_RATE, *, name: str = "acceleration"
) -> tuple[Array, Array]:
    """Frequencies [Hz] and one-sided power spectral density [(m/s2)2/Hz]: periodogram, mean left in. Kale, figure 5.39.

    Raises:
        ValueError: a value is not finite, there are fewer than two, or the rate is not positive.
    """
    series = finite_series(name, acceleration_m_s2)
    number("sampling rate", rate_hz, "Hz", above=0)
    if len(series) < 2:
        raise ValueError(f"{name} has {len(series)} sample; a spectrum needs two at least")
    from scipy import signal  # slow to import

    frequency, density = signal.periodogram(series, rate_hz, detrend=False)
    return np.asarray(frequency, dtype=float), np.asarray(density, dtype=float)


def psd_rms(acceleration_m_s2: npt.ArrayLike, rate_hz: float = PSD_RATE, *, name: str = "acceleration") -> float:
    """Root of the integral of the power spectral density [m/s2]. Kale, below figure 5.39.

    The sum over the lines of the periodogram, so by Parseval's theorem it is the root mean square over the run.
    """
    frequency, density = psd(acceleration_m_s2, rate_hz, name=name)
    return math.sqrt(float(np.sum(density)) * float(frequency[1]))


def crossing(
    az_m_s2: npt.ArrayLike,
    ax_m_s2: npt.ArrayLike,
    pitch_rad: npt.ArrayLike,
    hub_fx_n: npt.ArrayLike,
    rate_hz: float = PSD_RATE,
) -> Crossing:
    """The quantities of a run.

    Args:
        az_m_s2: vertical accelerations of the body (samples,).
        ax_m_s2: longitudinal accelerations of the body (samples,).
        pitch_rad: pitch of the body (samples,).
        hub_fx_n: longitudinal hub forces [N] (samples, 2 * axles = 6), axle by axle from the front, left and right.
        rate_hz: samples per second. Peaks are those of all samples; an RMS is that of every n-th one, at 1 kHz, where
            the rate is n times as high.

    Raises:
        ValueError: a signal has another shape or length, or a value is not finite.
    """
    signals = {
        "vertical acceleration": finite_series("vertical acceleration", az_m_s2),
        "longitudinal acceleration": finite_series("longitudinal acceleration", ax_m_s2),
        "pitch": finite_series("pitch", pitch_rad),
    }
    hubs = np.asarray(hub_fx_n, dtype=float)
    if hubs.ndim != 2 or hubs.shape[1] != 6:
        raise ValueError(f"hub forces have shape {hubs.shape}; expected one row per sample, six columns")
    signals |= {f"hub force {i + 1}": finite_series(f"hub force {i + 1}", hubs[:, i]) for i in range(6)}
    lengths = {n: len(s) for n, s in signals.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"the signals have different numbers of samples: {lengths}")
    az, ax, pitch = list(signals.values())[:3]
    every = max(1, round(rate_hz / PSD_RATE))
    axles = np.abs(hubs).reshape(-1, 3, 2).max(axis=(0, 2)) / 1e3
    return Crossing(
        az=peak(az),
        ax=peak(ax),
        az_rms=psd_rms(az[::every], rate_hz / every, name="vertical acceleration"),
        ax_rms=psd_rms(ax[::every], rate_hz / every, name="longitudinal acceleration"),
        pitch=math.degrees(peak(pitch)),
        hub_front=float(axles[0]),
        hub_middle=float(axles[1]),
        hub_rear=float(axles[2]),
    )


def exceeded(run: Crossing, limits: Crossing = LIMITS) -> tuple[str, ...]:
    """Names of the quantities above their limit. Kale, Table 5.3."""
    return tuple(f.name for f in fields(Crossing) if not getattr(run, f.name) <= getattr(limits, f.name))


def failures(run: Crossing, *, arrived: bool, belly_contact: bool, limits: Crossing = LIMITS) -> tuple[str, ...]:
    """Why a crossing counts as failed: `"stuck"`, `"belly contact"` and what is above its limit. Empty when it passed.

    Bumpers may touch (Kale, figures 5.15 to 5.20); what hangs below the body may not.
    """
    reasons = ["stuck"] * (not arrived) + ["belly contact"] * belly_contact
    return (*reasons, *exceeded(run, limits))


def cost(run: Crossing, weights: Mapping[str, float] = WEIGHTS) -> float:
    """Weighted sum, weights in per cent; `cost(LIMITS)` is the reference line of figure 5.41.

    Kale, section 5.6 and Tables 5.9 to 5.11.
    """
    return sum(w * getattr(run, n) for n, w in weights.items())


def normalized(value: float, costs: Iterable[float]) -> float:
    """Cost between 0 (the lowest of `costs`) and 1 (the highest), over runs with and without control.

    Raises:
        ValueError: all costs are the same.

    Source:
        Kale, Table 5.11.
    """
    series = finite_series("cost", list(costs))
    low, high = float(series.min()), float(series.max())
    if high == low:
        raise ValueError(f"all costs are {low:g}; there is nothing to scale with")
    return (value - low) / (high - low)


def reduction_percent(controlled: float, passive: float) -> float:
    """By how many per cent a quantity is lower than that of the passive vehicle; nan where that is 0.

    Kale, Tables 5.6 to 5.8; of normalized costs it is the improvement of Table 5.11.
    """
    return math.nan if passive == 0.0 else 100.0 * (1.0 - controlled / passive)


def scores(costs: Iterable[float]) -> list[float]:
    """From 5 (lowest cost) to 1 (highest) of the controlled runs. Kale, Table 5.9.

    Raises:
        ValueError: there are no costs, or all are the same.
    """
    costs = list(costs)
    return [BEST - (BEST - WORST) * normalized(c, costs) for c in costs]
