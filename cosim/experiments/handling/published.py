"""The runs of the study."""

from __future__ import annotations

from typing import Any

from cosim.experiments.handling.runs import CARS, CONTROLLERS, MANOEUVRES, REDESIGNED, Case
from cosim.study.experiment import Task

SPEED = 60.0  # km/h
OTHER_SPEEDS = {"obstacle": 40.0, "straight": 30.0}  # km/h; straight, near the 6 W of the full car on its course
ANGLES = {"steady": 180.0, "step": 30.0, "sine": 45.0, "brake-in-turn": 45.0, "sine-with-dwell": 120.0, "j-turn": 120.0}
J_TURNS = (90.0, 150.0, 210.0, 270.0, 330.0)  # deg
COURSE = "1in"  # of comfort
ROUGH = ("step", "lane-change")  # manoeuvres that are driven on a random road too

CONTROLLED = "modified"  # the car whose suspension is controlled: that of paper 000
LANE_CHANGES = ("lane-change", "obstacle")
SHOWN = (*LANE_CHANGES, "step", "straight")  # manoeuvres with controllers
HYDRAULIC = ("lane-change", "straight")  # those with hydraulic actuators too


def at(car: str, manoeuvre: str, **more: Any) -> Case:
    """The run of a car in a manoeuvre; `more`: other fields of the case."""
    angle = {"wheel_deg": ANGLES[manoeuvre]} if manoeuvre in ANGLES else {}
    road = {"road": COURSE} if manoeuvre == "straight" else {}
    return Case(car, manoeuvre, OTHER_SPEEDS.get(manoeuvre, SPEED), **{**angle, **road, **more})


def rough(car: str, manoeuvre: str) -> Case:
    """The run of a car in a manoeuvre on a random road."""
    return at(car, manoeuvre, road="iso8608")


def controlled(controller: str, manoeuvre: str, actuators: str = "ideal", *, design: str = "car") -> Case:
    """The run of the controlled car; LQR and MPC are designed on it unless `design` says "paper"."""
    own = {"design": design} if controller in REDESIGNED else {}
    return at(CONTROLLED, manoeuvre, controller=controller, actuators=actuators, **own)


def j_turns(car: str) -> list[Case]:
    """Turns of rising steering wheel angle, up to where wheels lift."""
    return [Case(car, "j-turn", SPEED, angle) for angle in J_TURNS]


def plan() -> list[Task]:
    """Every run of the study."""
    shown = [at(c, m) for c in CARS for m in MANOEUVRES] + [rough(c, m) for c in CARS for m in ROUGH]
    shown += [controlled(c, m) for c in CONTROLLERS for m in SHOWN]
    shown += [controlled(c, m, "hydraulic") for c in CONTROLLERS for m in HYDRAULIC]
    return [Task(c, signals=True) for c in dict.fromkeys(shown)] + [Task(t) for c in CARS for t in j_turns(c)]
