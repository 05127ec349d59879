"""The numbers of a function that have no derivatives.

Over numbers with derivatives each statement costs as much as its operands, for each direction (`tangents.h`) or on the
tape (`adjoints.h`). A number that few others read can be left out: what reads it has its operands in its place, with
the products of the slopes. That is worth it where it leaves fewer operands (preaccumulation; Griewank and Walther,
Evaluating Derivatives, 2008, chapter 10). Plain numbers are computed as before.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

_STATEMENT = 2.0  # cost of a statement, in operands
_PRODUCT = 0.25  # of a product of two slopes
_PARAMETER = 0.25  # of an operand that moves in few directions, if in any
_BRANCH = 0.25  # share of the runs that need what stands under a condition: of two branches one is taken
_MOST = 64  # operands of a statement: compilers take long for more


@dataclass
class Statement:
    """One that writes a number, or a result.

    Attributes:
        name: of the number; "" for a result.
        reads: names of its operands: those of numbers, and fields such as `x->body_roll`.
        depth: conditions that it stands under.
        smooth: whether it can be left out.
    """

    name: str
    reads: set[str] = field(default_factory=set)
    depth: int = 0
    smooth: bool = False

    @property
    def share(self) -> float:
        """The part of all calls that carries it out."""
        return float(_BRANCH**self.depth)


def without_derivatives(statements: Sequence[Statement]) -> set[str]:
    """Names of the numbers to leave out; the statements' operands are then those that remain."""
    readers: dict[str, list[Statement]] = {}
    for s in statements:
        for name in s.reads:
            readers.setdefault(name, []).append(s)
    left_out: set[str] = set()
    more = True
    while more:
        more = False
        for s in statements:
            if s.smooth and s.name not in left_out and _gain(s, of := readers.get(s.name, [])) > 0.0:
                for reader in of:
                    for name in s.reads - reader.reads:
                        readers[name].append(reader)
                    reader.reads |= s.reads
                    reader.reads.discard(s.name)
                for name in s.reads:
                    readers[name].remove(s)
                left_out.add(s.name)
                more = True
    return left_out


def _gain(s: Statement, readers: Sequence[Statement]) -> float:
    """Operands that are saved without a number."""
    gain = s.share * (_STATEMENT + _cost(s.reads))
    if any(len(s.reads | reader.reads) > _MOST for reader in readers):
        return 0.0
    for reader in readers:
        gain += reader.share * (1.0 - _cost(s.reads - reader.reads) - _PRODUCT * len(s.reads))
    return gain


def _cost(names: Collection[str]) -> float:
    return sum(_PARAMETER if name.startswith(("p->", "f->")) else 1.0 for name in names)
