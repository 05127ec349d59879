"""Web page: a full car to drive with keys or a gamepad, between the cones of the lane changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import ceil, radians

import numpy as np

from cosim.experiments.handling.runs import MANOEUVRES, METRICS, NAMES, PEDALS, WHEEL, Case, Manoeuvre
from cosim.experiments.page_parts import shown_as
from cosim.export.web.page import Control, Drive, WebPage
from cosim.scenes.scene import Cone, Reading, Scene, Value
from cosim.study.web import Live, LiveCase
from fmu_sources.models.corners import CORNERS

COURSES = {"lane-change": "double lane change (as ISO 3888-1)", "obstacle": "obstacle avoidance (as ISO 3888-2)"}
SPACING = 5.0  # m between the cones of a lane, at most
LARGEST = radians(240.0)  # of the steering wheel
KEYED, RETURN = radians(300.0), radians(500.0)  # per second: a key, and a hand that lets go or holds a stick
PRESS, LIFT = 2.0, 5.0  # of a pedal, per second
SLOWEST, FASTEST = 10.0, 120.0  # km/h, that the page offers
_AXES = {"yaw_rate_peak": "body.yaw_rate", "ay_peak": "body.ay", "roll_peak": "body.roll"}
"""Metric -> output of the car whose peak it is."""


def cones(manoeuvre: Manoeuvre, width: float) -> list[Cone]:
    """Cones along both sides of the lanes for a car of this width [m]; the base of each touches its lane."""
    found = []
    for (first, last, middle), (part, more) in zip(manoeuvre.lanes, manoeuvre.widths, strict=True):
        half = (part * width + more) / 2 + Cone.radius
        for x in np.linspace(first, last, ceil((last - first) / SPACING) + 1).tolist():
            found += [Cone(x, middle + side * half) for side in (1, -1)]
    return found


def live(case: Case) -> Live:
    """The car of the case on level ground, on each course, under a person; at the start as fast as the case says."""
    level = {n: getattr(Case, n) for n in ("road", "terrain", "seed")}
    base = replace(case, manoeuvre="lane-change", wheel_deg=Case.wheel_deg, driven=True, **level)
    cases = [
        LiveCase(NAMES[base.car], replace(base, manoeuvre=m), group=words, staged=_staged(MANOEUVRES[m]))
        for m, words in COURSES.items()
    ]
    page = WebPage(
        "Drive a full car between cones",
        "A nonlinear full car, with steering wheel, throttle and brake, is yours: drive it through the lane changes of"
        " the study of handling, and beyond. Cones that you hit fall, and are counted. Everything is computed here,"
        " live.",
        controls=[
            Control(
                "steering wheel",
                ["car.steering.wheel"],
                -LARGEST,
                LARGEST,
                drive=Drive(KEYED, RETURN, raised_by=("ArrowLeft", "a"), lowered_by=("ArrowRight", "d"), axis=(0, -1)),
            ),
            Control("throttle", ["car.throttle"], drive=Drive(PRESS, LIFT, raised_by=("ArrowUp", "w"), button=7)),
            Control("brake", ["car.brake"], drive=Drive(PRESS, LIFT, raised_by=("ArrowDown", "s"), button=6)),
            Control("speed is kept by", ["car.driver.mode"], choices={"your pedals": PEDALS, "the car": WHEEL}),
            Control("speed at the start", ["car.target.speed"], SLOWEST / 3.6, FASTEST / 3.6),
        ],
        plots=["car.steering.wheel", "car.body.ay", "car.body.yaw_rate"],
        measures=[shown_as(METRICS[k], [f"car.{n}"]) for k, n in _AXES.items()],
        group_label="course",
    )
    return Live(page, cases)


def _staged(manoeuvre: Manoeuvre) -> Callable[[Scene], Scene]:
    """Cones and instruments for the scene of a car."""
    sides = {k: -1.0 if k.endswith("l") else 1.0 for k in CORNERS}
    transfer = Value({f"car.tire.{k}.force": side for k, side in sides.items()})
    load = Value(dict.fromkeys(transfer.terms, 1.0))

    def instrument(key: str, label: str, quantity: Value | str, **more: object) -> Reading:
        metric = METRICS[key]
        return Reading(label, metric.unit.removeprefix("-"), quantity, 2, metric.factor, **more)  # type: ignore[arg-type]

    readings = [
        Reading("steering wheel", "deg", "car.steering.wheel", 0, METRICS["roll_peak"].factor),
        instrument("ay_peak", "lateral acceleration", "car.body.ay"),
        instrument("yaw_rate_peak", "yaw rate", "car.body.yaw_rate"),
        instrument("roll_peak", "roll", "car.body.roll"),
        instrument("rollover", "rollover index", transfer, per=load),
        instrument("rollover", METRICS["rollover"].text, transfer, per=load, largest=True),
    ]

    def stage(scene: Scene) -> Scene:
        speed = [r for r in scene.readings if r.label == "speed"]
        return replace(scene, cones=cones(manoeuvre, 2 * scene.footprint[2]), readings=[*speed, *readings])

    return stage
