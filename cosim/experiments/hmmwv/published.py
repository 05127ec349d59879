"""What paper 001 shows of the vehicle: the runs behind its figures and statements, and what stands beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from cosim.experiments.hmmwv.runs import CONTROLLERS, PREVIEW_STEPS, ROADS, Case, over_variants
from cosim.experiments.steps import halved
from cosim.study.experiment import Task

WITHOUT_PREVIEW = ("zero", "skyhook", "lqr")  # the published controllers that know no road, apart from MPC
PUBLISHED = ("passive", *WITHOUT_PREVIEW, "mpc", "mpc-preview")
ESTIMATED = ("lqr", "mpc", "mpc-preview")
ACTIVE = tuple(c for c in CONTROLLERS if c != "passive")
PUMPS_L_MIN = {"track": (60.0, 75.0, 90.0, 120.0), "bump": (60.0, 120.0), "off-road": (120.0, 180.0, 240.0)}
"""Larger pumps than the paper's that are tried, to each actuator, by road."""
PUMPED = {"track": ("skyhook", "lqr", "mpc"), "bump": ("mpc", "mpc-preview"), "off-road": ("mpc",)}
"""Controllers for which they are tried."""
REFINED_APART = ("passive", "lqr", "mpc", "mpc-preview")  # over bumps also with one of the two steps finer, not both
NULL_OPENINGS_MM = (4.0, 5.0, 6.75)  # what is plausible for an unpowered spool
LENGTHS = (1, 2, 3, 4, 6, 8, 11, PREVIEW_STEPS)  # steps of preview; MPC has 0
ERRORS_MS = (-40, -30, -20, -10, -5, 0, 5, 10, 20, 30, 40)
OFF_ROAD_S = 20.0  # duration of a run off road, 18 s of them after the ramp
VARIANTS = {"track": "places of the bumps", "bump": "places of the bump", "off-road": "stretches"}  # what varies
SIDE_VARIANTS = 2  # places of the bump, or stretches, for what is beside the published runs


@dataclass(frozen=True)
class Condition:
    """Flow of the pump: unlimited, or at most `pump_l_min` [l/min] to each actuator (None: as in the FMU)."""

    limited: bool = False
    pump_l_min: float | None = None
    shared: bool = False  # one pump for all four alike

    def __call__(self, case: Case) -> Case:
        """The case under this condition; the passive car has its pump off."""
        if not self.limited or case.controller == "passive":
            return case
        return replace(case, flow_limit=True, pump_l_min=self.pump_l_min, shared_pump=self.shared)

    def l_min(self, study: Any) -> float:
        """Flow to each actuator at most [l/min]; `study.pump_l_min` is the pump in the actuator's FMU."""
        if not self.limited:
            return math.inf
        flow: float = study.pump_l_min if self.pump_l_min is None else self.pump_l_min
        return flow / 4 if self.shared else flow

    def words(self, study: Any) -> str:
        """Condition as a claim names it."""
        if not self.limited:
            return "pump without limit"
        flow = self.l_min(study)
        return "the pump's limit at each actuator" if math.isnan(flow) else f"{flow:g} l/min at each actuator"


WITHOUT_LIMIT, PUMP, SHARED = Condition(), Condition(limited=True), Condition(limited=True, shared=True)
CONDITIONS = (WITHOUT_LIMIT, PUMP)
"""The paper's pump (Table 1.4) delivers 45 l/min, and the paper names no accumulator. So every statement on a
controlled car is judged under two conditions: with a pump that holds its pressure at any flow, and with no more than
its flow to each actuator. The latter is the most generous reading of one pump for four actuators, which may take four
times its flow together (180 l/min), still without an accumulator. Neither is the paper's vehicle.
"""


def estimated(controller: str, road: str, *, sensed: bool = False) -> Case:
    """A controller on the states of the Kalman filter; `sensed`: with the preview of the range sensors."""
    return Case(road, controller, states="estimated", preview="sensed" if sensed else "generated")


@cache
def finer(case: Case) -> Case:
    """The case with half the communication step of car and actuators and half the steps of their solvers."""
    return replace(case, exchange_parts=2, solver_parts=2)


@cache
def places(case: Case) -> tuple[Case, ...]:
    """The runs that a case stands for: places of the bump on the controllers' grid, or stretches off road."""
    if case.road == "off-road" and case.duration is None:
        case = replace(case, duration=OFF_ROAD_S)
    if (case.exchange_parts > 1) != (case.solver_parts > 1):  # which of the two matters, apart from what claims rest on
        return tuple(over_variants(case, 1))
    beside = case.friction or not case.lift_off or case.shared_pump
    return tuple(over_variants(case, SIDE_VARIANTS if beside else None))


def averaged_cases() -> list[Case]:
    """What the study measures, each over all its places."""
    cases = published_cases()
    cases += [Case(road, c, actuators="ideal") for road in ROADS for c in ACTIVE]
    cases += [estimated(c, road) for road in ROADS for c in ESTIMATED]
    cases += [estimated("mpc-preview", road, sensed=True) for road in ROADS]
    cases += [replace(estimated(c, "bump"), lift_off=False) for c in ("mpc", "mpc-preview")]
    cases += [SHARED(Case(road, c)) for road in ROADS for c in PUBLISHED if c != "passive"]
    cases += [
        Condition(limited=True, pump_l_min=pump)(Case(road, c))
        for road in ROADS
        for c in PUMPED[road]
        for pump in PUMPS_L_MIN[road]
    ]
    cases += [finer(case) for case in published_cases()]
    cases += [case for road in ("track", "bump") for c in REFINED_APART for case in halved(Case(road, c)).values()]
    cases += [Case("bump", "mpc-preview", preview_steps=n) for n in LENGTHS]
    cases += [Case("bump", "mpc-preview", preview_error_ms=float(ms)) for ms in ERRORS_MS]
    for road in ("track", "bump"):
        cases += [Case(road, "passive", null_opening_mm=mm) for mm in NULL_OPENINGS_MM]
        cases += [Case(road, c, lift_off=False) for c in PUBLISHED]
        cases += [Case(road, c, friction=True) for c in PUBLISHED]
    return list(dict.fromkeys(cases))


def published_cases() -> list[Case]:
    """Runs behind the claims on the whole vehicle: every controller on every road, with and without pump limit."""
    cases = [Case(road, c) for road in ROADS for c in CONTROLLERS]
    return cases + [PUMP(Case(road, c)) for road in ROADS for c in ACTIVE]


def plan() -> list[Task]:
    """Every run of the vehicle."""
    drawn = [Case(road, c) for road in ROADS for c in PUBLISHED] + [Case("off-road", "lqr-kilonewton")]
    first = {places(case)[0] for case in drawn}  # whose signals are kept
    runs = dict.fromkeys(run for case in averaged_cases() for run in places(case))
    return [Task(run, signals=run in first, cost=_cost(run)) for run in runs]


def _cost(case: Case) -> float:
    """Rough time of a run, in seconds of the simplest one."""
    work = 1.5 if case.exchange_parts > 1 or case.solver_parts > 1 else 1.0
    work *= 0.4 if case.actuators == "ideal" else 1.6 if case.states == "estimated" else 1.0
    return work * (case.duration or 4.0)
