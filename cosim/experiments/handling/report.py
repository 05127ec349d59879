"""Tables and figures of the handling study as a report."""

from __future__ import annotations

from dataclasses import replace
from math import pi

from cosim.experiments.handling import EXPERIMENT
from cosim.experiments.handling.published import at, j_turns
from cosim.experiments.handling.runs import CARS, MANOEUVRES, METRICS
from cosim.report import Figure, Panel, Parameter, Series, Table, curve
from cosim.study import Content, FmuSet, Results, StudyReport, parameters

NAMES = {
    "hmmwv": "HMMWV",
    "modified": "modified HMMWV",
    "tires": "modified HMMWV, tires by file",
    "public": "public HMMWV",
}
DEG = 180 / pi
_SHOWN = (
    ("wheel", "steering wheel [deg]", DEG),
    ("yaw_rate", "yaw rate [deg/s]", DEG),
    ("ay", "lateral acceleration [m/s2]", 1.0),
)


def _parameters(fmus: FmuSet) -> list[Parameter]:
    return [replace(p, name=f"{NAMES[c]}: {p.name}") for c, fmu in CARS.items() for p in parameters(fmus.path(fmu))]


report = StudyReport(
    EXPERIMENT,
    "Handling of the full cars",
    parameters=_parameters,
    looks=dict(zip(NAMES.values(), ("blue", "orange", "purple", "green"), strict=True)),
)


@report.lead
def _main_result(study: Results) -> Content:
    found = ", ".join(
        f"{NAMES[c]} {METRICS['understeer'].shown(study[at(c, 'steady')].get('understeer'))} deg per m/s2" for c in CARS
    )
    yield f"Understeer gradients at small lateral acceleration: {found}."
    yield Figure("main-result", "Lateral acceleration against steering wheel angle", "ISO 4138.", [_against(study)])


def _against(study: Results) -> Panel:
    curves = []
    for c in CARS:
        s = study.signals(at(c, "steady"))
        degrees = [DEG * w for w in s["wheel"]]
        curves.append(Series(NAMES[c], degrees, s["ay"]))
    return Panel("", "steering wheel [deg]", "lateral acceleration [m/s2]", curves)


def _figure(study: Results, manoeuvre: str, *, rough: bool = False) -> Figure:
    runs = {NAMES[c]: study.signals(at(c, manoeuvre, rough=rough)) for c in CARS}
    panels = [Panel("", "time [s]", label, [curve(n, s, of, k) for n, s in runs.items()]) for of, label, k in _SHOWN]
    title = MANOEUVRES[manoeuvre].about + (", rough road" if rough else "")
    return Figure(manoeuvre + "-rough" * rough, title[0].upper() + title[1:], "", panels, columns=3)


@report.section("Open-loop manoeuvres")
def _open_loop(study: Results) -> Content:
    yield """The steering wheel follows a table; the speed is kept by the car's own driver in steady cornering, step and
    sine, and falls with resistance and brakes in the others."""
    for manoeuvre in ("step", "sine", "brake-in-turn", "sine-with-dwell"):
        yield _figure(study, manoeuvre)
    yield _figure(study, "step", rough=True)


@report.section("Lane changes with a driver")
def _lanes(study: Results) -> Content:
    yield "The FMU Driver follows the path; the lanes are those of the standards in our simplification as one line."
    for manoeuvre in ("lane-change", "obstacle"):
        runs = {NAMES[c]: study.signals(at(c, manoeuvre)) for c in CARS}
        x, y = zip(*MANOEUVRES[manoeuvre].path, strict=True)
        path = [Series("path", x, y, color="black", dash="dot")]
        track = [curve(n, s, "y", x="x") for n, s in runs.items()]
        gg = [curve(n, s, "ax", x="ay") for n, s in runs.items()]
        yield Figure(
            manoeuvre,
            MANOEUVRES[manoeuvre].about,
            "Track and g-g diagram.",
            [
                Panel("", "distance [m]", "lateral position [m]", track + path),
                Panel("", "lateral acceleration [m/s2]", "longitudinal acceleration [m/s2]", gg),
            ],
            columns=2,
        )


@report.section("Rollover")
def _rollover(study: Results) -> Content:
    yield """A fast step of the steering wheel without pedals. A rollover index of 1 means that all wheels of one side
    have lifted; a run that ends early has turned over."""
    curves = []
    for c in CARS:
        runs = [t for t in j_turns(c) if "rollover" in study[t]]
        curves.append(
            Series(NAMES[c], [t.wheel_deg for t in runs], [study[t]["rollover"] for t in runs], mode="line+markers")
        )
    yield Figure(
        "rollover",
        "Rollover index over the angle of the steering wheel",
        "J-turns.",
        [Panel("", "steering wheel [deg]", "largest rollover index [-]", curves)],
    )


@report.section("Metrics")
def _metrics(study: Results) -> Content:
    yield "The definitions are in the module `cosim.experiments.handling.metrics`."
    rows = (
        {"manoeuvre": m, "car": NAMES[c]} | {v.heading: v.shown(study[at(c, m)].get(k)) for k, v in METRICS.items()}
        for m in MANOEUVRES
        for c in CARS
    )
    yield Table.of("metrics", "All manoeuvres", rows, "A dash: the manoeuvre does not have this metric.")
