"""The car of a file with hardpoints in Exudyn, a third-party multibody code.

It consists of rigid bodies, joints, and forces between them. Nothing of our equations is used.

Bodies are where the file's hardpoints have them at design, with the file's masses and inertias; the arms turn about
their pivots, ball joints and tierods close the mechanisms, the wheels turn on their uprights. Springs, stops, dampers,
tires and the driver are written once more from the file's parameters, the tires with the exact area of a disc below a
finely divided profile (`oracles.tire_contact`). Exudyn finds the motion with the generalized-alpha method in redundant
coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_sources.vehicles.schema import WishboneCar
from oracles.tire_contact import AreaContact, Road

GRAVITY = 9.81  # m/s2
LOW_SPEED = 1.0  # m/s, below which slip is formed with it
CORNERS = ("fl", "fr", "rl", "rr")


def level(x: np.ndarray) -> np.ndarray:
    """A level road."""
    return np.zeros_like(x)


@dataclass(frozen=True)
class Motion:
    """What was recorded at every step: times (n,) [s], and signals (n,) by the names that our FMU has for them."""

    time: np.ndarray
    signals: dict[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.signals[name]


class MultibodyCar:
    """The car over a road.

    `force` (4,) [N]: of the actuators, at all times; `speed` [m/s] at the start, which the driver keeps.
    `contact`: how the road bears the tires, one of `oracles.tire_contact.RULES`.
    `wheel`: angle of the steering wheel [rad] over time [s], which moves the inner ends of the tierods with a link;
    without it they are fixed to the chassis.
    """

    def __init__(
        self,
        vehicle: WishboneCar,
        road: Road = level,
        *,
        speed: float = 0.0,
        start: float = 5.0,
        height: float = 0.80,
        force: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
        contact: str = "road normal",
        wheel: Callable[[float], float] | None = None,
    ) -> None:
        import exudyn as exu
        from exudyn.utilities import RigidBodyInertia

        self.exu: Any = exu
        self.vehicle, self.road, self.speed, self.force = vehicle, road, speed, force
        self._contact = AreaContact(vehicle.tire.radius.value, contact)
        self.container = self.exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self._slip = [0.0] * 4
        self._per_angle: float | None = None
        self._integral = 0.0
        self._torque = 0.0
        self._step = 1e-3
        self._tire = [(0.0, 0.0)] * 4  # load and slip, as evaluated last

        body = vehicle.body
        self.cg = np.array([start, 0.0, height])
        self.frame = self.cg - [body.com_x.value, 0.0, body.com_z.value]  # origin of the chassis frame

        def rigid(
            mass: float, inertia: np.ndarray, place: np.ndarray, turn: np.ndarray | None = None, **more: Any
        ) -> Any:
            tensor = np.asarray(inertia)
            if turn is not None:
                tensor = turn @ tensor @ turn.T
            return self.mbs.CreateRigidBody(
                referencePosition=list(place),
                inertia=RigidBodyInertia(mass, tensor),
                gravity=[0, 0, -GRAVITY],
                initialVelocity=[speed, 0, 0],
                **more,
            )

        # The steering gear is fixed to the chassis: one body about the common center of mass.
        parts = [
            (
                body.mass.value,
                np.zeros(3),
                np.diag([body.roll_inertia.value, body.pitch_inertia.value, body.yaw_inertia.value]),
            )
        ]
        gear = vehicle.steering_gear
        for part in (gear.pitman,) if wheel else (gear.link, gear.pitman):
            place = np.array(part.position.value) * [1, 0, 1] - [body.com_x.value, 0.0, body.com_z.value]
            parts.append((part.mass.value, place, np.zeros((3, 3))))
        total = sum(m for m, _, _ in parts)
        self.com = np.sum([m * r for m, r, _ in parts], axis=0) / total
        tensor = np.zeros((3, 3))
        for m, r, own in parts:
            d = r - self.com
            tensor += own + m * (d @ d * np.eye(3) - np.outer(d, d))
        self.chassis = rigid(total, tensor, self.cg + self.com)
        self._inner = self._link(wheel, rigid) if wheel else (self.chassis, self.cg + self.com)
        self.wheels: list[Any] = []
        for i, corner in enumerate(CORNERS):
            self._corner(i, corner, rigid)
        if any(force):
            self._actuators()
        self.mbs.SetPreStepUserFunction(self._advance)
        self.mbs.Assemble()

    # ------------------------------------------------------------------------------------------------------- building

    def _corner(self, i: int, corner: str, rigid: Callable[..., Any]) -> None:
        vehicle, mbs = self.vehicle, self.mbs
        axle = getattr(vehicle.suspension, "front" if corner[0] == "f" else "rear")
        mirror = np.array([1.0, 1.0 if corner[1] == "l" else -1.0, 1.0])

        def at(name: str) -> np.ndarray:
            forward, left, up = getattr(axle.points, name).value
            return np.asarray(self.frame + mirror * [forward + axle.reference.value, left, up])

        center = at("wheel_centre")
        wheel = vehicle.wheel
        spin = self.speed / (vehicle.tire.radius.value - 0.005)
        turning = np.diag(
            [wheel.tilt_inertia.value, wheel.spin_inertia.value + wheel.shaft_inertia.value, wheel.tilt_inertia.value]
        )
        disc = rigid(wheel.mass.value, turning, center, initialAngularVelocity=[0, spin, 0])
        upright = rigid(vehicle.upright.mass.value, np.diag(vehicle.upright.inertia.value), at("upright_com"))
        if corner == "fl":
            self._left = upright, at
        mbs.CreateGenericJoint(itemNumbers=[upright, disc], position=list(center), constrainedAxes=[1, 1, 1, 1, 0, 1])
        arms = {}
        for which in ("upper", "lower"):
            solid = getattr(vehicle, f"{which}_arm")
            front, rear, ball, com = (at(f"{which}_{n}") for n in ("front", "rear", "ball", "com"))
            along = (front - rear) / np.linalg.norm(front - rear)
            normal = np.cross(along, ball - rear)
            normal /= np.linalg.norm(normal)
            turn = np.column_stack([along, np.cross(normal, along), normal])
            arm = rigid(solid.mass.value, np.diag(solid.inertia.value), com, turn)
            axes = np.column_stack([np.cross(normal, along), normal, along])
            mbs.CreateGenericJoint(
                itemNumbers=[self.chassis, arm],
                position=list((front + rear) / 2),
                rotationMatrixAxes=axes,
                constrainedAxes=[1, 1, 1, 1, 1, 0],
            )
            mbs.CreateSphericalJoint(itemNumbers=[arm, upright], position=list(ball))
            arms[which] = com
            if which == "lower":
                lower = arm
        body_at = self.cg + self.com
        inner, inner_at = self._inner if corner[0] == "f" else (self.chassis, body_at)
        mbs.CreateDistanceConstraint(
            itemNumbers=[inner, upright],
            localPosition0=list(at("tierod_inner") - inner_at),
            localPosition1=list(at("tierod_outer") - at("upright_com")),
        )
        for name, law in (("spring", self._spring(axle)), ("damper", self._damper(axle))):
            top, bottom = at(f"{name}_top"), at(f"{name}_bottom")
            mbs.CreateSpringDamper(
                itemNumbers=[self.chassis, lower],
                localPosition0=list(top - body_at),
                localPosition1=list(bottom - arms["lower"]),
                referenceLength=1e-9,
                stiffness=1.0,
                springForceUserFunction=law,
            )
        exu = self.exu
        ground = mbs.AddMarker(exu.utilities.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
        hub = mbs.AddMarker(exu.utilities.MarkerBodyRigid(bodyNumber=disc))
        mbs.AddObject(
            exu.utilities.ObjectConnectorRigidBodySpringDamper(
                markerNumbers=[ground, hub],
                stiffness=np.zeros((6, 6)),
                damping=np.zeros((6, 6)),
                springForceTorqueUserFunction=self._tire_law(i, disc),
            )
        )
        self.wheels.append(disc)

    def _link(self, wheel: Callable[[float], float], rigid: Callable[..., Any]) -> tuple[Any, np.ndarray]:
        """The link of the steering gear, which the steering wheel moves to the side; and its place (3,) [m]."""
        steering, part = self.vehicle.steering, self.vehicle.steering_gear.link
        most = steering.max_angle.value
        place = self.frame + np.array(part.position.value) * [1, 0, 1]
        link = rigid(part.mass.value, 0.01 * np.eye(3), place)

        def shift(t: float) -> float:
            if not wheel(t):
                return 0.0
            if self._per_angle is None:
                self._per_angle = self._shift_per_angle()
            return self._per_angle * float(np.clip(wheel(t) / steering.ratio.value, -most, most))

        def sideways(amount: float) -> list[float]:  # of the chassis; offsets of a joint are in road axes
            turn = self.mbs.GetObjectOutputBody(self.chassis, self.exu.OutputVariableType.RotationMatrix)
            return [amount * turn[1], amount * turn[4], amount * turn[7], 0.0, 0.0, 0.0]

        self.mbs.CreateGenericJoint(
            itemNumbers=[self.chassis, link],
            position=list(place),
            offsetUserFunction=lambda _mbs, t, *_: sideways(shift(t)),
            offsetUserFunction_t=lambda _mbs, t, *_: sideways((shift(t + 1e-6) - shift(t)) / 1e-6),
        )
        return link, place

    def _shift_per_angle(self) -> float:
        """How far [m] the inner end of the left tierod moves per steer angle [rad] of a wheel that stays at its height.

        As the car stands now, which is where the ratio of a steering is measured. No rod changes its length.
        """
        kinds, (upright, at) = self.exu.OutputVariableType, self._left

        def pose(body: Any) -> tuple[np.ndarray, np.ndarray]:
            turn = self.mbs.GetObjectOutputBody(body, kinds.RotationMatrix).reshape(3, 3)
            return turn, self.mbs.GetObjectOutputBody(body, kinds.Position)

        (level, chassis_at), (turn, upright_at) = pose(self.chassis), pose(upright)

        def moved(name: str) -> np.ndarray:  # chassis axes, from its center of mass
            return np.asarray(level.T @ (upright_at + turn @ (at(name) - at("upright_com")) - chassis_at))

        rods = [(f"{arm}_{end}", f"{arm}_ball") for arm in ("upper", "lower") for end in ("front", "rear")]
        rows, right = [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]], [0.0]  # velocity of the wheel center, angular velocity
        for inner, outer in [*rods, ("tierod_inner", "tierod_outer")]:
            along = moved(outer) - (at(inner) - self.cg - self.com)
            rows.append([*along, *_cross(moved(outer) - moved("wheel_centre"), along)])
            right.append(along[1] if inner == "tierod_inner" else 0.0)
        return float(1 / np.linalg.solve(np.array(rows), right)[5])

    def _actuators(self) -> None:
        """Forces along the vertical of the chassis between it and the wheel centers.

        In the form that connectors to the ground want.
        """
        mbs, kinds = self.mbs, self.exu.OutputVariableType
        ground = mbs.CreateGround()

        def upwards() -> np.ndarray:
            return np.array(mbs.GetObjectOutputBody(self.chassis, kinds.RotationMatrix).reshape(3, 3)[:, 2])

        def on_wheel(force: float) -> Callable[..., list[float]]:
            return lambda *_: [*(force * upwards()), 0.0, 0.0, 0.0]

        def on_chassis(_mbs: Any, _t: float, _n: int, place: Any, *_: Any) -> list[float]:
            up, moment = upwards(), np.zeros(3)
            for wheel, force in zip(self.wheels, self.force, strict=True):
                moment += _cross(mbs.GetObjectOutputBody(wheel, kinds.Position) - np.array(place), force * up)
            return [*(-sum(self.force) * up), *(-moment)]

        laws = [(self.chassis, on_chassis), *((w, on_wheel(f)) for w, f in zip(self.wheels, self.force, strict=True))]
        for body, law in laws:
            markers = [mbs.AddMarker(self.exu.utilities.MarkerBodyRigid(bodyNumber=b)) for b in (ground, body)]
            mbs.AddObject(
                self.exu.utilities.ObjectConnectorRigidBodySpringDamper(
                    markerNumbers=markers,
                    stiffness=np.zeros((6, 6)),
                    damping=np.zeros((6, 6)),
                    springForceTorqueUserFunction=law,
                )
            )

    def _spring(self, axle: Any) -> Callable[..., float]:
        """Tension of a spring with its stops [N], by its length."""
        table, stops = axle.spring, self.vehicle.suspension.stop
        lengths, forces = np.array(table.compression.value), np.array(table.force.value)
        free, bump, rebound = table.free_length.value, axle.stop.bump.value, axle.stop.rebound.value
        into, resist = np.array(stops.penetration.value), np.array(stops.force.value)

        def law(_mbs: Any, _t: float, _n: int, length: float, *_: float) -> float:
            short = free - length
            pressed = np.copysign(np.interp(abs(short), lengths, forces), short)
            return float(np.interp(length - rebound, into, resist) - np.interp(bump - length, into, resist) - pressed)

        return law

    def _damper(self, axle: Any) -> Callable[..., float]:
        """Tension of a damper [N], by its length and rate."""
        rates, span = axle.damper, self.vehicle.suspension.damper_range
        inner = (rates.compression.value, rates.rebound.value)
        outer = (rates.outer_compression.value, rates.outer_rebound.value)
        least, most, blend = span.least.value, span.most.value, span.blend.value

        def eased(into: float) -> float:
            t = min(1.0, max(0.0, into / blend + 0.5))
            return t * t * (3 - 2 * t)

        def law(_mbs: Any, _t: float, _n: int, length: float, rate: float, *_: float) -> float:
            out = rate > 0
            share = eased(length - least) * eased(most - length)
            return (outer[out] + (inner[out] - outer[out]) * share) * rate

        return law

    def _tire_law(self, i: int, disc: Any) -> Callable[..., list[float]]:
        """Force and moment of the road on a wheel, as a connector to the ground wants them."""
        tire, exu = self.vehicle.tire, self.exu
        radius = tire.radius.value
        deflections, loads = np.array(tire.deflection.value), np.array(tire.force.value)
        beyond = (loads[-1] - loads[-2]) / (deflections[-1] - deflections[-2])

        def law(mbs: Any, _t: float, _n: int, place: Any, _r: Any, velocity: Any, turning: Any, *_: Any) -> list[float]:
            touch = self._contact.at(self.road, place[0], place[2])
            depth, normal = touch.depth, touch.normal
            axle = mbs.GetObjectOutputBody(disc, exu.OutputVariableType.RotationMatrix).reshape(3, 3)[:, 1]
            spin = float(axle @ turning)
            if depth <= 0:
                share, pace = self._step / tire.relaxation.value, np.hypot(velocity[0], LOW_SPEED)
                self._tire[i] = (0.0, (self._slip[i] + share * (spin * radius - velocity[0])) / (1 + share * pace))
                return [0.0, 0.0, 0.0, *(-self._torque * axle)]
            bearing = np.interp(depth, deflections, loads) + max(0.0, depth - deflections[-1]) * beyond
            load = max(0.0, float(bearing) - tire.damping.value * float(velocity @ normal))
            forward = np.array([axle[1], -axle[0], 0.0])
            forward /= np.linalg.norm(forward)
            side = np.array([-forward[1], forward[0], 0.0])
            below = (radius - depth) * ((axle @ normal) * axle - normal)
            if touch.foot is not None:
                below = touch.foot
            rolling = float(velocity @ forward)
            pace = np.hypot(rolling, LOW_SPEED)
            patch = velocity + _cross(turning - spin * axle, below)
            # The slip at the end of the step, implicitly: with the lag alone it would swing against the wheel's spin.
            share = self._step / tire.relaxation.value
            slip = (self._slip[i] + share * (spin * (radius - depth / 3) - rolling)) / (1 + share * pace)
            drive = tire.slip_stiffness.value * slip
            corner = -tire.cornering_stiffness.value * float(patch @ side) / pace
            grip = load / np.sqrt(
                1 + (drive / tire.longitudinal_friction.value) ** 2 + (corner / tire.lateral_friction.value) ** 2
            )
            force = load * normal + grip * (drive * forward + corner * side)
            resistance = tire.rolling_resistance.value * load * radius * np.tanh(spin * radius / LOW_SPEED)
            moment = _cross(below, load * normal + grip * corner * side)
            moment += (self._torque - resistance - (radius - depth) * grip * drive) * axle
            self._tire[i] = (load, slip)
            return [*(-force), *(-moment)]

        return law

    # -------------------------------------------------------------------------------------------------------- running

    def _forward_speed(self) -> float:
        """Of the CG [m/s], horizontal."""
        kinds = self.exu.OutputVariableType
        velocity = self.mbs.GetObjectOutputBody(self.chassis, kinds.Velocity, list(-self.com))
        turn = self.mbs.GetObjectOutputBody(self.chassis, kinds.RotationMatrix)
        return float((velocity[0] * turn[0] + velocity[1] * turn[3]) / np.hypot(turn[0], turn[3]))

    def _advance(self, _mbs: Any, _t: float) -> bool:
        """Driver and slips, once a step."""
        control = self.vehicle.speed_control
        error = self.speed - self._forward_speed()
        requested = control.gain.value * error + control.integral_gain.value * self._integral
        limit = control.max_force.value
        if not (abs(requested) > limit and requested * error > 0):
            self._integral += error * self._step
        self._torque = float(np.clip(requested, -limit, limit)) * control.lever.value / 4
        self._slip = [slip for _, slip in self._tire]
        return True

    def run(self, duration: float, step: float = 1e-3) -> Motion:
        """The motion over `duration` [s] in steps of `step` [s]."""
        exu, mbs, self._step = self.exu, self.mbs, step
        rows: list[list[float]] = []
        kinds = exu.OutputVariableType
        seat = self.vehicle.seat
        arm = [v.value - c for v, c in zip((seat.x, seat.y, seat.z), self.com, strict=True)]

        def record(_mbs: Any, t: float) -> bool:
            cg = mbs.GetObjectOutputBody(self.chassis, kinds.Position, list(-self.com))
            az = mbs.GetObjectOutputBody(self.chassis, kinds.Acceleration, list(-self.com))[2]
            at_seat = mbs.GetObjectOutputBody(self.chassis, kinds.Acceleration, arm)[2]
            turn = mbs.GetObjectOutputBody(self.chassis, kinds.RotationMatrix)
            wheels = [mbs.GetObjectOutputBody(w, kinds.Position)[2] for w in self.wheels]
            yaw_rate = mbs.GetObjectOutputBody(self.chassis, kinds.AngularVelocityLocal)[2]
            handling = cg[1], np.arctan2(turn[7], turn[8]), yaw_rate, self._forward_speed()
            loads = (load for load, _ in self._tire)
            rows.append([t, cg[0], cg[2], az, at_seat, -turn[6], turn[7], *wheels, *loads, *handling])
            return True

        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps = round(duration / step)
        settings.timeIntegration.endTime = duration
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        settings.show.statistics = False
        mbs.SetPostStepUserFunction(record)
        mbs.SolveDynamic(settings)
        names = [
            "time",
            "x",
            "height",
            "body.az",
            "seat.az",
            "pitch",
            "roll",
            *(f"wheel.{c}.height" for c in CORNERS),
            *(f"tire.{c}.force" for c in CORNERS),
            *("y", "body.roll", "body.yaw_rate", "speed"),
        ]
        columns = dict(zip(names, np.array(rows).T, strict=True))
        return Motion(columns.pop("time"), columns)


def _cross(a: Any, b: Any) -> np.ndarray:
    """Cross product of two vectors (3,), faster than numpy's."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
