"""Corners of vehicles: names, axles, the order of all vectors over wheels, and declarations per corner.

The variables of a car are in the order of kinds: all heights, then all velocities, not corner by corner. Its equations
are those of one corner, four or six times. A `Corner` holds what belongs to one of them, and
`Corners.each` declares one kind after the other:

    corners = Corners(TWO_AXLES)
    corners.each(z=lambda k: c.state(f"wheel.{k}.z", "m", "height of the wheel"))
    corners.each(vz=lambda k: c.state(f"wheel.{k}.vz", "m/s", "velocity of the wheel"))
    for k in corners:
        c.derivative(k.z, k.vz)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

TWO_AXLES = {f"{axle[0]}{side}": axle for axle in ("front", "rear") for side in "lr"}
"""Corner -> axle: `fl fr rl rr` -> `front` or `rear`."""
THREE_AXLES = {f"{axle}{side}": axle for axle in ("a1", "a2", "a3") for side in "lr"}
"""Corner -> axle: `a1l a1r a2l a2r a3l a3r` -> `a1` (the front), `a2` or `a3`."""

CORNERS = tuple(TWO_AXLES)
SIX_CORNERS = tuple(THREE_AXLES)


class Corner(SimpleNamespace):
    """One corner, and all that it is given. In texts it is its name.

    `name`, `axle`; `side`: 1 left of the middle, -1 right; `place` in the order of the corners, from 0 on.
    """

    def __init__(self, name: str, axle: str, place: int) -> None:
        super().__init__(name=name, axle=axle, place=place, side=1 if name.endswith("l") else -1)

    def __str__(self) -> str:
        return str(self.name)


class Corners(list[Corner]):
    """The corners of a car, in the order of all vectors; made of corner -> axle."""

    def __init__(self, axle_of: Mapping[str, str]) -> None:
        super().__init__(Corner(name, axle, i) for i, (name, axle) in enumerate(axle_of.items()))

    def each(self, **values: Callable[[Corner], Any]) -> None:
        """Give every corner attributes: one after the other for all corners, each the value for that corner."""
        for name, value in values.items():
            for k in self:
                setattr(k, name, value(k))

    def all(self, name: str) -> list[Any]:
        """An attribute of all corners."""
        return [getattr(k, name) for k in self]

    def paired(self, name: str) -> Any:
        """Sum of an attribute over the corners, left and right first: bit-identical where these are exchanged."""
        of = self.all(name)
        return sum(left + right for left, right in zip(of[::2], of[1::2], strict=True))
