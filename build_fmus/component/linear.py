"""The linear model of a component about an operating point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from build_fmus import extras
from build_fmus.component.declaration import VECTORS, Declaration

with extras.needed("build", extras.BUILDING):
    import casadi as ca


@dataclass(frozen=True)
class Linearization:
    """``dx/dt = A x + B u``, ``y = C x + D u`` about an operating point, with the names of rows and columns."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: list[str]
    inputs: list[str]
    outputs: list[str]


def make_jacobians(d: Declaration, functions: Mapping[str, ca.Function]) -> ca.Function:
    """``(t, x, u, p) -> d rhs/dx, d rhs/du, d y/dx, d y/du`` of a continuous component."""
    t = d.symbols.sym("t")
    x, u, p = (d.symbols.sym(r, d.size(r)) for r in VECTORS)
    dx, y = functions["rhs"](t, x, u, p), functions["out"](t, x, u, p)
    blocks = [ca.densify(ca.jacobian(e, v)) for e, v in ((dx, x), (dx, u), (y, x), (y, u))]
    return ca.Function("jacobians", [t, x, u, p], blocks)


def linearized(d: Declaration, jacobians: ca.Function, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> Linearization:
    """Linear model about ``(x, u, p)``; C and D cover all output elements in order."""
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
