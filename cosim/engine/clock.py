"""When something that repeats is due, in ticks."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass


@dataclass(frozen=True)
class Clock:
    """Due at `offset`, `offset + period`, ... (ticks)."""

    period: int
    offset: int = 0

    def due(self, tick: int) -> bool:
        """Whether the clock ticks at a tick."""
        return tick >= self.offset and (tick - self.offset) % self.period == 0

    def next(self, tick: int) -> int:
        """First due tick at or after `tick`."""
        return max(self.offset, tick + (self.offset - tick) % self.period)


def cycle(clocks: Collection[Clock]) -> tuple[int, int]:
    """(first tick, length in ticks) of the repeating pattern of clocks, beginning at a multiple of its length."""
    period = math.lcm(*(c.period for c in clocks))
    return -(-max(c.offset for c in clocks) // period) * period, period
