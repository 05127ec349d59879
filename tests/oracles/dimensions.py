"""Dimensions by algebra on the expression graph: every operation, in all branches, without numbers."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import casadi as ca

from build_fmus.base import units
from build_fmus.component import Model
from build_fmus.component.declaration import VECTORS

Exponents = Mapping[str, Fraction]
NONE: Exponents = {}

_SAME = {ca.OP_ADD, ca.OP_SUB, ca.OP_FMIN, ca.OP_FMAX}
_COMPARED = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_ATAN2}
_KEPT = {ca.OP_NEG, ca.OP_FABS, ca.OP_TWICE, ca.OP_ASSIGN}
_POWER = {ca.OP_SQ: Fraction(2), ca.OP_SQRT: Fraction(1, 2), ca.OP_INV: Fraction(-1)}
_LOGICAL = {ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_SIGN}


def inconsistent(model: Model) -> list[str]:
    """What is wrong with the derivatives, updates, starts and outputs of a component with SX symbols.

    Empty when nothing is.

    A literal has no dimension, but 0 has every one; an output that is a literal has the declared one. Radians count as
    none. Not for units by row and column.
    """
    variables = [v for r in VECTORS for v in model.of(r)] + model.of("constant")
    arguments = [ca.SX.sym("t"), *(ca.SX.sym(v.name, *v.symbol.shape) for v in variables)]
    given = [{"s": Fraction(1)}, *(_of(v.unit) for v in variables)]
    expressions: list[Any] = []
    names, declared = [], []
    changed = {"s": Fraction(1)} if model.kind == "continuous" else NONE
    for what, group, per in (
        ("start", model.starts, NONE),
        ("change", model.changes, changed),
        ("output", model.results, NONE),
    ):
        for name, e in group.items():
            if what == "output" and e.is_constant():
                continue
            column = ca.vec(e)
            expressions.append(column)
            names += [f"{what} of {name}"] * column.numel()
            declared += [_times(_of(model.variable(name).unit), per, -1)] * column.numel()
    own = ca.vertcat(model.time, *(ca.vec(v.symbol) for v in variables))
    column = ca.substitute(ca.vertcat(*expressions), own, ca.vertcat(*(ca.vec(a) for a in arguments)))
    return _walk(ca.Function("f", arguments, [ca.densify(column)]), given, names, declared)


def _walk(f: ca.Function, given: list[Exponents], names: list[str], declared: list[Exponents]) -> list[str]:
    registers: dict[int, Exponents | None] = {}  # None: 0, of any dimension
    values: dict[int, float] = {}
    wrong = []
    for k in range(f.n_instructions()):
        op, out = f.instruction_id(k), f.instruction_output(k)
        args = f.instruction_input(k)
        if op == ca.OP_OUTPUT:
            row = out[1]
            if registers[args[0]] not in (None, declared[row]):
                wrong.append(f"{names[row]} has {registers[args[0]]}, declared {declared[row]}")
            continue
        if op == ca.OP_CONST:
            values[out[0]] = f.instruction_constant(k)
            registers[out[0]] = None if values[out[0]] == 0 else NONE
            continue
        if op == ca.OP_INPUT:
            values.pop(out[0], None)
            registers[out[0]] = given[args[0]]
            continue
        exponent = values.get(args[1]) if len(args) > 1 else None
        try:
            registers[out[0]] = _result(op, [registers[a] for a in args], exponent)
        except ValueError as error:
            wrong.append(str(error))
            registers[out[0]] = NONE
        values.pop(out[0], None)
    return wrong


def _result(op: int, of: list[Exponents | None], exponent: float | None) -> Exponents | None:
    known = [e for e in of if e is not None]
    if op in _SAME or op in _COMPARED:
        if any(e != known[0] for e in known):
            raise ValueError(f"operation {op} joins {' and '.join(map(str, known))}")
        return NONE if op in _COMPARED else known[0] if known else None
    if op in (ca.OP_MUL, ca.OP_DIV):
        return _times(of[0], of[1] or NONE, 1 if op == ca.OP_MUL else -1) if None not in of else None
    if op == ca.OP_IF_ELSE_ZERO:
        return of[1]
    if op in _KEPT:
        return of[0]
    if op in _POWER:
        return None if of[0] is None else {b: e * _POWER[op] for b, e in of[0].items()}
    if op in (ca.OP_POW, ca.OP_CONSTPOW) and of[0] and exponent is not None:
        return {b: e * Fraction(exponent).limit_denominator(100) for b, e in of[0].items()}
    if op not in _LOGICAL and any(known):
        raise ValueError(f"operation {op} of {' and '.join(map(str, known))}")
    return NONE


def _times(a: Exponents | None, b: Exponents, sign: int) -> Exponents:
    a = a or NONE
    return {n: e for n in {**a, **b} if (e := a.get(n, Fraction(0)) + sign * b.get(n, Fraction(0)))}


def _of(unit: str | None) -> Exponents:
    return {b: Fraction(e) for b, e in units.unit(unit).powers.items() if b != "rad"} if unit else NONE
