"""Courses of a proving ground under one car: three RMS courses and a half-round, chosen by a parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from build_fmus.component import Component
from fmu_sources.registration import component
from fmu_sources.roads.half_cylinder import HalfRound
from fmu_sources.roads.half_round import RolledHalfRound
from fmu_sources.roads.layout import RoadLayout
from fmu_sources.roads.rms_course import COURSES, LENGTH, RAMP, SEEDS, STEP, course_heights, driven
from fmu_sources.roads.road import Profile, road

HALF_ROUND = len(COURSES)  # its number among the courses
POSITION, BEHIND = 30.0, 100.0  # m, of the half-round, and of level road behind it


@dataclass(frozen=True)
class _Chosen:
    """The profile, or the half-round where `obstacle` is true."""

    profile: Profile
    half_round: RolledHalfRound | HalfRound
    obstacle: Any
    note = "Between heights the road is linear."

    @property
    def end(self) -> Any:
        """[m]."""
        return ca.if_else(self.obstacle, self.half_round.end, self.profile.end)

    def at(self, x: Any, side: str) -> tuple[Any, Any]:
        """Height [m] and slope at a column of positions [m]."""
        both = zip(self.half_round.at(x, side), self.profile.at(x, side), strict=True)
        height, slope = (ca.if_else(self.obstacle, over, along) for over, along in both)
        return height, slope


@component("RoadProvingGround{v}", "synthetic RMS courses and a half-round under the HMMWV", of="ride_car_hmmwv")
@component("RoadProvingGround5ms{s}", "synthetic RMS courses and a half-round under the sedan", of="sedan")
@component("RoadProvingGroundThreeAxle{s}", "synthetic RMS courses and a half-round under the 6x6", of="three_axle")
@component(
    "RoadProvingGround{v}", "synthetic RMS courses and a half-round under tires that envelop them", of="hmmwv_public"
)
@component("RoadProvingGround{s}", "synthetic RMS courses and a half-round under the full car", of="hmmwv_modified")
def road_proving_ground(layout: RoadLayout, name: str = "RoadProvingGround", *, radius: float) -> Component:
    """The synthetic RMS courses and a half-round, under wheels of `radius` [m].

    With 0 the heights are as they are, for tires that envelop; see `fmu_sources.roads.rms_course`.
    """
    track = np.mean([w.y for w in layout.wheels if w.side == "left"]) - np.mean(
        [w.y for w in layout.wheels if w.side == "right"]
    )
    tables: dict[str, list[np.ndarray]] = {"left": [], "right": []}
    for course in COURSES:
        for seed in range(1, SEEDS + 1):
            for side, heights in zip(tables, course_heights(course, seed, float(track), alike=False), strict=True):
                tables[side].append(driven(heights, radius))
    nodes = len(tables["left"][0])

    def chosen(c: Component) -> _Chosen:
        names = ", ".join(f"{i} {n} rms" for i, n in enumerate(COURSES))
        course = c.parameter(
            "course",
            0,
            None,
            f"course: {names}, {HALF_ROUND} half-round",
            min=0,
            max=HALF_ROUND,
            source="names of the measured courses",
        )
        seed = c.parameter("seed", 1, None, "which of the random profiles", min=1, max=SEEDS, source="own")
        alike = c.parameter(
            "alike", True, None, "left and right are the same, as on the measured courses", source="as measured"
        )
        size = c.parameter(
            "half_round.height", 0.2032, "m", "height of the half-round, its radius", min=0.001, max=1.0, source="8 in"
        )
        wheel = (
            c.constant("wheel.radius", radius, "m", "radius of the wheels", source="build option") if radius else None
        )
        place = (
            c.parameter("half_round.position", POSITION, "m", "where its middle is", min=-1e4, max=1e4, source="own"),
            c.constant("behind", BEHIND, "m", "level road behind it", source="own"),
        )
        obstacle = HalfRound(size, *place) if wheel is None else RolledHalfRound(size, wheel, *place)
        held = {
            side: c.constant(
                f"heights.{side}",
                np.concatenate(found) + 0.0,
                "m",
                f"heights of the {side} track",
                source="fitted spectrum",
            )
            for side, found in tables.items()
        }
        first = (ca.fmin(course, HALF_ROUND - 1) * SEEDS + seed - 1) * nodes

        def height(node: Any, side: str) -> Any:
            left = held["left"][first + node]
            return left if side == "left" else ca.if_else(alike, left, held["right"][first + node])

        return _Chosen(Profile(height, nodes - 1, STEP, -RAMP).declared(c), obstacle, course > HALF_ROUND - 0.5)

    rms = ", ".join(f"{1e3 * c.rms:.1f}" for c in COURSES.values())
    return road(
        name,
        layout,
        chosen,
        description=f"Synthetic RMS courses of a proving ground, {SEEDS} seeds each, and a half-round",
        source="rms and spectrum fitted to measured RMS courses of a proving ground in Michigan; Gaussian",
        symbols=ca.MX,
        notes=(
            (
                f"RMS courses run from 0 to {LENGTH:g} m, level before and behind with {RAMP:g} m of ramp:"
                f" {', '.join(COURSES)} with {rms} mm, the detrended rms and fitted spectrum of the measured courses of"
                " these names. Heights are Gaussian; the measured 1in course has single bumps besides."
            ),
            (
                "The half-round is a half cylinder across the road, its height its radius; the road is level before and"
                " behind it."
            ),
            (
                f"Heights are those that a rigid wheel of {radius:g} m radius follows, which bridges waves shorter than"
                " itself and meets an obstacle before its hub is there. rms and spectrum are those of the ground below"
                " it. A tire gives way at an edge and meets a little less."
                if radius
                else "Heights are those of the ground itself, for tires that envelop it."
            ),
            (
                "alike: both sides are the same, as on the measured courses. Otherwise the correlation of the sides"
                f" falls with wave number as exp(-2 track n), with a track of {track:g} m (assumed; it was not measured"
                " there), and cars roll."
            ),
        ),
        reference_start=POSITION - 4.0,
    )
