"""Tables and figures of the handling study as a report."""

from __future__ import annotations

from math import pi

from cosim.experiments.handling import EXPERIMENT, published
from cosim.experiments.handling.claims import CLAIMS
from cosim.experiments.handling.published import at, controlled, controlled_rollover, j_turns, rollover, rough
from cosim.experiments.handling.runs import CARS, MANOEUVRES, METRICS, NAMES, REDESIGNED
from cosim.report import Figure, Panel, Parameter, Series, Table, curve, over_time
from cosim.report.model import Look
from cosim.study import Content, FmuSet, Results, StudyReport, parameters
from cosim.study.pages import cells

LAWS = {
    "passive": "passive (baseline)",
    "skyhook": "skyhook",
    "lqr": "LQR, force in N",
    "lqr-kilonewton": "LQR, force in kN",
    "mpc": "MPC",
    "mpc-preview": "MPC with preview",
    "implicit": "GPC, implicit",
    "explicit": "GPC, explicit",
    "preview": "GPC with preview",
}
_LAW_LOOKS: tuple[Look, ...] = (
    *("black", "sky", "orange", "vermilion", "blue", ("blue", "dash"), "purple", "green", ("green", "dash")),
)
_HANDLING = (
    *("roll_peak", "roll_rate_peak", "transfer_front", "transfer_rear", "rollover", "slip_peak", "offset"),
    *("force_peak", "force_rms", "power_peak", "power_rms"),
)
_TURNING = ("roll_gradient", "roll_peak", "yaw_gain", "response_time")
_COMFORT = ("iso2631_rms", "seat_rms", "absorbed_power_nrmm", "iso2631_rms_cg")
DEG = 180 / pi
_PANELS = (
    ("", "steering wheel [deg]", "wheel", DEG),
    ("", "yaw rate [deg/s]", "yaw_rate", DEG),
    ("", "lateral acceleration [m/s2]", "ay", 1.0),
)


def _parameters(fmus: FmuSet) -> list[Parameter]:
    return [p for c, fmu in CARS.items() for p in parameters(fmus.path(fmu), prefix=f"{NAMES[c]}: ")]


report = StudyReport(
    EXPERIMENT,
    "Handling of the full cars",
    CLAIMS,
    parameters=_parameters,
    looks={
        **dict(zip(NAMES.values(), ("blue", "orange", "purple", "green"), strict=True)),
        **dict(zip(LAWS.values(), _LAW_LOOKS, strict=True)),
    },
)


@report.lead
def _main_result(study: Results) -> Content:
    found = ", ".join(
        f"{NAMES[c]} {METRICS['understeer'].shown(study[at(c, 'steady')].get('understeer'))} deg per m/s2" for c in CARS
    )
    yield f"Understeer gradients at small lateral acceleration: {found}."
    signals = {NAMES[c]: study.signals(at(c, "steady")) for c in CARS}
    curves = [Series(name, [DEG * w for w in s["wheel"]], s["ay"]) for name, s in signals.items()]
    panel = Panel("", "steering wheel [deg]", "lateral acceleration [m/s2]", curves)
    yield Figure("main-result", "Lateral acceleration against steering wheel angle", "ISO 4138.", [panel])


def _figure(study: Results, manoeuvre: str, *, random: bool = False) -> Figure:
    runs = {NAMES[c]: study.signals((rough if random else at)(c, manoeuvre)) for c in CARS}
    title = MANOEUVRES[manoeuvre].about + ", random road" * random
    return Figure(manoeuvre + "-rough" * random, title[0].upper() + title[1:], "", over_time(runs, _PANELS), columns=3)


@report.section("Open-loop manoeuvres")
def _open_loop(study: Results) -> Content:
    yield """The steering wheel follows a table; the speed is kept by the car's own driver in steady cornering, step and
    sine, and falls with resistance and brakes in the others."""
    for manoeuvre in ("step", "sine", "brake-in-turn", "sine-with-dwell"):
        yield _figure(study, manoeuvre)
    yield _figure(study, "step", random=True)


@report.section("Lane changes with a driver")
def _lanes(study: Results) -> Content:
    yield "The FMU Driver follows the path; the lanes are those of the standards in our simplification as one line."
    for manoeuvre in published.LANE_CHANGES:
        runs = {NAMES[c]: study.signals(at(c, manoeuvre)) for c in CARS}
        x, y = zip(*MANOEUVRES[manoeuvre].path, strict=True)
        path = [Series("path", x, y, color="black", dash="dot")]
        track = [curve(n, s, "y", x="x") for n, s in runs.items()]
        gg = [curve(n, s, "ax", x="ay") for n, s in runs.items()]
        panels = [
            Panel("", "distance [m]", "lateral position [m]", track + path),
            Panel("", "lateral acceleration [m/s2]", "longitudinal acceleration [m/s2]", gg),
        ]
        yield Figure(manoeuvre, MANOEUVRES[manoeuvre].about, "Track and g-g diagram.", panels, columns=2)
    yield _figure(study, "lane-change", random=True)


