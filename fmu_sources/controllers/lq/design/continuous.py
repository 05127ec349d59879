"""The optimal control law in continuous time (Theorem 1).

With its feed-forward for a disturbance that is linear between nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import linalg

from build_fmus.base.checks import number, whole_number
from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.lq.design.matrices import by_decay, even, matrix
from fmu_sources.controllers.lq.design.modes import check_modes, rate
from fmu_sources.controllers.lq.design.plant import LinearPlant, LqError, QuadraticIndex, check_sizes
from fmu_sources.controllers.lq.design.riccati import RESIDUAL_LIMIT, refined


@dataclass(frozen=True, eq=False)
class ContinuousLq:
    """Theorem 1: u(t) = -K x(t) + direct w(t) + integral over s from 0 on of kernel(s) w(t + s)."""

    P: Array  # (n, n), stabilizing solution of (16)
    K: Array  # (nu, n), R^-1 (N' + B' P)
    A_c: Array  # (n, n), (18)
    direct: Array  # (nu, nw), -R^-1 Nuw
    drive: Array  # (n, nw), P E + Q12 - K' Nuw: what w does to r in (17)
    eigenvalues: npt.NDArray[np.complex128]  # of A_c, slowest decay last
    residual: float  # |left side of (16)| / |P|, Frobenius norms
    plant: LinearPlant
    index: QuadraticIndex

    @property
    def preview_gain(self) -> Array:
        """(nu, n): R^-1 B', with which r of (17) acts on u."""
        return np.asarray(linalg.solve(self.index.R, self.plant.B.T, assume_a="pos"))

    def kernel(self, s: float) -> Array:
        """(nu, nw): G(s) = -R^-1 B' exp(A_c' s) (P E + Q12 - K' Nuw), the weight of w(t + s)."""
        number("the kernel's time ahead", s, "s", least=0)
        return -self.preview_gain @ linalg.expm(self.A_c.T * s) @ self.drive

    def foh_weights(self, step: float, count: int) -> FohWeights:
        """The integral of kernel(s) w(t + s) for a w that is linear between nodes 0, step, 2 step ... ahead.

        With Phi = exp(A_c' step), H0 = integral of exp(A_c' s)(1 - s/step) and H1 = integral of exp(A_c' s) s/step
        over one step, the hat over node j weighs -R^-1 B' (H1 Phi^(j-1) + H0 Phi^j)(P E + Q12 - K' Nuw). All three
        are blocks of one matrix exponential, so nothing is approximated.
        """
        step, count = number("step", step, "s", above=0), whole_number("count", count)
        n, M = len(self.A_c), self.A_c.T
        ladder = np.zeros((3 * n, 3 * n))
        ladder[:n, :n] = M * step
        ladder[:n, n : 2 * n] = ladder[n : 2 * n, 2 * n :] = np.eye(n)
        blocks = linalg.expm(ladder)[:n]
        phi, whole, falling = blocks[:, :n], step * blocks[:, n : 2 * n], step * blocks[:, 2 * n :]
        gain = self.preview_gain
        fall, rise = gain @ falling, gain @ (whole - falling)
        rest = linalg.solve(M.T, gain.T).T  # gain (A_c')^-1

        shape = (count, *self.direct.shape)
        interior, end, tail = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        v = self.drive
        interior[0], tail[0] = -fall @ v, rest @ v
        for j in range(1, count):
            end[j] = -rise @ v
            v = phi @ v
            interior[j] = end[j] - fall @ v
            tail[j] = rest @ v
        return FohWeights(step=step, interior=interior, end=end, tail=tail, direct=self.direct)


@dataclass(frozen=True, eq=False)
class FohWeights:
    """Weights of the nodes w_j = w(t + j step) when w is linear between them and known up to node n.

    The feed-forward is:

        u_ff = direct w_0 + sum_{j<n} interior[j] w_j + end[n] w_n  (+ tail[n] w_n with hold_tail)

    `end[n]` is the rising half of the hat at the horizon, 0 for n = 0. `tail[n]` is what w gives from the horizon on if
    it stays at w_n; without it w is taken to be 0 there. `direct` is 0 unless D' W F is not.
    """

    step: float  # s
    interior: Array  # (count, nu, nw)
    end: Array  # (count, nu, nw)
    tail: Array  # (count, nu, nw)
    direct: Array  # (nu, nw)

    def command(self, ahead: npt.ArrayLike, horizons: Sequence[int], *, hold_tail: bool = False) -> Array:
        """u_ff, (nu,), from the nodes ahead (nodes, nw) and one horizon n per disturbance, in steps."""
        road = matrix("ahead", ahead, (None, self.direct.shape[1]), "nodes x disturbances")
        if len(horizons) != road.shape[1]:
            raise ValueError(f"{len(horizons)} horizons are given for {road.shape[1]} disturbances")
        most = min(len(self.interior), len(road)) - 1
        u = np.zeros(len(self.direct))
        if most >= 0:
            u += self.direct @ road[0]
        for k, n in enumerate(horizons):
            if not 0 <= n <= most:
                raise ValueError(f"horizon {n} of disturbance {k} is outside 0 ... {most}, the nodes there are")
            u += np.einsum("ju,j->u", self.interior[:n, :, k], road[:n, k]) + self.end[n, :, k] * road[n, k]
            if hold_tail:
                u += self.tail[n, :, k] * road[n, k]
        return u


def continuous_lq(plant: LinearPlant, index: QuadraticIndex) -> ContinuousLq:
    """Theorem 1: (14)-(18), solved with the cross term and refined by Newton steps on (16).

    `LqError` names the mode if (A, B) is not stabilizable or the index does not detect a mode that does not decay.
    """
    check_sizes(plant, index)
    check_modes(plant, index)
    A, B, N, R = plant.A, plant.B, index.N, index.R

    def gain(P: Array) -> Array:
        return np.asarray(linalg.solve(R, B.T @ P + N.T, assume_a="pos"))

    def residual(P: Array) -> Array:
        K = gain(P)
        return A.T @ P + P @ A - K.T @ R @ K + index.Q1

    def newton(P: Array) -> Array:
        K = gain(P)
        cost = index.Q1 - N @ K - K.T @ N.T + K.T @ R @ K
        return np.asarray(linalg.solve_continuous_lyapunov((A - B @ K).T, -even(cost)))

    try:
        P = linalg.solve_continuous_are(A, B, index.Q1, R, s=N)
    except (linalg.LinAlgError, ValueError) as error:
        raise LqError(f"the Riccati equation (16) has no stabilizing solution: {error}") from error
    P, relative = refined(np.asarray(P), newton, residual)
    K = gain(P)
    A_c = A - B @ K
    eigenvalues = by_decay(linalg.eigvals(A_c))
    if not relative <= RESIDUAL_LIMIT or eigenvalues[-1].real >= 0.0:
        raise LqError(
            f"the Riccati equation (16) was solved to {relative:.1e} |P| only, with the slowest closed-loop "
            f"eigenvalue at {rate(eigenvalues[-1])}; the weights are too far apart, or a mode is nearly uncontrollable"
        )
    return ContinuousLq(
        P=P,
        K=K,
        A_c=A_c,
        direct=-linalg.solve(R, index.Nuw, assume_a="pos"),
        drive=P @ plant.E + index.Q12 - K.T @ index.Nuw,
        eigenvalues=eigenvalues,
        residual=relative,
        plant=plant,
        index=index,
    )
