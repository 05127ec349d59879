"""The functions of a component: what its C code, its linear model and its Python evaluation compute."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.component.declaration import VECTORS, Declaration
from build_fmus.component.variables import DeclarationError

with extras.needed("build", extras.BUILDING):
    import casadi as ca

_JACOBIAN_UP_TO = 10_000  # operations of `fwd`: beyond it a Jacobian in one piece would double the size of the FMU


def make_functions(declaration: Declaration) -> dict[str, ca.Function]:
    """What `build_fmus.component.Model.functions` describes.

    Raises:
        DeclarationError: an expression with an undeclared symbol, a check that depends on a state.
    """
    d, made = declaration, _Maker(declaration)
    x0, change, result = (column(d, parts) for parts in (starts(d), list(d.changes.values()), results(d)))
    made.add("start", made.start_arguments, x0)
    made.add("out", made.at_an_instant, result)
    if d.kind == "continuous":
        made.add("rhs", made.arguments, change)
        made.add_derivatives(x0, change, result)
    else:
        made.add("update", made.at_an_instant, change)
        made.add("tick", made.at_an_instant, change, result)
        if d.programs:
            made.add("programs", made.arguments, column(d, [q.data for q in d.programs]))
        for q in d.profiles:
            made.add("profile_settings", made.arguments, q.settings)
            made.add("spectra", [q.wave_number, *made.start_arguments], q.spectra)
    if d.values:
        made.add("values", made.at_an_instant, *(ca.densify(e) for e, _ in d.values.values()))
    if d.checks:
        positive = column(d, [e for e, _ in d.checks])
        made.add("check", made.arguments, positive)
        if d.size("state") and ca.depends_on(positive, d.symbol("state")):
            raise DeclarationError(f"{d.name}: a check may depend on parameters, inputs and time, not on states")
    return made.functions


def with_constants(d: Declaration) -> Declaration:
    """The declaration with the values of its constants in place of their symbols."""
    constants = d.of("constant")
    if not constants:
        return d
    groups = (d.starts, d.changes, d.results)
    values = [e for e, _ in d.values.values()]
    flat = (
        [e for group in groups for e in group.values()]
        + [e for e, _ in d.checks]
        + values
        + [q.data for q in d.programs]
        + [e for q in d.profiles for e in (q.settings, q.spectra)]
    )
    numbers = [d.symbols(ca.DM(np.reshape(v.start, v.shape))) for v in constants if v.start is not None]
    put_in = iter(ca.substitute(flat, [v.symbol for v in constants], numbers))

    def renewed(group: Mapping[str, Any]) -> dict[str, Any]:
        return {name: next(put_in) for name in group}

    starts, changes, results = (renewed(group) for group in groups)
    return replace(
        d,
        starts=starts,
        changes=changes,
        results=results,
        checks=tuple((next(put_in), m) for _, m in d.checks),
        values={name: (next(put_in), source) for name, (_, source) in d.values.items()},
        programs=tuple(replace(q, data=next(put_in)) for q in d.programs),
        profiles=tuple(replace(q, settings=next(put_in), spectra=next(put_in)) for q in d.profiles),
    )


def column(d: Declaration, parts: list[Any]) -> Any:
    """Expressions below each other, dense."""
    return ca.densify(ca.vertcat(*parts)) if parts else d.symbols(0, 1)


def starts(d: Declaration) -> list[Any]:
    """Expressions of the start state: a declared start is the state itself."""
    return [d.starts.get(v.name, v.symbol) for v in d.of("state")]


def results(d: Declaration) -> list[Any]:
    """Expressions of the outputs as columns of row-major elements."""
    return [ca.vec(e.T) for e in d.results.values()]


class _Maker:
    """Functions of one declaration by name, with the arguments that they share."""

    def __init__(self, d: Declaration) -> None:
        self.d = d
        self.start_arguments = [d.symbol(role) for role in VECTORS]
        self.arguments = [d.time, *self.start_arguments]
        solutions = [ca.vertcat(*(q.symbol for q in d.programs))] if d.programs else []
        self.at_an_instant = [*self.arguments, *solutions, *(q.symbol for q in d.profiles)]
        self.functions: dict[str, ca.Function] = {}

    def add(self, name: str, arguments: list[Any], *expressions: Any) -> None:
        """Make one function."""
        d, outs = self.d, list(expressions)
        if d.symbols is ca.SX and d.kind == "continuous":
            outs = ca.cse(outs)  # what two expressions share is computed once: derivatives shrink to half
        try:
            self.functions[name] = ca.Function(f"fmu_{name}", arguments, outs)
        except RuntimeError as error:
            free = ", ".join(
                str(s)
                for e in outs
                for s in ca.symvar(e)
                if not any(ca.depends_on(a, s) for a in arguments if a.numel())
            )
            raise DeclarationError(f"{d.name}: {name} uses undeclared symbols ({free or error})") from None

    def add_derivatives(self, x0: Any, change: Any, result: Any) -> None:
        """Directional derivatives, and the Jacobian where a solver needs it or its code stays short."""
        d, (x, u, p) = self.d, self.start_arguments
        dx, du, dp = (d.symbols.sym(f"d{n}", s.numel()) for n, s in (("x", x), ("u", u), ("p", p)))
        knowns, seeds = ca.vertcat(x, u, p), ca.vertcat(dx, du, dp)

        def along(expression: Any) -> Any:
            return ca.densify(ca.jtimes(expression, knowns, seeds))

        self.add("fwd", [*self.arguments, dx, du, dp], along(change), along(result))
        self.add("fwd_start", [*self.start_arguments, dx, du, dp], along(x0))
        if d.solver == "ros2" or self.functions["fwd"].n_instructions() <= _JACOBIAN_UP_TO:
            self.add("jac", self.arguments, *(ca.densify(ca.jacobian(change, v)) for v in (x, d.time)))
