"""Which clocks are due at which tick, without computing it again at every instant."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

Entry = TypeVar("Entry")


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


class Timetable(Generic[Entry]):
    """Instants of a set of clocks.

    `compile_entry` makes an entry from the numbers of the clocks that are due; it is called once for every combination
    that occurs. From the largest offset on the pattern repeats: one period of it is kept as a table, unless it is
    longer than `LONGEST` instants.
    """

    LONGEST = 20_000
    BLOCK = 2_000

    def __init__(self, clocks: Sequence[Clock], compile_entry: Callable[[frozenset[int]], Entry]):
        self._clocks = tuple(clocks)
        self._compile = compile_entry
        self._steady = max(c.offset for c in clocks)
        self._period = math.lcm(*(c.period for c in clocks))
        self._count = sum(self._period // c.period for c in clocks)
        self.forget()

    def forget(self) -> None:
        """Compile all entries again."""
        self._entries: dict[frozenset[int], Entry] = {}
        self._by_mask: dict[int, Entry] = {}
        self._by_place: dict[int, Entry] = {}
        self._table: list[tuple[int, Entry]] | None = None

    def at(self, tick: int) -> Entry:
        """The entry of a tick, also of one at which nothing is due."""
        place = (tick - self._steady) % self._period
        if tick < self._steady or place not in self._by_place:
            entry = self._found(tick)
            if tick < self._steady or len(self._by_place) >= self.LONGEST:
                return entry
            self._by_place[place] = entry
        return self._by_place[place]

    def _found(self, tick: int) -> Entry:
        due = frozenset(i for i, c in enumerate(self._clocks) if c.due(tick))
        if due not in self._entries:
            self._entries[due] = self._compile(due)
        return self._entries[due]

    def cycle(self) -> tuple[int, int]:
        """(first tick, length in ticks) of the repeating pattern, beginning at a multiple of its length."""
        return -(-self._steady // self._period) * self._period, self._period

    def instants(self, first: int, end: int) -> Iterator[tuple[int, Entry]]:
        """(tick, entry) of every instant with first <= tick < end at which something is due."""
        if self._count > self.LONGEST:
            yield from self._search(first, end)
            return
        yield from self._search(first, min(end, self._steady))
        first = max(first, self._steady)
        if first >= end:
            return
        if self._table is None:
            begin = self._steady
            self._table = [(tick - begin, entry) for tick, entry in self._search(begin, begin + self._period)]
        cycle, place = divmod(first - self._steady, self._period)
        base = self._steady + cycle * self._period
        if place:
            for after, entry in self._table:
                if after >= place:
                    if base + after >= end:
                        return
                    yield base + after, entry
            base += self._period
        while base + self._period <= end:
            for after, entry in self._table:
                yield base + after, entry
            base += self._period
        for after, entry in self._table:
            if base + after >= end:
                return
            yield base + after, entry

    def _search(self, first: int, end: int) -> Iterator[tuple[int, Entry]]:
        """As `instants`, worked out afresh, some thousand instants at a time."""
        span = self.BLOCK * min(c.period for c in self._clocks)
        while first < end:
            stop = min(end, first + span)
            due = [np.arange(c.next(first), stop, c.period) for c in self._clocks]
            ticks = np.unique(np.concatenate(due))
            masks = np.zeros(len(ticks), dtype=np.int64 if len(due) < 63 else object)
            for i, own in enumerate(due):
                masks[np.searchsorted(ticks, own)] |= 1 << i
            for tick, mask in zip(ticks.tolist(), masks.tolist(), strict=True):
                yield tick, self._by_mask.get(mask) or self._entry(tick, mask)
            first = stop

    def _entry(self, tick: int, mask: int) -> Entry:
        self._by_mask[mask] = self.at(tick)
        return self._by_mask[mask]
