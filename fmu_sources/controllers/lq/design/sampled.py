"""The optimal control law of a controller with a sample time.

Exact for commands and disturbances that are held between samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import linalg

from build_fmus.base.checks import number, whole_number
from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.lq.design.matrices import even
from fmu_sources.controllers.lq.design.modes import check_modes, dominant, hidden_mode, rate
from fmu_sources.controllers.lq.design.plant import LinearPlant, LqError, QuadraticIndex, check_sizes
from fmu_sources.controllers.lq.design.riccati import RESIDUAL_LIMIT, refined


@dataclass(frozen=True, eq=False)
class SampledLq:
    """The optimal control law of a controller with sample time `period`: u_k = -K x_k - sum_{j>=0} G_j w_{k+j}.

    Controls and disturbances are held over each period; the index is the exact integral between samples, so that
    P, Qd, Nd ... are integrals over one period, not means.
    """

    period: float  # s
    Ad: Array
    Bd: Array
    Ed: Array
    Qd: Array  # (n, n)
    Nd: Array  # (n, nu)
    Rd: Array  # (nu, nu)
    N_xw: Array  # (n, nw)
    N_uw: Array  # (nu, nw)
    Q2d: Array  # (nw, nw)
    P: Array
    K: Array  # (nu, n)
    A_cd: Array  # (n, n), Ad - Bd K
    Rb: Array  # (nu, nu), Rd + Bd' P Bd
    eigenvalues: npt.NDArray[np.complex128]  # of A_cd, smallest magnitude first
    residual: float  # of the discrete Riccati equation / |P|, Frobenius norms
    plant: LinearPlant
    index: QuadraticIndex

    @property
    def _drive(self) -> Array:
        return self.A_cd.T @ self.P @ self.Ed + self.N_xw - self.K.T @ self.N_uw

    def preview_gains(self, count: int) -> Array:
        """Gains G_j of the disturbance j samples ahead, (count, nu, nw).

        G_0 = Rb^-1 (Bd' P Ed + N_uw), G_j = Rb^-1 Bd' (A_cd')^(j-1) [A_cd' P Ed + N_xw - K' N_uw].
        """
        gains = np.zeros((whole_number("count", count), *self.N_uw.shape))
        gains[0] = linalg.solve(self.Rb, self.Bd.T @ self.P @ self.Ed + self.N_uw, assume_a="pos")
        gain, v = linalg.solve(self.Rb, self.Bd.T, assume_a="pos"), self._drive
        for j in range(1, count):
            gains[j] = gain @ v
            v = self.A_cd.T @ v
        return gains

    def tail(self, n: int) -> Array:
        """(nu, nw): sum of G_j from j = n on.

        A preview that ends with w_{n-1} and holds it from there on uses G_{n-1} + tail(n) on that last value.
        """
        if n < 0:
            raise ValueError(f"n = {n}; a tail begins at 0 or later")
        if n == 0:
            return np.asarray(self.preview_gains(1)[0] + self.tail(1))
        gain = linalg.solve(self.Rb, self.Bd.T, assume_a="pos")
        power = np.linalg.matrix_power(self.A_cd.T, n - 1)
        return np.asarray(gain @ power @ linalg.solve(np.eye(len(self.K[0])) - self.A_cd.T, self._drive))


def sampled_lq(plant: LinearPlant, index: QuadraticIndex, period: float) -> SampledLq:
    """The exact sampled design: zero-order hold of u and w over `period` seconds, costs integrated in between."""
    period = number("period", period, "s", above=0)
    check_sizes(plant, index)
    check_modes(plant, index)
    n, nu = plant.B.shape
    step, cost = sampled_costs(plant, index, period)
    x, u, w = slice(0, n), slice(n, n + nu), slice(n + nu, None)
    Ad, Bd, Ed = step[x, x], step[x, u], step[x, w]
    Qd, Nd, Rd = cost[x, x], cost[x, u], cost[u, u]

    mode = hidden_mode(Ad, Bd, discrete=True)
    if mode is not None:
        states = dominant(mode[1], plant.states)
        raise LqError(
            f"at a period of {period:g} s the controls cannot reach the mode at {rate(mode[0], 'per sample')}, mostly "
            f"{', '.join(states)}: it is undamped and turns by whole or half turns between samples; change the period",
            mode[0],
            states,
        )

    def weight(P: Array) -> Array:
        return even(Rd + Bd.T @ P @ Bd)

    def gain(P: Array) -> Array:
        return np.asarray(linalg.solve(weight(P), Bd.T @ P @ Ad + Nd.T, assume_a="pos"))

    def residual(P: Array) -> Array:
        K = gain(P)
        return Ad.T @ P @ Ad - P - K.T @ weight(P) @ K + Qd

    def newton(P: Array) -> Array:
        K = gain(P)
        return np.asarray(
            linalg.solve_discrete_lyapunov((Ad - Bd @ K).T, even(Qd - Nd @ K - K.T @ Nd.T + K.T @ Rd @ K))
        )

    try:
        P = linalg.solve_discrete_are(Ad, Bd, Qd, Rd, s=Nd)
    except (linalg.LinAlgError, ValueError) as error:
        raise LqError(
            f"at a period of {period:g} s the sampled Riccati equation has no stabilizing solution ({error}); "
            "change the period or the weights"
        ) from error
    P, relative = refined(np.asarray(P), newton, residual)
    K = gain(P)
    A_cd = Ad - Bd @ K
    eigenvalues = linalg.eigvals(A_cd)
    eigenvalues = eigenvalues[np.lexsort((-eigenvalues.imag, np.round(np.abs(eigenvalues), 12)))]
    if not relative <= RESIDUAL_LIMIT or np.abs(eigenvalues[-1]) >= 1.0:
        raise LqError(
            f"at a period of {period:g} s the sampled Riccati equation was solved to {relative:.1e} |P| only, with the"
            f" largest closed-loop eigenvalue at magnitude {np.abs(eigenvalues[-1]):.6g}; change the period or the"
            " weights"
        )
    return SampledLq(
        period=period,
        Ad=Ad,
        Bd=Bd,
        Ed=Ed,
        Qd=Qd,
        Nd=Nd,
        Rd=Rd,
        N_xw=cost[x, w],
        N_uw=cost[u, w],
        Q2d=cost[w, w],
        P=P,
        K=K,
        A_cd=A_cd,
        Rb=weight(P),
        eigenvalues=eigenvalues,
        residual=relative,
        plant=plant,
        index=index,
    )


def sampled_costs(plant: LinearPlant, index: QuadraticIndex, period: float) -> tuple[Array, Array]:
    """exp(Z T) and the integral of exp(Z' s) W exp(Z s) over [0, T] for z = [x, u, w], dz/dt = Z z with u, w held.

    Van Loan's method on a step short enough that exp(-Z' s) stays harmless, doubled until it covers the period.
    """
    n, nu = plant.B.shape
    size = n + nu + plant.E.shape[1]
    Z = np.zeros((size, size))
    Z[:n] = np.hstack([plant.A, plant.B, plant.E])
    W = np.block(
        [[index.Q1, index.N, index.Q12], [index.N.T, index.R, index.Nuw], [index.Q12.T, index.Nuw.T, index.Q2]]
    )
    balanced = linalg.matrix_balance(plant.A, permute=False)[0]
    doublings = max(0, int(np.ceil(np.log2(max(linalg.norm(balanced, 2) * period, 1e-300)))))
    short = period / 2**doublings
    blocks = linalg.expm(np.block([[-Z.T, W], [np.zeros_like(Z), Z]]) * short)
    step = blocks[size:, size:]
    cost = even(step.T @ blocks[:size, size:])
    for _ in range(doublings):
        cost = even(cost + step.T @ cost @ step)
        step = step @ step
    return step, cost
