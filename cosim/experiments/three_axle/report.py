"""Tables and figures of the linear part of paper 003 as a report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cosim.experiments.steps import HALVED, halved
from cosim.experiments.three_axle import EXPERIMENT
from cosim.experiments.three_axle.claims import CLAIMS, place_text
from cosim.experiments.three_axle.published import CONTROLLED, SHOWN, VARIANTS, Place, places, variant
from cosim.experiments.three_axle.runs import CONTROLLERS, METRICS, Case, edge_time
from cosim.fmu.file import FmuFile
from cosim.report import Figure, Panel, Parameter, Report, Section, Series, Table, keep_peaks
from cosim.report.model import Scalar
from cosim.study import FmuSet, Results, Row, make_lead, parameters, provenance, sections
from cosim.study.fmus import designed_with
from fmu_sources.models.corners import SIX_CORNERS

_NAMES = {"passive": "passive", "lqr": "LQR", "mpc": "MPC", "mpc-preview": "MPC with preview"}
_LOOKS: Mapping[str, Mapping[str, Any]] = {
    "passive": {"color": "gray"},
    "lqr": {"color": "orange", "dash": "dash"},
    "mpc": {"color": "blue", "dash": "dot"},
    "mpc-preview": {"color": "green"},
}
_REFINED = ("peak_error_deg", "ramp_error_deg", "rms_az", "peak_force_kN")  # what is compared at finer steps
_COLUMNS = [m.heading for m in METRICS.values()]


def report(study: Results, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    makers = (_table, _crossings, _disturbance, _forces, _variants, _refinement)
    lead, figure = make_lead(study, _main_result)
    about = Section(
        "Runs of the study",
        [
            "A linear model of a 6x6 with nine degrees of freedom drives over a trench 2 m long with rounded edges,"
            " 0.15 and 0.25 m deep, at 5, 10 and 20 km/h, and then has to follow a pitch of 3 degrees. It does so"
            " passive, under a linear-quadratic regulator, and under predictive control without and with preview of"
            " road and reference. Vehicle, road and controllers are native FMUs. Statements of Kale's thesis stand"
            " beside what these runs give; it prints no numbers for them."
        ],
    )
    return Report(
        experiment=EXPERIMENT.name,
        title="6x6 over shallow trenches with preview control",
        lead=lead,
        figure=figure,
        claims=CLAIMS.judge(study),
        sections=[about, *sections(study, makers)],
        parameters=_parameters(fmus),
        provenance=provenance(EXPERIMENT, fmus),
    )


# ------------------------------------------------------------------------------------------------------------- tables


def _cells(row: Row) -> list[Scalar]:
    """A cell for each of METRICS, with its digits; None for what a run does not have."""
    return [float(m.shown(row[k])) if k in row else None for k, m in METRICS.items()]


def _table(study: Results) -> Section:
    cases = [Case(*p, c) for p in places(study) for c in CONTROLLERS]
    table = Table(
        "table-5-1",
        "Runs of Table 5.1 and the passive vehicle",
        ["speed [km/h]", "depth [m]", "system", *_COLUMNS],
        [[c.speed_kmh, c.depth, _NAMES[c.controller], *_cells(study[c])] for c in cases],
        "Errors are pitch less its reference. The steady error is that before the end of the hold; the peak force is"
        " that of the whole run.",
    )
    return Section(
        "All runs",
        [
            (
                "Everything exchanges every millisecond, the predictive controllers every five. They have the weights"
                " and bounds of Tables 4.2 to 4.7, which the parameters list, and estimate the state from the nine"
                " outputs of Table 4.2 and the height of the body, with integrating offsets on them: the default of the"
                " tool of the thesis, which itself says nothing of it. Without preview they know neither the road nor"
                " the reference ahead."
            ),
            (
                "The regulator's forces count in kN and its weights of the wheels' states are 1e-4 of those printed; in"
                " SI units throughout the printed weights do nothing."
            ),
        ],
        [],
        [table],
    )


def _variants(study: Results) -> Section:
    table = Table(
        "variants",
        "Other choices that the thesis leaves open",
        ["variant", "speed [km/h]", "depth [m]", *_COLUMNS],
        [
            [words, *p, *_cells(study[variant(p, words)])]
            for words in VARIANTS
            for p in places(study)
            if variant(p, words) in study
        ],
        "The first two weigh the height of the body as well (20, scale 0.2), as the controller does over deep"
        " trenches.",
    )
    texts = [
        (
            "Which estimator stands behind MPC without preview decides what it is worth. With offsets on the outputs,"
            " the default, it learns of the trench only when the body has tilted. An estimator that knows that roads"
            " have heights infers the trench from the wheels, and the controller then needs hardly any preview on this"
            " linear vehicle."
        ),
        "With preview the estimator hardly matters, and neither does measuring all states.",
    ]
    return Section("Open points", texts, [], [table])


def _refinement(study: Results) -> Section:
    place = places(study)[-1]
    rows: list[list[Scalar]] = []
    for controller in CONTROLLERS:
        base = study[Case(*place, controller)]
        finer = {f"{what} halved": study[c] for what, c in halved(Case(*place, controller)).items()}
        for what, row in {"as in the runs": base, **finer}.items():
            change = 100 * max(abs(row[k] / base[k] - 1) for k in _REFINED if base[k])
            rows.append([_NAMES[controller], what, *(METRICS[k].factor * row[k] for k in _REFINED), change])
    table = Table(
        "refinement",
        f"Results with finer steps, {place_text(place)}",
        ["system", "steps", *(METRICS[k].heading for k in _REFINED), "largest change [%]"],
        rows,
        f"{' and '.join(HALVED).capitalize()} of the vehicle; controllers, road and reference keep their sample times.",
    )
    return Section("Steps", ["Whether the results depend on the steps."], [], [table])


# ------------------------------------------------------------------------------------------------------------ figures


def _series(
    study: Results, place: Place, controller: str, signal: str = "pitch", start: float = 0.0, end: float = 25.0
) -> Series:
    return _curve(study, Case(*place, controller), signal, start, end, _NAMES[controller], **_LOOKS[controller])


def _target(study: Results, place: Place, start: float = 0.0, end: float = 25.0) -> Series:
    look = {"color": "black", "dash": "longdash"}
    return _curve(study, Case(*place, "passive"), "reference", start, end, "reference", **look)


def _curve(study: Results, case: Case, signal: str, start: float, end: float, name: str, **look: Any) -> Series:
    """A signal from `start` to `end` [s], thinned so that its peaks stay."""
    t, y = (np.array(study.signals(case)[s]) for s in ("time", signal))
    keep = (t >= start) & (t <= end)
    return Series(name, *keep_peaks(t[keep], y[keep]), **look)


def _crossings(study: Results) -> Section:
    slowest = places(study)[0][0]
    roads = []
    for p in places(study):
        if p[0] == slowest:
            s = study.signals(Case(*p, "passive"))
            roads.append(Series(f"{p[1]:g} m deep", s["time"], s["road"]))
    road = Figure(
        "figure-5-4",
        f"Road under the front left wheel at {slowest:g} km/h (Figure 5.4)",
        "2 m long at half its depth; each edge falls as a tanh with a scale of 0.2 m.",
        [Panel("", "time [s]", "height [mm]", roads)],
    )
    figure = Figure(
        "figures-5-5-to-5-10",
        "Pitch, uncontrolled and controlled (Figures 5.5 to 5.10)",
        "Positive is nose down (ISO 8855; the thesis has it nose up). The trench comes first, the reference from 15"
        " s on.",
        [
            Panel(
                place_text(p),
                "time [s]",
                "pitch [deg]",
                [_target(study, p), *(_series(study, p, c) for c in CONTROLLERS)],
            )
            for p in places(study)
        ],
        columns=2,
    )
    return Section("Trench and reference", [], [road, figure])


def _disturbance(study: Results) -> Section:
    passive = study.signals(Case(*SHOWN, "passive"))
    edge = edge_time(np.array(passive["time"]), np.array(passive["road"]), 1e3 * SHOWN[1])
    curves = {c: _series(study, SHOWN, c, start=1, end=10) for c in CONTROLLERS}
    close = f"with preview; the road begins to fall at {edge:.2f} s"
    figure = Figure(
        "figure-5-11",
        f"Pitch at the trench, {place_text(SHOWN)} (Figure 5.11)",
        "Right: the same run with preview on a scale of its own.",
        [
            Panel("all systems", "time [s]", "pitch [deg]", list(curves.values())),
            Panel(close, "time [s]", "pitch [deg]", [curves["mpc-preview"]]),
        ],
        columns=2,
    )
    return Section("At the trench", [], [figure])


def _main_result(study: Results) -> tuple[str, Figure]:
    """Pitch over the ramp."""
    rows = {c: study[Case(*SHOWN, c)] for c in CONTROLLERS}
    ramp, peak = ({c: METRICS[k].shown(r[k]) for c, r in rows.items()} for k in ("ramp_error_deg", "peak_error_deg"))
    lead = (
        f"On a ramp to {np.abs(study.signals(Case(*SHOWN, 'passive'))['reference']).max():.3g} deg of pitch at"
        f" {SHOWN[0]:g} km/h, the rms error of pitch is {ramp['mpc-preview']} deg with preview, {ramp['mpc']} deg with"
        f" MPC without preview and {ramp['lqr']} deg with the LQR; over a trench {SHOWN[1]:g} m deep the peak error is"
        f" {peak['mpc-preview']}, {peak['mpc']} and {peak['lqr']} deg, and {peak['passive']} deg for the passive"
        " vehicle."
    )
    panels = []
    for title, start, end in (("start of the ramp", 14.4, 16.0), ("whole demand", 14.0, 25.0)):
        curves = [_series(study, SHOWN, c, start=start, end=end) for c in CONTROLLED]
        panels.append(Panel(title, "time [s]", "pitch [deg]", [_target(study, SHOWN, start, end), *curves]))
    figure = Figure(
        "figures-5-12-5-13",
        f"Following the reference, {place_text(SHOWN)} (Figures 5.12 and 5.13)",
        "Positive is nose down. The vehicle is beyond the trench.",
        panels,
        columns=2,
    )
    return lead, figure


def _forces(study: Results) -> Section:
    panels = [
        Panel(
            f"{axle} axle, left", "time [s]", "force [kN]", [_series(study, SHOWN, c, f"force.{k}") for c in CONTROLLED]
        )
        for axle, k in zip(("first", "second", "third"), SIX_CORNERS[::2], strict=True)
    ]
    figure = Figure(
        "figure-5-14",
        f"Actuator forces, {place_text(SHOWN)} (Figure 5.14)",
        "Positive lifts the body. Both sides are alike.",
        panels,
    )
    return Section("Forces", [], [figure])


def _parameters(fmus: FmuSet) -> list[Parameter]:
    """Parameters of vehicle, road, reference and controllers.

    The vehicle's right corners are left out, since they equal the left ones, and so is the depth of the road;
    controllers have their design parameters.
    """
    right = tuple(f".{k}." for k in SIX_CORNERS[1::2])
    vehicle = [p for p in parameters(fmus.path("ThreeAxleRide")) if not any(k in p.name for k in right)]
    trench = parameters(fmus.path("RoadShallowTrench"), ("trench.start", "trench.length", "trench.edge"))
    reference = parameters(fmus.path("PitchReference"), prefix="reference.")
    return [*vehicle, *trench, *reference, *_of_the_regulator(fmus), *_of_the_predictive(fmus)]


def _of_the_regulator(fmus: FmuSet) -> list[Parameter]:
    """Weights of the squares, and the limit of the forces."""
    file = fmus.path("LqrThreeAxle")
    weights = designed_with(file)["weights"]
    named = {
        "state": ("body states but pitch", "1/SI2", "003 (4.8)"),
        "pitch": ("pitch", "1/rad2", "003 (4.8)"),
        "wheel": ("wheel states", "1/SI2", "003 (4.8) times 1e-4, assumed"),
        "force": ("force", "1/N2", "003 (4.9), per squared kN"),
    }
    rows = [Parameter(f"LQR weight, {text}", weights[k], *rest) for k, (text, *rest) in named.items()]
    return [*rows, *parameters(file, ["force.limit"], prefix="LQR ")]


def _of_the_predictive(fmus: FmuSet) -> list[Parameter]:
    """Horizon, weights, scales and bounds, which are alike on both sides; bounds count in both directions."""
    mpc = designed_with(fmus.path("MpcThreeAxle"))["mpc"]
    car = FmuFile(fmus.path("ThreeAxleRide")).description
    case = mpc["cases"]["nominal, height held"]
    rows = [
        Parameter("MPC sample time", 1e3 * mpc["period"], "ms", "003 Table 4.4"),
        Parameter("MPC prediction horizon", mpc["prediction"], "-", "003 Table 4.4"),
        Parameter("MPC control horizon", len(mpc["moves"]), "-", "003 Table 4.4"),
        Parameter("MPC weight of the slack", mpc["slack_weight"], "-", "assumed"),
    ]
    tables = {"scale": "4.3", "max": "4.5", "rate_max": "4.5", "weight": "4.7", "rate_weight": "4.7", "ecr": "4.6"}
    words = {
        "scale": "scale",
        "max": "bound",
        "rate_max": "bound of the change per sample",
        "weight": "weight",
        "rate_weight": "weight of the change",
        "ecr": "softness of the bound",
    }
    for signal in (*case["inputs"], *case["outputs"]):
        name = signal["name"]
        if any(f".{k}" in name for k in SIX_CORNERS[1::2]):
            continue
        unit = car.find(name, "ThreeAxleRide").unit_name or "-"
        for key, table in tables.items():
            if key in signal and (key != "ecr" or "max" in signal):
                source = (
                    f"003 Table {table}"
                    if name != "body.z"
                    else "assumed" + "; 0 unless the height is held" * (key == "weight")
                )
                in_unit = unit if key in ("scale", "max", "rate_max") else "-"
                rows.append(Parameter(f"MPC {name}, {words[key]}", signal[key], in_unit, source))
    return rows
