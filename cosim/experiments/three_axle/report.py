"""Tables and figures of the linear part of paper 003 as a report."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cosim.experiments.steps import HALVED, with_finer_steps
from cosim.experiments.three_axle import EXPERIMENT
from cosim.experiments.three_axle.claims import CLAIMS, ThreeAxleView
from cosim.experiments.three_axle.published import CONTROLLED, SHOWN, VARIANTS, Place, places, variant
from cosim.experiments.three_axle.runs import CONTROLLERS, METRICS, Case, edge_time
from cosim.fmu.file import FmuFile
from cosim.report import Figure, Panel, Parameter, Table, over_time
from cosim.study import Content, FmuSet, Results, Row, StudyReport, parameters
from cosim.study.fmus import designed_with
from fmu_sources.models.corners import SIX_CORNERS

_NAMES = {"passive": "passive", "lqr": "LQR", "mpc": "MPC", "mpc-preview": "MPC with preview"}
_words = ThreeAxleView.named.format  # of speed and depth
_PITCH = ("pitch [deg]", "pitch", 1.0)  # label, signal and factor of a panel
_REFINED = ("peak_error_deg", "ramp_error_deg", "rms_az", "peak_force_kN")  # what is compared at finer steps


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
    kinds = {  # words, table
        "scale": ("scale", "4.3"),
        "max": ("bound", "4.5"),
        "rate_max": ("bound of the change per sample", "4.5"),
        "weight": ("weight", "4.7"),
        "rate_weight": ("weight of the change", "4.7"),
        "ecr": ("softness of the bound", "4.6"),
    }
    for signal in (*case["inputs"], *case["outputs"]):
        name = signal["name"]
        if any(f".{k}" in name for k in SIX_CORNERS[1::2]):
            continue
        unit = car.find(name, "ThreeAxleRide").unit_name or "-"
        for key, (words, table) in kinds.items():
            if key in signal and (key != "ecr" or "max" in signal):
                assumed = "assumed" + "; 0 unless the height is held" * (key == "weight")
                source = assumed if name == "body.z" else f"003 Table {table}"
                in_unit = unit if key in ("scale", "max", "rate_max") else "-"
                rows.append(Parameter(f"MPC {name}, {words}", signal[key], in_unit, source))
    return rows


report = StudyReport(
    EXPERIMENT,
    "6x6 over shallow trenches with preview control",
    CLAIMS,
    _parameters,
    looks={
        "reference": ("black", "longdash"),
        "passive": "gray",
        "LQR": ("orange", "dash"),
        "MPC": ("blue", "dot"),
        "MPC with preview": "green",
    },
)


@report.lead
def _main_result(study: Results) -> Content:
    rows = {c: study[Case(*SHOWN, c)] for c in CONTROLLERS}
    ramp, peak = ({c: METRICS[k].shown(r[k]) for c, r in rows.items()} for k in ("ramp_error_deg", "peak_error_deg"))
    demand = np.abs(study.signals(Case(*SHOWN, "passive"))["reference"]).max()
    yield f"""On a ramp to {demand:.3g} deg of pitch at {SHOWN[0]:g} km/h, the rms error of pitch is
    {ramp["mpc-preview"]} deg with preview, {ramp["mpc"]} deg with MPC without preview and {ramp["lqr"]} deg with the
    LQR; over a trench {SHOWN[1]:g} m deep the peak error is {peak["mpc-preview"]}, {peak["mpc"]} and {peak["lqr"]} deg,
    and {peak["passive"]} deg for the passive vehicle."""
    yield Figure(
        "figures-5-12-5-13",
        f"Following the reference, {_words(*SHOWN)} (Figures 5.12 and 5.13)",
        "Positive is nose down. The vehicle is beyond the trench.",
        [
            *_pitch(study, SHOWN, "start of the ramp", CONTROLLED, start=14.4, end=16.0),
            *_pitch(study, SHOWN, "whole demand", CONTROLLED, start=14.0, end=25.0),
        ],
        columns=2,
    )


def _runs(study: Results, place: Place, systems: Iterable[str]) -> dict[str, Row]:
    """Signals by the names of the systems."""
    return {_NAMES[c]: study.signals(Case(*place, c)) for c in systems}


def _pitch(study: Results, place: Place, title: str, systems: Iterable[str], **span: float) -> list[Panel]:
    """The reference of pitch, and what systems make of it."""
    passive = study.signals(Case(*place, "passive"))
    runs = {"reference": {**passive, "pitch": passive["reference"]}, **_runs(study, place, systems)}
    return over_time(runs, [(title, *_PITCH)], thin=True, **span)


def _cells(row: Row) -> dict[str, float | None]:
    """Each of METRICS with its digits; None for what a run does not have."""
    return {m.heading: float(m.shown(row[k])) if k in row else None for k, m in METRICS.items()}


@report.section("Runs of the study")
def _about(_: Results) -> Content:
    yield """A linear model of a 6x6 with nine degrees of freedom drives over a trench 2 m long with rounded edges, 0.15
    and 0.25 m deep, at 5, 10 and 20 km/h, and then has to follow a pitch of 3 degrees. It does so passive, under a
    linear-quadratic regulator, and under predictive control without and with preview of road and reference. Vehicle,
    road and controllers are native FMUs. Statements of Kale's thesis stand beside what these runs give; it prints no
    numbers for them."""


@report.section("All runs")
def _table(study: Results) -> Content:
    yield """Everything exchanges every millisecond, the predictive controllers every five. They have the weights and
    bounds of Tables 4.2 to 4.7, which the parameters list, and estimate the state from the nine outputs of Table 4.2
    and the height of the body, with integrating offsets on them: the default of the tool of the thesis, which itself
    says nothing of it. Without preview they know neither the road nor the reference ahead.

    The regulator's forces count in kN and its weights of the wheels' states are 1e-4 of those printed; in SI units
    throughout the printed weights do nothing."""
    yield Table.of(
        "table-5-1",
        "Runs of Table 5.1 and the passive vehicle",
        [
            {"speed [km/h]": p[0], "depth [m]": p[1], "system": _NAMES[c], **_cells(study[Case(*p, c)])}
            for p in places(study)
            for c in CONTROLLERS
        ],
        "Errors are pitch less its reference. The steady error is that before the end of the hold; the peak force is"
        " that of the whole run.",
    )


@report.section("Trench and reference")
def _crossings(study: Results) -> Content:
    slowest = places(study)[0][0]
    depths = {p[1]: study.signals(Case(*p, "passive")) for p in places(study) if p[0] == slowest}
    yield Figure(
        "figure-5-4",
        f"Road under the front left wheel at {slowest:g} km/h (Figure 5.4)",
        "2 m long at half its depth; each edge falls as a tanh with a scale of 0.2 m.",
        over_time({f"{d:g} m deep": s for d, s in depths.items()}, [("", "height [mm]", "road", 1.0)]),
    )
    yield Figure(
        "figures-5-5-to-5-10",
        "Pitch, uncontrolled and controlled (Figures 5.5 to 5.10)",
        "Positive is nose down (ISO 8855; the thesis has it nose up). The trench comes first, the reference from 15"
        " s on.",
        [panel for p in places(study) for panel in _pitch(study, p, _words(*p), CONTROLLERS)],
        columns=2,
    )


@report.section("At the trench")
def _disturbance(study: Results) -> Content:
    passive = study.signals(Case(*SHOWN, "passive"))
    edge = edge_time(np.array(passive["time"]), np.array(passive["road"]), 1e3 * SHOWN[1])
    close = f"with preview; the road begins to fall at {edge:.2f} s"
    yield Figure(
        "figure-5-11",
        f"Pitch at the trench, {_words(*SHOWN)} (Figure 5.11)",
        "Right: the same run with preview on a scale of its own.",
        [
            *over_time(_runs(study, SHOWN, CONTROLLERS), [("all systems", *_PITCH)], start=1, end=10, thin=True),
            *over_time(_runs(study, SHOWN, ["mpc-preview"]), [(close, *_PITCH)], start=1, end=10, thin=True),
        ],
        columns=2,
    )


@report.section("Forces")
def _forces(study: Results) -> Content:
    axles = zip(("first", "second", "third"), SIX_CORNERS[::2], strict=True)
    forces = [(f"{axle} axle, left", "force [kN]", f"force.{k}", 1.0) for axle, k in axles]
    yield Figure(
        "figure-5-14",
        f"Actuator forces, {_words(*SHOWN)} (Figure 5.14)",
        "Positive lifts the body. Both sides are alike.",
        over_time(_runs(study, SHOWN, CONTROLLED), forces, thin=True),
    )


@report.section("Open points")
def _variants(study: Results) -> Content:
    yield """Which estimator stands behind MPC without preview decides what it is worth. With offsets on the outputs,
    the default, it learns of the trench only when the body has tilted. An estimator that knows that roads have heights
    infers the trench from the wheels, and the controller then needs hardly any preview on this linear vehicle.

    With preview the estimator hardly matters, and neither does measuring all states."""
    rows = [
        {"variant": words, "speed [km/h]": p[0], "depth [m]": p[1], **_cells(study[variant(p, words)])}
        for words in VARIANTS
        for p in places(study)
        if variant(p, words) in study
    ]
    if rows:
        yield Table.of(
            "variants",
            "Other choices that the thesis leaves open",
            rows,
            "The first two weigh the height of the body as well (20, scale 0.2), as the controller does over deep"
            " trenches.",
        )


@report.section("Steps")
def _refinement(study: Results) -> Content:
    yield "Whether the results depend on the steps."
    place = places(study)[-1]
    rows = []
    for c in CONTROLLERS:
        base = study[Case(*place, c)]
        rows += [
            {
                "system": _NAMES[c],
                "steps": steps,
                **{METRICS[k].heading: METRICS[k].factor * row[k] for k in _REFINED},
                "largest change [%]": 100 * max(abs(row[k] / base[k] - 1) for k in _REFINED if base[k]),
            }
            for steps, row in with_finer_steps(study, Case(*place, c)).items()
        ]
    yield Table.of(
        "refinement",
        f"Results with finer steps, {_words(*place)}",
        rows,
        f"{' and '.join(HALVED).capitalize()} of the vehicle; controllers, road and reference keep their sample times.",
    )
