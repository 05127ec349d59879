"""Theorem 2 of paper 004, the loop of a sampled controller and its plant, and means of squares.

Theorem 2 is for an index in outputs with a known error; no component uses it. Where the print is incomplete or damaged,
this is what is implemented:

* (A5): N_d is C' Q1 D Rd^-1 N' + N Rd^-1 D' Q1 C + N Rd^-1 N'.
* (A6) is r = lambda - P x; the first term of (A9) is A_d' P; (A10) ends at r = -P x for a horizon without a terminal
  weight, hence at 0 in the limit of a long one; (21): K2 is -Rd^-1 B'.
* (20): w drives the states and v, the measurement error, enters y through F; Appendix A has the two names exchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import linalg

from build_fmus.base.checks import number, whole_number
from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.lq.design.continuous import ContinuousLq, continuous_lq
from fmu_sources.controllers.lq.design.matrices import even, matrix, scaled_lowest, symmetric
from fmu_sources.controllers.lq.design.plant import LinearPlant, QuadraticIndex, index_from_outputs


@dataclass(frozen=True, eq=False)
class OutputErrorLq:
    """Theorem 2: u = K1 x + K2 r + K3 v for an index in y = C x + D u + F v with a known error v. (A12), (21).

    r(t) is the integral over s from 0 on of exp(A_G' s) [road_drive w(t + s) + error_drive v(t + s)]; leave out what
    is not known ahead. `law` is the same law in the form of Theorem 1, its disturbances being [w, v].
    """

    K1: Array  # (nu, n)
    K2: Array  # (nu, n)
    K3: Array  # (nu, nv)
    P: Array
    A_d: Array  # (A5)
    B_d: Array
    C_d: Array
    R_d: Array
    A_G: Array  # (A11), the closed loop
    road_drive: Array  # (n, nw), of (A10)
    error_drive: Array  # (n, nv)
    residual: float  # |left side of (A9)| / |P|
    law: ContinuousLq


def theorem2_lq(
    plant: LinearPlant,
    Q1y: npt.ArrayLike,
    N: npt.ArrayLike,
    R: npt.ArrayLike,
    Q12: npt.ArrayLike,
    *,
    error: npt.ArrayLike | None = None,
    errors: Sequence[str] | None = None,
) -> OutputErrorLq:
    """Minimize the mean of y' Q1y y + 2 x' N u + u' R u + 2 x' Q12 w, (19), for y = C x + D u + F w + error v.

    `error` (ny, nv) is F of (20), the way of the measurement error v into y; without it there is no v. `plant.F`, the
    direct way of the road into y, is 0 in the paper and is allowed here. N (n, nu), R (nu, nu) and Q12 (n, nw).
    """
    n, nu, nw, ny = *plant.B.shape, plant.E.shape[1], len(plant.C)
    Q = symmetric("Q1y", matrix("Q1y", Q1y, (ny, ny), "outputs x outputs"))
    if scaled_lowest(Q) < -1e-10:
        raise ValueError(f"Q1y is not nonnegative definite: eigenvalue {linalg.eigvalsh(Q)[0]:.3g}")
    cross = matrix("N", N, (n, nu), "states x controls")
    R_own = symmetric("R", matrix("R", R, (nu, nu), "controls x controls"))
    Q12_own = matrix("Q12", Q12, (n, nw), "states x disturbances")
    F = matrix("error", np.zeros((ny, 0)) if error is None else error, (ny, None), "outputs x errors")
    nv = F.shape[1]
    names = tuple(f"error[{k + 1}]" for k in range(nv)) if errors is None else tuple(errors)
    if len(names) != nv:
        raise ValueError(f"errors has {len(names)} names; error has {nv} columns")

    both = LinearPlant(
        plant.A,
        plant.B,
        np.hstack([plant.E, np.zeros((n, nv))]),
        plant.C,
        plant.D,
        np.hstack([plant.F, F]),
        plant.states,
        plant.controls,
        (*plant.disturbances, *names),
        plant.outputs,
    )
    from_outputs = index_from_outputs(both, Q, R_own)
    index = QuadraticIndex(
        Q1=from_outputs.Q1,
        N=from_outputs.N + cross,
        R=from_outputs.R,
        Q12=from_outputs.Q12 + np.hstack([Q12_own, np.zeros((n, nv))]),
        Q2=from_outputs.Q2,
        Nuw=from_outputs.Nuw,
    )
    law = continuous_lq(both, index)
    R_d, B = index.R, plant.B
    R_d_inverse_N = linalg.solve(R_d, index.N.T, assume_a="pos")  # Rd^-1 (D' Q1y C + N')
    return OutputErrorLq(
        K1=-law.K,
        K2=-law.preview_gain,
        K3=law.direct[:, nw:],
        P=law.P,
        A_d=plant.A - B @ R_d_inverse_N,
        B_d=B @ law.preview_gain,
        C_d=even(index.Q1 - index.N @ R_d_inverse_N),
        R_d=R_d,
        A_G=law.A_c,
        road_drive=law.drive[:, :nw],
        error_drive=law.drive[:, nw:],
        residual=law.residual,
        law=law,
    )


@dataclass(frozen=True, eq=False)
class SampledRun:
    """Signals at the samples k period, k = 0 ... steps - 1, with the command and the disturbance held from there."""

    time: Array  # (steps,), s
    x: Array  # (steps, n)
    u: Array  # (steps, nu)
    w: Array  # (steps, nw)
    y: Array  # (steps, ny)
    x_end: Array  # (n,), the state one period after the last sample


def sampled_loop(
    plant: LinearPlant,
    period: float,
    w: npt.ArrayLike,
    *,
    K: npt.ArrayLike | None = None,
    feed_forward: npt.ArrayLike | Callable[[int], npt.ArrayLike] | None = None,
    x0: npt.ArrayLike | None = None,
    hold: int = 1,
) -> SampledRun:
    """The loop of a sampled controller and the continuous plant, exact at the samples.

    w (steps, nw) is held over each period. At every `hold`-th sample k the command becomes u = -K x_k + feed_forward,
    given as an array (steps, nu) or as a function of k; in between it is held. Without K and feed_forward the plant
    runs passive.
    """
    period, hold = number("period", period, "s", above=0), whole_number("hold", hold)
    n, nu = plant.B.shape
    road = matrix("w", w, (None, plant.E.shape[1]), "samples x disturbances")
    gain = matrix("K", np.zeros((nu, n)) if K is None else K, (nu, n), "controls x states")
    x = np.zeros(n) if x0 is None else matrix("x0", np.atleast_2d(x0), (1, n), "1 x states")[0]
    steps = len(road)
    ahead: Callable[[int], npt.ArrayLike]
    if callable(feed_forward):
        ahead = feed_forward
    else:
        table = np.zeros((steps, nu)) if feed_forward is None else feed_forward
        ahead = matrix("feed_forward", table, (steps, nu), "samples x controls").__getitem__

    Z = np.zeros((n + nu + road.shape[1],) * 2)
    Z[:n] = np.hstack([plant.A, plant.B, plant.E])
    step = linalg.expm(Z * period)[:n]
    xs, us = np.zeros((steps, n)), np.zeros((steps, nu))
    u = np.zeros(nu)
    for k in range(steps):
        if k % hold == 0:
            u = -gain @ x + np.asarray(ahead(k), dtype=float)
        xs[k], us[k] = x, u
        x = step @ np.concatenate([x, u, road[k]])
    y = xs @ plant.C.T + us @ plant.D.T + road @ plant.F.T
    return SampledRun(time=np.asarray(period * np.arange(steps), dtype=float), x=xs, u=us, w=road, y=y, x_end=x)


def mean_squares(samples: npt.ArrayLike) -> Array:
    """Mean of the square of each column of equally spaced samples, by the trapezoidal rule."""
    values = matrix("samples", samples, (None, None), "samples x signals")
    if len(values) < 2:
        raise ValueError(f"{len(values)} samples are given; a mean over time needs at least 2")
    return np.asarray(np.trapezoid(values**2, axis=0) / (len(values) - 1))
