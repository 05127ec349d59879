"""The runs of the study."""

from __future__ import annotations

from cosim.experiments.handling.runs import CARS, MANOEUVRES, Case
from cosim.study.experiment import Task

SPEED, SLOW = 60.0, 40.0  # km/h
ANGLES = {"steady": 180.0, "step": 30.0, "sine": 45.0, "brake-in-turn": 45.0, "sine-with-dwell": 120.0, "j-turn": 120.0}
J_TURNS = (90.0, 150.0, 210.0, 270.0, 330.0)  # deg


def at(car: str, manoeuvre: str, *, rough: bool = False) -> Case:
    """The run of a car in a manoeuvre."""
    angle = {"wheel_deg": ANGLES[manoeuvre]} if manoeuvre in ANGLES else {}
    return Case(car, manoeuvre, SLOW if manoeuvre == "obstacle" else SPEED, rough=rough, **angle)


def j_turns(car: str) -> list[Case]:
    """Turns of rising steering wheel angle, up to where wheels lift."""
    return [Case(car, "j-turn", SPEED, angle) for angle in J_TURNS]


def plan() -> list[Task]:
    """Every run of the study."""
    tasks = [Task(at(c, m), signals=True) for c in CARS for m in MANOEUVRES]
    return (
        tasks
        + [Task(at(c, "step", rough=True), signals=True) for c in CARS]
        + [Task(t) for c in CARS for t in j_turns(c)]
    )
