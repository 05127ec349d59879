"""A trench too shallow to catch a wheel, with rounded edges (paper 003, 5.3).

It is given by formulas, so it is exact at every position.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import declare_side, is_on, road

START, LENGTH, DEPTH, EDGE = 5.0, 2.0, 0.15, 0.2  # m


@dataclass(frozen=True)
class _Trench:
    """Every value may be a parameter of the component. Lengths, positions and depth in m."""

    start: Any
    length: Any
    depth: Any
    edge: Any
    side: Any
    end: Any

    note = (
        "Heights and slopes are exact at every position; there are no nodes. Beyond its end the road is held at its"
        " last height."
    )

    def at(self, x: Any, side: str) -> tuple[Any, Any]:
        """Height [m] and slope dz/dx at a column of positions [m]."""
        here = is_on(side, self.side)
        beyond = x > self.end
        x = ca.fmin(x, self.end)
        down, up = (ca.tanh((x - edge) / self.edge) for edge in (self.start, self.start + self.length))
        height = -self.depth / 2 * (down - up)
        slope = -self.depth / (2 * self.edge) * (up * up - down * down)
        return ca.if_else(here, height, 0), ca.if_else(ca.logic_and(here, ca.logic_not(beyond)), slope, 0)


@component("RoadShallowTrench{s}", "shallow trench under the 6x6 of paper 003", of="three_axle")
def road_shallow_trench(layout: RoadLayout, name: str = "RoadShallowTrench") -> Component:
    """Shallow trench across the road: -depth/2 (tanh((x - start)/edge) - tanh((x - start - length)/edge))."""

    def profile(c: Component) -> _Trench:
        def length(name: str, start: float, text: str, source: str, *, least: float = 1e-3) -> Any:
            return c.parameter(name, start, "m", text, min=least, max=1e5, source=source)

        return _Trench(
            start=length("trench.start", START, "where the trench begins, at half its depth", "assumed", least=-1e5),
            length=length("trench.length", LENGTH, "length of the trench at half its depth", "003 Figure 5.4"),
            depth=c.parameter(
                "trench.depth",
                DEPTH,
                "m",
                "depth of the trench, 0 for none",
                min=0.0,
                max=5.0,
                display_unit="mm",
                source="003 Table 5.1",
            ),
            edge=length("trench.edge", EDGE, "length over which an edge is rounded: the scale of its tanh", "assumed"),
            side=declare_side(c, "the trench is", "003: across the road"),
            end=length("length", 200.0, "length of the road", "assumed", least=1.0),
        )

    return road(
        name,
        layout,
        profile,
        description="Shallow trench with rounded edges, on both sides or one (paper 003)",
        source="003 section 5.3, Figure 5.4, Table 5.1; rounding assumed",
        notes=(
            (
                "An edge falls by 76 % of the depth within trench.edge to either side of its middle. An edge longer"
                " than about a third of the trench leaves less than the whole depth in the middle."
            ),
            (
                "The published runs are 0.15 and 0.25 m deep at 5, 10 and 20 km/h. trench.start counts from x = 0 of"
                " the CG, so the first axle is on the edge when x is trench.start less that wheel's position."
            ),
        ),
        reference_start=2.0,
    )
