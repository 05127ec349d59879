"""The designs of this folder as CasADi expressions of the weights, so that an FMU designs its law when it is initialized.

Riccati equations are solved by structure-preserving doubling (Chu, Fan, Lin: "A structure-preserving doubling algorithm for
continuous-time algebraic Riccati equations", 2005; with Guo and Xu for discrete ones, 2004): a fixed number of steps, each of which squares
what is left of the error, without eigenvalues and without a choice that depends on numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from build_fmus.checks import number
from fmu_sources.controllers.lq.design.plant import LinearPlant, index_from_outputs
from fmu_sources.controllers.lq.design.sampled import sampled_costs

DOUBLINGS = 20  # steps: of modes that decay by 1/s or faster, sampled every millisecond, nothing is left
SHIFT = 40.0  # 1/s, between the slowest and the fastest modes of a suspension: with it the Riccati equation becomes a discrete one
_TERMS = 16  # of the exponential series over one step, in which modes decay by less than a half


@dataclass(frozen=True, eq=False)
class TunableTaps:
    """Feedback ``K`` (controls, states) of the sampled law, and feed-forward of the continuous one for a disturbance that is linear between
    nodes (see :class:`FohWeights`), as expressions: of each kind (controls, count * disturbances), node after node."""

    K: ca.MX
    interior: ca.MX
    end: ca.MX
    tail: ca.MX


def tunable_taps(plant: LinearPlant, weights: ca.MX, period: float, count: int) -> TunableTaps:
    """What ``sampled_lq`` and ``continuous_lq`` give for ``weights`` (outputs + controls,), which may be expressions.

    The index must not weigh a control and a disturbance together (D' W F = 0), as that of a suspension does not.
    """
    period = number("period", period, "s", above=0)
    return TunableTaps(_sampled_gain(plant, weights, period), *_foh(plant, weights, period, count))


def _parts(plant: LinearPlant) -> list[tuple[np.ndarray, np.ndarray]]:
    """Weights of outputs and of controls, one after the other 1 and all others 0."""
    outputs, controls = len(plant.outputs), len(plant.controls)
    none = np.zeros((outputs, outputs)), np.zeros((controls, controls))
    return [(np.diag(row), none[1]) for row in np.eye(outputs)] + [(none[0], np.diag(row)) for row in np.eye(controls)]


def _combined(parts: list[np.ndarray], weights: ca.MX) -> ca.MX:
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


def _sampled_gain(plant: LinearPlant, weights: ca.MX, period: float) -> ca.MX:
    (n, nu), tiny = plant.B.shape, 1e-7
    x, u = slice(0, n), slice(n, n + nu)
    costs, step = [], np.zeros((0, 0))
    for weighted, driven in _parts(plant):
        step, cost = sampled_costs(plant, index_from_outputs(plant, weighted, driven + tiny * np.eye(nu)), period)
        cost[u, u] -= tiny * period * np.eye(nu)  # an index needs every force weighed
        costs.append(cost)
    whole = _combined(costs, weights)
    Ad, Bd = ca.DM(step[x, x]), ca.DM(step[x, u])
    Q, N, R = whole[x, x], whole[x, u], whole[u, u]
    direct = _solved(R, ca.horzcat(N.T, ca.MX(Bd.T)))
    P = _doubled(Ad - Bd @ direct[:, :n], Bd @ direct[:, n:], _even(Q - N @ direct[:, :n]))
    return _solved(R + Bd.T @ P @ Bd, Bd.T @ P @ Ad + N.T)


def _foh(plant: LinearPlant, weights: ca.MX, step: float, count: int) -> tuple[ca.MX, ca.MX, ca.MX]:
    """As :meth:`ContinuousLq.foh_weights`; the Riccati equation (16) by the doubling of its Cayley transform."""
    n, nu = plant.B.shape
    indices = [index_from_outputs(plant, W, R + np.eye(nu)) for W, R in _parts(plant)]
    Q, N, Q12 = (_combined([getattr(i, name) for i in indices], weights) for name in ("Q1", "N", "Q12"))
    R = _combined([i.R - np.eye(nu) for i in indices], weights)
    B, E = ca.DM(plant.B), ca.DM(plant.E)
    direct = _solved(R, ca.horzcat(N.T, ca.MX(B.T)))  # R^-1 [N', B']
    A = ca.DM(plant.A) - B @ direct[:, :n]
    G, H = _even(B @ direct[:, n:]), _even(Q - N @ direct[:, :n])
    one = ca.MX.eye(n)
    shifted = A - SHIFT * one
    back = _solved(shifted, ca.horzcat(one, G))  # shifted^-1 [I, G]
    inverse = _solved(shifted + G @ _solved(shifted.T, H), one)
    P = _doubled(one + 2 * SHIFT * inverse, _even(2 * SHIFT * back[:, n:] @ inverse.T), _even(2 * SHIFT * inverse.T @ H @ back[:, :n]))
    K = direct[:, :n] + direct[:, n:] @ P
    M, drive, gain = (ca.DM(plant.A) - B @ K).T, P @ E + Q12, direct[:, n:]

    phi, whole, falling = (_series(M * step, k) for k in (0, 1, 2))
    fall, rise = step * gain @ falling, step * gain @ (whole - falling)
    rest = _solved(M.T, gain.T).T
    ladder, power = drive, phi
    while ladder.shape[1] < count * plant.E.shape[1]:  # what one power of phi adds to all nodes so far
        ladder, power = ca.horzcat(ladder, power @ ladder), power @ power
    nodes = ladder[:, : count * plant.E.shape[1]]
    before = ca.horzcat(ca.MX.zeros(nu, plant.E.shape[1]), -rise @ nodes[:, : -plant.E.shape[1]])
    return before - fall @ nodes, before, rest @ nodes


def _series(M: ca.MX, k: int) -> ca.MX:
    """phi_k(M): sum of M^i / (i + k)!, the exponential for k = 0."""
    found = ca.MX.eye(M.shape[0])
    for i in range(_TERMS, 0, -1):
        found = ca.MX.eye(M.shape[0]) + M @ found / (i + k)
    return found / float(np.prod(np.arange(1, k + 1)))
