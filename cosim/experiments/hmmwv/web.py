"""The HMMWV to drive: passive, LQR and MPC side by side on one road, in a web page."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cosim.experiments.hmmwv.runs import Case
from cosim.experiments.page_parts import ROUGHNESS, SPRUNG_MASS, at_corners, largest_travel, speed_control
from cosim.export.web.page import Control, Measure, WebPage
from cosim.study.web import Live, LiveCase
from fmu_sources.models.corners import CORNERS

COURSES = {"off-road": "off road", "track": "raisers of 38 mm", "bump": "a bump of 76 mm"}
SYSTEMS: dict[str, dict[str, Any]] = {
    "Passive": {"controller": "passive"},
    "LQR": {"controller": "lqr"},
    "MPC": {"controller": "mpc"},
    "MPC that sees the road": {"controller": "mpc-preview", "states": "estimated", "preview": "sensed"},
}
FASTEST = 60.0  # km/h


def live(case: Case) -> Live:
    """Four vehicles under one driver on each course; what else the case says holds for all of them."""
    sight = {n: getattr(Case, n) for n in ("preview", "preview_steps", "preview_error_ms")}
    base = replace(case, controller="lqr", states="true", driven=True, **sight)
    cases = [
        LiveCase(title, replace(base, road=road, **changes), group=course)
        for road, course in COURSES.items()
        for title, changes in SYSTEMS.items()
    ]
    page = WebPage(
        "Drive the HMMWV",
        "Four HMMWVs under one driver on one road: passive, with LQR, with MPC, and with MPC that sees the road ahead"
        " through two range sensors and estimates its state with a Kalman filter (paper 001). You set speed and course;"
        " everything is computed here, live.",
        controls=[
            speed_control("speed.target.speed", 0.0, FASTEST),
            Control("preview that the MPC uses", ["controller.preview.used"], text="heights ahead, 30 ms apart"),
            Control("range sensors off", ["sensors.range.off"]),
            SPRUNG_MASS,
            ROUGHNESS,
        ],
        plots=["car.body.az", f"car.suspension.{CORNERS[0]}.deflection", f"controller.force.{CORNERS[0]}"],
        measures=[
            Measure("absorbed power, largest over 1 s", ["comfort.absorbed_power.peak"], "largest", "W"),
            Measure("vertical acceleration, rms", ["car.body.az"], "rms", "m/s2"),
            largest_travel(),
            Measure("tire deflection, rms", at_corners("car.tire.{}.deflection"), "rms", "mm", 1e3, decimals=1),
            Measure("actuator force, largest", at_corners("actuator_{}.force"), "peak", "kN", 1e-3),
        ],
        group_label="course",
    )
    return Live(page, cases)
