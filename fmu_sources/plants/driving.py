"""What a driver moves, and what it moves: steering wheel, pedals, powertrain and brakes of the full cars.

`driver.mode` chooses between the internal driver of a car and these inputs. Torques are those of all losses left out:
torque map over the mean speed of the driven wheels, differentials, brakes with a balance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.models.corners import Corner, Corners
from fmu_sources.plants.free_body import limit
from fmu_sources.plants.tables import check_increasing, linear_table

INTERNAL, EXTERNAL, WHEEL = 0, 1, 2
"""Values of `driver.mode`: the internal driver; wheel and pedals; the wheel, with the speed of the internal driver."""


@dataclass(frozen=True)
class Controls:
    """What a driver moves.

    Attributes:
        wheel: angle of the steering wheel [rad].
        throttle, brake: from 0 to 1.
        steers, drives: whether the wheel and whether the pedals act.
    """

    wheel: Any
    throttle: Any
    brake: Any
    steers: Any
    drives: Any


def control_inputs(c: Component) -> Controls:
    """Declare steering wheel, throttle and brake, and the parameter `driver.mode`."""
    mode = c.parameter(
        "driver.mode",
        INTERNAL,
        "1",
        "0: the internal driver keeps target.speed and target.y; 1: steering.wheel, throttle and brake drive; 2:"
        " steering.wheel steers, and the internal driver keeps target.speed",
        min=INTERNAL,
        max=WHEEL,
        source="option",
    )
    wheel = c.input(
        "steering.wheel",
        "rad",
        "angle of the steering wheel, positive left (driver.mode 1 and 2)",
        min=-50.0,
        max=50.0,
        display_unit="deg",
        optional=True,
    )
    throttle, brake = (
        c.input(name, "1", f"{name} pedal, 1: all the way down (driver.mode 1)", min=0.0, max=1.0, optional=True)
        for name in ("throttle", "brake")
    )
    return Controls(wheel, throttle, brake, mode > 0.5, ca.logic_and(mode > 0.5, mode < 1.5))


def nominal_angle(p: Any, controls: Controls) -> Any:
    """The steer angle [rad] that a linkage without differences left and right has."""
    return limit(controls.wheel / p.steering.ratio, p.steering.max_angle)


def pedal_torques(c: Component, p: Any, controls: Controls, corners: Corners, radius: Any, low_speed: Any) -> None:
    """Give every corner `pedals`: the torque [N.m] of powertrain and brakes on its wheel.

    Differentials are open, and split the torque by `powertrain.front_share`; their power is that of the torque at the
    mean speed. Locks add torques that only take energy. Brakes act against the spin with a smooth sign, tanh(spin
    radius / low_speed): they do not chatter at standstill, and do not hold the car there.
    """
    check_increasing(c, p.powertrain.speed, "powertrain.speed")
    share = p.powertrain.front_share
    fl, fr, rl, rr = corners.all("spin")
    front, rear = (fl + fr) / 2, (rl + rr) / 2
    mean = share * front + (1 - share) * rear
    engine = controls.throttle * linear_table(ca.fmax(0, mean), p.powertrain.speed, p.powertrain.torque, beyond=False)
    braking = controls.brake * p.brakes.max_torque
    center = p.powertrain.center_lock * (front - rear)
    for k in corners:
        at_front = k.axle == "front"
        driven, braked = (s if at_front else 1 - s for s in (share, p.brakes.front_share))
        lock = p.powertrain.front_lock if at_front else p.powertrain.rear_lock
        locked = lock * (k.spin - opposite(corners, k).spin) + (center if at_front else -center) / 2
        against = ca.tanh(k.spin * radius / low_speed)
        k.pedals = c.value(
            f"pedal_torque_{k}",
            engine * driven / 2 - locked - braking * braked / 2 * against,
            source="torque map, differentials, brakes",
        )


def antiroll_force(p: Any, corners: Corners, k: Corner, travel: str) -> Any:
    """Force [N] of the anti-roll bar against the travel of a corner, by the name of the travel [m]."""
    return getattr(p.antiroll, k.axle) * (getattr(k, travel) - getattr(opposite(corners, k), travel))


def opposite(corners: Corners, k: Corner) -> Corner:
    """The other corner of the axle."""
    return corners[k.place ^ 1]


DRIVING_NOTES = (
    (
        "driver.mode 1 gives the car to steering.wheel, throttle and brake, mode 2 only to steering.wheel: the internal"
        " driver keeps the speed, as tests at constant speed need it. In mode 0 these inputs do nothing. Values beyond"
        " their range are limited, with one warning; a value that is not finite ends the run with an error. An input"
        " whose source is lost keeps its last value, as FMI has it: who drives by a gamepad decides there what a lost"
        " one means."
    ),
    (
        "Powertrain: the torque of all wheels over the mean speed of the driven ones, times throttle, without gears,"
        " engine brake and reverse. Differentials are open; powertrain.*_lock makes them stiff in proportion to the"
        " difference of speeds. brake is split by brakes.front_share; there is no ABS and no traction control. The sign"
        " of the brakes is smooth below 1 m/s of wheel speed, so that nothing chatters at standstill, and brakes do not"
        " hold the car on a slope. Anti-roll bars (antiroll.*) are off by default; at initialization on a twisted road"
        " they are not counted."
    ),
)
