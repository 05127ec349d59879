"""Nonlinear full car: six-degree-of-freedom body, four wheel hops, four wheel spins, tires with slip lags.

Stand-in for the multi-body vehicle of paper 000. Axes are ISO 8855: x forward, y left, z up; roll positive left side
up, pitch positive nose down, yaw positive to the left. Forces come in pairs that do equal and opposite work on the two
bodies they join, so energy is only lost in dampers, tires and slip, and only gained from actuators and the driver.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.models.corners import TWO_AXLES, Corner, Corners
from fmu_sources.plants.driving import (
    DRIVING_NOTES,
    Controls,
    antiroll_force,
    control_inputs,
    nominal_angle,
    pedal_torques,
)
from fmu_sources.plants.free_body import (
    LOW_SPEED,
    body_motion,
    body_outputs,
    body_states,
    course_steering,
    driver_inputs,
    limit,
    road_and_force_inputs,
    rough_patch,
    start_position,
)
from fmu_sources.plants.gravity import gravity
from fmu_sources.plants.seat import SEAT_NOTE
from fmu_sources.registration import component
from fmu_sources.tires.magic_formula import Forces, tire_of
from fmu_sources.vehicles import FullCar, declare

EASE_SLIP, RELEASE_SLIP = 0.15, 0.30  # from this slip on the driver eases off, at that one torque is 0


@component("FullCar{v}", "nonlinear full car, vehicle file {file}", of="hmmwv hmmwv_modified hmmwv_tires")
def full_car(vehicle: FullCar, name: str = "FullCarHmmwv") -> Component:
    """Full car of a vehicle file; the structure is that of paper 000, section III (vehicle model).

    The springs are preloaded so that the given masses rest exactly at the given CG and hub heights: changing a mass
    changes the preload, not the ride height. All `z` count from that position on a road at height 0.
    """
    c = Component(
        name,
        kind="continuous",
        description=f"Full car, nonlinear, 6-DOF body, 4 wheel hops, 4 wheel spins, tire slip lags: {vehicle.name}",
        source="000 section III; derivation in the source of this component",
        solver="am2",
        solver_step=5e-4,
        notes=(*_NOTES, *DRIVING_NOTES, SEAT_NOTE),
    )
    p = declare(c, vehicle)
    tire = tire_of(c, vehicle.tire.file)
    start_x = start_position(c)
    g = gravity(c)
    low_speed = c.constant("low_speed", LOW_SPEED, "m/s", "below it slip is formed with this speed", source="assumed")
    corners = _corners(p, g)
    rigid = c.parameter(
        "wheel.rigid_body",
        0,
        "1",
        "1: wheels act on the body as rigid bodies on guides do: mass and its pull at the hubs, weight that leans out"
        " of a rolling or pitching body, gyroscopic moments; 0: their mass is horizontally at the CG",
        min=0,
        max=1,
        source="option",
    )

    def of_rigid(value: Any) -> Any:
        return ca.if_else(rigid > 0.5, value, 0)

    # ------------------------------------------------------------------------------------------------------ inputs

    road_and_force_inputs(c, corners)
    target_speed, target_y = driver_inputs(c)
    controls = control_inputs(c)

    # ------------------------------------------------------------------------------------------------------ states

    least = c.constant("least.stiffness", 1e-9, "N/m", "keeps roll at rest determined without any spring", source="own")
    rest = _equilibrium(corners, p, least)
    body = body_states(c, start_x, rest.z, rest.roll, rest.pitch, target_speed)
    shown: dict[str, Any] = {"output": True}
    start_spin = target_speed / p.wheel.radius
    corners.each(
        z=lambda k: c.state(
            f"wheel.{k}.z", "m", "wheel center above its static height", start=k.rest, nominal=0.1, **shown
        ),
        vz=lambda k: c.state(f"wheel.{k}.vz", "m/s", "vertical velocity of the wheel", **shown),
        spin=lambda k: c.state(
            f"wheel.{k}.spin", "rad/s", "spin, positive forward", start=start_spin, nominal=10.0, **shown
        ),
        slip_x=lambda k: c.state(f"tire.{k}.slip", "1", "lagged slip, positive driving", nominal=0.1),
        slip_y=lambda k: c.state(f"tire.{k}.slip_angle", "rad", "lagged slip angle, positive left", nominal=0.1),
    )
    speed_error = c.state("driver.speed_error", "m", "integral of the speed error")

    # -------------------------------------------------------------------------------------------------- kinematics

    turn = c.value("turn", body.turn, source="from body axes to road axes: yaw, pitch, roll (ISO 8855)")
    omega_body = ca.vertcat(*body.rates)
    omega = c.value("omega", turn @ omega_body, source="angular velocity, road axes")
    velocity = ca.vertcat(*body.velocity)
    ahead, left, up = body.ahead, body.left, ca.vertcat(0, 0, 1)

    # ------------------------------------------------------------------------------------------------------ driver

    total_mass = c.value("total_mass", p.body.mass + 4 * p.wheel.mass)
    error = target_speed - body.speed
    requested = p.speed_control.gain * error + p.speed_control.integral_gain * speed_error  # acceleration
    requested *= total_mass * p.wheel.radius / 4  # torque of each wheel
    limited = c.value(
        "driver_torque", limit(requested, p.speed_control.max_torque), source="driver: torque of each wheel"
    )
    course = course_steering(p.steering, body, target_y)
    c.value("steering_angle", course, source="driver: course")
    pedal_torques(c, p, controls, corners, p.wheel.radius, low_speed)
    c.check(
        ca.if_else(controls.steers, 1 - _narrower(p) * ca.tan(p.steering.max_angle), 1),
        "steering.max_angle would bring the center of turn between the wheels: make it or steering.ackermann smaller",
    )

    # ------------------------------------------------------------------------------------ forces, corner by corner

    for k in corners:
        # Points of the body: where the strut acts, beside the hub, and above the contact patch. The strut acts at CG
        # height, which leaves the weight no lever arm when the body pitches.
        k.top = turn @ ca.vertcat(k.x, k.y, 0)
        k.hub = turn @ ca.vertcat(k.x, k.y, p.wheel.hub_height - p.body.cg_height)
        k.patch = turn @ ca.vertcat(k.x, k.y, -p.body.cg_height)
        k.patch += of_rigid(k.road - p.body.cg_height - body.z - k.patch[2]) * up  # on the road
        for point, of in ((k.top, "strut"), (k.hub, "hub"), (k.patch, "patch")):
            c.value(f"{of}_{k}", point, source=f"{of} {k} from the CG, road axes")
        k.travel = body.z + k.top[2] - k.z
        k.travel_rate = body.velocity[2] + ca.cross(omega, k.top)[2] - k.vz
    for k in corners:
        top, hub, patch = k.top, k.hub, k.patch

        # Strut: preload, spring and damper through the motion ratio, stops, actuator, anti-roll bar; vertical, equal
        # and opposite.
        strut = (
            k.static_load
            - p.suspension.motion_ratio**2 * (k.strut.spring * k.travel + k.strut.damper * k.travel_rate)
            - _stop(k.travel, p.suspension.stop)
            + k.force
            - antiroll_force(p, corners, k, "travel")
        )
        c.value(
            f"strut_force_{k}",
            strut,
            source="preload, spring and damper through the motion ratio, stops, actuator, bar",
        )

        # Tire, vertical: the road rises under the moving wheel with slope x speed; a tire takes no tension.
        hub_velocity = velocity + ca.cross(omega, hub)
        c.value(f"hub_velocity_{k}", hub_velocity)
        gradient = limit(k.slope, 1.0)
        static = k.static_load + p.wheel.mass * g
        compression, compression_rate = k.road - k.z, gradient * hub_velocity[0] - k.vz
        k.load = ca.fmax(0, static + p.tire.stiffness * compression + p.tire.damping * compression_rate)

        # Tire, horizontal: slips lag by a relaxation length.
        steer = ca.if_else(controls.steers, _steer_angle(p, controls, k), course) if k.steered else 0
        forward = ca.cos(steer) * ahead + ca.sin(steer) * left if k.steered else ahead
        sideways = ca.cos(steer) * left - ca.sin(steer) * ahead if k.steered else left
        rolling = ca.dot(hub_velocity, forward)
        sliding = ca.dot(velocity + ca.cross(omega, patch), sideways)
        pace = ca.sqrt(rolling**2 + low_speed**2)
        on_road = k.spin * p.wheel.radius - rolling  # what slides backwards [m/s]
        if tire is None:
            ground, law = _within_ellipse(p.tire, k), "grows with slip and load up to the friction ellipse"
        else:
            ground = tire.forces(k.load, k.slip_x, -k.slip_y, body.angles[0], rolling, k.side)
            ground = tire.parked(ground, k.load, rolling, -on_road, sliding)
            law = "Magic Formula"
        k.slip_x_rate = (on_road - pace * k.slip_x) / ground.relaxation_x
        k.slip_y_rate = (-sliding - pace * k.slip_y) / ground.relaxation_y
        drive, corner = ground.fx, ground.fy
        c.value(f"drive_force_{k}", drive, source=law)
        c.value(f"side_force_{k}", corner, source=law)

        # Wheel; the internal driver reduces the torque where it makes the wheel slip.
        torque = ca.fmax(0, limited) * _eased(k.slip_x) + ca.fmin(0, limited) * _eased(-k.slip_x)
        torque = ca.if_else(controls.drives, k.pedals, torque)
        c.value(f"wheel_torque_{k}", torque, source="of the pedals, or reduced where it makes the wheel slip")
        k.torque = torque
        k.spin_torque = torque - drive * p.wheel.radius + ground.my

        # Body: strut; drive force and the push of the slope at the hub; side force at the patch; the driveline is
        # mounted on the body, so the reaction of the wheel torque turns it.
        at_hub = drive * forward - k.load * gradient * ca.vertcat(1, 0, 0)
        at_patch = corner * sideways
        push = strut - of_rigid(ca.dot(at_hub + at_patch, turn[:, 2]))  # along a guide that leans
        k.wheel_force = k.load - push - p.wheel.mass * g
        k.on_body = push * up + at_hub + at_patch
        k.turning = [
            ca.cross(top, push * up) + ca.cross(hub, at_hub) + ca.cross(patch, at_patch),
            of_rigid(ca.cross(hub - top, push * up) + ca.cross(patch - hub, k.load * up)),
            -(torque * turn[:, 1]),
            ground.mx * forward + ground.mz * up,
        ]
        k.moment = sum(k.turning)
    # Sums over the corners by left and right are those of the mirror image to the last digit. On the friction ellipse
    # they are formed from front left to rear right: another order would move the last digits of published results.
    weight = -p.body.mass * g * up
    of_pairs = (weight + corners.paired("on_body"), corners.paired("moment"))
    applied = corners.paired("torque") if tire else sum(corners.all("torque"))  # torque of all wheels
    if tire:
        body_force, body_moment = of_pairs
    else:
        body_force = sum(corners.all("on_body"), weight)
        body_moment = sum((part for k in corners for part in k.turning), ca.SX.zeros(3))
    c.value("body_force", body_force, source="all forces on the body, road axes")
    c.value("body_moment", body_moment, source="about the CG, road axes: struts, tires, reaction of the wheel torques")

    # --------------------------------------------------------------------------------------------- equations of motion

    # Wheels move vertically on their own and horizontally with the body.
    acceleration = body_force / ca.vertcat(total_mass, total_mass, p.body.mass)
    wheels_yaw_inertia = sum(p.wheel.mass * (k.x**2 + k.y**2) for k in corners)
    inertia = ca.vertcat(p.body.roll_inertia, p.body.pitch_inertia, p.body.yaw_inertia + wheels_yaw_inertia)
    c.value("inertia", inertia)
    angular = (turn.T @ body_moment - ca.cross(omega_body, inertia * omega_body)) / inertia  # Euler, principal axes
    exact = _with_wheels(p, corners, turn, omega_body, inertia, total_mass, *of_pairs)
    angular, acceleration = (
        ca.if_else(rigid > 0.5, new, old) for new, old in zip(exact, (angular, acceleration), strict=True)
    )

    newton = "Newton: wheels move vertically on their own, horizontally with the body"
    body_motion(c, body, acceleration, angular, (newton, "Euler, principal axes of the body"))
    for k in corners:
        c.derivative(k.z, k.vz)
        c.derivative(k.vz, k.wheel_force / p.wheel.mass)
        c.derivative(k.spin, k.spin_torque / p.wheel.spin_inertia)
        c.derivative(k.slip_x, k.slip_x_rate, source="slips lag by a relaxation length")
        c.derivative(k.slip_y, k.slip_y_rate, source="slips lag by a relaxation length")
    winding_up = ca.logic_and(ca.fabs(applied) < 0.999 * ca.fabs(4 * requested), requested * error > 0)
    c.derivative(speed_error, ca.if_else(ca.logic_or(winding_up, controls.drives), 0, error))

    # ----------------------------------------------------------------------------------------------------- outputs

    body_outputs(c, body, acceleration, angular, omega, p.seat)
    for k in corners:
        c.output(f"wheel.{k}.az", k.wheel_force / p.wheel.mass, "m/s2", "vertical acceleration of the wheel")
        c.output(f"suspension.{k}.deflection", k.travel, "m", "body height minus wheel height", display_unit="mm")
        c.output(f"suspension.{k}.velocity", k.travel_rate, "m/s", "rate of the suspension deflection")
        c.output(f"tire.{k}.deflection", k.z - k.road, "m", "wheel height minus road height", display_unit="mm")
        c.output(f"tire.{k}.force", k.load, "N", "vertical tire force, never negative", display_unit="kN")
        power = k.force * k.travel_rate
        c.output(f"actuator.{k}.power", power, "W", "power from the actuator into the car", display_unit="kW")

    for kmh in (0, 20, 80, 120, 216):
        c.operating_point(f"{kmh} km/h", {"target.speed": kmh / 3.6})
    c.operating_point("stops closed", {"body.z": -0.16})
    c.operating_point("wheels hanging", {f"wheel.{k}.z": -0.16 for k in corners})
    c.reference_input(rough_patch())
    return c


@dataclass(frozen=True)
class _Rest:
    z: Any
    roll: Any
    pitch: Any


def _corners(p: Any, g: Any) -> Corners:
    """Corners of the car.

    Each has its position relative to the CG [m], parameters of the axle, static load of the strut [N], and whether it
    steers.
    """
    to_front = p.body.cg_position * p.body.wheelbase
    to_rear = p.body.wheelbase - to_front
    on_front = p.body.mass * g * to_rear / p.body.wheelbase / 2
    on_rear = p.body.mass * g * to_front / p.body.wheelbase / 2
    half = p.body.track / 2
    corners = Corners(TWO_AXLES)
    corners.each(
        x=lambda k: to_front if k.axle == "front" else -to_rear,
        y=lambda k: half if k.side > 0 else -half,
        strut=lambda k: getattr(p.suspension, k.axle),
        static_load=lambda k: on_front if k.axle == "front" else on_rear,
        steered=lambda k: k.axle == "front",
    )
    return corners


def _with_wheels(
    p: Any, corners: Corners, turn: Any, rates: Any, inertia: Any, mass: Any, force: Any, moment: Any
) -> Any:
    """Angular acceleration, body axes, and acceleration of the CG, road axes, (3,) each, of a body with its wheels.

    These move with it along its x and y axes: Newton and Euler for the center of mass of both. `force` and `moment`
    act on both, `moment` about the body's CG; `inertia` (3,) has the wheels in yaw only.
    """
    wheels, drop = 4 * p.wheel.mass, p.wheel.hub_height - p.body.cg_height
    ahead = (corners[0].x + corners[2].x) / 2
    center = wheels / mass * ca.vertcat(ahead, 0, drop)
    apart = wheels * (1 - wheels / mass)
    roll, pitch, yaw = ca.vertsplit(inertia)
    roll, pitch, yaw = roll + apart * drop**2, pitch + apart * drop**2, yaw - wheels**2 / mass * ahead**2
    product = -apart * ahead * drop
    tensor = ca.vertcat(ca.horzcat(roll, 0, product), ca.horzcat(0, pitch, 0), ca.horzcat(product, 0, yaw))
    across = ca.vertcat(force[0], force[1], 0)
    spins = ca.vertcat(0, p.wheel.spin_inertia * corners.paired("spin"), 0)
    turning = turn.T @ moment - ca.cross(center, turn.T @ across) - ca.cross(rates, tensor @ rates + spins)
    least = roll * yaw - product**2
    angular = ca.vertcat(
        (yaw * turning[0] - product * turning[2]) / least,
        turning[1] / pitch,
        (roll * turning[2] - product * turning[0]) / least,
    )
    moved = turn @ (ca.cross(angular, center) + ca.cross(rates, ca.cross(rates, center)))
    return angular, force / ca.vertcat(mass, mass, p.body.mass) - ca.vertcat(moved[0], moved[1], 0)


def _equilibrium(corners: Corners, p: Any, least: Any) -> _Rest:
    """Rest position on the given wheel heights: exact on a level road, to second order in the angles otherwise.

    Corners learn the `rest` of their wheels [m].

    Spring and tire in series at each corner carry the body as one plane: heave and pitch follow the axle means, roll
    is the stiffness-weighted mean of the two axles. `least` stiffness [N/m] keeps roll determined without any spring.
    """
    fl, fr, rl, rr = corners.all("road")
    to_front, to_rear = corners[0].x, -corners[2].x
    front, rear = (fl + fr) / 2, (rl + rr) / 2
    z = (front * to_rear + rear * to_front) / p.body.wheelbase
    slope = (rear - front) / p.body.wheelbase
    corners.each(
        rate=lambda k: p.suspension.motion_ratio**2 * k.strut.spring + least,
        series=lambda k: k.rate * p.tire.stiffness / (k.rate + p.tire.stiffness),
    )
    at_front, _, at_rear, _ = corners.all("series")
    twist = (at_front * (fl - fr) + at_rear * (rl - rr)) / (at_front + at_rear) / p.body.track
    pitch, roll = ca.atan(slope), ca.atan(twist)
    for k in corners:
        body = z - k.x * slope + k.y * twist
        k.rest = (p.tire.stiffness * k.road + k.rate * body) / (p.tire.stiffness + k.rate)
    return _Rest(z, roll, pitch)


def _within_ellipse(tire: Any, k: Any) -> Forces:
    """Forces that grow with slip and load up to the friction ellipse."""
    drive, corner = tire.slip_stiffness * k.slip_x, tire.cornering_stiffness * k.slip_y  # per load
    grip = k.load / ca.sqrt(1 + (drive**2 + corner**2) / tire.friction**2)
    return Forces(
        grip * drive, grip * corner, relaxation_x=tire.longitudinal_relaxation, relaxation_y=tire.lateral_relaxation
    )


def _steer_angle(p: Any, controls: Controls, k: Corner) -> Any:
    """Angle [rad] of a front wheel under the steering wheel.

    With `steering.ackermann` 1 the axes of both wheels meet on the rear axle's: cot of the angle differs from that of
    the mean one by half the track over the wheelbase.
    """
    tangent = ca.tan(nominal_angle(p, controls))
    return ca.atan(tangent / (1 - k.side * (_narrower(p) * tangent)))


def _narrower(p: Any) -> Any:
    """By how much the tangent of the inner wheel's steer angle is larger, per tangent of the mean one."""
    return p.steering.ackermann * p.body.track / (2 * p.body.wheelbase)


