"""Web page: the HMMWV on passive and semi-active dampers under their control laws side by side, and active."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cosim.experiments.page_parts import ROUGHNESS, SPRUNG_MASS, at_corners, shown_as, speed_control
from cosim.experiments.semi_active.published import NAMES, SYSTEMS
from cosim.experiments.semi_active.runs import CORNERS, METRICS, Case
from cosim.export.web.page import Control, WebPage
from cosim.study.web import Live, LiveCase

COMPARED = {
    "hooks": ("passive", "skyhook", "groundhook", "sh-add"),
    "designed on a model": ("passive", "lqr", "mpc", "lqr, ideal"),
}
ROADS = {"random": "random road", "bump": "a bump"}
SPEEDS = 10.0, 80.0  # km/h, that the page offers
_SHIFT = "by which the velocity in the curve of a damper is shifted"
_AT_WHEELS = {  # metric -> output at each wheel, decimals
    "tire_rms": ("car.tire.{}.deflection", 2),
    "travel_rms": ("car.suspension.{}.deflection", 1),
    "force_rms": ("damper_{}.force", 0),
}


def live(case: Case) -> Live:
    """The car under four control laws at a time, on each road; speed, road and hysteresis are those of the case."""
    of_system: dict[str, Any] = {s: {"controller": c.controller, "actuators": c.actuators} for s, c in SYSTEMS.items()}
    cases = [
        LiveCase(NAMES[s], replace(case, **of_system[s], road=road, road_holding=None), group=f"{group}, {words}")
        for road, words in ROADS.items()
        for group, systems in COMPARED.items()
        for s in systems
    ]
    measures = [shown_as(METRICS["body_rms"], ["car.body.az"], "rms")]
    for name, (output, decimals) in _AT_WHEELS.items():
        words = f"{METRICS[name].text.removesuffix(' or actuator')}, worst wheel"
        measures.append(shown_as(METRICS[name], at_corners(output), "rms", words, decimals))
    page = WebPage(
        "Compare semi-active dampers",
        "Four HMMWVs on one road: on passive dampers, and on dampers whose force a current sets between two measured"
        " curves, under different control laws. Apart from its hysteresis, such a damper only takes energy from the"
        " car; an active suspension also gives it. Which one is good for the driver, which for the tires?",
        controls=[
            speed_control("speed.start.speed", *SPEEDS),
            ROUGHNESS,
            Control("hysteresis of the dampers", at_corners("damper_{}.hysteresis.speed"), 0.0, 0.2, text=_SHIFT),
            SPRUNG_MASS,
        ],
        plots=["car.body.az", f"car.tire.{CORNERS[0]}.deflection", f"damper_{CORNERS[0]}.force"],
        measures=measures,
        group_label="comparison",
    )
    return Live(page, cases)
