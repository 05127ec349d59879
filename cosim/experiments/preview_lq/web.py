"""Web page: the sedan over a hole and a bump, the value of delay and preview; its table is the paper's Table 3."""

from __future__ import annotations

from dataclasses import replace

from cosim.experiments.preview_lq.published import PAPER_COLUMNS, WEIGHT_NAMES
from cosim.experiments.preview_lq.runs import CONTROLLERS, DURATION, EXCHANGE, INPUTS, PREVIEW_TIME, Case
from cosim.export.web.page import Control, Finish, Measure, WebPage
from cosim.study.web import Live, LiveCase
from fmu_sources.catalog import LQ_PREVIEW

_POINTS, _STEP = LQ_PREVIEW
LONGEST = (_POINTS - 1) * _STEP  # s of preview that the controllers can use
_WEIGHTS = (  # words, parameters, largest
    ("heave", ["acceleration.heave"], 30.0),
    ("pitch", ["acceleration.pitch"], 80.0),
    ("roll", ["acceleration.roll"], 10.0),
    ("suspension deflection", ["suspension.front", "suspension.rear"], 4e4),
    ("tire deflection", ["tire.front", "tire.rear"], 4e5),
    ("actuator forces", ["force.front", "force.rear"], 1e-5),
)
TITLES = {
    "passive": "Passive",
    "active": "Active",
    "delay": "Active, front wheels seen by the rear",
    "preview": "Active with preview",
}


def live(case: Case) -> Live:
    """The four systems of Table 3 with the weights of each design; what else the case says holds for all of them."""
    base = replace(case, controller="active", preview_time=PREVIEW_TIME)
    cases = [
        LiveCase(TITLES[c], replace(base, controller=c, weights=weights, tunable=c != "passive"), group=words)
        for weights, words in WEIGHT_NAMES.items()
        for c in CONTROLLERS
    ]
    page = WebPage(
        "Tune the preview LQ",
        "A sedan meets a hole and a bump: passive, with optimal active suspension, with one whose rear wheels know what"
        " the front ones met, and with one that sees the road ahead (paper 004). The table is the paper's Table 3: mean"
        " squares in per cent of the passive car's. When you change a weight, the controller is redesigned.",
        controls=[
            Control(
                "preview ahead of the front wheels",
                ["controller.preview_time"],
                0.0,
                LONGEST,
                keys=("ArrowLeft", "ArrowRight"),
            ),
            Control("speed", ["speed.start.speed"], 5.0 / 3.6, 120.0 / 3.6, keys=("ArrowDown", "ArrowUp")),
            Control("wheels that meet it", ["road.side"], choices={k: float(v) for k, v in INPUTS.items()}),
            Control("depth of the hole", ["road.hole.depth"], 0.0, 0.15),
            Control("height of the bump", ["road.bump.height"], 0.0, 0.15),
            Control(
                "sprung mass",
                ["car.body.mass"],
                800.0,
                2500.0,
                text="the controller is designed for the car's initial parameters",
            ),
            *(
                Control(f"weight of {words}", [f"controller.weight.{n}" for n in names], None, most)
                for words, names, most in _WEIGHTS
            ),
        ],
        plots=["car.body.z", "car.body.pitch", "controller.force.fl"],
        measures=[Measure(n, [f"car.{n}"], "mean square", decimals=1, relative=True) for n in PAPER_COLUMNS],
        finish=Finish(None, DURATION),
        pace=0.1,
        group_label="weights for",
        interval=EXCHANGE,
    )
    return Live(page, cases)
