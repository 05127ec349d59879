"""Claims of paper 001 on the vehicle, judged by the runs; those on force tracking and preview are in their folders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cosim.experiments.hmmwv.averages import Averages
from cosim.experiments.hmmwv.preview.claims import CLAIMS as PREVIEW_CLAIMS
from cosim.experiments.hmmwv.published import CONDITIONS, PUMP, WITHOUT_LIMIT, estimated
from cosim.experiments.hmmwv.refinement import refinements
from cosim.experiments.hmmwv.runs import PREDICTIVE, ROADS, TRAVEL_LIMIT, Case
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES, finding, gain, parts, statement
from cosim.experiments.hmmwv.tracking.claims import CLAIMS as TRACKING_CLAIMS
from cosim.study import Band, ClaimList, Distribution, Finding, Results

ESTIMATES_COST = 10.0  # %, of the same with true states; our criterion
REFINED = 1.0  # %, by which halving all steps may move a figure: a tenth of the band around a single published one
RESIDUAL = 1e-6  # of a quadratic program
ASSUMED = "noise of the sensors and of the road in the filter assumed"

SENTENCES = ClaimList.read(Path(__file__).with_name("claims.toml"), {"statement": statement})
"""What the paper says of the controlled car, one entry for each sentence, in its order."""

STATEMENTS = {
    f"{s.id}-{p.of}" if len(found) > 1 else s.id: replace(p, published=s.published)
    for s in SENTENCES
    for found in [parts(**s.values)]
    for p in found
}
"""Their parts."""

PREVIEW_GAIN: Band = SENTENCES.statements["bump-preview"].values["band"]  # %, which counts as the published 15 %

CLAIMS = ClaimList()
CLAIMS.include(TRACKING_CLAIMS)
CLAIMS.include(SENTENCES)


def unsettled(study: Results) -> list[str]:
    """Statements whose verdict changes with half the steps, in words."""
    return [
        f"{s.id} ({', '.join([NAMES[p.of]] * (len(found) > 1) + [at.words(Averages(study))])})"
        for s in SENTENCES
        for found in [parts(**s.values)]
        for at in CONDITIONS
        for p in found
        if finding(p, study, at).undecided.startswith("as run")
    ]


# ------------------------------------------------------------------------------------------------ additional checks


def _less(percent: float) -> bool:
    return percent > 0


@CLAIMS.check(
    "off-road-kilonewton",
    "Off road: MPC also beats the LQR whose weights of Table 1.1 are read with the force in kN",
    expected="it does; the paper does not give the unit",
    source="Tables 1.1, 1.3",
)
def _off_road_kilonewton(results: Results) -> Finding:
    study = Averages(results)
    mpc, kilonewton = (Case("off-road", c) for c in ("mpc", "lqr-kilonewton"))
    ahead = gain("off-road", "mpc", ("lqr-kilonewton",))(study, WITHOUT_LIMIT)

    def beyond(case: Case) -> str:
        return (
            f"up to {1e3 * study.largest('travel_peak', case):.0f} mm of travel and"
            f" {100 * study.mean('travel_over', case):.2f} % of the time beyond {1e3 * TRAVEL_LIMIT:g} mm"
        )

    return Finding(
        f"{study.power(mpc):.2f} W with {beyond(mpc)}, the LQR {study.power(kilonewton):.2f} W with"
        f" {beyond(kilonewton)}; what MPC saves over it: {ahead.text('{:.1f}', '%', _less)}",
        ahead.everywhere(_less),
        "read so the LQR uses its forces as freely as MPC, knows no limit of travel and pays with travel; with "
        f"{PUMP.words(study)} {study.power(PUMP(kilonewton)):.1f} W, MPC {study.power(PUMP(mpc)):.1f} W",
        ahead.median,
        "%",
        criterion="less absorbed power on every stretch, pump without limit",
    )


@CLAIMS.check(
    "off-road-travel-limit",
    f"Off road: MPC keeps the travel within the printed {1e3 * TRAVEL_LIMIT:g} mm",
    expected=f"within {1e3 * TRAVEL_LIMIT:g} mm",
    source="Table 1.3",
)
def _off_road_travel_limit(results: Results) -> Finding:
    study = Averages(results)
    over = {c: 100 * study.mean("travel_over", Case("off-road", c)) for c in ("mpc", "skyhook", "lqr")}
    found = study.distribution("travel_peak", Case("off-road", "mpc"))
    peaks = Distribution((1e3 * p for p in found.values), of=found.of)
    return Finding(
        f"largest travel {peaks.text('{:.0f}', 'mm', lambda x: x <= 1e3 * TRAVEL_LIMIT)}; beyond the limit"
        f" {over['mpc']:.2f} % of the time, skyhook {over['skyhook']:.2f} %, LQR {over['lqr']:.2f} %",
        found.high <= TRAVEL_LIMIT,
        "the limit is soft, so that the problem always has a solution, and MPC without preview does not see the bumps"
        " coming",
        1e3 * found.high,
        "mm",
        criterion="no corner beyond it on any stretch",
        fitted="weight of the soft limit assumed",
    )


def _estimates(controller: str) -> None:
    """A check of what estimated states cost a controller."""

    @CLAIMS.check(
        f"estimates-{controller}",
        f"With estimated states {NAMES[controller]} is at most {ESTIMATES_COST:g} % worse than with true ones",
        expected="works with estimated states",
        source="section 1.4",
    )
    def _judged(results: Results) -> Finding:
        study = Averages(results)
        costs = {r: study.ratio(estimated(controller, r), Case(r, controller)).median for r in ROADS}
        worst = max(costs, key=lambda r: costs[r])
        tension = Case("bump", controller, lift_off=False)
        linear = study.power(replace(tension, states="estimated")) / study.power(tension)
        return Finding(
            ", ".join(f"{ROAD_NAMES[r]} {round(100 * (c - 1)):+d} %" for r, c in costs.items()),
            100 * (costs[worst] - 1) <= ESTIMATES_COST,
            f"more than {ESTIMATES_COST:g} % on {ROAD_NAMES[worst]}; over the bump with tires that take tension, as the"
            f" filter's linear model has them, {100 * (linear - 1):+.0f} %",
            100 * (costs[worst] - 1),
            "%",
            criterion=f"median over the variants at most {ESTIMATES_COST:g} % worse on every road",
            fitted=ASSUMED,
        )


for _controller in ("mpc", "mpc-preview"):
    _estimates(_controller)


@CLAIMS.check(
    "sensed-preview",
    "Preview from the range sensors, downstream of filter, correction and buffer, improves MPC as the published preview"
    " does",
    expected=f"at least {PREVIEW_GAIN.low:g} %; the paper measured generated preview only",
    source="section 1.5",
)
def _sensed_preview(results: Results) -> Finding:
    study = Averages(results)
    ratios = {r: study.ratio(estimated("mpc-preview", r, sensed=True), Case(r, "mpc")) for r in ROADS}
    saved = {r: Distribution(100 * (1 - x) for x in d.values).median for r, d in ratios.items()}
    worst = min(saved, key=lambda r: saved[r])
    least = PREVIEW_GAIN.low
    return Finding(
        ", ".join(f"{ROAD_NAMES[r]} {s:.0f} %" for r, s in saved.items()),
        saved[worst] >= least,
        f"less than {least:g} % on {ROAD_NAMES[worst]}",
        saved[worst],
        "%",
        criterion=(
            f"median at least {least:g} % below MPC without preview on every road, the least that counts as the"
            " published 15 %"
        ),
        fitted=ASSUMED,
    )


@CLAIMS.check(
    "converged",
    "Half the steps of exchange and solvers give the same absorbed power",
    expected=f"within {REFINED:g} %",
    source="",
)
def _converged(results: Results) -> Finding:
    study = Averages(results)
    worst = max(refinements(study), key=lambda r: abs(r.change))
    return Finding(
        f"at most {abs(worst.change):.2f} % off, {ROAD_NAMES[worst.case.road]}, {NAMES[worst.case.controller]}",
        abs(worst.change) <= REFINED,
        f"more than {REFINED:g} % off; every claim was judged at both steps",
        abs(worst.change),
        "%",
        criterion=f"at most {REFINED:g} % in every run of the claims: a tenth of the band around a published figure",
    )


@CLAIMS.check("solver", "Every quadratic program of MPC is solved", expected="all", source="")
def _solver(results: Results) -> Finding:
    rows = [results[c] for c in results.of() if c.controller in PREDICTIVE]
    failures = sum(r["solver_failures"] for r in rows)
    residual = max(r["solver_residual"] for r in rows)
    unsolved = "a sample was not solved" if failures else "all are solved, but not all to that residual"
    return Finding(
        f"{failures} samples not solved, largest residual {residual:.1e}",
        failures == 0 and residual <= RESIDUAL,
        unsolved,
        residual,
        "-",
        criterion=f"status solved in every sample of every run, residual at most {RESIDUAL:g}",
    )


CLAIMS.include(PREVIEW_CLAIMS)
