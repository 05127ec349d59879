"""Speeds at which a car reaches a limit: 6 W of absorbed power over a course, 2.5 g at the seat over a half-round.

A search walks from a guess by a fixed ratio until it has a run below the limit and one above it, and narrows that down: where
it expects the limit by a straight line on logarithmic scales, or in the middle when that has not halved the interval.
Runs are stored under their cases, so that searches that ask for the same one share it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from cosim.experiments.metrics.response import STANDARD_GRAVITY
from cosim.experiments.ride.runs import LIMIT_G, Case
from cosim.study.case import values
from cosim.study.experiment import Row
from fmu_sources.models.comfort import ABSORBED_POWER_LIMIT

WITHIN = (3.0, 120.0)  # km/h
TOLERANCE = 0.02  # of the speed, and of the limit where a run comes that close to it
COLD, WARM = 1.5, 1.08  # ratio of the first step from a guess, and from the speed of another seed
LIMITS = {
    "absorbed_power_nrmm": ABSORBED_POWER_LIMIT,
    "absorbed_power": ABSORBED_POWER_LIMIT,
    "seat_peak": LIMIT_G * STANDARD_GRAVITY,
}
"""Metric -> what it is limited to, in SI units."""


def crossing(value: Callable[[float], float], limit: float, guess: float, *, first: float = COLD) -> tuple[float | None, str]:
    """The speed [km/h] at which ``value`` rises to ``limit``, to :data:`TOLERANCE`, with "found"; or None with "never" (at no speed
    of :data:`WITHIN`) or "always" (at the lowest already).

    Args:
        value: of a speed, above 0; infinite where a run failed.
        guess: where it is looked for first.
        first: ratio of the first step from there.

    Raises:
        ValueError: ``value`` is not a number somewhere.
    """
    known: dict[float, float] = {}

    def at(v: float) -> float:
        known[v] = value(v)
        if math.isnan(known[v]):
            raise ValueError(f"what is limited is not a number at {v:g} km/h")
        return known[v]

    low, high = WITHIN
    v, step = _rounded(min(max(guess, low), high)), first
    upwards = at(v) < limit
    while (known[v] < limit) == upwards:
        if v == (high if upwards else low):
            return None, "never" if upwards else "always"
        last, v = v, _rounded(min(v * step, high) if upwards else max(v / step, low))
        at(v)
        step = COLD
    below, above = (last, v) if upwards else (v, last)
    halving = False
    while above / below > 1 + TOLERANCE:
        wide = math.log(above / below)
        middle = _rounded(below * math.exp(wide * (0.5 if halving else _part(known[below], known[above], limit))))
        if not below < middle < above:  # closer than four digits tell
            break
        if abs(at(middle) / limit - 1) <= TOLERANCE:
            return middle, "found"
        below, above = (middle, above) if known[middle] < limit else (below, middle)
        halving = math.log(above / below) > wide / 2
    return _rounded(math.sqrt(below * above)), "found"


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

    Finds ``speeds``: by metric, for each seed [km/h] (None: not reached, or always), and ``why`` in words; and ``runs``: the rows of
    all runs that were made for it, by rising speed.
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
        runs: dict[tuple[int, float], Row] = {}
        speeds: dict[str, list[float | None]] = {m: [] for m in self.metrics}
        why: dict[str, list[str]] = {m: [] for m in self.metrics}
        guess, first = self.guess, COLD
        for seed in range(1, self.seeds + 1):
            case = self.case if self.seeds == 1 else replace(self.case, seed=seed)
            for metric in self.metrics:

                def value(v: float, case: Case = case, seed: int = seed, metric: str = metric) -> float:
                    at = replace(case, speed_kmh=v)
                    if (seed, v) not in runs:
                        runs[seed, v] = {**values(at), **runner.metrics(at)}
                    row = runs[seed, v]
                    return float(row[metric]) if row["arrived"] else math.inf

                found, reason = crossing(value, LIMITS[metric], guess, first=first)
                speeds[metric].append(found)
                why[metric].append(reason)
                if found is not None:
                    guess, first = found, WARM
        return {"speeds": speeds, "why": why, "runs": [runs[k] for k in sorted(runs)]}
