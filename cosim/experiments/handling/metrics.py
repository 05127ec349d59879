"""What is measured of a car in a manoeuvre, from signals every so often [SI, ISO 8855 axes].

Definitions are our own words and formulas; the manoeuvres are those of ISO 4138 (2021, steady cornering), ISO 7401
(2011, step and sine), ISO 3888-1 (2018) and 3888-2 (2011, lane changes), ISO 7975 (2019, braking in a turn) and ISO
19365 (2016, sine with dwell), as far as `runs` says.
"""

from __future__ import annotations

import numpy as np

from cosim.core.signals import Array

SLIGHT = (0.5, 3.0)  # m/s2 of lateral acceleration, where a car is taken as linear


def side_slip(vx: Array, vy: Array, yaw: Array) -> Array:
    """Angle [rad] from the heading to the velocity, positive left; velocities in road axes [m/s], yaw [rad]."""
    return np.asarray(np.arctan2(vy * np.cos(yaw) - vx * np.sin(yaw), vx * np.cos(yaw) + vy * np.sin(yaw)))


def understeer_gradient(steer: Array, yaw_rate: Array, speed: Array, ay: Array, wheelbase: float) -> float:
    """Steer angle per lateral acceleration beyond that of the turn's geometry [rad.s2/m]; positive: understeer.

    Slope of `steer - wheelbase yaw_rate / speed` over `ay`, in least squares with an offset, where `ay` is `SLIGHT` and
    has not been above it: what a car does after it has slid does not count.

    Returns NaN where the manoeuvre has fewer than 10 such samples.
    """
    slight = np.maximum.accumulate(np.abs(ay)) <= SLIGHT[1]
    used = slight & (np.abs(ay) >= SLIGHT[0])
    if used.sum() < 10:
        return float("nan")
    beyond = (steer - wheelbase * yaw_rate / speed)[used]
    a = ay[used] - ay[used].mean()
    return float(a @ (beyond - beyond.mean()) / (a @ a))


def settled(values: Array, part: float = 0.1) -> float:
    """Mean over the last part of a signal."""
    return float(np.mean(values[-max(1, round(part * len(values))) :]))


def reach_time(time: Array, values: Array, part: float, final: float | None = None) -> float:
    """When a signal first has this part of its final value [s], linear between samples; NaN if never."""
    final = settled(values) if final is None else final
    rising = values / final if final else np.zeros(len(values))
    above = np.flatnonzero(rising >= part)
    if not above.size:
        return float("nan")
    i = int(above[0])
    return float(time[0] if i == 0 else np.interp(part, rising[i - 1 : i + 1], time[i - 1 : i + 1]))


def response_time(time: Array, steer: Array, response: Array) -> float:
    """From half of the final steer angle to 0.9 of the final response [s]."""
    return reach_time(time, response, 0.9) - reach_time(time, steer, 0.5)


def overshoot(response: Array) -> float:
    """By how much the largest response is above the final one, divided by the final one; 0 if it is not above."""
    final = settled(response)
    return max(float((response / final).max()) - 1.0, 0.0) if final else 0.0


def delay(time: Array, steer: Array, response: Array) -> float:
    """By how much the response comes after the steer angle [s]: where their cross-correlation is largest."""
    products = np.correlate(response, steer, mode="full")
    return float((int(np.argmax(products)) - (len(steer) - 1)) * (time[1] - time[0]))


def rollover_index(left: Array, right: Array) -> Array:
    """Difference of the vertical tire forces of both sides over their sum; 1: all wheels of the left side lift off."""
    return np.asarray((right - left) / np.maximum(right + left, 1.0))


def load_transfer(left: Array, right: Array) -> Array:
    """Lateral load transfer of an axle, as part of its static load: (F_r - F_l) / (F_l + F_r at the start).

    Vertical tire forces (samples,) [N] of a car that starts in equilibrium. 1: half of the static load of the axle has
    gone from one wheel to the other, so that a wheel lifts unless the axle bears more than its static load.
    """
    return np.asarray((right - left) / (left[0] + right[0]))


def follows_until(ay: Array, yaw_rate: Array, speed: Array, part: float = 0.1) -> int:
    """Number of samples in which a car follows the circle of its steering wheel, which turns slowly.

    In a steady turn the side slip is constant and ay = v r. A car that slides off or spins turns its velocity at
    another rate than its heading: |ay - v r| > `part` |ay|. Looked for from where |ay| is first above `SLIGHT`: the
    quotient means nothing at the start.
    """
    off = (np.maximum.accumulate(np.abs(ay)) > SLIGHT[1]) & (np.abs(ay - speed * yaw_rate) > part * np.abs(ay))
    return int(np.argmax(off)) if off.any() else len(ay)
