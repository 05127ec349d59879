"""Claims, tables and figures of the linear part of paper 003 as a report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from cosim.experiments import three_axle_study as ts
from cosim.experiments.cases import FmuSet
from cosim.experiments.provenance import provenance
from cosim.experiments.three_axle import FMUS, HORIZON, LIMIT, REFERENCE_START, SYSTEMS, Case, Row, edge_time
from cosim.experiments.three_axle_study import VARIANTS, Place, Study, published_cases
from cosim.report import (
    Claims,
    Figure,
    Panel,
    Parameter,
    Report,
    Result,
    Section,
    Series,
    Table,
    keep_peaks,
    write_report,
)
from cosim.report.model import Scalar
from fmu_sources.vehicles import Quantity, load_three_axle

CONTROLLED = ("lqr", "mpc", "mpc-preview")
_NAMES = {"passive": "passive", "lqr": "LQR", "mpc": "MPC", "mpc-preview": "MPC with preview"}
_LOOKS = {
    "passive": ("grey", "solid"),
    "lqr": ("orange", "dash"),
    "mpc": ("blue", "dot"),
    "mpc-preview": ("green", "solid"),
}
RATIO = 0.1  # peak pitch error with preview over that of another system
CLOSE = 0.25  # relative difference that still counts as "close to each other"
STEADY_DEG = 0.02
FITTED = "vehicle values that the thesis keeps back, chosen with its Table 5.4 (trench crossings) in view"
FITTED_LQR = "the LQR's units: forces in kN and the wheel states' weights times 1e-4, without which the printed weights do nothing"
BEFORE = 10.0  # times the force of the blind controller before the edge
SHOWN: Place = (5.0, 0.15)  # of Figures 5.11 to 5.14


def write(study: Study, fmus: FmuSet, directory: Path) -> Path:
    """Write report.html, summary.json and CSV files; returns the path of the page."""
    return write_report(report(study, fmus), directory)


def report(study: Study, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    return Report(
        experiment="three-axle",
        title="6x6 over shallow trenches with preview control",
        lead=(
            "A linear nine-degree model of a 6x6 drives over a trench 2 m long with rounded edges, 0.15 and 0.25 m deep, at 5, 10 and "
            "20 km/h, and then is asked for a pitch of 3 degrees. It does so passive, under a linear-quadratic regulator, and under "
            "predictive control without and with preview of road and reference. Vehicle, road and controllers are native FMUs. "
            "Statements of Kale's thesis stand beside what these runs give; it prints no numbers for them."
        ),
        claims=claims(study),
        results=[
            Result(f"peak pitch error with preview, {_place(p)}", round(study.value("peak_error_deg", p, "mpc-preview"), 3), "deg")
            for p in study.places
        ],
        sections=[_table(study), _crossings(study), _disturbance(study), _reference(study), _forces(study), _variants(study),
                  _refinement(study)],
        parameters=_parameters(),
        provenance=provenance(fmus, fmus.paths(FMUS)),
    )  # fmt: skip


def _place(place: Place) -> str:
    return f"{place[0]:g} km/h, {place[1]:g} m"


# ---------------------------------------------------------------------- claims


def claims(study: Study) -> Claims:
    """What the thesis says of its Figures 5.5 to 5.14, and what it should show to be worth its effort."""
    result = Claims()
    places = study.places

    claim = result.judge

    def peak(place: Place, system: str) -> float:
        return study.value("peak_error_deg", place, system)

    others = [s for s in SYSTEMS if s != "mpc-preview"]
    best = [p for p in places if all(peak(p, "mpc-preview") < peak(p, s) for s in others)]
    claim(
        "best-at-the-trench",
        "MPC with preview rejects the disturbance best",
        "best of the four in all six cases",
        f"smallest peak pitch error in {len(best)} of {len(places)}",
        len(best) == len(places),
        "another system has a smaller peak",
        "Figures 5.5 to 5.11",
        criterion="smallest peak pitch error at every speed and depth",
        fitted=FITTED,
    )
    for other, id_, text in (
        (
            "passive",
            "tenth-of-passive",
            "With preview the pitch error is clearly smaller than the passive vehicle's",
        ),
        (
            "mpc",
            "tenth-of-blind",
            "With preview the pitch error is clearly smaller than that of MPC without preview",
        ),
    ):
        ratios = {p: peak(p, "mpc-preview") / peak(p, other) for p in places}
        worst = max(ratios, key=lambda p: ratios[p])
        within = sum(r <= RATIO for r in ratios.values())
        claim(
            id_,
            text,
            "clearly smaller in every figure; no number",
            f"within a tenth in {within} of {len(places)}; largest {ratios[worst]:.4f} at {_place(worst)}",
            within == len(places),
            f"at {_place(worst)} the soft bound of 2 m/s2 on the acceleration of the body and the limit of the actuators cost "
            "accuracy: the controller gives up pitch to meet the bound",
            "Figures 5.5 to 5.10",
            criterion=f"clearly: at most {RATIO:g} of the other's peak at every speed and depth",
            fitted=FITTED,
        )
    distance = peak(SHOWN, "lqr") / peak(SHOWN, "mpc") - 1 if SHOWN in places else float("nan")
    claim(
        "lqr-near-mpc",
        f"LQR and MPC without preview are close to each other at the trench ({_place(SHOWN)})",
        "close to each other",
        f"LQR's peak is {100 * distance:+.0f} % of MPC's",
        abs(distance) <= CLOSE,
        f"more than {100 * CLOSE:.0f} % apart",
        "Figure 5.11",
        criterion=f"peaks of the pitch error within {100 * CLOSE:g} % of each other in the run that is shown",
        fitted=f"{FITTED}; {FITTED_LQR}",
    )

    def before(key: str, system: str) -> list[float]:
        return [study.value(key, p, system) for p in places]

    for id_, key, event, figure in (
        ("before-the-edge", "force_before_edge_kN", "the obstacle is met", "Figure 5.11"),
        ("before-the-reference", "force_before_ramp_kN", "the reference rises", "Figure 5.12"),
    ):
        seeing, blind = before(key, "mpc-preview"), before(key, "mpc")
        early = min(a / b for a, b in zip(seeing, blind, strict=True))
        claim(
            id_,
            f"MPC with preview acts before {event}",
            "acts before",
            f"force {min(seeing):.1f} to {max(seeing):.0f} kN before, {early:.0f} times that without preview or more",
            early >= BEFORE,
            f"less than {BEFORE:g} times the force of the controller that knows nothing of it",
            figure,
            criterion=f"largest force before (change within the {HORIZON:g} s of the horizon, for the reference) at least "
            f"{BEFORE:g} times that without preview, at every speed and depth",
        )

    def ramp(system: str) -> list[float]:
        return [study.value("ramp_error_deg", p, system) for p in places]

    claim(
        "ramp-preview",
        "MPC with preview follows the ramp best",
        "the most successful",
        f"rms error {max(ramp('mpc-preview')):.4f} deg; LQR {max(ramp('lqr')):.3f}, MPC without preview {max(ramp('mpc')):.3f} deg",
        all(a < min(b, c) for a, b, c in zip(ramp("mpc-preview"), ramp("mpc"), ramp("lqr"), strict=True)),
        "another controller follows it closer",
        "Figure 5.12",
        criterion="smallest rms pitch error on the ramp in every run",
    )
    claim(
        "ramp-lqr",
        "LQR follows the ramp slightly better than MPC without preview",
        "a little better",
        f"rms error {min(ramp('lqr')):.3f} deg against {max(ramp('mpc')):.3f} deg",
        all(a < b for a, b in zip(ramp("lqr"), ramp("mpc"), strict=True)),
        "the regulator has neither integral action nor feed-forward: a third of every demand is missing, on the ramp too",
        "Figure 5.12",
        criterion="smaller rms pitch error on the ramp in every run",
        fitted=FITTED_LQR,
    )
    steady = {s: [study.value("steady_error_deg", p, s) for p in places] for s in CONTROLLED}
    largest = max(*steady["mpc"], *steady["mpc-preview"])
    claim(
        "steady-mpc",
        "Both MPC controllers settle without visible error",
        "sufficient",
        f"{largest:.4f} deg at most",
        largest <= STEADY_DEG,
        f"more than {STEADY_DEG:g} deg",
        "Figure 5.13",
        criterion=f"visible: more than {STEADY_DEG:g} deg of the 3 deg, less than the width of a line",
    )
    claim(
        "steady-lqr",
        "LQR is less successful in the steady state",
        "a visible steady error",
        f"{min(steady['lqr']):.2f} deg of 3, {min(steady['lqr']) / largest:.0f} times MPC's or more",
        min(steady["lqr"]) >= 10 * largest,
        "less than ten times the error of MPC",
        "Figure 5.13",
        criterion="at least ten times the error of either MPC",
        fitted=FITTED_LQR,
    )
    at_limit = [study.value("at_limit", p, s) for p in places for s in CONTROLLED]
    claim(
        "force-limits",
        "Almost all commands are within the limits of the actuators",
        "almost all; instant peaks beyond",
        f"never beyond {LIMIT:g} kN (the bound is hard here), at it in {100 * max(at_limit):.2f} % of the commands of a run at most",
        max(at_limit) < 0.01,
        "at the limit in more than 1 % of a run",
        "Figure 5.14",
        criterion="almost all: at the limit in less than 1 % of the commands of every run",
    )
    solved = [r for c, r in study.rows.items() if c.system.startswith("mpc")]
    residual = max(r["solver_residual"] for r in solved)
    result.check(
        "solver",
        "The quadratic program is solved at every step, to 1e-6",
        "no failure, residual of 1e-6 at most",
        f"{sum(r['solver_failures'] for r in solved)} failures in {len(solved)} runs, largest residual {residual:.1e}, "
        f"{max(r['solver_iterations'] for r in solved)} iterations at most",
        residual <= 1e-6 and not any(r["solver_failures"] for r in solved),
        "a step was not solved",
        "own",
        criterion="every step of every run",
    )
    return result


# ---------------------------------------------------------------------- tables and figures


_COLUMNS: dict[str, tuple[str, Callable[[float], float]]] = {
    "peak error at the trench [deg]": ("peak_error_deg", lambda v: round(v, 4)),
    "rms error at the trench [deg]": ("rms_error_deg", lambda v: round(v, 4)),
    "rms error on the ramp [deg]": ("ramp_error_deg", lambda v: round(v, 4)),
    "steady error [deg]": ("steady_error_deg", lambda v: round(v, 4)),
    "peak heave [mm]": ("peak_heave_m", lambda v: round(1e3 * v, 1)),
    "rms vertical acceleration [m/s2]": ("rms_az", lambda v: round(v, 3)),
    "peak force [kN]": ("peak_force_kN", lambda v: round(v, 1)),
    "force before the edge [kN]": ("force_before_edge_kN", lambda v: round(v, 2)),
    "largest slack [-]": ("slack", lambda v: round(v, 2)),
}


def _cells(row: Row) -> list[float | None]:
    return [form(row[key]) if key in row else None for key, form in _COLUMNS.values()]


def _table(study: Study) -> Section:
    rows = [[c.speed_kmh, c.depth, _NAMES[c.system], *_cells(study.rows[c])] for c in published_cases(study.places)]
    table = Table(
        "table-5-1",
        "Runs of Table 5.1 and the passive vehicle",
        ["speed [km/h]", "depth [m]", "system", *_COLUMNS],
        rows,
        "Errors are pitch less its reference. The steady error is that before the end of the hold; the peak force is that of the "
        "whole run.",
    )
    return Section(
        "All runs",
        [
            "Everything exchanges every millisecond, the predictive controllers every five. They have the weights and bounds of "
            "Tables 4.2 to 4.7 and estimate the state from the nine outputs of Table 4.2 and the height of the body, with "
            "integrating offsets on them: the default of the tool of the thesis, which itself says nothing of it. Without "
            "preview they know neither the road nor the reference ahead.",
            "The regulator's forces count in kN and its weights of the wheels' states are 1e-4 of those printed; in SI units "
            "throughout the printed weights do nothing.",
        ],
        [],
        [table],
    )


def _series(
    study: Study, place: Place, system: str, key: str, *, start: float = 0.0, end: float = 25.0, name: str = ""
) -> Series:
    row = study.histories[Case(*place, system)]
    t = np.array(row["time"])
    keep = (t >= start) & (t <= end)
    color, dash = _LOOKS[system]
    x, y = keep_peaks(t[keep], np.array(row[key])[keep])
    return Series(name or _NAMES[system], x, y, color=color, dash=dash)  # type: ignore[arg-type]


def _reference_series(study: Study, place: Place, start: float, end: float) -> Series:
    row = study.histories[Case(*place, "passive")]
    t = np.array(row["time"])
    keep = (t >= start) & (t <= end)
    x, y = keep_peaks(t[keep], np.array(row["reference"])[keep])
    return Series("reference", x, y, color="black", dash="longdash")


def _crossings(study: Study) -> Section:
    roads = [
        Series(
            f"{p[1]:g} m deep", study.histories[Case(*p, "passive")]["time"], study.histories[Case(*p, "passive")]["road"]
        )
        for p in study.places
        if p[0] == study.places[0][0]
    ]  # fmt: skip
    road = Figure(
        "figure-5-4",
        f"Road under the front left wheel at {study.places[0][0]:g} km/h (Figure 5.4)",
        "2 m long at half its depth; each edge falls as a tanh with a scale of 0.2 m.",
        [Panel("", "time [s]", "height [mm]", roads)],
    )
    panels = [
        Panel(
            _place(p), "time [s]", "pitch [deg]",
            [_reference_series(study, p, 0, 25), *(_series(study, p, s, "pitch") for s in SYSTEMS)],
        )
        for p in study.places
    ]  # fmt: skip
    figure = Figure(
        "figures-5-5-to-5-10",
        "Pitch, uncontrolled and controlled (Figures 5.5 to 5.10)",
        "Positive is nose down (ISO 8855; the thesis has it nose up). The trench comes first, the reference from 15 s on.",
        panels,
        columns=2,
    )
    return Section("Trench and reference", [], [road, figure])


def _disturbance(study: Study) -> Section:
    if SHOWN not in study.places:
        return Section("At the trench", ["The run shown in the thesis was left out."], [])
    passive = study.histories[Case(*SHOWN, "passive")]
    edge = edge_time(np.array(passive["time"]), np.array(passive["road"]), 1e3 * SHOWN[1])
    systems = Panel(
        "all systems", "time [s]", "pitch [deg]", [_series(study, SHOWN, s, "pitch", start=1, end=10) for s in SYSTEMS]
    )
    close = Panel(
        f"with preview; the road begins to fall at {edge:.2f} s", "time [s]", "pitch [deg]",
        [_series(study, SHOWN, "mpc-preview", "pitch", start=1, end=10)],
    )  # fmt: skip
    figure = Figure(
        "figure-5-11",
        f"Pitch at the trench, {_place(SHOWN)} (Figure 5.11)",
        "Right: the same run with preview on a scale of its own.",
        [systems, close],
        columns=2,
    )
    return Section("At the trench", [], [figure])


def _reference(study: Study) -> Section:
    if SHOWN not in study.places:
        return Section("Reference", ["The run shown in the thesis was left out."], [])
    panels = []
    for title, start, end in (("start of the ramp", REFERENCE_START - 0.6, 16.0), ("whole demand", 14.0, 25.0)):
        curves = [_series(study, SHOWN, s, "pitch", start=start, end=end) for s in CONTROLLED]
        panels.append(
            Panel(title, "time [s]", "pitch [deg]", [_reference_series(study, SHOWN, start, end), *curves])
        )  # fmt: skip
    figure = Figure(
        "figures-5-12-5-13",
        f"Following the reference, {_place(SHOWN)} (Figures 5.12 and 5.13)",
        "The regulator meets two thirds of what is asked for; both predictive controllers meet all of it.",
        panels,
        columns=2,
    )
    return Section("Reference", [], [figure])


def _forces(study: Study) -> Section:
    if SHOWN not in study.places:
        return Section("Forces", ["The run shown in the thesis was left out."], [])
    panels = [
        Panel(
            f"{axle} axle, left", "time [s]", "force [kN]",
            [_series(study, SHOWN, s, f"force.{corner}") for s in CONTROLLED],
        )
        for axle, corner in (("first", "a1l"), ("second", "a2l"), ("third", "a3l"))
    ]  # fmt: skip
    figure = Figure(
        "figure-5-14", f"Actuator forces, {_place(SHOWN)} (Figure 5.14)", "Positive lifts the body. Both sides are alike.",
        panels,
    )  # fmt: skip
    return Section("Forces", [], [figure])


def _variants(study: Study) -> Section:
    rows = [
        [VARIANTS[v][1], *p, *_cells(study.rows[ts.variant_case(p, v)])] for v in study.variants for p in study.places
    ]
    table = Table(
        "variants",
        "Other choices that the thesis leaves open",
        ["variant", "speed [km/h]", "depth [m]", *_COLUMNS],
        rows,
        "The first two weigh the height of the body as well (20, scale 0.2), as the controller does over deep trenches.",
    )
    texts = [
        "Which estimator stands behind MPC without preview decides what it is worth. With offsets on the outputs, the default, it "
        "learns of the trench only when the body has tilted. An estimator that knows that roads have heights infers the trench from the "
        "wheels, and the controller then needs hardly any preview on this linear vehicle.",
        "With preview the estimator hardly matters, and neither does measuring all states.",
    ]
    return Section("What is left open", texts, [], [table])


def _refinement(study: Study) -> Section:
    place = study.places[-1]
    keys = (
        "peak error at the trench [deg]",
        "rms error on the ramp [deg]",
        "rms vertical acceleration [m/s2]",
        "peak force [kN]",
    )
    rows: list[list[Scalar]] = []
    for system in SYSTEMS:
        base = study.rows[Case(*place, system)]
        for what, row in (
            ("as in the runs", base),
            *((f"{w} halved", study.refined[w, system]) for w in ts.REFINEMENTS),
        ):
            figures = [_COLUMNS[k][0] for k in keys]
            change = 100 * max(abs(row[k] / base[k] - 1) for k in figures if base[k])
            rows.append([_NAMES[system], what, *(row[k] for k in figures), change])
    table = Table(
        "refinement", f"Results with finer steps, {_place(place)}", ["system", "steps", *keys, "largest change [%]"], rows,
        "Solver step and exchange step of the vehicle; controllers, road and reference keep their sample times.",
    )  # fmt: skip
    return Section("Steps", ["Whether the results depend on how time is cut."], [], [table])


def _parameters() -> list[Parameter]:
    vehicle = load_three_axle("three_axle")
    found = []
    for section, table in (("body", vehicle.body), ("wheel.a1", vehicle.wheel.a1), ("wheel.a2", vehicle.wheel.a2),
                           ("wheel.a3", vehicle.wheel.a3), ("suspension.a1", vehicle.suspension.a1),
                           ("tire.a1", vehicle.tire.a1)):  # fmt: skip
        for name in type(table).model_fields:
            q = getattr(table, name)
            if isinstance(q, Quantity):
                found.append(Parameter(f"{section}.{name}", q.value, q.unit, q.source))
    return found
