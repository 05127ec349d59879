"""Nonlinear least squares where a Jacobian is exact and costs as much as several values, as of a run.

Damped Gauss-Newton steps within bounds. A Jacobian serves as long as its steps lower the sum of squares: in a first fit
it follows the values that it leads to, and where it fails, it is computed again. The point that the fit ends at is run
once, with its derivatives.
Source: Marquardt, J. SIAM 11 (1963) 431; Broyden, Math. Comp. 19 (1965) 577.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cosim.core.signals import Array

OUTLYING = 2.0  # residuals over the noise, beyond which they count less in the first fit
COARSE, FINE = 1e-3, 0.01  # decrease at which a fit ends: of the sum of squares, and of one mean square residual
DAMPING, LEAST, RAISED = 1e-2, 1e-4, 10.0  # of a step, relative to the diagonal; factor after a step that fails
STEPS = 100  # of a fit, for each parameter


@dataclass(frozen=True)
class Minimum:
    """Where a fit ended: point (n,), residuals (m,) and their derivatives (m, n) there; whether it converged."""

    x: Array
    residuals: Array
    jacobian: Array
    converged: bool


def minimize_squares(
    residuals: Callable[[Array], Array],
    with_jacobian: Callable[[Array], tuple[Array, Array]],
    x: Array,
    low: Array,
    high: Array,
) -> Minimum:
    """Minimize the sum of squares of residuals over their noise, from `x` and within bounds (n,).

    Derivatives do not see single samples that jump, as at the touch-down of a tire. In a first fit residuals beyond
    `OUTLYING` count by their magnitude. The second one ends where no step is expected to lower the sum of squares by
    more than `FINE` of a mean square residual, hence within a tenth of a standard deviation.

    Args:
        residuals: at a point (n,), values (m,).
        with_jacobian: at a point, values (m,) and their derivatives (m, n).
        x: point that the fit begins at, within the bounds.
        low: bounds below.
        high: bounds above.
    """
    r, jacobian = with_jacobian(x)
    exact, step_is_small = True, False
    for outlying, least_gain in ((OUTLYING, COARSE), (None, FINE / len(r))):
        total, weights = _loss(r, outlying)
        damping, raised = DAMPING, RAISED
        for _ in range(STEPS * len(x)):
            step, gain = _step(r, jacobian, weights, damping, low - x, high - x)
            step_is_small = gain <= least_gain * total
            if step_is_small and (exact or outlying is not None):
                break
            trial = with_jacobian(x + step) if step_is_small else (residuals(x + step), None)
            at_trial, weights_there = _loss(trial[0], outlying)
            if at_trial < total * (1.0 + least_gain * step_is_small):
                if trial[1] is not None:
                    jacobian = trial[1]
                elif outlying is not None:
                    along = step * np.square(jacobian).sum(axis=0)
                    jacobian = jacobian + np.outer(trial[0] - r - jacobian @ step, along) / (step @ along)
                share = (total - at_trial) / gain if gain > 0.0 else 1.0  # 0 where all are held at bounds
                exact, raised = step_is_small, RAISED
                damping = max(damping / RAISED, LEAST) if share > 0.75 else damping if share > 0.25 else 4.0 * damping
                x, r, total, weights = x + step, trial[0], at_trial, weights_there
            elif exact:
                damping, raised = damping * raised, raised * RAISED
            else:
                r, jacobian = with_jacobian(x)
                exact = True
    if not exact:
        r, jacobian = with_jacobian(x)
    return Minimum(x, r, jacobian, step_is_small)


def _loss(r: Array, outlying: float | None) -> tuple[float, Array]:
    """Sum of squares of residuals (m,), and the weight of each (m,); beyond `outlying` a residual counts linearly."""
    if outlying is None:
        return float(r @ r), np.ones_like(r)
    root = np.sqrt(1.0 + np.square(r / outlying))
    return float((2.0 * np.square(r) / (1.0 + root)).sum()), 1.0 / root


def _step(r: Array, jacobian: Array, weights: Array, damping: float, low: Array, high: Array) -> tuple[Array, float]:
    """The damped step (n,) within bounds on it (n,), and by how much it lowers the linearized sum of squares."""
    square, slope = jacobian.T @ (weights[:, None] * jacobian), jacobian.T @ (weights * r)
    size = np.diag(square)
    damped = square + damping * np.diag(np.maximum(size, 1e-12 * (size.max() or 1.0)))
    step = np.zeros_like(slope)
    free = ~((low >= 0.0) & (slope > 0.0) | (high <= 0.0) & (slope < 0.0))
    while free.any():
        held = damped[:, ~free] @ step[~free]
        step[free] = np.linalg.solve(damped[np.ix_(free, free)], -(slope + held)[free])
        beyond = free & ((step < low) | (step > high))
        if not beyond.any():
            break
        step, free = np.where(beyond, np.clip(step, low, high), step), free & ~beyond
    return step, float(-(2.0 * slope + square @ step) @ step)
