"""A car's body with six degrees of freedom, and its drive: the common part of nonlinear full cars.

Suspensions are not in it. Axes are ISO 8855: x forward, y left, z up; roll positive left side up, pitch positive nose
down, yaw positive to the left. Velocities of the CG are in road axes, rates about body axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sin
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.models.corners import Corners
from fmu_sources.plants.seat import of_rigid_body, seat_outputs

LOW_SPEED = 1.0  # m/s; below it slip is formed with this speed, so that slip exists and decays at standstill
MAX_SPEED = 60.0  # m/s; the driver model keeps the car straight up to here
_AXES = ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class FreeBody:
    """States of a body, and what follows from them. Vectors are (3,), in road axes unless said otherwise.

    Attributes:
        x, y: position of the CG on the road [m].
        z: height of the CG above its static position [m].
        angles: roll, pitch, yaw [rad].
        velocity: of the CG [m/s], part by part a state.
        rates: about the body axes [rad/s].
        turn: rotation from body axes to road axes (3, 3).
        ahead, left: where the yaw angle points, and to its left.
        yaw_velocity: rate of the yaw angle [rad/s].
    """

    x: Any
    y: Any
    z: Any
    angles: tuple[Any, Any, Any]
    velocity: tuple[Any, Any, Any]
    rates: tuple[Any, Any, Any]
    turn: Any
    ahead: Any
    left: Any
    yaw_velocity: Any

    @property
    def speed(self) -> Any:
        """Forward speed of the CG [m/s]."""
        return ca.dot(ca.vertcat(*self.velocity), self.ahead)


def road_and_force_inputs(c: Component, corners: Corners) -> None:
    """Declare height and slope of the road under each wheel and the force of each actuator.

    They are `road`, `slope` and `force` of a corner.
    """
    lifts = "positive lifts the body and pushes the wheel down"
    corners.each(
        road=lambda k: c.input(f"road.{k}.height", "m", f"road height under the {k} wheel"),
        slope=lambda k: c.input(f"road.{k}.slope", "1", f"slope dz/dx of the road under the {k} wheel"),
        force=lambda k: c.input(f"force.{k}", "N", f"actuator force at {k}, {lifts}"),
    )


def driver_inputs(c: Component) -> tuple[Any, Any]:
    """Declare the speed [m/s] and the lateral position [m] that the driver keeps."""
    speed = c.input(
        "target.speed",
        "m/s",
        "speed the driver keeps; its first value is the start speed",
        start=50.0 / 3.6,
        min=0.0,
        max=MAX_SPEED,
        display_unit="km/h",
    )
    return speed, c.input("target.y", "m", "lateral position the driver keeps, positive left", min=-1e6, max=1e6)


def start_position(c: Component) -> Any:
    """Declare the parameter `start.x` [m]."""
    return c.parameter("start.x", 5.0, "m", "position of the CG at the start", min=-1e6, max=1e6, source="assumed")


def body_states(c: Component, x: Any, z: Any, roll: Any, pitch: Any, speed: Any) -> FreeBody:
    """Declare the states of a body.

    It starts at `x` and `z` [m], `roll` and `pitch` [rad], with `speed` [m/s] along the road.
    """
    at = c.state("x", "m", "distance of the CG along the road", start=x, output=True, nominal=10.0)
    beside = c.state("y", "m", "lateral position of the CG, positive left", output=True)
    height = c.state("body.z", "m", "CG height above its static position", start=z, output=True, nominal=0.1)
    angle: dict[str, Any] = {"output": True, "nominal": 0.1, "display_unit": "deg"}
    roll = c.state("body.roll", "rad", "roll angle, positive left side up", start=roll, **angle)
    pitch = c.state("body.pitch", "rad", "pitch angle, positive nose down", start=pitch, **angle)
    yaw = c.state("body.yaw", "rad", "yaw angle, positive to the left", **angle)
    vx = c.state("body.vx", "m/s", "velocity of the CG along the road", start=speed, nominal=10.0)
    vy = c.state("body.vy", "m/s", "lateral velocity of the CG in road axes")
    vz = c.state("body.vz", "m/s", "vertical velocity of the CG", output=True)
    p, q, r = (
        c.state(f"body.{axis}_rate", "rad/s", f"{axis} rate about the body axis", output=True, nominal=0.1)
        for axis in _AXES
    )
    turn = rotation(yaw, pitch, roll)
    ahead, left = ca.vertcat(ca.cos(yaw), ca.sin(yaw), 0), ca.vertcat(-ca.sin(yaw), ca.cos(yaw), 0)
    yaw_velocity = (q * ca.sin(roll) + r * ca.cos(roll)) / ca.cos(pitch)
    return FreeBody(at, beside, height, (roll, pitch, yaw), (vx, vy, vz), (p, q, r), turn, ahead, left, yaw_velocity)


def course_steering(gains: Any, body: FreeBody, target_y: Any) -> Any:
    """The driver's steering angle [rad] toward `target_y` [m].

    `gains` are parameters of lateral offset, heading and yaw rate.
    """
    course = gains.offset_gain * (target_y - body.y) - gains.heading_gain * body.angles[2]
    return limit(course - gains.yaw_rate_gain * body.yaw_velocity, gains.max_angle)


def body_motion(c: Component, body: FreeBody, acceleration: Any, angular: Any, sources: tuple[str, str]) -> None:
    """Declare the derivatives of a body's states.

    Args:
        c: the component.
        body: its states.
        acceleration: of the CG (3,) [m/s2], road axes.
        angular: acceleration (3,) [rad/s2] about the body axes.
        sources: where the one and the other come from.
    """
    (roll, pitch, yaw), (p, q, r) = body.angles, body.rates
    c.derivative(body.x, body.velocity[0])
    c.derivative(body.y, body.velocity[1])
    c.derivative(body.z, body.velocity[2])
    c.derivative(roll, p + ca.sin(pitch) * body.yaw_velocity)
    c.derivative(pitch, q * ca.cos(roll) - r * ca.sin(roll))
    c.derivative(yaw, body.yaw_velocity)
    for states, values, source in zip((body.velocity, body.rates), (acceleration, angular), sources, strict=True):
        for state, value in zip(states, ca.vertsplit(values), strict=True):
            c.derivative(state, value, source=source)


def body_outputs(c: Component, body: FreeBody, acceleration: Any, angular: Any, omega: Any, seat: Any) -> None:
    """Declare speed, accelerations of the CG and about the body axes, and those at the driver's seat.

    Args:
        c: the component.
        body: its states.
        acceleration: as in `body_motion`.
        angular: as in `body_motion`.
        omega: angular velocity (3,) [rad/s], road axes.
        seat: parameters with the seat's position from the CG.
    """
    c.output("speed", body.speed, "m/s", "forward speed of the CG", display_unit="km/h")
    c.output("body.ax", ca.dot(acceleration, body.ahead), "m/s2", "horizontal acceleration of the CG, forward")
    c.output("body.ay", ca.dot(acceleration, body.left), "m/s2", "horizontal acceleration of the CG, to the left")
    c.output("body.az", acceleration[2], "m/s2", "vertical acceleration of the CG")
    for i, axis in enumerate(_AXES):
        c.output(f"body.{axis}_acceleration", angular[i], "rad/s2", f"{axis} acceleration about the body axis")
    at_seat = of_rigid_body(acceleration, body.turn @ angular, omega, body.turn @ ca.vertcat(seat.x, seat.y, seat.z))
    seat_outputs(c, at_seat[0], at_seat[2])


def rotation(yaw: Any, pitch: Any, roll: Any) -> Any:
    """Rotation matrix from body to road axes: yaw, then pitch, then roll (ISO 8855)."""
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (ca.cos, ca.sin))
    return ca.vertcat(
        ca.horzcat(cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        ca.horzcat(sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        ca.horzcat(-sp, cp * sr, cp * cr),
    )


def limit(value: Any, bound: Any) -> Any:
    """A value between minus and plus a bound."""
    return ca.fmax(-bound, ca.fmin(bound, value))


def bump(at: float, height: float) -> Any:
    """A bump over a tenth of a second from `at` [s], as a function of time."""
    return lambda t: height * sin(pi * (t - at) / 0.1) ** 2 if at <= t < at + 0.1 else 0.0


def rough_patch() -> dict[str, Any]:
    """A rough patch taken at an angle, some actuator work and a little steering, for the reference result."""
    return {
        "target.speed": lambda t: 15.0 if t < 0.05 else 16.0,
        "target.y": lambda t: 0.0 if t < 0.02 else 0.3,
        "road.fl.height": bump(0.02, 0.04),
        "road.fr.height": bump(0.03, 0.05),
        "road.rl.height": bump(0.08, 0.04),
        "road.rr.height": bump(0.09, 0.05),
        "road.fl.slope": lambda t: 0.05 * sin(2 * pi * 8 * t),
        "force.fl": lambda t: 3000.0 * sin(2 * pi * 5 * t),
        "force.rr": lambda t: 2000.0 * sin(2 * pi * 3 * t),
    }
