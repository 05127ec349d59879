"""What pump the published figures take: flow without a limit, and the figures under pumps of several sizes."""

from __future__ import annotations

from cosim.experiments.hmmwv.averages import OF_MEDIANS, Averages
from cosim.experiments.hmmwv.claims import STATEMENTS
from cosim.experiments.hmmwv.published import (
    ACTIVE,
    PUBLISHED,
    PUMP,
    SHARED,
    SIDE_VARIANTS,
    WITHOUT_LIMIT,
)
from cosim.experiments.hmmwv.runs import ROADS, Case
from cosim.experiments.hmmwv.statements import NAMES, ROAD_NAMES, conditions, need
from cosim.report import Section, Table
from cosim.report.model import Scalar

WHERE = {"track": "on the test track", "bump": "over one bump", "off-road": "off road"}


def section(study: Averages) -> Section:
    """Effect of the hydraulics, and the pump that is needed."""
    pump, shared = (c.l_min(study) for c in (PUMP, SHARED))
    controlled = ("skyhook", "lqr", "mpc", "mpc-preview")
    demand = {r: [study.mean("flow_mean", Case(r, c)) for c in controlled] for r in ROADS}
    drawn = ", ".join(f"{min(v):.0f} to {max(v):.0f} l/min {WHERE[r]}" for r, v in demand.items())
    beyond = (max(max(v) for r, v in demand.items() if r != "off-road") - pump) / 60  # l in a second
    return Section(
        "Effect of the hydraulics, and the pump that is needed",
        [
            (
                f"The pump delivers {pump:g} l/min (the paper's: Table 1.4); an accumulator is not mentioned. Skyhook,"
                f" LQR and MPC draw {drawn} from a pump that holds its pressure at any flow (mean over the busiest"
                f" second, off road over the run). Over bumps that is up to {max(beyond, 0.0):.1f} l more in a second"
                " than the pump delivers, which an accumulator could hold; off road the whole run takes"
                f" {min(demand['off-road']) / pump:.1f} to {max(demand['off-road']) / pump:.1f} times the pump, which"
                " none could."
            ),
            (
                "How the limit is modeled: the flow that the valve draws from the supply is limited, and a piston"
                f" that moves faster than this flow fills is held by its oil column. With {pump:g} l/min at each"
                f" actuator, {4 * pump:g} l/min in all, every actuator may draw what the pump has for all four: the"
                f" most generous reading. With {shared:g} l/min each the four share it evenly, the narrowest one."
                " The paper's vehicle lies between."
            ),
        ],
        tables=[_side_by_side(study), _needed(study), _flows(study)],
    )


def _side_by_side(study: Averages) -> Table:
    pump, shared = (c.l_min(study) for c in (PUMP, SHARED))
    rows: list[list[Scalar]] = []
    for road in ROADS:
        passive = study.power(Case(road, "passive"))
        for controller in ACTIVE:
            row: list[Scalar] = [ROAD_NAMES[road], NAMES[controller], round(passive, 2)]
            for at in (WITHOUT_LIMIT, PUMP, SHARED):
                known = at is not SHARED or controller in PUBLISHED
                power = study.power(at(Case(road, controller))) if known else None
                row += [None, None] if power is None else [round(power, 2), round(passive / power, 2)]
            rows.append(row)
    columns = ["road", "controller", "passive [W]"]
    for what in ("no limit", f"{pump:g} l/min each", f"{shared:g} l/min each"):
        columns += [f"{what} [W]", f"{what}, passive over it [-]"]
    return Table(
        "pump",
        "Absorbed power without and with the pump's limit, side by side",
        columns,
        rows,
        f"Medians over the places of the bump or the stretches; with {shared:g} l/min each over {SIDE_VARIANTS} of"
        f" them. {OF_MEDIANS}",
    )


def _needed(study: Averages) -> Table:
    pump = PUMP.l_min(study)
    rows: list[list[Scalar]] = []
    for found in filter(None, (need(study, s) for s in STATEMENTS.values())):
        s, at = found.statement, found.smallest
        figures = [s.figures(study, c) for c in (PUMP, WITHOUT_LIMIT)]
        shown = [s.incomparable(f) or f"{s.form.format(f.median)} {s.unit}" for f in figures]
        flow: list[Scalar] = [None, None]
        if at is not None:
            driven = at(Case(s.road, s.controllers[-1]))
            flow = [round(study.mean("flow_mean", driven)), round(study.largest("flow_peak", driven))]
        rows.append([f"{ROAD_NAMES[s.road]}: {s.claim}", s.published, *shown, found.words(study), *flow])
    return Table(
        "pump-needed",
        "Which pump reproduces the published figures",
        [
            "statement",
            "published",
            f"{pump:g} l/min each",
            "no limit",
            "smallest pump with which it holds",
            "flow of all four there, mean [l/min]",
            "flow of all four there, peak [l/min]",
        ],
        rows,
        "Of the pumps tried: "
        + "; ".join(
            f"{ROAD_NAMES[r]} {', '.join(f'{c.l_min(study):g}' for c in conditions(study, r)[:-1])} l/min each"
            for r in ROADS
        )
        + ", and one without limit. Mean: over bumps the largest over 1 s, off road that of the run.",
    )


def _flows(study: Averages) -> Table:
    pump = PUMP.l_min(study)
    rows: list[list[Scalar]] = []
    for road in ROADS:
        for controller in ACTIVE:
            case = Case(road, controller)
            mean = study.mean("flow_mean", case)
            rows.append(
                [
                    ROAD_NAMES[road],
                    NAMES[controller],
                    round(mean),
                    round(study.largest("flow_peak", case)),
                    round(mean / pump, 1),
                    round(1e-3 * study.mean("power_mean", case), 1),
                    round(100 * study.mean("saturation", case), 1),
                    round(study.mean("tracking_error_rms", case)),
                ]
            )
    return Table(
        "hydraulics",
        "Flow of all four actuators without limit, saturation and tracking",
        [
            "road",
            "controller",
            "flow, mean [l/min]",
            "flow, peak [l/min]",
            "mean over that of the pump [-]",
            "power from the pump, mean [kW]",
            "valve saturated [%]",
            "force error rms [N]",
        ],
        rows,
        "Mean flow: over bumps the largest mean over 1 s, off road that of the run.",
    )
