"""How the checks of the study in `claims.toml` are judged.

General properties of any car, and published properties of the preview controllers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
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


def search(study: Results) -> Finding:
    """Whether each speed that a search found has runs on both sides of its limit."""
    wrong, total = [], 0
    for made in ran(study):
        found: Row = study.found(made)
        for metric, by_seed in found["speeds"].items():
            for seed, v in enumerate(by_seed, start=1):
                if v is None:
                    continue
                total += 1
                near = [r for r in found["runs"] if r["seed"] == seed and abs(r["speed_kmh"] / v - 1) <= TOLERANCE]
                shares = [r[metric] / LIMITS[metric] if r["arrived"] else 2.0 for r in near]
                if not (shares and min(shares) < 1 <= max(shares)):
                    wrong.append(f"{_named(made)} at {v:g} km/h")
    return Finding(f"{total - len(wrong)} of {total} speeds", not wrong, _more(wrong))


def slower(study: Results, *, metric: str, over: str) -> Finding:
    """Whether the speed at a limit falls over "courses" or "heights", for every car with every controller."""
    every: Mapping[str, list[Mapping[str, Any]]] = {
        "courses": [{"course": c, "sides": "alike"} for c in COURSES],
        "heights": [{"course": OBSTACLE, "height": h} for h in HEIGHTS],
    }
    steps = every[over]
    wrong, systems = [], {system_of(s): s for s in on(study, **steps[0])}
    for system, search in systems.items():
        own = [speeds(study, s, metric).median for step in steps for s in on(study, **step) if system_of(s) == system]
        reached = [v for v in own if v is not None]
        if rises := [b / a - 1 for a, b in pairwise(reached) if b >= a]:
            small = max(rises) <= TOLERANCE
            wrong.append(
                _named(search) + f" (it rises by {100 * max(rises):.1f} %, no more than searches can differ)" * small
            )
    why = f": {_RIDES_ON_TIRES}" if over == "courses" and _named_system(PUMP_OFF) in _more(wrong) else ""
    return Finding(f"{len(systems) - len(wrong)} of {len(systems)}", not wrong, _more(wrong) + why)


def definitions(study: Results) -> Finding:
    """Whether both definitions of 6 W are reached in their order."""
    ratios = {}
    for made in ran(study):
        if set(POWERS) <= set(made.metrics):
            third, second = (speeds(study, made, m).median for m in POWERS)
            if third is not None and second is not None:
                ratios[made.label] = third / second
    wrong = [n for n, r in ratios.items() if r >= 1]
    return Finding(f"{_extent(ratios)} of it", not wrong, _more(wrong))


def preview(study: Results) -> Finding:
    """Whether preview raises the speed of 6 W of the HMMWV under MPC, course by course."""
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
    return Finding(f"{_extent(ratios)} times as fast", not wrong, _more(wrong))


def _same_course(a: SpeedLimit, b: SpeedLimit) -> bool:
    x, y = a.case, b.case
    return (x.course, x.sides, x.actuators, a.metrics) == (y.course, y.sides, y.actuators, b.metrics)


JUDGES: dict[str, Callable[..., Finding]] = {
    "search": search,
    "slower": slower,
    "definitions": definitions,
    "preview": preview,
}
CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), JUDGES)
