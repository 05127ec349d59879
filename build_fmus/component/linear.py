"""The linear model of a component about an operating point, and components that are linear models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.component.declaration import VECTORS, Declaration
from build_fmus.component.variables import DeclarationError

with extras.needed("build", extras.BUILDING):
    import casadi as ca


@dataclass(frozen=True)
class Linearization:
    """`dx/dt = A x + B u`, `y = C x + D u` about an operating point, with the names of rows and columns."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: list[str]
    inputs: list[str]
    outputs: list[str]


def make_jacobians(d: Declaration, functions: Mapping[str, ca.Function]) -> ca.Function:
    """`(t, x, u, p) -> d rhs/dx, d rhs/du, d y/dx, d y/du` of a continuous component."""
    t = d.symbols.sym("t")
    x, u, p = (d.symbols.sym(r, d.size(r)) for r in VECTORS)
    dx, y = functions["rhs"](t, x, u, p), functions["out"](t, x, u, p)
    blocks = [ca.densify(ca.jacobian(e, v)) for e, v in ((dx, x), (dx, u), (y, x), (y, u))]
    return ca.Function("jacobians", [t, x, u, p], blocks)


def linearized(d: Declaration, jacobians: ca.Function, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> Linearization:
    """Linear model about `(x, u, p)`; C and D cover all output elements in order."""
    A, B, Cy, Dy = (np.asarray(ca.DM(m).full()) for m in jacobians(0.0, x, u, p))
    outs = d.output_elements()
    C, D = np.zeros((len(outs), d.size("state"))), np.zeros((len(outs), d.size("input")))
    for i, e in enumerate(outs):
        if e.variable.role == "state":
            C[i, e.slot] = 1.0
        else:
            C[i], D[i] = Cy[e.slot], Dy[e.slot]
    states, inputs = ([e.name for e in d.elements(role)] for role in ("state", "input"))
    return Linearization(A, B, C, D, states, inputs, [e.name for e in outs])


@dataclass(frozen=True)
class StateSpace:
    """Matrices A, B, C, D of a linear component, with the names and units of its signals.

    Sample time [s]; None: continuous.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    sample_time: float | None
    inputs: Mapping[str, str | None]
    outputs: Mapping[str, str | None]

    def declare_in(self, c: Any, source: str) -> None:
        """Declare inputs, states, outputs and equations in the empty builder `c`.

        The matrices become tunable parameters.
        """
        u = ca.vertcat(*(c.input(name, unit, "input of the control law") for name, unit in self.inputs.items()))
        y = ca.DM.zeros(len(self.outputs), 1)
        if self.D.any():
            direct = c.parameter("D", self.D, None, "outputs per input", tunable=True, source=source)
            y += (direct * (self.D != 0)) @ u  # what is 0 depends on nothing: no algebraic loop through it
        if self.A.size:
            x = c.state("x", None, "states of the control law", shape=(len(self.A),))
            a, b, c_ = (
                c.parameter(name, value, None, text, tunable=True, source=source)
                for name, value, text in (
                    ("A", self.A, "states per state"),
                    ("B", self.B, "states per input"),
                    ("C", self.C, "outputs per state"),
                )
            )
            (c.update if self.sample_time else c.derivative)(x, a @ x + b @ u)
            y += c_ @ x
        for i, (name, unit) in enumerate(self.outputs.items()):
            c.output(name, y[i], unit, "output of the control law", source=source)


def statespace(
    name: str,
    system: Any,
    sample_time: float | None,
    inputs: Mapping[str, str | None] | None,
    outputs: Mapping[str, str | None] | None,
) -> StateSpace:
    """What `Component.from_statespace` is given, checked."""
    if isinstance(system, tuple):
        matrices, dt = system, sample_time or 0
    else:
        matrices, dt = (system.A, system.B, system.C, system.D), system.dt
    A, B, C, D = (np.atleast_2d(np.asarray(m, dtype=float)) for m in matrices)
    n, (p, m) = (0 if A.size == 0 else len(A)), D.shape
    A, B, C = (x.reshape(shape) if x.size == 0 else x for x, shape in ((A, (0, 0)), (B, (0, m)), (C, (p, 0))))
    if A.shape != (n, n) or B.shape != (n, m) or C.shape != (p, n) or not D.size:
        raise DeclarationError(f"{name}: A {A.shape}, B {B.shape}, C {C.shape} and D {D.shape} do not fit together")
    if dt is True or (not n and not dt):  # sampled, nobody says when; gains are the same at any time
        if dt is True and sample_time is None:
            raise DeclarationError(
                f"{name}: the system is discrete-time with an unspecified sample time; give sample_time"
            )
        dt = sample_time or 0
    if sample_time is not None and abs(dt - sample_time) > 1e-9 * sample_time:
        told = (
            f"is sampled every {dt:g} s"
            if dt
            else "is continuous; sample it (control.sample_system) or leave sample_time out"
        )
        raise DeclarationError(f"{name}: sample_time is {sample_time:g} s, but the system {told}")
    signals = [_signals(name, system, w, g, n_) for w, g, n_ in (("inputs", inputs, m), ("outputs", outputs, p))]
    return StateSpace(A, B, C, D, float(dt) or None, *signals)


def _signals(
    name: str, system: Any, what: str, given: Mapping[str, str | None] | None, count: int
) -> Mapping[str, str | None]:
    """Names and units of inputs or outputs: as given, else the system's own."""
    if given is None:
        labels = getattr(system, f"{what[:-1]}_labels", None)
        if labels is None:
            raise DeclarationError(f"{name}: matrices have no names; give {what}={{name: unit}}")
        own, units = getattr(system, "names", {}), getattr(system, "units", {})
        given = {own.get(label, label): units.get(own.get(label, label)) for label in labels}
    if len(given) != count:
        raise DeclarationError(f"{name}: {len(given)} names for {count} {what}")
    return given
