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
    """C code of a value, and how tightly it binds.

    `logical`: it is a condition, which arithmetic must not meet. `uniform`: it is a number of C, not a `real`, which
    may be a vector of numbers (copies in lanes).
    """

    code: str
    level: int = ATOM
    logical: bool = False
    uniform: bool = False

    def within(self, level: int) -> str:
        """The code as an operand that must bind at least as tightly."""
        return self.code if self.level >= level else f"({self.code})"

    @property
    def number(self) -> Text:
        """As a number that one can calculate with."""
        return Text(f"number({self.code})") if self.logical else self

    @property
    def real(self) -> Text:
        """As what can be stored."""
        return Text(f"all({self.code})") if self.uniform else self.number

    @property
    def condition(self) -> Text:
        """As a condition."""
        return self if self.logical else Text(f"{self.within(SUM)} != 0.0", EQUAL, logical=True)


def constant(value: float) -> Text:
    """A number, with as many digits as tell it from all others."""
    if math.isnan(value):
        return Text("NAN", uniform=True)
    size = abs(value)
    short = re.sub(r"e([+-])0*", r"e\1", f"{size:g}").replace("e+", "e")
    digits = "INFINITY" if math.isinf(size) else short if "e" in short and float(short) == size else repr(size)
    negative = math.copysign(1.0, value) < 0
    return Text(f"-{digits}" if negative else digits, SIGNED if negative else ATOM, uniform=True)


def _infix(operator: str, level: int, *, operands: int | None = None, logical: bool = False) -> _Writer:
    """Operators that C groups from the left; `operands`: the level that both operands need instead."""

    def write(a: Text, b: Text) -> Text:
        left, right = (level, level + 1) if operands is None else (operands, operands)
        return Text(f"{a.within(left)} {operator} {b.within(right)}", level, logical)

    return write


def _condition(operator: str, level: int) -> _Writer:
    """Of conditions, by bits: vectors have no `&&` and `||`."""

    def write(a: Text, b: Text) -> Text:
        code = [x.code if x.level in (level, ATOM) else f"({x.code})" for x in (a.condition, b.condition)]
        return Text(f" {operator} ".join(code), level, logical=True)

    return write


def _call(function: str) -> _Writer:
    return lambda *operands: Text(f"{function}({', '.join(x.code for x in operands)})")


def _negative(a: Text) -> Text:
    return Text(f"-{a.within(ATOM)}", SIGNED)


def _not(a: Text) -> Text:
    return Text(f"{a.within(SUM)} == {'0' if a.logical else '0.0'}", EQUAL, logical=True)


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
    ca.OP_AND: _condition("&", AND),
    ca.OP_OR: _condition("|", OR),
    ca.OP_IF_ELSE_ZERO: _call("when"),
    IF_ELSE: _call("if_else"),
    ca.OP_SQ: _call("square"),
    ca.OP_CONSTPOW: _call("pow"),
} | {getattr(ca, f"OP_{name.upper()}"): _call(name) for name in FUNCTIONS}
ELEMENTWISE = frozenset(_WRITERS)
CONDITIONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, *_CONDITIONS)
ARITHMETIC = frozenset((ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_NEG, ca.OP_TWICE, ca.OP_INV, ca.OP_SQ))
SMOOTH_FUNCTIONS = frozenset(
    (
        *(ca.OP_EXP, ca.OP_EXPM1, ca.OP_ERF, ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ATAN),
        *(ca.OP_SINH, ca.OP_COSH, ca.OP_TANH, ca.OP_ASINH),
    )
)
"""Without kinks, and with a finite slope wherever the value is finite."""
HELPERS = (
    "real",
    "condition",
    "all",
    "any",
    "number",
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
    "solve_linear",
)
"""Functions of `runtime/equations.h`, and its types, which no value may be called like."""


def write(operation: int, operands: Sequence[Text]) -> Text:
    """The operation on its operands.

    Raises:
        KeyError: no elementwise operation.
    """
    writer = _WRITERS[operation]
    if all(x.uniform for x in operands):
        operands = [operands[0].real, *operands[1:]]
    if operation in _CONDITIONS:
        return writer(*operands)
    if operation in (ca.OP_IF_ELSE_ZERO, IF_ELSE):
        condition, *values = operands
        return writer(condition.condition, *(v.number for v in values))
    return writer(*(x.number for x in operands))
