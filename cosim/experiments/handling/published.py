"""The runs of the study."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from cosim.experiments.handling.runs import CARS, CONTROLLERS, MANOEUVRES, REDESIGNED, Case
from cosim.study.experiment import Task
from fmu_sources.roads.rms_course import SEEDS

SPEED = 60.0  # km/h
OTHER_SPEEDS = {"obstacle": 40.0, "straight": 30.0}  # km/h; straight, near the 6 W of the full car on its course
ANGLES = {"steady": 180.0, "step": 30.0, "sine": 45.0, "brake-in-turn": 45.0, "sine-with-dwell": 120.0, "j-turn": 120.0}
J_TURNS = (90.0, 150.0, 210.0, 270.0, 330.0)  # deg
CLOSE = 1.0  # deg, of the angle at which wheels lift
COURSE = "1in"  # of comfort
PROFILES = tuple(range(1, SEEDS + 1))  # its seeds
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


def controlled(controller: str, manoeuvre: str, actuators: str = "ideal", *, design: str = "car", **more: Any) -> Case:
    """The run of the controlled car; LQR and MPC are designed on it unless `design` says "paper"."""
    own = {"design": design} if controller in REDESIGNED else {}
    return at(CONTROLLED, manoeuvre, controller=controller, actuators=actuators, **own, **more)


def j_turns(car: str) -> list[Case]:
    """Turns of rising steering wheel angle, up to where wheels lift."""
    return [at(car, "j-turn", wheel_deg=angle) for angle in J_TURNS]


@dataclass(frozen=True)
class RolloverAngle:
    """Smallest angle of the steering wheel [deg], of a J-turn like `case`, at which all wheels of a side lift.

    The first of `J_TURNS` that lifts them and the one before are narrowed down by bisection to `CLOSE`. Finds None
    where none of them does: the tires slide before. A car that turns over has lifted its wheels.
    """

    case: Case
    cost: float = 10.0

    @property
    def label(self) -> str:
        """Which one it is."""
        return f"rollover-{self.case.label}"

    def __call__(self, runner: Any) -> float | None:
        """Search the angle."""

        def lifts(angle: float) -> bool:
            row = runner.metrics(replace(self.case, wheel_deg=angle))
            return bool(row.get("rollover", 1.0) >= 1.0)

        above = next(filter(lifts, J_TURNS), None)
        if above is None:
            return None
        below = max((a for a in J_TURNS if a < above), default=0.0)
        while above - below > CLOSE:
            middle = (below + above) / 2
            below, above = (below, middle) if lifts(middle) else (middle, above)
        return above


def rollover(car: str) -> RolloverAngle:
    """The rollover threshold of a car."""
    return RolloverAngle(at(car, "j-turn"))


def controlled_rollover(controller: str) -> RolloverAngle:
    """That of the controlled car."""
    return RolloverAngle(controlled(controller, "j-turn"))


def plan() -> list[Task | RolloverAngle]:
    """Every run of the study."""
    shown = [at(c, m) for c in CARS for m in MANOEUVRES] + [rough(c, m) for c in CARS for m in ROUGH]
    shown += [controlled(c, m) for c in CONTROLLERS for m in SHOWN]
    shown += [controlled(c, m, "hydraulic") for c in CONTROLLERS for m in HYDRAULIC]
    shown += [controlled(c, m, design="paper") for c in REDESIGNED for m in SHOWN]
    shown += [controlled(c, "straight", seed=seed) for c in CONTROLLERS for seed in PROFILES]
    searches = [rollover(c) for c in CARS] + [controlled_rollover(c) for c in CONTROLLERS]
    tasks = [Task(c, signals=True) for c in dict.fromkeys(shown)] + [Task(t) for c in CARS for t in j_turns(c)]
    return [*tasks, *dict.fromkeys(searches)]
