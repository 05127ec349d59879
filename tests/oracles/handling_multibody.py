"""The car of a file of kind `full_car` in Exudyn, a third-party multibody code, as its steering wheel turns.

A chassis with six degrees of freedom carries four discs with masses and inertias of their own. Each slides along a
guide that is fixed in the chassis, and turns about its axle. Exudyn has the equations of motion
(its kinematic tree, with a Runge-Kutta method of fourth order); forces are formulae of their own here. A tire acts
where the disc is nearest to the level road.

Shared with our full car: the numbers of the vehicle file and of the tire file, the formula of the friction ellipse that
the numbers of the vehicle file belong to, and how the driver keeps the speed. The Magic Formula is written
once more from H. B. Pacejka, Tire and Vehicle Dynamics, third edition, 2012, (4.E1) to (4.E78), as the book has it.
Not shared: kinematics, equations of motion, points where forces act, and all code.
"""

from __future__ import annotations

from collections.abc import Callable
from math import atan, cos, exp, hypot, pi, sin, sqrt, tan
from types import SimpleNamespace
from typing import Any

import numpy as np

from fmu_sources.vehicles.schema import FullCar
from oracles.multibody import CORNERS, GRAVITY, LOW_SPEED, Motion

LEAST_RELAXATION = 0.1  # m
BODY, FIRST = 5, 6  # links of the tree: the chassis, the guide of the first wheel; its disc follows it


