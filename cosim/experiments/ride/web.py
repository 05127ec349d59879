"""Web page of a proving ground: a car under its controllers side by side, over synthetic courses or a measured one."""

from __future__ import annotations

from dataclasses import replace

from cosim.experiments.metrics.response import STANDARD_GRAVITY
from cosim.experiments.ride.results import CAR_NAMES, name
from cosim.experiments.ride.runs import CARS, LIMIT_G, NUMBER, OBSTACLE, Case, passive
from cosim.export.web.page import Control, Measure, WebPage
from cosim.study.web import Live, LiveCase
from fmu_sources.roads.rms_course import COURSES

SHOWN = {
    "hmmwv": ("passive", "lqr", "mpc", "mpc-preview"),
    "hmmwv-dampers": ("passive", "skyhook", "sh-add", "mpc"),
    "sedan": ("passive", "comfort-active", "comfort-delay", "comfort-preview"),
}
"""Controllers that are side by side, where a car has more than fit on a page."""
SLOWEST, FASTEST = 2.0, 120.0  # km/h, that the page offers


def live(case: Case) -> Live:
    """The car of the case under its controllers, over every course of the project or the file that the case names.

    Actuators, profile and height are those of the case.
    """
    car = CARS[case.car]
    controllers = tuple(dict.fromkeys((*SHOWN.get(case.car, car.controllers), case.controller)))
    courses = (
        {n: f"{n.removesuffix('in')} in rms" for n in COURSES} | {OBSTACLE: OBSTACLE}
        if case.course in NUMBER
        else {case.course: ""}
    )
    cases = [
        _system(case, controller, course, words) for course, words in courses.items() for controller in controllers
    ]
    page = WebPage(
        "Drive a proving ground",
        f"{CAR_NAMES[case.car][0].upper()}{CAR_NAMES[case.car][1:]}:"
        f" {'its controllers side by side' if len(controllers) > 1 else 'without a controller'}, over {_courses(case)}."
        " How fast until the driver has had enough?",
        controls=[
            Control("speed", ["speed.start.speed"], SLOWEST / 3.6, FASTEST / 3.6, keys=("ArrowDown", "ArrowUp")),
            *(
                [Control("height of the half-round", ["road.half_round.height"], 0.02, 0.4)]
                if case.course in NUMBER
                else []
            ),
        ],
        plots=[
            "car.seat.az",
            f"car.suspension.{car.corners[0]}.deflection",
            *([f"controller.force.{car.corners[0]}"] if len(controllers) > 1 else []),
        ],
        measures=[
            Measure("acceleration of the driver's seat, rms", ["car.seat.az"], "rms", "m/s2"),
            Measure(
                "acceleration of the driver's seat, largest",
                ["car.seat.az"],
                "peak",
                "g",
                1 / STANDARD_GRAVITY,
                LIMIT_G,
            ),
            Measure("acceleration of the CG, rms", ["car.body.az"], "rms", "m/s2"),
            Measure(
                "suspension travel, largest",
                [f"car.suspension.{k}.deflection" for k in car.corners],
                "peak",
                "mm",
                1e3,
                decimals=0,
            ),
        ],
        group_label="course",
    )
    return Live(page, cases)


def _system(case: Case, controller: str, course: str, group: str) -> LiveCase:
    """The case with another controller and course; what it says of another kind of course is left out."""
    made = passive(case) if controller == "passive" else replace(case, controller=controller)
    fields = {"seed": course in COURSES, "sides": course in COURSES, "height": course == OBSTACLE}
    made = replace(made, course=course, **{f: getattr(case if used else Case, f) for f, used in fields.items()})
    return LiveCase(name((made.car, controller, made.actuators)), made, group=group)


def _courses(case: Case) -> str:
    if case.course in NUMBER:
        return "synthetic courses with the roughness of measured ones, and over a half-round"
    return "the measured course of a file"
