"""How the checks of the study in `claims.toml` are judged.

General properties of any car, and published properties of the preview controllers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from cosim.experiments.ride.published import HEIGHTS, POWERS
from cosim.experiments.ride.results import Searches
from cosim.experiments.ride.runs import OBSTACLE
from cosim.experiments.ride.search import LIMITS, TOLERANCE
from cosim.study import ClaimList, Finding, RunFailed
from fmu_sources.roads.rms_course import COURSES

NRMM, DONAHUE = POWERS
_PUMP_OFF = ("hmmwv", "passive", "hydraulic")
_RIDES_ON_TIRES = (
    "with its pump off its struts hardly move at such speeds, so it rides on its tires, which feel waves of less than a"
    " meter; the 1 inch course has more of those than the 2 inch course"
)


def _more(texts: list[str]) -> str:
    return f"not of {'; '.join(texts[:3])}" + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")


def _compared(speeds: Iterable[tuple[str, float | None, float | None]], words: str, *, above: bool) -> Finding:
    """A finding on ratios of two speeds by name, all of which have to be above 1, or below.

    Without any, RunFailed leaves a check open.
    """
    ratios = {name: own / other for name, own, other in speeds if own is not None and other is not None}
    if not ratios:
        raise RunFailed("no runs of this study can be compared in this respect")
    wrong = [n for n, r in ratios.items() if not (r > 1 if above else r < 1)]
    extent = f"{min(ratios.values()):.2f} to {max(ratios.values()):.2f}"
    return Finding(f"{extent} {words}", not wrong, _more(wrong))


def search(study: Searches) -> Finding:
    """Whether each speed that a search found has runs on both sides of its limit."""
    wrong, total = [], 0
    for made in study.every.values():
        for metric, by_seed in made.found["speeds"].items():
            for seed, v in enumerate(by_seed, start=1):
                if v is None:
                    continue
                total += 1
                rows = (r for r in made.found["runs"] if r["seed"] == seed and abs(r["speed_kmh"] / v - 1) <= TOLERANCE)
                shares = [r[metric] / LIMITS[metric] if r["arrived"] else 2.0 for r in rows]
                if not (shares and min(shares) < 1 <= max(shares)):
                    wrong.append(f"{made.words} at {v:g} km/h")
    return Finding(f"{total - len(wrong)} of {total} speeds", not wrong, _more(wrong))


def slower(study: Searches, *, metric: str, over: str) -> Finding:
    """Whether the speed at a limit falls over "courses" or "heights", for every car with every controller."""
    every: Mapping[str, list[Mapping[str, Any]]] = {
        "courses": [{"course": c, "sides": "alike"} for c in COURSES],
        "heights": [{"course": OBSTACLE, "height": h} for h in HEIGHTS],
    }
    wrong, first = {}, study.on(**every[over][0])
    for made in first:
        own = [d.speeds(metric).median for at in every[over] for d in study.on(system=made.case.system, **at)]
        if rises := [b / a - 1 for a, b in pairwise(v for v in own if v is not None) if b >= a]:
            small = f" (it rises by {100 * max(rises):.1f} %, no more than searches can differ)"
            wrong[made.case.system] = made.words + small * (max(rises) <= TOLERANCE)
    why = f": {_RIDES_ON_TIRES}" if over == "courses" and _PUMP_OFF in wrong else ""
    return Finding(f"{len(first) - len(wrong)} of {len(first)}", not wrong, _more([*wrong.values()]) + why)


def definitions(study: Searches) -> Finding:
    """Whether both definitions of 6 W are reached in their order."""
    both = [d for d in study.every.values() if set(POWERS) <= set(d.search.metrics)]
    speeds = ((d.search.label, d.speeds(NRMM).median, d.speeds(DONAHUE).median) for d in both)
    return _compared(speeds, "of it", above=False)


def preview(study: Searches) -> Finding:
    """Whether preview raises the speed of 6 W of the HMMWV under MPC, course by course."""
    pairs = [
        (made, blind)
        for made in study.on(car="hmmwv", controller="mpc-preview")
        if made.case.course in COURSES and (blind := study.every.get(replace(made.case, controller="mpc")))
    ]
    speeds = ((made.search.label, made.speeds(NRMM).median, blind.speeds(NRMM).median) for made, blind in pairs)
    return _compared(speeds, "times as fast", above=True)


JUDGES = {f.__name__: f for f in (search, slower, definitions, preview)}
CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), JUDGES, Searches)
