"""Three-axle 6x6 over trenches and other obstacles: rigid body, six struts with stops, disc wheels, body contact.

Nonlinear plant of paper 003 (section 3.3, where a multi-body program computes it). Generalized coordinates are position
x and z of the CG, pitch, roll and the extension of the six struts; yaw and sideways motion are locked. Equations of
motion follow from the kinematics of the seven masses, forces from virtual work, so that energy is only lost in dampers,
tires, contacts and friction, and only gained from the actuators and the imposed spin of the wheels.

Axes are ISO 8855: x forward, y left, z up; roll positive left side up, pitch positive nose down. (The thesis counts
pitch positive nose up and roll positive to the left.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.models.corners import THREE_AXLES, Corner, Corners
from fmu_sources.plants.gravity import gravity
from fmu_sources.plants.obstacle import Outline, Touch
from fmu_sources.plants.seat import SEAT_NOTE, seat_outputs
from fmu_sources.registration import component
from fmu_sources.vehicles import ThreeAxleTrenchCar, declare

SIDES = {"l": ("left", 1), "r": ("right", -1)}
POINTS = 6  # of an obstacle outline
MAX_SPEED = 5.0  # m/s
_PART = {"front": (1, 0, 0), "rear": (0, 1, 0), "belly": (0, 0, 1)}  # of the body, as masks
LEAST_COLUMN = 0.2  # of the length of a gas column at rest; compressed further, its stiffness stays
FRICTION_TIME = 4e-4  # s; least time in which friction stops a wheel that slides along its strut
PROGRESS_TIME = 1.0  # s; time constant of the smoothed speed behind `stuck`
STUCK_BELOW = 0.05  # of target.speed


@dataclass(frozen=True)
class _Small:
    """Constants that regularize, and times of the model."""

    stiffness: Any
    load: Any
    meter: Any
    speed: Any
    friction_time: Any
    progress_time: Any

    @classmethod
    def of(cls, c: Component) -> _Small:
        """Declare them."""
        return cls(
            stiffness=c.constant(
                "least.stiffness", 1e-6, "N/m", "added to that of a strut, which may be 0", source="own"
            ),
            load=c.constant(
                "least.load", 1e-3, "N", "by which at least moments of contact forces are divided", source="own"
            ),
            meter=c.constant(
                "meter", 1.0, "m", "1 m, in which lengths of the obstacle's geometry are given", source="own"
            ),
            speed=c.constant(
                "least.speed", 0.01, "m/s", "target.speed above which the vehicle can be stuck", source="own"
            ),
            friction_time=c.constant(
                "friction.time", FRICTION_TIME, "s", "least time in which friction stops a wheel", source="own"
            ),
            progress_time=c.constant(
                "progress.time", PROGRESS_TIME, "s", "time constant of the smoothed speed", source="own"
            ),
        )


@component("ThreeAxleTrench{s}", "6x6 of paper 003 over trenches and obstacles, with contact", of="three_axle_trench")
def three_axle_trench(vehicle: ThreeAxleTrenchCar, name: str = "ThreeAxleTrench") -> Component:
    """The vehicle of a file of kind `three_axle_trench` in front of a trench or another obstacle."""
    c = Component(
        name,
        kind="continuous",
        description=f"Three-axle 6x6 with wheel and body contact, for trenches and obstacles: {vehicle.name}",
        source="003 section 3.3; derivation in the source of this component",
        solver="semi_implicit",
        solver_step=5e-4,
        stop_time=10.0,
        notes=(*_NOTES, SEAT_NOTE),
    )
    p = declare(c, vehicle)
    gas = c.parameter(
        "strut.hydropneumatic",
        False,
        None,
        "gas springs (003 Figure 3.7) instead of linear ones",
        source="option; 003 section 3.3.2.1 has linear ones",
    )
    driven = c.parameter(
        "wheels.driven",
        True,
        None,
        "wheels turn at the imposed speed; false: they roll freely and give no traction",
        source="003 section 5.4: imposed",
    )
    on_road = c.parameter(
        "wheels.spin_on_road",
        False,
        None,
        "the imposed spin counts against the road; false: against the body, where the drives are",
        source="option; 003 does not say against what it is imposed",
    )
    g, small = gravity(c), _Small.of(c)
    wheels = _wheels(p, g, small)
    front, rear = (sum(w.x for w in wheels if w.axle == axle) / 2 for axle in ("a1", "a3"))
    mean_radius = p.disc.radius - sum(w.compression for w in wheels) / 6
    height = p.body.cg_height + mean_radius  # of the CG above the road at rest
    wheels.each(below=lambda w: height - (p.disc.radius - w.compression))
    tip, tail = front + p.outline.front_overhang, rear - p.outline.rear_overhang

    grounds, markers = _obstacle(c, tip, tip - tail, small.meter)
    c.check(
        ca.vertcat(*(w.static_load for w in wheels)),
        "every strut must carry load at rest: move body.cg_offset or wheel.*.x so that the CG lies between the axles",
    )
    c.check(
        height + ca.fmin(p.outline.belly_height, p.outline.tip_height),
        "the body touches the road at rest: raise outline.belly_height or outline.tip_height, or body.cg_height",
    )

    # ------------------------------------------------------------------------------------------------------ inputs

    lifts = "positive lifts the body and pushes the wheel down"
    wheels.each(force=lambda w: c.input(f"force.{w}", "N", f"actuator force at {w}, {lifts}", nominal=1e4))
    target_speed = c.input(
        "target.speed",
        "m/s",
        "rolling speed of the wheels, imposed; its first value is the start speed",
        start=3 / 3.6,
        min=0.0,
        max=MAX_SPEED,
        display_unit="km/h",
    )

    # ------------------------------------------------------------------------------------------------------ states

    angle: dict[str, Any] = {"output": True, "nominal": 0.1, "display_unit": "deg"}
    base = [
        c.state("x", "m", "distance of the CG along the road", output=True, nominal=10.0),
        c.state("body.z", "m", "CG height above its static position", output=True, nominal=0.1),
        c.state("body.pitch", "rad", "pitch angle, positive nose down", **angle),
        c.state("body.roll", "rad", "roll angle, positive left side up", **angle),
    ]
    wheels.each(
        travel=lambda w: c.state(
            f"suspension.{w}.deflection",
            "m",
            "extension of the strut from rest",
            output=True,
            nominal=0.1,
            display_unit="mm",
        )
    )
    base_rate = [
        c.state(
            "speed", "m/s", "forward speed of the CG", start=target_speed, output=True, nominal=1.0, display_unit="km/h"
        ),
        c.state("body.vz", "m/s", "vertical velocity of the CG", output=True),
        c.state("body.pitch_rate", "rad/s", "pitch rate", output=True, nominal=0.1, display_unit="deg/s"),
        c.state("body.roll_rate", "rad/s", "roll rate", output=True, nominal=0.1, display_unit="deg/s"),
    ]
    wheels.each(
        travel_rate=lambda w: c.state(f"suspension.{w}.velocity", "m/s", "rate of the strut extension", output=True)
    )
    supplied = c.state(
        "energy.supplied", "J", "work of the wheel drives and actuators so far", output=True, nominal=1e4
    )
    progress = c.state("progress", "m/s", "speed, smoothed over a second", start=target_speed, output=True)

    x, z, pitch, roll = base
    q, dq = ca.vertcat(*base), ca.vertcat(*base_rate)
    ahead = (ca.cos(pitch), -ca.sin(pitch))  # body x-axis in the road's x-z plane
    up = (ca.sin(pitch), ca.cos(pitch))

    def place(bx: Any, by: Any, bz: Any) -> tuple[Any, Any, Any]:
        """Road coordinates (x, y, z) of a point of the body relative to the CG; z from the road at rest."""
        lifted = by * ca.sin(roll) + bz * ca.cos(roll)
        aside = by * ca.cos(roll) - bz * ca.sin(roll)
        return x + bx * ahead[0] + lifted * up[0], aside, height + z + bx * ahead[1] + lifted * up[1]

    def jacobian(bx: Any, by: Any, bz: Any) -> tuple[Any, Any, Any]:
        """Velocity (x, z) of a point of the body per rate of pitch (two numbers) and of roll (along `up`)."""
        lifted = by * ca.sin(roll) + bz * ca.cos(roll)
        return -bx * up[0] + lifted * ahead[0], -bx * up[1] + lifted * ahead[1], by * ca.cos(roll) - bz * ca.sin(roll)

    # ------------------------------------------------------------------------------- wheels: kinematics and contact

    mass = [[0.0] * 4 for _ in range(4)]
    load = [0.0, -p.body.mass * g, 0.0, 0.0]  # generalized forces of x, z, pitch, roll
    mass[0][0] = mass[1][1] = p.body.mass
    mass[2][2], mass[3][3] = p.body.pitch_inertia, p.body.roll_inertia
    rolling = p.disc.radius - p.disc.rolling_loss
    carried_along = ca.if_else(on_road, 0, dq[2])  # by a spin against the body, which pitches
    spin = target_speed / rolling + carried_along
    power_speed = target_speed - (dq[2] - carried_along) * rolling  # of a drive, whose torque acts on the body too
    kinetic = (
        p.body.mass * (dq[0] ** 2 + dq[1] ** 2) + p.body.pitch_inertia * dq[2] ** 2 + p.body.roll_inertia * dq[3] ** 2
    )
    kinetic /= 2
    potential = p.body.mass * g * z
    drive_power: Any = 0.0
    actuator_power: Any = 0.0
    for w in wheels:
        s, ds = w.travel, w.travel_rate
        center = ca.vertcat(*place(w.x, w.y, -(w.below + s)))
        by_base, by_travel = ca.jacobian(center, q), ca.jacobian(center, s)  # 3 x 4, 3 x 1; by_travel has length 1
        velocity = by_base @ dq + by_travel * ds
        bias = ca.jtimes(velocity, ca.vertcat(q, s), ca.vertcat(dq, ds))  # acceleration of the wheel at constant rates

        touches = grounds[_side(w)].disc(center[0], center[2], p.disc.radius)
        total = _Contacts.of(touches, w.tire, p.disc, w.mass, velocity, spin, rolling, driven, small)
        strut, stored = _strut(p, w, gas, s, ds, small)
        along = total.fx * ahead[0] + total.fz * ahead[1]
        w.hub_fx, w.hub_fz = along, total.fx * up[0] + total.fz * up[1]
        w.center, w.velocity, w.contact = center, velocity, total
        w.clearance = grounds[_side(w)].clearance(touches)

        outer = ca.vertcat(total.fx, 0, total.fz - w.mass * g)
        inner = strut + w.force  # along the strut, on the wheel
        free = w.mass * (by_base - by_travel @ (by_travel.T @ by_base))  # wheel slides along its strut
        share = by_base.T @ free
        own = ca.dot(by_travel, outer) + inner  # generalized force of the extension
        push = by_base.T @ (outer - w.mass * (bias - by_travel * ca.dot(by_travel, bias)) - by_travel * own)
        for i in range(4):
            load[i] += push[i]
            for j in range(4):
                mass[i][j] += share[i, j]
        load[2] -= total.traction * rolling  # the drives are mounted on the body: reaction of their torque
        w.by_base, w.by_travel, w.own, w.bias = by_base, by_travel, own, bias

        drive_power += total.traction * power_speed
        actuator_power += w.force * ds
        kinetic += w.mass * ca.dot(velocity, velocity) / 2
        potential += w.mass * g * center[2] + stored + total.energy

    # ------------------------------------------------------------------------------------------------ body contact

    bumper: dict[str, Any] = {"front": 0.0, "rear": 0.0, "belly": 0.0}

    def touch(parts: dict[str, Any], bx: Any, by: Any, bz: Any, depth: Any, nx: Any, nz: Any) -> None:
        """Force of the ground on the body at one point: half of the contact stiffness, which is for both sides."""
        nonlocal potential
        px, pz, r = jacobian(bx, by, bz)
        vx = dq[0] + px * dq[2] + r * up[0] * dq[3]
        vz = dq[1] + pz * dq[2] + r * up[1] * dq[3]
        rate = -(vx * nx + vz * nz)
        onset = ca.fmin(1, depth / p.contact.onset)
        normal = ca.fmax(0, p.contact.stiffness / 2 * depth + p.contact.damping / 2 * onset * rate)
        sliding = vx * nz - vz * nx
        rub = -p.contact.friction * normal * ca.tanh(sliding / p.disc.slip_speed)
        fx, fz = normal * nx + rub * nz, normal * nz - rub * nx
        touching = partial(_where, depth > 0)
        for i, force in enumerate((fx, fz, px * fx + pz * fz, r * (up[0] * fx + up[1] * fz))):
            load[i] += touching(force)
        for part, its in parts.items():
            bumper[part] += touching(its * normal)
        potential += p.contact.stiffness / 4 * depth**2

    o = p.outline
    vertices = [
        ("front", tip, o.tip_height),
        ("rear", tail, o.tip_height),
        ("belly", front + o.belly_distance, o.belly_height),
        ("belly", rear - o.belly_distance, o.belly_height),
    ]
    knee = (front + o.knee_distance, o.knee_height), (rear - o.knee_distance, o.knee_height)
    face = partial(_face, meter=small.meter)
    overlap = 0.1 * small.meter  # of bumper and belly
    solids = [  # convex parts of the body: points on their faces, inward normals, to which part the face belongs
        [
            (*face(knee[1], vertices[3][1:]), *_PART["rear"]),
            (*face(vertices[3][1:], vertices[2][1:]), *_PART["belly"]),
            (*face(vertices[2][1:], knee[0]), *_PART["front"]),
        ],
        [
            (*of, *_PART["front"])
            for of in (face(knee[0], (tip, o.tip_height)), (tip, 0, -1, 0), (knee[0][0] - overlap, 0, 1, 0))
        ],
        [
            (*of, *_PART["rear"])
            for of in (face((tail, o.tip_height), knee[1]), (tail, 0, 1, 0), (knee[1][0] + overlap, 0, -1, 0))
        ],
    ]
    for side, ground in grounds.items():
        y = SIDES[side][1] * p.body.half_width
        for part, bx, bz in vertices:
            px, _, pz = place(bx, y, bz)
            touch({part: 1}, bx, y, bz, *ground.point(px, pz))
        for (gx, gz), convex in zip(ground.points, ground.convex, strict=True):
            dx, dz = gx - x, gz - height - z
            bx = dx * ahead[0] + dz * ahead[1]
            bz = (dx * up[0] + dz * up[1] - y * ca.sin(roll)) / ca.cos(roll)
            inside = [
                _least([((bx - fx) * nx + (bz - fz) * nz, nx, nz, *part) for fx, fz, nx, nz, *part in faces])
                for faces in solids
            ]
            depth, nx, nz, *parts = _least([(-d, *rest) for d, *rest in inside])
            depth, *parts = (ca.if_else(convex, v, 0) for v in (ca.fmax(0, -depth), *parts))
            nx, nz = (ca.if_else(convex, v, 0) for v in (nx, nz))
            nx, nz = (nx * ahead[i] + nz * up[i] for i in (0, 1))
            touch(dict(zip(_PART, parts, strict=True)), bx, y, bz, depth, nx, nz)

    # ------------------------------------------------------------------------------------------ equations of motion

    acceleration = _solve(mass, load)
    for place_, rate, value in zip(base, base_rate, acceleration, strict=True):
        c.derivative(place_, rate)
        c.derivative(rate, value)
    for w in wheels:
        carried = w.by_base @ ca.vertcat(*acceleration) + w.bias
        second = w.own / w.mass - ca.dot(w.by_travel, carried)
        c.derivative(w.travel, w.travel_rate)
        c.derivative(w.travel_rate, second)
        w.acceleration = carried + w.by_travel * second
    c.derivative(supplied, drive_power + actuator_power)
    c.derivative(progress, (dq[0] - progress) / small.progress_time)

    # ----------------------------------------------------------------------------------------------------- outputs

    ax, az, pitch_acceleration, roll_acceleration = acceleration
    c.output("body.az", az, "m/s2", "vertical acceleration of the CG")
    c.output("body.ax", ax, "m/s2", "longitudinal acceleration of the CG")
    c.output("body.roll_acceleration", roll_acceleration, "rad/s2", "roll acceleration", display_unit="deg/s2")
    c.output("body.pitch_acceleration", pitch_acceleration, "rad/s2", "pitch acceleration", display_unit="deg/s2")
    seat = ca.vertcat(*place(p.seat.x - p.body.cg_offset, p.seat.y, p.seat.z))
    by_body = ca.jacobian(seat, q)  # and what it accelerates by at constant rates
    at_seat = by_body @ ca.vertcat(*acceleration) + ca.jtimes(by_body @ dq, q, dq)
    seat_outputs(c, at_seat[0], at_seat[2])
    for w in wheels:
        center, total = w.center, w.contact
        c.output(f"hub.{w}.x", center[0], "m", "position of the wheel center along the road")
        c.output(f"hub.{w}.z", center[2], "m", "height of the wheel center above the road")
        c.output(
            f"wheel.{w}.z", center[2] - (p.disc.radius - w.compression), "m", "wheel center above its static height"
        )
        c.output(f"wheel.{w}.vz", w.velocity[2], "m/s", "vertical velocity of the wheel")
        c.output(f"wheel.{w}.az", w.acceleration[2], "m/s2", "vertical acceleration of the wheel")
        c.output(
            f"tire.{w}.deflection",
            w.clearance + w.compression,
            "m",
            "distance from the nearest ground, 0 at static load",
            display_unit="mm",
        )
        c.output(f"hub.{w}.fx", w.hub_fx, "N", "force of the tire on the hub along the body", display_unit="kN")
        c.output(f"hub.{w}.fz", w.hub_fz, "N", "force of the tire on the hub across the body", display_unit="kN")
        c.output(f"contact.{w}.fx", total.fx, "N", "longitudinal force of the ground on the tire", display_unit="kN")
        c.output(f"contact.{w}.fz", total.fz, "N", "vertical force of the ground on the tire", display_unit="kN")
        c.output(f"contact.{w}.x", center[0] + total.px, "m", "where the ground force acts, along the road")
        at = center[2] + total.pz
        at = ca.if_else(ca.fabs(at) < 1e-9 * small.meter, 0, at)  # rounding on level road is no height
        c.output(f"contact.{w}.z", at, "m", "where the ground force acts, height")
    c.output(
        "bumper.front.force", bumper["front"], "N", "contact force of the front bumper and nose", display_unit="kN"
    )
    c.output("bumper.rear.force", bumper["rear"], "N", "contact force of the rear bumper and tail", display_unit="kN")
    c.output("belly.force", bumper["belly"], "N", "contact force of the belly", display_unit="kN")
    lx, _, lz = place(front + p.lidar.ahead, 0, p.lidar.height)
    for end, (mx, mz) in markers.items():
        c.output(f"lidar.{end}.dx", mx - lx, "m", f"{end} of the obstacle ahead of the nose lidar, road axes")
        c.output(f"lidar.{end}.dz", lz - mz, "m", f"nose lidar above the {end} of the obstacle, road axes")
    c.output("lidar.x", lx, "m", "position of the nose lidar along the road")
    c.output("lidar.z", lz, "m", "height of the nose lidar above the road")
    stuck = ca.logic_and(target_speed > small.speed, progress < STUCK_BELOW * target_speed)
    c.output("stuck", ca.if_else(stuck, 1.0, 0.0), "1", "1 while the smoothed speed is below 5 % of target.speed")
    c.output("energy", kinetic + potential, "J", "mechanical energy without the spin of the wheels")
    c.output("power.drive", drive_power, "W", "power of the imposed wheel spin", display_unit="kW")
    c.output("power.actuators", actuator_power, "W", "power of all actuators", display_unit="kW")

    c.operating_point("axles at the stops", {f"suspension.{w}.deflection": -0.25 for w in wheels})
    c.operating_point("deep in the tires", {"body.z": -0.25})
    c.operating_point("body on the ground", {"body.z": -0.61})
    c.reference_input(_reference_inputs())
    return c


# ---------------------------------------------------------------------------------------------------------------- parts


def _wheels(p: Any, g: Any, small: _Small) -> Corners:
    """The wheels: position relative to the CG [m], parameters, and their loads at rest.

    Loads are the static load of the strut [N] and the compression of the tire [m]. The body rests level, its weight
    spread as on springs under a rigid plane.
    """
    wheels = Corners(THREE_AXLES)
    wheels.each(
        x=lambda w: getattr(p.wheel, w.name).x - p.body.cg_offset,
        y=lambda w: w.side * getattr(p.wheel, w.name).half_track,
        mass=lambda w: getattr(p.wheel, w.name).mass,
        strut=lambda w: getattr(p.suspension, w.name),
        tire=lambda w: getattr(p.tire, w.name),
        row=lambda w: ca.vertcat(1, w.x, w.y),
        stiffness=lambda w: w.strut.stiffness + small.stiffness,
    )
    gram = sum(w.stiffness * w.row @ w.row.T for w in wheels)
    plane = ca.vertcat(*_solve([[gram[i, j] for j in range(3)] for i in range(3)], [p.body.mass * g, 0, 0]))
    for w in wheels:
        w.static_load = w.stiffness * ca.dot(w.row, plane)
        weight = w.static_load + w.mass * g
        compression = weight / w.tire.stiffness
        over = ca.fmax(0, weight - w.tire.stiffness * p.disc.bottoming) / (
            w.tire.stiffness + p.disc.bottoming_stiffness
        )
        w.compression = ca.fmin(compression, p.disc.bottoming + over)
    return wheels


def _side(w: Corner) -> str:
    return w.name[-1]


@dataclass(frozen=True)
class _Contacts:
    """Sum of the ground forces on one tire; `px`, `pz` from the wheel center to where it acts."""

    fx: Any
    fz: Any
    traction: Any
    energy: Any
    px: Any
    pz: Any

    @classmethod
    def of(
        cls,
        touches: list[Touch],
        tire: Any,
        disc: Any,
        mass: Any,
        velocity: Any,
        spin: Any,
        rolling: Any,
        driven: Any,
        small: _Small,
    ) -> _Contacts:
        fx = fz = traction = energy = px = pz = weight = ca.SX(0)
        for t in touches:
            touching = partial(_where, t.depth > 0)  # else nothing of it is needed
            depth = ca.fmax(0, t.depth)
            over = ca.fmax(0, depth - disc.bottoming)
            rate = -(velocity[0] * t.nx + velocity[2] * t.nz)
            spring = tire.stiffness * depth + disc.bottoming_stiffness * over
            damper = tire.damping * ca.fmin(1, depth / disc.onset) * rate
            normal = t.share * ca.fmax(0, spring + damper)
            sliding = spin * rolling - (velocity[0] * t.nz - velocity[2] * t.nx)
            # The slope of the friction model is limited to what a wheel of this mass can follow in explicit steps of
            # 0.5 ms.
            grip_limit = driven * disc.friction * normal
            grip = grip_limit * ca.tanh(sliding / ca.fmax(disc.slip_speed, grip_limit * small.friction_time / mass))
            fx += touching(normal * t.nx + grip * t.nz)
            fz += touching(normal * t.nz - grip * t.nx)
            traction += touching(grip)
            energy += touching(t.share * (tire.stiffness * depth**2 + disc.bottoming_stiffness * over**2) / 2)
            reach = disc.radius - depth
            px -= touching(normal * reach * t.nx)
            pz -= touching(normal * reach * t.nz)
            weight += touching(normal)
        weight = ca.fmax(weight, small.load)
        return cls(fx, fz, traction, energy, px / weight, pz / weight)


def _strut(p: Any, w: Corner, gas: Any, s: Any, ds: Any, small: _Small) -> tuple[Any, Any]:
    """Force of one strut (positive extends) and its stored energy: spring, damper, stops. Energy is 0 at rest."""
    linear = w.static_load - w.strut.stiffness * s
    linear_energy = -w.static_load * s + w.strut.stiffness * s**2 / 2
    # A gas column with the same load and stiffness at rest: F = F0 (L / (L + s))^n, from a fifth of its length on
    # linear.
    n = p.strut.gas_exponent
    column = ca.fmax(n * w.static_load / (w.strut.stiffness + small.stiffness), 1e-6 * small.meter)
    stretch = ca.fmax(LEAST_COLUMN, 1 + s / column)
    beyond = ca.fmax(0, (LEAST_COLUMN - 1) * column - s)
    gas_force = w.static_load * stretch**-n
    stiffness = w.static_load * n / column * LEAST_COLUMN ** (-n - 1)
    m = n - 1 + 1e-9  # the energy without its singularity at exponent 1
    gas_energy = w.static_load * column * (stretch**-m - 1) / m + gas_force * beyond + stiffness * beyond**2 / 2
    gas_force += stiffness * beyond
    spring, energy = ca.if_else(gas, gas_force, linear), ca.if_else(gas, gas_energy, linear_energy)

    def stop(depth: Any, rate: Any) -> Any:
        depth = ca.fmax(0, depth)
        damper = p.strut.damping * ca.fmin(1, depth / p.strut.onset) * rate
        return ca.fmax(0, p.strut.stiffness * depth + damper), p.strut.stiffness * depth**2 / 2

    out, out_energy = stop(s - p.strut.extension, ds)
    in_, in_energy = stop(-p.strut.compression - s, -ds)
    return spring - w.strut.damping * ds - out + in_, energy + out_energy + in_energy


def _where(condition: Any, value: Any) -> Any:
    return ca.if_else(condition, value, 0)


def _least(rows: list[tuple[Any, ...]]) -> tuple[Any, ...]:
    """The row with the least first element."""
    best = rows[0]
    for row in rows[1:]:
        less = row[0] < best[0]
        best = tuple(ca.if_else(less, a, b) for a, b in zip(row, best, strict=True))
    return best


def _face(a: tuple[Any, Any], b: tuple[Any, Any], meter: Any) -> tuple[Any, Any, Any, Any]:
    """Face through two points of the lower outline, the second ahead of the first: a point of it, its inward normal."""
    dx, dz = b[0] - a[0], b[1] - a[1]
    length = ca.sqrt(dx**2 + dz**2 + 1e-12 * meter**2)
    return a[0], a[1], -dz / length, dx / length


def _solve(matrix: list[list[Any]], right: list[Any]) -> list[Any]:
    """Solve a small symmetric positive definite system (L D L')."""
    n = len(right)
    low: list[list[Any]] = [[0.0] * n for _ in range(n)]
    diagonal: list[Any] = [0.0] * n
    for j in range(n):
        diagonal[j] = matrix[j][j] - sum(low[j][k] ** 2 * diagonal[k] for k in range(j))
        for i in range(j + 1, n):
            low[i][j] = (matrix[i][j] - sum(low[i][k] * low[j][k] * diagonal[k] for k in range(j))) / diagonal[j]
    y: list[Any] = [0.0] * n
    for i in range(n):
        y[i] = right[i] - sum(low[i][k] * y[k] for k in range(i))
    x: list[Any] = [0.0] * n
    for i in reversed(range(n)):
        x[i] = y[i] / diagonal[i] - sum(low[k][i] * x[k] for k in range(i + 1, n))
    return x


def _obstacle(c: Component, tip: Any, length: Any, meter: Any) -> tuple[dict[str, Outline], dict[str, tuple[Any, Any]]]:
    """Declare the obstacle; the ground of each side, and the places the lidar looks at."""
    assumed = "assumed"
    shape = c.parameter("obstacle.shape", 1, None, "0 level road, 1 trench, 2 outline.*", min=0, max=2, source=assumed)
    start = c.parameter(
        "trench.start", 5.0, "m", "start of the trench; the CG begins at 0", min=-1e3, max=1e3, source=assumed
    )
    wide = c.parameter("trench.length", 1.4, "m", "length of the trench", min=0.01, max=100.0, source="003 Table 5.2")
    deep = c.parameter("trench.depth", 2.0, "m", "depth of the trench", min=0.01, max=100.0, source=assumed)
    skew = c.parameter(
        "trench.right_offset",
        0.0,
        "m",
        "trench under the right wheels starts this much later",
        min=-10.0,
        max=10.0,
        nominal=0.1,
        source=assumed,
    )
    is_trench, is_outline = shape == 1, shape == 2
    c.check(
        ca.if_else(is_trench, start + ca.fmin(0, skew) - tip, 1),
        "trench.start lies behind the front of the vehicle: the trench must begin ahead of the front bumper",
    )
    c.check(
        ca.if_else(is_trench, length - wide, 1),
        "trench.length exceeds the length of the vehicle, which would just drive "
        "down into it: take a shorter trench or an outline",
    )

    default_x = [5.0, 5.5, 6.5, 7.0, 8.0, 9.0]
    default_z = [0.0, 0.3, 0.3, 0.0, 0.0, 0.0]
    count = c.parameter(
        "outline.points",
        4,
        None,
        "points of the outlines that count; level after them",
        min=1,
        max=POINTS,
        source=assumed,
    )
    grounds = {}
    markers = {"start": (start, 0), "finish": (start + wide, 0)}
    for side, (word, sign) in SIDES.items():
        name = f"outline.{word}"
        px = c.parameter(
            f"{name}.x",
            np.array(default_x),
            "m",
            f"outline under the {word} wheels, along the road",
            min=-1e3,
            max=1e3,
            source=assumed,
        )
        pz = c.parameter(
            f"{name}.z",
            np.array(default_z),
            "m",
            f"outline under the {word} wheels, height",
            min=-100.0,
            max=100.0,
            source=assumed,
        )
        ox, oz = [px[0]], [pz[0]]
        for k in range(1, POINTS):
            counts = count > k
            ox.append(ca.if_else(counts, px[k], ox[-1] + meter))
            oz.append(ca.if_else(counts, pz[k], oz[-1]))
        gaps = ca.vertcat(*(b - a for a, b in pairwise(ox)))
        rises = ca.vertcat(*(b - a for a, b in pairwise(oz)))
        c.check(
            ca.if_else(is_outline, gaps + 1e-9, 1),
            f"{name}.x goes back between two points, so the outline would cross "
            "itself or overhang: order the points along the road (equal x makes a vertical wall)",
        )
        c.check(
            ca.if_else(is_outline, gaps**2 + rises**2 - 1e-6, 1),
            f"{name}.x and {name}.z have two neighboring points in one place: leave one out, or set outline.points",
        )
        c.check(
            ca.if_else(is_outline, 1e-6 - ca.fabs(oz[0]), 1),
            f"{name}.z[1] must be 0: the vehicle starts on level road at height 0",
        )
        c.check(
            ca.if_else(is_outline, ox[0] - tip, 1),
            f"{name}.x[1] lies behind the front of the vehicle: the obstacle must begin ahead of the front bumper",
        )
        begin = start + (0 if sign > 0 else skew)
        trench_x, trench_z = [begin, begin, begin + wide, begin + wide], [0, -deep, -deep, 0]
        trench_x += [begin + wide + k * meter for k in range(1, POINTS - 3)]
        trench_z += [0] * (POINTS - 4)
        level = [begin + k * meter for k in range(POINTS)]
        gx = [
            ca.if_else(is_outline, a, ca.if_else(is_trench, b, f)) for a, b, f in zip(ox, trench_x, level, strict=True)
        ]
        gz = [ca.if_else(is_outline, a, ca.if_else(is_trench, b, 0)) for a, b in zip(oz, trench_z, strict=True)]
        grounds[side] = Outline(gx, gz, meter)
        if sign > 0:
            end_x, end_z = ox[0], oz[0]
            for k in range(1, POINTS):
                end_x, end_z = ca.if_else(count > k, ox[k], end_x), ca.if_else(count > k, oz[k], end_z)
            markers = {
                "start": (ca.if_else(is_outline, ox[0], start), 0),
                "finish": (ca.if_else(is_outline, end_x, start + wide), ca.if_else(is_outline, end_z, 0)),
            }
    return grounds, markers


def _reference_inputs() -> dict[str, Any]:
    """Wheels drive toward the trench while the front axle is retracted, for the reference result."""
    signals: dict[str, Any] = {"target.speed": lambda t: 2.5}
    for n in ("a1l", "a1r"):
        signals[f"force.{n}"] = lambda t: -2e4 if t > 0.05 else 0.0
    signals["force.a3r"] = lambda t: 5e3 if t > 0.1 else 0.0
    return signals


_NOTES = (
    (
        "The body moves along the road, heaves, pitches and rolls; yaw and sideways motion are locked. Six wheels slide"
        " along struts that are fixed in the body, with spring, damper and stops. Angles may be large: a vehicle that"
        " falls into the trench is computed to the end."
    ),
    (
        "Wheels are discs. The ground below the outline of an obstacle is taken as convex solids that meet in its"
        " concave corners; a wheel touches each solid at the point closest to its center, the force acts along the line"
        " between both, and the forces of several solids add up (at obtuse corners less, so that a nearly straight road"
        " pushes once). A tire has a stiffness, a second one from bottoming on, and a damper that sets in with the"
        " first millimeters."
    ),
    (
        "target.speed is the rolling speed of all wheels and is imposed: the spin does not depend on the torque, and"
        " the drives are mounted on the body, which takes the reaction. The spin counts against the body, so pitching"
        " turns the wheels too; with wheels.spin_on_road it does not. Friction limits traction: mu N tanh(sliding /"
        " slip_speed); above some 150 kN the slip speed grows with the load, so that friction does not stop a wheel in"
        " less than 0.4 ms. Speed 0 is allowed; the vehicle then stands, and stuck stays 0. With wheels.driven false"
        " the vehicle coasts from its start speed."
    ),
    (
        "Bumper tips and the ends of the belly touch the ground, and convex corners of the ground touch the outline of"
        " the body. belly.force counts the flat belly and its ends; the rising parts before and behind it belong to the"
        " bumpers. The stiffness is that of both sides of the vehicle together, half of it left and half right."
    ),
    (
        "Obstacle: obstacle.shape 0 is level road, 1 a trench (trench.*), 2 the polyline outline.left and outline.right"
        " of up to 6 points each, which may differ: step, bump, ditch. Before its first and after its last point the"
        " ground is level; equal x makes a vertical wall. A trench of depth 0 is refused: for level road set"
        " obstacle.shape to 0. Parameters that do not fit together (trench behind or longer than the vehicle, an"
        " outline that runs back) end initialization with an error."
    ),
    (
        "Springs are preloaded so that the body rests level at the given heights: another mass or CG changes the"
        " preload, not the ride height. All z and deflections count from there; the vehicle starts at rest on level"
        " road, rolling at target.speed. Trench positions count from the first position of the CG. strut.hydropneumatic"
        " gives gas springs with the same load and stiffness at rest."
    ),
    (
        "For small motions heave is that of ThreeAxleRide with the same numbers; pitch is too with wheels.driven false,"
        " some 4 % softer because the CG lies above the wheels. With the spin imposed, pitching turns the vehicle about"
        " the ground and moves its mass too: the natural frequency of pitch falls by a fifth. The linear model has no"
        " such motion."
    ),
    (
        "lidar.*.dx is the distance of the obstacle's start and finish ahead of the nose lidar, lidar.*.dz how far the"
        " lidar is above them, both along the axes of the road, as equations (4.18) to (4.28) of paper 003 need them."
        " They are positions of markers: there are values without an obstacle too (those of the trench), and behind the"
        " vehicle dx is negative."
    ),
    (
        "hub.*.fx is the force of the tire on the hub along the body, what Table 5.3 limits. body.ax and body.az are"
        " along the axes of the road. stuck is 1 while the speed, smoothed over a second, is below 5 % of target.speed;"
        " it is a flag with jumps, not meant for Model Exchange root finding. energy minus energy.supplied never grows."
    ),
    (
        "Wiring: a controller drives force.*. Exchange at 1 ms; where peaks count, at 0.5 ms: when body and ground"
        " meet, the acceleration rises within a solver step and falls within a few milliseconds."
    ),
)
