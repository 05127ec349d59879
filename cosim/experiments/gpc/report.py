"""Figures and tables of paper 000 as a report."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

from cosim.experiments.gpc import EXPERIMENT
from cosim.experiments.gpc.claims import CLAIMS, R_TEXT, Judge, number
from cosim.experiments.gpc.published import ACTIVE_CONTROLLERS, CURB_SPEED, SINE_SPEED, WEIGHTS
from cosim.experiments.gpc.results import METRICS, Results, select
from cosim.experiments.gpc.runs import PLANT, R_PUBLISHED, ROADS, TRAVEL
from cosim.report import Claims, Evidence, Figure, Panel, Parameter, Series, Table, over_time
from cosim.report.model import Look
from cosim.study import Content, Distribution, FmuSet, Row, RunFailed, StudyReport, parameters
from cosim.study import Results as Runs
from cosim.study.pages import compared
from fmu_sources.controllers.gpc.component import FORCE_LIMIT
from fmu_sources.controllers.gpc.identification import DesignSettings, IdentificationSettings
from fmu_sources.models.corners import CORNERS

_NAMES = {"sine": "sine", "perryman3": "Perryman 3", "curb": "curb"}  # in tables
_TITLES = {"sine": "Sine road", "perryman3": "Perryman 3 road (synthetic)", "curb": "Curb"}
_LOOKS: dict[str, Look] = {
    "passive": ("gray", "solid"),
    "implicit": ("orange", "dot"),
    "explicit": ("blue", "dash"),
    "preview": ("green", "solid"),
}
_SPEED = "speed [km/h]"
_QUANTITIES = (
    ("response", "Response objective (22a)", "J (g, deg) [-]"),
    ("improvement", "Response improvement (23)", "improvement [-]"),
    ("force", "Actuator force (22b)", "force [kN]"),
    ("power", "Actuator power (22c)", "power [W]"),
    ("per_force", "Force-normalized effectiveness (24a)", "improvement per force [1/kN]"),
    ("per_power", "Power-normalized effectiveness (24b)", "improvement per power [1/kW]"),
)
_EFFORTS = {"force [N]": ("force", 1), "power [W]": ("power", 1), "peak force [N]": ("peak_force", 0)}
"""Heading -> metric and decimals."""
_OVER_SEEDS = "Lines are medians over the identification seeds, bands span all of them."


class View(NamedTuple):
    """What the report reads: numbers, judged claims, and the name of the car's FMU."""

    results: Results
    claims: Claims
    car: str


def _view(runs: Runs, fmus: FmuSet) -> View:
    results = Results(runs)
    chosen = [p for p in _parameters(fmus) if "000 figure" in p.source]  # with a figure of the paper in view
    judge = Judge(results, "; ".join(f"{p.name} = {p.value:g} ({p.source})" for p in chosen))  # type: ignore[str-bytes-safe]
    return View(results, CLAIMS.judge(judge, judge.singles(), "identifications"), fmus.name(PLANT))


def _parameters(fmus: FmuSet) -> list[Parameter]:
    paper = "000 Table 2"
    i, d = IdentificationSettings(), DesignSettings()
    return [
        *parameters(fmus.path(PLANT)),
        Parameter("GPC order p", i.order, "-", paper),
        Parameter("GPC prediction horizon", d.h_p, "-", paper),
        Parameter("GPC control horizon", d.h_c, "-", paper),
        Parameter("GPC weight Q, vertical acceleration", d.Q[0], "1/g2", paper),
        Parameter("GPC weight Q, pitch", d.Q[1], "1/deg2", paper),
        Parameter("GPC weight Q, roll", d.Q[2], "1/deg2", paper),
        Parameter("GPC weight R", R_PUBLISHED, "1/N2", paper),
        Parameter("identification samples L", i.samples, "-", paper),
        Parameter("identification speed", i.speed, "m/s", paper),
        Parameter("excitation per actuator, standard deviation", i.excitation, "N", "assumed"),
        Parameter("samples before the excitation", i.settling_samples, "-", "assumed"),
        Parameter("actuator limit", FORCE_LIMIT, "N", paper),
        Parameter("travel per run", TRAVEL, "m", "000, text"),
    ]


