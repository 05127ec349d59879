"""One step of each fixed-step solver, for any right-hand side: what `runtime/integrators.c` does, in Python.

The reference evaluation integrates with these steps, and the check of the solver step applies them to linear dynamics.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

RightHandSide = Callable[[float, np.ndarray], np.ndarray]
"""dx/dt = f(t, x)."""


def rk4(f: RightHandSide, t: float, x: np.ndarray, h: float) -> np.ndarray:
    """Classic fourth-order Runge-Kutta."""
    k1 = f(t, x)
    k2 = f(t + h / 2, x + h / 2 * k1)
    k3 = f(t + h / 2, x + h / 2 * k2)
    k4 = f(t + h, x + h * k3)
    return x + h / 6 * (k1 + 2 * (k2 + k3) + k4)


def am2(
    f: RightHandSide, t: float, x: np.ndarray, h: float, before: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Adams-Bashforth-2 predictor, Adams-Moulton-2 corrector: the new state, and the derivative for the next step.

    `before`: the derivative of the step before; None predicts with Euler, as after an exchange.
    """
    now = f(t, x)
    predicted = x + h * (now if before is None else 1.5 * now - 0.5 * before)
    return x + h / 2 * (now + f(t + h, predicted)), now


def semi_implicit(f: RightHandSide, t: float, x: np.ndarray, h: float, velocity_of: np.ndarray) -> np.ndarray:
    """Stoermer-Verlet: positions half a step, velocities by the midpoint rule, positions half a step.

    `velocity_of`: for each state the index of its derivative among the states, or -1.
    """
    moving = velocity_of >= 0

    def slope(x: np.ndarray) -> np.ndarray:
        dx = np.array(f(t + h / 2, x))
        dx[moving] = 0.0
        return dx

    x = x.copy()
    x[moving] += h / 2 * x[velocity_of[moving]]
    x = x + h * slope(x + h / 2 * slope(x))
    x[moving] += h / 2 * x[velocity_of[moving]]
    return x


def ros2(
    f: RightHandSide,
    jacobian: Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]],
    t: float,
    x: np.ndarray,
    h: float,
    nominal: np.ndarray,
) -> np.ndarray:
    """The Rosenbrock method ROS2, L-stable; states count in units of their nominal values.

    `jacobian`: the derivatives of f by x (n, n) and by t (n,).

    Raises:
        LinAlgError: the matrix of the method is singular.
    """
    gh = (1 - math.sqrt(0.5)) * h
    by_state, by_time = jacobian(t, x)
    matrix = np.eye(len(x)) - gh * by_state * nominal / nominal[:, None]
    by_time = gh * by_time / nominal
    k1 = np.linalg.solve(matrix, f(t, x) / nominal + by_time)
    ahead = f(t + h, x + h * nominal * k1) / nominal
    k2 = np.linalg.solve(matrix, ahead - 2 * k1 - by_time)
    return x + h / 2 * nominal * (3 * k1 + k2)
