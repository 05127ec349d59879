"""Made-up studies of paper 000: one in which everything is as published, and changes to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import made_up

from cosim.experiments.gpc import EXPERIMENT
from cosim.experiments.gpc.published import MATCHED, SPEEDS_KMH, Comparison
from cosim.experiments.gpc.results import Results
from cosim.experiments.gpc.runs import Case
from cosim.study import Results as Runs
from cosim.study import Row
from cosim.study.case import values
from fmu_sources.controllers.gpc.component import FORCE_LIMIT


def paper_runs() -> Runs:
    """Every statement of the paper holds, in every seed, with the published figures."""
    return made_up.study(EXPERIMENT, metrics, found=found)


def paper_study() -> Results:
    """Numbers of these runs, whose rows can be changed."""
    return Results(paper_runs())


def metrics(case: Case) -> Row:
    """Of a run that is no part of a comparison: preview on the sine road shows the effect of its weight."""
    return _swept(case) if (case.road, case.controller) == ("sine", "preview") else _run(case)


def found(search: Any) -> Any:
    """Rows of a comparison, all controllers at R = 1e-7; no history."""
    if not isinstance(search, Comparison):
        return []
    explicit, *others = ({**values(c), **_run(c)} for c in map(search.case, ("explicit", *MATCHED)))
    matched = [{**row, "matched": True, "runs": 3} for row in others]
    return {"compared": [explicit, *matched], "unmatched": others}


def change(rows: list[Row], by: Callable[[Row], dict[str, Any] | None]) -> int:
    """Update rows with what `by` returns for them; how many it changed."""
    changes = [(row, new) for row in rows if (new := by(row)) is not None]
    for row, new in changes:
        row.update(new)
    return len(changes)


def passive_response(road: str, speed: float) -> float:
    """Highest at 50 km/h on the sine road, at 40 km/h elsewhere."""
    return 4.0 - abs(speed - (50.0 if road == "sine" else 40.0)) / 20


def _improvement(road: str, speed: float) -> float:
    if road == "curb":
        return 0.14 if speed == max(SPEEDS_KMH) else 0.10
    return 0.60 if road == "sine" else 0.30


def _run(s: Case) -> Row:
    passive = passive_response(s.road, s.speed_kmh)
    m = {
        "diverged": False,
        "response": passive,
        "force": 0.0,
        "power": 0.0,
        "peak_force": 0.0,
        "rms_az": 1.0,
        "rms_pitch": 1.0,
        "rms_roll": 0.0 if s.road == "sine" else 0.5,
        "peak_pitch": 3.0,
    }
    if s.controller != "passive":
        m |= {"response": passive * (1 - _improvement(s.road, s.speed_kmh)), **_effort(s), **_signals(s)}
    return m


def _effort(s: Case) -> dict[str, float]:
    if s.road == "curb":
        force, power, peak = {"implicit": (500, 150, 7e3), "explicit": (1000, 300, 9e3), "preview": (400, 100, 4e3)}[
            s.controller
        ]
    elif s.controller == "implicit":
        force, power, peak = 1.6 * 5000, 1.9 * 2000, 9e3
    else:
        force, power, peak = 5000, 2000, 8e3
    return {"force": float(force), "power": float(power), "peak_force": peak}


def _signals(s: Case) -> dict[str, float]:
    if s.road == "sine":
        az, pitch = (0.9, 0.46) if s.controller == "implicit" else (0.8, 0.5)
        return {"rms_az": az, "rms_pitch": pitch, "rms_roll": 0.1 * pitch}
    return {"rms_az": 1.05, "rms_roll": 0.525, "peak_pitch": 2.0}


def _swept(case: Case) -> Row:
    """Force in proportion to the improvement, power to its square; at the limit with the smallest weight."""
    gain = {1e-7: 0.5, 5e-7: 0.25, 1e-6: 0.15, 5e-6: 0.03}[case.R]
    return _run(case) | {
        "response": passive_response("sine", case.speed_kmh) * (1 - gain),
        "force": 1e4 * gain,
        "power": 1e4 * gain**2,
        "peak_force": FORCE_LIMIT * (1.0 if case.R == 1e-7 else gain),
    }