report = StudyReport(
    EXPERIMENT,
    "Full car under generalized predictive control",
    lambda view: view.claims,
    _parameters,
    _LOOKS,
    view=_view,
    provenance=lambda view: {
        "identification": IdentificationSettings().told(),
        "identification seeds": list(view.results.seeds),
        "roads": list(ROADS.values()),
        "corners": list(CORNERS),
    },
)


@report.lead
def _main_result(view: View) -> Content:
    results = view.results
    gains = {c: results.improvements("sine", SINE_SPEED, c).median for c in ACTIVE_CONTROLLERS}
    changes = [
        f"{compared(1 - gain / 100, 1.0) if math.isfinite(gain) else 'diverged'} with {controller}"
        for controller, gain in gains.items()
    ]
    yield f"""On the sine road at {SINE_SPEED:g} km/h, the response of the car (objective J of vertical acceleration,
    pitch and roll) is {", ".join(changes[:-1])} and {changes[-1]} GPC than that of the passive car (medians over
    {len(results.seeds)} identification seeds, {R_TEXT}); the passive response peaks at {results.open_loop_peak():g}
    km/h."""
    published = {c: _rows(results.published, "sine", c) for c in ACTIVE_CONTROLLERS}
    curves = [_curve(results, "response", c, results.speeds, rows) for c, rows in published.items()]
    panel = Panel("", _SPEED, _QUANTITIES[0][2], _drawn(_passive_curve(results, "sine"), *curves))
    caption = f"{R_TEXT} for every controller: nothing is matched. {_OVER_SEEDS}"
    yield Figure("main-result", "Response over speed on the sine road", caption, [panel])


@report.section("Runs of the study")
def _about(view: View) -> Content:
    study = view.results
    yield f"""A nonlinear HMMWV ({view.car}) crosses three roads at {len(study.speeds)} speeds, passive and under three
    GPC controllers, each identified {len(study.seeds)} times with another random excitation. Car, roads and controllers
    are native FMUs; the co-simulation master exchanges at 1 kHz, the controllers act at 100 Hz. Figures and claims of
    Brown, Murugan and Mazza stand beside what these runs give."""


Rows = Callable[[float, int], Row | None]  # of a curve, by speed [km/h] and seed


def _curve(results: Results, key: str, name: str, speeds: Sequence[float], rows: Rows) -> Series | None:
    """Median over the seeds by speed, with the band that the seeds span; gaps where no seed has a row."""
    points = []
    for v in sorted(speeds):
        found = [results.figures(r)[key] for s in results.seeds if (r := rows(v, s)) is not None]
        finite = [x for x in found if math.isfinite(x)]
        d = Distribution(finite) if finite else None
        points.append((v, *((d.median, d.low, d.high) if d else (math.nan, math.nan, math.nan))))
    x, y, low, high = (list(column) for column in zip(*points, strict=True))
    if not any(map(math.isfinite, y)):
        return None
    alone = low == high
    return Series(name, x, y, None if alone else low, None if alone else high, mode="line+markers")


def _rows(of: Callable[..., Row | None], road: str, controller: str) -> Rows:
    return lambda v, s: of(road, v, controller, s)


def _passive_curve(results: Results, road: str) -> Series | None:
    return _curve(results, "response", "passive", _speeds(results, road), lambda v, _: results.passive(road, v))


def _speeds(results: Results, road: str) -> list[float]:
    return sorted({*results.speeds, CURB_SPEED} if road == "curb" else results.speeds)


def _drawn(*curves: Series | None) -> list[Series]:
    return [c for c in curves if c is not None]


def _panels(results: Results, road: str, speeds: Sequence[float], controlled: dict[str, Rows]) -> list[Panel]:
    """Each quantity over speed; the passive car has a response alone."""
    panels = []
    for key, title, label in _QUANTITIES:
        passive = [_passive_curve(results, road)] if key == "response" else []
        curves = (_curve(results, key, name, speeds, rows) for name, rows in controlled.items())
        panels.append(Panel(title, _SPEED, label, _drawn(*passive, *curves)))
    return panels


