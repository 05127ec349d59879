"""Tables 2 and 3 and figures 3 to 7 of paper 004 as a report."""

from __future__ import annotations

import numpy as np

from cosim.experiments.preview_lq import EXPERIMENT
from cosim.experiments.preview_lq.claims import (
    CLAIMS,
    INPUT_NAMES,
    PARTS,
    WEIGHT_NAMES,
    eigenvalues,
    matched,
    relative,
    relative_index,
    short_preview,
    sprung_mass,
)
from cosim.experiments.preview_lq.design import DESIGNS
from cosim.experiments.preview_lq.published import (
    COARSE,
    CONTROLLED,
    PAPER_COLUMNS,
    PAPER_CORNERS,
    PRINTED,
    WEIGHT_SETS,
    corrected,
    over_preview,
    plateau,
)
from cosim.experiments.preview_lq.runs import (
    CAR,
    CONTROLLERS,
    DURATION,
    INPUTS,
    PLATEAU_MM,
    PREVIEW_TIME,
    SPEED_KMH,
    WEIGHTED_CONTROLLERS,
    Case,
    designed_weights,
)
from cosim.experiments.steps import HALVED, halved
from cosim.report import Figure, Panel, Parameter, Report, Section, Series, Table
from cosim.report.model import Color, Dash, Scalar
from cosim.study import FmuSet, Results, Row, make_lead, parameters, provenance, sections
from fmu_sources.models.corners import CORNERS

_SHORT = ("heave", "pitch", "roll", *(f"{q} {k}" for q in ("s", "t") for k in PAPER_CORNERS))
_LOOKS = {
    "passive": ("gray", "solid"),
    "active": ("orange", "dot"),
    "delay": ("blue", "dash"),
    "preview": ("green", "solid"),
}
_OVER_TIME = {  # curves of figure 3 -> metrics that are added
    "index J": ["J"],
    "vertical acceleration": ["body.az"],
    "suspension deflection": [f"suspension.{k}.deflection" for k in CORNERS],
    "tire deflection": [f"tire.{k}.deflection" for k in CORNERS],
}
_OVER_TIME_COLORS: dict[str, Color] = dict(zip(_OVER_TIME, ("orange", "purple", "sky", "green"), strict=True))


