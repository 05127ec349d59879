"""Paper 003 under other readings: which of its claims turn under which of the assumptions that it leaves open.

Every reading is a main study (`trench`, `three-axle`) with fields of its cases set otherwise. None is chosen: the main
studies stay as they are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cosim.experiments import three_axle, trench
from cosim.experiments.three_axle import published as linear
from cosim.experiments.three_axle.runs import CONTROLLERS as LINEAR_CONTROLLERS
from cosim.experiments.three_axle.runs import Case as LinearCase
from cosim.experiments.trench.published import SYSTEMS, between, matrix, refined, some
from cosim.experiments.trench.runs import UNSEEING, Case
from cosim.report import Report
from cosim.study.fmus import FmuSet
from cosim.study.readings import AS_READ, Change, Reading, ReadingsStudy
from cosim.study.results import Results

ALONE = ("lqr", "mpc-offsets")  # controllers of which the thesis says that they do not do alone


def _mpc(controller: str) -> Reading:
    return (Change(Case, {"controller": controller}, {"controller": "mpc"}),)


def _observer(estimator: str) -> Change:
    return Change(LinearCase, {"estimator": estimator}, {"controller": ("mpc", "mpc-preview")})


READINGS: dict[str, Reading] = {
    AS_READ: (),
    "spin against the road": (Change(Case, {"spin": "road"}),),
    "hydropneumatic struts": (Change(Case, {"hydropneumatic": True}),),
    "limits as printed": _mpc("mpc-printed-limits"),
    "forced ranges with the printed sign": _mpc("mpc-printed-sign"),
    "height of the body not weighed, weighed on shallow trenches": (
        *_mpc("mpc-no-height"),
        Change(LinearCase, {"hold_height": True}, {"controller": ("mpc", "mpc-preview")}),
    ),
    "no guidance of controllers without preview": (Change(Case, {"guided": False}, {"controller": UNSEEING}),),
    "estimator with road heights": (
        Change(Case, {"controller": "mpc-no-preview"}, {"controller": "mpc-offsets"}),
        _observer("road"),
    ),
}
MORE: dict[str, Reading] = {
    "all states measured": (_observer("measured"),),
    "travel of the struts a quarter longer": (Change(Case, {"travel_factor": 1.25}),),
    "travel of the struts a quarter shorter": (Change(Case, {"travel_factor": 0.75}),),
    "friction 0.6": (Change(Case, {"friction": 0.6}),),
    "CG 5 cm behind": (Change(Case, {"cg_offset": -0.05}),),
    "CG 20 cm lower": (Change(Case, {"cg_height": 0.45}),),
    "trench 1 m deep": (Change(Case, {"depth": 1.0}),),
}


def needs() -> list[Any]:
    """The runs on which the claims of the main studies rest."""
    crossings = [c for s in SYSTEMS for c in matrix(s)]
    crossings += [*map(refined, crossings), *between()]
    crossings += [c for controller in ALONE for c in some(controller) if c.length >= 1.6]
    return [*crossings, *(LinearCase(*p, c) for p in linear.PLACES for c in LINEAR_CONTROLLERS)]


STUDY = ReadingsStudy(
    replace(trench.EXPERIMENT, study=replace(trench.EXPERIMENT.study, parts=[three_axle.EXPERIMENT])),
    needs,
    ("cosim.experiments.trench.claims:CLAIMS", "cosim.experiments.three_axle.claims:CLAIMS"),
    READINGS,
    f"judge at half the step too, and {len(MORE)} more readings",
    MORE,
    short=(Change(Case, {"solver_parts": 1, "exchange_parts": 1}),),
)
NOTES = (
    "The LQR's units: its weights are read with forces in kN, without which they do nothing. Other units are another"
    " gain matrix, so another controller file, not an option of a run.",
)


def report(results: Results, fmus: FmuSet) -> Report:
    """Claims by reading."""
    from cosim.study.readings_report import report_readings

    return report_readings(STUDY, EXPERIMENT, results, fmus, NOTES)


EXPERIMENT = STUDY.experiment("trench-readings", "A 6x6 crosses trenches: other readings (paper 003)", __name__)
