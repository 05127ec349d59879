"""What pump the published figures of paper 001 take: flow without a limit, and the figures under pumps of several sizes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from cosim.experiments.hmmwv import ROADS, Case
from cosim.experiments.hmmwv_figures import NAMES, PUMP, ROAD_NAMES, STATEMENTS, WITHOUT_LIMIT, Condition, Statement
from cosim.experiments.hmmwv_study import (
    ACTIVE,
    PUBLISHED,
    PUMP_L_MIN,
    PUMPED,
    PUMPS_L_MIN,
    SHARED_L_MIN,
    SIDE_VARIANTS,
    Study,
)
from cosim.report import Section, Table
from cosim.report.model import Scalar

SHARED = Condition(SHARED_L_MIN)
WHERE = {"track": "on the test track", "bump": "over one bump", "off-road": "off road"}


@dataclass(frozen=True)
class Need:
    """What a statement takes: of the pumps tried, the smallest from which on all carry it; None: none does.

    ``conditions`` are those tried, from the smallest pump to the one without limit.
    """

    statement: Statement
    conditions: tuple[Condition, ...]
    carried: tuple[bool, ...]

    @property
    def smallest(self) -> Condition | None:
        if not any(self.carried):
            return None
        first = self.carried.index(True)
        return self.conditions[first]

    @property
    def words(self) -> str:
        """ "from 90 l/min at each actuator on (not with 75)"."""
        if self.smallest is None:
            return "no pump that was tried"
        first, past = self.carried.index(True), [c for c, ok in zip(self.conditions, self.carried, strict=True) if ok]
        words = self.smallest.words
        if first and self.conditions[first - 1].pump_l_min is not None:
            words += f", not with {self.conditions[first - 1].pump_l_min:g} l/min"
        gaps = any(a and not b for a, b in pairwise(self.carried))
        return words + (f"; no longer beyond {past[-1].words}" if gaps else "")


def conditions(road: str) -> tuple[Condition, ...]:
    """Pumps that were tried on a road with all controllers of :data:`PUMPED`, from the smallest on."""
    return (PUMP, *(Condition(x) for x in PUMPS_L_MIN[road]), WITHOUT_LIMIT)


def needs(study: Study) -> list[Need]:
    """Which pump carries each statement with a size or a limit, as far as larger pumps were tried for it."""
    found = []
    for s in STATEMENTS:
        if set(s.controllers) <= set(PUMPED[s.road]):
            tried = conditions(s.road)
            found.append(Need(s, tried, tuple(s.carried(study, at) for at in tried)))
    return found


def section(study: Study) -> Section:
    """The pump's part of a report."""
    every = needs(study)
    controlled = ("skyhook", "lqr", "mpc", "mpc-preview")
    demand = {r: [study.mean("flow_mean", Case(r, c)) for c in controlled] for r in ROADS}
    asked = ", ".join(f"{min(v):.0f} to {max(v):.0f} l/min {WHERE[r]}" for r, v in demand.items())
    beyond = (max(max(v) for r, v in demand.items() if r != "off-road") - PUMP_L_MIN) / 60  # l in a second
    return Section(
        "What the hydraulics do, and what pump it takes",
        [
            f"The paper's pump delivers {PUMP_L_MIN:g} l/min (Table 1.4); an accumulator is not mentioned. Skyhook, LQR and MPC draw {asked} "
            "from a pump that holds its pressure at any flow (mean over the busiest second, off road over the run). Over bumps that is up to "
            f"{max(beyond, 0.0):.1f} l more in a second than the pump delivers, which an accumulator could hold; off road the whole run takes "
            f"{min(demand['off-road']) / PUMP_L_MIN:.1f} to {max(demand['off-road']) / PUMP_L_MIN:.1f} times the pump, which none could.",
            f"How the limit is modelled: what the valve lets out of the supply is cut at the limit, and a piston that moves faster than this flow "
            f"fills is held by its oil column. With {PUMP_L_MIN:g} l/min at each actuator, {4 * PUMP_L_MIN:g} l/min in all, every actuator may draw "
            f"what the pump has for all four: the most generous reading. With {SHARED_L_MIN:g} l/min each the four share it evenly, the "
            "narrowest one. What the paper's vehicle could do lies between.",
        ],
        tables=[_side_by_side(study), _needed(study, every), _flows(study)],
    )


def _side_by_side(study: Study) -> Table:
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
    for what in ("no limit", f"{PUMP_L_MIN:g} l/min each", f"{SHARED_L_MIN:g} l/min each"):
        columns += [f"{what} [W]", f"{what}, passive over it [-]"]
    return Table(
        "pump",
        "Absorbed power without and with the pump's limit, side by side",
        columns,
        rows,
        f"Medians over the places of the bump or the stretches; with {SHARED_L_MIN:g} l/min each over {SIDE_VARIANTS} of them.",
    )


def _needed(study: Study, every: list[Need]) -> Table:
    rows: list[list[Scalar]] = []
    for need in every:
        s, at = need.statement, need.smallest
        figures = [s.figure(study, c).median for c in (PUMP, WITHOUT_LIMIT)]
        flow: list[Scalar] = [None, None]
        if at is not None:
            driven = at(Case(s.road, s.controllers[-1]))
            flow = [round(study.mean("flow_mean", driven)), round(study.largest("flow_peak", driven))]
        rows.append(
            [f"{ROAD_NAMES[s.road]}: {s.claim}", s.published, *(f"{s.form.format(f)} {s.unit}" for f in figures), need.words, *flow]
        )  # fmt: skip
    return Table(
        "pump-needed",
        "What pump carries the published figures",
        [
            "statement", "published", f"{PUMP_L_MIN:g} l/min each", "no limit", "smallest pump that carries it",
            "flow of all four there, mean [l/min]", "flow of all four there, peak [l/min]",
        ],
        rows,
        "Of the pumps tried: "
        + "; ".join(f"{ROAD_NAMES[r]} {', '.join(f'{c.pump_l_min:g}' for c in conditions(r)[:-1])} l/min each" for r in ROADS)
        + ", and none without limit. Mean: over bumps the largest over 1 s, off road that of the run.",
    )  # fmt: skip


def _flows(study: Study) -> Table:
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
                    round(mean / PUMP_L_MIN, 1),
                    round(1e-3 * study.mean("power_mean", case), 1),
                    round(100 * study.mean("saturation", case), 1),
                    round(study.mean("tracking_error_rms", case)),
                ]
            )
    return Table(
        "hydraulics",
        "Flow of all four actuators without limit, saturation and tracking",
        [
            "road", "controller", "flow, mean [l/min]", "flow, peak [l/min]", "mean over that of the paper's pump [-]",
            "power from the pump, mean [kW]", "valve saturated [%]", "force error rms [N]",
        ],
        rows,
        "Mean flow: over bumps the largest mean over 1 s, off road that of the run.",
    )  # fmt: skip