def _evidence(id: str, on: str, found: Claims, prefixes: tuple[str, ...]) -> Table:
    return Table(
        f"distributions-{id}",
        f"Distributions behind the claims on {on}",
        Evidence.COLUMNS,
        [e.row() for e in found.evidence if e.claim.startswith(prefixes)],
        "Distributions over the identification seeds (ratios: those in which the controllers could be matched) and how"
        " many agree with the claim. The median decides; for a strict claim 7 of 8 or 6 of 6 have to agree (sign test"
        " at 5 %).",
    )


@report.section("Effect of the control weight")
def _weights(view: View) -> Content:
    yield """The preview controller is redesigned for every weight R from the same identified model; only gain
    parameters of the controller FMU change."""
    results = view.results
    yield Figure(
        "figure-6",
        "Control weight, GPC with preview on the sine road (figure 6 of the paper)",
        f"Runs over 150 m. An order of magnitude in R buys response and costs force and power. {_OVER_SEEDS}",
        _panels(results, "sine", results.speeds, {f"R = {number(w)}": partial(results.swept, w) for w in WEIGHTS}),
        columns=2,
    )
    yield _evidence("weights", "the control weight", view.claims, ("weight-",))


def _road(view: View, road: str, figure: int, prefixes: tuple[str, ...], text: str) -> Content:
    yield text
    results, speeds = view.results, _speeds(view.results, road)
    named = _TITLES[road] if road == "perryman3" else _TITLES[road][0].lower() + _TITLES[road][1:]
    yield Figure(
        f"figure-{figure}",
        f"The three controllers on the {named} (figure {figure} of the paper)",
        "R = 1e-7 for explicit; at each speed and for each seed the weights of implicit and preview are chosen so that"
        " their response objective equals explicit's, so the first two panels show one controller three times. Left"
        f" out: seeds in which no weight does, or explicit does not lower the response. {_OVER_SEEDS}",
        _panels(results, road, speeds, {c: _rows(results.matched, road, c) for c in ACTIVE_CONTROLLERS}),
        columns=2,
    )
    yield _history(results, road, named, figure + 1)
    yield Table.of(
        f"comparison-{road}",
        f"Runs on the {named}, medians over the seeds",
        [_compared(results, road, v, controller) for v in speeds for controller in ("passive", *ACTIVE_CONTROLLERS)],
        "Matched: seeds in which a weight gives the controller explicit's response; the others are left out.",
    )
    yield _evidence(road, f"the {named}", view.claims, prefixes)


def _history(results: Results, road: str, named: str, figure: int) -> Figure:
    histories = select(results.histories, road=road)
    if not histories:
        raise RunFailed(f"there are no time histories on the {named}")
    shown = {
        h["controller"]: {k: v for k, v in h.items() if (h["controller"], k) != ("passive", "force")} for h in histories
    }
    panels = over_time(
        shown,
        [
            ("Vertical acceleration", "body.az [m/s2]", "az", 1.0),
            ("Pitch, nose down", "pitch [deg]", "pitch", 1.0),
            ("Roll, left side up", "roll [deg]", "roll", 1.0),
            ("Actuator force, front left", "force.fl [kN]", "force", 1e-3),
        ],
    )
    first = histories[0]
    weights = ", ".join(f"{h['controller']} R = {h['R']:.2g}" for h in histories if h["controller"] != "passive")
    return Figure(
        f"figure-{figure}",
        f"Time histories on the {named} at {first['speed_kmh']:g} km/h (figure {figure} of the paper)",
        f"Identification seed {first['seed']}. Weights: {weights}.",
        panels,
    )


def _compared(results: Results, road: str, speed: float, controller: str) -> dict[str, Any]:
    """A row of the comparison: medians over the seeds that could be matched."""
    passive = controller == "passive"
    rows = (
        [results.passive(road, speed)]
        if passive
        else [r for s in results.seeds if (r := results.matched(road, speed, controller, s)) is not None]
    )
    matched = "not found" if not rows else f"{len(rows)} of {len(results.seeds)}"

    def median(key: str, digits: int) -> float | None:
        return round(Distribution(r[key] for r in rows).median, digits) if rows else None

    gain = Distribution([0.0] if passive else map(results.improvement, rows)) if rows else None
    return {
        "speed [km/h]": speed,
        "controller": controller,
        "R [1/N2]": None if passive or not rows else float(f"{Distribution(r['R'] for r in rows).median:.3g}"),
        "matched": None if passive or (controller == "explicit" and rows) else matched,
        "J [-]": median("response", 4),
        "improvement [-]": gain and round(gain.median, 4),
        "lowest [-]": gain and round(gain.low, 4),
        "highest [-]": gain and round(gain.high, 4),
        **{heading: 0.0 if passive else median(key, digits) for heading, (key, digits) in _EFFORTS.items()},
    }


