"""Tables 2 and 3 and figures 3 to 7 of paper 004 as a report."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from cosim.experiments.preview_lq import EXPERIMENT, claims, published
from cosim.experiments.preview_lq.claims import INPUT_NAMES, PARTS
from cosim.experiments.preview_lq.design import DESIGNS
from cosim.experiments.preview_lq.published import CONTROLLED, PAPER_COLUMNS, WEIGHT_NAMES, WEIGHT_SETS, corrected
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
from cosim.experiments.steps import with_finer_steps
from cosim.report import Figure, Panel, Parameter, Series, Table, bars, curve, over_time
from cosim.report.model import Color, Look
from cosim.study import Content, FmuSet, Results, StudyReport, parameters
from fmu_sources.models.corners import CORNERS

_SHORT = ("heave", "pitch", "roll", *(f"{q} {k}" for q in ("s", "t") for k in published.PAPER_CORNERS), "J")
_OVER_TIME = {  # curves of figure 3 -> metrics that are added
    "index J": ["J"],
    "vertical acceleration": ["body.az"],
    "suspension deflection": [f"suspension.{k}.deflection" for k in CORNERS],
    "tire deflection": [f"tire.{k}.deflection" for k in CORNERS],
}
_OVER_TIME_COLORS: dict[str, Color] = dict(zip(_OVER_TIME, ("orange", "purple", "sky", "green"), strict=True))
_LOOKS: dict[str, Look] = {
    "road": ("black", "dot"),
    "passive": ("gray", "solid"),
    "active": ("orange", "dot"),
    "delay": ("blue", "dash"),
    "preview": ("green", "solid"),
    **{name: (color, "solid") for name, color in _OVER_TIME_COLORS.items()},
    **{f"{name}, table 3": color for name, color in _OVER_TIME_COLORS.items()},
    "index J, last height held": (_OVER_TIME_COLORS["index J"], "dash"),
}


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


_TITLE = "Optimal preview control of a car with seven degrees of freedom"
report = StudyReport(EXPERIMENT, _TITLE, claims.CLAIMS, _parameters, _LOOKS)


@report.lead
def _main_result(study: Results) -> Content:
    shares = {c: {p: claims.relative_index(study, *p, c) for p in PARTS} for c in CONTROLLED}
    preview, delay, active = (
        " and ".join(f"{shares[c]['both', w]:.1f} %" for w in WEIGHT_SETS) for c in ("preview", "delay", "active")
    )
    yield f"""With {PREVIEW_TIME:g} s of preview, the quadratic indices of {" and ".join(WEIGHT_NAMES.values())} are
    {preview} of the passive car's with input on both sides, compared with {delay} if the controller only knows the
    road of the rear wheels from the front wheels, and {active} without any information on the road."""
    names = [f"{WEIGHT_NAMES[w]}, {INPUT_NAMES[i]}" for i, w in PARTS]
    heights = {c: [*values.values()] for c, values in shares.items()}
    yield Figure(
        "main-result",
        "Index J by what the controller knows of the road",
        "active: no information on the road; delay: the road of the rear wheels from the front wheels; preview: the"
        f" road {PREVIEW_TIME:g} s ahead. The passive car is at 100 %.",
        [bars("index, input [?]", "J, per cent of passive [%]", names, heights)],
    )


@report.section("Runs of the study")
def _about(_: Results) -> Content:
    yield f"""A linear sedan crosses a hole and a bump at {SPEED_KMH:g} km/h, passive and under the optimal LQ
    controller with three information patterns: none of the road, the rear wheels' road from the front wheels, and
    preview ahead. Car, road and controller are native FMUs exchanging every millisecond. Tables and figures of
    Marzbanrad, Hojjat, Zohoor and Nikravesh stand beside what these runs give."""


@report.section("Closed-loop poles")
def _poles(study: Results) -> Content:
    yield f"""Poles of the continuous design from the equations and the numbers of the car FMU, with
    {claims.sprung_mass(study)}."""
    rows = []
    for design in DESIGNS:
        weights, _, rest = design.partition(", ")
        name, computed = WEIGHT_NAMES[weights] + f", {rest} of N" * bool(rest), claims.eigenvalues(study, design)
        pairs = claims.matched(computed) if weights == "comfort" else [(None, own, None) for own in computed]
        rows += [
            {
                "design": name,
                "printed [1/s]": None if printed is None else _complex(printed),
                "computed [1/s]": _complex(own),
                "distance [%]": None if distance is None else round(100 * distance, 2),
            }
            for printed, own, distance in pairs
        ]
    yield Table.of("table-2", "Closed-loop eigenvalues, upper half plane (table 2 of the paper)", rows)


def _complex(value: complex) -> str:
    return f"{value.real:.2f} + {value.imag:.2f}i"


@report.section("Mean squares and index")
def _table3(study: Results) -> Content:
    yield f"""Means over {DURATION:g} s; preview {PREVIEW_TIME:g} s. The size of hole and bump cancels. Columns in the
    paper's order: left front, left rear, right front, right rear.

    Misprints of the table: in a) the active system's s4 (s rr) is 137.0, not 1370; in c) t3 and t4 (t fr, t rr) are ten
    times too small; roll with both sides equal is 0/0, printed as 100.

    Where the computed and the printed components differ by more than a few per cent, the printed design differs too:
    its two low pole pairs are off (see the poles)."""
    for (input_, weights), part in PARTS.items():
        rows: list[list[Any]] = []
        for c in CONTROLLERS:
            computed = claims.relative(study, input_, weights, c)
            rows.append([c, "computed", *(None if v is None else round(v, 1) for v in computed)])
            if weights == "comfort" and c != "passive":
                rows.append([c, "printed", *published.PRINTED[input_, c]])
                rows.append([c, "corrected", *corrected(input_, c)])
        title = f"{INPUT_NAMES[input_].capitalize()}, {WEIGHT_NAMES[weights]}, per cent of passive"
        columns = ["system", "row", *(f"{n} [%]" for n in _SHORT)]
        yield Table(f"table-3{part}", f"{title} (table 3{part} of the paper)", columns, rows)


@report.section("Preview time")
def _figure3(study: Results) -> Content:
    worst = max(claims.worst_short_preview(study, place) for place in PARTS)
    yield f"""Mean squares over preview time, relative to no preview with the delay between the axles known.

    The first 10 to 20 ms make the index worse, by up to {100 * (worst - 1):.0f} %, before longer previews make it
    better. The controller with a finite horizon takes the road beyond it to be at height 0. Seen from the middle of a
    bump, a horizon of 10 ms says that the road is about to fall to 0 within 10 ms, and the front actuators prepare for
    an edge that is not there; the longer the horizon, the farther off and the less urgent the supposed edge. Without
    any preview the front road does not enter the controller at all, so it makes no false assumption. The dashed curve
    of the index shows it: if the road is taken to continue at its last height instead (hold_tail), every preview is
    better than none."""
    panels = []
    for input_, weights in product(INPUTS, WEIGHT_SETS):
        curves = [_over_none(study, text, names, input_, weights) for text, names in _OVER_TIME.items()]
        curves.append(_over_none(study, "index J, last height held", ["J"], input_, weights, hold_tail=True))
        if weights == "comfort":  # the set of weights that table 3 has
            curves += _printed_over_none(input_)
        title = f"{WEIGHT_NAMES[weights]}, {INPUT_NAMES[input_]}"
        panels.append(Panel(title, "preview time [s]", "relative to no preview [-]", curves))
    yield Figure(
        "figure-3",
        "Effect of preview time (figure 3 of the paper)",
        "Suspension and tire: sums over the four wheels. Points: from the cells of table 3, preview over delay.",
        panels,
        columns=2,
    )


def _over_none(study: Results, name: str, metrics: list[str], *of: str, hold_tail: bool = False) -> Series:
    cases = published.over_preview(*of, hold_tail=hold_tail)
    sums = [sum(study[c][m] for m in metrics) for c in cases.values()]
    return Series(name, list(cases), [s / sums[0] for s in sums])


def _printed_over_none(input_: str) -> Iterator[Series]:
    """Ratio of preview to delay in table 3, for curves that are no sums.

    The table gives the parts of sums as per cent of the passive car's values, so they cannot be added.
    """
    with_preview, without = (
        dict(zip((*PAPER_COLUMNS, "J"), corrected(input_, c), strict=True)) for c in ("preview", "delay")
    )
    for text, (name, *others) in _OVER_TIME.items():
        above, below = with_preview[name], without[name]
        if not others and above is not None and below is not None:
            yield Series(f"{text}, table 3", [PREVIEW_TIME], [above / below], mode="markers")


@report.section("Time histories")
def _histories(study: Results) -> Content:
    for number, weights in (("4", "comfort"), ("5", "road-holding")):
        runs = {c: study.signals(Case("left", weights, c)) for c in CONTROLLERS}
        panels = []
        for k in ("fl", "rl"):
            wheels = [curve(c, r, f"car.wheel.{k}.z", 1e3) for c, r in runs.items()]
            road = curve("road", runs["passive"], f"road.road.{k}.height", 1e3)
            panels.append(Panel(f"wheel {k}", "time [s]", "height [mm]", [road, *wheels]))
        title = f"Wheel tracking, left side, {WEIGHT_NAMES[weights]} (figure {number} of the paper)"
        yield Figure(f"figure-{number}", title, "Wheel height over the road under it.", panels)
    for number, input_ in (("6", "both"), ("7", "left")):
        panels = []
        for w in WEIGHT_SETS:
            forces = [
                (f"{WEIGHT_NAMES[w]}, {k}", "force [kN]", f"controller.force.{k}", 1e-3)
                for k in (("fl", "rl") if input_ == "both" else CORNERS)
            ]
            panels += over_time({c: study.signals(Case(input_, w, c)) for c in CONTROLLED}, forces)
        title = f"Control forces, {INPUT_NAMES[input_]} (figure {number} of the paper)"
        yield Figure(f"figure-{number}", title, "Hole and bump 50 mm.", panels, columns=2)


@report.section("Sample time")
def _sampling(study: Results) -> Content:
    yield """The controller of PreviewLqComfort5ms is designed for its sample time (exact sampled gains and costs), not
    the 1 ms controller run slowly."""
    fine, passive = (study[Case("both", "comfort", c)]["J"] for c in ("preview", "passive"))
    rows = (
        {
            "sample time [ms]": ms,
            "J [% of passive]": round(100 * index / passive, 2),
            "compared with 1 ms [%]": round(100 * (index / fine - 1), 2),
        }
        for ms, index in ((1, fine), (5, study[published.COARSE]["J"]))
    )
    yield Table.of("sampling", "Ride comfort with preview, both sides", rows)


@report.section("Steps")
def _refinement(study: Results) -> Content:
    yield "Whether the results depend on the steps."
    found = {c: with_finer_steps(study, Case("both", "comfort", c)) for c in CONTROLLERS}
    rows = (
        {
            "steps": steps,
            **{f"J, {c} [-]": rows[steps]["J"] for c, rows in found.items()},
            "largest change [%]": 100 * max(abs(r[steps]["J"] / r["as in the runs"]["J"] - 1) for r in found.values()),
        }
        for steps in found["passive"]
    )
    yield Table.of(
        "refinement",
        "Index of ride comfort, both sides, with finer steps",
        rows,
        "Solver step and communication step of the car; controller and road keep their sample time of 1 ms.",
    )


@report.section("A road that does not return to zero")
def _offset(study: Results) -> Content:
    cut, held = (study.signals(published.plateau(hold_tail=h)) for h in (False, True))
    lasting = [float(np.abs(r["controller.force.fl"][-100:]).mean()) for r in (cut, held)]
    yield f"""A preview that is truncated at a horizon assumes height 0 beyond it. A constant offset or a slow drift of
    the road then requests forces without end: {lasting[0]:.0f} N at the front left wheel 2.5 s after a step of
    {PLATEAU_MM:g} mm. With hold_tail the road is taken to continue at its last height, and the force dies out
    ({lasting[1]:.1g} N)."""
    signals = [
        ("force, front left", "force [kN]", "controller.force.fl", 1e-3),
        ("body height", "height [mm]", "car.body.z", 1e3),
    ]
    yield Figure(
        "offset",
        f"Driving onto a plateau of {PLATEAU_MM:g} mm",
        "Without hold_tail the controller takes the road to return to height 0 beyond its horizon and keeps"
        " drawing the body down.",
        over_time({"height 0 beyond the horizon": cut, "last height held": held}, signals),
        columns=2,
    )