class HandlingCar:
    """The car on a level road.

    Args:
        vehicle: its file.
        wheel: angle of the steering wheel [rad] over time [s].
        speed: that the driver keeps [m/s].
    """

    def __init__(self, vehicle: FullCar, wheel: Callable[[float], float], speed: float) -> None:
        import exudyn as exu
        from exudyn.utilities import NodeGenericODE2, ObjectKinematicTree

        self.exu: Any = exu
        self.vehicle, self.wheel, self.speed = vehicle, wheel, speed
        body = vehicle.body
        self.height, self.hub = body.cg_height.value, vehicle.wheel.hub_height.value
        ahead = body.cg_position.value * body.wheelbase.value
        self.x = [ahead, ahead, ahead - body.wheelbase.value, ahead - body.wheelbase.value]
        self.y = [s * body.track.value / 2 for s in (1, -1, 1, -1)]
        share = [-self.x[2] / body.wheelbase.value, self.x[0] / body.wheelbase.value]
        self.rest = [body.mass.value * GRAVITY * s / 2 for s in share for _ in "lr"]  # of the struts [N]
        self.mass = body.mass.value + 4 * vehicle.wheel.mass.value
        self._law = vehicle.tire.file and PacejkaTire(vehicle.tire.file.values)
        self._slip = [(0.0, 0.0)] * 4
        self._ahead = list(self._slip)  # slips at the end of the step
        self._load = [0.0] * 4
        self._steered = [0.0] * 4  # torque [N.m] about a steered axle less that about the disc's, which does not steer
        self._integral = self._torque = 0.0
        self._step = 1e-3

        in_joints: Any = self._joints
        joint, matrix = exu.JointType, exu.Matrix3DList
        kinds = [
            joint.PrismaticX,
            joint.PrismaticY,
            joint.PrismaticZ,
            joint.RevoluteZ,
            joint.RevoluteY,
            joint.RevoluteX,
        ]
        parents, offsets = list(range(-1, BODY)), [np.zeros(3)] * FIRST
        own = [body.roll_inertia.value, body.pitch_inertia.value, body.yaw_inertia.value]
        masses, inertias = [0.0] * BODY + [body.mass.value], [np.zeros((3, 3))] * BODY + [np.diag(own)]
        spin = vehicle.wheel.spin_inertia.value
        for x, y in zip(self.x, self.y, strict=True):
            kinds += [joint.PrismaticZ, joint.RevoluteY]
            parents += [BODY, len(parents)]
            offsets += [np.array([x, y, self.hub - self.height]), np.zeros(3)]
            masses += [0.0, vehicle.wheel.mass.value]
            inertias += [np.zeros((3, 3)), np.diag([spin / 2, spin, spin / 2])]  # of a thin disc
        n = len(kinds)
        start = np.zeros(n)
        start[0] = speed
        start[FIRST + 1 :: 2] = speed / vehicle.wheel.radius.value

        self.container = exu.SystemContainer()
        self.mbs: Any = self.container.AddSystem()
        self.node = self.mbs.AddNode(
            NodeGenericODE2(
                referenceCoordinates=[0.0] * n,
                initialCoordinates=[0.0] * n,
                initialCoordinates_t=list(start),
                numberOfODE2Coordinates=n,
            )
        )

        def as_list(kind: Any, values: list[np.ndarray]) -> Any:
            found = kind()
            for value in values:
                found.Append(value)
            return found

        self.tree = self.mbs.AddObject(
            ObjectKinematicTree(
                nodeNumber=self.node,
                jointTypes=kinds,
                linkParents=parents,
                jointTransformations=as_list(matrix, [np.eye(3)] * n),
                jointOffsets=as_list(exu.Vector3DList, offsets),
                linkInertiasCOM=as_list(matrix, inertias),
                linkCOMs=as_list(exu.Vector3DList, [np.zeros(3)] * n),
                linkMasses=masses,
                baseOffset=[0.0, 0.0, self.height],
                gravity=[0.0, 0.0, -GRAVITY],
                forceUserFunction=in_joints,
            )
        )
        self._tires()
        self.mbs.SetPreStepUserFunction(self._advance)
        self.mbs.Assemble()

    # --------------------------------------------------------------------------------------------------------- forces

    def _joints(self, _mbs: Any, _t: float, _n: int, q: Any, rate: Any) -> list[float]:
        """Struts along the guides, and the torques of the driver between chassis and discs."""
        suspension, bars = self.vehicle.suspension, self.vehicle.antiroll
        forces = [0.0] * len(q)
        ratio = suspension.motion_ratio.value
        out = [-q[FIRST + 2 * i] for i in range(4)]  # travel, positive apart
        for i in range(4):
            strut, bar = (suspension.front, bars.front) if i < 2 else (suspension.rear, bars.rear)
            push = self.rest[i] - ratio * (strut.spring.value * ratio * out[i])
            push += ratio * (strut.damper.value * ratio * rate[FIRST + 2 * i])
            beyond = abs(out[i]) - suspension.stop.travel.value
            if beyond > 0:
                stop = suspension.stop.stiffness.value * beyond + suspension.stop.cubic.value * beyond**3
                push -= np.copysign(stop, out[i])
            push -= bar.value * (out[i] - out[i ^ 1])
            forces[FIRST + 2 * i] = -push
            forces[FIRST + 2 * i + 1] = self._torque + self._steered[i]
        return forces

    def _tires(self) -> None:
        exu, mbs = self.exu, self.mbs
        ground = mbs.AddMarker(exu.utilities.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
        for i in range(4):
            disc = exu.utilities.MarkerKinematicTreeRigid(objectNumber=self.tree, linkNumber=FIRST + 2 * i + 1)
            mbs.AddObject(
                exu.utilities.ObjectConnectorRigidBodySpringDamper(
                    markerNumbers=[ground, mbs.AddMarker(disc)],
                    stiffness=np.zeros((6, 6)),
                    damping=np.zeros((6, 6)),
                    springForceTorqueUserFunction=self._tire(i),
                )
            )

    def _steer(self, i: int, t: float) -> float:
        """Steer angle [rad] of a wheel: the axes of both front wheels meet on the rear one's (Ackermann)."""
        steering, body = self.vehicle.steering, self.vehicle.body
        mean = self.wheel(t) / steering.ratio.value
        mean = min(max(mean, -steering.max_angle.value), steering.max_angle.value)
        if i > 1 or mean == 0:
            return 0.0
        radius = body.wheelbase.value / tan(mean)  # of the turn, to the left
        return atan(body.wheelbase.value / (radius - steering.ackermann.value * self.y[i]))

    def _tire(self, i: int) -> Callable[..., list[float]]:
        """Force and moment of the road on a disc, as a connector to the ground wants them."""
        vehicle, kinds = self.vehicle, self.exu.OutputVariableType
        tire, radius, side = vehicle.tire, vehicle.wheel.radius.value, 1 if self.y[i] > 0 else -1
        weight = self.rest[i] + vehicle.wheel.mass.value * GRAVITY

        def law(mbs: Any, t: float, _n: int, place: Any, _r: Any, velocity: Any, turning: Any, *_: Any) -> list[float]:
            q = mbs.GetNodeOutput(self.node, kinds.Coordinates)
            axes = _turn(*q[3:6])
            angle = self._steer(i, t)
            axle = axes @ [-sin(angle), cos(angle), 0.0]
            spin = float(mbs.GetNodeOutput(self.node, kinds.Coordinates_t)[FIRST + 2 * i + 1])
            forward = np.array([axle[1], -axle[0], 0.0]) / hypot(axle[0], axle[1])
            left = np.array([-forward[1], forward[0], 0.0])
            lean = _cross(forward, axle)  # up in the plane of the disc
            below = -place[2] / lean[2] * lean  # from the center to the road
            carrier = turning - spin * axes[:, 1]
            load = max(0.0, weight + tire.stiffness.value * (self.hub - place[2]) - tire.damping.value * velocity[2])
            rolling = float(velocity @ forward)
            sliding = float((velocity + _cross(carrier, below)) @ left)
            slips = self._slip[i]
            if self._law:
                of = self._law(load, slips[0], -slips[1], atan(lean @ left / -lean[2]), rolling, side)
            else:
                of = self._ellipse(load, *slips)
            # The slips at the end of the step, implicitly.
            pace = hypot(rolling, LOW_SPEED)
            self._ahead[i] = tuple(
                (old + self._step / lag * rate) / (1 + self._step / lag * pace)
                for old, lag, rate in zip(
                    slips, (of.relaxation_x, of.relaxation_y), (spin * radius - rolling, -sliding), strict=True
                )
            )
            self._load[i] = load
            force = of.fx * forward + of.fy * left + np.array([0.0, 0.0, load])
            moment = _cross(below, force) + of.mx * forward + of.my * axle + [0.0, 0.0, of.mz]
            self._steered[i] = float(moment @ (axle - axes[:, 1]))
            return [*(-force), *(-moment)]

        return law

    def _ellipse(self, load: float, slip_x: float, slip_y: float) -> Any:
        tire = self.vehicle.tire
        fx, fy = tire.slip_stiffness.value * slip_x, tire.cornering_stiffness.value * slip_y
        part = load / sqrt(1 + (fx * fx + fy * fy) / tire.friction.value**2)
        lags = {"relaxation_x": tire.longitudinal_relaxation.value, "relaxation_y": tire.lateral_relaxation.value}
        return SimpleNamespace(fx=part * fx, fy=part * fy, mx=0.0, my=0.0, mz=0.0, **lags)

    # -------------------------------------------------------------------------------------------------------- running

    def _forward_speed(self) -> float:
        q = self.mbs.GetNodeOutput(self.node, self.exu.OutputVariableType.Coordinates)
        rate = self.mbs.GetNodeOutput(self.node, self.exu.OutputVariableType.Coordinates_t)
        return float(rate[0] * cos(q[3]) + rate[1] * sin(q[3]))

    def _advance(self, _mbs: Any, _t: float) -> bool:
        """Driver and slips, once a step."""
        control = self.vehicle.speed_control
        error = self.speed - self._forward_speed()
        ask = control.gain.value * error + control.integral_gain.value * self._integral
        ask *= self.mass * self.vehicle.wheel.radius.value / 4
        self._torque = float(np.clip(ask, -control.max_torque.value, control.max_torque.value))
        if self._torque == ask:
            self._integral += error * self._step
        self._slip = list(self._ahead)
        return True

    def run(self, duration: float, step: float = 2e-3) -> Motion:
        """The motion over `duration` [s] in steps of `step` [s]."""
        exu, mbs, self._step = self.exu, self.mbs, step
        kinds = exu.OutputVariableType
        rows: list[list[float]] = []

        def record(_mbs: Any, t: float) -> bool:
            q = mbs.GetNodeOutput(self.node, kinds.Coordinates)
            rate = mbs.GetNodeOutput(self.node, kinds.Coordinates_t)
            yaw_rate = rate[3] * cos(q[4]) * cos(q[5]) - rate[4] * sin(q[5])  # about the body's axis
            rows.append([t, *q[:6], yaw_rate, self._forward_speed(), *self._load])
            return True

        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps = round(duration / step)
        settings.timeIntegration.endTime = duration
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        settings.show.statistics = False
        mbs.SetPostStepUserFunction(record)
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.RK44)
        body = ("x", "y", "body.z", "body.yaw", "body.pitch", "body.roll", "body.yaw_rate", "speed")
        names = ["time", *body, *(f"tire.{k}.force" for k in CORNERS)]
        columns = dict(zip(names, np.array(rows).T, strict=True))
        return Motion(columns.pop("time"), columns)


