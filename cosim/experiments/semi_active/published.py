"""The runs of the study."""

from __future__ import annotations

from dataclasses import replace

from cosim.experiments.semi_active.runs import CONTROLLERS, IDEAL, STRETCHES, TUNED, Case
from cosim.experiments.steps import halved
from cosim.study.experiment import Task

SYSTEMS = {**{c: Case(c) for c in CONTROLLERS}, **{f"{c}, ideal": Case(c, "ideal") for c in IDEAL}}
"""Passive and semi-active cars, and active ones with ideal actuators."""
NAMES = {
    "passive": "passive",
    "skyhook": "skyhook",
    "skyhook-on-off": "skyhook, on-off",
    "groundhook": "groundhook",
    "groundhook-on-off": "groundhook, on-off",
    "add": "ADD",
    "sh-add": "SH-ADD",
    "lqr": "clipped LQR",
    "mpc": "MPC",
    "skyhook, ideal": "skyhook, active",
    "lqr, ideal": "LQR, active",
    "mpc, ideal": "MPC, active",
}
"""What the systems are called."""
TUNINGS = tuple(i / 8 for i in range(9))
FAMILIES = {
    "passive": ["passive"],
    "semi-active": [c for c in CONTROLLERS if c != "passive"],
    "active": [f"{c}, ideal" for c in IDEAL],
}
"""Kinds of suspension -> their systems."""
FRONTS = {n: c for n, c in SYSTEMS.items() if c.controller in TUNED}
REFINED = "sh-add"  # whose runs are repeated with finer steps


def at(system: str, road: str = "random", stretch: int = 0) -> Case:
    """The run of one of `SYSTEMS` on a road."""
    return replace(SYSTEMS[system], road=road, stretch=stretch)


def front(system: str) -> list[Case]:
    """Runs from comfort to road holding."""
    return [replace(at(system), road_holding=t) for t in TUNINGS]


def family(kind: str) -> list[Case]:
    """All runs of a kind of suspension on the first stretch of the random road."""
    systems = FAMILIES[kind]
    return [at(s) for s in systems] + [case for s in systems if s in FRONTS for case in front(s)]


def without_hysteresis(system: str) -> Case:
    """The run on the random road whose dampers have no hysteresis."""
    return replace(at(system), hysteresis=False)


def plan() -> list[Task]:
    """Every run of the study."""
    tasks = [
        Task(at(s, road), signals=True, cost=6.0 if road == "rig" else 2.0)
        for s in SYSTEMS
        for road in ("rig", "random")
    ]
    cases = [at(s, "bump") for s in SYSTEMS]
    cases += [at(s, stretch=i) for s in SYSTEMS for i in range(1, STRETCHES)]
    cases += [case for s in FRONTS for case in front(s)]
    cases += [
        without_hysteresis(s) for s, c in SYSTEMS.items() if c.controller != "passive" and c.actuators == "dampers"
    ]
    cases += halved(at(REFINED)).values()
    return tasks + [Task(c) for c in cases]
