"""What an accelerometer's place on the body moves like: the driver's seat of every car.

`seat.az` and `seat.ax` are kinematic: second derivatives of the height and of the position along the road of the
point of the body at `seat.x`, `seat.y`, `seat.z` from the CG, in the axes of the road, without gravity. At rest
both are 0. An accelerometer that is fixed to the seat shows these turned into its own axes, plus 1 g upwards.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from build_fmus.component import Component

SEAT_NOTE = (
    "seat.az and seat.ax are the acceleration of the driver's seat, at seat.x, seat.y, seat.z from the CG and fixed to"
    " the body: kinematic, in the axes of the road, without gravity (an accelerometer there also shows 1 g upwards, and"
    " turns with the body)."
)


def of_rigid_body(acceleration: Any, angular_acceleration: Any, angular_velocity: Any, arm: Any) -> Any:
    """Acceleration (3,) [m/s2] of a point at `arm` (3,) [m] from a point with known `acceleration` (3,).

    All are in the same axes.
    """
    centripetal = ca.cross(angular_velocity, ca.cross(angular_velocity, arm))
    return acceleration + ca.cross(angular_acceleration, arm) + centripetal


def seat_outputs(c: Component, ax: Any, az: Any) -> None:
    """Declare the outputs `seat.az` and `seat.ax` [m/s2]."""
    how = "of the driver's seat, road axes, without gravity"
    c.output("seat.az", az, "m/s2", f"vertical acceleration {how}")
    c.output("seat.ax", ax, "m/s2", f"longitudinal acceleration {how}")