class PacejkaTire:
    """The Magic Formula 6.1 with the coefficients of a file, without the terms that are 0 in `hmmwv.tir`."""

    def __init__(self, values: Any) -> None:
        self.p = SimpleNamespace(**values)

    def __call__(self, load: float, kappa: float, slip: float, gamma: float, speed: float, side: int) -> Any:
        """Forces [N] and moments [N.m] about the axes of the contact patch (ISO 8855), and relaxation lengths [m].

        `slip`: tangent of the slip angle; `gamma`: inclination [rad]; `side`: 1 left, where it was measured, or -1.
        """
        p = self.p
        fz = max(load, p.FZMIN)  # below it forces are in proportion to the load
        df, dp = fz / p.FNOMIN - 1, p.INFLPRES / p.NOMPRES - 1
        a, g = side * slip, sin(side * gamma)

        def wave(b: float, c: float, e: float, x: float) -> float:
            return c * atan(b * x - e * (b * x - atan(b * x)))

        def sign(x: float) -> float:
            return float(np.sign(x))

        def across(g: float) -> Any:  # the side force of a wheel that leans by g
            mu = (p.PDY1 + p.PDY2 * df) * (1 + p.PPY3 * dp + p.PPY4 * dp**2) * (1 - p.PDY3 * g**2)
            k = p.PKY1 * p.FNOMIN * (1 + p.PPY1 * dp) * (1 - p.PKY3 * abs(g))
            k *= sin(p.PKY4 * atan(fz / p.FNOMIN / ((p.PKY2 + p.PKY5 * g**2) * (1 + p.PPY2 * dp))))
            kg = fz * (p.PKY6 + p.PKY7 * df) * (1 + p.PPY5 * dp)
            svg = fz * (p.PVY3 + p.PVY4 * df) * g
            sv = fz * (p.PVY1 + p.PVY2 * df) + svg
            sh = p.PHY1 + p.PHY2 * df + (kg * g - svg) / k
            e = (p.PEY1 + p.PEY2 * df) * (1 + p.PEY5 * g**2 - (p.PEY3 + p.PEY4 * g) * sign(a + sh))
            b = k / (p.PCY1 * mu * fz)
            pure = mu * fz * sin(wave(b, p.PCY1, e, a + sh)) + sv
            br = (p.RBY1 + p.RBY4 * g**2) * cos(atan(p.RBY2 * (a - p.RBY3)))
            shk, ek = p.RHY1 + p.RHY2 * df, p.REY1 + p.REY2 * df
            weight = cos(wave(br, p.RCY1, ek, kappa + shk)) / cos(wave(br, p.RCY1, ek, shk))
            induced = mu * fz * (p.RVY1 + p.RVY2 * df + p.RVY3 * g) * cos(atan(p.RVY4 * a))
            induced *= sin(p.RVY5 * atan(p.RVY6 * kappa))
            return SimpleNamespace(k=k, b=b, sh=sh, sv=sv, weighted=weight * pure, induced=induced)

        y = across(g)
        fy = y.weighted + y.induced
        # Along the wheel.
        mu = (p.PDX1 + p.PDX2 * df) * (1 + p.PPX3 * dp + p.PPX4 * dp**2) * (1 - p.PDX3 * g**2)
        kx = fz * (p.PKX1 + p.PKX2 * df) * exp(p.PKX3 * df) * (1 + p.PPX1 * dp + p.PPX2 * dp**2)
        x = kappa + p.PHX1 + p.PHX2 * df
        e = (p.PEX1 + p.PEX2 * df + p.PEX3 * df**2) * (1 - p.PEX4 * sign(x))
        fx = mu * fz * sin(wave(kx / (p.PCX1 * mu * fz), p.PCX1, e, x)) + fz * (p.PVX1 + p.PVX2 * df)
        br = (p.RBX1 + p.RBX3 * g**2) * cos(atan(p.RBX2 * kappa))
        ex = p.REX1 + p.REX2 * df
        fx *= cos(wave(br, p.RCX1, ex, a + p.RHX1)) / cos(wave(br, p.RCX1, ex, p.RHX1))
        # Moments.
        at = a + p.QHZ1 + p.QHZ2 * df + (p.QHZ3 + p.QHZ4 * df) * g
        ar = a + y.sh + y.sv / y.k
        at_eq, ar_eq = (sign(v) * hypot(v, kx / y.k * kappa) for v in (at, ar))
        bt = (p.QBZ1 + p.QBZ2 * df + p.QBZ3 * df**2) * (1 + p.QBZ5 * abs(g) + p.QBZ6 * g**2)
        dt = fz * p.UNLOADED_RADIUS / p.FNOMIN * (p.QDZ1 + p.QDZ2 * df) * (1 - p.PPZ1 * dp)
        dt *= 1 + p.QDZ3 * abs(g) + p.QDZ4 * g**2
        et = (p.QEZ1 + p.QEZ2 * df + p.QEZ3 * df**2) * (1 + (p.QEZ4 + p.QEZ5 * g) * 2 / pi * atan(bt * p.QCZ1 * at))
        trail = dt * cos(wave(bt, p.QCZ1, min(1.0, et), at_eq)) * cos(atan(a))
        dr = (p.QDZ8 + p.QDZ9 * df) * (1 + p.PPZ2 * dp) + (p.QDZ10 + p.QDZ11 * df) * abs(g)
        dr = fz * p.UNLOADED_RADIUS * (p.QDZ6 + p.QDZ7 * df + dr * g) * cos(atan(a))
        residual = dr * cos(atan((p.QBZ9 + p.QBZ10 * y.b * p.PCY1) * ar_eq))
        lever = p.UNLOADED_RADIUS * (p.SSZ1 + p.SSZ2 * fy / p.FNOMIN + (p.SSZ3 + p.SSZ4 * df) * g)
        mz = residual - trail * across(0.0).weighted + lever * fx
        mx = p.UNLOADED_RADIUS * fz * (p.QSX1 - p.QSX2 * g * (1 + p.PPMX1 * dp) + p.QSX3 * fy / p.FNOMIN)
        pace = abs(speed / p.LONGVL)
        my = p.QSY1 + p.QSY2 * fx / p.FNOMIN + p.QSY3 * pace + p.QSY4 * pace**4
        my += (p.QSY5 + p.QSY6 * fz / p.FNOMIN) * g**2
        my *= -fz * p.UNLOADED_RADIUS * (fz / p.FNOMIN) ** p.QSY7 * (1 + dp) ** p.QSY8
        part = load / fz
        return SimpleNamespace(
            fx=part * fx,
            fy=side * part * fy,
            mx=side * part * mx,
            my=part * my,
            mz=side * part * mz,
            relaxation_x=max(LEAST_RELAXATION, kx / p.LONGITUDINAL_STIFFNESS),
            relaxation_y=max(LEAST_RELAXATION, abs(y.k) / p.LATERAL_STIFFNESS),
        )


def _cross(a: Any, b: Any) -> np.ndarray:
    """Product of two vectors (3,); faster than that of NumPy, which is made for many."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _turn(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Rotation matrix (3, 3) of yaw, then pitch, then roll."""
    cy, sy, cp, sp, cr, sr = (f(a) for a in (yaw, pitch, roll) for f in (cos, sin))
    return (
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    )
