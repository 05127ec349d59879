"""A half-round: the obstacle of mobility tests, a half cylinder that lies across the road, as a rolling wheel meets it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import road

POSITION = 30.0  # m
BEHIND = 100.0  # m of road behind it


@dataclass(frozen=True)
class RolledHalfRound:
    """Path of a disc of ``wheel`` [m] radius over a half cylinder of ``height`` [m] radius at ``place`` [m]: an arc about its axis."""

    height: Any
    wheel: Any
    place: Any
    behind: Any
    alike = True
    note = (
        "Heights are those of a rigid wheel that rolls over the half-round: an arc of the sum of both radii, which begins where the wheel "
        "touches. A tire gives way at the edge, so it meets a little less."
    )

    @property
    def end(self) -> Any:
        """[m]."""
        return self.place + self.behind

    def at(self, x: Any, _side: str) -> tuple[Any, Any]:
        """Height [m] and slope at a column of positions [m]; both sides are the same."""
        s, together = x - self.place, self.height + self.wheel
        over = s**2 < together**2 - self.wheel**2
        root = ca.sqrt(ca.if_else(over, together**2 - s**2, together**2))
        return ca.if_else(over, root - self.wheel, 0), ca.if_else(over, -s / root, 0)


def road_half_round(layout: RoadLayout, name: str = "RoadHalfRound", *, radius: float) -> Component:
    """A half-round under wheels of ``radius`` [m]; heights of 4 to 12 inches are usual."""

    def profile(c: Component) -> RolledHalfRound:
        return RolledHalfRound(
            c.parameter("height", 0.2032, "m", "height of the half-round, its radius", min=0.001, max=1.0, source="8 in, as proving grounds have"),
            c.parameter("wheel.radius", radius, "m", "radius of the wheels", min=0.05, max=3.0, source="vehicle"),
            c.parameter("position", POSITION, "m", "where its middle is", min=-1e4, max=1e4, source="own"),
            c.constant("behind", BEHIND, "m", "road behind it", source="own"),
        )

    return road(
        name, layout, profile, description="Half-round obstacle across the road", source="half-rounds of proving grounds",
        notes=("Before and behind the half-round the road is level.",), stimulus_start=POSITION - 5.0,
    )  # fmt: skip
