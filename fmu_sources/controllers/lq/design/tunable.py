"""The designs of this folder as CasADi expressions of the weights.

With them an FMU designs its control law when it is initialized.

Riccati equations are solved by structure-preserving doubling (Chu, Fan, Lin: "A structure-preserving doubling algorithm
for continuous-time algebraic Riccati equations", 2005; with Guo and Xu for discrete ones, 2004): a fixed number of
steps, each of which squares what is left of the error, without eigenvalues and without a choice that depends on
numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from build_fmus.base.checks import number
from fmu_sources.controllers.lq.design.plant import LinearPlant, QuadraticIndex, index_from_outputs
from fmu_sources.controllers.lq.design.sampled import sampled_costs

DOUBLINGS = 20  # steps: of modes that decay by 1/s or faster, sampled every millisecond, nothing is left
# 1/s, between the slowest and the fastest modes of a suspension: with it the Riccati equation becomes a discrete one
SHIFT = 40.0
_REGULAR = (
    1e-7  # weight of every force with which parts of an index are made that weigh none, and which is taken away again
)
_HALVINGS, _TERMS = 8, 8  # of the step before the exponential series, and what is kept of it


@dataclass(frozen=True, eq=False)
class TunableTaps:
    """Gains of a tunable control law as expressions.

    Feedback `K` (controls, states) of the sampled control law, and feed-forward of the continuous one for a
    disturbance that is linear between nodes (see `FohWeights`): of each kind (controls, count * disturbances),
    node after node.

    `residuals` (2,): of the sampled and the continuous Riccati equation, relative to their solutions. Doubling does
    not fail where weights have no control law, or none that double precision finds: what it gives then solves nothing.
    """

    K: ca.MX
    interior: ca.MX
    end: ca.MX
    tail: ca.MX
    residuals: ca.MX


def tunable_taps(plant: LinearPlant, weights: ca.MX, period: float, count: int) -> TunableTaps:
    """What `sampled_lq` and `continuous_lq` give for `weights` (outputs + controls,), which may be expressions.

    The index must not weigh a control and a disturbance together (D' W F = 0), as that of a suspension does not.
    """
    period = number("period", period, "s", above=0)
    K, sampled = _sampled_gain(plant, weights, period)
    interior, end, tail, continuous = _foh(plant, weights, period, count)
    return TunableTaps(K, interior, end, tail, ca.vertcat(sampled, continuous))


def _indices(plant: LinearPlant) -> list[QuadraticIndex]:
    """Indices with a weight of 1 on one output or control and 0 on all others, for each in turn.

    Every control has the weight `_REGULAR` besides.
    """
    outputs = len(plant.outputs)
    rows = np.eye(outputs + len(plant.controls))
    regular = _REGULAR * np.eye(len(plant.controls))
    return [index_from_outputs(plant, np.diag(row[:outputs]), np.diag(row[outputs:]) + regular) for row in rows]


def _relative(residual: ca.MX, P: ca.MX) -> ca.MX:
    return ca.sqrt(_squares(residual) / _squares(P))


def _squares(m: ca.MX) -> ca.MX:
    return ca.sum1(ca.vec(m) ** 2)


def _combined(parts: Sequence[np.ndarray], weights: ca.MX) -> ca.MX:
    """The sum of matrices, each times its weight."""
    flat = np.column_stack([m.ravel(order="F") for m in parts])
    return ca.reshape(ca.mtimes(ca.MX(ca.DM(flat)), weights), *parts[0].shape)


def _doubled(A: ca.MX, G: ca.MX, H: ca.MX) -> ca.MX:
    """The solution P of P = A' P (I + G P)^-1 A + H."""
    n = A.shape[0]
    for _ in range(DOUBLINGS):
        both = _solved(ca.MX.eye(n) + G @ H, ca.horzcat(A, G))
        turned, spread = both[:, :n], both[:, n:]
        A, G, H = A @ turned, _even(G + A @ spread @ A.T), _even(H + A.T @ H @ turned)
    return H


def _solved(A: ca.MX, B: ca.MX) -> ca.MX:
    return ca.solve(A, B, "qr")


def _even(m: ca.MX) -> ca.MX:
    return (m + m.T) / 2


def _sampled_gain(plant: LinearPlant, weights: ca.MX, period: float) -> tuple[ca.MX, ca.MX]:
    """K, and the relative residual of its equation."""
    n, nu = plant.B.shape
    x, u = slice(0, n), slice(n, n + nu)
    steps, costs = zip(*(sampled_costs(plant, index, period) for index in _indices(plant)), strict=True)
    for cost in costs:
        cost[u, u] -= _REGULAR * period * np.eye(nu)
    Ad, Bd = ca.DM(steps[0][x, x]), ca.DM(steps[0][x, u])
    whole = _combined(costs, weights)
    Q, N, R = whole[x, x], whole[x, u], whole[u, u]
    direct = _solved(R, ca.horzcat(N.T, ca.MX(Bd.T)))
    P = _doubled(Ad - Bd @ direct[:, :n], Bd @ direct[:, n:], _even(Q - N @ direct[:, :n]))
    weight = R + Bd.T @ P @ Bd
    K = _solved(weight, Bd.T @ P @ Ad + N.T)
    return K, _relative(Ad.T @ P @ Ad - P - K.T @ weight @ K + Q, P)


def _foh(plant: LinearPlant, weights: ca.MX, step: float, count: int) -> tuple[ca.MX, ca.MX, ca.MX, ca.MX]:
    """As `ContinuousLq.foh_weights`, and the relative residual of the Riccati equation (16).

    The equation is solved by the doubling of its Cayley transform.
    """
    (n, nu), nw = plant.B.shape, plant.E.shape[1]
    indices = _indices(plant)
    Q, N, Q12 = (_combined([getattr(i, name) for i in indices], weights) for name in ("Q1", "N", "Q12"))
    R = _combined([i.R - _REGULAR * np.eye(nu) for i in indices], weights)
    B, E = ca.DM(plant.B), ca.DM(plant.E)
    direct = _solved(R, ca.horzcat(N.T, ca.MX(B.T)))  # R^-1 [N', B']
    A = ca.DM(plant.A) - B @ direct[:, :n]
    G, H = _even(B @ direct[:, n:]), _even(Q - N @ direct[:, :n])
    one = ca.MX.eye(n)
    shifted = A - SHIFT * one
    back = _solved(shifted, ca.horzcat(one, G))  # shifted^-1 [I, G]
    inverse = _solved(shifted + G @ _solved(shifted.T, H), one)
    P = _doubled(
        one + 2 * SHIFT * inverse,
        _even(2 * SHIFT * back[:, n:] @ inverse.T),
        _even(2 * SHIFT * inverse.T @ H @ back[:, :n]),
    )
    residual = _relative(A.T @ P + P @ A - P @ G @ P + H, P)
    K = direct[:, :n] + direct[:, n:] @ P
    M, drive, gain = (ca.DM(plant.A) - B @ K).T, P @ E + Q12, direct[:, n:]

    phi, whole, falling = _exponentials(M * step)
    fall, rise = step * gain @ falling, step * gain @ (whole - falling)
    rest = _solved(M.T, gain.T).T
    ladder, power = drive, phi
    while ladder.shape[1] < count * nw:  # what one power of phi adds to all nodes so far
        ladder, power = ca.horzcat(ladder, power @ ladder), power @ power
    nodes = ladder[:, : count * nw]
    before = ca.horzcat(ca.MX.zeros(nu, nw), -rise @ nodes[:, :-nw])
    return before - fall @ nodes, before, rest @ nodes, residual


def _exponentials(M: ca.MX) -> list[ca.MX]:
    """exp(M), and the sums of M^i / (i + 1)! and M^i / (i + 2)!.

    They are series of a small part of M, which is doubled again.
    """
    one, part = ca.MX.eye(M.shape[0]), M / 2**_HALVINGS
    series = []
    for k in range(3):
        found = one
        for i in range(_TERMS, 0, -1):
            found = one + part @ found / (i + k)
        series.append(found / math.factorial(k))
    phi, whole, falling = series
    for _ in range(_HALVINGS):
        phi, whole, falling = phi @ phi, (phi + one) @ whole / 2, (whole @ whole + 2 * falling) / 4
    return [phi, whole, falling]
