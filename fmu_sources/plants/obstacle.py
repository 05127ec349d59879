"""Obstacle outlines in the vertical plane of one side: what discs, points and corners touch, and how deep.

An outline is a chain of points along the road with the ground below it. Straight pieces between two concave corners
form one convex solid; a disc touches each solid at most once, at the point closest to its center. For a trench these
solids are the two quarter-planes beside it and its floor. All of it is found from the points at run time, so an outline
is a parameter of an FMU.

What is far away is cheap: values are chosen such that whatever needs a root or a quotient is needed on one side of a
condition only (a solid that there is, a point not above everything), and is not computed on the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca

FAR = 1e4  # m; the ground is level from the ends of an outline up to here
_TINY = 1e-12
_ABOVE = 1e-6  # m; this far above all points no rounding puts the ground above a place
_ALIKE = 1e-7  # contacts whose directions differ by less count as one


@dataclass(frozen=True)
class Touch:
    """One possible contact of a disc: penetration [m] (negative: distance), normal and share.

    The normal of the ground points outwards (0 where there is no solid). `share` is 1 for a contact by itself, and
    less where two solids that meet at an obtuse corner push the same way.
    """

    depth: Any
    nx: Any
    nz: Any
    share: Any


class Outline:
    """The ground of one side.

    Args:
        x, z: coordinates [m] of N points, symbols or numbers, x not decreasing, neighbors apart. Before the first
            point and after the last one the ground is level.
        meter: the length of 1 m, a constant where x and z are symbols of a component.
    """

    def __init__(self, x: list[Any], z: list[Any], meter: Any = 1.0) -> None:
        self._metre, self._far = meter, FAR * meter
        tiny = _TINY * meter**2
        self.points = list(zip(x, z, strict=True))
        ends = [(x[0] - self._far, z[0]), *self.points, (x[-1] + self._far, z[-1])]
        self._from = ends[:-1]
        self._way = [(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(ends)]
        self._inverse = [1 / (dx * dx + dz * dz + tiny) for dx, dz in self._way]
        self._inverse[-1] = 1 / (FAR * FAR + _TINY) / meter**2  # a number: its dx is FAR exactly
        turn = [a[0] * b[1] - a[1] * b[0] for a, b in pairwise(self._way)]
        self.concave = [t > 1e-9 * meter**2 for t in turn]  # at each point
        self.convex = [t < -1e-9 * meter**2 for t in turn]

    def _offsets(self, x: Any, z: Any) -> list[tuple[Any, Any]]:
        """From the closest point of each straight piece to (x, z)."""
        offsets = []
        for (x0, z0), (dx, dz), inverse in zip(self._from, self._way, self._inverse, strict=True):
            ox, oz = x - x0, z - z0
            along = ca.fmin(1, ca.fmax(0, (ox * dx + oz * dz) * inverse))
            offsets.append((ox - along * dx, oz - along * dz))
        return offsets

    def height(self, x: Any) -> Any:
        """Height of the ground at x; at a vertical wall that of its end."""
        height = self._from[0][1]
        for (x0, _), (dx, dz) in zip(self._from[1:-1], self._way[1:-1], strict=True):
            height += dz * ca.fmin(1, ca.fmax(0, (x - x0) / ca.fmax(dx, _TINY * self._metre)))
        return height

    def disc(self, x: Any, z: Any, radius: Any) -> list[Touch]:
        """Possible contacts of a disc centered above the ground at (x, z), one for each straight piece."""
        offsets = self._offsets(x, z)
        last = len(offsets) - 1
        solids: list[tuple[Any, Any, Any, Any]] = []  # closed here?, depth, nx, nz
        best = offsets[0]
        square = best[0] ** 2 + best[1] ** 2
        for k, (ox, oz) in enumerate(offsets):
            if k:
                here = ox * ox + oz * oz
                new = ca.logic_or(self.concave[k - 1], here < square)
                best = (ca.if_else(new, ox, best[0]), ca.if_else(new, oz, best[1]))
                square = ca.if_else(new, here, square)
            distance = ca.sqrt(square + _TINY * self._metre**2)
            closed = self.concave[k] if k < last else 1
            solids.append((closed, radius - distance, best[0] / distance, best[1] / distance))
        return [
            Touch(
                ca.if_else(closed, depth, -self._far),
                ca.if_else(closed, nx, 0),
                ca.if_else(closed, nz, 0),
                before * after,
            )
            for (closed, depth, nx, nz), before, after in zip(
                solids, self._shares(solids), reversed(self._shares(solids[::-1])), strict=True
            )
        ]

    def clearance(self, touches: list[Touch]) -> Any:
        """Distance [m] of a disc from the ground, negative when it touches."""
        clearance = -touches[0].depth
        for t in touches[1:]:
            clearance = ca.fmin(clearance, -t.depth)
        return clearance

    def point(self, x: Any, z: Any) -> tuple[Any, Any, Any]:
        """Depth of a point below the ground and the unit vector of the shortest way out, all 0 outside."""
        best: Any = None
        for ox, oz in self._offsets(x, z):
            here = ox * ox + oz * oz
            if best is None:
                best = (here, ox, oz)
            else:
                new = here < best[0]
                best = tuple(ca.if_else(new, a, b) for a, b in zip((here, ox, oz), best, strict=True))
        distance = ca.sqrt(best[0] + (_TINY * self._metre) ** 2)
        highest = self.points[0][1]
        for _, top in self.points[1:]:
            highest = ca.fmax(highest, top)
        near = z < highest + _ABOVE * self._metre
        inside = ca.if_else(near, self.height(x) > z, 0)
        depth, nx, nz = (ca.if_else(inside, v, 0) for v in (distance, -best[1] / distance, -best[2] / distance))
        return depth, nx, nz

    def _shares(self, solids: list[tuple[Any, Any, Any, Any]]) -> list[Any]:
        """What the solid before leaves to each solid.

        Two planes push a disc out by the shortest vector d with n1 d >= p1 and n2 d >= p2. At right angles each pushes
        by its own penetration; nearly parallel ones push once. The force is the gradient of d^2 / 2, so it has a
        potential.
        """
        shares = []
        depth, nx, nz = solids[0][1] * 0 - self._far, solids[0][2], solids[0][3]  # of the closed solid before
        for closed, p, mx, mz in solids:
            c = ca.fmin(1, ca.fmax(0, nx * mx + nz * mz))
            # The small numbers give half to each of two contacts that coincide, in the middle of a straight road.
            left = (p * (1 + _ALIKE / 2) - c * depth) / (ca.fmax(p, 1e-9 * self._metre) * (1 - c * c + _ALIKE))
            shares.append(ca.if_else(depth > 0, ca.fmin(1, ca.fmax(0, left)), 1))
            depth, nx, nz = (ca.if_else(closed, new, old) for new, old in ((p, depth), (mx, nx), (mz, nz)))
        return shares
