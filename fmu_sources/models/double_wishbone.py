"""Kinematics of a double wishbone, from its hardpoints.

Gives the positions of wheel, arms, spring and damper at every travel of the wheel.

Two arms turn about axes of the chassis, the upright hangs on their ball joints, and a rod of fixed length holds its
steering arm: one degree of freedom. Its coordinate is the travel of the wheel center, vertical and relative to the
chassis, positive upwards, 0 at design. The left side is computed; the right one is its mirror image. Axes are ISO 8855:
x forward, y left, z up.

What the motion of a wheel is needed for is smooth, so few numbers hold it: the coefficients of a uniform cubic B-spline
(`Spline`), which is twice continuously differentiable. `Spline.basis` has the values of the basis for
symbols as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

POINTS = (
    "wheel_centre",
    "upright_com",
    "upper_front",
    "upper_rear",
    "upper_ball",
    "upper_com",
    "lower_front",
    "lower_rear",
    "lower_ball",
    "lower_com",
    "damper_top",
    "damper_bottom",
    "spring_top",
    "spring_bottom",
    "tierod_inner",
    "tierod_outer",
)
"""Names of the hardpoints. Springs and dampers stand on the lower arm; the inner tierod and all tops belong to the
chassis.
"""

_STEP = 2e-3  # m, from one travel to the next one, where the solution of the last is the first guess
_EXACT = 1e-12  # m, error of closed joints
_LEAST = 1e-3  # m, between points that give a direction


class HardpointError(ValueError):
    """Hardpoints that make no suspension. The message names the points and what to do."""


@dataclass(frozen=True)
class Position:
    """The mechanism at one travel.

    Attributes:
        wheel: wheel center (3,) [m].
        turn: rotation of the upright since design (3, 3).
        upper_ball, lower_ball: ball joints (3,) [m].
        lower_turn, upper_turn: rotations of the arms since design (3, 3).
        spring, damper: their lengths [m].
    """

    wheel: np.ndarray
    turn: np.ndarray
    upper_ball: np.ndarray
    lower_ball: np.ndarray
    upper_turn: np.ndarray
    lower_turn: np.ndarray
    spring: float
    damper: float

    @property
    def rotation(self) -> np.ndarray:
        """Rotation vector of the upright (3,) [rad]."""
        return rotation_vector(self.turn)

    @property
    def camber(self) -> float:
        """Angle [rad] that the wheel's plane has leant since design.

        Positive where its top leans outwards (ISO 8855).
        """
        return float(-np.arcsin(self.turn[2, 1]))

    @property
    def toe(self) -> float:
        """Angle [rad] of the wheel's plane with the direction of travel.

        Positive where the left wheel points outwards.
        """
        return float(np.arctan2(-self.turn[0, 1], self.turn[1, 1]))


class DoubleWishbone:
    """A double wishbone of given hardpoints (name -> (3,) [m], left side, any origin on the chassis).

    Raises:
        HardpointError: a point is missing, or two coincide that give an axis or a length.
    """

    def __init__(self, points: Mapping[str, Any]) -> None:
        if missing := [n for n in POINTS if n not in points]:
            raise HardpointError(f"{', '.join(missing)}: missing among the hardpoints")
        self.points = {n: np.asarray(points[n], dtype=float) for n in POINTS}
        for one, other in (
            ("upper_front", "upper_rear"),
            ("lower_front", "lower_rear"),
            ("upper_ball", "lower_ball"),
            ("tierod_inner", "tierod_outer"),
            ("damper_top", "damper_bottom"),
            ("spring_top", "spring_bottom"),
        ):
            if np.linalg.norm(self.points[one] - self.points[other]) < _LEAST:
                raise HardpointError(f"{one} and {other} coincide; they need at least {_LEAST * 1e3:g} mm between them")
        for arm in ("upper", "lower"):
            if self.arm(arm).reach < _LEAST:
                raise HardpointError(
                    f"{arm}_ball lies on the axis of {arm}_front and {arm}_rear; an arm needs a length"
                )
        self._solved: dict[int, tuple[np.ndarray, np.ndarray]] = {0: (self.points["wheel_centre"], np.eye(3))}

    def arm(self, which: str) -> Arm:
        """Geometry of the `"upper"` or `"lower"` arm at design."""
        p = self.points
        return Arm(p[f"{which}_front"], p[f"{which}_rear"], p[f"{which}_ball"], p[f"{which}_com"])

    def at(self, travel: float) -> Position:
        """The mechanism at a travel [m].

        Raises:
            HardpointError: the joints do not close there.
        """
        steps = round(travel / _STEP)
        sign = 1 if steps > 0 else -1
        for n in range(sign, steps + sign, sign):
            if n not in self._solved:
                self._solved[n] = self._closed(n * _STEP, *self._solved[n - sign])
        wheel, turn = self._closed(travel, *self._solved[steps])
        p = self.points

        def moved(name: str) -> np.ndarray:
            return wheel + turn @ (p[name] - p["wheel_centre"])

        upper, lower = moved("upper_ball"), moved("lower_ball")
        upper_turn, lower_turn = self.arm("upper").turned(upper), self.arm("lower").turned(lower)
        foot = p["lower_front"]
        spring, damper = (
            float(np.linalg.norm(foot + lower_turn @ (p[f"{n}_bottom"] - foot) - p[f"{n}_top"]))
            for n in ("spring", "damper")
        )
        return Position(wheel, turn, upper, lower, upper_turn, lower_turn, spring, damper)

    def steered(self, most: float, count: int = 25) -> tuple[np.ndarray, np.ndarray]:
        """How the wheel steers at design when the linkage shifts the inner end of the tierod to the side.

        The shift is given as the angle [rad] that it would give if both stayed in proportion as they are at design. So
        both rows, `count` angles each, have the slope 1 at 0. The right wheel is the mirror image.

        Args:
            most: largest angle; where the joints do not close that far, the rows end before.
            count: of the angles, an odd number.

        Returns:
            Angles in proportion to the shift, and the steer angles of the left wheel, positive left.
        """
        design = self.points["wheel_centre"], np.eye(3)

        def angle(at: tuple[np.ndarray, np.ndarray]) -> float:
            return float(np.arctan2(-at[1][0, 1], at[1][1, 1]))

        small = 1e-4  # m
        near = [angle(self._closed(0.0, *design, shift=s)) for s in (-small, small)]
        per_angle = 2 * small / (near[1] - near[0])
        angles = np.linspace(-most, most, count)
        found = {count // 2: 0.0}
        for direction in (-1, 1):
            now, i = design, count // 2 + direction
            try:
                while 0 <= i < count:
                    now = self._closed(0.0, *now, shift=per_angle * angles[i])
                    found[i] = angle(now)
                    i += direction
            except HardpointError:
                pass
        places = sorted(found)
        return angles[places], np.array([found[i] for i in places])

    def _closed(
        self, travel: float, wheel: np.ndarray, turn: np.ndarray, shift: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Wheel center and rotation of the upright at a travel, by Newton's method from those near by.

        `shift` [m] moves the inner end of the tierod to the left.
        """
        p, design = self.points, self.points["wheel_centre"]
        rods = [(f"{arm}_{end}", f"{arm}_ball") for arm in ("upper", "lower") for end in ("front", "rear")]
        rods.append(("tierod_inner", "tierod_outer"))
        for _ in range(20):
            errors, rows = [wheel[2] - design[2] - travel], [np.array([0, 0, 1.0, 0, 0, 0])]
            for fixed, moving in rods:
                arm = turn @ (p[moving] - design)
                along = wheel + arm - p[fixed] - np.array([0, shift if fixed == "tierod_inner" else 0.0, 0])
                length = np.linalg.norm(p[moving] - p[fixed])
                errors.append((along @ along - length**2) / (2 * length))
                rows.append(np.concatenate([along, np.cross(arm, along)]) / length)
            jacobian = np.array(rows)
            if np.abs(errors).max() < _EXACT:
                return wheel, turn
            if np.linalg.cond(jacobian) > 1e8:
                break
            change = np.linalg.solve(jacobian, -np.array(errors))
            if np.abs(change).max() > 0.2:  # another way to assemble it
                break
            wheel, turn = wheel + change[:3], _rotation(change[3:]) @ turn
        raise HardpointError(
            f"the suspension cannot be assembled at a travel of {travel:.3f} m of the wheel: no position of the"
            " upright keeps the lengths of both arms and of the tierod there; correct a hardpoint, or reduce the range"
            " of travel"
        )


