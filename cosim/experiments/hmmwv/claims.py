"""Claims of paper 001 on the vehicle, judged by the runs; those on force tracking and preview are in their folders.

`statements` judges what the paper says, this file the additional checks; sentences and bounds are in `claims.toml`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from cosim.experiments.hmmwv.averages import Averages
from cosim.experiments.hmmwv.preview.claims import CLAIMS as PREVIEW_CLAIMS
from cosim.experiments.hmmwv.published import CONDITIONS, PUMP, estimated
from cosim.experiments.hmmwv.refinement import largest_change, refinements
from cosim.experiments.hmmwv.runs import PREDICTIVE, ROADS, TRAVEL_LIMIT, Case
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES, finding, parts, statement
from cosim.experiments.hmmwv.tracking.claims import CLAIMS as TRACKING_CLAIMS
from cosim.study import Band, ClaimList, Distribution, Finding


def _less(percent: float) -> bool:
    return percent > 0


def kilonewton(study: Averages) -> Finding:
    """Whether MPC absorbs less than the LQR with its weights in kN on every stretch; the value is the median [%]."""
    mpc, lqr = Case("off-road", "mpc"), Case("off-road", "lqr-kilonewton")
    ahead = study.gain(mpc, [lqr])
    words: dict[str, Any] = {"limit": 1e3 * TRAVEL_LIMIT, "pump": PUMP.words(study)}
    words["saved"] = ahead.text("{:.1f}", "%", _less)
    for name, case in (("mpc", mpc), ("lqr", lqr)):
        words |= {name: study.power(case), f"{name}_limited": study.power(PUMP(case))}
        words[f"{name}_travel"] = 1e3 * study.largest("travel_peak", case)
        words[f"{name}_beyond"] = 100 * study.mean("travel_over", case)
    return Finding(holds=ahead.everywhere(_less), value=ahead.median, unit="%", words=words)


def travel_limit(study: Averages) -> Finding:
    """Whether no corner goes beyond the limit of travel under MPC; the value is the largest travel [mm]."""
    found = study.distribution("travel_peak", Case("off-road", "mpc"))
    peaks = Distribution((1e3 * p for p in found.values), of=found.of)
    words: dict[str, Any] = {"peaks": peaks.text("{:.0f}", "mm", lambda x: x <= 1e3 * TRAVEL_LIMIT)}
    words |= {c: 100 * study.mean("travel_over", Case("off-road", c)) for c in ("mpc", "skyhook", "lqr")}
    return Finding(holds=found.high <= TRAVEL_LIMIT, value=1e3 * found.high, unit="mm", words=words)


def estimates(study: Averages, *, controller: str, most: float) -> Finding:
    """Whether estimated states cost a controller at most so much [%] on every road; the value is the worst."""
    costs = {r: study.ratio(estimated(controller, r), Case(r, controller)).median for r in ROADS}
    worst = max(costs, key=costs.__getitem__)
    tension = Case("bump", controller, lift_off=False)
    linear = study.power(replace(tension, states="estimated")) / study.power(tension)
    return Finding(
        ", ".join(f"{ROAD_NAMES[r]} {round(100 * (c - 1)):+d} %" for r, c in costs.items()),
        100 * (costs[worst] - 1) <= most,
        value=100 * (costs[worst] - 1),
        unit="%",
        words={"worst": ROAD_NAMES[worst], "linear": 100 * (linear - 1)},
    )


def sensed_preview(study: Averages) -> Finding:
    """Whether sensed preview saves at least as much as counts as published, on every road; the value is the least."""
    saved = {r: study.gain(estimated("mpc-preview", r, sensed=True), [Case(r, "mpc")]).median for r in ROADS}
    worst = min(saved, key=saved.__getitem__)
    return Finding(
        ", ".join(f"{ROAD_NAMES[r]} {s:.0f} %" for r, s in saved.items()),
        saved[worst] >= PREVIEW_GAIN.low,
        value=saved[worst],
        unit="%",
        words={"worst": ROAD_NAMES[worst], "least": PREVIEW_GAIN.low},
    )


def converged(study: Averages, *, most: float) -> Finding:
    """Whether halving all steps moves every figure by at most so much [%]; the value is the largest change."""
    case, change = largest_change(refinements(study))
    where = f"{ROAD_NAMES[case.road]}, {NAMES[case.controller]}"
    return Finding(holds=abs(change) <= most, value=abs(change), unit="%", words={"where": where})


def solver(study: Averages, *, residual: float) -> Finding:
    """Whether every quadratic program is solved, to this residual; the value is the largest residual."""
    results = study.results
    rows = [results[c] for c in results.of() if c.controller in PREDICTIVE]
    failures, largest = sum(r["solver_failures"] for r in rows), max(r["solver_residual"] for r in rows)
    unsolved = "a sample was not solved" if failures else "all are solved, but not all to that residual"
    words = {"failures": failures, "unsolved": unsolved}
    return Finding(holds=failures == 0 and largest <= residual, value=largest, unit="-", words=words)


JUDGES = {f.__name__: f for f in (statement, kilonewton, travel_limit, estimates, sensed_preview, converged, solver)}
VEHICLE = ClaimList.read(Path(__file__).with_name("claims.toml"), JUDGES, Averages)

SENTENCES = {s.id: [replace(p, published=s.published) for p in parts(**s.values)] for s in VEHICLE if not s.own}
"""What the paper says of the controlled car, one entry for each sentence, in its order: its parts."""

PREVIEW_GAIN: Band = VEHICLE.statements["bump-preview"].values["band"]  # %, which counts as the published 15 %

CLAIMS = ClaimList()
for _claims in (TRACKING_CLAIMS, VEHICLE, PREVIEW_CLAIMS):
    CLAIMS.include(_claims)


def unsettled(study: Averages) -> list[str]:
    """Statements whose verdict changes with half the steps, in words."""
    return [
        f"{id} ({', '.join([NAMES[p.of]] * (len(found) > 1) + [at.words(study)])})"
        for id, found in SENTENCES.items()
        for at in CONDITIONS
        for p in found
        if finding(p, study, at).undecided.startswith("as run")
    ]