def report(study: Results, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    makers = (_poles, _table3, _figure3, _histories, _sampling, _refinement, _offset)
    lead, figure = make_lead(study, _main_result)
    about = Section(
        "Runs of the study",
        [
            f"A linear sedan crosses a hole and a bump at {SPEED_KMH:g} km/h, passive and under the optimal LQ"
            " controller with three information patterns: none of the road, the rear wheels' road from"
            " the front wheels, and preview ahead. Car, road and controller are native FMUs exchanging"
            " every millisecond. Tables and figures of"
            " Marzbanrad, Hojjat, Zohoor and Nikravesh stand beside what these runs give."
        ],
    )
    return Report(
        experiment=EXPERIMENT.name,
        title="Optimal preview control of a car with seven degrees of freedom",
        lead=lead,
        figure=figure,
        claims=CLAIMS.judge(study),
        sections=[about, *sections(study, makers)],
        parameters=_parameters(fmus),
        provenance=provenance(EXPERIMENT, fmus),
    )


def _main_result(study: Results) -> tuple[str, Figure]:
    """The index by what the controller knows of the road."""
    shares = {(i, w, c): relative_index(study, i, w, c) for i, w in PARTS for c in CONTROLLED}
    preview, delay, active = (
        " and ".join(f"{shares['both', w, c]:.1f} %" for w in WEIGHT_SETS) for c in ("preview", "delay", "active")
    )
    lead = (
        f"With {PREVIEW_TIME:g} s of preview, the quadratic indices of {' and '.join(WEIGHT_NAMES.values())} are"
        f" {preview} of the passive car's with input on both sides, compared with {delay} if the controller only"
        f" knows the road of the rear wheels from the front wheels, and {active} without any information on the road."
    )
    bars = [
        Series(
            c,
            range(len(PARTS)),
            [shares[i, w, c] for i, w in PARTS],
            color=_LOOKS[c][0],  # type: ignore[arg-type]
            dash=_LOOKS[c][1],  # type: ignore[arg-type]
            mode="bar",
        )
        for c in CONTROLLED
    ]
    names = [f"{WEIGHT_NAMES[w]}, {INPUT_NAMES[i]}" for i, w in PARTS]
    panel = Panel("", "index, input [?]", "J, per cent of passive [%]", bars, x_names=names)
    caption = (
        "active: no information on the road; delay: the road of the rear wheels from the front wheels; preview: the"
        f" road {PREVIEW_TIME:g} s ahead. The passive car is at 100 %."
    )
    return lead, Figure("main-result", "Index J by what the controller knows of the road", caption, [panel])


def _poles(study: Results) -> Section:
    """Closed-loop poles."""
    rows: list[list[Scalar]] = []
    for design in DESIGNS:
        computed = eigenvalues(study, design)
        if design.startswith("comfort"):
            rows += [
                [_design(design), _complex(p), _complex(o), round(100 * distance, 2)]
                for p, o, distance in matched(computed)
            ]
        else:
            rows += [[_design(design), None, _complex(o), None] for o in computed]
    table = Table(
        "table-2",
        "Closed-loop eigenvalues, upper half plane (table 2 of the paper)",
        ["design", "printed [1/s]", "computed [1/s]", "distance [%]"],
        rows,
    )
    return Section(
        "Closed-loop poles",
        [
            "Poles of the continuous design from the equations and the numbers of the car FMU, with"
            f" {sprung_mass(study)}."
        ],
        [],
        [table],
    )


def _design(name: str) -> str:
    weights, _, rest = name.partition(", ")
    return WEIGHT_NAMES[weights] + f", {rest} of N" * bool(rest)


def _complex(value: complex) -> str:
    return f"{value.real:.2f} + {value.imag:.2f}i"


def _table3(study: Results) -> Section:
    """Mean squares and index."""
    tables = []
    for (input_, weights), part in PARTS.items():
        rows: list[list[Scalar]] = []
        for c in CONTROLLERS:
            computed = relative(study, input_, weights, c)
            rows.append([c, "computed", *(None if v is None else round(v, 1) for v in computed)])
            if weights == "comfort" and c != "passive":
                rows.append([c, "printed", *PRINTED[input_, c]])
                rows.append([c, "corrected", *corrected(input_, c)])
        tables.append(
            Table(
                f"table-3{part}",
                f"{INPUT_NAMES[input_].capitalize()}, {WEIGHT_NAMES[weights]}, per cent of passive (table 3{part} of"
                " the paper)",
                ["system", "row", *(f"{n} [%]" for n in _SHORT), "J [%]"],
                rows,
            )
        )
    return Section(
        "Mean squares and index",
        [
            (
                f"Means over {DURATION:g} s; preview {PREVIEW_TIME:g} s. The size of hole and bump cancels. Columns in"
                " the paper's order: left front, left rear, right front, right rear."
            ),
            (
                "Misprints of the table: in a) the active system's s4 (s rr) is 137.0, not 1370; in c) t3 and t4 (t fr,"
                " t rr) are ten times too small; roll with both sides equal is 0/0, printed as 100."
            ),
            (
                "Where the computed and the printed components differ by more than a few per cent, the printed design"
                " differs too: its two low pole pairs are off (see the poles)."
            ),
        ],
        [],
        tables,
    )


def _figure3(study: Results) -> Section:
    """Preview time."""
    panels = []
    for input_ in INPUTS:
        for weights in WEIGHT_SETS:
            cut, held = (over_preview(input_, weights, hold_tail=h) for h in (False, True))
            curves = [
                _over_none(study, text, cut, names, _OVER_TIME_COLORS[text]) for text, names in _OVER_TIME.items()
            ]
            curves.append(
                _over_none(study, "index J, last height held", held, ["J"], _OVER_TIME_COLORS["index J"], "dash")
            )
            if weights == "comfort":  # the set of weights that table 3 has
                curves += _printed_over_none(input_)
            panels.append(
                Panel(
                    f"{WEIGHT_NAMES[weights]}, {INPUT_NAMES[input_]}",
                    "preview time [s]",
                    "relative to no preview [-]",
                    curves,
                )
            )
    return Section(
        "Preview time",
        [
            "Mean squares over preview time, relative to no preview with the delay between the axles known.",
            (
                f"The first 10 to 20 ms make the index worse, by up to {100 * (max(short_preview(study)) - 1):.0f} %,"
                " before longer previews make it better. The controller with a finite horizon takes the road beyond it"
                " to be at height 0. Seen from the middle of a bump, a horizon of 10 ms says that the"
                " road is about to fall to 0 within 10 ms, and the front actuators prepare for an edge"
                " that is not there; the longer the"
                " horizon, the farther off and the less urgent the supposed edge. Without any preview the front road"
                " does not enter the controller at all, so it makes no false assumption. The dashed curve of the index"
                " shows it: if the road is taken to continue at its last height instead (hold_tail),"
                " every preview is better than none."
            ),
        ],
        [
            Figure(
                "figure-3",
                "Effect of preview time (figure 3 of the paper)",
                "Suspension and tire: sums over the four wheels. Points: from the cells of table 3, preview over"
                " delay.",
                panels,
                columns=2,
            )
        ],
    )


def _over_none(
    study: Results, text: str, curve: dict[float, Case], names: list[str], color: Color, dash: Dash = "solid"
) -> Series:
    sums = [sum(study[c][n] for n in names) for c in curve.values()]
    return Series(text, list(curve), [s / sums[0] for s in sums], color=color, dash=dash)


def _printed_over_none(input_: str) -> list[Series]:
    """Ratio of preview to delay in table 3, for curves that are no sums.

    The table gives the parts of sums as per cent of the passive car's values, so they cannot be added.
    """
    with_preview, without = (
        dict(zip((*PAPER_COLUMNS, "J"), corrected(input_, c), strict=True)) for c in ("preview", "delay")
    )
    points = []
    for text, (name, *others) in _OVER_TIME.items():
        above, below = with_preview[name], without[name]
        if not others and above is not None and below is not None:
            points.append(
                Series(
                    f"{text}, table 3", [PREVIEW_TIME], [above / below], color=_OVER_TIME_COLORS[text], mode="markers"
                )
            )
    return points


def _histories(study: Results) -> Section:
    """Time histories."""
    figures = []
    for number, weights in (("4", "comfort"), ("5", "road-holding")):
        runs = {c: study.signals(Case("left", weights, c)) for c in CONTROLLERS}
        panels = []
        for k in ("fl", "rl"):
            road = _curve("road", runs["passive"], f"road.road.{k}.height", 1e3, "black", "dot")
            wheels = [_curve(c, r, f"car.wheel.{k}.z", 1e3, *_LOOKS[c]) for c, r in runs.items()]
            panels.append(Panel(f"wheel {k}", "time [s]", "height [mm]", [road, *wheels]))
        figures.append(
            Figure(
                f"figure-{number}",
                f"Wheel tracking, left side, {WEIGHT_NAMES[weights]} (figure {number} of the paper)",
                "Wheel height over the road under it.",
                panels,
                columns=1,
            )
        )
    for number, input_ in (("6", "both"), ("7", "left")):
        panels = []
        for weights in WEIGHT_SETS:
            runs = {c: study.signals(Case(input_, weights, c)) for c in CONTROLLED}
            for k in ("fl", "rl") if input_ == "both" else CORNERS:
                forces = [_curve(c, r, f"controller.force.{k}", 1e-3, *_LOOKS[c]) for c, r in runs.items()]
                panels.append(Panel(f"{WEIGHT_NAMES[weights]}, {k}", "time [s]", "force [kN]", forces))
        figures.append(
            Figure(
                f"figure-{number}",
                f"Control forces, {INPUT_NAMES[input_]} (figure {number} of the paper)",
                "Hole and bump 50 mm.",
                panels,
                columns=2,
            )
        )
    return Section("Time histories", [], figures)


def _curve(
    name: str, signals: Row, variable: str, factor: float, color: str | None = None, dash: str | None = None
) -> Series:
    return Series(name, signals["time"], factor * np.array(signals[variable]), color=color, dash=dash)  # type: ignore[arg-type]


def _sampling(study: Results) -> Section:
    """Sample time."""
    coarse, fine, passive = (
        study[c]["J"] for c in (COARSE, *(Case("both", "comfort", c) for c in ("preview", "passive")))
    )
    table = Table(
        "sampling",
        "Ride comfort with preview, both sides",
        ["sample time [ms]", "J [% of passive]", "compared with 1 ms [%]"],
        [
            [1, round(100 * fine / passive, 2), 0.0],
            [5, round(100 * coarse / passive, 2), round(100 * (coarse / fine - 1), 2)],
        ],
    )
    return Section(
        "Sample time",
        [
            "The controller of PreviewLqComfort5ms is designed for its sample time (exact sampled gains and costs),"
            " not the 1 ms controller run slowly."
        ],
        [],
        [table],
    )


def _refinement(study: Results) -> Section:
    """Steps."""
    cases = [Case("both", "comfort", c) for c in CONTROLLERS]
    base = [study[c]["J"] for c in cases]
    rows: list[list[Scalar]] = [["as in the runs", *base, 0.0]]
    for what in HALVED:
        finer = [study[halved(c)[what]]["J"] for c in cases]
        rows.append([f"{what} halved", *finer, 100 * max(abs(f / b - 1) for f, b in zip(finer, base, strict=True))])
    table = Table(
        "refinement",
        "Index of ride comfort, both sides, with finer steps",
        ["steps", *(f"J, {c} [-]" for c in CONTROLLERS), "largest change [%]"],
        rows,
        "Solver step and communication step of the car; controller and road keep their sample time of 1 ms.",
    )
    return Section("Steps", ["Whether the results depend on the steps."], [], [table])


def _offset(study: Results) -> Section:
    """A road that does not return to zero."""
    cut, held = (study.signals(plateau(hold_tail=h)) for h in (False, True))
    curves = {"height 0 beyond the horizon": cut, "last height held": held}
    panels = [
        Panel(title, "time [s]", label, [_curve(n, r, variable, factor) for n, r in curves.items()])
        for title, label, variable, factor in (
            ("force, front left", "force [kN]", "controller.force.fl", 1e-3),
            ("body height", "height [mm]", "car.body.z", 1e3),
        )
    ]
    figure = Figure(
        "offset",
        f"Driving onto a plateau of {PLATEAU_MM:g} mm",
        "Without hold_tail the controller takes the road to return to height 0 beyond its horizon and keeps"
        " drawing the body down.",
        panels,
        columns=2,
    )
    lasting = [float(np.abs(r["controller.force.fl"][-100:]).mean()) for r in (cut, held)]
    return Section(
        "A road that does not return to zero",
        [
            "A preview that is truncated at a horizon assumes height 0 beyond it. A constant offset or a slow drift of"
            f" the road then requests forces without end: {lasting[0]:.0f} N at the front left wheel 2.5 s after a step"
            f" of {PLATEAU_MM:g} mm. With hold_tail the road is taken to continue at its last height, and the force"
            f" dies out ({lasting[1]:.1g} N)."
        ],
        [figure],
    )


def _parameters(fmus: FmuSet) -> list[Parameter]:
    """Of the car, and of the controllers' weights, as the FMUs have them."""
    rows = parameters(fmus.path(CAR))
    for weights in WEIGHT_SETS:
        w = designed_weights(fmus.path(WEIGHTED_CONTROLLERS[weights][0]))
        for name, value, unit in (
            ("heave", w.acceleration.heave, "s4/m2"),
            ("pitch", w.acceleration.pitch, "s4/rad2"),
            ("roll", w.acceleration.roll, "s4/rad2"),
            ("suspension, front", w.suspension.front, "1/m2"),
            ("suspension, rear", w.suspension.rear, "1/m2"),
            ("tire, front", w.tire.front, "1/m2"),
            ("tire, rear", w.tire.rear, "1/m2"),
            ("force", w.force.front, "1/N2"),
        ):
            rows.append(Parameter(f"weight, {WEIGHT_NAMES[weights]}: {name}", value, unit, w.source))
    return rows
