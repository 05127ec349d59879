"""Algebraic loops among continuous components: values that depend on themselves at the same instant.

Continuous components advance with inputs as of the beginning of their steps, so around a loop of outputs that depend
directly on inputs each value is computed from one that is a step old: one pass of an iteration per step, not the
solution of the loop's equations. A connection with a delay breaks a loop, and so does a discrete component: it reads
its inputs at its own instants, by the exchange rule.

The edges of a loop are connections, and direct dependencies of outputs on inputs within a component. Where a component
does not declare those, the loop is only possible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from cosim.core.errors import LoopError
from cosim.system.components import Connection, SystemComponent

Loop = tuple[Connection, ...]
Depends = Callable[
    [SystemComponent, str], "frozenset[str] | None"
]  # the inputs that an output depends on directly; None: on all of them
_Output = tuple[
    SystemComponent, "frozenset[str] | None"
]  # outputs of a component that depend on the same inputs are one node


def declared(component: SystemComponent, output: str) -> frozenset[str] | None:
    """The inputs that an output depends on directly as far as the component declares them; None: it does not."""
    return component.description.dependencies.get(output)


def certain(component: SystemComponent, output: str) -> frozenset[str]:
    """As `declared`, without inputs of which nothing is declared."""
    return declared(component, output) or frozenset()


def find_loops(connections: Iterable[Connection], depends: Depends) -> list[Loop]:
    """Loops among continuous components, each as a sequence of connections.

    There is at least one of every set of loops that have a component in common, and none that shares an output with
    another one in the list.
    """
    into: dict[SystemComponent, list[Connection]] = {}
    for c in connections:
        if not (c.delay or c.source.discrete or c.target.discrete):
            into.setdefault(c.target, []).append(c)

    def node(c: Connection) -> _Output:
        return c.source, depends(c.source, c.output.name)

    def before(output: _Output) -> Iterator[Connection]:
        component, inputs = output
        return (c for c in into.get(component, ()) if inputs is None or c.input.name in inputs)

    found: list[Loop] = []
    done: set[_Output] = set()
    named: set[_Output] = set()
    for first in dict.fromkeys(node(c) for incoming in into.values() for c in incoming):
        if first in done:
            continue
        place = {first: 0}  # of the nodes on the present path, which leads from outputs back to what they depend on
        path: list[Connection] = []  # between these nodes
        ahead = [before(first)]  # of each node: the connections that are not followed yet
        while ahead:
            try:
                c = next(ahead[-1])
            except StopIteration:
                done.add(place.popitem()[0])
                ahead.pop()
                del path[-1:]
                continue
            source = node(c)
            if source in place:
                loop = [*path[place[source] :], c][::-1]
                if named.isdisjoint(nodes := {node(x) for x in loop}):
                    named |= nodes
                    found.append(_from_first(loop))
            elif source not in done:
                place[source] = len(place)
                path.append(c)
                ahead.append(before(source))
    return sorted(found, key=lambda loop: [c.source_name for c in loop])


def refuse_loops(loops: Iterable[Loop], why: str = "") -> None:
    """Raise LoopError naming the first of these loops."""
    for loop in loops:
        raise LoopError(
            f"the continuous components {', '.join(repr(n) for n in components(loop))} form an algebraic loop, which"
            " the master does not solve: each of these values depends directly on the one before"
            f" it{why}\n{path_of(loop)}\nGive one of these connections delay=True (one step of delay) to break the"
            " loop."
        )


def components(loop: Loop) -> list[str]:
    """Names of the components of a loop, each once."""
    return list(dict.fromkeys(c.source.name for c in loop))


def path_of(loop: Loop) -> str:
    """A loop in words, one connection per line."""
    return "\n".join(f"    {c.source_name} -> {c.target_name}" for c in loop)


def _from_first(loop: list[Connection]) -> Loop:
    """The same loop from its first component by name on."""
    first = min(range(len(loop)), key=lambda i: loop[i].source_name)
    return tuple(loop[first:] + loop[:first])
