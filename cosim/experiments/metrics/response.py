"""Figures of merit, one function per published metric.

"Brown et al." stands for Brown, Murugan, Mazza, "Analytical Evaluation of Generalized Predictive Control Algorithms
Using a Full Vehicle Multi-Body Dynamics Model For Mobility Enhancement". Its metrics (22)-(24) are evaluated on signals
sampled at 100 Hz: the low-pass is causal and starts from zero, and the mean is taken over the whole run, start-up
included, so every run that is compared must cover the same stretch of road.

Every input must be finite; an error names the signal and the sample.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy import constants

from build_fmus.base.checks import number, whole_number
from cosim.core.signals import Array, finite_channels, finite_series

STANDARD_GRAVITY = constants.g  # m/s2, 9.80665


def low_pass(
    values: npt.ArrayLike, rate_hz: float, cutoff_hz: float = 1.0, order: int = 4, *, name: str = "signal"
) -> Array:
    """Causal Butterworth low-pass, bilinear, zero initial state; -3 dB at `cutoff_hz`. Brown et al., below (22)."""
    series = finite_series(name, values)
    if not (math.isfinite(rate_hz) and math.isfinite(cutoff_hz) and 0.0 < 2.0 * cutoff_hz < rate_hz):
        raise ValueError(f"cutoff {cutoff_hz} Hz must lie between 0 and half the sampling rate of {rate_hz} Hz")
    whole_number("filter order", order)
    from scipy import signal  # slow to import

    sections = signal.butter(order, cutoff_hz, fs=rate_hz, output="sos")
    return np.asarray(signal.sosfilt(sections, series), dtype=float)


def low_pass_mean(
    values: npt.ArrayLike, rate_hz: float, cutoff_hz: float = 1.0, order: int = 4, *, name: str = "signal"
) -> float:
    """Mean over the run of `low_pass`."""
    return float(np.mean(low_pass(values, rate_hz, cutoff_hz, order, name=name)))


def root_sum_square(values: npt.ArrayLike, *, name: str = "signal") -> Array:
    """sqrt(x' x) at every sample of x (n, k): what (22a)-(22c) of Brown et al. low-pass."""
    return np.asarray(np.linalg.norm(finite_channels(name, values), axis=1))


def response_magnitude(az_m_s2: npt.ArrayLike, pitch_rad: npt.ArrayLike, roll_rad: npt.ArrayLike) -> Array:
    """sqrt(y' y) at every sample, y = (vertical acceleration [g], pitch [deg], roll [deg]). Brown et al., (22a)."""
    az, pitch, roll = (
        finite_series(name, values)
        for name, values in (("vertical acceleration", az_m_s2), ("pitch", pitch_rad), ("roll", roll_rad))
    )
    if not len(az) == len(pitch) == len(roll):
        raise ValueError(
            f"vertical acceleration, pitch and roll have {len(az)}, {len(pitch)} and {len(roll)} samples; "
            "they must be sampled together"
        )
    return root_sum_square(np.column_stack([az / STANDARD_GRAVITY, np.degrees(pitch), np.degrees(roll)]))


def response_objective(
    az_m_s2: npt.ArrayLike, pitch_rad: npt.ArrayLike, roll_rad: npt.ArrayLike, rate_hz: float
) -> float:
    """J_resp: mean of the low-pass of sqrt(y' y), y in (g, deg, deg), over the run. Brown et al., (22a)."""
    return low_pass_mean(response_magnitude(az_m_s2, pitch_rad, roll_rad), rate_hz, name="response")


def actuator_force(forces_n: npt.ArrayLike, rate_hz: float) -> float:
    """Mean of the low-pass of sqrt(u' u) [N], u (n, actuators). Brown et al., (22b)."""
    return low_pass_mean(root_sum_square(forces_n, name="force"), rate_hz, name="force")


def actuator_power(powers_w: npt.ArrayLike, rate_hz: float) -> float:
    """Mean of the low-pass of sqrt(P' P) [W], P (n, actuators), signs of no effect. Brown et al., (22c)."""
    return low_pass_mean(root_sum_square(powers_w, name="power"), rate_hz, name="power")


def improvement(j: float, j_open: float) -> float:
    """Response improvement 1 - J / J_open loop. Brown et al., (23).

    Without any open-loop response (J_open = 0) there is nothing to improve on and the result is nan.
    """
    number("J", j, least=0)
    number("J of the open loop", j_open, least=0)
    return math.nan if j_open == 0.0 else 1.0 - j / j_open


def force_normalized_effectiveness(response_improvement: float, force_n: float) -> float:
    """Response improvement per actuator force [1/N]. Brown et al., (24a). nan without force, or if undefined itself."""
    return _effectiveness(response_improvement, force_n, "actuator force")


def power_normalized_effectiveness(response_improvement: float, power_w: float) -> float:
    """Response improvement per actuator power [1/W]. Brown et al., (24b). nan without power, or if undefined itself."""
    return _effectiveness(response_improvement, power_w, "actuator power")


def _effectiveness(response_improvement: float, effort: float, name: str) -> float:
    if math.isinf(response_improvement):
        raise ValueError(f"response improvement is {response_improvement}")
    number(name, effort, least=0)
    return math.nan if effort == 0.0 else response_improvement / effort
