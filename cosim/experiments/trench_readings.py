"""Paper 003 under other readings: its two studies (`trench`, `three-axle`) with what it leaves open set otherwise.

No reading is chosen: the main studies stay as they are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cosim.experiments import three_axle, trench
from cosim.experiments.three_axle.published import PLACES
from cosim.experiments.three_axle.runs import CONTROLLERS
from cosim.experiments.three_axle.runs import Case as LinearCase
from cosim.experiments.trench.published import SYSTEMS, between, matrix, refined, some
from cosim.experiments.trench.runs import UNSEEING, Case
from cosim.study.readings import AS_READ, Change, Reading, ReadingsStudy

PREDICTIVE = {"controller": ("mpc", "mpc-preview")}  # of the linear vehicle


def _mpc(controller: str) -> Change:
    return Change(Case, {"controller": controller}, {"controller": "mpc"})


READINGS: dict[str, Reading] = {
    AS_READ: (),
    "spin against the road": (Change(Case, {"spin": "road"}),),
    "no guidance of controllers without preview": (Change(Case, {"guided": False}, {"controller": UNSEEING}),),
    "estimator with road heights": (
        Change(Case, {"controller": "mpc-no-preview"}, {"controller": "mpc-offsets"}),
        Change(LinearCase, {"estimator": "road"}, PREDICTIVE),
    ),
    "limits as printed": (_mpc("mpc-printed-limits"),),
    "hydropneumatic struts": (Change(Case, {"hydropneumatic": True}),),
}
MORE: dict[str, Reading] = {
    "forced ranges with the printed sign": (_mpc("mpc-printed-sign"),),
    "height of the body not weighed, weighed on shallow trenches": (
        _mpc("mpc-no-height"),
        Change(LinearCase, {"hold_height": True}, PREDICTIVE),
    ),
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
    crossings += [c for controller in ("lqr", "mpc-offsets") for c in some(controller) if c.length >= 1.6]
    return [*crossings, *(LinearCase(*p, c) for p in PLACES for c in CONTROLLERS)]


STUDY = ReadingsStudy(
    replace(trench.EXPERIMENT, study=replace(trench.EXPERIMENT.study, parts=[three_axle.EXPERIMENT])),
    needs,
    ("cosim.experiments.trench.claims:CLAIMS", "cosim.experiments.three_axle.claims:CLAIMS"),
    READINGS,
    f"judge at half the step too, and {len(MORE)} more readings",
    MORE,
    short=(Change(Case, {"solver_parts": 1, "exchange_parts": 1}),),
    notes=(
        "The LQR's units: its weights are read with forces in kN, without which they do nothing. Other units are"
        " another gain matrix, so another controller file, not an option of a run.",
    ),
)
EXPERIMENT = STUDY.experiment("trench-readings", "A 6x6 crosses trenches: other readings (paper 003)", __name__)
