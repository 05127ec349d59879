"""Kalman filters for a car whose forces and accelerations are both measured: sampled models and their Riccati equation.

    x(k+1) = A x(k) + B u(k) + w(k),   y(k) = C x(k) + D u(k) + v(k),   cov (w, v) = [Q S; S' R]

S is not 0: load cells drive the model and reach the accelerometers at once, and so does the road's rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg


@dataclass(frozen=True)
class SampledModel:
    """Car and noise at one sample time [s].

    `E` and `F` are the effect of road rates that are held over a sample.
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    C: np.ndarray
    D: np.ndarray
    F: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    S: np.ndarray
    period: float


def sampled_model(
    A: np.ndarray,
    B: np.ndarray,
    E: np.ndarray,
    C: np.ndarray,
    D: np.ndarray,
    F: np.ndarray,
    *,
    measured: np.ndarray,
    force: float,
    road: float,
    period: float,
) -> SampledModel:
    """Sample `dx/dt = A x + B u + E w`, `y = C x + D u + F w` with u and w held.

    `measured`: standard deviations of y; `force`: that of the measured u; `road`: intensity of the white road
    rates w [m2/s], held over a sample with variance road / period.
    """
    n, m = A.shape[0], B.shape[1]
    block = np.zeros((n + m + E.shape[1],) * 2)
    block[:n, :n], block[:n, n : n + m], block[:n, n + m :] = A, B, E
    block = scipy.linalg.expm(block * period)
    Ad, Bd, Ed = block[:n, :n], block[:n, n : n + m], block[:n, n + m :]
    u, w = force**2, road / period
    Q = u * Bd @ Bd.T + w * Ed @ Ed.T
    S = u * Bd @ D.T + w * Ed @ F.T
    R = np.diag(measured**2) + u * D @ D.T + w * F @ F.T
    return SampledModel(Ad, Bd, Ed, C, D, F, Q, R, S, period)


@dataclass(frozen=True)
class Filter:
    """Correct, x += gain (y - C x - D u); then predict, x = A x + B u + Y y, with no cross-covariance left.

    `gain` and the covariance before a measurement (`prior`) are those of the steady state; `Q` is what the
    process noise leaves that the measurements do not share.
    """

    model: SampledModel
    A: np.ndarray
    B: np.ndarray
    Y: np.ndarray
    Q: np.ndarray
    gain: np.ndarray
    prior: np.ndarray


def kalman_filter(model: SampledModel) -> Filter:
    """The steady-state filter.

    Raises:
        ValueError: no stabilizing solution (a state that nothing measures, or noise that does not reach one).
    """
    m = model
    Y = np.linalg.solve(m.R, m.S.T).T
    A, Q = m.A - Y @ m.C, m.Q - Y @ m.S.T
    Q = (Q + Q.T) / 2
    try:
        prior = scipy.linalg.solve_discrete_are(m.A.T, m.C.T, m.Q, m.R, s=m.S)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ValueError(f"no steady-state Kalman filter: {error}") from None
    return Filter(m, A, m.B - Y @ m.D, Y, Q, correction(prior, m.C, m.R)[0], prior)


def correction(prior: np.ndarray, C: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gain of a measurement with noise R, and the covariance after it."""
    gain = np.linalg.solve(C @ prior @ C.T + R, C @ prior).T
    left = np.eye(len(prior)) - gain @ C
    return gain, left @ prior @ left.T + gain @ R @ gain.T
