"""Speeds at which a car reaches a limit: 6 W of absorbed power over a course, 2.5 g at the seat over a half-round.

A search steps from a guess toward the limit, by as much as its runs say that the value rises with speed, until it has
a run below the limit and one above it, and narrows that down: where it expects the limit by a straight line on
logarithmic scales, or in the middle when that has not halved the interval. A run that is near the limit is followed by
one on the other side of it, so that most intervals are narrow at once. It ends where the interval is `TOLERANCE`
wide: how near a value is to the limit says nothing of the speed where the value hardly rises. Runs are made once: the
second limit of a search begins with those of the first, and they are stored under their cases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from cosim.experiments.metrics.response import STANDARD_GRAVITY
from cosim.experiments.ride.runs import LIMIT_G, Case
from cosim.study.case import values
from cosim.study.experiment import Row
from fmu_sources.models.comfort import ABSORBED_POWER_LIMIT

WITHIN = (3.0, 120.0)  # km/h
TOLERANCE = 0.02  # of the speed: the width of the interval between a run below the limit and one above
NEAR = 0.02  # of the limit, within which a run is followed by one on the other side
LONGEST = 1.5  # ratio of the longest step toward a limit
EXPONENT = 2.5  # with which absorbed power is taken to rise with speed, until two runs tell
STEEP = (1.0, 8.0)  # range of plausible exponents
LIMITS = {
    "absorbed_power_nrmm": ABSORBED_POWER_LIMIT,
    "absorbed_power": ABSORBED_POWER_LIMIT,
    "seat_peak": LIMIT_G * STANDARD_GRAVITY,
}
"""Metric -> its limit, in SI units."""


def crossing(
    value: Callable[[float], float],
    limit: float,
    guess: float,
    *,
    known: Iterable[float] = (),
    exponent: float = EXPONENT,
) -> tuple[float | None, str]:
    """Find the speed [km/h] at which `value` rises to `limit`, to a relative accuracy of `TOLERANCE`.

    Returns the speed with "found"; or None with "never" (at no speed of `WITHIN`) or "always" (at the lowest already).

    Args:
        value: function of a speed, above 0; infinite where a run failed.
        limit: value to reach.
        guess: speed of the first attempt; of several crossings, the search returns one near it.
        known: speeds whose value is known already; they are used first.
        exponent: assumed exponent of speed with which the value rises, as long as there is a single run.

    Raises:
        ValueError: `value` is not a number somewhere.
    """
    seen: dict[float, float] = {}

    def ask(v: float) -> None:
        seen[v] = value(v)
        if math.isnan(seen[v]):
            raise ValueError(f"the limited metric is not a number at {v:g} km/h")

    def far(v: float) -> float:
        return abs(math.log(v / guess))

    for v in known:
        ask(v)
    low, high = WITHIN
    if not seen:
        ask(_rounded(min(max(guess, low), high)))
    wide, least = math.inf, TOLERANCE
    answered = False
    while True:
        near = [v for v, found in seen.items() if abs(found / limit - 1) <= NEAR]
        if near and not answered:
            answered = True
            closest = min(near, key=far)
            beyond = _rounded(closest * (1 + 0.9 * TOLERANCE) ** (1 if seen[closest] < limit else -1))
            if low <= beyond <= high and beyond not in seen:
                ask(beyond)
        speeds = sorted(seen)
        rises = [(a, b) for a, b in pairwise(speeds) if seen[a] < limit <= seen[b]]
        if rises:
            below, above = min(rises, key=lambda pair: far(math.sqrt(pair[0] * pair[1])))
            before, wide = wide, math.log(above / below)
            part = 0.5 if wide > before / 2 else _part(seen[below], seen[above], limit)
            middle = _rounded(below * math.exp(wide * part))
            if above / below <= 1 + TOLERANCE or not below < middle < above:  # narrow, or closer than four digits tell
                return _rounded(math.sqrt(below * above)), "found"
            ask(middle)
            continue
        upwards = seen[min(speeds, key=far)] < limit
        edge = speeds[-1] if upwards else speeds[0]
        if edge == (high if upwards else low):
            return None, "never" if upwards else "always"
        ratio = min(max(_step(seen[edge], limit, rise(seen, limit, exponent)), 1 + least), LONGEST)
        least *= 2  # a value that only just does not get there is not followed in small steps
        ask(_rounded(min(edge * ratio, high) if upwards else max(edge / ratio, low)))


def _step(value: float, limit: float, exponent: float) -> float:
    """Ratio of the speeds of a run with a value and of the one at the limit."""
    return math.exp(abs(math.log(limit / value)) / exponent) if 0 < value < math.inf else LONGEST


def rise(seen: Mapping[float, float], limit: float, otherwise: float = EXPONENT) -> float:
    """Exponent of speed with which a value rises between the two runs nearest to a limit, within `STEEP`.

    `otherwise` is returned if there are no two.
    """
    usable = sorted((abs(math.log(v / limit)), speed) for speed, v in seen.items() if math.isfinite(v) and v > 0)
    if len(usable) < 2:
        return otherwise
    a, b = (speed for _, speed in usable[:2])
    return min(max(math.log(seen[b] / seen[a]) / math.log(b / a), STEEP[0]), STEEP[1])


def _part(below: float, above: float, limit: float) -> float:
    """How far between two runs the limit is expected on a logarithmic scale, away from both."""
    if not math.isfinite(above) or below <= 0:
        return 0.5
    return min(max(math.log(limit / below) / math.log(above / below), 0.1), 0.9)


def _rounded(v: float) -> float:
    """To four digits, so that the same speed is the same case."""
    return float(f"{v:.4g}")


@dataclass(frozen=True)
class SpeedLimit:
    """Speeds at which a car reaches limits on a course, seed by seed.

    Finds `speeds`: by metric, for each seed [km/h] (None: not reached, or always), and `why` in words; and
    `runs`: the rows of all runs that were made for it, by rising speed.
    """

    case: Case
    metrics: tuple[str, ...]
    seeds: int = 1
    guess: float = 20.0  # km/h
    cost: float = 1.0

    @property
    def label(self) -> str:
        """Which one it is."""
        limits = "2.5g" if self.metrics == ("seat_peak",) else "6W"
        return f"{limits}-{replace(self.case, speed_kmh=1.0).label}"

    def __call__(self, runner: Any) -> Row:
        """Search the speed [km/h] at the limit of each metric, for every seed."""
        runs: dict[tuple[int, float], Row] = {}
        speeds: dict[str, list[float | None]] = {m: [] for m in self.metrics}
        why: dict[str, list[str]] = {m: [] for m in self.metrics}
        guess, exponents = self.guess, dict.fromkeys(self.metrics, EXPONENT)
        for seed in range(1, self.seeds + 1):
            case = self.case if self.seeds == 1 else replace(self.case, seed=seed)
            for metric in self.metrics:

                def value(v: float, case: Case = case, seed: int = seed, metric: str = metric) -> float:
                    at = replace(case, speed_kmh=v)
                    if (seed, v) not in runs:
                        runs[seed, v] = {**values(at), **runner.metrics(at)}
                    row = runs[seed, v]
                    return float(row[metric]) if row["arrived"] else math.inf

                known = [v for of, v in runs if of == seed]
                found, reason = crossing(value, LIMITS[metric], guess, known=known, exponent=exponents[metric])
                speeds[metric].append(found)
                why[metric].append(reason)
                exponents[metric] = rise(
                    {v: value(v) for of, v in runs if of == seed}, LIMITS[metric], exponents[metric]
                )
            first = speeds[self.metrics[0]][-1]
            guess = first if first is not None else guess
        return {"speeds": speeds, "why": why, "runs": [runs[k] for k in sorted(runs)]}
