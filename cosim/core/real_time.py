"""A run that keeps pace with the clock, and how well it did.

Due times are absolute: that of an instant is the beginning's plus simulated time over `factor`, so nothing adds up.
Before it the run sleeps, and spins through the last `SPIN` seconds, since a sleep ends late. Whatever comes too late is
caught up with: no instant is left out.
"""

from __future__ import annotations

import bisect
import time
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Protocol

EDGES = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 1e-1)  # s
SPIN = 2e-4  # s; about what sleeping ends late on a machine that is not busy
NAP = 0.02  # s; the longest sleep, after which an interrupt is looked for


@dataclass
class RealTime:
    """Real-time statistics of a run: of `instants`, `overruns` were due before the work before them was done.

    `lateness`: number of instants by lateness, counted between `EDGES` (the first up to 10 us, the last beyond 0.1 s);
    `worst` [s] is the latest. `factor`: simulated time over wall time.
    """

    factor: float
    instants: int = 0
    overruns: int = 0
    worst: float = 0.0
    lateness: list[int] = field(default_factory=lambda: [0] * (len(EDGES) + 1))

    def count(self, late: float, overrun: bool) -> None:
        """One more instant, begun `late` [s]."""
        self.instants += 1
        self.overruns += overrun
        self.worst = max(self.worst, late)
        self.lateness[bisect.bisect_left(EDGES, late)] += 1

    def copy(self) -> RealTime:
        """A copy that later instants do not change."""
        return RealTime(self.factor, self.instants, self.overruns, self.worst, list(self.lateness))

    def within(self, seconds: float) -> float:
        """Share of the instants that began at most `seconds` late, one of `EDGES`."""
        return sum(self.lateness[: EDGES.index(seconds) + 1]) / self.instants if self.instants else 1.0

    def __str__(self) -> str:
        lines = [
            f"{self.factor:g} times real time: {self.instants} instants, {self.overruns} overruns, the latest"
            f" {_short(self.worst)} late"
        ]
        bounds = ["up to 10 us", *(f"to {_short(e)}" for e in EDGES[1:]), f"over {_short(EDGES[-1])}"]
        lines += [f"  {bound:>12}: {n}" for bound, n in zip(bounds, self.lateness, strict=True) if n]
        return "\n".join(lines)


class Interrupt(Protocol):
    """What ends a wait."""

    pending: bool


class Pace:
    """Due times from now on, when the simulation stands at `tick`; a tick is `length` [s] of simulated time."""

    def __init__(self, factor: float, tick: int, length: Fraction):
        self.kept = RealTime(factor)
        self.tick = tick  # where the simulation was left
        self._first, self._length, self._begin = tick, float(length) / factor, time.perf_counter()

    def wait(self, tick: int, interrupt: Interrupt) -> bool:
        """Until a tick is due; returns at once if it was before. False: an interrupt came first."""
        due, clock = self._begin + (tick - self._first) * self._length, time.perf_counter
        overrun = clock() > due
        while not interrupt.pending and (left := due - clock()) > 0:
            if left > SPIN:
                time.sleep(min(left - SPIN, NAP))
        if interrupt.pending:
            return False
        self.kept.count(clock() - due, overrun)
        return True


def _short(seconds: float) -> str:
    scale, unit = (1e6, "us") if seconds < 1e-3 else (1e3, "ms") if seconds < 1 else (1.0, "s")
    return f"{seconds * scale:.3g} {unit}"
