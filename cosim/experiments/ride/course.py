"""A measured course from an OpenCRG file for any of the cars; its road FMU is built on first use, once per process."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from cosim.experiments.built import built
from cosim.fmu.file import FmuFile
from cosim.study.fmus import FmuSet
from fmu_sources.roads import ENVELOPING, RoadError, RoadLayout, WheelPosition, road_from_file
from fmu_sources.roads.user_file import heights_from_file

LEVEL = 1e-3  # m: within it of its ends a course has not begun, or has ended


@dataclass(frozen=True)
class FileCourse:
    """The road FMU of a file, and where its heights begin to differ from those at its ends [m along it]."""

    fmu: Path
    begin: float
    end: float


def extent(path: Path, half_track: float, wheelbase: float) -> tuple[float, float]:
    """Where the course in a file begins and ends [m], between level stretches at its ends.

    Raises:
        RoadError: it is level, or shorter than a car with this `wheelbase` [m]; or it cannot be read.
    """
    distance, left, right = heights_from_file(path, half_track)
    length = float(distance[-1] - distance[0])
    if length < wheelbase:
        raise RoadError(
            f"{path}: the course is {length:g} m long, shorter than the car between its first and last axle"
            f" ({wheelbase:g} m)"
        )
    both = np.column_stack([left, right])
    begun = np.flatnonzero((np.abs(both - both[0]) > LEVEL).any(axis=1))
    ended = np.flatnonzero((np.abs(both - both[-1]) > LEVEL).any(axis=1))
    if not begun.size or not ended.size:
        raise RoadError(f"{path}: the course is level, within {1e3 * LEVEL:g} mm; there is nothing to ride over")
    return float(distance[max(begun[0] - 1, 0)]), float(distance[min(ended[-1] + 1, len(distance) - 1)])


def wheels_of(car: FmuFile) -> tuple[WheelPosition, ...]:
    """Where the wheels of a car's FMU are."""
    values = {n: float(v.start) for n, v in car.description.parameters.items() if isinstance(v.start, int | float)}
    if "body.wheelbase" in values:
        front = values["body.cg_position"] * values["body.wheelbase"]
        half = values["body.track"] / 2
        places = {"fl": (front, half), "fr": (front, -half)}
        places |= {k: (front - values["body.wheelbase"], y) for k, y in (("rl", half), ("rr", -half))}
        return tuple(WheelPosition(k, *at) for k, at in places.items())
    if "suspension.front.wheel[1]" in values:  # double wishbones, of the left wheels
        return tuple(
            WheelPosition(
                f"{axle[0]}{side[0]}",
                values[f"suspension.{axle}.wheel[1]"],
                sign * values[f"suspension.{axle}.wheel[2]"],
            )
            for axle in ("front", "rear")
            for side, sign in (("left", 1), ("right", -1))
        )
    corners = [n.split(".")[1] for n in values if n.startswith("wheel.") and n.endswith(".half_track")]
    return tuple(
        WheelPosition(k, values[f"wheel.{k}.x"], (1 if k.endswith("l") else -1) * values[f"wheel.{k}.half_track"])
        for k in corners
    )


def course_under(fmus: FmuSet, path: str, plant: str, preview: tuple[int, float], radius: float) -> FileCourse:
    """The road FMU of a course file under a car.

    Args:
        fmus: where the car's FMU is.
        path: of the file.
        plant: name of the car's FMU, which says where its wheels are.
        preview: heights ahead and the time between them [s], that the car's controllers read.
        radius: of its wheels [m].

    Raises:
        RoadError: the file cannot be used; the message names it and what is wrong.
    """
    return _made(
        Path(path),
        Path(path).stat().st_mtime_ns if Path(path).is_file() else 0,
        fmus.path(plant),
        fmus.fmi,
        preview,
        radius,
    )


@cache
def _made(path: Path, _changed: int, car: Path, fmi: int, preview: tuple[int, float], radius: float) -> FileCourse:
    file = FmuFile(car)
    wheels = wheels_of(file)
    contact = ENVELOPING if "contact.step" in file.description.inputs else None
    axles = [w.x for w in wheels]
    begin, end = extent(path, max(abs(w.y) for w in wheels), max(axles) - min(axles))
    component = road_from_file(path, RoadLayout(wheels, *preview, contact=contact), "RoadCourse", radius=radius)
    return FileCourse(built(component, fmi), begin, end)
