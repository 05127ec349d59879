"""Trenches to cross: the 6x6 passive, with LQR and with MPC, in a web page that says who gets across."""

from __future__ import annotations

import math
from dataclasses import replace

from cosim.core.content_checks import split_label
from cosim.experiments.metrics.crossing import LABELS, LIMITS
from cosim.experiments.trench.runs import APPROACH, CLEAR, LEAD, RUN_OUT, STEP, TOUCH, Case
from cosim.export.web.page import Control, Finish, How, Measure, WebPage
from cosim.scenes.scene import Value
from cosim.study.web import Live, LiveCase
from fmu_sources.models.corners import SIX_CORNERS

SYSTEMS = {"Passive": "passive", "LQR": "lqr", "MPC": "mpc"}
SLOWEST, FASTEST = 1.0, 15.0  # km/h, that the page offers
PATIENCE = 60.0  # s: longer than at the slowest over the longest
FIRST, LAST = (f"car.wheel.{k}.x" for k in (SIX_CORNERS[0], SIX_CORNERS[-2]))
START = [
    Value({FIRST: 1.0, "car.outline.front_overhang": 1.0}, CLEAR),
    Value({FIRST: 1.0, "car.target.speed": LEAD[1] + APPROACH}, LEAD[0] + CLEAR),
]
"""Where the trench begins, the larger of both: as `cosim.experiments.trench.runs.Course` has it."""
_HUBS = [[f"car.hub.{k}.fx" for k in SIX_CORNERS[i : i + 2]] for i in (0, 2, 4)]
_MEASURED: dict[str, tuple[list[str], How, float]] = {  # quantity of Table 5.3 -> outputs, how, factor
    "az": (["car.body.az"], "peak", 1.0),
    "ax": (["car.body.ax"], "peak", 1.0),
    "az_rms": (["car.body.az"], "rms", 1.0),
    "ax_rms": (["car.body.ax"], "rms", 1.0),
    "pitch": (["car.body.pitch"], "peak", math.degrees(1.0)),
    "hub_front": (_HUBS[0], "peak", 1e-3),
    "hub_middle": (_HUBS[1], "peak", 1e-3),
    "hub_rear": (_HUBS[2], "peak", 1e-3),
}


def live(case: Case) -> Live:
    """The vehicle with each controller before one trench; what else the case says holds for all of them."""
    cases = [LiveCase(title, replace(case.passive(), controller=controller)) for title, controller in SYSTEMS.items()]
    measures = []
    for quantity, label in LABELS.items():
        (words, unit), (names, how, factor) = split_label(label), _MEASURED[quantity]
        measures.append(Measure(words, names, how, unit, factor, getattr(LIMITS, quantity)))
    page = WebPage(
        "Cross the trench",
        "A 6x6 drives over a trench: passive, with LQR, and with an MPC that sees the trench coming and lifts its"
        " wheels over it (paper 003). Make it longer, deeper or faster until a vehicle fails. The limits are those of"
        " the paper.",
        controls=[
            Control("length of the trench", ["car.trench.length"], 0.2, 2.5, keys=("ArrowLeft", "ArrowRight")),
            Control("depth of the trench", ["car.trench.depth"], 0.05, 3.0),
            Control("right wheels meet it later by", ["car.trench.right_offset"], 0.0, 2.0),
            Control(
                "speed",
                ["car.target.speed"],
                SLOWEST / 3.6,
                FASTEST / 3.6,
                keys=("ArrowDown", "ArrowUp"),
                follows={"car.trench.start": START},
            ),
            Control("sprung mass", ["car.body.mass"], 8000.0, 26000.0),
        ],
        plots=["car.body.pitch", "car.body.az", f"controller.force.{SIX_CORNERS[0]}"],
        measures=[*measures, Measure("force on the belly", ["car.belly.force"], "largest", "kN", 1e-3, TOUCH / 1e3, 3)],
        finish=Finish(
            Value({"car.x": 1.0, "car.trench.start": -1.0, "car.trench.length": -1.0, LAST: 1.0}, -RUN_OUT), PATIENCE
        ),
        interval=STEP,
    )
    return Live(page, cases)
