"""A road with a half-round as it is, for tires that envelop it: the profile itself, not the path of a wheel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import road

POSITION = 30.0  # m
BEHIND = 100.0  # m of road behind it


@dataclass(frozen=True)
class HalfRound:
    """A half cylinder of `height` [m] radius across the road at `place` [m]."""

    height: Any
    place: Any
    behind: Any
    alike = True
    note = (
        "Heights are those of the half-round itself, whose sides are vertical where they begin; before and behind it"
        " the road is level."
    )

    @property
    def end(self) -> Any:
        """Position [m] at which the road ends."""
        return self.place + self.behind

    def at(self, x: Any, _side: str) -> tuple[Any, Any]:
        """Height [m] and slope at a column of positions [m]; both sides are the same."""
        s = x - self.place
        over = s**2 < self.height**2
        root = ca.sqrt(ca.if_else(over, self.height**2 - s**2, self.height**2))
        return ca.if_else(over, root, 0), ca.if_else(over, -s / root, 0)


@component("RoadHalfRound{v}", "half-round under tires that envelop it", of="hmmwv_public")
def road_half_round(layout: RoadLayout, name: str = "RoadHalfRound") -> Component:
    """A half-round under tires that envelop it; heights of 4 to 12 inches are usual."""

    def profile(c: Component) -> HalfRound:
        return HalfRound(
            c.parameter(
                "height",
                0.2032,
                "m",
                "height of the half-round, its radius",
                min=0.001,
                max=1.0,
                source="8 in, as proving grounds have",
            ),
            c.parameter("position", POSITION, "m", "where its middle is", min=-1e4, max=1e4, source="own"),
            c.constant("behind", BEHIND, "m", "road behind it", source="own"),
        )

    return road(
        name,
        layout,
        profile,
        description="Half-round obstacle across the road",
        source="half-rounds of proving grounds",
        reference_start=POSITION - 5.0,
    )
