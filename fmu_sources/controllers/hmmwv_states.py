"""The relative states that the HMMWV's controllers and its estimator share (paper 001), and the car's model in them.

Suspension and tyre deflections instead of heights: nothing that a vehicle can measure tells where the datum of the road
is. With the road's rates w and the actuator forces u,

    dx/dt = A x + B u + E w,    y = C x + D u + F w

is derived from the declaration of the car (:meth:`Component.linearize`), whose 14 states are absolute:
``x = T x_absolute + R height``. The 15 relative states are one more than those because the four road heights have a
warp that no motion of the car can take up: on a flat road the relative states stay in the 14-dimensional range of T.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component

CORNERS = ("fl", "fr", "rl", "rr")
SUSPENSION = tuple(f"suspension.{k}.deflection" for k in CORNERS)  # m, body minus wheel
TIRE = tuple(f"tire.{k}.deflection" for k in CORNERS)  # m, wheel minus road
WHEEL_SPEED = tuple(f"wheel.{k}.vz" for k in CORNERS)  # m/s
BODY_SPEED = ("body.vz", "body.roll_rate", "body.pitch_rate")  # m/s, rad/s, rad/s
RELATIVE_STATES = (*SUSPENSION, *TIRE, *WHEEL_SPEED, *BODY_SPEED)
"""Names and order of the 15 states: 4 suspension and 4 tyre deflections, 4 wheel and 3 body velocities."""

FORCES = tuple(f"force.{k}" for k in CORNERS)
ROAD_HEIGHTS = tuple(f"road.{k}.height" for k in CORNERS)
ROAD_RATES = tuple(f"road.{k}.rate" for k in CORNERS)
FORCE_LIMIT = 8000.0  # N, 001 Table 1.3

_TOLERANCE = 1e-9  # of the largest element; what is left of a product that should cancel


@dataclass(frozen=True)
class RelativeModel:
    """The car in relative states; rows and columns in the order of the names in this module.

    ``A`` (15, 15), ``B`` (15, 4) forces, ``E`` (15, 4) road rates; ``T`` (15, n) and ``R`` (15, 4) map the car's own n
    states (``absolute``) and the road heights: ``x = T x_absolute + R height``.
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    T: np.ndarray
    R: np.ndarray
    absolute: tuple[str, ...]
    car: Component

    def output(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``C`` (m, 15), ``D`` (m, 4), ``F`` (m, 4) of outputs of the car by name: ``y = C x + D u + F w``.

        Raises:
            ValueError: no output of the car, or one that the relative states do not determine (an absolute height).
        """
        lin = self.car.linearize()
        rows = [_position(lin.outputs, n, f"output of {self.car.name}") for n in names]
        u, h, w = (_columns(lin.inputs, group, self.car.name) for group in (FORCES, ROAD_HEIGHTS, ROAD_RATES))
        C, left_over = _in_relative(np.hstack([lin.C[rows], lin.D[np.ix_(rows, h)]]), np.hstack([self.T, self.R]))
        hidden = [n for n, bad in zip(names, left_over, strict=True) if bad]
        if hidden:
            raise ValueError(f"the relative states do not determine {', '.join(hidden)} of {self.car.name}")
        return C, lin.D[np.ix_(rows, u)], lin.D[np.ix_(rows, w)]


def relative_model(car: Component) -> RelativeModel:
    """The linear model of a four-wheeled ride car in :data:`RELATIVE_STATES`.

    Raises:
        ValueError: an output or input that is missing; a car whose relative motion depends on absolute heights.
    """
    lin = car.linearize()
    rows = [_position(lin.outputs, n, f"output of {car.name}") for n in RELATIVE_STATES]
    u, h, w = (_columns(lin.inputs, group, car.name) for group in (FORCES, ROAD_HEIGHTS, ROAD_RATES))
    T, R = lin.C[rows], lin.D[np.ix_(rows, h)]
    A, left_over = _in_relative(np.hstack([T @ lin.A, T @ lin.B[:, h]]), np.hstack([T, R]))
    if left_over.any():
        bad = [n for n, b in zip(RELATIVE_STATES, left_over, strict=True) if b]
        raise ValueError(f"{car.name}: {', '.join(bad)} depends on absolute heights, not on relative states alone")
    B, E = T @ lin.B[:, u], T @ lin.B[:, w] + R
    return RelativeModel(A, B, E, T, R, tuple(lin.states), car)


def relative_inputs(c: Component, car: Component) -> Any:
    """Declare the 15 relative states as inputs of ``c``, named and described as on the car; their column (15, 1)."""
    symbols = []
    for name in RELATIVE_STATES:
        v = car.variable(name)
        symbols.append(c.input(name, v.unit, v.description, nominal=v.nominal, display_unit=v.display_unit))
    return ca.vertcat(*symbols)


def force_outputs(c: Component, forces: Sequence[Any]) -> None:
    """What every higher-level controller of this car has beside its law: ``body.az`` among the inputs, forces within a limit.

    ``forces``: expressions in the order of :data:`FORCES`.
    """
    if "body.az" not in {v.name for v in c.all_variables}:
        c.input("body.az", "m/s2", "vertical acceleration of the CG")
    limit = c.parameter(
        "force.limit", FORCE_LIMIT, "N", "largest force of an actuator that is asked for", min=0.0, max=1e6, tunable=True,
        display_unit="kN", source="001 Table 1.3",
    )  # fmt: skip
    for name, corner, value in zip(FORCES, CORNERS, forces, strict=True):
        c.output(
            name, ca.fmin(ca.fmax(value, -limit), limit), "N", f"force that the actuator at {corner} is to give, positive lifts the body",
            display_unit="kN",
        )  # fmt: skip
    c.output(
        "force.limited",
        ca.mmax(ca.fabs(ca.vertcat(*forces))) > limit,
        None,
        "a force is cut off at force.limit",
        type=bool,
    )


def sines(amplitudes: Mapping[str, float]) -> dict[str, Callable[[float], float]]:
    """Stimulus of a controller: each input a sine of its own frequency, 0.6 Hz and up."""

    def wave(amplitude: float, rate: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(rate * t + phase)

    return {n: wave(a, 4.0 + i, 0.4 * i) for i, (n, a) in enumerate(amplitudes.items())}


def _in_relative(rows: np.ndarray, basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """X with ``X basis = rows``, rounding removed, and for each row whether there is none (boolean)."""
    X = np.linalg.lstsq(basis.T, rows.T, rcond=None)[0].T
    size = np.maximum(np.abs(rows).max(axis=1), 1e-300)
    X = np.where(np.abs(X) < _TOLERANCE * np.abs(X).max(axis=1, keepdims=True), 0.0, X)
    return X, np.abs(X @ basis - rows).max(axis=1) > 1e3 * _TOLERANCE * size


def _position(names: Sequence[str], name: str, what: str) -> int:
    try:
        return list(names).index(name)
    except ValueError:
        raise ValueError(f"no {what} is called {name!r}") from None


def _columns(names: Sequence[str], wanted: Sequence[str], car: str) -> list[int]:
    return [_position(names, n, f"input of {car}") for n in wanted]
