"""The interface of every ride car: inputs at the corners, and states and outputs of body and wheels.

These are heave, roll, pitch and wheels. The interface does not depend on the equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, sin
from typing import Any

from build_fmus.component import Component
from fmu_sources.models.corners import Corners
from fmu_sources.plants.seat import seat_outputs


def ride_inputs(c: Component, corners: Corners) -> None:
    """Declare, for each corner, `road` [m], `road_rate` [m/s] and `force` [N]."""
    lifts = "positive lifts the body and pushes the wheel down"
    corners.each(
        road=lambda k: c.input(f"road.{k}.height", "m", f"road height under the {k} wheel"),
        road_rate=lambda k: c.input(f"road.{k}.rate", "m/s", f"rate of the road height under the {k} wheel"),
        force=lambda k: c.input(f"force.{k}", "N", f"actuator force at {k}, {lifts}"),
    )


def ride_states(c: Component, corners: Corners) -> tuple[list[Any], list[Any]]:
    """Declare positions and their rates, which are outputs too.

    Positions are height [m], roll and pitch [rad] of the body, and heights of the wheels [m].
    """
    angle: dict[str, Any] = {"output": True, "nominal": 0.1, "display_unit": "deg"}
    turning: dict[str, Any] = {**angle, "display_unit": "deg/s"}
    positions = [
        c.state("body.z", "m", "CG height above static equilibrium", output=True, nominal=0.1),
        c.state("body.roll", "rad", "roll angle, positive left side up", **angle),
        c.state("body.pitch", "rad", "pitch angle, positive nose down", **angle),
        *(
            c.state(f"wheel.{k}.z", "m", "wheel height above static equilibrium", output=True, nominal=0.1)
            for k in corners
        ),
    ]
    rates = [
        c.state("body.vz", "m/s", "vertical velocity of the CG", output=True),
        c.state("body.roll_rate", "rad/s", "roll rate", **turning),
        c.state("body.pitch_rate", "rad/s", "pitch rate", **turning),
        *(c.state(f"wheel.{k}.vz", "m/s", "vertical velocity of the wheel", output=True) for k in corners),
    ]
    return positions, rates


def ride_outputs(c: Component, corners: Corners, acceleration: Sequence[Any], seat_ax: Any, seat_az: Any) -> None:
    """Declare accelerations (in the order of `ride_states`) and the outputs of corners.

    Those are `travel` and `travel_rate` of the suspension, `deflection` of the tire [m], and `tire_force` [N].
    """
    az, roll_acceleration, pitch_acceleration, *wheel_az = acceleration
    c.output("body.az", az, "m/s2", "vertical acceleration of the CG")
    c.output("body.roll_acceleration", roll_acceleration, "rad/s2", "roll acceleration", display_unit="deg/s2")
    c.output("body.pitch_acceleration", pitch_acceleration, "rad/s2", "pitch acceleration", display_unit="deg/s2")
    seat_outputs(c, seat_ax, seat_az)
    for k, value in zip(corners, wheel_az, strict=True):
        c.output(f"wheel.{k}.az", value, "m/s2", "vertical acceleration of the wheel")
    for k in corners:
        c.output(f"suspension.{k}.deflection", k.travel, "m", "body height minus wheel height", display_unit="mm")
    for k in corners:
        c.output(f"suspension.{k}.velocity", k.travel_rate, "m/s", "rate of the suspension deflection")
    for k in corners:
        c.output(f"tire.{k}.deflection", k.deflection, "m", "wheel height minus road height", display_unit="mm")
    for k in corners:
        c.output(
            f"tire.{k}.force",
            k.tire_force,
            "N",
            "tire force on the wheel, static load included",
            nominal=1e3,
            display_unit="kN",
        )


def bump_at_an_angle(corners: list[str]) -> dict[str, Any]:
    """A bump taken at an angle, and some actuator work, for the reference result."""

    def bump(at: float) -> tuple[Any, Any]:
        def inside(t: float) -> bool:
            return at <= t < at + 0.08

        w = pi / 0.08
        return (
            lambda t: 0.04 * sin(w * (t - at)) ** 2 if inside(t) else 0.0,
            lambda t: 0.04 * w * sin(2 * w * (t - at)) if inside(t) else 0.0,
        )

    signals: dict[str, Any] = {
        f"force.{corners[0]}": lambda t: 1000.0 * sin(2 * pi * 5 * t),
        f"force.{corners[-1]}": lambda t: -600.0 * sin(2 * pi * 3 * t),
    }
    for i, n in enumerate(corners):  # the right wheel 10 ms behind the left one, each axle 70 ms behind the one ahead
        signals[f"road.{n}.height"], signals[f"road.{n}.rate"] = bump(round(0.02 + 0.07 * (i // 2) + 0.01 * (i % 2), 2))
    return signals
