"""What pump the published figures take: flow without a limit, and the figures under pumps of several sizes."""

from __future__ import annotations

from itertools import product
from typing import Any

from cosim.experiments.hmmwv.averages import OF_MEDIANS, Averages
from cosim.experiments.hmmwv.claims import SENTENCES
from cosim.experiments.hmmwv.published import ACTIVE, PUBLISHED, PUMP, SHARED, SIDE_VARIANTS, WITHOUT_LIMIT
from cosim.experiments.hmmwv.runs import ROADS, Case
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES, conditions, need
from cosim.report import Table
from cosim.study import Content

WHERE = {"track": "on the test track", "bump": "over one bump", "off-road": "off road"}


def section(study: Averages) -> Content:
    """Effect of the hydraulics, and the pump that is needed."""
    pump, shared = (c.l_min(study) for c in (PUMP, SHARED))
    controlled = ("skyhook", "lqr", "mpc", "mpc-preview")
    demand = {r: [study.mean("flow_mean", Case(r, c)) for c in controlled] for r in ROADS}
    drawn = ", ".join(f"{min(v):.0f} to {max(v):.0f} l/min {WHERE[r]}" for r, v in demand.items())
    beyond = (max(max(v) for r, v in demand.items() if r != "off-road") - pump) / 60  # l in a second
    yield f"""The pump delivers {pump:g} l/min (the paper's: Table 1.4); an accumulator is not mentioned. Skyhook, LQR
    and MPC draw {drawn} from a pump that holds its pressure at any flow (mean over the busiest second, off road over
    the run). Over bumps that is up to {max(beyond, 0.0):.1f} l more in a second than the pump delivers, which an
    accumulator could hold; off road the whole run takes {min(demand["off-road"]) / pump:.1f} to
    {max(demand["off-road"]) / pump:.1f} times the pump, which none could.

    How the limit is modeled: the flow that the valve draws from the supply is limited, and a piston that moves faster
    than this flow fills is held by its oil column. With {pump:g} l/min at each actuator, {4 * pump:g} l/min in all,
    every actuator may draw what the pump has for all four: the most generous reading. With {shared:g} l/min each the
    four share it evenly, the narrowest one. The paper's vehicle lies between."""
    each, evenly = (f"{flow:g} l/min each" for flow in (pump, shared))
    rows = []
    for road, controller in product(ROADS, ACTIVE):
        base = study.power(Case(road, "passive"))
        row: dict[str, Any] = {"road": ROAD_NAMES[road], "controller": NAMES[controller], "passive [W]": round(base, 2)}
        for at, what in ((WITHOUT_LIMIT, "no limit"), (PUMP, each), (SHARED, evenly)):
            known = at is not SHARED or controller in PUBLISHED
            power = study.power(at(Case(road, controller))) if known else None
            row[f"{what} [W]"] = None if power is None else round(power, 2)
            row[f"{what}, passive over it [-]"] = None if power is None else round(base / power, 2)
        rows.append(row)
    yield Table.of(
        "pump",
        "Absorbed power without and with the pump's limit, side by side",
        rows,
        f"Medians over the places of the bump or the stretches; with {evenly} over {SIDE_VARIANTS} of"
        f" them. {OF_MEDIANS}",
    )
    yield _needed(study, each)
    rows = [
        {
            "road": ROAD_NAMES[case.road],
            "controller": NAMES[case.controller],
            "flow, mean [l/min]": round(study.mean("flow_mean", case)),
            "flow, peak [l/min]": round(study.largest("flow_peak", case)),
            "mean over that of the pump [-]": round(study.mean("flow_mean", case) / pump, 1),
            "power from the pump, mean [kW]": round(1e-3 * study.mean("power_mean", case), 1),
            "valve saturated [%]": round(100 * study.mean("saturation", case), 1),
            "force error rms [N]": round(study.mean("tracking_error_rms", case)),
        }
        for case in (Case(road, controller) for road in ROADS for controller in ACTIVE)
    ]
    title = "Flow of all four actuators without limit, saturation and tracking"
    yield Table.of(
        "hydraulics", title, rows, "Mean flow: over bumps the largest mean over 1 s, off road that of the run."
    )


def _needed(study: Averages, at_pump: str) -> Table:
    rows = []
    for found in filter(None, (need(study, s) for parts in SENTENCES.values() for s in parts)):
        s, at = found.statement, found.smallest
        figures = [s.figures(study, c) for c in (PUMP, WITHOUT_LIMIT)]
        shown = [s.incomparable(f) or f"{s.form.format(f.median)} {s.unit}" for f in figures]
        driven = at and at(Case(s.road, s.of))
        rows.append(
            {
                "statement": f"{ROAD_NAMES[s.road]}: {s.claim}",
                "published": s.published,
                at_pump: shown[0],
                "no limit": shown[1],
                "smallest pump with which it holds": found.words(study),
                "flow of all four there, mean [l/min]": driven and round(study.mean("flow_mean", driven)),
                "flow of all four there, peak [l/min]": driven and round(study.largest("flow_peak", driven)),
            }
        )
    tried = "; ".join(
        f"{ROAD_NAMES[r]} {', '.join(f'{c.l_min(study):g}' for c in conditions(study, r)[:-1])} l/min each"
        for r in ROADS
    )
    return Table.of(
        "pump-needed",
        "Which pump reproduces the published figures",
        rows,
        f"Of the pumps tried: {tried}, and one without limit. Mean: over bumps the largest over 1 s, off road that of"
        " the run.",
    )
