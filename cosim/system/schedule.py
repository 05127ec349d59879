"""The order in which a system runs, worked out once and readable as text."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

from cosim.core.dependencies import Dependencies
from cosim.core.description import RECORDABLE
from cosim.core.errors import LoopError, WiringError
from cosim.core.time import TimeBase, gcd, seconds_text
from cosim.system.components import Connection, Group, SystemComponent
from cosim.system.loops import AlgebraicLoop, certain, certain_initially, declared, find_loops, require_solvable


@dataclass(frozen=True)
class Schedule:
    """The order of execution.

    `discrete` components in their order; `groups` of continuous components, each in declared order, a component without
    a group alone; `lagging` are connections between discrete components that deliver the value of the sample before,
    possible only into inputs without direct feedthrough.
    """

    tick: Fraction
    discrete: tuple[SystemComponent, ...]
    groups: tuple[Group, ...]
    lagging: tuple[Connection, ...]
    connections: tuple[Connection, ...]
    unconnected: tuple[str, ...]
    loops: tuple[AlgebraicLoop, ...] = ()  # in the order in which they are solved
    possible_loops: tuple[AlgebraicLoop, ...] = ()  # where dependencies are not declared
    initial_loops: tuple[AlgebraicLoop, ...] = ()  # further ones that are solved in initialization only
    late_loops: tuple[AlgebraicLoop, ...] = ()  # `sampled_loops`, of a system that is exported
    # direct dependencies that are not declared
    measured: Mapping[SystemComponent, Dependencies] = field(default_factory=dict, hash=False)
    ticks: tuple[Connection, ...] = ()  # connections of clocks
    parameters: tuple[Connection, ...] = ()  # of calculated parameters to parameters

    @property
    def continuous(self) -> tuple[SystemComponent, ...]:
        """Continuous components in the order of their groups."""
        return tuple(m for group in self.groups for m in group.components)

    @property
    def value_connections(self) -> tuple[Connection, ...]:
        """Connections to inputs and to parameters, without those of clocks."""
        return self.connections + self.parameters

    @property
    def components(self) -> tuple[SystemComponent, ...]:
        """All components in the order of execution, the discrete ones first."""
        return self.discrete + self.continuous

    def time_base(self, start: Fraction) -> TimeBase:
        """The base of the tick, with time [s] counted from `start`."""
        return TimeBase(self.tick, start)

    def __str__(self) -> str:
        lines = [f"base tick {seconds_text(self.tick)}", "", "At every instant, the components that are due:"]
        if self.discrete:
            lines.append("1. discrete, one after the other, each used at once:")
            lines += [f"     {_rate(m)}" for m in self.discrete]
        if self.continuous:
            lines.append(f"{2 if self.discrete else 1}. continuous, from t to t + step with inputs as of t:")
            single = [m for g in self.groups if g.method == "jacobi" for m in g.components]
            if single:
                lines.append("   Jacobi, side by side:")
                lines += [f"     {_rate(m)}" for m in single]
            for group in self.groups:
                if group.method == "gauss-seidel":
                    lines.append(
                        f"   Gauss-Seidel '{group.name}', in this order, each sees those before it at t + step:"
                    )
                    lines += [f"     {_rate(m)}" for m in group.components]
        lines += ["", f"{len(self.connections)} connections:", *(f"     {c}" for c in self.connections)]
        if self.ticks:
            lines += ["", "Clocks that tick together, whose components take their steps together:"]
            lines += [f"     {c}" for c in self.ticks]
        if self.parameters:
            lines += ["", "Parameters that are calculated by other components, in initialization:"]
            lines += [f"     {c}" for c in self.parameters]
        if self.lagging:
            lines += ["", "Inputs without direct feed-through that see the sample before:"]
            lines += [f"     {c}" for c in self.lagging]
        for loop in self.loops:
            unknowns = ", ".join(f"{m.name}.{v.name}" for m, v in loop.unknowns)
            lines += ["", f"Algebraic loop, solved for {unknowns} at each exchange:", str(loop)]
        for loop in self.initial_loops:
            unknowns = ", ".join(f"{m.name}.{v.name}" for m, v in loop.unknowns)
            lines += ["", f"Algebraic loop, solved for {unknowns} in initialization only:", str(loop)]
        if self.possible_loops:
            lines += [
                "",
                "Possible algebraic loops (not all of their direct dependencies are declared); initialization measures"
                " which there are and solves those:",
            ]
            lines += map(str, self.possible_loops)
        if self.unconnected:
            lines += ["", "Unconnected inputs, at their start values:", *(f"     {name}" for name in self.unconnected)]
        return "\n".join(lines)


def _rate(component: SystemComponent) -> str:
    offset = f" from {seconds_text(component.offset)}" if component.offset else ""
    apart = ", in a process of its own" if getattr(component.implementation, "isolation", None) else ""
    return f"{component.name} ({component.description.name}) every {seconds_text(component.step)}{offset}{apart}"


def make_schedule(
    components: Iterable[SystemComponent],
    connections: Iterable[Connection] = (),
    groups: Iterable[Group] = (),
    extra: Iterable[Fraction] = (),
) -> Schedule:
    """Schedule of components, of the connections between them and the groups among them.

    `extra` are further periods [s] that the base tick must divide. Ties are settled by name, never by the order in
    which components were added. Raises WiringError when there are no components, and LoopError for a loop among
    discrete ones, or one among continuous ones (`cosim.system.loops`) that cannot be solved.
    """
    components = sorted(components, key=lambda m: m.name)
    if not components:
        raise WiringError("the system has no components")
    every = sorted(connections, key=lambda c: c.target_name)
    parameters = tuple(c for c in every if c.sets_parameter)
    connections, ticks = (
        tuple(c for c in every if c.is_clock is clocks and not c.sets_parameter) for clocks in (False, True)
    )
    _check_ticks(ticks, groups)
    discrete, lagging = _order([m for m in components if m.discrete], connections)
    loops = find_loops(connections, certain)
    for loop in loops:
        require_solvable(loop)
    return Schedule(
        tick=gcd([*(m.step for m in components), *(m.offset for m in components), *extra]),
        discrete=tuple(discrete),
        groups=tuple(_groups(groups, [m for m in components if not m.discrete])),
        lagging=tuple(lagging),
        connections=connections,
        unconnected=tuple(sorted(unconnected(components, {c.target_name for c in every}))),
        loops=tuple(loops),
        initial_loops=tuple(
            loop
            for loop in find_loops(connections, certain_initially)
            if loop not in loops and all(v.type == "real" for _, v in loop.unknowns)
        ),
        possible_loops=tuple(loop for loop in find_loops(connections, declared) if loop not in loops),
        ticks=ticks,
        parameters=parameters,
    )


def _check_ticks(ticks: Sequence[Connection], groups: Iterable[Group]) -> None:
    """Raise WiringError for components with connected clocks that cannot take their steps together."""
    grouped = {m: g.name for g in groups for m in g.components}
    for c in ticks:
        pair, names = (c.source, c.target), f"{c.source_name} -> {c.target_name}"
        for m in pair:
            if m.discrete:
                raise WiringError(f"{names}: '{m.name}' is discrete, and clocks connect continuous components")
            if m in grouped:
                raise WiringError(f"{names}: '{m.name}' is in the group '{grouped[m]}': leave it out of the group")
        if (c.source.step, c.source.offset) != (c.target.step, c.target.offset):
            steps = " and ".join(f"'{m.name}' every {seconds_text(m.step)}" for m in pair)
            raise WiringError(f"{names}: components with connected clocks need one step and offset: {steps}")


def only_numbers(schedule: Schedule, what: str, remedy: str) -> Schedule:
    """The schedule for those who exchange doubles: 64-bit integers are rounded.

    Raises WiringError for a text, which `what` does not exchange, with a `remedy`.
    """
    text = next((c for c in (*schedule.connections, *schedule.ticks) if c.output.type not in RECORDABLE), None)
    if text is not None:
        kind = text.output.fmi_type
        raise WiringError(
            f"{text.source_name} -> {text.target_name} is a {kind}, which {what} does not exchange: {remedy}"
        )
    return replace(schedule, connections=tuple(replace(c, size=0) if c.size else c for c in schedule.connections))


def unconnected(components: Iterable[SystemComponent], targets: Container[str]) -> list[str]:
    """Inputs that are not among the `targets` of connections, were given no start value and are not optional."""
    return [
        f"{m.name}.{i}"
        for m in components
        for i in (*m.description.inputs, *m.description.triggered)
        if f"{m.name}.{i}" not in targets and i not in m.values and not _optional(m, i)
    ]


def _optional(component: SystemComponent, name: str) -> bool:
    variable = component.description.inputs.get(name)
    return variable is not None and variable.optional


def _groups(declared: Iterable[Group], continuous: list[SystemComponent]) -> Iterable[Group]:
    ordered = sorted(declared, key=lambda g: g.name)
    grouped = {m for g in ordered for m in g.components}
    yield from (Group("", (m,)) for m in continuous if m not in grouped)
    yield from ordered


def _order(
    discrete: list[SystemComponent], connections: Sequence[Connection]
) -> tuple[list[SystemComponent], list[Connection]]:
    """Topological order of the discrete components, and the connections that had to be left behind.

    A connection is firm when its input feeds through to some output of the target: the source must run first. Others
    are followed where possible, and left behind (the input sees the sample before) only to break a loop.
    """
    undelayed = [c for c in connections if not c.delay and c.source.discrete and c.target.discrete]
    firm = [c for c in undelayed if _feeds_through(c)]
    waiting, order = list(discrete), []
    while waiting:
        ready = _without_source(waiting, undelayed) or _without_source(waiting, firm)
        if not ready:
            raise LoopError(_loop(waiting, firm))
        order.append(ready)
        waiting.remove(ready)
    place = {m: i for i, m in enumerate(order)}
    return order, [c for c in undelayed if place[c.source] >= place[c.target]]


def _feeds_through(connection: Connection) -> bool:
    about = connection.target.description
    return any(about.feeds(connection.input.name, output) for output in about.outputs)


def _without_source(waiting: list[SystemComponent], connections: Sequence[Connection]) -> SystemComponent | None:
    blocked = {c.target for c in connections if c.source in waiting}
    return next((m for m in waiting if m not in blocked), None)


def _loop(waiting: list[SystemComponent], firm: Sequence[Connection]) -> str:
    """Name one loop, variable by variable, starting at its first component by name."""
    into = {m: next(c for c in firm if c.target is m and c.source in waiting) for m in waiting}
    component, seen = waiting[0], []
    while component not in seen:
        seen.append(component)
        component = into[component].source
    loop = [into[m] for m in seen[seen.index(component) :]][::-1]
    first = min(range(len(loop)), key=lambda i: loop[i].source.name)
    loop = loop[first:] + loop[:first]
    path = "\n".join(f"    {c.source_name} -> {c.target_name}" for c in loop)
    return (
        f"the discrete components {', '.join(repr(c.source.name) for c in loop)} depend on each other at the same"
        f" instant:\n{path}\nGive one of these connections delay=True (one step of delay) to define the order."
    )
