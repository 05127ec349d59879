"""The loop of a sampled controller and its plant, and means of squares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import linalg

from build_fmus.base.checks import number, whole_number
from fmu_sources.controllers.design_checks import Array
from fmu_sources.controllers.lq.design.matrices import matrix
from fmu_sources.controllers.lq.design.plant import LinearPlant


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
