"""The relative states that the HMMWV's controllers and its estimator share (paper 001), and the car's model in them.

The 15 relative states are one more than the car's own because the four road heights have a warp that no motion of the
car can follow: on a flat road the relative states stay in the 14-dimensional range of T (`.relative`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.models import relative
from fmu_sources.models.corners import CORNERS, TWO_AXLES, Corner, Corners
from fmu_sources.models.relative import RelativeModel

SUSPENSION = tuple(f"suspension.{k}.deflection" for k in CORNERS)  # m, body minus wheel
TIRE = tuple(f"tire.{k}.deflection" for k in CORNERS)  # m, wheel minus road
WHEEL_SPEED = tuple(f"wheel.{k}.vz" for k in CORNERS)  # m/s
BODY_SPEED = ("body.vz", "body.roll_rate", "body.pitch_rate")  # m/s, rad/s, rad/s
RELATIVE_STATES = (*SUSPENSION, *TIRE, *WHEEL_SPEED, *BODY_SPEED)
"""Names and order of the 15 states: 4 suspension and 4 tire deflections, 4 wheel and 3 body velocities."""

FORCES = tuple(f"force.{k}" for k in CORNERS)
ROAD_HEIGHTS = tuple(f"road.{k}.height" for k in CORNERS)
ROAD_RATES = tuple(f"road.{k}.rate" for k in CORNERS)
SAMPLE_TIME = 0.030  # s, of all higher-level controllers of paper 001 (section 1.4)
FORCE_LIMIT = 8000.0  # N, 001 Table 1.3


def relative_model(car: Component) -> RelativeModel:
    """The linear model of a four-wheeled ride car in `RELATIVE_STATES`.

    Raises:
        ValueError: an output or input that is missing; a car whose relative motion depends on absolute heights.
    """
    return relative.relative_model(car, RELATIVE_STATES, forces=FORCES, heights=ROAD_HEIGHTS, rates=ROAD_RATES)


def relative_inputs(c: Component, car: Component) -> Any:
    """Declare the 15 relative states as inputs of `c`, named and described as on the car; their column (15, 1)."""
    symbols = []
    for name in RELATIVE_STATES:
        v = car.variable(name)
        symbols.append(c.input(name, v.unit, v.description, nominal=v.nominal, display_unit=v.display_unit))
    return ca.vertcat(*symbols)


def car_parameter(car: Component, name: str) -> float:
    """The value of a parameter of a car."""
    start = car.variable(name).start
    assert start is not None  # parameters always have start values
    return float(start[0])


def car_corners(c: Component, car: Component) -> Corners:
    """Declare where the wheels are; corners with their `x` ahead of the CG and `half_track` to its side [m]."""
    corners = Corners(TWO_AXLES)
    for k in corners:
        for what, text, low in (
            ("x", "position ahead of the CG", -50.0),
            ("half_track", "distance from the middle", 0.0),
        ):
            name = f"wheel.{k}.{what}"
            start = car_parameter(car, name)
            about = f"{text} of the {k} wheel"
            setattr(k, what, c.parameter(name, start, "m", about, min=low, max=50.0, source="vehicle file"))
    return corners


def at_corner(k: Corner, heave: Any, roll: Any, pitch: Any) -> Any:
    """A rate of heave, roll and pitch of the body, as vertical rate of its corner."""
    return heave + k.side * k.half_track * roll - k.x * pitch


def force_outputs(c: Component, forces: Sequence[Any]) -> None:
    """Add what all higher-level controllers of this car have in common.

    `body.az` among the inputs, and forces within a limit. `forces`: expressions in the order of `FORCES`.
    """
    if not c.declares("body.az"):
        c.input("body.az", "m/s2", "vertical acceleration of the CG")
    limit = c.parameter(
        "force.limit",
        FORCE_LIMIT,
        "N",
        "largest requested force of an actuator",
        min=0.0,
        max=1e6,
        tunable=True,
        display_unit="kN",
        source="001 Table 1.3",
    )
    for name, corner, value in zip(FORCES, CORNERS, forces, strict=True):
        c.output(
            name,
            ca.fmin(ca.fmax(value, -limit), limit),
            "N",
            f"requested force of the actuator at {corner}, positive lifts the body",
            display_unit="kN",
        )
    c.output(
        "force.limited",
        ca.mmax(ca.fabs(ca.vertcat(*forces))) > limit,
        None,
        "a force is clipped at force.limit",
        type=bool,
    )


def usual_motion() -> dict[str, Callable[[float], float]]:
    """Reference inputs of a controller: all relative states, each as large as on a road."""
    sizes = {SUSPENSION: 0.02, TIRE: 0.005, WHEEL_SPEED: 0.5, BODY_SPEED: 0.3}
    return sines({name: size for names, size in sizes.items() for name in names})


def sines(amplitudes: Mapping[str, float]) -> dict[str, Callable[[float], float]]:
    """Reference inputs of a controller: each input is a sine of its own frequency, 0.6 Hz and up."""

    def wave(amplitude: float, rate: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(rate * t + phase)

    return {n: wave(a, 4.0 + i, 0.4 * i) for i, (n, a) in enumerate(amplitudes.items())}
