"""Claims, tables and figures of paper 001's vehicle runs as a report."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from cosim.comfort import ABSORBED_POWER_LIMIT
from cosim.experiments import hmmwv
from cosim.experiments.cases import FmuSet
from cosim.experiments.hmmwv import BUMPS, CONTROLLERS, ROADS, SHIFTS, SPEED_KMH, STRETCHES, Case
from cosim.experiments.hmmwv_claims import NAMES, claims
from cosim.experiments.hmmwv_study import HISTORY_VARIANT, LIMITED, NULL_OPENINGS_MM, Study
from cosim.experiments.store import content_hash
from cosim.report import Figure, Panel, Parameter, Report, Result, Section, Series, Table, write_report
from cosim.report.model import Scalar
from fmu_sources.catalog import PAPERS

_ROADS = {"track": "test track", "bump": "one 76 mm bump", "off-road": "off road"}
_LOOKS = {
    "passive": ("grey", "solid"),
    "zero": ("sky", "dot"),
    "skyhook": ("orange", "dash"),
    "lqr": ("blue", "dashdot"),
    "lqr-kilonewton": ("purple", "longdash"),
}
_READINGS = {  # W, an independent calculation of the same vehicle
    ("track", "passive"): "17 to 21", ("track", "zero"): "6.8", ("track", "skyhook"): "7.3", ("track", "lqr"): "6.8",
    ("bump", "passive"): "19 to 23", ("bump", "zero"): "11.1", ("bump", "skyhook"): "11.7", ("bump", "lqr"): "11.0",
    ("off-road", "skyhook"): "8 to 9.8", ("off-road", "lqr"): "7.8 to 9.6",
}  # fmt: skip


def write(study: Study, fmus: FmuSet, directory: Path) -> Path:
    """Write report.html, summary.json and CSV files; returns the path of the page."""
    return write_report(report(study, fmus), directory)


def report(study: Study, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    return Report(
        experiment="hmmwv",
        title="Active suspension of a HMMWV with hydraulic actuators",
        lead=(
            f"A HMMWV drives at 20 mph ({SPEED_KMH:.1f} km/h) over speed bumps and off road. Each wheel has a hydraulic actuator whose "
            "servo valve is commanded every millisecond by a force tracking controller; a controller of the whole vehicle gives "
            "the forces every 30 ms. The passive car is the same car with the pump off. The figure of merit is the power that a "
            "driver absorbs. Every box is a native FMU; the statements of Donahue and Hedrick stand beside what these runs give."
        ),
        claims=claims(study),
        results=[
            Result(f"absorbed power, {_ROADS[road]}, {NAMES[c]}", round(study.power(Case(road, c)), 2), "W")
            for road in ROADS
            for c in ("passive", "lqr")
        ],
        sections=[
            _overview(study),
            _test_track(study),
            _off_road(study),
            _actuators(study),
            _passive(study),
            _limits(),
        ],
        parameters=_parameters(),
        provenance={
            "versions": {n: metadata.version(n) for n in ("suspension-fmus", "numpy", "scipy", "casadi")},
            "papers": PAPERS,
            "FMI version": f"{fmus.fmi}.0",
            "FMUs (SHA-256)": {n: content_hash([fmus.path(n)]) for n in hmmwv.all_fmus()},
            "bump positions per control period": SHIFTS,
            "off-road stretches": STRETCHES,
        },
    )


def _series(name: str, x: Any, y: Any) -> Series:
    color, dash = _LOOKS[name]
    return Series(NAMES[name], x, y, color=color, dash=dash)  # type: ignore[arg-type]


def _overview(study: Study) -> Section:
    rows: list[list[Scalar]] = []
    for road in ROADS:
        for controller in CONTROLLERS:
            case = Case(road, controller)
            low, high = study.spread("absorbed_power", case)
            ideal = None if controller == "passive" else study.power(Case(road, controller, actuators="ideal"))
            rows.append(
                [
                    _ROADS[road],
                    NAMES[controller],
                    round(study.power(case), 2),
                    round(low, 2),
                    round(high, 2),
                    _READINGS.get((road, controller), "-"),
                    None if ideal is None else round(ideal, 2),
                    round(study.mean("iso2631_rms", case), 2),
                    round(1e3 * study.mean("travel_rms", case), 1),
                    round(1e3 * study.mean("travel_peak", case), 0),
                    round(100 * study.mean("lift_off", case), 1),
                    round(study.mean("force_rms", case), 0),
                ]
            )
    return Section(
        "Absorbed power",
        [
            "Over bumps the figure is the peak of a moving mean over 1 s, off road the mean of the run, both from the heave of the CG. "
            f"Over bumps it is the mean over {SHIFTS} places of the bump between two samples of the controller, off road over "
            f"{STRETCHES} stretches of a class E road.",
            "Ideal actuators give the force that the controller asks for, at once. What hydraulics cost is large: the force "
            "tracking follows the desired force in the middle of a bump only after its valve has come back from saturation.",
        ],
        tables=[
            Table(
                "absorbed-power",
                "Absorbed power and what goes with it",
                [
                    "road", "controller", "absorbed power [W]", "lowest [W]", "highest [W]", "expected [W]",
                    "with ideal actuators [W]", "ISO 2631 rms [m/s2]", "travel rms [mm]", "largest travel [mm]",
                    "tyre off the ground [%]", "force rms [N]",
                ],
                rows,
                "Expected: an independent calculation of the same vehicle. Tyre off the ground: part of the time in which the linear "
                "tyre pulls, which a real one cannot.",
            )
        ],
    )  # fmt: skip


def _history(study: Study, road: str, controller: str) -> dict[str, np.ndarray]:
    row = study.histories[Case(road, controller, variant=HISTORY_VARIANT)]
    return {k: np.asarray(v) for k, v in row.items() if isinstance(v, list)}


def _power_panel(study: Study, road: str, controllers: tuple[str, ...]) -> Panel:
    curves = []
    for c in controllers:
        h = _history(study, road, c)
        curves.append(_series(c, h["x"], h["power_window"]))
    x = curves[0].x_values
    limit = Series("limit of the driver", [x[0], x[-1]], [ABSORBED_POWER_LIMIT] * 2, color="black", dash="dot")
    return Panel(_ROADS[road], "distance of the CG [m]", "absorbed power over 1 s [W]", [*curves, limit])


def _test_track(study: Study) -> Section:
    controllers = ("passive", "zero", "skyhook", "lqr")
    tracking = _history(study, "track", "lqr")
    return Section(
        "Test track",
        [
            "Figure 1.9: two bumps, 57 and 38 mm high, 6 m apart. All controllers without preview come out alike, as published: "
            "what they take away is the damping of the closed cylinders.",
        ],
        figures=[
            Figure(
                "figure-1-9",
                "Figure 1.9: test track",
                "Absorbed power of the last second over the distance, and what the front left actuator does under the LQR.",
                [
                    _power_panel(study, "track", controllers),
                    Panel(
                        "force at the front left wheel, LQR",
                        "distance of the CG [m]",
                        "force [N]",
                        [
                            Series("desired, smoothed", tracking["x"], tracking["smoothed"], color="black"),
                            Series("actuator", tracking["x"], tracking["force"], color="vermilion"),
                        ],
                    ),
                ],
            ),
            Figure(
                "one-bump",
                "One 76 mm bump",
                "Absorbed power of the last second.",
                [_power_panel(study, "bump", controllers)],
            ),
        ],
    )


def _off_road(study: Study) -> Section:
    controllers = ("passive", "zero", "skyhook", "lqr")
    travels = []
    for c in controllers:
        h = _history(study, "off-road", c)
        travels.append(_series(c, h["x"], 1e3 * h["travel_fl"]))
    x = travels[0].x_values
    travels += [
        Series(
            "limit of travel",
            [x[0], x[-1], np.nan, x[0], x[-1]],
            [60, 60, np.nan, -60, -60],
            color="black",
            dash="dash",
        )
    ]
    return Section(
        "Off road",
        ["Figure 1.10: a random road of ISO 8608 class E, smoothed over the contact of the tyre."],
        figures=[
            Figure(
                "figure-1-10",
                "Figure 1.10: off road",
                "Absorbed power of the last second, and travel of the front left suspension, on the first stretch.",
                [
                    _power_panel(study, "off-road", controllers),
                    Panel("suspension", "distance of the CG [m]", "travel, front left [mm]", travels),
                ],
            )
        ],
    )


def _actuators(study: Study) -> Section:
    rows: list[list[Scalar]] = []
    for road in ROADS:
        for controller in CONTROLLERS:
            if controller == "passive":
                continue
            case = Case(road, controller)
            limited = round(study.power(Case(road, controller, flow_limit=True)), 2) if controller in LIMITED else None
            rows.append(
                [
                    _ROADS[road],
                    NAMES[controller],
                    round(study.mean("flow_mean", case), 0),
                    round(study.mean("flow_peak", case), 0),
                    round(1e-3 * study.mean("power_mean", case), 1),
                    round(100 * study.mean("saturation", case), 1),
                    round(study.mean("tracking_error_rms", case), 0),
                    round(study.power(case), 2),
                    limited,
                ]
            )
    return Section(
        "What the hydraulics do",
        [
            "The published runs are without the limit of the pump: it holds its pressure at any flow. Each actuator of the limited runs "
            "gets 45 l/min at most, the flow of the pump for one of them; the pump of the vehicle has that for all four, and an "
            "accumulator that the paper does not describe. The demand is far above either.",
        ],
        tables=[
            Table(
                "hydraulics",
                "Flow of all four actuators, saturation and tracking",
                [
                    "road", "controller", "flow, mean [l/min]", "flow, peak [l/min]", "power from the pump, mean [kW]",
                    "valve saturated [%]", "force error rms [N]", "absorbed power [W]", "with flow limit [W]",
                ],
                rows,
                "Mean flow: over bumps the largest mean over 1 s, off road that of the run.",
            )
        ],
    )  # fmt: skip


def _passive(study: Study) -> Section:
    rows: list[list[Scalar]] = [
        [_ROADS[road], mm, round(study.power(Case(road, "passive", null_opening_mm=mm)), 1)]
        for road in ("track", "bump")
        for mm in NULL_OPENINGS_MM
    ]
    return Section(
        "The passive car",
        [
            "The paper emulates the passive car with the pump off and the valves unpowered. How far an unpowered spool stays open is "
            "not given; 5 mm is assumed here. A closed one would lock the struts. The absorbed power of the passive car, and with it every "
            "ratio to it, depends on this opening.",
        ],
        tables=[
            Table(
                "null-opening",
                "The passive car over the opening of its unpowered spools",
                ["road", "null opening [mm]", "absorbed power [W]"],
                rows,
            )
        ],
    )


def _limits() -> Section:
    return Section(
        "What differs from the paper",
        [
            "The paper measured on a vehicle; these are runs of the linear seven-degree model that its controllers are designed on. Tyres are "
            "linear and pull where they would lift off.",
            "Roads: the bumps' shape, which bumps stood where and the off-road terrain are not in the paper. A bump is a parabola "
            f"0.305 m long smoothed over 0.25 m of contact, {', '.join(f'{1e3 * h:g} mm' for h in BUMPS['track'].values())} high on the "
            "track; off road is class E of ISO 8608.",
            "The weights of the LQR are taken in SI units with the force in newtons; taken in kilonewtons the regulator works "
            "up to its limit of 8 kN. Both are in the table.",
            "The human response filter of the paper takes acceleration in ft/s2; the print says m/s2, with which every car "
            "would be below 6 W.",
        ],
    )


def _parameters() -> list[Parameter]:
    from build_fmus.component import Component
    from fmu_sources.catalog import Context, default_catalog

    rows = []
    nowhere = Context(Path(), Path())
    for name in ("RideCarHmmwv", "HydraulicActuator", "Skyhook"):
        component: Component = default_catalog()[name].make(nowhere)
        rows += [
            Parameter(f"{name} {e.name}", e.start, e.variable.unit or "-", e.variable.source or "assumed")
            for e in component.elements("parameter")
        ]
    paper = "001 section 1.6"
    return [
        *rows,
        Parameter("speed", round(SPEED_KMH, 3), "km/h", paper),
        Parameter("sample time of the controllers", 1e3 * hmmwv.CONTROL_PERIOD, "ms", "001 section 1.3"),
        Parameter("exchange of car and actuators", hmmwv.EXCHANGE, "-", "assumed: halving it changes nothing visible"),
        Parameter("limit of absorbed power", ABSORBED_POWER_LIMIT, "W", paper),
    ]
