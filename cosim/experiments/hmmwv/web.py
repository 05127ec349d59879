"""The HMMWV to drive: passive, LQR and MPC side by side on one road, in a web page."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cosim.experiments.hmmwv.runs import PREVIEW_STEPS, Case
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
FASTEST = 60 / 3.6  # m/s


def live(case: Case) -> Live:
    """Four vehicles under one driver on each course; what else the case says holds for all of them."""
    base = replace(
        case,
        controller="lqr",
        states="true",
        preview="generated",
        preview_steps=PREVIEW_STEPS,
        preview_error_ms=0.0,
        driven=True,
    )
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
            Control("speed", ["speed.target.speed"], 0.0, FASTEST, keys=("ArrowDown", "ArrowUp")),
            Control("preview that the MPC uses", ["controller.preview.used"], text="heights ahead, 30 ms apart"),
            Control("range sensors off", ["sensors.range.off"]),
            Control("sprung mass", ["car.body.mass"], 1500.0, 4500.0),
            Control(
                "roughness, ISO 8608 class", ["road.class"], choices={n: float(i) for i, n in enumerate("ABCDEFGH")}
            ),
        ],
        plots=["car.body.az", f"car.suspension.{CORNERS[0]}.deflection", f"controller.force.{CORNERS[0]}"],
        measures=[
            Measure("absorbed power, largest over 1 s", ["comfort.absorbed_power.peak"], "largest", "W"),
            Measure("vertical acceleration, rms", ["car.body.az"], "rms", "m/s2"),
            Measure(
                "suspension travel, largest",
                [f"car.suspension.{k}.deflection" for k in CORNERS],
                "peak",
                "mm",
                1e3,
                decimals=0,
            ),
            Measure(
                "tire deflection, rms", [f"car.tire.{k}.deflection" for k in CORNERS], "rms", "mm", 1e3, decimals=1
            ),
            Measure("actuator force, largest", [f"actuator_{k}.force" for k in CORNERS], "peak", "kN", 1e-3),
        ],
        group_label="course",
    )
    return Live(page, cases)
