"""Worst stack of a function, from the frames and the calls that GCC writes (-fcallgraph-info=su)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter

from build_fmus.target.assemble import COMMENT, RENAMED, TargetError

_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]*)"')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_INDIRECT = "__indirect_call"


def worst_stack(
    graph: str,
    code: str,
    entries: Iterable[str],
    library: Mapping[str, tuple[int, set[str]]] | None,
    recursions: Mapping[str, int],
) -> int:
    """Bytes of stack that the deepest chain of calls below any of `entries` takes.

    A call through a pointer may reach any function whose address the code takes, unless that function is running
    already: a solver calls its fallback, which is another solver and has no fallback.

    Args:
        graph: the compiler's call graph.
        code: the C file.
        entries: functions that firmware calls.
        library: frames and calls of functions outside of the code; None where they count as 0.
        recursions: functions that may call themselves, and how often one inside the other.

    Raises:
        TargetError: a function without a known frame, or one that calls itself.
    """
    frames: dict[str, int] = {}
    for title, label in _NODE.findall(graph):
        name = _plain(title)
        if found := re.search(r"(\d+) bytes \((static|dynamic[^)]*)\)", label):
            if found[2] == "dynamic":
                raise TargetError(f"the stack of {name} depends on the data; no worst case is known")
            frames[name] = int(found[1])
    calls: dict[str, set[str]] = {}
    for source, to in _EDGE.findall(graph):
        calls.setdefault(_plain(source), set()).add(_plain(to))
    renamed = {new: old for old, new in RENAMED.findall(code)}
    named = set(re.findall(r"\b(\w+)\b(?!\s*\()", COMMENT.sub("", RENAMED.sub("", code))))
    pointed = frozenset(n for n in frames if renamed.get(b := n.partition(".")[0], b) in named)
    rings = [_Ring(n, depth, calls, frames) for n, depth in recursions.items() if n in frames]
    _refuse_recursion(calls)

    @cache
    def deepest(name: str, running: frozenset[str]) -> int:
        if name not in frames and library is not None and name not in library:
            raise TargetError(f"the stack of {name} is not known")
        frame, below = (
            (frames[name], calls.get(name, set())) if name in frames else (library or {}).get(name, (0, set()))
        )
        now = running | ({name} & pointed)
        reached = below - {_INDIRECT} | (pointed if _INDIRECT in below else set())
        return frame + max((below_call(name, b, now) for b in sorted(reached - now)), default=0)

    def below_call(name: str, callee: str, now: frozenset[str]) -> int:
        """Stack below a call; one into a ring of functions goes around it as often as it may, then on from anywhere."""
        ring = next((r for r in rings if callee in r.members and name not in r.members), None)
        return ring.turns + max(deepest(m, now) for m in sorted(ring.members)) if ring else deepest(callee, now)

    return max(deepest(n, frozenset()) for n in entries)


def _refuse_recursion(calls: Mapping[str, set[str]]) -> None:
    """Refuse functions that reach themselves by direct calls."""
    try:
        TopologicalSorter(calls).prepare()
    except CycleError as error:
        raise TargetError(f"{error.args[1][0]} calls itself; no worst stack is known") from None


class _Ring:
    """Functions that call each other in a cycle through `name`; the calls that close it are taken out.

    Attributes:
        turns: stack of all turns [bytes].
    """

    def __init__(self, name: str, depth: int, calls: dict[str, set[str]], frames: Mapping[str, int]) -> None:
        def reach(start: str) -> set[str]:
            found: set[str] = set()
            open_ = [start]
            while open_:
                new = calls.get(open_.pop(), set()) - found
                found |= new
                open_ += new
            return found

        self.members = {n for n in reach(name) if name in reach(n)}

        def longest(at: str, on: frozenset[str]) -> int:
            inside = calls.get(at, set()) & self.members - on
            return frames[at] + max((longest(n, on | {n}) for n in inside), default=0)

        self.turns = (depth + 1) * longest(name, frozenset((name,))) if self.members else 0
        for member in self.members:
            calls[member] = calls[member] - {name}


def _plain(title: str) -> str:
    """A name without the file of a static function."""
    return title.rpartition(":")[2]
