"""Web page: the HMMWV on passive and semi-active dampers under their control laws side by side, and active."""

from __future__ import annotations

from dataclasses import replace

from cosim.experiments.semi_active.published import NAMES, SYSTEMS
from cosim.experiments.semi_active.runs import CORNERS, METRICS, Case
from cosim.export.web.page import Control, How, Measure, WebPage
from cosim.study.web import Live, LiveCase
from fmu_sources.roads.iso8608 import CLASSES

COMPARED = {
    "hooks": ("passive", "skyhook", "groundhook", "sh-add"),
    "designed on a model": ("passive", "lqr", "mpc", "lqr, ideal"),
}
ROADS = {"random": "random road", "bump": "a bump"}
SLOWEST, FASTEST = 10.0, 80.0  # km/h, that the page offers
_MEASURED: dict[str, tuple[list[str], How, int]] = {  # metric -> outputs, how, decimals
    "body_rms": (["car.body.az"], "rms", 2),
    "tire_rms": ([f"car.tire.{k}.deflection" for k in CORNERS], "rms", 2),
    "travel_rms": ([f"car.suspension.{k}.deflection" for k in CORNERS], "rms", 1),
    "force_rms": ([f"damper_{k}.force" for k in CORNERS], "rms", 0),
}


def live(case: Case) -> Live:
    """The car under four control laws at a time, on each road; speed, road and hysteresis are those of the case."""
    cases = [
        LiveCase(
            NAMES[s],
            replace(
                case, controller=SYSTEMS[s].controller, actuators=SYSTEMS[s].actuators, road=road, road_holding=None
            ),
            group=f"{group}, {words}",
        )
        for road, words in ROADS.items()
        for group, systems in COMPARED.items()
        for s in systems
    ]
    measures = []
    for name, (outputs, how, decimals) in _MEASURED.items():
        metric, worst = METRICS[name], ", worst wheel" if len(outputs) > 1 else ""
        text = metric.text.removesuffix(" or actuator") + worst
        measures.append(Measure(text, outputs, how, metric.unit, metric.factor, decimals=decimals))
    page = WebPage(
        "Compare semi-active dampers",
        "Four HMMWVs on one road: on passive dampers, and on dampers whose force a current sets between two measured"
        " curves, under different control laws. Apart from its hysteresis, such a damper only takes energy from the"
        " car; an active suspension also gives it. Which one is good for the driver, which for the tires?",
        controls=[
            Control("speed", ["speed.start.speed"], SLOWEST / 3.6, FASTEST / 3.6, keys=("ArrowDown", "ArrowUp")),
            Control("roughness, ISO 8608 class", ["road.class"], choices={c: float(i) for i, c in enumerate(CLASSES)}),
            Control(
                "hysteresis of the dampers",
                [f"damper_{k}.hysteresis.speed" for k in CORNERS],
                0.0,
                0.2,
                text="by which the velocity in the curve of a damper is shifted",
            ),
            Control("sprung mass", ["car.body.mass"], 1500.0, 4500.0),
        ],
        plots=["car.body.az", f"car.tire.{CORNERS[0]}.deflection", f"damper_{CORNERS[0]}.force"],
        measures=measures,
        group_label="comparison",
    )
    return Live(page, cases)
