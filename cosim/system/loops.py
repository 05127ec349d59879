"""Algebraic loops among continuous components: values that depend on themselves at the same instant.

The edges of a loop are connections, and direct dependencies of outputs on inputs within a component. A connection with
a delay breaks a loop, and so does a discrete component: it reads its inputs at its own instants, by the exchange rule.
So does an input that belongs to a clock: it is read when the clock ticks.

Values that depend on each other are the strong components of this graph, and each of them is one loop, which the engine
solves (`algebraic_loop.c`). Where a component does not declare its dependencies, a loop is only possible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

import numpy as np

from cosim.core.description import RECORDABLE, Variable
from cosim.core.errors import LoopError
from cosim.core.time import seconds_text
from cosim.system.components import Connection, SystemComponent

Depends = Callable[
    [SystemComponent, str], "frozenset[str] | None"
]  # the inputs that an output depends on directly; None: on all of them
_Output = tuple[
    SystemComponent, "frozenset[str] | None"
]  # outputs of a component that depend on the same inputs are one node


@dataclass(frozen=True)
class AlgebraicLoop:
    """Components whose outputs depend directly on each other, in the order in which they pass on values."""

    components: tuple[SystemComponent, ...]
    connections: tuple[Connection, ...]

    @property
    def unknowns(self) -> tuple[tuple[SystemComponent, Variable], ...]:
        """Outputs at which the loop is cut: those that their own component reads, or one ahead of it."""
        return tuple(dict.fromkeys((c.source, c.output) for c in self._cut))

    @property
    def first_guess(self) -> list[float]:
        """The unknowns before the first solution, by start values of inputs that they drive: given ones come first."""
        found: dict[tuple[SystemComponent, Variable], float] = {}
        for c in sorted(self._cut, key=lambda c: not _has_given_start(c)):
            start = c.target.start(c.input.name)
            found.setdefault((c.source, c.output), 0.0 if start is None else (float(start) - c.offset) / c.scale)
        return [found[unknown] for unknown in self.unknowns]

    @property
    def _cut(self) -> list[Connection]:
        place = {m: i for i, m in enumerate(self.components)}
        return [c for c in self.connections if place[c.source] >= place[c.target]]

    @property
    def has_events(self) -> bool:
        """Whether discrete states of its components may change with its values: of third-party Model Exchange FMUs."""
        return any(m.description.interface == "me" and m.description.kind is None for m in self.components)

    @property
    def names(self) -> str:
        """Its components, for messages."""
        return ", ".join(repr(m.name) for m in self.components)

    def __str__(self) -> str:
        return "\n".join(f"    {c.source_name} -> {c.target_name}" for c in self.connections)


def declared(component: SystemComponent, output: str) -> frozenset[str] | None:
    """The inputs that an output depends on directly as far as the component declares them; None: it does not."""
    return component.description.dependencies.get(output)


def certain(component: SystemComponent, output: str) -> frozenset[str]:
    """As `declared`, without inputs of which nothing is declared."""
    return declared(component, output) or frozenset()


def certain_initially(component: SystemComponent, output: str) -> frozenset[str]:
    """As `certain`, in initialization: state variables too may depend on inputs there."""
    found = component.description.initial_dependencies.get(output)
    return certain(component, output) if found is None else found


def _has_given_start(connection: Connection) -> bool:
    """Whether the user has set the start value of its input."""
    return connection.input.name in connection.target.values


def sampled_loops(connections: Iterable[Connection]) -> tuple[AlgebraicLoop, ...]:
    """All loops among initial values, if discrete components are in some: where passing on values does not settle."""

    def initially(component: SystemComponent, output: str) -> frozenset[str] | None:
        return component.description.initial_dependencies.get(output, declared(component, output))

    loops = tuple(find_loops(connections, initially, sampled=True))
    numbers = all(v.type == "real" for loop in loops for _, v in loop.unknowns)
    return loops if numbers and any(m.discrete for loop in loops for m in loop.components) else ()


def numeric(connections: Iterable[Connection]) -> list[Connection]:
    """Connections of numbers: no equation is solved for texts, which take a step on each connection."""
    return [c for c in connections if c.output.type in RECORDABLE]


def find_loops(connections: Iterable[Connection], depends: Depends, *, sampled: bool = False) -> list[AlgebraicLoop]:
    """Loops among continuous components, each after those whose values it needs; `sampled`: among all components.

    No two of them share an output.
    """
    undelayed = sorted(
        (
            c
            for c in numeric(connections)
            if not (c.delay or c.input.clocks) and (sampled or not (c.source.discrete or c.target.discrete))
        ),
        key=lambda c: (c.source_name, c.target_name),
    )
    numbers: dict[_Output, int] = {}
    source = {c: numbers.setdefault((c.source, depends(c.source, c.output.name)), len(numbers)) for c in undelayed}
    edges = [
        (source[c], number, c)
        for (component, inputs), number in numbers.items()
        for c in undelayed
        if c.target is component and (inputs is None or c.input.name in inputs)
    ]
    if not _has_cycle((begin, end) for begin, end, _ in edges):
        return []
    from scipy.sparse import coo_array  # slow to import, and hardly any system has a loop
    from scipy.sparse.csgraph import connected_components

    rows, columns, _ = zip(*edges, strict=True)
    graph = coo_array((np.ones(len(edges)), (rows, columns)), shape=(len(numbers), len(numbers)))
    _, label = connected_components(graph.tocsr(), directed=True, connection="strong")
    before = TopologicalSorter({int(k): () for k in label})
    within: dict[int, dict[Connection, None]] = {}
    for begin, end, c in edges:
        if label[begin] == label[end]:
            within.setdefault(int(label[begin]), {})[c] = None
        else:
            before.add(int(label[end]), int(label[begin]))
    return [_ordered(tuple(within[k])) for k in before.static_order() if k in within]


def _has_cycle(edges: Iterable[tuple[int, int]]) -> bool:
    graph: TopologicalSorter[int] = TopologicalSorter()
    for begin, end in edges:
        graph.add(end, begin)
    try:
        graph.prepare()
    except CycleError:
        return True
    return False


def _ordered(connections: tuple[Connection, ...]) -> AlgebraicLoop:
    """A loop with its components in an order that cuts few outputs: next is what reads the fewest of those waiting.

    Components with given start values are ahead, so that the loop is cut where the user has chosen its first guess.
    """
    waiting = sorted({c.source for c in connections}, key=lambda m: m.name)
    order: list[SystemComponent] = []
    while waiting:
        needs: dict[SystemComponent, tuple[int, bool, int]] = {}
        for m in waiting:
            reads = [c for c in connections if c.target is m and c.source in waiting and c.source is not m]
            cut = {(c.output.type != "real", c.source_name) for c in reads}
            needs[m] = sum(other for other, _ in cut), not any(map(_has_given_start, reads)), len(cut)
        order.append(min(waiting, key=needs.__getitem__))
        waiting.remove(order[-1])
    place = {m: i for i, m in enumerate(order)}
    return AlgebraicLoop(tuple(order), tuple(sorted(connections, key=lambda c: place[c.source])))


def require_solvable(loop: AlgebraicLoop) -> None:
    """Raise LoopError for a loop that the engine cannot solve: give a connection a delay."""
    rates = {(m.step, m.offset): m for m in loop.components}
    bent = next((c for c in loop.connections if c.extrapolate), None)
    other = next((f"{m.name}.{v.name}" for m, v in loop.unknowns if v.type != "real"), None)
    if len(rates) > 1:
        steps = ", ".join(f"'{m.name}' every {seconds_text(m.step)}" for m in rates.values())
        why = f"its components have different steps or offsets ({steps}); give them one"
    elif bent is not None:
        why = f"{bent.source_name} -> {bent.target_name} is extrapolated; leave that out"
    elif other is not None:
        why = f"{other} is not a real number"
    else:
        return
    raise LoopError(
        f"the continuous components {loop.names} form an algebraic loop, which cannot be solved: {why}\n{loop}\nOr give"
        " one of these connections delay=True (one step of delay) to break the loop."
    )
