"""Components whose clocks are connected: they take their steps together (`clocked_steps.h`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cosim.fmu.clocked_steps import ClockedValues, ClockWire
from cosim.system.components import SystemComponent
from cosim.system.schedule import Schedule


@dataclass(frozen=True)
class NetworkPlan:
    """Components in order, `ClockTick` of each connection of their clocks, and what they pass on at ticks."""

    components: list[SystemComponent]
    ticks: list[tuple[int, int, int, int]]
    wires: list[ClockWire]


def clock_networks(schedule: Schedule, values: Callable[[SystemComponent], ClockedValues]) -> list[NetworkPlan]:
    """The networks of a system; `values`: those of a component with clocks."""
    of: dict[SystemComponent, list[SystemComponent]] = {}
    for c in schedule.ticks:
        together = list(dict.fromkeys([*of.get(c.source, [c.source]), *of.get(c.target, [c.target])]))
        of.update(dict.fromkeys(together, together))
    found = []
    for together in {id(together): together for together in of.values()}.values():
        components = [m for m in schedule.components if m in together]
        number = {m: i for i, m in enumerate(components)}
        ticks, wires = [], []
        for c in schedule.ticks:
            if c.target in number:
                (origin,), (clock,) = (
                    values(m).index([v.reference]) for m, v in ((c.source, c.output), (c.target, c.input))
                )
                ticks.append((number[c.source], origin, number[c.target], clock))
        for c in schedule.connections:
            if c.source in number and c.target in number and c.input.clocks and not c.delay:
                source, target = values(c.source), values(c.target)
                places = source.place[c.output], target.place[c.input], target.width(c.input)
                numbers = (number[c.source], number[c.target], *places, c.scale, c.offset)
                wires.append(ClockWire(numbers, target.index(c.input.clocks), not c.output.clocks))
        found.append(NetworkPlan(components, ticks, wires))
    return found