@dataclass(frozen=True)
class Arm:
    """An arm that turns about the axis through two points of the chassis; all points (3,) [m] at design."""

    front: np.ndarray
    rear: np.ndarray
    ball: np.ndarray
    com: np.ndarray

    @cached_property
    def axis(self) -> np.ndarray:
        """Unit vector along the axis, forward."""
        along = self.front - self.rear
        return np.asarray(along / np.linalg.norm(along))

    def from_axis(self, point: np.ndarray) -> np.ndarray:
        """The part of `point` (3,) [m] that stands perpendicular on the axis."""
        out = point - self.front
        return np.asarray(out - (out @ self.axis) * self.axis)

    @property
    def reach(self) -> float:
        """Distance [m] of the ball joint from the axis."""
        return float(np.linalg.norm(self.from_axis(self.ball)))

    def turned(self, ball: np.ndarray) -> np.ndarray:
        """Rotation (3, 3) that takes the ball joint from design to `ball`."""
        old, new = self.from_axis(self.ball), self.from_axis(ball)
        angle = np.arctan2(np.cross(old, new) @ self.axis, old @ new)
        return _rotation(angle * self.axis)

    def lumps(self, mass: float, inertia: float) -> tuple[float, float, float]:
        """Point masses [kg] at the ball joint, at the center of mass and at the axis that move as the arm does.

        They have its mass, its first moment about the axis, and its moment of inertia about the axis (`inertia` [kg
        m2] is that about the parallel through the center of mass), where the center of mass lies on the way from the
        axis to the ball joint.
        """
        part = float(self.from_axis(self.com) @ self.from_axis(self.ball)) / self.reach**2
        about_axis = (inertia + mass * float(np.sum(self.from_axis(self.com) ** 2))) / self.reach**2
        at_com = (mass * part - about_axis) / (part - part**2)
        at_ball = mass * part - at_com * part
        return at_ball, at_com, mass - at_ball - at_com


