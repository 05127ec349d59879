"""Rules for where and in which direction a road bears a tire, and an elastic ring that judges them.

All rules take the depth from the area of the tire's disc below the road, as the public HMMWV and our car on double
wishbones do; they differ in the direction of the force:

- `road normal`: along the normal of the road below the wheel center, through the center. The rule of our car.
- `point behind`: along the normal of the road at the point that is (radius - depth) times the normal below the center
  away from it: behind a wheel that climbs. The rule of the public model (Project Chrono, `ChTire.cpp`), which adds this
  vector to the center where subtracting it would lead to the road.
- `swept area`: along the gradient of the area by the position of the center, through the center.

A ring over a half-round (`Ring`) has a direction of its own, without any of these rules.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, nnls

DIVISIONS = 100  # of a tire's disc
SLOPE_BASE = 0.05  # m, over which the road's normal is taken
RULES = ("road normal", "point behind", "swept area")

Force = Callable[[float, float], tuple[float, float]]
"""Force of a road on a wheel, forward and up [N], where the wheel center is at (x, z) [m]."""
Road = Callable[[np.ndarray], np.ndarray]
"""Height [m] at positions [m], the same left and right."""


@dataclass(frozen=True)
class Touch:
    """How a road bears a tire.

    Attributes:
        depth: below a flat road where the disc has the same area below it [m].
        normal: direction (3,) of the force.
        foot: from the wheel center to where it acts (3,) [m]; None: along the normal, through the center.
    """

    depth: float
    normal: np.ndarray
    foot: np.ndarray | None = None


class AreaContact:
    """A disc of a radius [m] that a road bears by one of `RULES`."""

    def __init__(self, radius: float, rule: str = "road normal") -> None:
        if rule not in RULES:
            raise ValueError(f"rule = {rule!r} is not one of {', '.join(RULES)}")
        self.radius, self.rule = radius, rule
        self._offsets = np.linspace(-radius, radius, DIVISIONS + 1)
        self._edge = np.sqrt(np.maximum(0.0, radius**2 - self._offsets**2))
        self._slope = self._offsets / np.maximum(self._edge, 1e-3 * radius)  # of the disc's lower edge
        self._depths = np.concatenate([[0.0], np.geomspace(1e-6, 0.95 * radius, 2000)])
        cosine = (radius - self._depths) / radius
        self._areas = radius**2 * (np.arccos(cosine) - cosine * np.sqrt(1 - cosine**2))

    def at(self, road: Road, x: float, z: float) -> Touch:
        """The touch where the wheel center is at (x, z) [m]; depth 0 in the air."""
        over = np.maximum(0.0, road(x + self._offsets) - (z - self._edge))
        area = float(np.sum(over)) * (self._offsets[1] - self._offsets[0])
        depth = float(np.interp(area, self._areas, self._depths))
        if depth > 0 and self.rule == "swept area":
            inside = over > 0
            return Touch(depth, _unit(-float(np.sum(self._slope[inside])), float(np.sum(inside))))
        normal, _ = road_normal(road, x)
        if self.rule != "point behind":
            return Touch(depth, normal)
        moved = x + (self.radius - depth) * normal[0]
        normal, height = road_normal(road, moved)
        return Touch(depth, normal, np.array([moved - x, 0.0, height - z]))

    def force(self, road: Road, stiffness: float) -> Force:
        """The force of a road on a tire of a stiffness [N/m] without damping."""

        def force(x: float, z: float) -> tuple[float, float]:
            touch = self.at(road, x, z)
            back, _, up = stiffness * touch.depth * touch.normal
            return float(back), float(up)

        return force


def road_normal(road: Road, x: float) -> tuple[np.ndarray, float]:
    """Direction (3,) of a road's normal at a position [m], by a forward difference, and the height there [m]."""
    here, ahead = road(np.array([x, x + SLOPE_BASE]))
    return _unit(-(ahead - here) / SLOPE_BASE, 1.0), float(here)


def _unit(x: float, z: float) -> np.ndarray:
    return np.array([x, 0.0, z]) / np.hypot(x, z)


