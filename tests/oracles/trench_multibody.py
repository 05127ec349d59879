"""The 6x6 in front of a trench in Exudyn, a third-party multibody code.

One rigid body that can only move in its plane of symmetry, three pairs of wheels that slide along struts fixed in it,
and forces between them and the ground. Nothing of our equations is used: Exudyn finds the motion in redundant
coordinates with joints (generalized-alpha method), the forces are written once more from the parameters of the vehicle
file. The ground is two quarter-planes and a floor; a wheel touches each at its point closest to the wheel's center.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmu_sources.vehicles.schema import ThreeAxleTrenchCar
from oracles.multibody import GRAVITY, Motion

AXLES = ("a1", "a2", "a3")
FRICTION_TIME = 4e-4  # s, least time in which friction may stop a wheel, as the plant has it

Vector = np.ndarray
"""Of the road's x and z."""


@dataclass(frozen=True)
class Trench:
    """Vertical walls and a floor; `start` and `length` [m] along a level road at height 0, `depth` [m]."""

    start: float
    length: float
    depth: float

    def closest(self, x: float, z: float) -> list[Vector]:
        """Points of the three solids that are closest to a point above them."""
        end = self.start + self.length
        return [
            np.array([min(x, self.start), min(z, 0.0)]),
            np.array([min(max(x, self.start), end), min(z, -self.depth)]),
            np.array([max(x, end), min(z, 0.0)]),
        ]

    def way_out(self, x: float, z: float) -> Vector:
        """Shortest way (2,) out of the ground from a point, 0 for one above it."""
        end = self.start + self.length
        ways = []
        if x <= self.start and z < 0:
            ways = [np.array([0.0, -z]), np.array([self.start - x, 0.0])]
        elif x >= end and z < 0:
            ways = [np.array([0.0, -z]), np.array([end - x, 0.0])]
        elif z < -self.depth:
            ways = [np.array([0.0, -self.depth - z])]
        return min(ways, key=lambda way: float(way @ way), default=np.zeros(2))


