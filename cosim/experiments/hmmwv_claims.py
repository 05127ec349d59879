"""The claims of paper 001 on the whole vehicle, each judged from the study's own numbers."""

from __future__ import annotations

from dataclasses import replace

from cosim.comfort import ABSORBED_POWER_LIMIT
from cosim.experiments import hmmwv_preview, hmmwv_tracking
from cosim.experiments.hmmwv import ROADS, TRAVEL_LIMIT, Case
from cosim.experiments.hmmwv_figures import (
    CONDITIONS,
    NAMES,
    PREVIEW_GAIN,
    PUMP,
    ROAD_NAMES,
    STATEMENTS,
    WITHOUT_LIMIT,
    Condition,
    Statement,
    gain,
)
from cosim.experiments.hmmwv_pump import needs
from cosim.experiments.hmmwv_refinement import refinements
from cosim.experiments.hmmwv_study import Study, estimated, with_pump
from cosim.report import Claims, Distribution

ESTIMATES_COST = 10.0  # %, of the same on true states; ours
REFINED = 1.0  # %, by which halving all steps may move a figure: a tenth of the band around a single published one
RESIDUAL = 1e-6  # of a quadratic program


def claims(study: Study) -> Claims:
    """Every published claim with the published figure, ours and a verdict; those on parts if the parts were run.

    A verdict that changes when the steps of exchange and solvers are halved is open.
    """
    result = Claims()
    if study.tracking is not None:
        result += hmmwv_tracking.tracking_claims(study.tracking)
    finer = {c.id: c for c in vehicle_claims(study.refined())}
    for coarse in vehicle_claims(study):
        fine = finer[coarse.id]
        if fine.verdict == coarse.verdict:
            result.append(coarse)
        else:
            both = f"as run {coarse.ours}: {coarse.verdict}; with half the steps {fine.ours}: {fine.verdict}"
            result.append(replace(coarse, verdict="open", reason=both))
    _checks(result, study)
    if study.preview is not None:
        result += hmmwv_preview.claims(study.preview)
    return result


def vehicle_claims(study: Study) -> Claims:
    """The statements on the vehicle, those on the controlled car once per condition of the pump."""
    result = Claims()
    carriers = {need.statement.id: need.words for need in needs(study)}
    for statement in STATEMENTS:
        for suffix, at in CONDITIONS.items():
            _judge(result, study, statement, suffix, at, carriers.get(statement.id, ""))
    passive = study.distribution("absorbed_power", Case("off-road", "passive"))

    def unbearable(power: float) -> bool:
        return power > ABSORBED_POWER_LIMIT

    result.judge(
        "off-road-passive",
        f"Off road: at 20 mph the passive car is above the {ABSORBED_POWER_LIMIT:g} W that a driver bears",
        f"above {ABSORBED_POWER_LIMIT:g} W",
        passive.text("{:.1f}", "W", unbearable),
        passive.everywhere(unbearable),
        "not above it on every stretch",
        "Figure 1.10",
        passive.median,
        "W",
        criterion=f"above {ABSORBED_POWER_LIMIT:g} W on every stretch",
        fitted="the terrain is not in the paper, class E of ISO 8608 is assumed; so is the null opening of the unpowered spool",
    )
    return result


def _judge(result: Claims, study: Study, s: Statement, suffix: str, at: Condition, carrier: str) -> None:
    found = s.figure(study, at)
    single = len(found.values) == 1  # nothing is sampled in it, so the place of the bump does not matter
    powers = {c: study.power(at(Case(s.road, c))) for c in dict.fromkeys(("passive", *s.controllers))}
    side, reason = found.everywhere(s.side), s.shortfall
    if not side:
        reason += f" (on the claimed side in {found.count(s.side)} of {len(found.values)})"
    if carrier and at.pump_l_min is not None:
        reason += f"; carried by: {carrier}"
    result.judge(
        s.id + suffix,
        f"{ROAD_NAMES[s.road].capitalize()}, {at.words}: {s.claim}",
        s.published,
        f"{f'{s.form.format(found.median)} {s.unit}' if single else found.text(s.form, s.unit, s.side)}; absorbed power "
        f"{', '.join(f'{NAMES[c]} {p:.2f}' for c, p in powers.items())} W",
        side,
        reason,
        s.source if at is WITHOUT_LIMIT else f"{s.source}, Table 1.4",
        found.median if single else None,
        s.unit,
        band=s.band,
        over=None if single else found,
        criterion=s.criterion,
        fitted=s.fitted(study, at),
    )


