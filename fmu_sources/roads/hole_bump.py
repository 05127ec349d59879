"""A hole, a flat stretch and a bump, given by formulas: exact at every position (paper 004, Table 3)."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import declare_side, is_on, road

SPEED = 75 / 3.6  # m/s, of the runs of paper 004
LEAD, DURATION = 0.12, 0.1  # s at that speed: to the front edge of the hole; each of hole, gap and bump
HEIGHT = 0.05  # m
_EDGE = 1e-9  # a position this part of a length before an edge counts as on it

HAVERSINE, SINE, TRIANGLE, STEP = range(4)


@dataclass(frozen=True)
class _HoleBump:
    """Heights of hole and bump; every value may be a parameter of the component. Lengths and positions in m."""

    hole_start: Any
    hole_length: Any
    hole_depth: Any
    gap: Any
    bump_length: Any
    bump_height: Any
    shape: Any
    edge: Any
    side: Any
    end: Any

    note = (
        "Heights and slopes are exact at every position; there are no nodes. At a corner the slope is that ahead. "
        "Outside hole and bump the road is flat at height 0, and so it is beyond its end."
    )

    def at(self, x: Any, side: str) -> tuple[Any, Any]:
        """Height [m] and slope dz/dx at a column of positions [m]."""
        bump_start = self.hole_start + self.hole_length + self.gap
        in_bump = x >= bump_start - _EDGE * self.bump_length
        start = ca.if_else(in_bump, bump_start, self.hole_start)
        length = ca.if_else(in_bump, self.bump_length, self.hole_length)
        size = ca.if_else(in_bump, self.bump_height, -self.hole_depth)
        here = is_on(side, self.side)

        part = (x - start) / length
        inside = ca.logic_and(here, ca.logic_and(part >= -_EDGE, part < 1 - _EDGE))
        part = ca.fmax(0, ca.fmin(1, part))
        rising = part < 0.5 - _EDGE
        # Distance from the nearer edge; the mirror image makes both halves equal to the last bit.
        near = ca.if_else(rising, part, 1 - part)
        sign = ca.if_else(rising, 1, -1)
        edge = ca.fmin(self.edge / length, 0.5)
        on_edge = ca.logic_or(ca.logic_and(rising, near < edge - _EDGE), ca.logic_and(sign < 0, near <= edge + _EDGE))
        heights = {
            HAVERSINE: ca.sin(pi * near) ** 2,
            SINE: ca.sin(pi * near),
            TRIANGLE: 2 * near,
            STEP: ca.fmin(1, near / edge),
        }
        slopes = {  # per part of the length
            HAVERSINE: sign * pi * ca.sin(2 * pi * near),
            SINE: sign * pi * ca.cos(pi * near),
            TRIANGLE: 2 * sign,
            STEP: ca.if_else(on_edge, sign / edge, 0),
        }
        height, slope = self._chosen(heights), self._chosen(slopes)
        return ca.if_else(inside, size * height, 0), ca.if_else(inside, size * slope / length, 0)

    def _chosen(self, values: dict[int, Any]) -> Any:
        *rest, last = values.items()
        chosen = last[1]
        for number, value in reversed(rest):
            chosen = ca.if_else(self.shape == number, value, chosen)
        return chosen


@component("RoadHoleBump{s}", "hole, flat and bump of paper 004", of="sedan")
def road_hole_bump(layout: RoadLayout, name: str = "RoadHoleBump") -> Component:
    """Hole, flat and bump (paper 004, Table 3 and Figures 4 to 7).

    The defaults are lengths that last 0.1 s each at 75 km/h, and a hole that the front wheels of `layout` reach at
    0.12 s when the CG starts at x = 0 with that speed.
    """
    front = max(w.x for w in layout.wheels)

    def profile(c: Component) -> _HoleBump:
        at_speed = f"at {SPEED * 3.6:.0f} km/h"

        def length(
            name: str, seconds: float, text: str, source: str, *, least: float = 1e-3, ahead: float = 0.0
        ) -> Any:
            return c.parameter(name, round(ahead + seconds * SPEED, 12), "m", text, min=least, max=1e5, source=source)

        def size(name: str, text: str) -> Any:
            return c.parameter(
                name, HEIGHT, "m", text, min=-5.0, max=5.0, display_unit="mm", source="assumed; cancels in 004 Table 3"
            )

        shapes = "shape of hole and bump: 0 haversine, 1 half sine, 2 triangle, 3 step"
        source = "004: hole and bump, both sides"
        lasting = f"{DURATION:g} s {at_speed}, which reproduces 004 Table 3"
        return _HoleBump(
            hole_start=length(
                "hole.start",
                LEAD,
                "where the hole begins",
                f"{LEAD:g} s {at_speed} ahead of the front wheels at x = 0",
                least=-1e5,
                ahead=front,
            ),
            hole_length=length("hole.length", DURATION, "length of the hole", lasting),
            hole_depth=size("hole.depth", "depth of the hole, 0 for none"),
            gap=length("gap", DURATION, "flat stretch between hole and bump", lasting, least=0.0),
            bump_length=length("bump.length", DURATION, "length of the bump", lasting),
            bump_height=size("bump.height", "height of the bump, 0 for none"),
            shape=c.parameter("shape", 0, None, shapes, min=0, max=STEP, source=source),
            edge=c.parameter(
                "step.edge",
                0.1,
                "m",
                "length of each edge of a step",
                min=1e-3,
                max=1e5,
                display_unit="mm",
                source="as of the curb road",
            ),
            side=declare_side(c, "hole and bump are", source),
            end=c.parameter("length", 200.0, "m", "length of the road", min=1.0, max=1e6, source="assumed"),
        )

    return road(
        name,
        layout,
        profile,
        description="Hole, flat stretch and bump, on both sides or one (paper 004)",
        source="004 numerical simulation: hole followed by a bump; lengths found from its Table 3",
        notes=(
            (
                "A step is a ramp of step.edge meters up and another one down, so that height, slope and rate agree; 1"
                " mm is the shortest. An edge longer than half of the hole or bump makes a triangle of it."
            ),
            (
                "hole.start counts from x = 0. With its default, and x of the CG running from 0 at 75 km/h, the front"
                " wheels enter the hole at 0.12 s and the bump at 0.32 s (SpeedProfile: start.x 0, start.speed 75"
                " km/h). A negative depth or height turns a hole into a bump and the other way round."
            ),
        ),
        reference_start=2.0,
    )
