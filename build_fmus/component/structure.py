"""What depends on what: exact dependencies from sparsity patterns, positions and velocities, constants."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.component.declaration import VECTORS, Declaration
from build_fmus.component.variables import Role
from build_fmus.random_profiles import FUNCTIONS

with extras.needed("build", extras.BUILDING):
    import casadi as ca


def constant_outputs(d: Declaration) -> dict[str, float]:
    """Output elements whose value is a number known now, such as the step of a preview."""
    constant = {n: e for n, e in d.results.items() if e.is_constant()}
    return {
        element: float(value)
        for name, e in constant.items()
        for element, value in zip(d.variable(name).element_names(), np.asarray(ca.evalf(e).full()).ravel(), strict=True)
    }


def dependencies(d: Declaration, functions: Mapping[str, ca.Function], *, initial: bool) -> dict[str, list[str]]:
    """Maps each output and derivative element to the elements that it depends on directly.

    Of continuous states and inputs (discrete components: of inputs, by feed-through at a sample instant); `initial`:
    during initialization, of parameters, inputs and settable start values, for calculated states too. Time is left out,
    though FMI allows it: no importer needs it, and OMSimulator refuses an FMI 3.0 FMU that lists it.
    """
    roles: tuple[Role, ...] = ("state", "input") if d.kind == "continuous" else ("input",)
    if initial:
        roles = ("state", "input", "parameter")
    t = d.symbols.sym("t")
    x, u, p = (d.symbols.sym(r, d.size(r)) for r in VECTORS)
    x_at = functions["start"](x, u, p) if initial else x
    solutions = [d.symbols.sym("s", sum(q.n_solution for q in d.programs))] if d.programs else []
    profiles = []  # each node depends on all that these come from
    for pair in d.profiles:
        n = d.symbols.sym("wave_number")
        made_of = ca.vertcat(*(functions[name](n, x_at, u, p) for name in FUNCTIONS))
        profiles.append(ca.repmat(ca.sum1(made_of), pair.symbol.numel(), 1))
    vectors: dict[Role, Any] = {"output": functions["out"](t, x_at, u, p, *solutions, *profiles)}
    if d.kind == "continuous":
        vectors["derivative"] = functions["rhs"](t, x_at, u, p)
    if initial:
        vectors["state"] = functions["start"](x, u, p)
    knowns = ca.vertcat(t, x, u, p)
    names: list[str | None] = [None] * knowns.numel()
    nx, nu = x.numel(), u.numel()
    offset: dict[Role, int] = {"state": 1, "input": 1 + nx, "parameter": 1 + nx + nu}
    for e in d.elements(*roles):
        if not (initial and e.variable.role == "state" and e.start is None):
            names[offset[e.variable.role] + e.slot] = e.name
    of_solution: list[set[int]] = []  # knowns behind each element of the solutions
    if d.programs:
        data = _pattern(functions["programs"](t, x_at, u, p), knowns)
        first = 0
        for q in d.programs:
            of_solution += [set().union(*data[first : first + q.n_data])] * q.n_solution
            first += q.n_data
    result: dict[str, list[str]] = {}
    for role, expr in vectors.items():
        rows = _pattern(expr, knowns)
        if role == "output":
            for row, used in zip(rows, _pattern(expr, *solutions) if solutions else (), strict=False):
                row.update(*(of_solution[c] for c in used))
        for e in d.elements(role):
            result[e.name] = [n for c in sorted(rows[e.slot]) if (n := names[c]) is not None]
    if not initial:  # a state that is an output depends on itself alone
        for e in d.elements("state"):
            if e.variable.output:
                result[e.name] = [e.name] if d.kind == "continuous" else []
    return result


def velocities(d: Declaration, functions: Mapping[str, ca.Function]) -> np.ndarray:
    """For each state the slot of the state that is its derivative, or -1: positions and velocities of a mechanism.

    A state is a position when its derivative is one other state and nothing else. That other state must not be a
    position itself; chains of integrators (jerk, acceleration, velocity) count from the top.
    """
    n = d.size("state")
    result = np.full(n, -1)
    if d.kind != "continuous" or not n:
        return result
    f = functions["rhs"]
    args = [d.symbols.sym("t"), *(d.symbols.sym(r, d.size(r)) for r in VECTORS)]
    rows = [
        {column - 1 for column in row} for row in _pattern(f(*args), ca.vertcat(*args))
    ]  # without time: from state 0
    points = [np.random.default_rng(seed).uniform(0.5, 1.5, n) for seed in (1, 2)]
    values = [np.asarray(f(0.0, x, d.vector("input"), d.vector("parameter"))).ravel() for x in points]
    driver = {}
    for i, known in enumerate(rows):
        j = min(known, default=-1)
        if len(known) == 1 and 0 <= j < n and j != i and all(v[i] == x[j] for v, x in zip(values, points, strict=True)):
            driver[i] = j

    def is_position(i: int, seen: tuple[int, ...] = ()) -> bool:
        return i in driver and i not in seen and not is_position(driver[i], (*seen, i))

    for i, j in driver.items():
        if is_position(i):
            result[i] = j
    return result


def _pattern(expression: Any, knowns: Any) -> list[set[int]]:
    """For each row of a column expression the elements of `knowns` it depends on."""
    rows: list[set[int]] = [set() for _ in range(expression.numel())]
    if expression.numel() and knowns.numel():
        for r, c in zip(*ca.jacobian_sparsity(expression, knowns).get_triplet(), strict=True):
            rows[r].add(c)
    return rows
