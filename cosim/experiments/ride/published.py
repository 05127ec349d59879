"""The runs of the study: every car with every controller, over the synthetic courses or one from a file."""

from __future__ import annotations

from pathlib import Path

import click

from build_fmus.base import surface
from build_fmus.base.terminal import PATH, Names
from cosim.experiments.hmmwv.runs import ACTUATORS
from cosim.experiments.preview_lq.runs import MODES
from cosim.experiments.ride.course import extent
from cosim.experiments.ride.runs import CARS, OBSTACLE, CarSystem, Case
from cosim.experiments.ride.search import WITHIN, SpeedLimit
from cosim.study.case import CaseError, check_choice
from fmu_sources.roads.rms_course import COURSES, INCH, SEEDS

POWERS = ("absorbed_power_nrmm", "absorbed_power")
PEAK = ("seat_peak",)
SEEDS_RUN = 3  # profiles of each course, which show the spread
ONE_SEED = ("mpc", "mpc-preview")  # whose runs take so long that the rougher courses have one profile
SPREAD = "1in"  # the course that all controllers drive on all profiles
HEIGHTS = tuple(round(inches * INCH, 4) for inches in (4, 6, 8, 10, 12))  # m, of the half-rounds
SIDES_COURSE = "1in"  # the course that is also driven with different sides
GUESS = {
    "hmmwv": (15.0, 0.8, 0.7),
    "sedan": (40.0, 0.6, 0.47),
    "6x6": (31.0, 0.63, 0.54),
    "full-car": (35.0, 0.53, 0.39),
    "public": (15.0, 0.6, 0.4),
    "hmmwv-dampers": (20.0, 0.8, 0.7),
}
"""Where searches begin: speed [km/h] of 6 W on the first course, and parts of it on the others. They decide how many
runs a search takes.
"""
FASTER = {
    ("hmmwv", "passive"): 0.27,
    ("hmmwv", "lqr-kilonewton"): 1.3,
    ("hmmwv", "mpc"): 1.3,
    ("hmmwv", "mpc-preview"): 1.7,
    ("6x6", "lqr"): 1.15,
    ("6x6", "mpc"): 0.7,
    ("6x6", "mpc-preview"): 0.82,
    ("sedan", "comfort-active"): 1.8,
    ("sedan", "comfort-delay"): 2.2,
    ("sedan", "comfort-preview"): 2.5,
    ("sedan", "road-holding-active"): 0.62,
    ("sedan", "road-holding-preview"): 2.0,
}
"""The same for controllers under which a car is much faster or slower: times as fast."""
LONG = {
    "mpc": 6.0,
    "mpc-preview": 6.0,
    **{f"{weights}-{mode}": 4.0 for weights in ("comfort", "road-holding") for mode in MODES},
}
"""Rough time of a run as compared with others, so that the longest searches come first; hydraulics double it."""


def systems(car: str | None = None) -> list[CarSystem]:
    """Every car with every controller of the study, or those of one car.

    Hydraulic actuators are included where the car has them.
    """
    if car is not None:
        check_choice("car", car, CARS)
    every = ((name, c) for name, made in CARS.items() if car in (None, name) for c in made.controllers)
    return [
        (name, controller, actuators)
        for name, controller in every
        for actuators in (ACTUATORS if name == "hmmwv" else ("ideal",))
        if (name, controller, actuators) != ("hmmwv", "passive", "ideal")  # its pump is off, its actuators are there
    ]


def _at(system: CarSystem, course: str, **more: object) -> Case:
    car, controller, actuators = system
    return Case(car, controller, actuators, course, 1.0, **more)  # type: ignore[arg-type]


def _guess(system: CarSystem, course: str) -> float:
    """Where the search for 6 W begins [km/h]."""
    first, *parts = GUESS[system[0]]
    return max(WITHIN[0], first * FASTER.get(system[:2], 1.0) * dict(zip(COURSES, (1.0, *parts), strict=True))[course])


def _cost(system: CarSystem, speed: float) -> float:
    return LONG.get(system[1], 1.0) * (2.0 if system[2] == "hydraulic" else 1.0) / speed


def six_watts(system: CarSystem, course: str, *, seeds: int = 1, sides: str = "alike") -> SpeedLimit:
    """The speed of 6 W, by both definitions, on an RMS course."""
    guess = _guess(system, course)
    return SpeedLimit(_at(system, course, sides=sides), POWERS, seeds, guess, (1 + seeds) * _cost(system, guess))


def obstacle(system: CarSystem, height: float) -> SpeedLimit:
    """The speed of 2.5 g over a half-round [m]."""
    guess = 1.5 * GUESS[system[0]][0] * (HEIGHTS[0] / height)
    return SpeedLimit(_at(system, OBSTACLE, height=height), PEAK, 1, guess, _cost(system, guess) / 10)


def on_file(system: CarSystem, course: str) -> SpeedLimit:
    """Both on a course from a file."""
    guess = _guess(system, SPREAD)
    return SpeedLimit(_at(system, course), (*POWERS, *PEAK), 1, guess, 3 * _cost(system, guess))


@click.option(
    "--course", type=PATH, metavar="FILE.crg", help="a measured course (OpenCRG) instead of the synthetic ones"
)
@click.option("--car", type=Names(CARS), help="one car only")
@click.option(
    "--seeds",
    type=click.IntRange(1, SEEDS),
    default=SEEDS_RUN,
    help=f"profiles of each course; of the rougher ones {' and '.join(ONE_SEED)} drive one",
)
def plan(course: Path | None = None, car: str | None = None, seeds: int = SEEDS_RUN) -> list[SpeedLimit]:
    """Every search of the study.

    Raises:
        RoadError: a file that cannot be driven on.
        CaseError: no such car, or a file that is no OpenCRG file.
    """
    chosen = systems(car)
    if course is not None:
        if course.suffix != ".crg":
            raise CaseError(f"{surface.given(course=str(course))}: give an OpenCRG file, FILE.crg")
        for name in dict.fromkeys(s[0] for s in chosen):  # said before anything runs
            extent(course, *CARS[name].size)
        return [on_file(s, str(course)) for s in chosen]
    found = [six_watts(s, c, seeds=1 if c != SPREAD and s[1] in ONE_SEED else seeds) for s in chosen for c in COURSES]
    found += [six_watts(s, SIDES_COURSE, seeds=1, sides="apart") for s in chosen]
    return [*found, *(obstacle(s, h) for s in chosen for h in HEIGHTS)]