def _checks(result: Claims, study: Study) -> None:
    """Checks of ours, which the paper gives no figure for."""
    check = result.check
    mpc, kilonewton = Case("off-road", "mpc"), Case("off-road", "lqr-kilonewton")
    ahead = gain("off-road", "mpc", ("lqr-kilonewton",))(study, WITHOUT_LIMIT)
    limit = 1e3 * TRAVEL_LIMIT

    def beyond(case: Case) -> str:
        return (
            f"up to {1e3 * study.largest('travel_peak', case):.0f} mm of travel and {100 * study.mean('travel_over', case):.2f} % "
            f"of the time beyond {limit:g} mm"
        )

    check(
        "off-road-kilonewton",
        "Off road: MPC also beats the LQR whose weights of Table 1.1 are read with the force in kN",
        "it does; the paper does not give the unit",
        f"{study.power(mpc):.2f} W with {beyond(mpc)}, the LQR {study.power(kilonewton):.2f} W with {beyond(kilonewton)}; "
        f"MPC below it by {ahead.text('{:.1f}', '%', lambda x: x > 0)}",
        ahead.everywhere(lambda x: x > 0),
        "read so the LQR uses its forces as freely as MPC, knows no limit of travel and pays with travel; with "
        f"{PUMP.words} {study.power(with_pump(kilonewton)):.1f} W, MPC {study.power(with_pump(mpc)):.1f} W",
        "Tables 1.1, 1.3",
        ahead.median,
        "%",
        criterion="less absorbed power on every stretch, pump without limit",
    )
    peaks = study.distribution("travel_peak", mpc)
    check(
        "off-road-travel-limit",
        f"Off road: MPC keeps the travel within the printed {limit:g} mm",
        f"within {limit:g} mm",
        f"largest travel {Distribution((1e3 * p for p in peaks.values), of=peaks.of).text('{:.0f}', 'mm', lambda x: x <= limit)}; beyond "
        f"the limit {100 * study.mean('travel_over', mpc):.2f} % of the time, skyhook "
        f"{100 * study.mean('travel_over', Case('off-road', 'skyhook')):.2f} %, LQR {100 * study.mean('travel_over', Case('off-road', 'lqr')):.2f} %",
        peaks.high <= TRAVEL_LIMIT,
        "the limit is soft, so that the problem always has a solution, and MPC without preview does not see the bumps coming",
        "Table 1.3",
        1e3 * peaks.high,
        "mm",
        criterion="no corner beyond it on any stretch",
        fitted="weight of the soft limit assumed",
    )
    _estimate_checks(result, study)
    every = refinements(study)
    if every:
        worst = max(every, key=lambda r: abs(r.change))
        check(
            "converged",
            "Half the steps of exchange and solvers give the same absorbed power",
            f"within {REFINED:g} %",
            f"at most {abs(worst.change):.2f} % off, {ROAD_NAMES[worst.case.road]}, {NAMES[worst.case.controller]}",
            abs(worst.change) <= REFINED,
            f"more than {REFINED:g} % off; every claim was judged at both steps",
            "",
            abs(worst.change),
            "%",
            criterion=f"at most {REFINED:g} % on the first variant of every case of the claims: a tenth of the band around a published figure",
        )
    failures = sum(r.get("solver_failures", 0) for r in study.rows.values())
    residual = max((r.get("solver_residual", 0.0) for r in study.rows.values()), default=0.0)
    check(
        "solver",
        "Every quadratic program of MPC is solved",
        "all",
        f"{failures} samples not solved, largest residual {residual:.1e}",
        failures == 0 and residual <= RESIDUAL,
        "not every one",
        "",
        residual,
        "-",
        criterion=f"status solved in every sample of every run, residual at most {RESIDUAL:g}",
    )


def _estimate_checks(result: Claims, study: Study) -> None:
    assumed = "noise of the sensors and of the road in the filter assumed"
    for controller in ("mpc", "mpc-preview"):
        costs = {r: study.ratio(estimated(controller, r), Case(r, controller)).median for r in ROADS}
        worst = max(costs, key=lambda r: costs[r])
        pulling = Case("bump", controller, lift_off=False)
        linear = study.power(replace(pulling, states="estimated")) / study.power(pulling)
        result.check(
            f"estimates-{controller}",
            f"{NAMES[controller]} on the states of the Kalman filter is at most {ESTIMATES_COST:g} % worse than on true states",
            "works on estimates",
            ", ".join(f"{ROAD_NAMES[r]} {100 * (c - 1):+.0f} %" for r, c in costs.items()),
            100 * (costs[worst] - 1) <= ESTIMATES_COST,
            f"more than {ESTIMATES_COST:g} % on {ROAD_NAMES[worst]}; over the bump with tyres that pull, as the filter's linear model has "
            f"them, {100 * (linear - 1):+.0f} %",
            "section 1.4",
            100 * (costs[worst] - 1),
            "%",
            criterion=f"median over the variants at most {ESTIMATES_COST:g} % worse on every road",
            fitted=assumed,
        )
    saved = {
        r: Distribution(
            100 * (1 - x) for x in study.ratio(estimated("mpc-preview", r, sensed=True), Case(r, "mpc")).values
        )
        for r in ROADS
    }
    worst = min(saved, key=lambda r: saved[r].median)
    least = PREVIEW_GAIN.low
    result.check(
        "sensed-preview",
        "Preview from the range sensors, behind filter, correction and buffer, improves MPC as the published preview does",
        f"at least {least:g} %; the paper measured generated preview only",
        ", ".join(f"{ROAD_NAMES[r]} {s.median:.0f} %" for r, s in saved.items()),
        saved[worst].median >= least,
        f"less than {least:g} % on {ROAD_NAMES[worst]}",
        "section 1.5",
        saved[worst].median,
        "%",
        criterion=f"median at least {least:g} % below MPC without preview on every road, the least that counts as the published 15 %",
        fitted=assumed,
    )
