"""Linear models of a car in relative states: deflections and velocities, not heights.

Nothing that a vehicle can measure tells where the datum of the road is. With the road's rates w and the actuator forces
u,

    dx/dt = A x + B u + E w,    y = C x + D u + F w

is derived from the declaration of the car (`Component.linearize`), whose own states are absolute:
`x = T x_absolute + R height`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from build_fmus.component import Component, Linearization

_TOLERANCE = 1e-9  # of the largest element; what is left of a product that should cancel


@dataclass(frozen=True)
class RelativeModel:
    """A car in n relative states; rows and columns in the order of the names it was made with.

    `A` (n, n), `B` (n, forces), `E` (n, road rates); `T` (n, its own states) and `R` (n, road heights) map
    the car's own states (`absolute`) and the road heights: `x = T x_absolute + R height`.
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    T: np.ndarray
    R: np.ndarray
    states: tuple[str, ...]
    forces: tuple[str, ...]
    heights: tuple[str, ...]
    rates: tuple[str, ...]
    absolute: tuple[str, ...]
    car: Component

    def output(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`C` (m, n), `D` (m, forces), `F` (m, rates) of outputs of the car by name: `y = C x + D u + F w`.

        Raises:
            ValueError: no output of the car, or one that the relative states do not determine (an absolute height).
        """
        lin = self.car.linearize()
        rows = _columns(lin.outputs, names, f"output of {self.car.name}")
        u, h, w = (
            _columns(lin.inputs, g, f"input of {self.car.name}") for g in (self.forces, self.heights, self.rates)
        )
        C, left_over = _in_relative(np.hstack([lin.C[rows], lin.D[np.ix_(rows, h)]]), np.hstack([self.T, self.R]))
        hidden = [n for n, bad in zip(names, left_over, strict=True) if bad]
        if hidden:
            raise ValueError(f"the relative states do not determine {', '.join(hidden)} of {self.car.name}")
        return C, lin.D[np.ix_(rows, u)], lin.D[np.ix_(rows, w)]

    def linearization(self, outputs: Sequence[str] = ()) -> Linearization:
        """The model with forces, then road rates as inputs; its states, then `outputs` of the car as outputs."""
        C, D, F = self.output(outputs)
        n, inputs = len(self.states), [*self.forces, *self.rates]
        return Linearization(
            self.A,
            np.hstack([self.B, self.E]),
            np.vstack([np.eye(n), C]),
            np.vstack([np.zeros((n, len(inputs))), np.hstack([D, F])]),
            list(self.states),
            inputs,
            [*self.states, *outputs],
        )


def relative_model(
    car: Component, states: Sequence[str], *, forces: Sequence[str], heights: Sequence[str], rates: Sequence[str]
) -> RelativeModel:
    """The linear model of `car` in `states`, which are outputs of it.

    Args:
        car: continuous component.
        states: names of the relative states; more than the car's own states are allowed where roads differ from wheel
            to wheel in a way that no motion of the car can follow.
        forces: names of its force inputs.
        heights: names of its inputs for road heights.
        rates: names of its inputs for their rates, in the same order.

    Raises:
        ValueError: an output or input that is missing; a car whose relative motion depends on absolute heights.
    """
    lin = car.linearize()
    rows = _columns(lin.outputs, states, f"output of {car.name}")
    u, h, w = (_columns(lin.inputs, group, f"input of {car.name}") for group in (forces, heights, rates))
    T, R = lin.C[rows], lin.D[np.ix_(rows, h)]
    A, left_over = _in_relative(np.hstack([T @ lin.A, T @ lin.B[:, h]]), np.hstack([T, R]))
    bad = [n for n, b in zip(states, left_over, strict=True) if b]
    if bad:
        raise ValueError(f"{car.name}: {', '.join(bad)} depends on absolute heights, not on relative states alone")
    direct = [n for n, row in zip(states, lin.D[np.ix_(rows, [*u, *w])], strict=True) if row.any()]
    if direct:
        raise ValueError(f"{car.name}: {', '.join(direct)} depends on inputs directly, so it is not a state")
    return RelativeModel(
        A,
        T @ lin.B[:, u],
        T @ lin.B[:, w] + R,
        T,
        R,
        tuple(states),
        tuple(forces),
        tuple(heights),
        tuple(rates),
        tuple(lin.states),
        car,
    )


def _in_relative(rows: np.ndarray, basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """X with `X basis = rows`, rounding removed, and for each row whether there is none (boolean)."""
    X = np.linalg.lstsq(basis.T, rows.T, rcond=None)[0].T
    size = np.maximum(np.abs(rows).max(axis=1, initial=0.0), 1e-300)
    X = np.where(np.abs(X) < _TOLERANCE * np.abs(X).max(axis=1, keepdims=True, initial=0.0), 0.0, X)
    return X, np.abs(X @ basis - rows).max(axis=1, initial=0.0) > 1e3 * _TOLERANCE * size


def _columns(names: Sequence[str], requested: Sequence[str], what: str) -> list[int]:
    known = list(names)
    missing = [n for n in requested if n not in known]
    if missing:
        raise ValueError(f"no {what} is called {missing[0]!r}")
    return [known.index(n) for n in requested]