for _name, _figure, _prefixes, _text in (
    ("sine", 7, ("sine-", "implicit-"), "Half-amplitude 0.10 m, wavelength 10 m, after 30 m of flat road."),
    (
        "perryman3",
        9,
        ("perryman-",),
        """The measured course is not public. This road is synthetic: it has the published character (neither linear,
        Gaussian nor stationary, large peaks between 0.5 and 3 Hz at 40 km/h), not the published profile.""",
    ),
    (
        "curb",
        11,
        ("curb-",),
        """A step of 0.10 m up after 30 m, 10 m long, and down again. The explicit controller ignores the road ahead
        (height 0).""",
    ),
):
    report.section(_TITLES[_name])(partial(_road, road=_name, figure=_figure, prefixes=_prefixes, text=_text))


@report.section("Spread over identification seeds")
def _seeds(view: View) -> Content:
    results, found = view.results, view.claims
    yield f"""A controller depends on the excitation it was identified with. So a claim is judged on the median of the
    seeds, and the tables above have the distributions. The paper had one identification: judged on each of these alone,
    {min(found.by_sample)} to {max(found.by_sample)} of {found.published} claims hold in full. In the table every
    controller has the published weight R = 1e-7: nothing is matched."""
    cases = {"sine": SINE_SPEED, "perryman3": results.worst_speed("perryman3"), "curb": CURB_SPEED}
    rows = []
    for (road, v), controller, seed in product(cases.items(), ACTIVE_CONTROLLERS, results.seeds):
        r = results.published(road, v, controller, seed)
        improvement = None if r["diverged"] else round(results.improvement(r), 4)
        efforts = {h: None if r["diverged"] else round(r[key], digits) for h, (key, digits) in _EFFORTS.items()}
        where = {"road": _NAMES[road], "speed [km/h]": v, "controller": controller, "seed": seed}
        rows.append({**where, "improvement [-]": improvement, **efforts})
    yield Table.of("seeds", f"{R_TEXT}, {len(results.seeds)} identification seeds", rows)


@report.section("Refinement of steps")
def _refinement(view: View) -> Content:
    yield """The car is integrated at 0.5 ms by a predictor-corrector method of Adams, Bashforth and Moulton and
    exchanges with road and controller every 1 ms, as in the paper. The method restarts at every exchange, so what it
    does depends on how time is divided into steps: with the exchange halved at the same solver step every step is a
    first one, and results move a little more than with both halved. A claim whose figure could be moved across the edge
    of its band by the largest number of this table would be open."""
    rows: list[list[Any]] = []
    for r, words, moves in view.results.moves():
        cells = [None if k not in moves or math.isnan(moves[k]) else float(f"{100 * moves[k]:.2g}") for k in METRICS]
        rows.append([_NAMES[r["road"]], r["speed_kmh"], r["controller"], words, *cells])
    yield Table(
        "refinement",
        "Change of metrics when steps are halved",
        ["road", "speed [km/h]", "controller", "refinement", *(f"{words} [%]" for words in METRICS.values())],
        rows,
        f"{R_TEXT}, seed {view.results.seeds[0]}; the controllers stay those identified with the steps of the study.",
    )


@report.section("Differences from the paper")
def _limits(_: View) -> Content:
    yield """The paper's vehicle is a TruckSim model with measured tire tables, suspension compliances, nonlinear
    kinematics and a powertrain; the stand-in has the published masses, springs and dampers, public or assumed values
    for the rest (see the parameters), vertical wheel travel with stops, and a tire with slip lags.

    The identification excitation is not given in the paper and decides how well the implicit controller does: 2 kN per
    actuator, white up to the Nyquist frequency, is assumed.

    Explicit leaves the future road out of its optimization, as published, which amounts to height 0 ahead. Run `cosim
    run gpc --road curb --controller explicit --hold` to see what holding the last height changes."""
