"""Sine and curb roads of paper 000: the same on both sides, given by a formula at nodes 0.1 m apart."""

from __future__ import annotations

from math import pi
from typing import Any

import casadi as ca

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.road import NODE_STEP, Profile, road


@component("RoadSine{s}", "sine road of paper 000", of="hmmwv_modified")
def road_sine(layout: RoadLayout, name: str = "RoadSine") -> Component:
    """Sine road: flat, then a sine wave (paper 000, figure 3)."""

    def profile(c: Component) -> Profile:
        amplitude = c.parameter(
            "amplitude", 0.10, "m", "half the height of the wave", min=0.0, max=5.0, source="000 sine road"
        )
        wavelength = c.parameter(
            "wavelength", 10.0, "m", "length of one wave", min=0.2, max=1e5, source="000 sine road"
        )
        flat, last, step = _flat_last_and_step(c)

        def height(node: Any, _: str) -> Any:
            x = node * step - flat
            return ca.if_else(x > 0, amplitude * ca.sin(2 * pi * x / wavelength), 0)

        return Profile(height, last, step, alike=True)

    return road(
        name,
        layout,
        profile,
        description="Sine road of paper 000: 30 m flat, then waves 10 m long and +-0.1 m high",
        source="000 road profiles, figure 3",
    )


@component("RoadCurb{s}", "curb road of paper 000", of="hmmwv_modified")
def road_curb(layout: RoadLayout, name: str = "RoadCurb") -> Component:
    """Curb: flat, a step up, level, a step down (paper 000, figure 4); a step takes one node interval."""

    def profile(c: Component) -> Profile:
        rise = c.parameter("height", 0.10, "m", "height of the step", min=-5.0, max=5.0, source="000 curb road")
        level = c.parameter(
            "level", 10.0, "m", "from the step up to the step down", min=0.1, max=1e5, source="000 curb road"
        )
        flat, last, step = _flat_last_and_step(c)

        def height(node: Any, _: str) -> Any:
            x = node * step - flat - step / 2  # half a node off: no node lies on a step
            return ca.if_else(ca.logic_and(x > 0, x < level), rise, 0)

        return Profile(height, last, step, alike=True)

    return road(
        name,
        layout,
        profile,
        description="Curb road of paper 000: 30 m flat, 0.1 m up, 10 m level, 0.1 m down",
        source="000 road profiles, figure 4",
    )


def _flat_last_and_step(c: Component) -> tuple[Any, Any, Any]:
    """What both roads have: flat start, length as the number of the last node, and the distance between nodes."""
    step = c.constant("node.step", NODE_STEP, "m", "distance between nodes", source="000 road profiles")
    flat = c.parameter("flat", 30.0, "m", "flat stretch at the start", min=0.0, max=1e5, source="000 road profiles")
    length = c.parameter(
        "length", 200.0, "m", "length of the road", min=1.0, max=1e6, source="assumed: 150 m runs and margin"
    )
    return flat, ca.floor(length / step + 1e-6), step