class Ring:
    """A tire as an elastic ring on a radial foundation, at rest or rolling freely, over a half-round.

    The belt is a ring of radius R that bends with the stiffness B [N m2]; the sidewalls and the air hold it with the
    stiffness k [N/m2] per length of the belt. With its inward displacement w(t) at the angle t the energy is

        U = 1/2 int k w^2 + B ((w'' + w) / R^2)^2 ds

    so a displacement cos(n t) needs the pressure q = k (1 + b (n^2 - 1)^2) cos(n t) with b = B / (k R^4): moved as a
    whole (n = 1) the ring does not bend. The road keeps the belt out: w >= g, q >= 0, q (w - g) = 0, where g(t) is
    how far the undeformed ring is inside the road along its own radius. That is a linear complementarity problem, here
    solved as non-negative least squares for q at `count` equal angles. Pressures act along the radius, so none of them
    turns the wheel: it rolls freely. Their sum is the force on the wheel.

    No number is fitted. k follows from one load and its deflection on a flat road. b is not given by these; the ring
    without bending (b = 0: independent radial springs) is progressive, and from b = 0.01 on loads are as linear as the
    table of the tire. What is concluded has to hold for each such b.

    Args:
        radius: [m].
        load, deflection: on a flat road [N], [m].
        bending: b [1].
        count: angles in a full turn.
    """

    def __init__(self, radius: float, load: float, deflection: float, bending: float, count: int = 120) -> None:
        self.radius, self.flat_stiffness = radius, load / deflection
        angles = 2 * np.pi * np.arange(count) / count - np.pi  # from straight down, positive forward
        below = np.flatnonzero(np.abs(angles) < np.pi / 2 - 1e-9)  # the road is nowhere above the wheel center
        self._sine, self._cosine = np.sin(angles[below]), np.cos(angles[below])
        orders = np.fft.fftfreq(count, 1 / count)
        compliance = np.fft.ifft(1 / (1 + bending * (orders**2 - 1) ** 2)).real  # k times w per pressure
        matrix = compliance[(below[:, None] - below[None, :]) % count]
        self._root = np.linalg.cholesky(matrix + 1e-12 * np.eye(len(below))).T
        self._per_angle = 2 * np.pi / count * radius  # m of the belt
        self.stiffness = 1.0
        self.stiffness = load / self.force(0.0, radius - deflection, 0.0)[1]

    def force(self, x: float, z: float, height: float) -> tuple[float, float]:
        """Force of the road on the wheel, forward and up [N].

        The wheel center is x [m] ahead of the middle of a half-round of a height [m], and z [m] above the level road.
        """
        distance = z / self._cosine  # along each radius to the level road
        toward = x * self._sine - z * self._cosine
        square = toward**2 - (x**2 + z**2 - height**2)
        to_cylinder = -toward - np.sqrt(np.maximum(0.0, square))
        hits = (square > 0) & (to_cylinder > 0) & (to_cylinder < distance)
        inside = self.radius - np.where(hits, to_cylinder, distance)
        if inside.max() <= 0:
            return 0.0, 0.0
        # Least 1/2 q.C q - g.q with C = root' root is the least |root q - root'^-1 g|.
        pressure, _ = nnls(self._root, np.linalg.solve(self._root.T, inside), maxiter=20_000)
        pushed = self.stiffness * self._per_angle * pressure
        return -float(pushed @ self._sine), float(pushed @ self._cosine)


def half_round(height: float, start: float) -> Road:
    """A half cylinder of a height [m], which begins at `start` [m], on a level road."""
    return lambda x: np.sqrt(np.maximum(0.0, height**2 - (x - start - height) ** 2))


def turned_from(ring: Ring, rule: str, height: float, pressed: float) -> tuple[np.ndarray, np.ndarray]:
    """How a rule deviates from a ring while a wheel climbs a half-round of a height [m].

    The wheel center is `pressed` [m] below the way of a rigid disc over the half-round, from 0.25 m before the
    half-round almost to its top.

    Returns:
        Angles between both forces (16,) [deg], positive where that of the rule points back more, and depths of the rule
        relative to that of the ring's force on a flat road (16,).
    """
    radius, contact, road = ring.radius, AreaContact(ring.radius, rule), half_round(height, -height)
    angles, ratios = [], []
    for x in -np.linspace(0.1 * height, height + 0.25, 16):
        z = float(max(radius, np.sqrt(max(0.0, (radius + height) ** 2 - x**2)))) - pressed
        touch, (back, up) = contact.at(road, x, z), ring.force(x, z, height)
        angles.append(np.degrees(np.arctan2(-touch.normal[0], touch.normal[2]) - np.arctan2(-back, up)))
        ratios.append(touch.depth / (np.hypot(back, up) / ring.flat_stiffness))
    return np.array(angles), np.array(ratios)


def pushed_share(force: Force, radius: float, load: float, height: float) -> float:
    """Work of the push against the wheel while it climbs a half-round with a load, relative to the work that lifts it.

    It is 1 where the road, which does not move, neither gives nor takes energy: what lifts the wheel slows it down.

    Args:
        force: of the road, whose half-round has its middle at x = 0.
        radius: of the wheel [m].
        load: vertical, constant [N].
        height: of the half-round [m].
    """
    places = -np.linspace(height + 0.45, 0.0, 60)
    ways, pushes = [], []
    for x in places:
        surface = np.sqrt(max(0.0, height**2 - x**2))
        z = float(brentq(lambda z, x=x: force(x, z)[1] - load, surface + 0.4 * radius, radius + height + 1e-3))
        ways.append(z)
        pushes.append(-force(x, z)[0])
    return float(np.trapezoid(pushes, places)) / (load * (ways[-1] - ways[0]))
