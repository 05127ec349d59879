"""Tables, figures and the animation of paper 003's trench crossings as a report."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cosim.experiments.metrics.crossing import LABELS, LIMITS, WEIGHTS, cost, normalized, reduction_percent
from cosim.experiments.trench import EXPERIMENT, claims, linear, published
from cosim.experiments.trench.published import BOLD, GRID, LENGTHS, SPEEDS, SYSTEMS, Key, matrix, refined, some
from cosim.experiments.trench.runs import FRAME, MPC, SIDE, STEP, Case, configure, measure, signals, wire
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
    over_time,
    write_report,
)
from cosim.report.model import Look
from cosim.scenes import infer_scene
from cosim.scenes.scene import Reading
from cosim.study import Content, FmuSet, Results, Row, Run, StudyReport, parameters, provenance
from fmu_sources.models.corners import SIX_CORNERS

CASES = (
    "case 0: no axle over the trench",
    "case 1: front axle over the trench",
    "case 2: middle axle over the trench",
    "case 3: rear axle over the trench",
)
_words = claims.TrenchView.named.format  # of length and speed
FORCE_SCALE = 1e5  # N that are drawn as long as a meter
_NAMES = {"passive": "passive", "mpc": "controlled"}
_LOOKS: dict[str, Look] = {
    "passive": ("gray", "dash"),
    "controlled": ("blue", "solid"),
    "passive, thesis": "gray",
    "controlled, thesis": "blue",
    "linear": ("orange", "dash"),
    "nonlinear": ("blue", "solid"),
    "passes": "green",
    "fails": "vermilion",
}


def _key_cells(key: Key) -> dict[str, Any]:
    return dict(zip(("length [m]", "speed [km/h]"), key, strict=True))


def _parameters(fmus: FmuSet) -> list[Parameter]:
    """Parameters of vehicle, crossing algorithm and controller, and those of Table 5.3.

    The vehicle's right corners are left out, since they equal the left ones, and so are parameters that a run sets.
    """
    right = [f".{k}." for k in SIX_CORNERS[1::2]]
    aside = (*right, "outline.left.", "outline.right.", "outline.points", "trench.start", "trench.length")
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


def playback(title: str, case: Case, row: Row, drawn: Row, fmus: FmuSet) -> Playback:
    """A run of the vehicle. Both sides meet the trench alike, so the right one has the series of the left one."""
    with wire(fmus, case.passive()) as system:
        configure(system, case.passive())
        looks = infer_scene(system)
        car = system["car"]
        constant = {f"car.{n}": car.start(n) for n in car.description.parameters}
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


def _animation(study: Results, fmus: FmuSet) -> Animation | None:
    """The published crossings from the side, of those whose runs did not fail."""
    takes = []
    for key in BOLD[::-1]:
        cases = {_NAMES[s]: Case(*key, s) for s in SYSTEMS}
        if not set(cases.values()) <= set(study.ran):
            continue
        scenes = [playback(name, c, study[c], study.signals(c), fmus) for name, c in cases.items()]
        takes.append(Take(_words(*key), scenes))
    return _player("crossing", takes) if takes else None


def page(runs: Mapping[str, Run], fmus: FmuSet, folder: Path) -> Path:
    """Write the page of one crossing, by controller: its animation, time plots and quantities."""
    return write_report(single(runs, fmus), folder)


def single(runs: Mapping[str, Run], fmus: FmuSet) -> Report:
    """The page of one crossing."""
    rows, drawn = ({name: make(run) for name, run in runs.items()} for make in (measure, signals))
    case: Case = [run.case for run in runs.values()][-1]
    title = _words(case.length, case.speed_kmh)
    take = Take(title, [playback(_NAMES.get(s, s), run.case, rows[s], drawn[s], fmus) for s, run in runs.items()])
    lines = [
        {"quantity": words, "limit": getattr(LIMITS, n, None), **{s: r[n] for s, r in rows.items()}}
        for n, words in {**LABELS, "cost": "cost [-]", "outcome": "outcome"}.items()
    ]
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
                tables=[Table.of("quantities", "Quantities of Table 5.3", lines)],
            )
        ],
        provenance=provenance(alone, fmus, files),
        looks=_LOOKS,
    )


def _history(title: str, id_: str, drawn: Mapping[str, Row]) -> Figure:
    panels = []
    for name, label, signal, factor in (
        ("Pitch, nose down", "pitch [deg]", "car.body.pitch", math.degrees(1.0)),
        ("Vertical acceleration", "az [m/s2]", "car.body.az", 1.0),
        ("Longitudinal acceleration", "ax [m/s2]", "car.body.ax", 1.0),
        ("Front hub force", "hub force [kN]", "car.hub.a1l.fx", 1e-3),
    ):
        curves = {_NAMES.get(s, s): d["curves"][signal] for s, d in drawn.items()}
        panels.append(
            Panel(name, "time [s]", label, [Series(n, x, factor * np.asarray(y)) for n, (x, y) in curves.items()])
        )
    caption = (
        "Thinned for drawing; the lowest and highest samples of every stretch are kept, so peaks are those of the"
        " tables."
    )
    return Figure(id_, f"Passive and controlled, {title}", caption, panels, columns=2)


report = StudyReport(
    EXPERIMENT, "A 6x6 crosses trenches", claims.CLAIMS, _parameters, looks=_LOOKS, animation=_animation
)


@report.lead
def _main_result(study: Results) -> Content:
    passed = {s: [c for c in matrix(s) if study[c]["passed"]] for s in SYSTEMS}
    yield f"""With predictive control the 6x6 passes {len(passed["mpc"])} of {len(matrix("mpc"))} crossings of trenches
    {min(LENGTHS):g} to {max(LENGTHS):g} m long at {min(SPEEDS):g} to {max(SPEEDS):g} km/h, within the limits of
    acceleration, pitch and hub force and without contact of the belly; without control it passes
    {len(passed["passive"])} of {len(matrix("passive"))}."""
    panels = []
    for s in SYSTEMS:
        marked = {"passes": passed[s], "fails": [c for c in matrix(s) if c not in passed[s]]}
        marks = [
            Series(name, [c.length for c in cases], [c.speed_kmh for c in cases], mode="markers")
            for name, cases in marked.items()
            if cases
        ]
        panels.append(Panel(_NAMES[s], "trench length [m]", "speed [km/h]", marks))
    caption = "Each point is a crossing; limits are those of Table 5.3 of the thesis."
    yield Figure("main-result", "Crossings by length of the trench and speed", caption, panels, columns=2)


@report.section("Runs of the study")
def _about(_: Results) -> Content:
    yield """A three-axle vehicle drives over trenches of 1.2 to 2.0 m at 1 to 9 km/h, passive and under predictive
    control that sees the trench coming, lifts the axle above it and shifts its weight. Vehicle, crossing algorithm and
    controller are native FMUs. The tables of Kale's thesis stand beside what these runs give.

    The animation shows the six crossings of section 5.5 of the thesis. Before the front axle reaches the trench the
    controller raises the nose by 4 degrees, so that the weight rests on the rear axles; then it retracts each axle as
    it comes over the trench, and leans forward for the last one. Retracting takes over when the case changes, at 6 kN
    per 5 ms."""


@report.section("Verdicts")
def _verdicts(study: Results) -> Content:
    yield """A crossing fails when a quantity exceeds its limit, when what hangs below the body touches, or when the
    vehicle is still in the trench after 1.25 times the time it should take. Root mean squares are those of the whole
    run, from the start, some meters ahead of the trench, until the last axle is 1.5 m behind it; the thesis does not
    say where its runs begin and end."""
    axles = (f"hub {axle} [kN]" for axle in ("front", "middle", "rear"))
    short = ("az [m/s2]", "ax [m/s2]", "rms az [m/s2]", "rms ax [m/s2]", "pitch [deg]", *axles)
    caption = (
        "Limits of Table 5.3: 150 and 100 m/s2, 5 m/s2 rms, 15 deg, 225 kN. Contact of bumpers is allowed, of the belly"
        " not."
    )
    for system, title in (("passive", "Passive crossings (Table 5.4)"), ("mpc", "Controlled crossings")):
        rows = []
        for key in GRID:
            r, fine = (study[c] for c in (Case(*key, system), refined(Case(*key, system))))
            same = claims.verdict(study, key, system) is not None
            row = _key_cells(key) | dict(zip(short, (r[n] for n in WEIGHTS), strict=True))
            row |= {"outcome": r["outcome"], "at half the step": "the same" if same else fine["outcome"]}
            printed = {"Table 5.4": "passed" if published.passed(*key) else "failed"}
            rows.append(row | (printed if system == "passive" else {"largest actuator force [kN]": r["force"]}))
        yield Table.of(f"{system}-crossings", title, rows, caption)


@report.section("Peaks, pitch and spectra")
def _reductions(study: Results) -> Content:
    names = {"az": "az", "ax": "ax", "pitch": "pitch", "az_rms": "az rms", "ax_rms": "ax rms"}
    rows = []
    for key in GRID:
        controlled, base = (study[Case(*key, s)] for s in ("mpc", "passive"))
        row = _key_cells(key)
        for n, printed in names.items():
            row[f"{printed} [%]"] = round(reduction_percent(controlled[n], base[n]))
            row[f"{printed}, thesis [%]"] = published.number(*key, f"{printed} reduction [%]")
        rows.append(row)
    title = "Reduction by control, per cent of passive (Tables 5.6 to 5.8)"
    yield Table.of("reductions", title, rows, "Negative: control makes it worse.")
    yield from (_over_length(study, n, LABELS[n]) for n in ("az", "pitch"))


def _over_length(study: Results, metric: str, label: str) -> Figure:
    """A quantity over the length of the trench, a panel for each speed, with the cells that the thesis prints."""
    column = published.COLUMNS.get(metric, metric)
    panels = []
    for speed in SPEEDS:
        shown = []
        for system, name in _NAMES.items():
            shown.append(Series(name, LENGTHS, [study[Case(length, speed, system)][metric] for length in LENGTHS]))
            cells = [published.number(length, speed, f"{name} {column}") for length in LENGTHS]
            theirs = [math.nan if cell is None else cell for cell in cells]
            shown.append(Series(f"{name}, thesis", LENGTHS, theirs, mode="markers"))
        panels.append(Panel(f"{speed:g} km/h", "trench length [m]", label, shown))
    return Figure(
        f"{metric}-over-length",
        f"{label.partition(' [')[0].capitalize()} over the length of the trench",
        "Lines: this project; points: cells of Tables 5.4 and 5.6 to 5.9, as far as they are in print.",
        panels,
        columns=2,
    )


@report.section("Cost")
def _costs(study: Results) -> Content:
    scores, taken = claims.score(study), claims.improvements(study)
    scaled = {s: claims.normalized_costs(study, s) for s in SYSTEMS}
    rows = []
    for key in GRID:
        row = _key_cells(key)
        for s, name in _NAMES.items():
            row[name] = round(study[Case(*key, s)]["cost"])
            row[f"{name}, thesis"] = published.number(*key, f"{name} cost")
        row |= {f"{name}, normalized": round(scaled[s][key], 3) for s, name in _NAMES.items()}
        row["improvement [%]"] = round(taken[key], 1) if key in taken else None
        row["improvement, thesis [%]"] = published.number(*key, "improvement [%]")
        row["score"], row["score, thesis"] = round(scores[key], 1), published.number(*key, "score")
        rows.append(row)
    yield Table.of(
        "costs",
        "Cost, normalized cost, improvement and score (Tables 5.9 to 5.11)",
        rows,
        "Weights of Table 5.10. Normalized over all 72 runs; scores from 5, the lowest cost of the controlled runs, to"
        " 1, the highest.",
    )
    limit = normalized(cost(LIMITS), claims.costs(study))
    yield Map(
        "figure-5-40",
        "Normalized cost over length and speed (figures 5.40 and 5.41)",
        "On one scale; low is good. The red line, where there is one, is the cost of a crossing that just meets every"
        f" limit of Table 5.3 ({limit:.2f}), the plane of figure 5.41.",
        x_label="trench length [m]",
        y_label="speed [km/h]",
        value_label="normalized cost [-]",
        x=LENGTHS,
        y=SPEEDS,
        layers=[Layer(_NAMES[s], [[scaled[s][a, v] for a in LENGTHS] for v in SPEEDS]) for s in SYSTEMS],
        value_range=(0.0, max(1.0, limit)),
        reference=limit,
    )
    yield _over_length(study, "cost", "cost [-]")


@report.section("Time histories and spectra")
def _histories(study: Results) -> Content:
    for number, key in zip(("5-23", "5-26", "5-29", "5-32", "5-35", "5-38"), BOLD, strict=True):
        title = f"{_words(*key)} (figure {number.replace('-', '.')})"
        yield _history(title, f"figure-{number}", {s: study.signals(Case(*key, s)) for s in SYSTEMS})
    panels = []
    for axis, word in (("az", "Vertical"), ("ax", "Longitudinal")):
        spectra = {_NAMES[s]: study.signals(Case(*published.SPECTRUM, s))["spectra"][axis] for s in SYSTEMS}
        curves = [Series(n, *spectrum) for n, spectrum in spectra.items()]
        y_label = f"{axis} density [(m/s2)2/Hz]"
        panels.append(Panel(f"{word} acceleration", "frequency [Hz]", y_label, curves, x_scale="log", y_scale="log"))
    yield Figure(
        "figure-5-39",
        f"Power spectral density, {_words(*published.SPECTRUM)} (figure 5.39)",
        "Periodogram at 1 kHz, mean left in, averaged over twelfths of a decade.",
        panels,
        columns=2,
    )


@report.section("Steps")
def _refinement(study: Results) -> Content:
    changed = [(k, s) for s in SYSTEMS for k in GRID if claims.verdict(study, k, s) is None]
    where = ", ".join(f"{k[0]:g} m at {k[1]:g} km/h, {_NAMES[s]}" for k, s in changed)
    text = f"Halving the step changes {len(changed)} of {len(SYSTEMS) * len(GRID)} verdicts"
    yield f"{text}: {where}; these are open." if changed else f"{text}."
    rows = []
    for system, n in product(SYSTEMS, WEIGHTS):
        pairs = {k: [study[c][n] for c in (Case(*k, system), refined(Case(*k, system)))] for k in GRID}
        change = {k: 100 * abs(fine / coarse - 1) for k, (coarse, fine) in pairs.items()}
        worst = max(change, key=lambda k: change[k])
        rows.append(
            {
                "system": _NAMES[system],
                "quantity": LABELS[n],
                "median change [%]": float(np.median(list(change.values()))),
                "largest change [%]": change[worst],
                "where": _words(*worst),
                "as run": pairs[worst][0],
                "at half the step": pairs[worst][1],
            }
        )
    ms = 1e3 * float(STEP)
    title = f"Solver, exchange and recording step halved, from {ms:g} to {ms / 2:g} ms"
    yield Table.of("refinement", title, rows, "Over the 36 published crossings of each system.")


@report.section("Between the grid points")
def _between(study: Results) -> Content:
    names = ("az", "ax", "pitch", "hub_front", "hub_middle", "hub_rear")
    rows = [
        _key_cells((c.length, c.speed_kmh))
        | {LABELS[n]: study[c][n] for n in names}
        | {"cost [-]": study[c]["cost"], "outcome": study[c]["outcome"]}
        for c in published.between()
        if c in study
    ]
    if rows:
        yield "The same controller, nothing changed."
        yield Table.of("between", "Controlled crossings off the published grid", rows)


@report.section("Ablation")
def _without(study: Results) -> Content:
    changed = {words: some(controller) for controller, words in published.WITHOUT.items()}
    yield from _changed(
        study,
        """Each row leaves out or changes one part of the controller, for twelve crossings at 1, 3, 6 and 9 km/h. LQR
        and MPC without preview get the pitch reference of the crossing algorithm; LQR has no forced ranges.""",
        ("without", "one thing changed", "change"),
        {"as it is": some(), **changed},
    )


@report.section("Robustness to the vehicle")
def _vehicles(study: Results) -> Content:
    changed = {words: some(**changes) for words, changes in published.OTHER_VEHICLES.items()}
    yield from _changed(
        study,
        "The plant changes; the controller and its model of the vehicle do not.",
        ("vehicles", "another vehicle", "vehicle"),
        {"as the controller knows it": some(), **changed},
    )


def _changed(study: Results, text: str, named: tuple[str, str, str], lines: Mapping[str, list[Case]]) -> Content:
    """A line for each change, from the crossings under it; nothing where the study left them out."""
    if not all(c in study for cases in lines.values() for c in cases):
        return
    id_, what, column = named
    yield text
    rows = [{column: words} | _summary(study, cases) for words, cases in lines.items()]
    yield Table.of(id_, f"Controlled crossings of 1.2, 1.6 and 2.0 m, {what}", rows)


def _summary(study: Results, cases: Iterable[Case]) -> dict[str, Any]:
    rows = [study[c] for c in cases]
    bad = [f"{c.length:g}/{c.speed_kmh:g}" for c in cases if not study[c]["passed"]]
    return {
        "passed": sum(r["passed"] for r in rows),
        "of": len(rows),
        **{why: sum(why in r["failures"] for r in rows) for why in ("stuck", "belly contact")},
        "largest pitch [deg]": max(r["pitch"] for r in rows),
        "largest az [m/s2]": max(r["az"] for r in rows),
        "mean cost [-]": round(float(np.mean([r["cost"] for r in rows]))),
        "failed [m]/[km/h]": ", ".join(bad) or "–",
    }


@report.section("Linear compared with nonlinear vehicle")
def _linear(study: Results) -> Content:
    yield Figure(
        "figure-5-1",
        f"Linear and nonlinear passive vehicle, trench {linear.DEPTH:g} m deep at {linear.SPEED_KMH:g} km/h (figures"
        " 5.1 to 5.3)",
        "The same masses, springs, wheel positions and trench with sloped edges. The linear vehicle follows the road at"
        " a point below each wheel and keeps its speed; the nonlinear one has discs for wheels, which bridge the edges,"
        " and is slowed by them.",
        over_time(
            {n: study.signals(linear.Shallow(n)) for n in ("linear", "nonlinear")},
            [
                ("Body height (figure 5.1)", "body height [m]", "z", 1.0),
                ("Pitch, nose down (figure 5.2)", "pitch [deg]", "pitch", 1.0),
                ("Speed (figure 5.3)", "speed [km/h]", "speed", 1.0),
            ],
        ),
    )


@report.section("Limits of this comparison")
def _limits(_: Results) -> Content:
    yield f"""The thesis does not disclose its vehicle. The masses, geometry and tires are assumed, some of them with
    Table 5.4 in view; its multi-body model has suspension links and a tire model that a disc on solids does not
    replace. So peaks of impacts agree in order of magnitude at best.

    The vehicle is solved, exchanged and recorded every {1e3 * float(STEP):g} ms, and peaks are those of all these
    samples: where body and ground meet, the acceleration rises within a solver step and falls within a few
    milliseconds, so that samples 1 ms apart can miss its peak. RMS values are those of samples at 1 kHz.

    Readings of the thesis that matter: the forced ranges of Table 4.8 lift an axle only with their sign turned; the
    rate limit of Table 4.5 counts per control interval in the thesis's tool and never binds there, here it counts as
    N/s; limits on outputs (Table 4.6) are off; pitch keeps its weight of 100 in all cases, and the height of the body
    is weighed too. The effect of each is in the table of changes. Windows of the cases and the pitch reference (4 deg)
    are not in the thesis."""
