"""What reads outputs that the first event iteration of an FMU may have changed, in the order of direct dependency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter

from cosim.core.description import Variable
from cosim.system.components import Connection, SystemComponent
from cosim.system.loops import AlgebraicLoop, Depends, numeric
from cosim.system.schedule import Schedule

_Value = tuple[SystemComponent, str] | AlgebraicLoop


@dataclass(frozen=True)
class Follower:
    """A component or a loop, and those of the outputs that it directly depends on that may have changed."""

    what: SystemComponent | AlgebraicLoop
    reads: tuple[tuple[SystemComponent, Variable], ...]


def find_followers(schedule: Schedule, loops: Sequence[AlgebraicLoop], depends: Depends) -> list[Follower]:
    """Followers in the order of the schedule, each after those that it depends on; a component may occur again.

    Loops with Model Exchange FMUs are among them in any case. A connection with a delay passes nothing on, nor does one
    to a discrete component or to an input that belongs to a clock.
    """
    if not any(m.description.begins_with_events for m in schedule.components):
        return []
    solved = {(c.source, c.output.name): loop for loop in loops for c in loop.connections}
    place = {what: i for i, what in enumerate((*loops, *schedule.components))}
    reads: dict[_Value, list[Connection]] = {}
    for c in numeric(schedule.connections):
        if c.delay or c.input.clocks or c.target.discrete:
            continue
        for output in c.target.description.outputs:
            inputs = depends(c.target, output)
            if inputs is None or c.input.name in inputs:
                reads.setdefault(solved.get((c.target, output), (c.target, output)), []).append(c)

    def read(c: Connection) -> _Value:
        return solved.get((c.source, c.output.name), (c.source, c.output.name))

    order = TopologicalSorter({v: dict.fromkeys(u for c in into if (u := read(c)) != v) for v, into in reads.items()})
    order.prepare()
    moved: set[_Value] = set()
    found = []
    while order.is_active():
        ready = order.get_ready()
        level: dict[SystemComponent | AlgebraicLoop, dict[tuple[SystemComponent, Variable], None]] = {}
        for value in ready:
            into = reads.get(value, [])
            changed = [c for c in into if c.source.description.begins_with_events or read(c) in moved]
            what = value if isinstance(value, AlgebraicLoop) else value[0]
            if changed or (isinstance(what, AlgebraicLoop) and what.has_events):
                moved.add(value)
                level.setdefault(what, {}).update({(c.source, c.output): None for c in changed})
        found += [Follower(what, (*level[what],)) for what in sorted(level, key=place.__getitem__)]
        order.done(*ready)
    return found
