"""The weight at which a controller's response equals another's: what makes the controllers of paper 000 comparable."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from cosim.experiments.gpc.runs import R_PUBLISHED


@dataclass(frozen=True)
class Match:
    """Outcome of `match_weight`: the weight and its metrics, or `found` false and the nearest one tried."""

    found: bool
    R: float
    metrics: dict[str, Any]
    runs: int


GRID_STEP = 0.25  # decades of R
GRID_RANGE = (-8, 8)  # steps about the published R: 1e-9 .. 1e-5
MATCH_TOLERANCE = 5e-3  # relative, on the response objective


def match_weight(measure: Callable[[float], dict[str, Any]], target: float) -> Match:
    """The control weight at which a controller's response objective equals `target`.

    J(R) is not monotone, so a grid of weights is walked outward from the published one until two neighbors bracket
    the target; the crossing nearest to 1e-7 is then refined in log R. Of two at the same distance the one is taken that
    lies where a J that rises with R has it.
    """
    tried: dict[float, dict[str, Any]] = {}

    def error(R: float) -> float:
        if R not in tried:
            tried[R] = measure(R)
        m = tried[R]
        return math.inf if m["diverged"] else m["response"] / target - 1.0

    for a, b in _outward(up_first=error(R_PUBLISHED) <= 0 or math.isinf(error(R_PUBLISHED))):
        low, high = R_PUBLISHED * 10 ** (GRID_STEP * a), R_PUBLISHED * 10 ** (GRID_STEP * b)
        e_low, e_high = error(low), error(high)
        for R, e in ((low, e_low), (high, e_high)):
            if abs(e) <= MATCH_TOLERANCE:
                return Match(True, R, tried[R], len(tried))
        if not (math.isfinite(e_low) and math.isfinite(e_high)) or e_low * e_high > 0:
            continue
        for _ in range(12):
            # Regula falsi in log R, kept inside the bracket; J is smooth there.
            w = min(max(e_low / (e_low - e_high), 0.1), 0.9)
            R = low ** (1 - w) * high**w
            e = error(R)
            if abs(e) <= MATCH_TOLERANCE:
                return Match(True, R, tried[R], len(tried))
            if e * e_low > 0:
                low, e_low = R, e
            else:
                high, e_high = R, e
        break
    nearest = min(tried, key=lambda R: abs(error(R)))
    return Match(False, nearest, tried[nearest], len(tried))


def _outward(*, up_first: bool) -> Iterator[tuple[int, int]]:
    """Intervals of the grid, those nearest to the published weight first."""
    down, up = GRID_RANGE
    for k in range(max(up, -down)):
        sides = [(k, k + 1)] * (k < up), [(-k, -k - 1)] * (-k > down)
        for side in sides if up_first else reversed(sides):
            yield from side