class MultibodyTrenchCar:
    """The passive vehicle of a file, rolling at `speed` [m/s] toward a trench; the CG begins at x = 0.

    `absolute_spin`: the imposed spin of the wheels counts against the road, not against the pitching body.
    """

    def __init__(
        self, vehicle: ThreeAxleTrenchCar, trench: Trench, speed: float, *, absolute_spin: bool = False
    ) -> None:
        import exudyn as exu
        from exudyn.utilities import RigidBodyInertia

        self.exu: Any = exu
        self.vehicle, self.trench, self.speed, self.absolute_spin = vehicle, trench, speed, absolute_spin
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        body, disc = vehicle.body, vehicle.disc
        self.mass = [2 * getattr(vehicle.wheel, a).mass.value for a in AXLES]
        self.x = [getattr(vehicle.wheel, a).x.value - body.cg_offset.value for a in AXLES]
        self.strut = [2 * getattr(vehicle.suspension, a).stiffness.value for a in AXLES]
        self.damping = [2 * getattr(vehicle.suspension, a).damping.value for a in AXLES]
        self.tire = [getattr(vehicle.tire, a) for a in AXLES]
        self.load = self._loads_at_rest()
        weights = [f + m * GRAVITY for f, m in zip(self.load, self.mass, strict=True)]
        compression = [w / 2 / t.stiffness.value for w, t in zip(weights, self.tire, strict=True)]
        assert max(compression) < disc.bottoming.value
        self.height = body.cg_height.value + disc.radius.value - sum(compression) / 3
        self.below = [self.height - disc.radius.value + c for c in compression]

        def rigid(mass: float, inertia: Vector, x: float, z: float) -> Any:
            return self.mbs.CreateRigidBody(
                referencePosition=[x, 0, z],
                inertia=RigidBodyInertia(mass, inertia),
                gravity=[0, 0, -GRAVITY],
                initialVelocity=[speed, 0, 0],
            )

        tensor = np.diag([body.roll_inertia.value, body.pitch_inertia.value, body.pitch_inertia.value])
        self.body = rigid(body.mass.value, tensor, 0.0, self.height)
        ground = self.mbs.CreateGround()
        self.mbs.CreateGenericJoint(
            itemNumbers=[ground, self.body], position=[0, 0, self.height], constrainedAxes=[0, 1, 0, 1, 0, 1]
        )
        self.wheels = []
        for i in range(3):
            wheel = rigid(self.mass[i], 1e-3 * np.eye(3), self.x[i], self.height - self.below[i])
            self.mbs.CreateGenericJoint(
                itemNumbers=[self.body, wheel],
                position=[self.x[i], 0, self.height - self.below[i]],
                constrainedAxes=[1, 1, 0, 1, 1, 1],
            )
            self.wheels.append(wheel)
        # What acts on a body, as connectors to the ground: the laws read the motion of all bodies.
        for item, law in [(self.body, self._on_body), *((w, self._on_wheel(i)) for i, w in enumerate(self.wheels))]:
            markers = [self.mbs.AddMarker(exu.utilities.MarkerBodyRigid(bodyNumber=b)) for b in (ground, item)]
            self.mbs.AddObject(
                exu.utilities.ObjectConnectorRigidBodySpringDamper(
                    markerNumbers=markers,
                    stiffness=np.zeros((6, 6)),
                    damping=np.zeros((6, 6)),
                    springForceTorqueUserFunction=law,
                )
            )
        self.mbs.Assemble()

    def _loads_at_rest(self) -> list[float]:
        """Of the struts of each axle [N]: a level rigid body on springs."""
        rows = np.array([[1.0, x] for x in self.x])
        k = np.diag(self.strut)
        plane = np.linalg.solve(rows.T @ k @ rows, [self.vehicle.body.mass.value * GRAVITY, 0.0])
        return [float(f) for f in k @ rows @ plane]

    # --------------------------------------------------------------------------------------------------------- forces

    def _state(self, item: Any) -> tuple[Vector, Vector]:
        """Position and velocity (2,) of a body."""
        kinds = self.exu.OutputVariableType
        place = self.mbs.GetObjectOutputBody(item, kinds.Position)
        rate = self.mbs.GetObjectOutputBody(item, kinds.Velocity)
        return np.array([place[0], place[2]]), np.array([rate[0], rate[2]])

    def _axes(self) -> tuple[Vector, Vector, float]:
        """The body's x and z axes (2,) and its pitch rate, positive nose down."""
        kinds = self.exu.OutputVariableType
        turn = np.reshape(self.mbs.GetObjectOutputBody(self.body, kinds.RotationMatrix), (3, 3))
        rate = self.mbs.GetObjectOutputBody(self.body, kinds.AngularVelocity)[1]
        return np.array([turn[0, 0], turn[2, 0]]), np.array([turn[0, 2], turn[2, 2]]), float(rate)

    def _strut_force(self, i: int) -> float:
        """Of both struts of an axle [N], positive pushes apart."""
        strut = self.vehicle.strut
        _, up, turning = self._axes()
        (body, body_rate), (wheel, wheel_rate) = self._state(self.body), self._state(self.wheels[i])
        arm = wheel - body
        s = -float(arm @ up) - self.below[i]
        up_rate = turning * np.array([up[1], -up[0]])
        ds = -float((wheel_rate - body_rate) @ up + arm @ up_rate)

        def stop(depth: float, rate: float) -> float:
            if depth <= 0:
                return 0.0
            damper = 2 * strut.damping.value * min(1.0, depth / strut.onset.value) * rate
            return max(0.0, 2 * strut.stiffness.value * depth + damper)

        out = stop(s - strut.extension.value, ds) - stop(-strut.compression.value - s, -ds)
        return self.load[i] - self.strut[i] * s - self.damping[i] * ds - out

    def _tire_force(self, i: int) -> tuple[Vector, float]:
        """Force (2,) of the ground on both tires of an axle, and its part along the ground, with traction positive."""
        disc, tire = self.vehicle.disc, self.tire[i]
        place, velocity = self._state(self.wheels[i])
        rolling = disc.radius.value - disc.rolling_loss.value
        spin = self.speed / rolling + (0.0 if self.absolute_spin else self._axes()[2])
        force: Vector = np.zeros(2)
        traction = 0.0
        for point in self.trench.closest(*place):
            away = place - point
            distance = float(np.hypot(*away))
            depth = disc.radius.value - distance
            if depth <= 0:
                continue
            n = away / distance
            t = np.array([n[1], -n[0]])
            spring = tire.stiffness.value * depth
            spring += disc.bottoming_stiffness.value * max(0.0, depth - disc.bottoming.value)
            damper = -tire.damping.value * min(1.0, depth / disc.onset.value) * float(velocity @ n)
            normal = max(0.0, spring + damper)
            most = disc.friction.value * normal
            width = max(disc.slip_speed.value, most * FRICTION_TIME / (self.mass[i] / 2))
            grip = most * np.tanh((spin * rolling - float(velocity @ t)) / width)
            force += 2 * (normal * n + grip * t)
            traction += 2 * grip
        return force, traction

    def _on_wheel(self, i: int) -> Any:
        def law(*_: Any) -> list[float]:
            force = self._tire_force(i)[0] - self._strut_force(i) * self._axes()[1]
            return [-float(force[0]), 0.0, -float(force[1]), 0.0, 0.0, 0.0]

        return law

    def _on_body(self, *_: Any) -> list[float]:
        """Struts, the reaction of the drives, and the ground below the body."""
        ahead, up, turning = self._axes()
        place, velocity = self._state(self.body)
        force, moment = np.zeros(2), 0.0
        rolling = self.vehicle.disc.radius.value - self.vehicle.disc.rolling_loss.value
        for i in range(3):
            push = self._strut_force(i) * up
            arm = self.x[i] * ahead  # along the strut its point does not matter
            force += push
            moment += float(arm[1] * push[0] - arm[0] * push[1])
            moment -= self._tire_force(i)[1] * rolling
        for at, way in self._touches(place, ahead, up):
            arm = at - place
            rate = velocity + turning * np.array([arm[1], -arm[0]])
            push = self._contact(way, rate)
            force += push
            moment += float(arm[1] * push[0] - arm[0] * push[1])
        return [-force[0], 0.0, -force[1], 0.0, -moment, 0.0]

    def _contact(self, way: Vector, rate: Vector) -> Vector:
        """Force (2,) of the ground on the body where it is `way` deep and moves at `rate`."""
        contact = self.vehicle.contact
        depth = float(np.hypot(*way))
        n = way / depth
        damper = -contact.damping.value * min(1.0, depth / contact.onset.value) * float(rate @ n)
        normal = max(0.0, contact.stiffness.value * depth + damper)
        sliding = float(rate @ np.array([n[1], -n[0]]))
        rub = -contact.friction.value * normal * np.tanh(sliding / self.vehicle.disc.slip_speed.value)
        return normal * n + rub * np.array([n[1], -n[0]])

    def _outline(self) -> list[Vector]:
        """The lower outline of the body, from the rear tip to the front tip, in body axes from the CG."""
        o = self.vehicle.outline
        front, rear = self.x[0], self.x[2]
        return [
            np.array([rear - o.rear_overhang.value, o.tip_height.value]),
            np.array([rear - o.knee_distance.value, o.knee_height.value]),
            np.array([rear - o.belly_distance.value, o.belly_height.value]),
            np.array([front + o.belly_distance.value, o.belly_height.value]),
            np.array([front + o.knee_distance.value, o.knee_height.value]),
            np.array([front + o.front_overhang.value, o.tip_height.value]),
        ]

    def _touches(self, place: Vector, ahead: Vector, up: Vector) -> list[tuple[Vector, Vector]]:
        """Points (2,) where body and ground overlap and the shortest way (2,) of the body out of the ground."""
        outline = self._outline()
        found = []
        for k in (0, 2, 3, 5):
            at = place + outline[k][0] * ahead + outline[k][1] * up
            way = self.trench.way_out(*at)
            if np.any(way):
                found.append((at, way))
        for x in (self.trench.start, self.trench.start + self.trench.length):
            corner = np.array([x, 0.0])
            d = corner - place
            way = self._way_of_corner(float(d @ ahead), float(d @ up), outline)
            if np.any(way):
                found.append((corner, way[0] * ahead + way[1] * up))
        return found

    @staticmethod
    def _way_of_corner(x: float, z: float, outline: list[Vector]) -> Vector:
        """How the body must move, in its axes, to free a point of the ground that is inside it; 0 if it is outside.

        The body is above its outline, and ends at the tips.
        """
        first, last = outline[0], outline[-1]
        if not first[0] < x < last[0]:
            return np.zeros(2)
        k = next(i for i in range(5) if x <= outline[i + 1][0])
        a, b = outline[k], outline[k + 1]
        if z <= a[1] + (b[1] - a[1]) * (x - a[0]) / (b[0] - a[0]):
            return np.zeros(2)
        ways = []
        for a, b in itertools.pairwise(outline):  # the face's inward normal, times the depth
            n = np.array([-(b - a)[1], (b - a)[0]]) / np.hypot(*(b - a))
            at = np.array([x, z])
            along = float((at - a) @ (b - a)) / float((b - a) @ (b - a))
            depth = float((at - a) @ n)
            if depth > 0 and -0.5 < along < 1.5:
                ways.append(depth * n)
        ways += [np.array([x - last[0], 0.0]), np.array([x - first[0], 0.0])]
        return min(ways, key=lambda way: float(way @ way))

    # -------------------------------------------------------------------------------------------------------- running

    def run(self, duration: float, step: float = 2.5e-4) -> Motion:
        """The motion over `duration` [s] in steps of `step` [s]."""
        exu, mbs = self.exu, self.mbs
        rows: list[list[float]] = []
        kinds = exu.OutputVariableType

        def record(_mbs: Any, t: float) -> bool:
            place, velocity = self._state(self.body)
            acceleration: Any = mbs.GetObjectOutputBody(self.body, kinds.Acceleration)
            ahead, _, _ = self._axes()
            hubs = [float(self._tire_force(i)[0] @ ahead) / 2 for i in range(3)]
            pitch = -np.arctan2(ahead[1], ahead[0])
            rows.append([t, *place, velocity[0], pitch, acceleration[0], acceleration[2], *hubs])
            return True

        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps = round(duration / step)
        settings.timeIntegration.endTime = duration
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.7
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        settings.show.statistics = False
        mbs.SetPostStepUserFunction(record)
        mbs.SolveDynamic(settings)
        names = ["time", "x", "height", "speed", "body.pitch", "body.ax", "body.az", *(f"hub.{a}.fx" for a in AXLES)]
        columns = dict(zip(names, np.array(rows).T, strict=True))
        return Motion(columns.pop("time"), columns)
