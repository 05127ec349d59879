"""The lines of one C function: their order, places for work arrays, and blocks for what stands under conditions."""

from __future__ import annotations

import heapq
import math
import textwrap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from build_fmus.equations.branches import Block, Branch, Guard, arranged, homes
from build_fmus.equations.locals import Statement, without_derivatives
from build_fmus.equations.names import WIDTH


@dataclass
class Line:
    """Lines of code, with the work arrays and named numbers that they write and read.

    `@` stands for the position of the array that they begin. `kind` is the type of a number whose line does not say
    it, because that depends on where the number is read. A smooth number can be a local one (`locals`).
    """

    lines: list[str]
    writes: str = ""
    begins: int = 0  # numbers of the work array that begins here
    reads: frozenset[str] = frozenset()
    kind: str = ""
    guard: Guard = ()
    smooth: bool = False
    depth: float = math.inf  # calls of functions on the longest way to it; results stand behind all of these lines


@dataclass
class Layout:
    """Arranges the lines of a function.

    Attributes:
        lines: of the function, each after what it reads.
        condition: the C expression of a branch.
        kept: names of numbers that are not local.
        local: whether numbers can be local.
        work: numbers of work arrays.
    """

    lines: list[Line]
    condition: Callable[[Branch], str]
    kept: frozenset[str]
    local: bool
    work: int = 0

    def placed(self) -> list[str]:
        """All lines, with a place in the work memory for every work array, from its first to its last use."""
        self._choose_locals(frozenset())
        last = {name: k for k, line in enumerate(self.lines) for name in (line.writes, *line.reads) if name}
        ends: list[tuple[int, int, int]] = []  # last use, place, size
        free: list[tuple[int, int]] = []  # place, size
        text: list[str] = []
        for k, line in enumerate(self.lines):
            while ends and ends[0][0] < k:
                _, place, size = heapq.heappop(ends)
                free.append((place, size))
            lines = self._declared(line)
            if line.begins:
                place = self._place(free, line.begins)
                heapq.heappush(ends, (last[line.writes], place, line.begins))
                lines = [x.replace("w + @", f"w + {place}") for x in lines]
            text += _wrapped(lines)
        return text

    @staticmethod
    def _declared(line: Line) -> list[str]:
        """The lines with the type of the number that they define."""
        return [*line.lines[:-1], f"const {line.kind} {line.lines[-1]}"] if line.kind else line.lines

    # ------------------------------------------------------------------ branches

    def in_branches(self) -> list[str]:
        """All lines, those under conditions in blocks.

        Calls of functions that do not wait for each other stand close together: a processor carries them out at the
        same time as far as it looks ahead. A number that is read outside of its block is declared before it.
        """
        depths: dict[str, float] = {}
        for line in self.lines:
            line.depth = max([line.depth, *(depths[r] for r in line.reads if r in depths)])
            depths[line.writes] = line.depth
        self.lines.sort(key=lambda line: line.depth)
        place = {line.writes: k for k, line in enumerate(self.lines) if line.writes}
        needs = [frozenset(place[r] for r in line.reads if r in place) for line in self.lines]
        items = arranged([line.guard for line in self.lines], needs)
        home = homes(items)
        outside: dict[int, int] = {}  # lines whose numbers are read outside of their block: how many blocks have both
        for k, of in enumerate(needs):
            for n in of:
                both = next((i for i, (a, b) in enumerate(zip(home[k], home[n], strict=False)) if a != b), len(home[k]))
                if both < len(home[n]):
                    outside[n] = min(both, outside.get(n, both))
        self._choose_locals(outside)
        return self._block(items, outside, 0)

    def _choose_locals(self, outside: Collection[int]) -> None:
        """Make numbers without derivatives `local`, except those that are read `outside` of their block."""
        if not self.local:
            return
        conditions = {line.writes for line in self.lines if line.kind == "condition"}
        statements = [
            Statement(
                line.writes,
                set(line.reads - conditions),
                len(line.guard),
                line.smooth and k not in outside and line.writes not in self.kept,
            )
            for k, line in enumerate(self.lines)
        ]
        left_out = without_derivatives(statements)
        for line in self.lines:
            if line.writes in left_out:
                line.kind = "local"

    def _block(self, items: Sequence[int | Block], outside: Mapping[int, int], depth: int) -> list[str]:
        text: list[str] = []
        for item in items:
            if not isinstance(item, Block):
                line = self.lines[item]
                text += _wrapped(line.lines if item in outside else self._declared(line), depth)
                continue
            before = [self.lines[k] for k in sorted(item.lines()) if outside.get(k) == depth]
            text += _wrapped([f"{line.kind} {line.writes} = {{0}};" for line in before], depth)
            inner = self._block(item.items, outside, depth + 1)
            text += [*_wrapped([f"if (any({self.condition(item.branch)})) {{"], depth), *inner, *_wrapped(["}"], depth)]
        return text

    def _place(self, free: list[tuple[int, int]], size: int) -> int:
        """The first gap that is large enough, or the end."""
        free.sort()
        merged: list[tuple[int, int]] = []
        for place, length in free:
            if merged and merged[-1][0] + merged[-1][1] == place:
                merged[-1] = (merged[-1][0], merged[-1][1] + length)
            else:
                merged.append((place, length))
        free[:] = merged
        for i, (place, length) in enumerate(free):
            if length >= size:
                free[i : i + 1] = [(place + size, length - size)] if length > size else []
                return place
        place = self.work
        self.work += size
        return place


_INDENT = " " * 4


def _wrapped(lines: Iterable[str], depth: int = 0) -> list[str]:
    indent = _INDENT * depth
    return [
        part
        for line in lines
        for part in textwrap.wrap(
            line,
            WIDTH,
            initial_indent=indent,
            subsequent_indent=indent + _INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        )
    ]
