"""Checks of the study: general properties of any car, and published properties of the preview controllers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from cosim.experiments.ride.published import HEIGHTS, POWERS, System
from cosim.experiments.ride.results import CAR_NAMES, name, on, ran, speeds, system_of
from cosim.experiments.ride.runs import OBSTACLE
from cosim.experiments.ride.search import LIMITS, TOLERANCE, SpeedLimit
from cosim.study import ClaimList, Finding, Results, Row, RunFailed
from fmu_sources.roads.rms_course import COURSES

NRMM, DONAHUE = POWERS
PUMP_OFF: System = ("hmmwv", "passive", "hydraulic")
_RIDES_ON_TIRES = (
    "with its pump off its struts hardly move at such speeds, so it rides on its tires, which feel waves of less than a"
    " meter; the 1 inch course has more of those than the 2 inch course"
)

CLAIMS = ClaimList()


def _named(search: SpeedLimit) -> str:
    return _named_system(system_of(search))


def _named_system(system: System) -> str:
    return f"{CAR_NAMES[system[0]]}, {name(system)}"


def _more(texts: list[str]) -> str:
    return f"not of {'; '.join(texts[:3])}" + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")


def _extent(ratios: dict[str, float]) -> str:
    """Range of values in words, "0.91 to 0.97".

    RunFailed if no runs could be compared, which leaves a check open.
    """
    if not ratios:
        raise RunFailed("no runs of this study can be compared in this respect")
    return f"{min(ratios.values()):.2f} to {max(ratios.values()):.2f}"


@CLAIMS.check(
    "search",
    "Every speed that is reported has a run just below its limit and one just above",
    expected=f"runs on both sides within {100 * TOLERANCE:g} % of the speed",
)
def _search(study: Results) -> Finding:
    wrong, total = [], 0
    for search in ran(study):
        found: Row = study.found(search)
        for metric, by_seed in found["speeds"].items():
            for seed, v in enumerate(by_seed, start=1):
                if v is None:
                    continue
                total += 1
                near = [r for r in found["runs"] if r["seed"] == seed and abs(r["speed_kmh"] / v - 1) <= TOLERANCE]
                shares = [r[metric] / LIMITS[metric] if r["arrived"] else 2.0 for r in near]
                if not (shares and min(shares) < 1 <= max(shares)):
                    wrong.append(f"{_named(search)} at {v:g} km/h")
    return Finding(
        f"{total - len(wrong)} of {total} speeds", not wrong, _more(wrong), criterion="every speed of every search"
    )


def _slower(study: Results, metric: str, steps: Sequence[Mapping[str, Any]], criterion: str) -> Finding:
    """Whether the speed at a limit falls from step to step, for every car with every controller.

    The steps are given by values of cases.
    """
    wrong, systems = [], {system_of(s): s for s in on(study, **steps[0])}
    for system, search in systems.items():
        own = [speeds(study, s, metric).median for step in steps for s in on(study, **step) if system_of(s) == system]
        reached = [v for v in own if v is not None]
        if rises := [b / a - 1 for a, b in pairwise(reached) if b >= a]:
            small = max(rises) <= TOLERANCE
            wrong.append(
                _named(search) + f" (it rises by {100 * max(rises):.1f} %, no more than searches can differ)" * small
            )
    return Finding(f"{len(systems) - len(wrong)} of {len(systems)}", not wrong, _more(wrong), criterion=criterion)


@CLAIMS.check(
    "rougher-is-slower", "A rougher course is driven more slowly at 6 W", expected="of every car with every controller"
)
def _rougher(study: Results) -> Finding:
    courses = [{"course": c, "sides": "alike"} for c in COURSES]
    found = _slower(study, NRMM, courses, "median speed of 6 W (third order) falls from course to course")
    return (
        replace(found, reason=f"{found.reason}: {_RIDES_ON_TIRES}")
        if _named_system(PUMP_OFF) in found.reason
        else found
    )


@CLAIMS.check(
    "definitions",
    "6 W by the filter of third order is reached at a lower speed than 6 W by that of second order",
    expected="its power is 1.06 to 1.38 times as high from 1 to 8 Hz",
)
def _definitions(study: Results) -> Finding:
    ratios = {}
    for search in ran(study):
        if set(POWERS) <= set(search.metrics):
            third, second = (speeds(study, search, m).median for m in POWERS)
            if third is not None and second is not None:
                ratios[search.label] = third / second
    wrong = [n for n, r in ratios.items() if r >= 1]
    return Finding(
        f"{_extent(ratios)} of it",
        not wrong,
        _more(wrong),
        criterion="of every car with every controller on every course",
    )


@CLAIMS.check(
    "preview-is-faster",
    "The HMMWV under MPC reaches 6 W at a higher speed with preview than without",
    expected="on every course, with ideal and with hydraulic actuators",
)
def _preview(study: Results) -> Finding:
    ratios = {}
    for search in on(study, car="hmmwv", controller="mpc-preview"):
        if search.metrics != POWERS or search.case.course not in COURSES:
            continue
        blind = next((s for s in on(study, car="hmmwv", controller="mpc") if _same_course(s, search)), None)
        if blind is None:
            continue
        fast, slow = speeds(study, search, NRMM).median, speeds(study, blind, NRMM).median
        if fast is not None and slow is not None:
            ratios[search.label] = fast / slow
    wrong = [n for n, r in ratios.items() if r <= 1]
    return Finding(
        f"{_extent(ratios)} times as fast", not wrong, _more(wrong), criterion="median speed of 6 W (third order)"
    )


def _same_course(a: SpeedLimit, b: SpeedLimit) -> bool:
    x, y = a.case, b.case
    return (x.course, x.sides, x.actuators, a.metrics) == (y.course, y.sides, y.actuators, b.metrics)


@CLAIMS.check(
    "higher-is-slower",
    "A higher half-round is crossed more slowly at 2.5 g",
    expected="of every car with every controller",
)
def _higher(study: Results) -> Finding:
    heights = [{"course": OBSTACLE, "height": h} for h in HEIGHTS]
    return _slower(
        study, "seat_peak", heights, "speed of 2.5 g falls from height to height, of those at which it is reached"
    )
