"""Claims, tables, figures and the animation of paper 003's trench crossings as a report."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from cosim.experiments import trench_published as published
from cosim.experiments import trench_study as ts
from cosim.experiments.cases import FmuSet
from cosim.experiments.provenance import provenance
from cosim.experiments.trench import CONTROLS, CORNERS, STEP, Case, Row, outcome
from cosim.experiments.trench_claims import GRID, claims
from cosim.experiments.trench_published import LENGTHS, SPEEDS
from cosim.experiments.trench_study import Study, passes
from cosim.fmu import Fmu
from cosim.metrics_crossing import LABELS, LIMITS, WEIGHTS, cost_of_limits, normalised, reduction_percent
from cosim.report import (
    Animation,
    Body,
    Figure,
    Force,
    Layer,
    Map,
    Panel,
    Parameter,
    Phase,
    Reading,
    Report,
    Result,
    Scene,
    Section,
    Series,
    Strut,
    Table,
    Take,
    Wheel,
    write_report,
)

CASES = (
    "case 0: no axle over the trench",
    "case 1: front axle over the trench",
    "case 2: middle axle over the trench",
    "case 3: rear axle over the trench",
)
_NAMES = {"passive": "passive", "mpc": "controlled"}
_LOOKS: dict[str, Any] = {
    "passive": {"color": "grey", "dash": "dash"},
    "controlled": {"color": "blue", "dash": "solid"},
}
_LEFT = ("a1l", "a2l", "a3l")
_AXLES = ("front", "middle", "rear")


def write(study: Study, fmus: FmuSet, directory: Path) -> Path:
    """Write report.html, summary.json and CSV files; returns the path of the page."""
    return write_report(report(study, fmus), directory)


def report(study: Study, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    controlled, passive = study.rows("mpc"), study.rows("passive")
    return Report(
        experiment="trench",
        title="A 6x6 crosses trenches",
        lead=(
            "A three-axle vehicle drives over trenches of 1.2 to 2.0 m at 1 to 9 km/h, passive and under predictive control that "
            "sees the trench coming, lifts the axle above it and shifts its weight. Vehicle, crossing algorithm and controller "
            "are native FMUs. The tables of Kale's thesis stand beside what these runs give."
        ),
        claims=claims(study),
        results=[
            Result("crossings passed, passive", passes(passive), "of 36"),
            Result("crossings passed, controlled", passes(controlled), "of 36"),
            Result("mean cost, passive", round(_mean(passive)), "-"),
            Result("mean cost, controlled", round(_mean(controlled)), "-"),
        ],
        sections=[
            _animation(study, fmus),
            _verdicts(study),
            _reductions(study),
            _costs(study),
            _histories(study),
            _refinement(study),
            *_between(study),
            *_without(study),
            *_vehicles(study),
            _linear(study),
            _limits(),
        ],
        parameters=_parameters(),
        provenance=provenance(fmus, fmus.paths(Case().fmus())),
    )


def single(case: Case, rows: dict[str, Row], frames: dict[str, Row], fmus: FmuSet) -> Report:
    """One crossing, by system: its animation, time plots and quantities."""
    take = Take(case.title, [scene(_NAMES.get(s, s), rows[s], frames[s], fmus) for s in rows])
    columns = ["quantity", "limit", *rows]
    lines = [[LABELS[n], getattr(LIMITS, n), *(rows[s][n] for s in rows)] for n in WEIGHTS]
    lines += [["cost [-]", None, *(r["cost"] for r in rows.values())]]
    lines += [["outcome", None, *(outcome(r) for r in rows.values())]]
    return Report(
        experiment="trench",
        title=f"Crossing a trench: {case.title}",
        lead=f"A 6x6 drives over a trench of {case.length:g} m at {case.speed_kmh:g} km/h.",
        sections=[
            Section(
                "The crossing",
                animations=[_player("crossing", [take])],
                figures=[_history(case.title, "time-histories", frames)],
                tables=[Table("quantities", "Quantities of Table 5.3", columns, lines)],
            )
        ],
        provenance=provenance(fmus, fmus.paths(case.fmus())),
    )


def _mean(rows: list[Row]) -> float:
    return float(np.mean([r["cost"] for r in rows]))


# ---------------------------------------------------------------------- animation


def scene(title: str, row: Row, frames: Row, fmus: FmuSet) -> Scene:
    """The left side of the vehicle in one run."""
    parameter = Fmu(fmus.path("ThreeAxleTrench")).description.parameters

    def value(name: str) -> float:
        return float(parameter[name].start)

    first, last = (value(f"wheel.{k}.x") - row["cg_offset"] for k in ("a1l", "a3l"))
    radius, height = value("disc.radius"), _height(frames, value("body.cg_height"))
    outline = _outline(value, first, last)
    signal = {n: np.asarray(v, dtype=float) for n, v in frames.items() if n not in ("step", "curves")}
    start = row["trench_start"]
    x, z, pitch = signal["car.x"] - start, height + signal["car.body.z"], signal["car.body.pitch"]
    wheels, struts, forces = [], [], []
    for k, axle in zip(_LEFT, _AXLES, strict=True):
        hub_x = signal[f"car.hub.{k}.x"] - start
        rolled = (hub_x - hub_x[0]) / (radius - value("disc.rolling_loss"))
        wheels.append(Wheel(axle, radius, hub_x, signal[f"car.hub.{k}.z"], rolled))
        struts.append(Strut("vehicle", (value(f"wheel.{k}.x") - row["cg_offset"], 0.1), axle))
        contact = {n: signal[f"car.contact.{k}.{n}"] for n in ("x", "z", "fx", "fz")}
        forces.append(Force(axle, contact["x"] - start, contact["z"], contact["fx"], contact["fz"]))
    cos, sin, nothing = np.cos(pitch), np.sin(pitch), np.zeros(len(x))
    places = {
        "bumper.front": outline[0],
        "bumper.rear": outline[5],
        "belly": ((first + last) / 2, value("outline.belly_height")),
    }
    for name, (bx, bz) in places.items():
        force = signal[f"car.{name}.force"]
        forces.append(Force(name, x + bx * cos + bz * sin, z - bx * sin + bz * cos, nothing, force, "body"))
    readings = [
        Reading("pitch, nose down [deg]", np.degrees(pitch)),
        Reading("speed [km/h]", 3.6 * signal["car.speed"]),
        Reading("vertical acceleration [m/s2]", signal["car.body.az"]),
        Reading("front hub force [kN]", signal["car.hub.a1l.fx"] / 1e3, 0),
    ]
    phase = Phase(CASES, signal["crossing.case"]) if "crossing.case" in signal else None
    length = row["length"]
    ground = [(-30.0, 0.0), (0.0, 0.0), (0.0, -5.0), (length, -5.0), (length, 0.0), (length + 30.0, 0.0)]
    return Scene(
        title=title, step=frames["step"], ground=ground, bodies=[Body("vehicle", outline, x, z, pitch)], wheels=wheels,
        struts=struts, forces=forces, readings=readings, phase=phase, outcome=outcome(row), good=row["passed"],
    )  # fmt: skip


def _height(frames: Row, above_wheels: float) -> float:
    """CG above the road at rest [m]: above the mean of the wheel centres."""
    return above_wheels + float(np.mean([frames[f"car.hub.{k}.z"][0] for k in _LEFT]))


def _outline(value: Any, first: float, last: float) -> list[tuple[float, float]]:
    """Lower outline from the front bumper to the rear one as the plant has it; hull and roof are drawn for the eye only."""
    tip, knee, belly = (value(f"outline.{n}_height") for n in ("tip", "knee", "belly"))
    front, rear = first + value("outline.front_overhang"), last - value("outline.rear_overhang")
    aside, flat = value("outline.knee_distance"), value("outline.belly_distance")
    lower = [
        (front, tip),
        (first + aside, knee),
        (first + flat, belly),
        (last - flat, belly),
        (last - aside, knee),
        (rear, tip),
    ]
    upper = [(rear, 0.35), (rear + 0.2, 1.0), (first - 0.1, 1.05), (first + 0.55, 0.5), (front - 0.05, 0.25)]
    return [*lower, *upper]


def _player(id_: str, takes: list[Take]) -> Animation:
    return Animation(
        id_,
        "The crossing from the side",
        "Left wheels, to scale; positions count from the start of the trench. Orange: force of the ground on a tyre, drawn where it "
        "acts. Red: contact of bumpers and belly; its height is that of the part, not the very point of contact. The hull above the "
        "belly line is drawn for the eye. Both runs share the clock; the road in view follows each vehicle. Frames are 20 ms apart: "
        "peaks of impacts between them are in the time histories and tables. An arrow too long for the picture is cut, and says so.",
        takes,
    )  # fmt: skip


def _animation(study: Study, fmus: FmuSet) -> Section:
    takes = []
    for key in ts.BOLD[::-1]:
        scenes = [scene(_NAMES[s], study.published[*key, s], study.frames[*key, s], fmus) for s in ts.SYSTEMS]
        takes.append(Take(f"{key[0]:g} m, {key[1]:g} km/h", scenes))
    text = (
        "The six crossings that section 5.5 of the thesis shows. Before the front axle reaches the trench the controller raises the "
        "nose by 4 degrees, so that the weight rests on the rear axles; then it retracts each axle as it comes over the trench, and "
        "leans forward for the last one. Retracting takes over when the case changes, at 6 kN per 5 ms."
    )
    return Section("The crossing", [text], animations=[_player("crossing", takes)])


# ---------------------------------------------------------------------- tables


def _verdict(passed: bool) -> str:
    return "passed" if passed else "failed"


def _settled(study: Study, length: float, speed: float, system: str) -> str:
    """The verdict at half the step, marked where it is another one."""
    fine = study.refined[length, speed, system]
    return outcome(fine) if study.verdict(length, speed, system) is None else "the same"


def _refinement(study: Study) -> Section:
    """How much halving the step moves each quantity, over all published crossings."""
    rows: list[list[Any]] = []
    for system in ts.SYSTEMS:
        for n in WEIGHTS:
            change = {k: 100 * abs(study.refined[*k, system][n] / study.published[*k, system][n] - 1) for k in GRID}
            worst = max(change, key=lambda k: change[k])
            coarse, fine = study.published[*worst, system][n], study.refined[*worst, system][n]
            median = float(np.median(list(change.values())))
            rows.append(
                [_NAMES[system], LABELS[n], median, change[worst], f"{worst[0]:g} m, {worst[1]:g} km/h", coarse, fine]
            )
    changed = [(k, s) for s in ts.SYSTEMS for k in GRID if study.verdict(*k, s) is None]
    ms = 1e3 * float(STEP)
    table = Table(
        "refinement", f"Solver, exchange and recording step halved, from {ms:g} to {ms / 2:g} ms",
        ["system", "quantity", "median change [%]", "largest change [%]", "where", "as run", "at half the step"], rows,
        "Over the 36 published crossings of each system.",
    )  # fmt: skip
    text = (
        f"Halving the step changes {len(changed)} of {2 * len(GRID)} verdicts"
        + (
            ""
            if not changed
            else ": " + ", ".join(f"{k[0]:g} m at {k[1]:g} km/h, {_NAMES[s]}" for k, s in changed) + "; these are open"
        )
        + "."
    )
    return Section("Steps", [text], tables=[table])


def _verdicts(study: Study) -> Section:
    tables = []
    short = [
        "az [m/s2]",
        "ax [m/s2]",
        "rms az [m/s2]",
        "rms ax [m/s2]",
        "pitch [deg]",
        *(f"hub {a} [kN]" for a in _AXLES),
    ]
    for system in ts.SYSTEMS:
        rows = []
        for (length, speed), r in zip(GRID, study.rows(system), strict=True):
            row: list[Any] = [length, speed, *(r[n] for n in WEIGHTS), outcome(r)]
            if system == "passive":
                row += [_settled(study, length, speed, system), _verdict(published.passed(length, speed))]
            else:
                row += [_settled(study, length, speed, system), r["force"]]
            rows.append(row)
        last = ["outcome", "at half the step", "Table 5.4" if system == "passive" else "largest actuator force [kN]"]
        title = "Passive crossings (Table 5.4)" if system == "passive" else "Controlled crossings"
        caption = "Limits of Table 5.3: 150 and 100 m/s2, 5 m/s2 rms, 15 deg, 225 kN. Contact of bumpers is allowed, of the belly not."
        tables.append(Table(f"{system}-crossings", title, ["length [m]", "speed [km/h]", *short, *last], rows, caption))
    text = (
        "A crossing fails when a quantity exceeds its limit, when what hangs below the body touches, or when the vehicle is still in "
        "the trench after 1.25 times the time it should take. Root mean squares are those of the whole run, from the start, some "
        "metres ahead of the trench, until the last axle is 1.5 m behind it; the thesis does not say where its runs begin and end."
    )
    return Section("Verdicts", [text], tables=tables)


def _reductions(study: Study) -> Section:
    """Tables 5.6 to 5.8: what control takes off, in per cent, ours beside print."""
    names = {"az": "az", "ax": "ax", "pitch": "pitch", "az_rms": "az rms", "ax_rms": "ax rms"}
    rows = []
    for length, speed in GRID:
        ours, base = study.published[length, speed, "mpc"], study.published[length, speed, "passive"]
        row: list[Any] = [length, speed]
        for n, printed in names.items():
            row += [
                round(reduction_percent(ours[n], base[n])),
                published.number(length, speed, f"{printed} reduction [%]"),
            ]
        rows.append(row)
    columns = ["length [m]", "speed [km/h]"]
    for printed in names.values():
        columns += [f"{printed} [%]", f"{printed}, thesis [%]"]
    table = Table(
        "reductions", "What control takes off, per cent of passive (Tables 5.6 to 5.8)", columns, rows,
        "Negative: control makes it worse.",
    )  # fmt: skip
    return Section("Peaks, pitch and spectra", tables=[table])


def _costs(study: Study) -> Section:
    rows = []
    scores = study.scores()
    for key in GRID:
        base, ours = (study.published[*key, s]["cost"] for s in ts.SYSTEMS)
        low, high = (study.normalised(*key, s) for s in ("mpc", "passive"))
        rows.append(
            [
                *key, round(base), published.number(*key, "passive cost"), round(ours), published.number(*key, "controlled cost"),
                round(high, 3), round(low, 3), round(reduction_percent(low, high), 1), published.number(*key, "improvement [%]"),
                round(scores[key], 1), published.number(*key, "score"),
            ]
        )  # fmt: skip
    columns = [
        "length [m]", "speed [km/h]", "passive", "passive, thesis", "controlled", "controlled, thesis", "passive, normalised",
        "controlled, normalised", "improvement [%]", "improvement, thesis [%]", "score", "score, thesis",
    ]  # fmt: skip
    table = Table(
        "costs", "Cost, normalised cost, improvement and score (Tables 5.9 to 5.11)", columns, rows,
        "Weights of Table 5.10. Normalised over all 72 runs; scores from 5, the lowest cost of the controlled runs, to 1, the highest.",
    )  # fmt: skip
    layers = [
        Layer(_NAMES[s], [[study.normalised(length, speed, s) for length in LENGTHS] for speed in SPEEDS])
        for s in ts.SYSTEMS
    ]
    grid: dict[str, Any] = {
        "x_label": "trench length [m]", "y_label": "speed [km/h]", "value_label": "normalised cost [-]", "x": LENGTHS, "y": SPEEDS,
        "layers": layers,
    }  # fmt: skip
    limit = normalised(cost_of_limits(), study.costs())
    contour = Map(
        "figure-5-40", "Normalised cost over length and speed (figure 5.40)", "Both on one scale; low is good.", **grid
    )
    surface = Map(
        "figure-5-41",
        "The same as surfaces (figure 5.41)",
        f"The plane is the cost of a crossing that just meets every limit of Table 5.3 ({limit:.2f}). Drag to turn.",
        view="surface",
        reference=limit,
        **grid,
    )
    return Section("Cost", figures=[contour, surface], tables=[table])


# ---------------------------------------------------------------------- figures


def _history(title: str, id_: str, frames: dict[str, Row]) -> Figure:
    def series(signal: str, factor: float) -> list[Series]:
        return [_curve(s, f["curves"][signal], factor) for s, f in frames.items()]

    def _curve(system: str, points: list[list[float]], factor: float) -> Series:
        name, (time, values) = _NAMES.get(system, system), points
        return Series(name, time, factor * np.asarray(values), **_LOOKS.get(name, {}))

    time = "time [s]"
    panels = [
        Panel("Pitch, nose down", time, "pitch [deg]", series("car.body.pitch", math.degrees(1.0))),
        Panel("Vertical acceleration", time, "az [m/s2]", series("car.body.az", 1.0)),
        Panel("Longitudinal acceleration", time, "ax [m/s2]", series("car.body.ax", 1.0)),
        Panel("Front hub force", time, "hub force [kN]", series("car.hub.a1l.fx", 1e-3)),
    ]
    caption = "Thinned for drawing; the lowest and highest samples of every stretch are kept, so peaks are those of the tables."
    return Figure(id_, f"Passive and controlled, {title}", caption, panels, columns=2)


def _histories(study: Study) -> Section:
    figures = []
    for number, key in zip(("5-23", "5-26", "5-29", "5-32", "5-35", "5-38"), ts.BOLD, strict=True):
        frames = {s: study.frames[*key, s] for s in ts.SYSTEMS}
        title = f"{key[0]:g} m, {key[1]:g} km/h (figure {number.replace('-', '.')})"
        figures.append(_history(title, f"figure-{number}", frames))
    panels = []
    for axis, word in (("az", "Vertical"), ("ax", "Longitudinal")):
        curves = []
        for system in ts.SYSTEMS:
            f = study.frames[*ts.SPECTRUM, system]
            curves.append(Series(_NAMES[system], f["psd.frequency"], f[f"psd.{axis}"], **_LOOKS[_NAMES[system]]))
        panels.append(
            Panel(
                f"{word} acceleration",
                "frequency [Hz]",
                f"{axis} density [(m/s2)2/Hz]",
                curves,
                x_scale="log",
                y_scale="log",
            )
        )
    figures.append(
        Figure(
            "figure-5-39",
            f"Power spectral density, {ts.SPECTRUM[0]:g} m, {ts.SPECTRUM[1]:g} km/h (figure 5.39)",
            "Periodogram at 1 kHz, mean left in, averaged over twelfths of a decade.",
            panels,
            columns=2,
        )
    )
    return Section("Time histories and spectra", figures=figures)


# ---------------------------------------------------------------------- beyond the published runs


def _summary(rows: list[Row]) -> list[Any]:
    touched = sum("belly contact" in r["failures"] for r in rows)
    stuck = sum("stuck" in r["failures"] for r in rows)
    steep = max(r["pitch"] for r in rows)
    return [
        passes(rows),
        len(rows),
        stuck,
        touched,
        steep,
        max(r["az"] for r in rows),
        round(_mean(rows)),
        _failed(rows),
    ]


def _failed(rows: list[Row]) -> str:
    bad = [r for r in rows if not r["passed"]]
    return ", ".join(f"{r['length']:g}/{r['speed_kmh']:g}" for r in bad) or "–"


_SUMMARY = [
    "passed", "of", "stuck", "belly contact", "largest pitch [deg]", "largest az [m/s2]", "mean cost [-]", "failed [m]/[km/h]",
]  # fmt: skip


def _between(study: Study) -> list[Section]:
    if not study.between:
        return []
    rows = [
        [r["length"], r["speed_kmh"], *(r[n] for n in ("az", "ax", "pitch", "hub_front", "hub_middle", "hub_rear", "cost")), outcome(r)]
        for r in study.between
    ]  # fmt: skip
    columns = [
        "length [m]",
        "speed [km/h]",
        *(LABELS[n] for n in ("az", "ax", "pitch", "hub_front", "hub_middle", "hub_rear")),
    ]
    table = Table("between", "Controlled crossings off the published grid", [*columns, "cost [-]", "outcome"], rows)
    return [Section("Between the grid points", ["The same controller, nothing changed."], tables=[table])]


def _some(study: Study) -> list[Row]:
    return [study.published[a, b, "mpc"] for a, b in ts.SOME]


def _without(study: Study) -> list[Section]:
    if not study.without:
        return []
    rows = [["as it is", *_summary(_some(study))]]
    rows += [[text, *_summary(study.without[c])] for c, text in ts.WITHOUT.items()]
    table = Table(
        "without", "Controlled crossings of 1.2, 1.6 and 2.0 m, one thing changed", ["change", *_SUMMARY], rows
    )
    text = (
        "What makes the crossing work, seen by leaving it out. Each line is twelve crossings at 1, 3, 6 and 9 km/h. LQR and MPC "
        "without preview get the pitch reference of the crossing algorithm; LQR has no forced ranges."
    )
    return [Section("What it depends on", [text], tables=[table])]


def _vehicles(study: Study) -> list[Section]:
    if not study.vehicles:
        return []
    rows = [["as the controller knows it", *_summary(_some(study))]]
    rows += [[n, *_summary(r)] for n, r in study.vehicles.items()]
    table = Table(
        "vehicles", "Controlled crossings of 1.2, 1.6 and 2.0 m, another vehicle", ["vehicle", *_SUMMARY], rows
    )
    text = "The plant is changed, the controller and what it knows of the vehicle are not."
    return [Section("Where the edge is", [text], tables=[table])]


def _linear(study: Study) -> Section:
    quantities = (
        ("z", "Body height (figure 5.1)", "body height [m]"),
        ("pitch", "Pitch, nose down (figure 5.2)", "pitch [deg]"),
        ("speed", "Speed (figure 5.3)", "speed [km/h]"),
    )
    looks = {"linear": {"color": "orange", "dash": "dash"}, "nonlinear": {"color": "blue", "dash": "solid"}}
    panels = [
        Panel(title, "time [s]", label, [Series(n, s["time"], s[q], **looks[n]) for n, s in study.linear.items()])  # type: ignore[arg-type]
        for q, title, label in quantities
    ]
    speed, depth = ts.LINEAR
    figure = Figure(
        "figure-5-1",
        f"Linear and nonlinear passive vehicle, trench {depth:g} m deep at {speed:g} km/h (figures 5.1 to 5.3)",
        "The same masses, springs, wheel positions and trench with sloped edges. The linear vehicle follows the road at a point below each "
        "wheel and keeps its speed; the nonlinear one has discs for wheels, which bridge the edges, and is slowed by them.",
        panels,
    )  # fmt: skip
    return Section("Linear against nonlinear vehicle", figures=[figure])


def _limits() -> Section:
    return Section(
        "Limits of this comparison",
        [
            "The thesis keeps its vehicle to itself. Masses, geometry and tyres of ours are assumed, some of them with Table 5.4 in view; "
            "its multi-body model has suspension links and a tyre model that a disc on solids does not replace. So peaks of impacts "
            "agree in size at best.",
            f"The vehicle is solved, exchanged and recorded every {1e3 * float(STEP):g} ms, and peaks are those of all these samples: where "
            "body and ground meet, "
            "the acceleration rises within a solver step and falls within a few milliseconds, so that samples 1 ms apart can miss its peak. "
            "RMS values are those of samples at 1 kHz.",
            "Readings of the thesis that matter: the forced ranges of Table 4.8 lift an axle only with their sign turned; the rate limit of "
            "Table 4.5 counts per control interval in the thesis's tool and never binds there, here it counts as N/s; limits on outputs "
            "(Table 4.6) are off; pitch keeps its weight of 100 in all cases, and the height of the body is weighed too. What each of "
            "them does is in the table of changes. Windows of the cases and the pitch reference (4 deg) are not in the thesis.",
        ],
    )


def _parameters() -> list[Parameter]:
    limits = [
        Parameter(f"limit.{n}", getattr(LIMITS, n), LABELS[n].split("[")[1][:-1], "003 Table 5.3") for n in WEIGHTS
    ]
    weights = [Parameter(f"weight.{n}", w, "%", "003 Table 5.10") for n, w in WEIGHTS.items()]
    return [*limits, *weights]


__all__ = ["CONTROLS", "CORNERS", "report", "scene", "single", "write"]
