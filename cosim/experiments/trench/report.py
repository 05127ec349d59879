"""Tables, figures and the animation of paper 003's trench crossings as a report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.experiments.metrics.crossing import LABELS, LIMITS, WEIGHTS, cost_of_limits, normalized, reduction_percent
from cosim.experiments.trench import EXPERIMENT, linear, published
from cosim.experiments.trench.claims import (
    CLAIMS,
    costs,
    improvements,
    normalized_costs,
    passes,
    ran,
    score,
    verdict,
)
from cosim.experiments.trench.published import (
    BOLD,
    GRID,
    LENGTHS,
    OTHER_VEHICLES,
    SPECTRUM,
    SPEEDS,
    SYSTEMS,
    WITHOUT,
    Key,
    between,
    matrix,
    refined,
    some,
)
from cosim.experiments.trench.runs import FRAME, MPC, SIDE, STEP, Case, configure, measure, passive, signals, wire
from cosim.report import (
    Animation,
    Figure,
    Layer,
    Map,
    Panel,
    Parameter,
    Phase,
    Playback,
    Report,
    Section,
    Series,
    Table,
    Take,
    write_report,
)
from cosim.scenes import infer_scene
from cosim.scenes.scene import Reading
from cosim.study import FmuSet, Results, Row, Run, make_lead, parameters, provenance, sections
from fmu_sources.models.corners import SIX_CORNERS

CASES = (
    "case 0: no axle over the trench",
    "case 1: front axle over the trench",
    "case 2: middle axle over the trench",
    "case 3: rear axle over the trench",
)
FORCE_SCALE = 1e5  # N that are drawn as long as a meter
_NAMES = {"passive": "passive", "mpc": "controlled"}
_LOOKS: dict[str, Any] = {
    "passive": {"color": "gray", "dash": "dash"},
    "controlled": {"color": "blue", "dash": "solid"},
}
_AXLES = ("front", "middle", "rear")


def report(study: Results, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    makers = (
        _verdicts,
        _reductions,
        _costs,
        _histories,
        _refinement,
        _between,
        _without,
        _vehicles,
        _linear,
        _limits,
    )
    lead, figure = make_lead(study, _main_result)
    about = Section(
        "Runs of the study",
        [
            "A three-axle vehicle drives over trenches of 1.2 to 2.0 m at 1 to 9 km/h, passive and under predictive"
            " control that sees the trench coming, lifts the axle above it and shifts its weight. Vehicle, crossing"
            " algorithm and controller are native FMUs. The tables of Kale's thesis stand beside what these runs"
            " give.",
            _ANIMATED,
        ],
    )
    return Report(
        experiment=EXPERIMENT.name,
        title="A 6x6 crosses trenches",
        lead=lead,
        figure=figure,
        animation=_animation(study, fmus),
        claims=CLAIMS.judge(study),
        sections=[about, *sections(study, makers)],
        parameters=_parameters(fmus),
        provenance=provenance(EXPERIMENT, fmus),
    )


def _main_result(study: Results) -> tuple[str, Figure]:
    """Which trenches the vehicle crosses."""
    passed = {s: [c for c in matrix(s) if study[c]["passed"]] for s in SYSTEMS}
    lead = (
        f"With predictive control the 6x6 passes {len(passed['mpc'])} of {len(matrix('mpc'))} crossings of trenches"
        f" {min(LENGTHS):g} to {max(LENGTHS):g} m long at {min(SPEEDS):g} to {max(SPEEDS):g} km/h, within the limits of"
        " acceleration, pitch and hub force and without contact of the belly; without control it passes"
        f" {len(passed['passive'])} of {len(matrix('passive'))}."
    )
    panels = []
    for s in SYSTEMS:
        good = passed[s]
        bad = [c for c in matrix(s) if c not in good]
        marks = [
            Series(name, [c.length for c in cases], [c.speed_kmh for c in cases], color=color, mode="markers")  # type: ignore[arg-type]
            for name, color, cases in (("passes", "green", good), ("fails", "vermilion", bad))
            if cases
        ]
        panels.append(Panel(_NAMES[s], "trench length [m]", "speed [km/h]", marks))
    caption = "Each point is a crossing; limits are those of Table 5.3 of the thesis."
    return lead, Figure("main-result", "Crossings by length of the trench and speed", caption, panels, columns=2)


def page(runs: Mapping[str, Run], fmus: FmuSet, folder: Path) -> Path:
    """Write the page of one crossing, by controller: its animation, time plots and quantities."""
    return write_report(single(runs, fmus), folder)


def single(runs: Mapping[str, Run], fmus: FmuSet) -> Report:
    """The page of one crossing."""
    rows, drawn = ({name: make(run) for name, run in runs.items()} for make in (measure, signals))
    case: Case = [run.case for run in runs.values()][-1]
    title = key_text((case.length, case.speed_kmh))
    take = Take(title, [playback(_NAMES.get(s, s), run.case, rows[s], drawn[s], fmus) for s, run in runs.items()])
    columns = ["quantity", "limit", *rows]
    lines = [[LABELS[n], getattr(LIMITS, n), *(r[n] for r in rows.values())] for n in WEIGHTS]
    lines += [["cost [-]", None, *(r["cost"] for r in rows.values())]]
    lines += [["outcome", None, *(r["outcome"] for r in rows.values())]]
    files = [f for run in runs.values() for f in run.system.fmu_files]
    alone = replace(EXPERIMENT, wiring=replace(EXPERIMENT.wiring, fmus=()), study=replace(EXPERIMENT.study, parts=()))
    return Report(
        experiment=EXPERIMENT.name,
        title=f"Crossing a trench: {title}",
        lead=f"A 6x6 drives over a trench of {case.length:g} m at {case.speed_kmh:g} km/h.",
        sections=[
            Section(
                "The crossing",
                animations=[_player("crossing", [take])],
                figures=[_history(title, "time-histories", drawn)],
                tables=[Table("quantities", "Quantities of Table 5.3", columns, lines)],
            )
        ],
        provenance=provenance(alone, fmus, files),
    )


def key_text(key: Key) -> str:
    """Length and speed."""
    return f"{key[0]:g} m, {key[1]:g} km/h"


def _mean(rows: list[Row]) -> float:
    return float(np.mean([r["cost"] for r in rows]))


# ---------------------------------------------------------------------- animation


def playback(title: str, case: Case, row: Row, drawn: Row, fmus: FmuSet) -> Playback:
    """A run of the vehicle. Both sides meet the trench alike, so the right one has the series of the left one."""
    with wire(fmus, passive(case)) as system:
        configure(system, passive(case))
        looks = infer_scene(system)
        car = system["car"]
        constant = {f"car.{n}": car.values.get(n, v.start) for n, v in car.description.parameters.items()}
    assert looks is not None
    recorded = {name: np.asarray(values, dtype=float) for name, values in drawn["frames"].items()}
    series: dict[str, Any] = constant | {"car.body.roll": 0.0, **recorded, "car.trench.start": row["trench_start"]}
    for left in SIDE:
        series |= {n.replace(f".{left}.", f".{left[:-1]}r."): v for n, v in recorded.items() if f".{left}." in n}
    readings = [
        Reading("pitch, nose down", "deg", "car.body.pitch", factor=math.degrees(1.0)),
        Reading("speed", "km/h", "car.speed", factor=3.6),
        Reading("vertical acceleration", "m/s2", "car.body.az"),
        Reading("front hub force", "kN", "car.hub.a1l.fx", 0, 1e-3),
    ]
    shown = replace(looks, readings=readings, limits=(), dimensions=(), force_scale=FORCE_SCALE)
    return Playback(
        title=title,
        step=float(FRAME),
        scene=shown,
        series={name: series[name] for name in shown.variables},
        phase=Phase(CASES, recorded["crossing.case"]) if "crossing.case" in recorded else None,
        outcome=row["outcome"],
        good=row["passed"],
    )


def _player(id_: str, takes: list[Take]) -> Animation:
    return Animation(
        id_,
        "The crossing, from any side",
        "To scale; positions count from where the CG begins. Orange: force of the ground on a tire, where it acts."
        " Red: contact of bumpers and belly; its height is that of the part, not the very point of contact. The hull"
        " above the belly line is drawn for orientation. Both runs share the clock; the road in view follows each"
        " vehicle. Frames are 20 ms apart: peaks of impacts between them are in the time histories and tables."
        " An arrow that is too long for the picture is cut, with its size beside it.",
        takes,
    )


_ANIMATED = (
    "The animation shows the six crossings of section 5.5 of the thesis. Before the front axle reaches the trench the"
    " controller raises the nose by 4 degrees, so that the weight rests on the rear axles; then it retracts each axle"
    " as it comes over the trench, and leans forward for the last one. Retracting takes over when the case changes, at"
    " 6 kN per 5 ms."
)


def _animation(study: Results, fmus: FmuSet) -> Animation | None:
    """The published crossings from the side, of those whose runs did not fail."""
    takes = []
    for key in BOLD[::-1]:
        cases = {_NAMES[s]: Case(*key, s) for s in SYSTEMS}
        if not set(cases.values()) <= set(study.ran):
            continue
        scenes = [playback(name, c, study[c], study.signals(c), fmus) for name, c in cases.items()]
        takes.append(Take(key_text(key), scenes))
    return _player("crossing", takes) if takes else None


# ---------------------------------------------------------------------- tables


def _refinement(study: Results) -> Section:
    """Steps."""
    rows: list[list[Any]] = []
    for system in SYSTEMS:
        for n in WEIGHTS:
            pairs = {k: [study[c][n] for c in (Case(*k, system), refined(Case(*k, system)))] for k in GRID}
            change = {k: 100 * abs(fine / coarse - 1) for k, (coarse, fine) in pairs.items()}
            worst = max(change, key=lambda k: change[k])
            median = float(np.median(list(change.values())))
            rows.append([_NAMES[system], LABELS[n], median, change[worst], key_text(worst), *pairs[worst]])
    changed = [(k, s) for s in SYSTEMS for k in GRID if verdict(study, k, s) is None]
    where = ", ".join(f"{k[0]:g} m at {k[1]:g} km/h, {_NAMES[s]}" for k, s in changed)
    ms = 1e3 * float(STEP)
    table = Table(
        "refinement",
        f"Solver, exchange and recording step halved, from {ms:g} to {ms / 2:g} ms",
        ["system", "quantity", "median change [%]", "largest change [%]", "where", "as run", "at half the step"],
        rows,
        "Over the 36 published crossings of each system.",
    )
    text = f"Halving the step changes {len(changed)} of {len(SYSTEMS) * len(GRID)} verdicts"
    return Section("Steps", [f"{text}: {where}; these are open." if changed else f"{text}."], tables=[table])


def _verdicts(study: Results) -> Section:
    tables = []
    short = [
        "az [m/s2]",
        "ax [m/s2]",
        "rms az [m/s2]",
        "rms ax [m/s2]",
        "pitch [deg]",
        *(f"hub {a} [kN]" for a in _AXLES),
    ]
    for system, title, last in (
        ("passive", "Passive crossings (Table 5.4)", "Table 5.4"),
        ("mpc", "Controlled crossings", "largest actuator force [kN]"),
    ):
        rows = []
        for key in GRID:
            r, fine = (study[c] for c in (Case(*key, system), refined(Case(*key, system))))
            row: list[Any] = [*key, *(r[n] for n in WEIGHTS), r["outcome"]]
            row.append("the same" if verdict(study, key, system) is not None else fine["outcome"])
            row.append(r["force"] if system == "mpc" else "passed" if published.passed(*key) else "failed")
            rows.append(row)
        columns = ["length [m]", "speed [km/h]", *short, "outcome", "at half the step", last]
        caption = (
            "Limits of Table 5.3: 150 and 100 m/s2, 5 m/s2 rms, 15 deg, 225 kN. Contact of bumpers is allowed, of the"
            " belly not."
        )
        tables.append(Table(f"{system}-crossings", title, columns, rows, caption))
    text = (
        "A crossing fails when a quantity exceeds its limit, when what hangs below the body touches, or when the"
        " vehicle is still in the trench after 1.25 times the time it should take. Root mean squares are those of the"
        " whole run, from the start, some meters ahead of the trench, until the last axle is 1.5 m behind it; the"
        " thesis does not say where its runs begin and end."
    )
    return Section("Verdicts", [text], tables=tables)


def _reductions(study: Results) -> Section:
    """Peaks, pitch and spectra."""
    names = {"az": "az", "ax": "ax", "pitch": "pitch", "az_rms": "az rms", "ax_rms": "ax rms"}
    rows = []
    for key in GRID:
        controlled, base = (study[Case(*key, s)] for s in ("mpc", "passive"))
        row: list[Any] = [*key]
        for n, printed in names.items():
            reduction = published.number(*key, f"{printed} reduction [%]")
            row += [round(reduction_percent(controlled[n], base[n])), reduction]
        rows.append(row)
    columns = ["length [m]", "speed [km/h]"]
    for printed in names.values():
        columns += [f"{printed} [%]", f"{printed}, thesis [%]"]
    table = Table(
        "reductions",
        "Reduction by control, per cent of passive (Tables 5.6 to 5.8)",
        columns,
        rows,
        "Negative: control makes it worse.",
    )
    figures = [_over_length(study, n, LABELS[n]) for n in ("az", "pitch")]
    return Section("Peaks, pitch and spectra", figures=figures, tables=[table])


def _over_length(study: Results, metric: str, label: str) -> Figure:
    """A quantity over the length of the trench, a panel for each speed, with the cells that the thesis prints."""
    column = published.COLUMNS.get(metric, metric)
    panels = []
    for speed in SPEEDS:
        shown = []
        for system, name in _NAMES.items():
            values = [study[Case(length, speed, system)][metric] for length in LENGTHS]
            shown.append(Series(name, LENGTHS, values))
            cells = [published.number(length, speed, f"{name} {column}") for length in LENGTHS]
            theirs = [math.nan if cell is None else cell for cell in cells]
            shown.append(Series(f"{name}, thesis", LENGTHS, theirs, color=_LOOKS[name]["color"], mode="markers"))
        panels.append(Panel(f"{speed:g} km/h", "trench length [m]", label, shown))
    return Figure(
        f"{metric}-over-length",
        f"{label.partition(' [')[0].capitalize()} over the length of the trench",
        "Lines: this project; points: cells of Tables 5.4 and 5.6 to 5.9, as far as they are in print.",
        panels,
        columns=2,
    )


def _costs(study: Results) -> Section:
    """Cost."""
    rows: list[list[Any]] = []
    scores, taken = score(study), improvements(study)
    scaled = {s: normalized_costs(study, s) for s in SYSTEMS}
    for key in GRID:
        base, controlled = (study[Case(*key, s)]["cost"] for s in SYSTEMS)
        rows.append(
            [
                *key,
                round(base),
                published.number(*key, "passive cost"),
                round(controlled),
                published.number(*key, "controlled cost"),
                *(round(scaled[s][key], 3) for s in SYSTEMS),
                round(taken[key], 1) if key in taken else None,
                published.number(*key, "improvement [%]"),
                round(scores[key], 1),
                published.number(*key, "score"),
            ]
        )
    columns = [
        "length [m]",
        "speed [km/h]",
        "passive",
        "passive, thesis",
        "controlled",
        "controlled, thesis",
        "passive, normalized",
        "controlled, normalized",
        "improvement [%]",
        "improvement, thesis [%]",
        "score",
        "score, thesis",
    ]
    table = Table(
        "costs",
        "Cost, normalized cost, improvement and score (Tables 5.9 to 5.11)",
        columns,
        rows,
        "Weights of Table 5.10. Normalized over all 72 runs; scores from 5, the lowest cost of the controlled runs, to"
        " 1, the highest.",
    )
    layers = [Layer(_NAMES[s], [[scaled[s][length, speed] for length in LENGTHS] for speed in SPEEDS]) for s in SYSTEMS]
    limit = normalized(cost_of_limits(), costs(study))
    contour = Map(
        "figure-5-40",
        "Normalized cost over length and speed (figures 5.40 and 5.41)",
        "On one scale; low is good. The red line, where there is one, is the cost of a crossing that just meets every"
        f" limit of Table 5.3 ({limit:.2f}), the plane of figure 5.41.",
        x_label="trench length [m]",
        y_label="speed [km/h]",
        value_label="normalized cost [-]",
        x=LENGTHS,
        y=SPEEDS,
        layers=layers,
        value_range=(0.0, max(1.0, limit)),
        reference=limit,
    )
    lines = _over_length(study, "cost", "cost [-]")
    return Section("Cost", figures=[contour, lines], tables=[table])


# ---------------------------------------------------------------------- figures


def _history(title: str, id_: str, drawn: Mapping[str, Row]) -> Figure:
    def series(signal: str, factor: float) -> list[Series]:
        curves = {_NAMES.get(s, s): d["curves"][signal] for s, d in drawn.items()}
        return [Series(n, x, factor * np.asarray(y), **_LOOKS.get(n, {})) for n, (x, y) in curves.items()]

    time = "time [s]"
    panels = [
        Panel("Pitch, nose down", time, "pitch [deg]", series("car.body.pitch", math.degrees(1.0))),
        Panel("Vertical acceleration", time, "az [m/s2]", series("car.body.az", 1.0)),
        Panel("Longitudinal acceleration", time, "ax [m/s2]", series("car.body.ax", 1.0)),
        Panel("Front hub force", time, "hub force [kN]", series("car.hub.a1l.fx", 1e-3)),
    ]
    caption = (
        "Thinned for drawing; the lowest and highest samples of every stretch are kept, so peaks are those of the"
        " tables."
    )
    return Figure(id_, f"Passive and controlled, {title}", caption, panels, columns=2)


def _histories(study: Results) -> Section:
    """Time histories and spectra."""
    figures = []
    for number, key in zip(("5-23", "5-26", "5-29", "5-32", "5-35", "5-38"), BOLD, strict=True):
        title = f"{key_text(key)} (figure {number.replace('-', '.')})"
        figures.append(_history(title, f"figure-{number}", {s: study.signals(Case(*key, s)) for s in SYSTEMS}))
    panels = []
    for axis, word in (("az", "Vertical"), ("ax", "Longitudinal")):
        spectra = {_NAMES[s]: study.signals(Case(*SPECTRUM, s))["spectra"][axis] for s in SYSTEMS}
        curves = [Series(n, *spectrum, **_LOOKS[n]) for n, spectrum in spectra.items()]
        y_label = f"{axis} density [(m/s2)2/Hz]"
        panels.append(Panel(f"{word} acceleration", "frequency [Hz]", y_label, curves, x_scale="log", y_scale="log"))
    figures.append(
        Figure(
            "figure-5-39",
            f"Power spectral density, {key_text(SPECTRUM)} (figure 5.39)",
            "Periodogram at 1 kHz, mean left in, averaged over twelfths of a decade.",
            panels,
            columns=2,
        )
    )
    return Section("Time histories and spectra", figures=figures)


# ---------------------------------------------------------------------- beyond the published runs


_SUMMARY = [
    "passed",
    "of",
    "stuck",
    "belly contact",
    "largest pitch [deg]",
    "largest az [m/s2]",
    "mean cost [-]",
    "failed [m]/[km/h]",
]


def _summary(study: Results, cases: list[Case]) -> list[Any]:
    rows = ran(study, cases)
    bad = [f"{c.length:g}/{c.speed_kmh:g}" for c in cases if not study[c]["passed"]]
    stuck, touched = (sum(why in r["failures"] for r in rows) for why in ("stuck", "belly contact"))
    pitch, az = (max(r[n] for r in rows) for n in ("pitch", "az"))
    return [passes(rows), len(rows), stuck, touched, pitch, az, round(_mean(rows)), ", ".join(bad) or "–"]


def _between(study: Results) -> list[Section]:
    """Between the grid points."""
    names = ("az", "ax", "pitch", "hub_front", "hub_middle", "hub_rear")
    rows: list[list[Any]] = [
        [c.length, c.speed_kmh, *(study[c][n] for n in (*names, "cost", "outcome"))] for c in between() if c in study
    ]
    columns = ["length [m]", "speed [km/h]", *(LABELS[n] for n in names), "cost [-]", "outcome"]
    table = Table("between", "Controlled crossings off the published grid", columns, rows)
    return [Section("Between the grid points", ["The same controller, nothing changed."], tables=[table])] * bool(rows)


def _without(study: Results) -> list[Section]:
    """Ablation: one part of the controller changed at a time."""
    changed = {words: some(controller) for controller, words in WITHOUT.items()}
    text = (
        "Each row leaves out or changes one part of the controller, for twelve crossings at 1, 3, 6 and 9 km/h. LQR"
        " and MPC without preview get the pitch reference of the crossing algorithm; LQR has no forced ranges."
    )
    tables = _changed(study, "without", "one thing changed", "change", {"as it is": some(), **changed})
    return [Section("Ablation", [text], tables=tables)] * bool(tables)


def _vehicles(study: Results) -> list[Section]:
    """Robustness to other vehicles."""
    changed = {words: some(**changes) for words, changes in OTHER_VEHICLES.items()}
    text = "The plant changes; the controller and its model of the vehicle do not."
    tables = _changed(
        study, "vehicles", "another vehicle", "vehicle", {"as the controller knows it": some(), **changed}
    )
    return [Section("Robustness to the vehicle", [text], tables=tables)] * bool(tables)


def _changed(study: Results, id_: str, what: str, column: str, lines: Mapping[str, list[Case]]) -> list[Table]:
    """A line for each change, from the crossings under it; no table where the study left them out."""
    if not all(c in study for cases in lines.values() for c in cases):
        return []
    rows = [[words, *_summary(study, cases)] for words, cases in lines.items()]
    return [Table(id_, f"Controlled crossings of 1.2, 1.6 and 2.0 m, {what}", [column, *_SUMMARY], rows)]


def _linear(study: Results) -> Section:
    """Linear compared with nonlinear vehicle."""
    quantities = (
        ("z", "Body height (figure 5.1)", "body height [m]"),
        ("pitch", "Pitch, nose down (figure 5.2)", "pitch [deg]"),
        ("speed", "Speed (figure 5.3)", "speed [km/h]"),
    )
    looks: dict[str, Any] = {
        "linear": {"color": "orange", "dash": "dash"},
        "nonlinear": {"color": "blue", "dash": "solid"},
    }
    drawn = {n: study.signals(linear.Shallow(n)) for n in looks}
    panels = [
        Panel(title, "time [s]", label, [Series(n, d["time"], d[q], **looks[n]) for n, d in drawn.items()])
        for q, title, label in quantities
    ]
    figure = Figure(
        "figure-5-1",
        f"Linear and nonlinear passive vehicle, trench {linear.DEPTH:g} m deep at {linear.SPEED_KMH:g} km/h (figures"
        " 5.1 to 5.3)",
        "The same masses, springs, wheel positions and trench with sloped edges. The linear vehicle follows the road at"
        " a point below each wheel and keeps its speed; the nonlinear one has discs for wheels, which bridge the edges,"
        " and is slowed by them.",
        panels,
    )
    return Section("Linear compared with nonlinear vehicle", figures=[figure])


def _limits(_: Results) -> Section:
    return Section(
        "Limits of this comparison",
        [
            (
                "The thesis does not disclose its vehicle. The masses, geometry and tires are assumed, some of them"
                " with Table 5.4 in view; its multi-body model has suspension links and a tire model that a disc on"
                " solids does not replace. So peaks of impacts agree in order of magnitude at best."
            ),
            (
                f"The vehicle is solved, exchanged and recorded every {1e3 * float(STEP):g} ms, and peaks are those of"
                " all these samples: where body and ground meet, the acceleration rises within a solver step and falls"
                " within a few milliseconds, so that samples 1 ms apart can miss its peak. RMS values are those of"
                " samples at 1 kHz."
            ),
            (
                "Readings of the thesis that matter: the forced ranges of Table 4.8 lift an axle only with their sign"
                " turned; the rate limit of Table 4.5 counts per control interval in the thesis's tool and never binds"
                " there, here it counts as N/s; limits on outputs (Table 4.6) are off; pitch keeps its weight of 100 in"
                " all cases, and the height of the body is weighed too. The effect of each is in the table of"
                " changes. Windows of the cases and the pitch reference (4 deg) are not in the thesis."
            ),
        ],
    )


def _parameters(fmus: FmuSet) -> list[Parameter]:
    """Parameters of vehicle, crossing algorithm and controller, and those of Table 5.3.

    The vehicle's right corners are left out, since they equal the left ones, and so are parameters that a run sets.
    """
    aside = (
        *(f".{k}." for k in SIX_CORNERS[1::2]),
        "outline.left.",
        "outline.right.",
        "outline.points",
        "trench.start",
        "trench.length",
    )
    vehicle = parameters(fmus.path("ThreeAxleTrench"), set_to={"solver.step": float(STEP)})
    limits = [
        Parameter(f"limit.{n}", getattr(LIMITS, n), LABELS[n].split("[")[1][:-1], "003 Table 5.3") for n in WEIGHTS
    ]
    return [
        *(p for p in vehicle if not any(n in p.name for n in aside)),
        *parameters(fmus.path("TrenchCrossing"), prefix="crossing."),
        *parameters(fmus.path("MpcThreeAxle"), prefix="controller.", set_to=MPC),
        *limits,
        *(Parameter(f"weight.{n}", w, "%", "003 Table 5.10") for n, w in WEIGHTS.items()),
    ]