@report.section("Comfort and handling under control of the suspension")
def _suspension(study: Results) -> Content:
    yield f"""The {NAMES[published.CONTROLLED]} drives the lane changes under control laws for its suspension, which
    were made for comfort on a straight road, and straight ahead over the {published.COURSE} course of the study ride.
    GPC (paper 000) was identified on this car. Skyhook has the gains of paper 001. LQR and MPC have its weights and are
    designed on this car near rest. No control law gets the steering or the lateral acceleration, and none weighs the
    driver's seat, which is ahead of the CG. The baseline is the passive car: its springs and dampers alone. Comfort is
    that on the first profile of the course, and actuators are ideal, where nothing else is said."""
    yield Figure(
        "comfort-and-handling",
        "Roll in the lane change against comfort",
        "Down and left is better. Left: comfort of the driver's seat; right: of the CG, which the control laws weigh.",
        [_roll_against(study, metric) for metric in ("iso2631_rms", "iso2631_rms_cg")],
        columns=2,
    )
    yield _law_table(study, "lane-change", "ideal")
    for manoeuvre in published.LANE_CHANGES:
        runs = {name: study.signals(controlled(c, manoeuvre)) for c, name in LAWS.items()}
        panels = over_time(runs, [("", "roll angle [deg]", "roll", DEG)])
        title = f"Roll angle: {MANOEUVRES[manoeuvre].about}"
        yield Figure(f"roll-{manoeuvre}", title, "Positive: left side up.", panels)
    rows = [{"control law": n, **cells(METRICS, study[controlled(c, "obstacle")], _HANDLING)} for c, n in LAWS.items()]
    yield Table.of("control-obstacle", "Obstacle avoidance", rows)
    rows = [
        {"control law": n, **cells(METRICS, study[controlled(c, "step")], _TURNING)}
        | {"steering wheel at which all wheels of a side lift [deg]": _threshold(study.found(controlled_rollover(c)))}
        for c, n in LAWS.items()
    ]
    yield Table.of("control-turns", "Step of the steering wheel, and J-turn", rows, _THRESHOLD)
    yield _law_table(study, "lane-change", "hydraulic")
    yield """The last table is on LQR and MPC as paper 001 designed them, on a car of about half of the mass with
    stiffer springs. On this car, that LQR with cheap forces takes more stiffness than there is, and its forces go to
    their limits."""
    rows = [
        {"control law": LAWS[c], "designed on": where}
        | cells(METRICS, study[controlled(c, "lane-change", design=design)], _HANDLING[:8])
        | cells(METRICS, study[controlled(c, "straight", design=design)], _COMFORT)
        for c in REDESIGNED
        for where, design in (("this car", "car"), ("the car of paper 001", "paper"))
    ]
    yield Table.of("control-designs", "LQR and MPC designed on this car and on that of the paper", rows)


def _roll_against(study: Results, metric: str) -> Panel:
    """Roll in the lane change over a metric of comfort on the course, a point for each control law."""
    points = []
    for c, name in LAWS.items():
        comfort, roll = study[controlled(c, "straight")][metric], study[controlled(c, "lane-change")]["roll_peak"]
        points.append(Series(name, [comfort], [roll * DEG], mode="markers"))
    return Panel("", METRICS[metric].heading, METRICS["roll_peak"].heading, points)


def _law_table(study: Results, manoeuvre: str, actuators: str) -> Table:
    rows = [
        {"control law": name if actuators == "ideal" or c != "passive" else "pump off"}
        | cells(METRICS, study[controlled(c, manoeuvre, actuators)], _HANDLING)
        | cells(METRICS, study[controlled(c, "straight", actuators)], _COMFORT)
        for c, name in LAWS.items()
    ]
    about = "Handling in the lane change; comfort straight ahead. Powers are those that all actuators give to the car."
    return Table.of(f"control-{actuators}", f"Comfort and handling, {actuators} actuators", rows, about)


_THRESHOLD = f"To {published.CLOSE:g} deg; none: not up to {published.J_TURNS[-1]:g} deg, the tires slide before."


def _threshold(angle: float | None) -> str:
    return "none" if angle is None else f"{angle:.0f}"


@report.section("Rollover")
def _rollover(study: Results) -> Content:
    yield """A fast step of the steering wheel without pedals. A rollover index of 1 means that all wheels of one side
    have lifted; a run that ends early has turned over."""
    curves = []
    for c in CARS:
        index = {t.wheel_deg: study[t]["rollover"] for t in j_turns(c) if "rollover" in study[t]}
        curves.append(Series(NAMES[c], [*index], [*index.values()], mode="line+markers"))
    panel = Panel("", "steering wheel [deg]", "largest rollover index [-]", curves)
    yield Figure("rollover", "Rollover index over the angle of the steering wheel", "J-turns.", [panel])
    rows = [{"car": NAMES[c], "steering wheel [deg]": _threshold(study.found(rollover(c)))} for c in CARS]
    yield Table.of("rollover-thresholds", "Smallest angle at which all wheels of a side lift", rows, _THRESHOLD)


@report.section("Metrics")
def _metrics(study: Results) -> Content:
    yield """The definitions are in the module `cosim.experiments.handling.metrics`. Metrics of steady cornering are
    those until the car no longer follows the circle of its steering wheel: until its lateral acceleration differs by
    more than 10 % from speed times yaw rate."""
    rows = ({"manoeuvre": m, "car": NAMES[c], **cells(METRICS, study[at(c, m)])} for m in MANOEUVRES for c in CARS)
    yield Table.of("metrics", "All manoeuvres", rows, "A dash: the manoeuvre does not have this metric.")
