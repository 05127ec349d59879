"""The runs of paper 002: figures 6 to 10, and what stands beside them."""

from __future__ import annotations

from dataclasses import replace

from cosim.experiments.bench.runs import CONTROLLERS, Case
from cosim.experiments.steps import halved
from cosim.study.experiment import Task

BUMP_DURATIONS = (0.5, 0.2)  # s
LONG, SHORT = (f"bump {d:g} s" for d in BUMP_DURATIONS)
RANDOM = "random"
SCENARIOS = {n: Case("passive", "bump", d) for n, d in zip((LONG, SHORT), BUMP_DURATIONS, strict=True)} | {
    RANDOM: Case("passive", "random")
}
HEIGHTS_MM = (10.0, 20.0, 30.0, 40.0, 50.0)  # bumps over which the limit comes into play
LIMITED = ("lqr-clipped", "mpc", "mpc-moves")  # controllers that are compared there
STRETCHES = tuple(10.0 * i for i in range(8))  # s, where the runs over the random road start in its motion
JUDGED = ("passive", "mpc")  # controllers that are judged on the random road
CONTROLLED = tuple(c for c in CONTROLLERS if c != "passive")


def at(scenario: str, controller: str, *, encoders: bool = False) -> Case:
    """The run of a controller in one of `SCENARIOS`."""
    return replace(SCENARIOS[scenario], controller=controller, encoders=encoders)


def over_height(duration: float, controller: str) -> list[Case]:
    """Runs over bumps of `HEIGHTS_MM`."""
    return [Case(controller, "bump", duration, height_mm=h) for h in HEIGHTS_MM]


def over_stretches(controller: str) -> list[Case]:
    """Runs over the `STRETCHES` of the random road."""
    return [replace(at(RANDOM, controller), offset=s) for s in STRETCHES]


def plan() -> list[Task]:
    """Every run of the study."""
    tasks = [Task(at(s, c), signals=True) for s in SCENARIOS for c in CONTROLLERS]
    cases = [at(s, c, encoders=True) for s in SCENARIOS for c in CONTROLLED]
    cases += [case for d in BUMP_DURATIONS for c in LIMITED for case in over_height(d, c)]
    cases += [case for c in JUDGED for case in over_stretches(c)]
    cases += [case for c in CONTROLLERS for case in halved(at(SHORT, c)).values()]
    known = {t.case for t in tasks}
    return tasks + [Task(c) for c in cases if c not in known]
