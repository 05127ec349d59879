"""Claims, tables and figures of paper 004 as a report."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cosim.experiments import preview_lq_study as ps
from cosim.experiments.cases import FmuSet
from cosim.experiments.preview_lq import DURATION, INPUTS, PREVIEW_TIME, SPEED_KMH, SYSTEMS, WEIGHTS
from cosim.experiments.preview_lq_study import PAPER_COLUMNS, PRINTED, PRINTED_EIGENVALUES, WEIGHT_SETS, Study
from cosim.experiments.provenance import provenance
from cosim.report import Band, Claims, Figure, Panel, Parameter, Report, Result, Section, Series, Table, write_report
from cosim.report.model import Scalar
from fmu_sources.controllers.preview_lq import CORNERS
from fmu_sources.controllers.preview_lq_weights import load_weights
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car

_SHORT = ("heave", "pitch", "roll", *(f"{q} {k}" for q in ("s", "t") for k in ps.PAPER_CORNERS))
CONTROLLED = tuple(s for s in SYSTEMS if s != "passive")
_INPUT = {"both": "both sides", "left": "left side"}
_WEIGHTS = {"comfort": "ride comfort", "road-holding": "road holding"}
_PARTS = {
    ("both", "comfort"): "a",
    ("both", "road-holding"): "b",
    ("left", "comfort"): "c",
    ("left", "road-holding"): "d",
}
_LOOKS = {
    "passive": ("grey", "solid"),
    "active": ("orange", "dot"),
    "delay": ("blue", "dash"),
    "preview": ("green", "solid"),
}
J_TOLERANCE, COMPONENT_TOLERANCE = 0.05, 0.10  # relative
MOST = 0.8  # of a benefit
CLEAR = 0.1  # by which one of two forces is larger
NOTICEABLE = 0.02  # by which an index is worse
FITTED = "the sprung mass: 1460 kg, from which the printed poles follow, not the 1400 kg of Table 1"
POLE_TOLERANCE = 0.02  # relative
LOW_PAIRS = (-5.31 + 6.14j, -4.00 + 5.07j)  # printed; the design as printed does not give them


def write(study: Study, fmus: FmuSet, directory: Path) -> Path:
    """Write report.html, summary.json and CSV files; returns the path of the page."""
    return write_report(report(study, fmus), directory)


def report(study: Study, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    return Report(
        experiment="preview-lq",
        title="Optimal preview control of a seven-degree car",
        lead=(
            f"A linear sedan crosses a hole and a bump at {SPEED_KMH:g} km/h, passive and under the optimal LQ law with three "
            "information patterns: none of the road, the rear wheels' road from the front wheels, and preview ahead. Car, road and "
            "controller are native FMUs exchanging every millisecond. Tables and figures of Marzbanrad, Hojjat, Zohoor and "
            "Nikravesh stand beside what these runs give."
        ),
        claims=claims(study),
        results=[
            Result(
                f"J with preview, {_WEIGHTS[w]}, {_INPUT[i]}",
                round(ps.relative_index(study, i, w, "preview"), 1),
                "% of passive",
            )
            for i in INPUTS
            for w in WEIGHT_SETS
        ],
        sections=[
            _poles(study),
            _table3(study),
            _figure3(study),
            _histories(study),
            _sampling(study),
            _refinement(study),
            _offset(study),
        ],
        parameters=_parameters(),
        provenance=provenance(fmus, fmus.paths(FMUS)),
    )


FMUS = (
    "RideCarSedan",
    "RoadHoleBump",
    "SpeedProfile",
    "PreviewLqComfort",
    "PreviewLqRoadHolding",
    "PreviewLqComfort5ms",
)


# ---------------------------------------------------------------------- claims


def claims(study: Study) -> Claims:
    """Every published number that is in print, and what the text says of preview."""
    result = Claims()
    claim = result.judge

    pairs = ps.matched_eigenvalues(study.eigenvalues["comfort"], PRINTED_EIGENVALUES)
    exact = [e for p, _, e in pairs if p not in LOW_PAIRS]
    low = [e for p, _, e in pairs if p in LOW_PAIRS]
    poles = (
        f"within {100 * POLE_TOLERANCE:g} %: poles are computed, so equal data give equal poles up to rounding in print"
    )
    claim(
        "poles",
        "Closed-loop poles of the ride-comfort design",
        "five pairs of Table 2",
        f"within {100 * max(exact):.1f} %",
        max(exact) <= POLE_TOLERANCE,
        "the vehicle or the weights differ",
        "Table 2",
        criterion=poles,
        fitted=FITTED,
    )
    claim(
        "poles-low",
        "The two remaining low pairs of the ride-comfort design",
        "-5.31+6.14i, -4.00+5.07i",
        ", ".join(f"{o.real:.2f}+{o.imag:.2f}i" for p, o, _ in pairs if p in LOW_PAIRS),
        max(low) <= POLE_TOLERANCE,
        f"{100 * min(low):.0f} to {100 * max(low):.0f} % away: with one entry of the cross weight N left out "
        f"({' and '.join(ps.MISSING_ENTRY)}) all seven printed pairs come out within {_missing(study):.1f} %; the index as printed "
        "gives ours",
        "Table 2",
        criterion=poles,
        fitted=FITTED,
    )
    for input_, system in PRINTED:
        ours, printed = ps.relative(study, input_, "comfort", system), ps.corrected(input_, system)
        j, published = ps.relative_index(study, input_, "comfort", system), PRINTED[input_, system][-1]
        claim(
            f"index-{input_}-{system}",
            f"The {system} system lowers the index of ride comfort, {_INPUT[input_]}",
            f"{published:g} % of passive",
            f"{j:.1f} %",
            j < 100,
            "the printed design has other low poles",
            f"Table 3{_PARTS[input_, 'comfort']}",
            j,
            "%",
            band=Band.around(published, J_TOLERANCE, "computed from printed data, so half of the usual 10 %"),
            criterion="below the passive car's",
            fitted=FITTED,
        )
        off = {
            c: o / p - 1
            for c, o, p in zip((*PAPER_COLUMNS, "J"), ours, printed, strict=True)
            if o is not None and p is not None
        }
        worst = max(off, key=lambda c: abs(off[c]))
        near = sum(abs(v) <= COMPONENT_TOLERANCE for v in off.values())
        sides = [
            (o - 100) * (p - 100) > 0
            for o, p in zip(ours, printed, strict=True)
            if o is not None and p is not None and abs(p - 100) > 100 * COMPONENT_TOLERANCE
        ]
        claim(
            f"parts-{input_}-{system}",
            f"The {system} system raises and lowers the components as printed, ride comfort, {_INPUT[input_]}",
            f"{len(off) - 1} mean squares and J (misprints corrected)",
            f"{near} of {len(off)} within {100 * COMPONENT_TOLERANCE:g} %; largest deviation {100 * off[worst]:+.0f} % ({worst})",
            all(sides),
            "the printed design lacks one entry of the cross weight N, which moves its low poles and what depends on them",
            f"Table 3{_PARTS[input_, 'comfort']}",
            100 * abs(off[worst]),
            "%",
            band=Band(0.0, 100 * COMPONENT_TOLERANCE, "every printed figure within 10 %"),
            criterion=f"all on the printed side of passive, where print is more than {100 * COMPONENT_TOLERANCE:g} % from it",
            fitted=FITTED,
        )
    for (input_, weights), part in _PARTS.items():
        row = [ps.relative_index(study, input_, weights, s) for s in CONTROLLED]
        claim(
            f"order-{part}",
            f"Each kind of information lowers the index, {_WEIGHTS[weights]}, {_INPUT[input_]}",
            "active > delay > preview",
            " > ".join(f"{x:.1f}" for x in row),
            row[0] > row[1] > row[2],
            "the order differs",
            f"Table 3{part}",
            criterion="in this order; nothing is random here",
        )
    for weights, time in (("comfort", 0.10), ("road-holding", 0.04)):
        shares = [_share(study, i, weights, time) for i in INPUTS]
        claim(
            f"preview-time-{weights}",
            f"A preview of {time:g} s brings most of the benefit, {_WEIGHTS[weights]}",
            f"about {time:g} s",
            f"{100 * min(shares):.0f} % of the benefit of 0.2 s",
            min(shares) >= MOST,
            f"less than {100 * MOST:g} % of the benefit of 0.2 s",
            "Figure 3",
            criterion=f"most: at least {100 * MOST:g} % of what 0.2 s brings, for both inputs",
        )
    ratio = min(study.forces["left", w, "preview"][0] / study.forces["left", w, "preview"][1] for w in WEIGHT_SETS)
    claim(
        "one-side-force",
        "With input on one side the actuators of the other side work less",
        "less force",
        f"left over right front force {ratio:.1f} or more",
        ratio >= 1 + CLEAR,
        "the other side works as hard",
        "Figure 7",
        criterion=f"rms force on the driven side at least {100 * CLEAR:g} % larger, with both sets of weights",
    )
    rates = [_rate(study, i, w) for i in INPUTS for w in WEIGHT_SETS]
    claim(
        "rear-rate",
        "The forces at the rear change faster than at the front",
        "higher rate at the rear, all cases",
        f"rear over front {min(rates):.2f} to {max(rates):.2f}",
        min(rates) > 1,
        "with preview ahead the front forces rise as fast as the rear ones in at least one of the four cases",
        "Figures 6, 7",
        criterion="rms rate of the force, rear over front, above 1 in all four cases",
    )
    short, held = _short_preview(study), _short_preview(study, held=True)
    result.check(
        "short-preview",
        "A preview of 10 to 20 ms is worse than none, and it is the horizon that does it",
        "the index rises; not if the road is taken to continue at its last height",
        f"index up by {100 * (min(short.values()) - 1):.0f} to {100 * (max(short.values()) - 1):.0f} % at its worst; with the "
        f"last height held {100 * (max(held.values()) - 1):+.0f} % at most",
        min(short.values()) > 1 + NOTICEABLE and max(held.values()) < 1,
        "a short preview lowers the index, or holding the last height does not change that",
        "Figure 3",
        criterion=f"in all four cases more than {100 * NOTICEABLE:g} % above no preview at 10 or 20 ms, and below it with hold_tail",
    )
    return result


def _short_preview(study: Study, *, held: bool = False) -> dict[tuple[str, str], float]:
    """Largest index with 10 to 20 ms of preview over that with none, by case."""
    curves = study.held if held else study.preview
    return {
        key: max(r["index"] for r in rows if 0.005 < r["preview_time"] < 0.025) / rows[0]["index"]
        for key, rows in curves.items()
    }


def _share(study: Study, input_: str, weights: str, time: float) -> float:
    curve = {r["preview_time"]: r["index"] for r in study.preview[input_, weights]}
    return (curve[0.0] - curve[time]) / (curve[0.0] - curve[0.2])


def _rate(study: Study, input_: str, weights: str) -> float:
    recording = study.histories[input_, weights, "preview"]
    front, rear = (np.sqrt(np.mean(np.diff(recording[f"controller.force.{k}"]) ** 2)) for k in ("fl", "rl"))
    return float(rear / front)


# ---------------------------------------------------------------------- tables and figures


def _missing(study: Study) -> float:
    """Largest distance [%] of the printed poles from those of the design with the missing entry."""
    pairs = ps.matched_eigenvalues(study.eigenvalues["comfort, one entry missing"], PRINTED_EIGENVALUES)
    return 100 * max(e for _, _, e in pairs)


def _poles(study: Study) -> Section:
    rows = []
    for weights, eigenvalues in study.eigenvalues.items():
        pairs = (
            ps.matched_eigenvalues(eigenvalues, PRINTED_EIGENVALUES)
            if weights.startswith("comfort")
            else [(None, complex(e), None) for e in eigenvalues]
        )
        for printed, ours, distance in pairs:
            rows.append([
                _WEIGHTS.get(weights, f"ride {weights} of N"), f"{printed.real:.2f} + {printed.imag:.2f}i" if printed is not None else None,
                f"{ours.real:.2f} + {ours.imag:.2f}i", None if distance is None else round(100 * distance, 2),
            ])  # fmt: skip
    table = Table(
        "table-2",
        "Table 2: closed-loop eigenvalues, upper half plane",
        ["design", "printed [1/s]", "ours [1/s]", "distance [%]"],
        rows,
    )
    return Section(
        "Closed-loop poles",
        [
            "Poles of the continuous design from the equations of the car FMU, with the sprung mass of 1460 kg that the printed poles "
            "follow from (Table 1 prints 1400 kg)."
        ],
        [],
        [table],
    )


def _table3(study: Study) -> Section:
    tables = []
    for (input_, weights), part in _PARTS.items():
        rows = []
        for system in SYSTEMS:
            rows.append(
                [
                    system,
                    "ours",
                    *(None if v is None else round(v, 1) for v in ps.relative(study, input_, weights, system)),
                ]
            )
            if weights == "comfort" and system != "passive":
                rows.append([system, "printed", *PRINTED[input_, system]])
                rows.append([system, "corrected", *ps.corrected(input_, system)])
        tables.append(
            Table(
                f"table-3{part}",
                f"Table 3{part}: {_INPUT[input_]}, {_WEIGHTS[weights]}, per cent of passive",
                ["system", "row", *(f"{n} [%]" for n in _SHORT), "J [%]"],
                rows,
            )
        )
    return Section(
        "Mean squares and index",
        [
            f"Means over {DURATION:g} s; preview {PREVIEW_TIME:g} s. The size of hole and bump cancels. Columns in the paper's order: left "
            "front, left rear, right front, right rear.",
            "Misprints of the table: in a) the active system's s4 is 137.0, not 1370; in c) t3 and t4 are ten times too small; roll with "
            "both sides equal is 0/0, printed as 100.",
            "Where ours and the printed components differ by more than a few per cent, the printed design differs too: its two low pole "
            "pairs are off (see the poles).",
        ],
        [],
        tables,
    )


def _figure3(study: Study) -> Section:
    panels = []
    for (input_, weights), rows in study.preview.items():
        names = {
            "index": "index J",
            "heave": "vertical acceleration",
            "suspension": "suspension deflection",
            "tire": "tyre deflection",
        }
        curves = [
            Series(text, [r["preview_time"] for r in rows], [r[key] / rows[0][key] for r in rows])
            for key, text in names.items()
        ]
        held = study.held[input_, weights]
        curves.append(
            Series(
                "index J, last height held", [r["preview_time"] for r in held],
                [r["index"] / held[0]["index"] for r in held], dash="dash",
            )
        )  # fmt: skip
        panels.append(
            Panel(f"{_WEIGHTS[weights]}, {_INPUT[input_]}", "preview time [s]", "relative to no preview [-]", curves)
        )
    return Section(
        "Preview time",
        [
            "Mean squares over preview time, relative to no preview with the delay between the axles known.",
            f"The first 10 to 20 ms make the index worse, by up to {100 * (max(_short_preview(study).values()) - 1):.0f} %, before longer "
            "previews make it better. The law with a finite horizon takes the road beyond it to be at height 0. Seen from the middle of a "
            "bump, a horizon of 10 ms says that the road is about to fall to 0 within 10 ms, and the front actuators prepare for an edge "
            "that is not there; the longer the horizon, the farther off and the less urgent the supposed edge. Without any preview the front "
            "road does not enter the law at all, so nothing false is believed. The dashed curve shows it: if the road is taken to "
            "continue at its last height instead (hold_tail), every preview is better than none.",
        ],
        [
            Figure(
                "figure-3",
                "Effect of preview time (figure 3 of the paper)",
                "Suspension and tyre: sums over the four wheels.",
                panels,
                columns=2,
            )
        ],
    )


def _histories(study: Study) -> Section:
    figures = []
    for number, weights in (("4", "comfort"), ("5", "road-holding")):
        panels = []
        for k in ("fl", "rl"):
            some = study.histories["left", weights, "passive"]
            curves = [Series("road", some.time, 1e3 * some[f"road.road.{k}.height"], color="black", dash="dot")]
            curves += [_series(s, study.histories["left", weights, s], f"car.wheel.{k}.z", 1e3) for s in SYSTEMS]
            panels.append(Panel(f"wheel {k}", "time [s]", "height [mm]", curves))
        figures.append(
            Figure(
                f"figure-{number}",
                f"Wheel tracking, left side, {_WEIGHTS[weights]} (figure {number} of the paper)",
                "Wheel height over the road under it.",
                panels,
                columns=1,
            )
        )
    for number, input_ in (("6", "both"), ("7", "left")):
        panels = []
        for weights in WEIGHT_SETS:
            for k in ("fl", "rl") if input_ == "both" else CORNERS:
                curves = [
                    _series(s, study.histories[input_, weights, s], f"controller.force.{k}", 1e-3) for s in CONTROLLED
                ]
                panels.append(Panel(f"{_WEIGHTS[weights]}, {k}", "time [s]", "force [kN]", curves))
        figures.append(
            Figure(
                f"figure-{number}",
                f"Control forces, {_INPUT[input_]} (figure {number} of the paper)",
                "Hole and bump 50 mm.",
                panels,
                columns=2,
            )
        )
    return Section("Time histories", [], figures)


def _series(name: str, recording, variable: str, scale: float) -> Series:  # type: ignore[no-untyped-def]
    color, dash = _LOOKS[name]
    return Series(name, recording.time, scale * recording[variable], color=color, dash=dash)  # type: ignore[arg-type]


def _sampling(study: Study) -> Section:
    fine = study.index["both", "comfort", "preview"]
    passive = study.index["both", "comfort", "passive"]
    table = Table(
        "sampling",
        "Ride comfort with preview, both sides",
        ["sample time [ms]", "J [% of passive]", "against 1 ms [%]"],
        [
            [1, round(100 * fine / passive, 2), 0.0],
            [5, round(100 * study.coarse / passive, 2), round(100 * (study.coarse / fine - 1), 2)],
        ],
    )
    return Section(
        "Sample time",
        [
            "The law of PreviewLqComfort5ms is designed for its sample time (exact sampled gains and costs), not the 1 ms law run slowly."
        ],
        [],
        [table],
    )


def _refinement(study: Study) -> Section:
    base = {s: study.index["both", "comfort", s] for s in SYSTEMS}
    rows: list[list[Scalar]] = [["as in the runs", *(base[s] for s in SYSTEMS), 0.0]]
    for what, finer in study.refined.items():
        change = max(abs(finer[s] / base[s] - 1) for s in SYSTEMS)
        rows.append([f"{what} halved", *(finer[s] for s in SYSTEMS), 100 * change])
    table = Table(
        "refinement", "Index of ride comfort, both sides, with finer steps",
        ["steps", *(f"J, {s} [-]" for s in SYSTEMS), "largest change [%]"], rows,
        "Solver step and exchange step of the car; controller and road keep their sample time of 1 ms.",
    )  # fmt: skip
    return Section("Steps", ["Whether the results depend on how time is cut."], [], [table])


def _offset(study: Study) -> Section:
    curves = []
    for hold, name in ((False, "height 0 beyond the horizon"), (True, "last height held")):
        r = study.offset[hold]
        curves.append((name, r))
    figure = Figure(
        "offset",
        "Driving onto a plateau of 50 mm",
        "Without hold_tail the law takes the road to return to height 0 beyond its horizon, for ever, and keeps pulling the body down.",
        [
            Panel(
                "force, front left",
                "time [s]",
                "force [kN]",
                [Series(n, r.time, 1e-3 * r["controller.force.fl"]) for n, r in curves],
            ),
            Panel(
                "body height", "time [s]", "height [mm]", [Series(n, r.time, 1e3 * r["car.body.z"]) for n, r in curves]
            ),
        ],
        columns=2,
    )
    lasting = {h: float(np.abs(r["controller.force.fl"][-100:]).mean()) for h, r in study.offset.items()}
    return Section(
        "A road that does not return to zero",
        [
            "Preview that is cut off at a horizon assumes height 0 behind it. A constant offset or a slow drift of the road then asks for "
            f"forces without end: {lasting[False]:.0f} N at the front left wheel 2.5 s after a step of 50 mm. With hold_tail the road is taken "
            f"to go on at its last height, and the force dies out ({lasting[True]:.1g} N)."
        ],
        [figure],
    )


def _parameters() -> list[Parameter]:
    car = ride_car(load_ride_car("sedan"), name="RideCarSedan")
    rows = [
        Parameter(e.name, e.start, e.variable.unit or "-", e.variable.source or "build option")
        for e in car.elements("parameter")
    ]
    for weights in WEIGHT_SETS:
        w = load_weights(WEIGHTS[weights])
        for name, value, unit in (
            ("heave", w.acceleration.heave, "s4/m2"), ("pitch", w.acceleration.pitch, "s4/rad2"), ("roll", w.acceleration.roll, "s4/rad2"),
            ("suspension, front", w.suspension.front, "1/m2"), ("suspension, rear", w.suspension.rear, "1/m2"),
            ("tyre, front", w.tire.front, "1/m2"), ("tyre, rear", w.tire.rear, "1/m2"), ("force", w.force.front, "1/N2"),
        ):  # fmt: skip
            rows.append(Parameter(f"weight, {_WEIGHTS[weights]}: {name}", value, unit, w.source))
    return rows
