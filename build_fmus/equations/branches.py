"""What only one value of a choice needs, under an `if` where that is worth a branch of the processor.

A choice takes one of two values, and a declaration computes both. An operation that only one of them needs, directly or
by way of others, need not be carried out where the other one is taken; the results are the same. So a contact that is
not there costs its distance, and not its friction. Lines with the same condition are brought together as far as their
order allows.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from build_fmus.base import extras
from build_fmus.equations.graph import Graph
from build_fmus.equations.operators import IF_ELSE

with extras.needed("build", extras.BUILDING):
    import casadi as ca

Branch = tuple[int, bool]  # node of a condition, and whether it holds
Guard = tuple[Branch, ...]  # what must hold where an operation is carried out, the outer condition first

WORTH = 6.0  # additions; a block that costs less than this is no faster when it is left out
_COSTS = {
    ca.OP_DIV: 4.0,
    ca.OP_INV: 4.0,
    ca.OP_SQRT: 5.0,
    ca.OP_FMIN: 2.0,
    ca.OP_FMAX: 2.0,
    ca.OP_FLOOR: 4.0,
    ca.OP_CEIL: 4.0,
}
_FUNCTION = 25.0  # a function of the mathematical library
_CHEAP = frozenset(
    (
        ca.OP_ADD,
        ca.OP_SUB,
        ca.OP_MUL,
        ca.OP_NEG,
        ca.OP_TWICE,
        ca.OP_SQ,
        ca.OP_LT,
        ca.OP_LE,
        ca.OP_EQ,
        ca.OP_NE,
        ca.OP_NOT,
        ca.OP_AND,
        ca.OP_OR,
        ca.OP_IF_ELSE_ZERO,
        IF_ELSE,
        ca.OP_FABS,
        ca.OP_SIGN,
        ca.OP_COPYSIGN,
        ca.OP_ASSIGN,
    )
)


def guards(graph: Graph, roots: Iterable[int], needed: Iterable[int]) -> dict[int, Guard]:
    """The conditions of each operation that stands under some, of those `needed` for `roots`.

    Empty where an operation works on vectors.
    """
    found: dict[int, frozenset[Branch]] = dict.fromkeys(roots, frozenset())
    order = sorted(needed, reverse=True)  # operands have smaller numbers than what uses them
    if any(graph.nodes[n].arguments and graph.nodes[n].size != 1 for n in order):
        return {}
    for n in order:
        for a, guard in _uses(graph, n, found[n]):
            found[a] = found[a] & guard if a in found else guard
    # A condition that itself stands under others is known inside of these only.
    ordered = {g: tuple(sorted(g, key=lambda b: (len(found[b[0]]), b))) for g in set(found.values())}
    total: dict[Guard, float] = defaultdict(float)
    operations = [n for n in order if graph.nodes[n].arguments]
    for n in operations:
        for k in range(len(ordered[found[n]])):
            total[ordered[found[n]][: k + 1]] += _cost(graph.nodes[n].operation)
    worth = {n: _worth(ordered[found[n]], total) for n in operations}
    return {n: guard for n, guard in worth.items() if guard}


def _uses(graph: Graph, n: int, guard: frozenset[Branch]) -> Iterator[tuple[int, frozenset[Branch]]]:
    """Operands of a node under a guard, with what must hold where each is needed."""
    node = graph.nodes[n]
    if node.operation not in (IF_ELSE, ca.OP_IF_ELSE_ZERO):
        yield from ((a, guard) for a in node.arguments)
        return
    condition, *values = node.arguments
    yield condition, guard
    holds = True
    if graph.nodes[condition].operation == ca.OP_NOT:
        (condition,), holds = graph.nodes[condition].arguments, False
    for value, branch in zip(values, ((condition, holds), (condition, not holds)), strict=False):
        yield value, guard | {branch}


def calls(graph: Graph, needed: Iterable[int]) -> tuple[dict[int, int], set[int]]:
    """For each node the calls of functions on the longest way to it, and the calls that others wait for."""
    order = sorted(needed)
    calling = {n for n in order if graph.nodes[n].arguments and _cost(graph.nodes[n].operation) == _FUNCTION}
    depths: dict[int, int] = {}
    for n in order:
        depths[n] = max((depths.get(a, 0) for a in graph.nodes[n].arguments), default=0) + (n in calling)
    awaited: set[int] = set()
    for n in reversed(order):
        if n in calling or n in awaited:
            awaited.update(graph.nodes[n].arguments)
    return depths, calling & awaited


def _cost(operation: int) -> float:
    return 1.0 if operation in _CHEAP else _COSTS.get(operation, _FUNCTION)


def _worth(guard: Guard, total: Mapping[Guard, float]) -> Guard:
    n = next((k for k in range(len(guard)) if total[guard[: k + 1]] < WORTH), len(guard))
    return guard[:n]


# ---------------------------------------------------------------------------------------------------- order of lines


@dataclass
class Block:
    """Lines and blocks under one more condition."""

    branch: Branch
    items: list[int | Block] = field(default_factory=list)

    def lines(self) -> Iterator[int]:
        """All lines in it."""
        for item in self.items:
            if isinstance(item, Block):
                yield from item.lines()
            else:
                yield item


def arranged(under: Sequence[Guard], needs: Sequence[frozenset[int]]) -> list[int | Block]:
    """Lines by their numbers; lines under conditions are in blocks.

    There are as few blocks as possible where each line stands after the lines that it `needs`.
    """

    def place(lines: list[int], level: int) -> list[int | Block]:
        items: list[int | Block] = []
        open_ = set(lines)
        for at, k in enumerate(lines):
            if k not in open_:
                continue
            if len(under[k]) == level:
                open_.remove(k)
                items.append(k)
                continue
            branch = under[k][level]
            before, block = together([i for i in lines[at:] if i in open_], branch, level)
            open_.difference_update(before, block)
            items += place(before, level)
            items.append(Block(branch, place(block, level + 1)))
        return items

    def together(lines: list[int], branch: Branch, level: int) -> tuple[list[int], list[int]]:
        """Of open lines those of one block, and what must stand before it."""
        mine = [i for i in lines if len(under[i]) > level and under[i][level] == branch]
        inside: set[int] = set()
        waiting: set[int] = set()  # for the block
        members = set(mine)
        for i in lines[: lines.index(mine[-1]) + 1]:
            if i not in members:
                if not (needs[i].isdisjoint(inside) and needs[i].isdisjoint(waiting)):
                    waiting.add(i)
            elif needs[i].isdisjoint(waiting):
                inside.add(i)
            else:
                waiting.add(i)
        before: set[int] = set()
        open_ = set(lines) - inside
        missing = list(inside)
        while missing:
            more = (needs[missing.pop()] & open_) - before
            before |= more
            missing += more
        return sorted(before), sorted(inside)

    return place(list(range(len(under))), 0)


def homes(items: Sequence[int | Block]) -> dict[int, tuple[int, ...]]:
    """For each line the blocks that it stands in, the outer one first, each by a number of its own."""
    found: dict[int, tuple[int, ...]] = {}
    count = 0

    def visit(items: Sequence[int | Block], home: tuple[int, ...]) -> None:
        nonlocal count
        for item in items:
            if isinstance(item, Block):
                count += 1
                visit(item.items, (*home, count))
            else:
                found[item] = home

    visit(items, ())
    return found
