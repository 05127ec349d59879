"""Web page of a proving ground: a car under its controllers side by side, over synthetic courses or a measured one."""

from __future__ import annotations

from dataclasses import replace

from cosim.experiments.metrics.response import STANDARD_GRAVITY
from cosim.experiments.page_parts import largest_travel, speed_control
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
SPEEDS = 2.0, 120.0  # km/h, that the page offers


def live(case: Case) -> Live:
    """The car of the case under its controllers, over every course of the project or the file that the case names.

    Actuators, profile and height are those of the case.
    """
    car = CARS[case.car]
    controllers = tuple(dict.fromkeys((*SHOWN.get(case.car, car.controllers), case.controller)))
    plots = ["car.seat.az", f"car.suspension.{car.corners[0]}.deflection"]
    courses, over, controls = {case.course: ""}, "the measured course of a file", []
    if case.course in NUMBER:
        courses = {n: f"{n.removesuffix('in')} in rms" for n in COURSES} | {OBSTACLE: OBSTACLE}
        over = "synthetic courses with the roughness of measured ones, and over a half-round"
        controls = [Control("height of the half-round", ["road.half_round.height"], 0.02, 0.4)]
    if len(controllers) > 1:
        plots.append(f"controller.force.{car.corners[0]}")
    shown = "its controllers side by side" if len(controllers) > 1 else "without a controller"
    text = f"{CAR_NAMES[case.car]}: {shown}, over {over}. How fast until the driver has had enough?"
    seat = "acceleration of the driver's seat"
    page = WebPage(
        "Drive a proving ground",
        text[0].upper() + text[1:],
        controls=[speed_control("speed.start.speed", *SPEEDS), *controls],
        plots=plots,
        measures=[
            Measure(f"{seat}, rms", ["car.seat.az"], "rms", "m/s2"),
            Measure(f"{seat}, largest", ["car.seat.az"], "peak", "g", 1 / STANDARD_GRAVITY, LIMIT_G),
            Measure("acceleration of the CG, rms", ["car.body.az"], "rms", "m/s2"),
            largest_travel(car.corners),
        ],
        group_label="course",
    )
    return Live(page, [_system(case, c, course, words) for course, words in courses.items() for c in controllers])


def _system(case: Case, controller: str, course: str, group: str) -> LiveCase:
    """The case with another controller and course; what it says of another kind of course is left out."""
    made = passive(case) if controller == "passive" else replace(case, controller=controller)
    fields = {"seed": course in COURSES, "sides": course in COURSES, "height": course == OBSTACLE}
    made = replace(made, course=course, **{f: getattr(case if used else Case, f) for f, used in fields.items()})
    return LiveCase(name((made.car, controller, made.actuators)), made, group=group)
