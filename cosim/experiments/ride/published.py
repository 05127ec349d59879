"""The runs of the study: every car under every law, over the synthetic courses or one from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cosim.experiments.hmmwv.runs import ACTUATORS
from cosim.experiments.ride.course import extent
from cosim.experiments.ride.runs import CARS, OBSTACLE, Case
from cosim.experiments.ride.search import SpeedLimit
from cosim.study.case import CaseError, check_choice
from fmu_sources.roads.rms_course import COURSES, INCH, SEEDS

POWERS = ("absorbed_power_nrmm", "absorbed_power")
PEAK = ("seat_peak",)
SEEDS_RUN = 3  # profiles of the course that shows the spread
SPREAD = "1in"
HEIGHTS = tuple(round(inches * INCH, 4) for inches in (4, 6, 8, 10, 12))  # m, of the half-rounds
APART = "1in"  # the course that is also driven with different sides
LEFT_OUT = ("comfort-delay", "road-holding-delay")  # they see the road ahead of the rear wheels only: between active and preview
GUESS = {"hmmwv": 15.0, "sedan": 40.0, "6x6": 28.0, "full-car": 30.0}  # km/h, of 6 W on the 1 inch course
ROUGHER = {"1in": 1.0, "2in": 0.6, "4in": 0.4}  # of the guess
SLOWER = {"hydraulic": 2.0}  # rough time of a run, to begin with the longest ones
LONG = {"mpc": 5.0, "mpc-preview": 5.0, "comfort-active": 4.0, "comfort-preview": 4.0, "road-holding-active": 4.0, "road-holding-preview": 4.0}

System = tuple[str, str, str]  # car, law, actuators


def systems(car: str | None = None) -> list[System]:
    """Every car under every law that the study runs, or those of one car; hydraulic actuators where there are any."""
    if car is not None:
        check_choice("car", car, CARS)
    found = []
    for name, made in CARS.items():
        if car in (None, name):
            for law in made.laws:
                for actuators in ACTUATORS if name == "hmmwv" else ("ideal",):
                    try:
                        found.append(_at((name, law, actuators), "1in"))
                    except CaseError:  # a passive car with ideal actuators
                        continue
    return [(c.car, c.controller, c.actuators) for c in found if c.controller not in LEFT_OUT]


def _at(system: System, course: str, **more: object) -> Case:
    car, law, actuators = system
    return Case(car, law, actuators, course, 1.0, **more)  # type: ignore[arg-type]


def _cost(system: System) -> float:
    return LONG.get(system[1], 1.0) * SLOWER.get(system[2], 1.0)


def six_watts(system: System, course: str, *, seeds: int = 1, sides: str = "alike") -> SpeedLimit:
    """The speed of 6 W, by both definitions, on an RMS course."""
    guess = GUESS[system[0]] * ROUGHER[course]
    return SpeedLimit(_at(system, course, sides=sides), POWERS, seeds, guess, 3 * seeds * _cost(system) / ROUGHER[course])


def obstacle(system: System, height: float) -> SpeedLimit:
    """The speed of 2.5 g over a half-round [m]."""
    return SpeedLimit(_at(system, OBSTACLE, height=height), PEAK, 1, 1.5 * GUESS[system[0]] * (4 * INCH / height), _cost(system) / 3)


def on_file(system: System, course: str) -> SpeedLimit:
    """Both on a course from a file."""
    return SpeedLimit(_at(system, course), (*POWERS, *PEAK), 1, GUESS[system[0]], 4 * _cost(system))


def plan(
    course: Annotated[
        Path | None, typer.Option("--course", metavar="FILE.crg", help="a measured course (OpenCRG) instead of the synthetic ones")
    ] = None,
    car: Annotated[str | None, typer.Option("--car", metavar="|".join(CARS), help="one car only")] = None,
    seeds: Annotated[int, typer.Option("--seeds", help=f"profiles of the {SPREAD} course", min=1, max=SEEDS)] = SEEDS_RUN,
) -> list[SpeedLimit]:
    """Every search of the study.

    Raises:
        RoadError: a file that cannot be driven on.
        CaseError: no such car, or a file that is no OpenCRG file.
    """
    chosen = systems(car)
    if course is not None:
        if course.suffix != ".crg":
            raise CaseError(f"--course {course}: give an OpenCRG file, FILE.crg")
        for name in dict.fromkeys(s[0] for s in chosen):  # said before anything runs
            extent(course, *CARS[name].size)
        return [on_file(s, str(course)) for s in chosen]
    found = [six_watts(s, c, seeds=seeds if c == SPREAD else 1) for s in chosen for c in COURSES]
    found += [six_watts(s, APART, seeds=1, sides="apart") for s in chosen]
    return [*found, *(obstacle(s, h) for s in chosen for h in HEIGHTS)]
