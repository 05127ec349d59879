"""What a component consists of, once everything is declared: data without a way to change them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from build_fmus import qp
from build_fmus.base import extras, units
from build_fmus.base.checks import did_you_mean
from build_fmus.component.variables import Element, Kind, Role, Solver, Variable
from build_fmus.random_profiles import RandomProfiles

with extras.needed("build", extras.BUILDING):
    import casadi as ca

VECTORS: tuple[Role, ...] = ("state", "input", "parameter")
"""What the functions of a component take, in this order; most of them after the time."""


@dataclass(frozen=True, eq=False)
class Declaration:
    """All declarations of the builder. Expressions are columns of row-major elements, in the symbols of the variables.

    Attributes:
        all_variables: every variable in declaration order, hidden states included.
        symbols: `ca.SX` or `ca.MX`, the kind of all expressions.
        time: symbol of the time.
        starts: state -> expression of its start value, where it is calculated.
        changes: state -> its derivative (continuous) or its value after a sample instant (discrete).
        results: output -> expression.
        checks: expressions that must be > 0 when initialization ends, with what to say when one is not.
        values: name of an intermediate value -> its expression, and where its equation comes from.
        equations: output or state -> where its equation comes from.
        programs: quadratic programs, whose symbols are among those of the expressions.
        profiles: random profiles, one pair at most, whose symbol is among those of the expressions.
        reference_inputs: input element -> its signal over time in the reference result.
        operating_points: name -> values of states and inputs at which the build also checks the solver's stability.
        provenance: content of the FMU's `resources/provenance.json`, unless empty.
        bibliography: short name of a source -> full reference.

    The others are those of `build_fmus.component.Component`.
    """

    name: str
    kind: Kind
    description: str
    source: str
    sample_time: float | None
    solver: Solver
    solver_step: float
    exchange_step: float
    stop_time: float
    notes: tuple[str, ...]
    all_variables: tuple[Variable, ...]
    symbols: Any
    time: Any
    starts: Mapping[str, Any]
    changes: Mapping[str, Any]
    results: Mapping[str, Any]
    checks: tuple[tuple[Any, str], ...]
    values: Mapping[str, tuple[Any, str]]
    equations: Mapping[str, str]
    programs: tuple[qp.QuadraticProgram, ...]
    profiles: tuple[RandomProfiles, ...]
    reference_inputs: Mapping[str, Callable[[float], float]]
    operating_points: Mapping[str, Mapping[str, float]]
    provenance: Mapping[str, Any]
    bibliography: Mapping[str, str]

    # ------------------------------------------------------------------ variables

    def of(self, role: Role) -> list[Variable]:
        """Declared variables of a role in declaration order, hidden ones included."""
        return [v for v in self.all_variables if v.role == role]

    @property
    def variables(self) -> list[Variable]:
        """Variables by role (time, parameters, inputs, states, derivatives, outputs) without hidden states."""
        groups = {role: [v for v in self.of(role) if v.exposed] for role in ("parameter", "input", "state", "output")}
        derivatives = [_derivative_variable(v) for v in groups["state"]] if self.kind == "continuous" else []
        time = Variable("time", "time", "s", "simulation time")
        return [time, *groups["parameter"], *groups["input"], *groups["state"], *derivatives, *groups["output"]]

    def variable(self, name: str) -> Variable:
        """Declared variable by name; KeyError proposing the nearest name."""
        return named(self.name, {v.name: v for v in self.all_variables}, name)

    def elements(self, *roles: Role) -> list[Element]:
        """Scalar elements of the given roles (all when none is given), in value-reference order."""
        return [
            Element(n, v, i)
            for v in self.variables
            if not roles or v.role in roles
            for i, n in enumerate(v.element_names())
        ]

    def output_elements(self) -> list[Element]:
        """Everything with output causality: states declared as outputs, then declared outputs."""
        return [e for e in self.elements("state", "output") if e.variable.output]

    @property
    def clipped_inputs(self) -> list[Variable]:
        """Inputs that the equations clip to their range."""
        inputs = [v for v in self.variables if v.role == "input" and v.type == "Float64"]
        return [v for v in inputs if v.min is not None or v.max is not None]

    # ------------------------------------------------------------------ vectors of the roles

    def size(self, role: Role) -> int:
        """Number of scalars of a role, hidden ones included."""
        return sum(v.size for v in self.of(role))

    def vector(self, role: Role, values: Mapping[str, float] | None = None) -> np.ndarray:
        """Start values of a role as one vector; hidden and calculated elements are 0.

        Elements that are in `values`, by name, have that value instead; KeyError for a name that no element has.
        """
        out = np.zeros(self.size(role))
        for v in self.of(role):
            if v.start is not None:
                out[v.slot : v.slot + v.size] = v.start
        slots = {e.name: e.slot for e in self.elements(role)} if values else {}
        for name, value in (values or {}).items():
            if name not in slots:
                raise KeyError(f"{self.name} has no {role} {name!r}{did_you_mean(name, slots)}")
            out[slots[name]] = value
        return out

    def symbol(self, role: Role) -> Any:
        """Symbols of a role as one column."""
        parts = [v.symbol for v in self.of(role)]
        return ca.vertcat(*parts) if parts else self.symbols(0, 1)

    # ------------------------------------------------------------------ texts

    @property
    def check_messages(self) -> list[str]:
        """What to say when an element of `functions["check"]` is not > 0."""
        return [m for _, m in self.checks]

    @property
    def value_sources(self) -> dict[str, str]:
        """Names of the intermediate values with the sources of their equations, ordered as `functions["values"]`."""
        return {name: source for name, (_, source) in self.values.items()}


def named(component: str, variables: Mapping[str, Variable], name: str) -> Variable:
    """Variable by name; KeyError proposing the nearest name."""
    try:
        return variables[name]
    except KeyError:
        raise KeyError(f"{component} has no variable {name!r}{did_you_mean(name, variables)}") from None


def _derivative_variable(v: Variable) -> Variable:
    unit = units.unit(v.unit) if v.unit else None
    match = units.derivative(unit) if unit else None
    return Variable(
        f"der({v.name})",
        "derivative",
        match,
        f"time derivative of {v.name}",
        v.shape,
        slot=v.slot,
        derivative_of=v.name,
    )
