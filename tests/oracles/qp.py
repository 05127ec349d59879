"""Quadratic programs by another method than the FMUs': Goldfarb and Idnani, in the package `quadprog`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from build_fmus.qp import INFINITE


@dataclass(frozen=True)
class ReferenceSolution:
    """Solution z (n,) with multipliers (m,), positive at upper bounds, and status 0 (solved) or 2 (infeasible)."""

    z: np.ndarray
    multipliers: np.ndarray
    status: int


def solve_reference(
    hessian: np.ndarray, linear: np.ndarray, constraints: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> ReferenceSolution:
    """Solve `minimise 1/2 z'Hz + q'z subject to l <= A z <= u` with quadprog (Goldfarb and Idnani).

    Shapes: (n, n), (n,), (m, n), (m,), (m,). Needs the package `quadprog` (extra `test`).
    """
    import quadprog

    H, q, A = (np.asarray(a, dtype=float) for a in (hessian, linear, constraints))
    m = len(A)
    lo, up = np.broadcast_to(np.asarray(lower, float), m), np.broadcast_to(np.asarray(upper, float), m)
    length = np.linalg.norm(A, axis=1)
    empty = length == 0
    multipliers = np.zeros(m)
    nothing = ReferenceSolution(np.zeros(len(q)), multipliers, 2)
    if np.any(lo[empty] > 0) or np.any(up[empty] < 0) or np.any(lo > up):
        return nothing
    equal = np.flatnonzero((lo == up) & ~empty)
    below = np.flatnonzero((lo > -INFINITE) & (lo < up) & ~empty)
    above = np.flatnonzero((up < INFINITE) & (lo < up) & ~empty)
    rows = np.concatenate([equal, below, above])
    sign = np.concatenate([np.ones(len(equal) + len(below)), -np.ones(len(above))])
    bounds = np.where(sign > 0, lo[rows], up[rows])
    scale = sign / length[rows]
    if not len(rows):
        return ReferenceSolution(-np.linalg.solve(H, q), multipliers, 0)
    # Units of the variables in which H has ones on its diagonal
    unit = 1 / np.sqrt(np.diag(H))
    try:
        z, _, _, _, active, _ = quadprog.solve_qp(
            H * unit * unit[:, None], -q * unit, (A[rows] * scale[:, None] * unit).T, bounds * scale, len(equal)
        )
    except ValueError as error:
        if "inconsistent" not in str(error):
            raise
        return nothing
    np.add.at(multipliers, rows, -active * scale)
    return ReferenceSolution(z * unit, multipliers, 0)
