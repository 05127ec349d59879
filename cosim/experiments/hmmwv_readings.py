"""Paper 001 under other readings: its study (`hmmwv`, with its parts) with what the paper leaves open set otherwise.

No reading is chosen: the main study stays as it is.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from typing import Any

from cosim.experiments import hmmwv
from cosim.experiments.hmmwv.preview.published import plan as plan_preview
from cosim.experiments.hmmwv.preview.runs import Case as PreviewCase
from cosim.experiments.hmmwv.published import CONDITIONS, NULL_OPENINGS_MM, WITHOUT_PREVIEW, finer, places
from cosim.experiments.hmmwv.runs import ROADS, Case
from cosim.experiments.hmmwv.tracking.published import PUBLISHED, VARIANTS
from cosim.experiments.hmmwv.tracking.runs import FILTER
from cosim.experiments.hmmwv.tracking.runs import Case as TrackingCase
from cosim.study.readings import AS_READ, Change, Reading, ReadingsStudy

PHYSICAL_DENSITY = 850.0  # kg/m3, of hydraulic oil; the paper prints 3500
ON_BUMP, ELSEWHERE = ("passive", "mpc", "mpc-preview"), ("passive", *WITHOUT_PREVIEW, "mpc")  # what claims are about
CONTROLLED = {"controller": (*WITHOUT_PREVIEW, "mpc", "mpc-preview")}


def _opening(mm: float) -> Reading:
    """The passive car's valves, where the main study leaves them to the actuator's FMU."""
    return (Change(Case, {"null_opening_mm": mm}, {"controller": "passive", "null_opening_mm": None}),)


READINGS: dict[str, Reading] = {
    AS_READ: (),
    "null opening 4 mm": _opening(min(NULL_OPENINGS_MM)),
    "null opening 6.75 mm": _opening(max(NULL_OPENINGS_MM)),
    "accumulator that never empties": (Change(Case, {"flow_limit": False}, CONTROLLED),),
    "no accumulator, one pump for each actuator": (Change(Case, {"flow_limit": True}, CONTROLLED),),
    "no accumulator, one pump for all": (Change(Case, {"flow_limit": True, "shared_pump": True}, CONTROLLED),),
    "density of real oil": (
        Change(Case, {"density": PHYSICAL_DENSITY}),
        Change(TrackingCase, {"actuator": "physical"}, {"signal": PUBLISHED}),
    ),
    "dry friction in the car, none at the corner": (
        Change(Case, {"friction": True}),
        Change(TrackingCase, {"friction": False}, {"signal": PUBLISHED}),
    ),
    "LQR weights with the force in kN": (Change(Case, {"controller": "lqr-kilonewton"}, {"controller": "lqr"}),),
    "preview 20 ms late": (Change(Case, {"preview_error_ms": 20.0}, {"controller": "mpc-preview"}),),
    "a tenth of the sensors' noise": (Change(PreviewCase, {"noise": 0.1}, {"noise": 1.0}),),
    "off road of class D": (Change(Case, {"terrain": "D"}, {"road": "off-road"}),),
}
MORE: dict[str, Reading] = {
    "tires that take tension": (Change(Case, {"lift_off": False}),),
    "estimated states": (Change(Case, {"states": "estimated"}, {"controller": ("skyhook", "lqr", *ON_BUMP[1:])}),),
}


def needs() -> list[Any]:
    """The runs on which the claims of the main study rest."""
    cars = [Case(road, c) for road in ROADS for c in (ON_BUMP if road == "bump" else ELSEWHERE)]
    cars = [at(case) for case in cars for at in CONDITIONS]
    cars += [Case(road, "passive", null_opening_mm=mm) for road in ("track", "bump") for mm in NULL_OPENINGS_MM]
    runs = list(dict.fromkeys(chain(*map(places, cars))))
    own = {"actuator": "paper", "friction": True, "extrapolate": True, "integral": None, "exchange_parts": 1}
    variants = [c for c in VARIANTS.values() if all(getattr(c, n) == v for n, v in own.items())]
    corner = [TrackingCase(FILTER), *(replace(c, signal=s) for c in variants for s in PUBLISHED)]
    runs += [finer(run) for run in runs if run.null_opening_mm is None]
    return [*runs, *corner, *(t.case for t in plan_preview() if not t.case.dropout)]


STUDY = ReadingsStudy(
    hmmwv.EXPERIMENT,
    needs,
    ("cosim.experiments.hmmwv.claims:CLAIMS",),
    READINGS,
    f"judge at half the steps of solver and exchange too, and {len(MORE)} more readings",
    MORE,
    short=(Change(Case, {"solver_parts": 1, "exchange_parts": 1}),),
    notes=(
        "The height of the CG: the paper's vehicle has seven degrees of freedom and drives straight at one speed, so no"
        " force acts along or across the road that a height could turn into pitch or roll.",
        "An accumulator of finite size: the actuator FMUs model no accumulator. A pump that holds its pressure at any"
        " flow is one that never empties, and a pump with its limit has no accumulator; over a bump the former is"
        " nearer, off road the latter.",
        "Springs, dampers and masses per wheel instead of per axle (Appendix 1.C): the controllers are designed on the"
        " vehicle, so that is another vehicle file, not an option of a run.",
    ),
)
EXPERIMENT = STUDY.experiment("hmmwv-readings", "HMMWV with hydraulic actuators: other readings (paper 001)", __name__)
