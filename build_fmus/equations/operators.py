"""How each elementwise operation of CasADi is written in C."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

from build_fmus.base import extras
from build_fmus.base.elementwise import FUNCTIONS

with extras.needed("build", extras.BUILDING):
    import casadi as ca

# How tightly C binds, of what is written here.
OR, AND, EQUAL, COMPARED, SUM, PRODUCT, SIGNED, ATOM = range(8)
IF_ELSE = -1  # the sum of two IF_ELSE_ZERO with opposite conditions, which no operation of CasADi stands for


class Text(NamedTuple):
    """C code of a value, how tightly it binds, and whether it is an int, 0 or 1, that arithmetic must not meet."""

    code: str
    level: int = ATOM
    logical: bool = False

    def within(self, level: int) -> str:
        """The code as an operand that must bind at least as tightly."""
        return self.code if self.level >= level else f"({self.code})"

    @property
    def number(self) -> Text:
        """As a number that one can calculate with: dividing ints is another operation."""
        return Text(f"(double){self.within(SIGNED)}", SIGNED) if self.logical else self


def constant(value: float) -> Text:
    """A number, with as many digits as tell it from all others."""
    if math.isnan(value):
        return Text("NAN")
    size = abs(value)
    short = re.sub(r"e([+-])0*", r"e\1", f"{size:g}").replace("e+", "e")
    digits = "INFINITY" if math.isinf(size) else short if "e" in short and float(short) == size else repr(size)
    return Text(f"-{digits}", SIGNED) if math.copysign(1.0, value) < 0 else Text(digits)


def _infix(operator: str, level: int, *, operands: int | None = None, logical: bool = False) -> _Writer:
    """Operators that C groups from the left; `operands`: the level that both operands need instead."""

    def write(a: Text, b: Text) -> Text:
        left, right = (level, level + 1) if operands is None else (operands, operands)
        return Text(f"{a.within(left)} {operator} {b.within(right)}", level, logical)

    return write


def _condition(operator: str, level: int) -> _Writer:
    """`&&` and `||`, whose operands are conditions; without parentheses only what no reader mistakes."""

    def write(a: Text, b: Text) -> Text:
        code = [x.code if x.level in (level, EQUAL, COMPARED, SIGNED, ATOM) else f"({x.code})" for x in (a, b)]
        return Text(f" {operator} ".join(code), level, logical=True)

    return write


def _call(function: str) -> _Writer:
    return lambda *operands: Text(f"{function}({', '.join(x.code for x in operands)})")


def _negative(a: Text) -> Text:
    return Text(f"-{a.within(ATOM)}", SIGNED)


def _not(a: Text) -> Text:
    return Text(f"!{a.within(ATOM)}", SIGNED, logical=True)


_Writer = Callable[..., Text]
_CONDITIONS = (ca.OP_NOT, ca.OP_AND, ca.OP_OR)
_WRITERS: dict[int, _Writer] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: _infix("+", SUM),
    ca.OP_SUB: _infix("-", SUM),
    ca.OP_MUL: _infix("*", PRODUCT),
    ca.OP_DIV: _infix("/", PRODUCT),
    ca.OP_NEG: _negative,
    ca.OP_TWICE: lambda a: Text(f"2.0 * {a.within(SIGNED)}", PRODUCT),
    ca.OP_INV: lambda a: Text(f"1.0 / {a.within(SIGNED)}", PRODUCT),
    ca.OP_LT: _infix("<", COMPARED, operands=SUM, logical=True),
    ca.OP_LE: _infix("<=", COMPARED, operands=SUM, logical=True),
    ca.OP_EQ: _infix("==", EQUAL, operands=SUM, logical=True),
    ca.OP_NE: _infix("!=", EQUAL, operands=SUM, logical=True),
    ca.OP_NOT: _not,
    ca.OP_AND: _condition("&&", AND),
    ca.OP_OR: _condition("||", OR),
    ca.OP_IF_ELSE_ZERO: _call("when"),
    IF_ELSE: _call("if_else"),
    ca.OP_SQ: _call("square"),
    ca.OP_CONSTPOW: _call("pow"),
} | {getattr(ca, f"OP_{name.upper()}"): _call(name) for name in FUNCTIONS}
ELEMENTWISE = frozenset(_WRITERS)
HELPERS = (
    "square",
    "sign",
    "when",
    "if_else",
    "index_of",
    "look_up",
    "store",
    "smallest",
    "largest",
    "product",
    "add_product",
)
"""Functions of `runtime/equations.h`, which no value may be called like."""


def write(operation: int, operands: Sequence[Text]) -> Text:
    """The operation on its operands.

    Raises:
        KeyError: no elementwise operation.
    """
    writer = _WRITERS[operation]
    if operation in _CONDITIONS:
        return writer(*operands)
    if operation in (ca.OP_IF_ELSE_ZERO, IF_ELSE):
        condition, *values = operands
        return writer(condition, *(v.number for v in values))
    return writer(*(x.number for x in operands))