def _eased(slip: Any) -> Any:
    """Part of the torque that is left at a slip in its direction."""
    return ca.fmax(0, ca.fmin(1, (RELEASE_SLIP - slip) / (RELEASE_SLIP - EASE_SLIP)))


def _stop(travel: Any, stop: Any) -> Any:
    """Force of the stops over the travel, at the wheel [N]: 0 in between, progressive from the gap on."""
    rebound, jounce = ca.fmax(0, travel - stop.travel), ca.fmax(0, -travel - stop.travel)
    return stop.stiffness * (rebound - jounce) + stop.cubic * (rebound**3 - jounce**3)


_NOTES = (
    (
        "The car of paper 000 was a commercial multi-body model. This stand-in keeps what decides its ride: a rigid "
        "body with six degrees of freedom, vertical wheel travel with stops, wheel spin, tires that lift off, tire "
        "slips with relaxation lengths inside a friction ellipse, and a driver for speed and course."
    ),
    (
        "Left out, because the data are not public and they act on handling rather than on heave and pitch below 20 "
        "Hz: six compliance freedoms per suspension, camber, toe and track change with travel, gears "
        "and aerodynamics. Horizontally the wheels move with the body, with their mass at its CG, without gyroscopic "
        "moments, and the weight has no lever arm about the wheels when the body leans. This makes the yaw rate per "
        "steering wheel angle up to 11 % too large, and roll up to 15 % too small; for handling set wheel.rigid_body "
        "to 1, which has all of it."
    ),
    (
        "Springs and dampers of the vehicle file sit at the spring and act at the wheel through the motion ratio. The "
        "actuator acts at the wheel with ratio 1. The preload of the springs follows from the masses, so the car "
        "rests at its ride height whatever masses are set. At initialization it rests on the road heights given then; "
        "on level ground that is an exact equilibrium."
    ),
    "Brakes and driveline are mounted on the body: drive forces pitch the car with the lever arm of the CG height.",
    (
        "The first value of target.speed is the start speed. The driver model holds a straight course up to the "
        "maximum of target.speed; the car does not reverse. Torque is reduced at slipping wheels."
    ),
    (
        "Wiring: connect a road's outputs road.* to the inputs of the same name, and this car's x and speed to that "
        "road; a controller drives force.*. Exchange at 1 ms."
    ),
    (
        "The solver restarts at every doStep: the same second divided into steps other than 1 ms (0.5 to 10 ms) differs"
        " by up to 2.1e-4 of the range of motions and forces, and 5.2e-4 of that of any output."
    ),
)