@dataclass(frozen=True)
class Spline:
    """Uniform cubic B-splines over `knots` [m]: a function is one coefficient per knot.

    Linear functions have their own values as coefficients.
    """

    first: float
    step: float
    count: int

    @property
    def knots(self) -> np.ndarray:
        """Knots [m] (count,). Functions are given from the second knot to the last but one."""
        return self.first + self.step * np.arange(self.count)

    @property
    def range(self) -> tuple[float, float]:
        """Least and largest argument [m]."""
        return self.first + self.step, self.first + self.step * (self.count - 2)

    @staticmethod
    def basis(
        distance: Any, largest: Callable[[Any, Any], Any] = np.maximum, size: Callable[[Any], Any] = np.abs
    ) -> Any:
        """Value of a basis function at a distance from its knot, in steps.

        `largest` and `size`: maximum and absolute value, those of other libraries for symbols.
        """
        away = size(distance)
        wide, narrow = largest(0, 2 - away), largest(0, 1 - away)
        return (wide * wide * wide - 4 * (narrow * narrow * narrow)) / 6

    def matrix(self, at: np.ndarray) -> np.ndarray:
        """Basis functions (columns) at arguments [m] (rows)."""
        return np.asarray(self.basis((np.asarray(at)[:, None] - self.knots[None, :]) / self.step))

    def fitted(self, at: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Coefficients (count,) of the function that is nearest to `values` at arguments [m], in least squares."""
        return np.asarray(np.linalg.lstsq(self.matrix(at), values, rcond=None)[0])


@dataclass(frozen=True)
class WheelMotion:
    """Coefficients of the splines (count,) that hold the motion of a left wheel over its travel, relative to design.

    Attributes:
        spline: knots.
        forward, outward: motion of the wheel center along x and y [m].
        roll, pitch, yaw: rotation vector of the upright [rad]: camber, caster and toe.
        spring, damper: lengths [m].
        error: largest distance [m] between the splines and the mechanism, of points or lengths.
    """

    spline: Spline
    forward: np.ndarray
    outward: np.ndarray
    roll: np.ndarray
    pitch: np.ndarray
    yaw: np.ndarray
    spring: np.ndarray
    damper: np.ndarray
    error: float


def wheel_motion(mechanism: DoubleWishbone, least: float, most: float, count: int = 12) -> WheelMotion:
    """The motion of a wheel from travel `least` to `most` [m] as splines with `count` knots.

    Raises:
        HardpointError: the joints do not close somewhere in that range.
    """
    step = (most - least) / (count - 3)
    spline = Spline(least - step, step, count)
    travels = np.linspace(least, most, 8 * count)
    positions = [mechanism.at(float(q)) for q in travels]
    design = mechanism.points["wheel_centre"]
    exact = np.array([[*(p.wheel - design)[:2], *p.rotation, p.spring, p.damper] for p in positions])
    fits = spline.fitted(travels, exact)
    error = float(np.abs(spline.matrix(travels) @ fits - exact).max())
    forward, outward, roll, pitch, yaw, spring, damper = fits.T
    return WheelMotion(spline, forward, outward, roll, pitch, yaw, spring, damper, error)


def rotation_vector(turn: np.ndarray) -> np.ndarray:
    """Axis times angle (3,) [rad] of a rotation matrix below half a turn."""
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    sine = np.linalg.norm(skew)
    angle = np.arctan2(sine, (np.trace(turn) - 1) / 2)
    return np.asarray(skew if sine < 1e-12 else skew * (angle / sine))


def _rotation(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if angle < 1e-12:
        return np.eye(3) + cross
    return np.asarray(np.eye(3) + np.sin(angle) / angle * cross + (1 - np.cos(angle)) / angle**2 * cross @ cross)
