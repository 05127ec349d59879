"""Paper 001 under other readings: which of its claims turn under which of the assumptions that it leaves open.

Every reading is the main study (`hmmwv`, with its parts) with fields of its cases set otherwise. None is chosen: the
main study stays as it is.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from typing import Any

from cosim.experiments import hmmwv
from cosim.experiments.hmmwv.preview import published as chain_of_preview
from cosim.experiments.hmmwv.preview.runs import Case as PreviewCase
from cosim.experiments.hmmwv.published import (
    CONDITIONS,
    NULL_OPENINGS_MM,
    WITHOUT_PREVIEW,
    finer,
    places,
    published_cases,
)
from cosim.experiments.hmmwv.runs import Case
from cosim.experiments.hmmwv.tracking import published as tracking
from cosim.experiments.hmmwv.tracking.runs import FILTER
from cosim.experiments.hmmwv.tracking.runs import Case as TrackingCase
from cosim.report import Report
from cosim.study.fmus import FmuSet
from cosim.study.readings import AS_READ, Change, Reading, ReadingsStudy
from cosim.study.results import Results

PHYSICAL_DENSITY = 850.0  # kg/m3, of hydraulic oil; the paper prints 3500
CONTROLLERS = {
    "track": ("passive", *WITHOUT_PREVIEW, "mpc"),
    "bump": ("passive", "mpc", "mpc-preview"),
    "off-road": ("passive", *WITHOUT_PREVIEW, "mpc"),
}
"""Whose runs the claims need, by road."""
CONTROLLED = (*WITHOUT_PREVIEW, "mpc", "mpc-preview")


def _opening(mm: float) -> Change:
    """The passive car's valves, where the main study leaves them to the actuator's FMU."""
    return Change(Case, {"null_opening_mm": mm}, {"controller": "passive", "null_opening_mm": None})


def _pump(**fields: bool) -> Reading:
    """One pump under both conditions of the main study."""
    return (Change(Case, fields, {"controller": CONTROLLED}),)


READINGS: dict[str, Reading] = {
    AS_READ: (),
    "null opening 4 mm": (_opening(min(NULL_OPENINGS_MM)),),
    "null opening 6.75 mm": (_opening(max(NULL_OPENINGS_MM)),),
    "accumulator that never empties": _pump(flow_limit=False),
    "no accumulator, one pump for each actuator": _pump(flow_limit=True),
    "no accumulator, one pump for all": _pump(flow_limit=True, shared_pump=True),
    "density of real oil": (
        Change(Case, {"density": PHYSICAL_DENSITY}),
        Change(TrackingCase, {"actuator": "physical"}, {"signal": tracking.PUBLISHED}),
    ),
    "dry friction in the car, none at the corner": (
        Change(Case, {"friction": True}),
        Change(TrackingCase, {"friction": False}, {"signal": tracking.PUBLISHED}),
    ),
    "LQR weights with the force in kN": (Change(Case, {"controller": "lqr-kilonewton"}, {"controller": "lqr"}),),
    "preview 20 ms late": (Change(Case, {"preview_error_ms": 20.0}, {"controller": "mpc-preview"}),),
    "a tenth of the sensors' noise": (Change(PreviewCase, {"noise": 0.1}, {"noise": 1.0}),),
    "tires that take tension": (Change(Case, {"lift_off": False}),),
    "estimated states": (Change(Case, {"states": "estimated"}, {"controller": CONTROLLED[1:]}),),
    "off road of class D": (Change(Case, {"terrain": "D"}, {"road": "off-road"}),),
}


def needs() -> list[Any]:
    """The runs on which the claims of the main study rest."""
    cars = [
        at(case)
        for case in published_cases()
        if not case.flow_limit and case.controller in CONTROLLERS[case.road]
        for at in CONDITIONS
    ]
    cars += [Case(road, "passive", null_opening_mm=mm) for road in ("track", "bump") for mm in NULL_OPENINGS_MM]
    variants = [c for c in tracking.VARIANTS.values() if c.actuator == "paper" and c.friction and c.extrapolate]
    variants = [c for c in variants if c.integral is None and c.exchange_parts == 1]
    corner = [TrackingCase(FILTER), *(replace(c, signal=s) for c in variants for s in tracking.PUBLISHED)]
    preview = [t.case for t in chain_of_preview.plan() if not t.case.dropout]
    at_places = list(chain(*map(places, cars)))
    return list(dict.fromkeys([*at_places, *map(finer, at_places), *corner, *preview]))


STUDY = ReadingsStudy(
    hmmwv.EXPERIMENT,
    needs,
    ("cosim.experiments.hmmwv.claims:CLAIMS",),
    READINGS,
    "judge at half the steps of solver and exchange too",
    short=(Change(Case, {"solver_parts": 1, "exchange_parts": 1}),),
)
NOTES = (
    "The height of the CG: the vehicle of the paper has seven degrees of freedom and drives straight at one speed, so"
    " no force acts along or across the road that a height could turn into pitch or roll.",
    "An accumulator of a size: the actuators have none. With a pump that holds its pressure at any flow it never"
    " empties, with the pump's limit there is none; over a bump the former is nearer, off road the latter.",
    "Springs, dampers and masses per wheel instead of per axle (Appendix 1.C): the controllers are designed on the"
    " vehicle, so that is another vehicle file, not an option of a run.",
)


def report(results: Results, fmus: FmuSet) -> Report:
    """Claims by reading."""
    from cosim.study.readings_report import report_readings

    return report_readings(STUDY, EXPERIMENT, results, fmus, NOTES)


EXPERIMENT = STUDY.experiment("hmmwv-readings", "HMMWV with hydraulic actuators: other readings (paper 001)", __name__)
