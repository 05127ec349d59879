"""Car on double wishbones: body with six degrees of freedom, wheels on the paths of their hardpoints.

Suspension tables and enveloping tires belong to it.

Each wheel moves with one degree of freedom, its travel q: vertical in the chassis, from design, positive upwards. Where
the wheel center is and how the upright is turned are functions of q, splines that
`fmu_sources.models.double_wishbone` computes from the hardpoints. With them the kinetic energy of wheel, upright
and arms is

    T = m V^2/2 + V.(w x s) + w.J w/2 + sum over wheels of (P.V + H.w) q' + M q'^2/2

with V and w the velocity of the CG and the angular velocity of the body, in body axes; s(q), J(q) the first and second
moments of all masses, P = ds/dq and H the momenta per travel rate and M the effective mass of a wheel. The equations of
motion follow from T as those of Lagrange for q and those of Kirchhoff for V and w:

    dp/dt + w x p = F,   dh/dt + w x h + V x p = N,   d/dt dT/dq' - dT/dq = Q

Axes are ISO 8855; roll positive left side up, pitch positive nose down. Nothing of the motion is linearized but
rotations of uprights, which are taken to second order. The wheels' spin is that of rotors: it has its own equation, and
its angular momentum turns with the axle.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.models.corners import TWO_AXLES, Corner, Corners
from fmu_sources.models.double_wishbone import Spline
from fmu_sources.plants.driving import (
    DRIVING_NOTES,
    Controls,
    antiroll_force,
    control_inputs,
    nominal_angle,
    pedal_torques,
)
from fmu_sources.plants.enveloping import CONTACT_COUNT, CONTACT_STEP, Disc
from fmu_sources.plants.free_body import (
    LOW_SPEED,
    body_motion,
    body_outputs,
    body_states,
    bump,
    course_steering,
    driver_inputs,
    limit,
    road_and_force_inputs,
    rotation,
    rough_patch,
    start_position,
)
from fmu_sources.plants.gravity import gravity
from fmu_sources.plants.seat import SEAT_NOTE
from fmu_sources.plants.tables import check_increasing, linear_table
from fmu_sources.registration import component
from fmu_sources.tires.magic_formula import Forces, tire_of
from fmu_sources.vehicles import WishboneCar, declare

_NEWTON = 5  # steps to the rest position from that of the vehicle file
_LEFT_OUT = (
    "body.com_x",
    "body.com_z",
    "steering_gear",
    "upper_arm",
    "lower_arm",
    *(f"suspension.{axle}.{what}" for axle in ("front", "rear") for what in ("reference", "travel", "points")),
)
_COMPUTED = "computed from the hardpoints, masses and inertias of the vehicle file"


@component(
    "FullCar{v}", "full car on double wishbones by their hardpoints, tables, enveloping tires", of="hmmwv_public"
)
def wishbone_car(vehicle: WishboneCar, name: str = "FullCarHmmwvPublic") -> Component:
    """Car of a vehicle file with hardpoints.

    All `z` count from where the car of the file rests on a road at height 0.
    """
    c = Component(
        name,
        kind="continuous",
        description=(
            f"Full car on double wishbones, 6-DOF body, wheels on the paths of their hardpoints: {vehicle.name}"
        ),
        source="Lagrange's and Kirchhoff's equations, in the source of this component; data: see the parameters",
        solver="am2",
        solver_step=5e-4,
        notes=(*_NOTES, *DRIVING_NOTES, SEAT_NOTE),
    )
    p = declare(c, vehicle, leave_out=_LEFT_OUT)
    tire = p.tire.formula = tire_of(c, vehicle.tire.file)
    _declare_computed(c, p, vehicle)
    g = gravity(c)
    low_speed = c.constant("low_speed", LOW_SPEED, "m/s", "below it slip is formed with this speed", source="assumed")
    start_x = start_position(c)
    for table in (
        "suspension.stop.penetration",
        "tire.deflection",
        *(f"suspension.{a}.spring.compression" for a in ("front", "rear")),
    ):
        check_increasing(c, _at(p, table), table)

    # ------------------------------------------------------------------------------------------------------ inputs

    corners = Corners(TWO_AXLES)
    corners.each(geometry=lambda k: getattr(p.suspension, k.axle))
    road_and_force_inputs(c, corners)
    target_speed, target_y = driver_inputs(c)
    controls = control_inputs(c)
    corners.each(
        contact=lambda k: c.input(
            f"contact.{k}",
            "m",
            f"heights of the road along the {k} tire, contact.step apart, above road.{k}.height",
            shape=(CONTACT_COUNT,),
        )
    )
    c.constant_input(
        "contact.step", "m", "distance between the heights along a tire", must_equal=CONTACT_STEP, display_unit="mm"
    )
    step = c.constant("contact_step", CONTACT_STEP, "m", "between heights along a tire", source="build option")
    disc = Disc(p.tire.radius, step, CONTACT_COUNT)

    # ------------------------------------------------------------------------------------------------------ states

    start = _rest(c, p, g, target_speed / low_speed)
    on = _plane(corners, p)
    body = body_states(c, start_x, start.z + on.z, on.roll, start.pitch + on.pitch, target_speed)
    rolling_radius = p.tire.radius - start.deflection / 3
    corners.each(
        q=lambda k: c.state(
            f"wheel.{k}.travel",
            "m",
            "travel of the wheel in the chassis, from design, positive upwards",
            start=start.travel[k.axle],
            nominal=0.1,
            output=True,
        ),
        dq=lambda k: c.state(f"wheel.{k}.travel_rate", "m/s", "rate of the travel"),
        spin=lambda k: c.state(
            f"wheel.{k}.spin",
            "rad/s",
            "spin, positive forward",
            start=target_speed / rolling_radius,
            nominal=10.0,
            output=True,
        ),
        slip_x=lambda k: c.state(f"tire.{k}.slip", "1", "lagged slip, positive driving", nominal=0.1),
    )
    if tire:
        corners.each(slip_y=lambda k: c.state(f"tire.{k}.slip_angle", "rad", "lagged slip angle", nominal=0.1))
    speed_error = c.state("driver.speed_error", "m", "integral of the speed error")

    # -------------------------------------------------------------------------------------------------- kinematics

    turn = c.value("turn", body.turn, source="from body axes to road axes: yaw, pitch, roll (ISO 8855)")
    w = ca.vertcat(*body.rates)
    velocity = ca.vertcat(*body.velocity)
    v = c.value("body_velocity", turn.T @ velocity, source="of the CG, body axes")
    up = turn.T @ ca.vertcat(0, 0, 1)  # in body axes
    height = p.rest.height + body.z

    for k in corners:
        _move(k, k.q)
        _inertia(k, p)
        for of in ("center", "spring_length", "damper_length"):
            c.value(f"{of}_{k}", getattr(k, of), source=f"{k} wheel: splines of its travel")
        k.momentum = k.spindle * (p.wheel.spin_inertia + p.wheel.shaft_inertia) * k.spin

    # ------------------------------------------------------------------------------------------------------ driver

    error = target_speed - body.speed
    requested = p.speed_control.gain * error + p.speed_control.integral_gain * speed_error
    limited = limit(requested, p.speed_control.max_force)
    torque = c.value("wheel_torque", limited * p.speed_control.lever / 4, source="driver: torque of each wheel")
    course = course_steering(p.steering, body, target_y)
    c.value("steering_angle", course, source="driver: course")
    pedal_torques(c, p, controls, corners, p.tire.radius, low_speed)

    # ------------------------------------------------------------------------------------ masses, and what acts on them

    mass, first, inertia = _body_inertia(p)
    mass += sum(k.mass for k in corners)
    first += sum(k.first for k in corners)
    inertia += sum(k.inertia for k in corners)
    c.value("total_mass", mass)
    force = -mass * g * up  # body axes
    moment = ca.cross(first, -g * up)  # about the CG, body axes
    for k in corners:
        _strut(k, p)
        c.value(f"strut_{k}", k.strut, source=f"{k} spring, stops and damper, at the wheel along its travel")
        k.along = k.strut - k.force - g * ca.dot(k.first_d, up)  # generalized force of the travel
        k.along -= antiroll_force(p, corners, k, "q")

        # Tire, vertical.
        k.from_cg = turn @ k.center
        k.hub_rate = v + ca.cross(w, k.center) + k.center_d * k.dq  # body axes
        hub_velocity = c.value(f"hub_velocity_{k}", turn @ k.hub_rate, source=f"{k} wheel center, road axes")
        k.height = height + k.from_cg[2]
        k.depth = c.value(
            f"tire_depth_{k}",
            disc.depth(disc.area(k.height - k.road, k.contact)),
            source="area rule: see enveloping.py",
        )
        normal = ca.vertcat(-k.slope, 0, 1) / ca.sqrt(1 + k.slope**2)
        bearing = linear_table(k.depth, p.tire.deflection, p.tire.force, beyond=True) - p.tire.damping * ca.dot(
            hub_velocity, normal
        )
        k.load = ca.if_else(k.depth > 0, ca.fmax(0, bearing), 0)

        # Tire, horizontal: slips lag, that of a friction ellipse only along the wheel and by a short length.
        steer = ca.if_else(controls.steers, _steer_angle(p, controls, k), course) if k.axle == "front" else 0
        heading = k.lean[2] + steer
        forward = ca.cos(heading) * body.ahead + ca.sin(heading) * body.left
        sideways = ca.cos(heading) * body.left - ca.sin(heading) * body.ahead
        against = turn.T @ normal  # body axes
        # from the center to the contact
        below = (p.tire.radius - k.depth) * (ca.dot(against, k.spindle) * k.spindle - against)
        patch_d = k.center_d + ca.cross(k.turning, below)
        patch_rate = v + ca.cross(w, k.center + below) + patch_d * k.dq
        rolling = ca.dot(hub_velocity, forward)
        pace = ca.sqrt(rolling**2 + low_speed**2)
        on_road = k.spin * (p.tire.radius - k.depth / 3) - rolling  # what slides backwards [m/s]
        sliding = ca.dot(turn @ patch_rate, sideways)
        if tire is None:
            drive, side = p.tire.slip_stiffness * k.slip_x, -p.tire.cornering_stiffness * sliding / pace  # per load
            grip, law = k.load / _saturation(p, drive, side), "grows with slip and load up to the friction ellipse"
            resistance = p.tire.rolling_resistance * k.load * p.tire.radius
            ground = Forces(
                grip * drive,
                grip * side,
                p.tire.relaxation,
                0.0,
                my=-resistance * ca.tanh(k.spin * p.tire.radius / low_speed),
            )
        else:
            inclination, law = ca.asin((turn @ k.spindle)[2] / ca.norm_2(k.spindle)), "Magic Formula"
            ground = tire.forces(k.load, k.slip_x, -k.slip_y, inclination, rolling, k.side)
            ground = tire.parked(ground, k.load, rolling, -on_road, sliding)
            k.slip_y_rate = (-sliding - pace * k.slip_y) / ground.relaxation_y
        k.slip_x_rate = (on_road - pace * k.slip_x) / ground.relaxation_x
        c.value(f"drive_force_{k}", ground.fx, source=law)
        c.value(f"side_force_{k}", ground.fy, source=law)

        # The drive force acts at the hub, since the wheel turns on its bearing; what the road presses and holds acts
        # below it.
        at_hub = turn.T @ (ground.fx * forward)
        at_patch = turn.T @ (k.load * normal + ground.fy * sideways)
        force += at_hub + at_patch
        moment += ca.cross(k.center, at_hub) + ca.cross(k.center + below, at_patch)
        k.along += ca.dot(k.center_d, at_hub) + ca.dot(patch_d, at_patch)
        if tire:
            turned = turn.T @ (ground.mx * forward + ground.mz * normal)  # the upright takes it
            moment += turned
            k.along += ca.dot(k.turning, turned)
        wheel_torque = c.value(f"wheel_torque_{k}", ca.if_else(controls.drives, k.pedals, torque))
        k.spin_torque = wheel_torque - ground.fx * (p.tire.radius - k.depth) + ground.my
    c.value("body_force", force, source="all forces from outside, body axes")
    c.value("body_moment", moment, source="of these about the CG, body axes")

    # --------------------------------------------------------------------------------------------- equations of motion

    momentum = mass * v + ca.cross(w, first) + sum(k.first_d * k.dq for k in corners)
    spinning = sum(k.momentum for k in corners)
    turning = ca.cross(first, v) + inertia @ w + sum(k.turn_d * k.dq for k in corners) + spinning
    first_rate = sum(k.first_d * k.dq for k in corners)
    inertia_rate = sum(k.inertia_d * k.dq for k in corners)
    force -= ca.cross(w, momentum) + ca.cross(w, first_rate) + sum(k.first_dd * k.dq**2 for k in corners)
    moment -= ca.cross(w, turning) + ca.cross(v, momentum) + ca.cross(first_rate, v) + inertia_rate @ w
    for k in corners:
        rotor = (p.wheel.spin_inertia + p.wheel.shaft_inertia) * k.spin
        moment -= k.turn_dd * k.dq**2 + k.spindle_d * (rotor * k.dq)
        k.along += ca.dot(v, ca.cross(w, k.first_d)) + ca.dot(w, k.inertia_d @ w) / 2 - k.effective_d * k.dq**2 / 2
        k.along += rotor * ca.dot(k.spindle_d, w)
        k.row = ca.vertcat(k.first_d, k.turn_d)
    skew = ca.vertcat(
        ca.horzcat(0, first[2], -first[1]), ca.horzcat(-first[2], 0, first[0]), ca.horzcat(first[1], -first[0], 0)
    )
    matrix = ca.vertcat(ca.horzcat(mass * ca.SX.eye(3), skew), ca.horzcat(skew.T, inertia))
    right = ca.vertcat(force, moment)
    for k in corners:  # the wheels' own accelerations eliminated
        matrix -= k.row @ k.row.T / k.effective
        right -= k.row * (k.along / k.effective)
    solved = _solve(matrix, right)
    angular = solved[3:]
    acceleration = turn @ (solved[:3] + ca.cross(w, v))
    c.value("acceleration", acceleration, source="of the CG, road axes")
    c.value("angular_acceleration", angular, source="body axes")
    for k in corners:
        k.ddq = c.value(f"travel_acceleration_{k}", (k.along - ca.dot(k.row, solved)) / k.effective, source="Lagrange")

    body_motion(c, body, acceleration, angular, ("Kirchhoff, turned into road axes", "Kirchhoff"))
    for k in corners:
        c.derivative(k.q, k.dq)
        c.derivative(k.dq, k.ddq, source="Lagrange")
        c.derivative(k.spin, k.spin_torque / (p.wheel.spin_inertia + p.wheel.shaft_inertia))
        c.derivative(k.slip_x, k.slip_x_rate, source="slip lags by a relaxation length")
        if tire:
            c.derivative(k.slip_y, k.slip_y_rate, source="slip lags by a relaxation length")
    winding_up = ca.logic_and(ca.fabs(requested) > p.speed_control.max_force, requested * error > 0)
    c.derivative(speed_error, ca.if_else(ca.logic_or(winding_up, controls.drives), 0, error))

    # ----------------------------------------------------------------------------------------------------- outputs

    body_outputs(c, body, acceleration, angular, turn @ w, p.seat)
    for k in corners:
        rest = getattr(p.rest, k.axle)
        moved = ca.cross(angular, k.center) + ca.cross(w, ca.cross(w, k.center) + 2 * k.center_d * k.dq)
        moved += k.center_d * k.ddq + k.center_dd * k.dq**2
        c.output(
            f"wheel.{k}.z", k.height - rest.wheel_height, "m", "wheel center above its static height", display_unit="mm"
        )
        c.output(f"wheel.{k}.vz", (turn @ k.hub_rate)[2], "m/s", "vertical velocity of the wheel center")
        c.output(
            f"wheel.{k}.az", acceleration[2] + (turn @ moved)[2], "m/s2", "vertical acceleration of the wheel center"
        )
        c.output(
            f"wheel.{k}.camber",
            -k.side * k.lean[0],
            "rad",
            "camber since design, positive where the top leans outwards",
            display_unit="deg",
        )
        c.output(f"wheel.{k}.toe", k.side * k.lean[2], "rad", "toe since design, positive outwards", display_unit="deg")
        c.output(
            f"wheel.{k}.half_track", k.side * k.center[1], "m", "distance of the wheel center to the side of the CG"
        )
        c.output(
            f"suspension.{k}.deflection", rest.travel - k.q, "m", "body height minus wheel height", display_unit="mm"
        )
        c.output(f"suspension.{k}.velocity", -k.dq, "m/s", "rate of the suspension deflection")
        c.output(f"spring.{k}.length", k.spring_length, "m", "length of the spring", display_unit="mm")
        c.output(f"spring.{k}.force", k.spring_force, "N", "force of the spring, stops not included", display_unit="kN")
        c.output(f"damper.{k}.length", k.damper_length, "m", "length of the damper", display_unit="mm")
        c.output(
            f"tire.{k}.deflection",
            -k.depth,
            "m",
            "minus the depth that bears the load on a flat road; 0 in the air",
            display_unit="mm",
        )
        c.output(
            f"tire.{k}.force",
            k.load,
            "N",
            "force of the road on the tire along its normal, never negative",
            display_unit="kN",
        )
        c.output(f"actuator.{k}.power", -k.force * k.dq, "W", "power from the actuator into the car", display_unit="kW")

    for kmh in (0, 20, 80, 120, 216):
        c.operating_point(f"{kmh} km/h", {"target.speed": kmh / 3.6})
    c.operating_point("in jounce", {f"wheel.{k}.travel": 0.05 for k in corners})
    c.operating_point("wheels hanging", {f"wheel.{k}.travel": -0.155 for k in corners})
    c.reference_input(_reference_inputs())
    return c


# -------------------------------------------------------------------------------------------------- computed parameters


def _declare_computed(c: Component, p: Any, vehicle: WishboneCar) -> None:
    """Declare what follows from the hardpoints, and put the symbols into `p`."""

    def number(name: str, value: Any, unit: str, text: str, **options: Any) -> Any:
        return c.parameter(name, value, unit, text, source=_COMPUTED, **options)

    fixed: list[tuple[float, np.ndarray]] = [  # in the plane of symmetry, which the car is taken to have
        (part.mass.value, np.array(part.position.value) * [1, 0, 1] - _cg(vehicle))
        for part in (vehicle.steering_gear.link, vehicle.steering_gear.pitman)
    ]
    for name in ("front", "rear"):
        axle, symbols = getattr(vehicle.suspension, name), getattr(p.suspension, name)
        mechanism, motion = axle.mechanism, axle.motion
        origin = np.array([axle.reference.value, 0.0, 0.0]) - _cg(vehicle)
        center = mechanism.points["wheel_centre"]
        at, of = f"suspension.{name}", f"of the left {name} wheel"
        symbols.center = number(
            f"{at}.wheel", origin + center, "m", f"wheel center {of} at design, from the CG", nominal=1.0
        )
        symbols.upright = number(
            f"{at}.upright",
            mechanism.points["upright_com"] - center,
            "m",
            f"center of mass of the upright {of} from its center",
            nominal=0.1,
        )
        for which in ("upper", "lower"):
            solid, arm = getattr(vehicle, f"{which}_arm"), mechanism.arm(which)
            at_ball, at_com, at_axis = arm.lumps(solid.mass.value, solid.inertia.value[0])
            foot = arm.ball - arm.from_axis(arm.ball)
            fixed += [(at_axis, (origin + foot) * [1, side, 1]) for side in (1, -1)]
            part = SimpleNamespace()
            part.ball = number(
                f"{at}.{which}_arm.ball",
                arm.ball - center,
                "m",
                f"{which} ball joint {of} at design, from its center",
                nominal=0.1,
            )
            part.com = number(
                f"{at}.{which}_arm.com",
                arm.com - center,
                "m",
                f"center of mass of the {which} arm {of} at design, from its center",
                nominal=0.1,
            )
            part.share = number(
                f"{at}.{which}_arm.share",
                float(arm.from_axis(arm.com) @ arm.from_axis(arm.ball)) / arm.reach**2,
                "1",
                f"how far the center of mass of the {which} arm is from its axis, of the way to the ball joint",
                min=0.0,
                max=1.0,
            )
            part.ball_mass = number(
                f"{at}.{which}_arm.ball_mass",
                at_ball,
                "kg",
                f"mass of the {which} arm that moves as its ball joint does",
            )
            part.com_mass = number(
                f"{at}.{which}_arm.com_mass",
                at_com,
                "kg",
                f"mass of the {which} arm that moves as its center of mass does",
            )
            setattr(symbols, which, part)
        spline = motion.spline
        symbols.first = number(
            f"{at}.knots.first", spline.first, "m", f"first knot of the splines over the travel {of}", min=-5.0, max=5.0
        )
        symbols.step = number(
            f"{at}.knots.step", spline.step, "m", f"distance between the knots of the splines {of}", min=1e-4, max=1.0
        )
        rows = {
            "forward": ("m", "motion of the wheel center forward"),
            "outward": ("m", "motion of the wheel center outward"),
            "roll": ("rad", "rotation of the upright about x (camber)"),
            "pitch": ("rad", "rotation of the upright about y (caster)"),
            "yaw": ("rad", "rotation of the upright about z (toe)"),
            "spring": ("m", "length of the spring"),
            "damper": ("m", "length of the damper"),
        }
        symbols.rows = {
            row: number(
                f"{at}.kinematics.{row}",
                getattr(motion, row),
                unit,
                f"{text} {of}: coefficients of a cubic B-spline over its travel",
                nominal=0.1,
            )
            for row, (unit, text) in rows.items()
        }
        symbols.count = spline.count
    angles, steered = vehicle.suspension.front.mechanism.steered(vehicle.steering.max_angle.value)
    at, of = "suspension.front.steering", "of the left front wheel"
    p.linkage = SimpleNamespace(
        nominal=number(f"{at}.nominal", angles, "rad", f"steer angle {of} by the ratio alone, increasing", nominal=0.1),
        angle=number(f"{at}.angle", steered, "rad", f"steer angle {of} there, at design, linear between", nominal=0.1),
    )
    check_increasing(c, p.linkage.nominal, f"{at}.nominal")
    total = sum(m for m, _ in fixed)
    place = sum(m * r for m, r in fixed) / total
    second = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in fixed)
    p.fixed = SimpleNamespace(
        mass=number(
            "fixed.mass", total, "kg", "steering gear and the parts of the arms at their axes: fixed to the body"
        ),
        position=number("fixed.position", place, "m", "their center of mass from the CG", nominal=0.1),
        inertia=number("fixed.inertia", second, "kg.m2", "their inertia about the CG", nominal=100.0),
    )


def _steer_angle(p: Any, controls: Controls, k: Corner) -> Any:
    """Angle [rad] of a front wheel under the steering wheel, from the hardpoints of its tierod; the right one mirrors.

    Beyond the table it continues as the angle by the ratio alone.
    """
    nominal = k.side * nominal_angle(p, controls)
    row = p.linkage.nominal
    inside = ca.fmax(row[0], ca.fmin(row[row.numel() - 1], nominal))
    return k.side * (linear_table(inside, row, p.linkage.angle, beyond=False) + (nominal - inside))


def _cg(vehicle: WishboneCar) -> np.ndarray:
    """Center of mass of the chassis body in the chassis frame [m]."""
    return np.array([vehicle.body.com_x.value, 0.0, vehicle.body.com_z.value])


def _at(p: Any, path: str) -> Any:
    for name in path.split("."):
        p = getattr(p, name)
    return p


# -------------------------------------------------------------------------------------------------------- one corner


def _move(k: Corner, q: Any) -> None:
    """Give a corner the values that its travel decides, with first and second derivatives `_d`, `_dd`.

    They are `center` of the wheel from the CG, `lean` of the upright (rotation vector), `turning` (angular
    velocity per travel rate), direction of the `spindle`, lengths of spring and damper. Beyond the knots everything
    continues along its tangent.
    """
    axle = k.geometry
    t = (q - axle.first) / axle.step
    inside = ca.fmax(1, ca.fmin(axle.count - 2, t))
    beyond = t - inside
    within = ca.if_else(beyond == 0, 1, 0)
    weights: list[list[Any]] = [[], [], []]
    for knot in range(axle.count):
        distance = inside - knot
        value, slope, bend = _basis(distance)
        weights[0].append(value + slope * beyond)
        weights[1].append(slope / axle.step)
        weights[2].append(bend * within / axle.step**2)
    value, slope, bend = (ca.horzcat(*row) for row in weights)

    def three(name: str) -> tuple[Any, Any, Any]:
        return value @ axle.rows[name], slope @ axle.rows[name], bend @ axle.rows[name]

    mirror = k.side
    forward, outward = three("forward"), three("outward")
    design = ca.vertcat(axle.center[0], mirror * axle.center[1], axle.center[2])
    k.center = design + ca.vertcat(forward[0], mirror * outward[0], q)
    k.center_d = ca.vertcat(forward[1], mirror * outward[1], 1)
    k.center_dd = ca.vertcat(forward[2], mirror * outward[2], 0)
    lean = [
        ca.vertcat(mirror * a, b, mirror * d)
        for a, b, d in zip(three("roll"), three("pitch"), three("yaw"), strict=True)
    ]
    k.lean, k.lean_d, k.lean_dd = lean
    k.turning = k.lean_d + ca.cross(k.lean, k.lean_d) / 2
    k.turning_d = k.lean_dd + ca.cross(k.lean, k.lean_dd) / 2
    k.spindle = ca.vertcat(-k.lean[2], 1, k.lean[0])
    k.spindle_d = ca.vertcat(-k.lean_d[2], 0, k.lean_d[0])
    k.spring_length, k.spring_d, _ = three("spring")
    k.damper_length, k.damper_d, _ = three("damper")


def _basis(distance: Any) -> tuple[Any, Any, Any]:
    """`Spline.basis` with its first and second derivative."""
    away, sign = ca.fabs(distance), ca.sign(distance)
    wide, narrow = ca.fmax(0, 2 - away), ca.fmax(0, 1 - away)
    return Spline.basis(distance, ca.fmax, ca.fabs), sign * (2 * narrow**2 - wide**2 / 2), wide - 4 * narrow


def _inertia(k: Corner, p: Any) -> None:
    """Give a corner its `mass`, and moments and momenta about the CG as functions of its travel.

    Moments and momenta come with their derivatives.
    """
    axle = k.geometry
    solids = [(p.wheel.mass, ca.SX.zeros(3), 1), (p.upright.mass, axle.upright, 1)]
    for arm in (axle.upper, axle.lower):
        solids += [(arm.ball_mass, arm.ball, 1), (arm.com_mass, arm, arm.share)]
    k.mass, k.effective, k.effective_d = 0, 0, 0
    k.first, k.first_d, k.first_dd, k.turn_d, k.turn_dd = (ca.SX.zeros(3) for _ in range(5))
    k.inertia, k.inertia_d = ca.SX.zeros(3, 3), ca.SX.zeros(3, 3)
    for m, what, share in solids:
        if isinstance(what, SimpleNamespace):  # center of mass of an arm: moves as its ball joint does, less
            r, d, dd = _on_upright(k, what.ball)
            place = ca.vertcat(axle.center[0], k.side * axle.center[1], axle.center[2])
            ball, com = (_mirrored(k, v) for v in (what.ball, what.com))
            r, d, dd = place + com + share * (r - place - ball), share * d, share * dd
        else:
            r, d, dd = _on_upright(k, what)
        k.mass += m
        k.first += m * r
        k.first_d += m * d
        k.first_dd += m * dd
        k.turn_d += m * ca.cross(r, d)
        k.turn_dd += m * ca.cross(r, dd)
        k.effective += m * ca.dot(d, d)
        k.effective_d += 2 * m * ca.dot(d, dd)
        k.inertia += m * (ca.dot(r, r) * ca.SX.eye(3) - r @ r.T)
        k.inertia_d += m * (2 * ca.dot(r, d) * ca.SX.eye(3) - r @ d.T - d @ r.T)
    # the wheel turns on its axle by itself
    own = p.upright.inertia + ca.vertcat(p.wheel.tilt_inertia, 0, p.wheel.tilt_inertia)
    k.inertia += ca.diag(own)
    k.turn_d += own * k.turning
    k.turn_dd += own * k.turning_d
    k.effective += ca.dot(k.turning, own * k.turning)
    k.effective_d += 2 * ca.dot(k.turning, own * k.turning_d)


def _mirrored(k: Corner, place: Any) -> Any:
    return ca.vertcat(place[0], k.side * place[1], place[2])


def _on_upright(k: Corner, place: Any) -> tuple[Any, Any, Any]:
    """Position of a point of the upright from the CG, and its first and second derivative by the travel.

    `place`: of the point from the wheel center, at design, on the left side.
    """
    arm = _mirrored(k, place)
    a, b, d = k.lean, k.lean_d, k.lean_dd
    cross = ca.cross
    turned = arm + cross(a, arm) + cross(a, cross(a, arm)) / 2
    first = cross(b, arm) + (cross(b, cross(a, arm)) + cross(a, cross(b, arm))) / 2
    second = cross(d, arm) + (cross(d, cross(a, arm)) + cross(a, cross(d, arm))) / 2 + cross(b, cross(b, arm))
    return k.center + turned, k.center_d + first, k.center_dd + second


def _body_inertia(p: Any) -> tuple[Any, Any, Any]:
    """Mass, first moment and inertia about the CG of what is fixed to the body."""
    inertia = ca.diag(ca.vertcat(p.body.roll_inertia, p.body.pitch_inertia, p.body.yaw_inertia)) + p.fixed.inertia
    return p.body.mass + p.fixed.mass, p.fixed.mass * p.fixed.position, inertia


def _strut(k: Corner, p: Any, *, moving: bool = True) -> None:
    """Give a corner its `spring_force` and `strut`.

    `strut` is the generalized force of spring, stops and damper on the travel [N].
    """
    axle, stops = k.geometry, p.suspension.stop
    compression = axle.spring.free_length - k.spring_length
    sign = ca.if_else(compression < 0, -1, 1)
    k.spring_force = sign * linear_table(ca.fabs(compression), axle.spring.compression, axle.spring.force, beyond=True)
    bump = linear_table(axle.stop.bump - k.spring_length, stops.penetration, stops.force, beyond=False)
    rebound = linear_table(k.spring_length - axle.stop.rebound, stops.penetration, stops.force, beyond=False)
    k.strut = (k.spring_force + bump - rebound) * k.spring_d
    if not moving:
        return
    velocity = k.damper_d * k.dq
    span = p.suspension.damper_range
    inner = _blend((k.damper_length - span.least) / span.blend) * _blend((span.most - k.damper_length) / span.blend)
    damper = axle.damper
    compressed = damper.outer_compression + (damper.compression - damper.outer_compression) * inner
    extended = damper.outer_rebound + (damper.rebound - damper.outer_rebound) * inner
    k.strut -= ca.if_else(velocity < 0, compressed, extended) * velocity * k.damper_d


def _blend(part: Any) -> Any:
    """From 0 at -1/2 to 1 at 1/2, smoothly."""
    t = ca.fmax(0, ca.fmin(1, part + 0.5))
    return t * t * (3 - 2 * t)


# ----------------------------------------------------------------------------------------------------------------- rest


@dataclass(frozen=True)
class _Rest:
    z: Any
    pitch: Any
    travel: dict[str, Any]
    deflection: Any


def _rest(c: Component, p: Any, g: Any, speed: Any) -> _Rest:
    """Where the car rests on a level road at a `speed` (in parts of that below which slip is formed with it).

    Newton's method from where the car of the vehicle file rests, standing, which is declared as `rest.*`.
    """
    unknown, rolling = ca.SX.sym("unknown", 4), ca.SX.sym("rolling")
    residual, wheels, _ = _static(p, g, unknown, rolling)
    symbols, values = c.known()
    newton = unknown - _solve(ca.densify(ca.jacobian(residual, unknown)), residual)
    step = ca.Function("rest_step", [unknown, rolling, symbols], [newton, wheels])
    at = np.array([0.8, 0.0, -0.1, -0.1])
    for _ in range(200):
        change = np.asarray(step(at, 0, values)[0]).ravel() - at
        at = at + change * min(1.0, 0.02 / max(np.abs(change).max(), 1e-300))
        if np.abs(change).max() < 1e-14:
            break
    else:
        raise ValueError(
            f"{c.name}: no static equilibrium on springs and tires was found; check their tables in the vehicle file"
        )
    heights = np.asarray(step(at, 0, values)[1]).ravel()

    def known(name: str, value: float, unit: str, text: str) -> Any:
        return c.parameter(
            name,
            float(value),
            unit,
            text,
            source="computed: rest of the car of the vehicle file, standing on a level road",
            nominal=0.1,
        )

    p.rest = SimpleNamespace(
        height=known("rest.height", at[0], "m", "height of the CG at rest, from which body.z counts")
    )
    for i, axle in enumerate(("front", "rear")):
        rest = SimpleNamespace(
            wheel_height=known(
                f"rest.{axle}.wheel_height",
                heights[i],
                "m",
                f"height of the {axle} wheel centers at rest, from which wheel.*.z counts",
            ),
            travel=known(
                f"rest.{axle}.travel",
                at[2 + i],
                "m",
                f"travel of the {axle} wheels at rest, from which suspension.*.deflection counts",
            ),
        )
        setattr(p.rest, axle, rest)
    source = "computed: rest of the car of the vehicle file"
    guess = (("height", "m"), ("pitch", "rad"), ("front_travel", "m"), ("rear_travel", "m"))
    parts = [
        c.constant(f"rest_{n}", float(v), unit, f"{n} at rest", source=source)
        for (n, unit), v in zip(guess, at, strict=True)
    ]
    found = ca.vertcat(*parts)
    for _ in range(_NEWTON):
        found = step(found, speed, symbols)[0]
    _, _, deep = _static(p, g, found, speed)
    return _Rest(found[0] - p.rest.height, found[1], {"front": found[2], "rear": found[3]}, (deep[0] + deep[1]) / 2)


def _static(p: Any, g: Any, unknown: Any, speed: Any) -> tuple[Any, Any, Any]:
    """Residuals of the rest on a level road, heights of the wheel centers, and deflections of the tires.

    The residuals vanish at rest: vertical force, pitch moment, generalized forces of front and rear travel.
    `unknown`: height of the CG, pitch, travels. A rolling tire that toes in presses against the road.
    """
    height, pitch = unknown[0], unknown[1]
    turn = rotation(0, pitch, 0)
    up = turn.T @ ca.vertcat(0, 0, 1)
    mass, first, _ = _body_inertia(p)
    force, moment, along, wheels, depths = -mass * g, ca.cross(first, -g * up)[1], [], [], []
    for i, axle in enumerate(("front", "rear")):
        k = Corner(axle + "l", axle, i)
        k.geometry = getattr(p.suspension, axle)
        _move(k, unknown[2 + i])
        _inertia(k, p)
        _strut(k, p, moving=False)
        center = height + (turn @ k.center)[2]
        depth = p.tire.radius - center
        load = linear_table(depth, p.tire.deflection, p.tire.force, beyond=True)
        below = (p.tire.radius - depth) * (ca.dot(up, k.spindle) * k.spindle - up)
        patch_d = k.center_d + ca.cross(k.turning, below)
        force += 2 * (load - k.mass * g)
        moment += 2 * (ca.cross(k.center + below, load * up)[1] + ca.cross(k.first, -g * up)[1])
        if p.tire.formula:
            slip_angle = -ca.tan(k.lean[2]) * speed / ca.sqrt(speed**2 + 1)
            toeing = p.tire.formula.forces(load, 0, slip_angle, k.lean[0], 0).fy
        else:
            side = p.tire.cornering_stiffness * ca.sin(k.lean[2]) * speed / ca.sqrt(speed**2 + 1)
            toeing = load * side / _saturation(p, 0, side)
        along.append(k.strut - g * ca.dot(k.first_d, up) + load * ca.dot(patch_d, up) + toeing * patch_d[1])
        wheels.append(center)
        depths.append(depth)
    return ca.vertcat(force, moment, *along), ca.vertcat(*wheels), depths


@dataclass(frozen=True)
class _Plane:
    z: Any
    roll: Any
    pitch: Any


def _plane(corners: Corners, p: Any) -> _Plane:
    """How the given road heights lift and turn the car at rest: the plane through the means of axles and sides."""
    fl, fr, rl, rr = corners.all("road")
    front, rear = p.suspension.front.center, p.suspension.rear.center
    base = front[0] - rear[0]
    slope = (fl + fr - rl - rr) / 2 / base
    twist = (fl - fr + rl - rr) / 2 / (front[1] + rear[1])
    return _Plane((fl + fr) / 2 - slope * front[0], ca.atan(twist), -ca.atan(slope))


# ---------------------------------------------------------------------------------------------------------- mathematics


def _solve(matrix: Any, right: Any) -> Any:
    """Solution of a small dense system with a positive definite matrix.

    By Gaussian elimination without exchange of rows.
    """
    n = matrix.shape[0]
    a = [[matrix[i, j] for j in range(n)] + [right[i]] for i in range(n)]
    for i in range(n):
        for j in range(i + 1, n):
            factor = a[j][i] / a[i][i]
            a[j] = [b - factor * d if place > i else b for place, (b, d) in enumerate(zip(a[j], a[i], strict=True))]
    x: list[Any] = [0.0] * n
    for i in reversed(range(n)):
        x[i] = (a[i][n] - sum(a[i][j] * x[j] for j in range(i + 1, n))) / a[i][i]
    return ca.vertcat(*x)


def _saturation(p: Any, drive: Any, side: Any) -> Any:
    """Divisor that keeps forces within the friction ellipse.

    Without it the forces, given per load, would grow linearly with slip.
    """
    return ca.sqrt(1 + (drive / p.tire.longitudinal_friction) ** 2 + (side / p.tire.lateral_friction) ** 2)


def _reference_inputs() -> dict[str, Any]:
    edge = CONTACT_COUNT // 2 + 5  # a ridge ahead of the middle of a contact
    return {**rough_patch(), **{f"contact.fl[{i}]": bump(0.06, 0.03) for i in range(edge, edge + 3)}}


_NOTES = (
    (
        "The car of a published open multibody model, with the same masses, hardpoints, springs, stops, dampers and"
        " vertical characteristic of the tires. Joints are ideal. Simplifications: rotations of uprights are taken"
        " to second order, the center of mass of an arm moves along with its ball joint, and the"
        " horizontal forces of the tires are those of a friction ellipse. steering.wheel steers the wheels as the"
        " tierods do at design (suspension.front.steering.*), and the travel adds its toe; what turns is where the"
        " tires point, while masses, camber and caster stay as without steering."
    ),
    (
        "wheel.*.travel is the coordinate of the suspension; paths of the wheel centers, camber, caster, toe and the"
        " lengths of springs and dampers are cubic B-splines over it, twice continuously differentiable, whose"
        " coefficients are parameters (suspension.*.kinematics.*). They are computed from the hardpoints of the vehicle"
        " file when the FMU is built. Beyond the knots everything continues along its tangent."
    ),
    (
        "Springs, stops and tires are tables that are linear in between (suspension.*.spring.*, suspension.stop.*,"
        " tire.deflection and tire.force). Rows that do not increase are refused at initialization. The rates of a"
        " damper switch with its length; they change smoothly over suspension.damper_range.blend."
    ),
    (
        "Tires envelop what is shorter than their contact: contact.* are the heights of the road along each tire,"
        " contact.step apart and counted from road.*.height, the middle one under the wheel center. The area of the"
        " tire's disc below them decides the depth. Roads that are made for this vehicle have these outputs; without a"
        " connection they are 0 and the tires touch a level road at road.*.height, which is right for roads that are"
        " long and smooth."
    ),
    (
        "At initialization the car rests on a level road, or on the plane through the road heights that are given then,"
        " by five steps of Newton's method from where the car of the vehicle file rests: exact for this car, and for"
        " others whose springs do not reach another line of their table."
    ),
    (
        "The actuator acts between body and wheel along the travel with ratio 1. The driver's torque is applied to the"
        " wheels and not supported by the body, as in the model that this car is compared with. The first value of"
        " target.speed is the start speed."
    ),
    (
        "Wiring: connect a road's outputs road.*, contact.* to the inputs of the same name, and this car's x and speed"
        " to that road; a controller drives force.*. Exchange at 1 ms."
    ),
)
