"""Figures and tables of paper 000 as a report."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from cosim.experiments.gpc import EXPERIMENT
from cosim.experiments.gpc.judge import CLAIMS, R_TEXT, Judge, number
from cosim.experiments.gpc.published import ACTIVE_CONTROLLERS, CURB_SPEED, SINE_SPEED, WEIGHTS
from cosim.experiments.gpc.results import METRICS, Results, Study, select
from cosim.experiments.gpc.runs import PLANT, R_PUBLISHED, ROADS, TRAVEL
from cosim.report import Claims, Evidence, Figure, Panel, Parameter, Report, Section, Series, Table
from cosim.study import Distribution, FmuSet, Row, make_lead, parameters, provenance, sections
from cosim.study import Results as Runs
from cosim.study.pages import compared
from fmu_sources.controllers.gpc.component import FORCE_LIMIT
from fmu_sources.controllers.gpc.identification import DesignSettings, IdentificationSettings
from fmu_sources.models.corners import CORNERS

NAN = float("nan")
_ROAD_FIGURES = {"sine": ("7", "8"), "perryman3": ("9", "10"), "curb": ("11", "12")}
_NAMES = {"sine": "sine", "perryman3": "Perryman 3", "curb": "curb"}  # in tables
_TITLES = {"sine": "Sine road", "perryman3": "Perryman 3 road (synthetic)", "curb": "Curb"}
_LOOKS = {
    "passive": ("gray", "solid"),
    "implicit": ("orange", "dot"),
    "explicit": ("blue", "dash"),
    "preview": ("green", "solid"),
}
_SPEED = "speed [km/h]"


def report(runs: Runs, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    study, given = Study.of(runs), _parameters(fmus)
    judge = Judge(study, _fitted(given))
    found = CLAIMS.judge(judge, judge.singles(), "identifications")
    results = Results(study)
    makers: list[Callable[[Results], Any]] = [
        partial(_weights, found=found),
        *(partial(_road, road=road, found=found) for road in _ROAD_FIGURES),
        partial(_seeds, found=found),
        _refinement,
        _limits,
    ]
    lead, figure = make_lead(results, _main_result)
    about = Section(
        "Runs of the study",
        [
            f"A nonlinear HMMWV ({fmus.name(PLANT)}) crosses three roads at {len(study.speeds)} speeds, passive and"
            f" under three GPC controllers, each identified {len(study.seeds)} times with another random excitation."
            " Car, roads and controllers are native FMUs; the co-simulation master exchanges at 1 kHz,"
            " the controllers act at 100 Hz. Figures and claims of Brown, Murugan and Mazza stand beside"
            " what these runs give."
        ],
    )
    return Report(
        experiment=EXPERIMENT.name,
        title="Full car under generalized predictive control",
        lead=lead,
        figure=figure,
        claims=found,
        sections=[about, *sections(results, makers)],
        parameters=given,
        provenance=_provenance(fmus, study),
    )


def _main_result(results: Results) -> tuple[str, Figure]:
    """Response over speed on the sine road."""
    gains = {
        controller: results.improvements("sine", SINE_SPEED, controller).median for controller in ACTIVE_CONTROLLERS
    }
    changes = [
        f"{compared(1 - gain / 100, 1.0) if math.isfinite(gain) else 'diverged'} with {controller}"
        for controller, gain in gains.items()
    ]
    lead = (
        f"On the sine road at {SINE_SPEED:g} km/h, the response of the car (objective J of vertical acceleration, pitch"
        f" and roll) is {', '.join(changes[:-1])} and {changes[-1]} GPC than that of the passive car (medians over"
        f" {len(results.seeds)} identification seeds, {R_TEXT}); the passive response peaks at"
        f" {results.open_loop_peak():g} km/h."
    )
    curves = [
        _passive_curve(results, "sine"),
        *(
            _curve(results, "response", controller, results.speeds, _at_published_weight(results, controller))
            for controller in ACTIVE_CONTROLLERS
        ),
    ]
    panel = Panel("", _SPEED, _QUANTITIES[0][2], [c for c in curves if c is not None])
    caption = f"{R_TEXT} for every controller: nothing is matched. {_OVER_SEEDS}"
    return lead, Figure("main-result", "Response over speed on the sine road", caption, [panel])


def _at_published_weight(results: Results, controller: str) -> Rows:
    return lambda v, s: results.published("sine", v, controller, s)


def _fitted(parameters: Iterable[Parameter]) -> str:
    """What of the vehicle was chosen with a figure of the paper in view: its source says so."""
    return "; ".join(f"{p.name} = {p.value:g} ({p.source})" for p in parameters if "000 figure" in p.source)  # type: ignore[str-bytes-safe]


# ---------------------------------------------------------------------- figures


_QUANTITIES = (
    ("response", "Response objective (22a)", "J (g, deg) [-]"),
    ("improvement", "Response improvement (23)", "improvement [-]"),
    ("force", "Actuator force (22b)", "force [kN]"),
    ("power", "Actuator power (22c)", "power [W]"),
    ("per_force", "Force-normalized effectiveness (24a)", "improvement per force [1/kN]"),
    ("per_power", "Power-normalized effectiveness (24b)", "improvement per power [1/kW]"),
)


def _title(road: str) -> str:
    return _TITLES[road][0].lower() + _TITLES[road][1:] if road != "perryman3" else _TITLES[road]


def _series(name: str, x: Sequence[float], y: Sequence[float], mode: str) -> Series:
    color, dash = _LOOKS.get(name, (None, None))
    return Series(name, x, y, color=color, dash=dash, mode=mode)  # type: ignore[arg-type]


Rows = Callable[[float, int], Row | None]  # of a curve, by speed [km/h] and seed


def _curve(
    results: Results, key: str, name: str, speeds: Sequence[float], rows: Rows, scale: float = 1.0
) -> Series | None:
    """Median over the seeds by speed, with the band that the seeds span; gaps where no seed has a row."""
    points = []
    for v in sorted(speeds):
        found = [results.figures(r)[key] for s in results.seeds if (r := rows(v, s)) is not None]
        found = [scale * x for x in found if math.isfinite(x)]
        d = Distribution(found) if found else None
        points.append((v, *((d.median, d.low, d.high) if d else (NAN, NAN, NAN))))
    x, y, low, high = (list(column) for column in zip(*points, strict=True))
    if not any(map(math.isfinite, y)):
        return None
    color, dash = _LOOKS.get(name, (None, None))
    band = {} if low == high else {"low": low, "high": high}
    return Series(name, x, y, color=color, dash=dash, mode="line+markers", **band)  # type: ignore[arg-type]


def _panels(curves: Callable[[str], Iterable[Series | None]]) -> list[Panel]:
    return [Panel(title, _SPEED, label, [c for c in curves(key) if c is not None]) for key, title, label in _QUANTITIES]


def _matched(results: Results, road: str, controller: str) -> Rows:
    return lambda v, s: results.matched(road, v, controller, s)


def _passive_curve(results: Results, road: str) -> Series | None:
    return _curve(results, "response", "passive", _speeds(results, road), lambda v, _: results.passive(road, v))


def _speeds(results: Results, road: str) -> list[float]:
    return sorted({*results.speeds, CURB_SPEED} if road == "curb" else results.speeds)


_OVER_SEEDS = "Lines are medians over the identification seeds, bands span all of them."


def _weights(results: Results, *, found: Claims) -> Section:
    def curves(key: str) -> list[Series | None]:
        return [
            _passive_curve(results, "sine") if key == "response" else None,
            *(_curve(results, key, f"R = {number(w)}", results.speeds, partial(results.swept, w)) for w in WEIGHTS),
        ]

    figure = Figure(
        "figure-6",
        "Control weight, GPC with preview on the sine road (figure 6 of the paper)",
        f"Runs over 150 m. An order of magnitude in R buys response and costs force and power. {_OVER_SEEDS}",
        _panels(curves),
        columns=2,
    )
    return Section(
        "Effect of the control weight",
        [
            "The preview controller is redesigned for every weight R from the same identified model; only gain"
            " parameters of the controller FMU change."
        ],
        [figure],
        [_evidence("weights", "the control weight", found, ("weight-",))],
    )


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


def _road(results: Results, *, road: str, found: Claims) -> Section:
    number, history_number = _ROAD_FIGURES[road]

    def curves(key: str) -> list[Series | None]:
        return [
            _passive_curve(results, road) if key == "response" else None,
            *(
                _curve(results, key, controller, _speeds(results, road), _matched(results, road, controller))
                for controller in ACTIVE_CONTROLLERS
            ),
        ]

    comparison = Figure(
        f"figure-{number}",
        f"The three controllers on the {_title(road)} (figure {number} of the paper)",
        "R = 1e-7 for explicit; at each speed and for each seed the weights of implicit and preview are chosen so that"
        " their response objective equals explicit's, so the first two panels show one controller three times. Left"
        f" out: seeds in which no weight does, or explicit does not lower the response. {_OVER_SEEDS}",
        _panels(curves),
        columns=2,
    )
    return Section(
        _TITLES[road],
        [_TEXTS[road]],
        [comparison, _history(results, road, history_number)],
        [_comparison_table(results, road), _evidence(road, f"the {_title(road)}", found, (_PREFIXES[road]))],
    )


_TEXTS = {
    "sine": "Half-amplitude 0.10 m, wavelength 10 m, after 30 m of flat road.",
    "curb": (
        "A step of 0.10 m up after 30 m, 10 m long, and down again. The explicit controller ignores the road ahead"
        " (height 0)."
    ),
    "perryman3": (
        "The measured course is not public. This road is synthetic: it has the published character (neither linear, "
        "Gaussian nor stationary, large peaks between 0.5 and 3 Hz at 40 km/h), not the published profile."
    ),
}
_PREFIXES = {"sine": ("sine-", "implicit-"), "perryman3": ("perryman-",), "curb": ("curb-",)}


def _history(results: Results, road: str, number: str) -> Figure:
    histories = select(results.study.histories, road=road)
    signals = (
        ("az", "Vertical acceleration", "body.az [m/s2]"),
        ("pitch", "Pitch, nose down", "pitch [deg]"),
        ("roll", "Roll, left side up", "roll [deg]"),
        ("force", "Actuator force, front left", "force.fl [kN]"),
    )
    first = histories[0]
    return Figure(
        f"figure-{number}",
        f"Time histories on the {_title(road)} at {first['speed_kmh']:g} km/h (figure {number} of the paper)",
        f"Identification seed {first['seed']}. Weights: "
        + ", ".join(f"{h['controller']} R = {h['R']:.2g}" for h in histories if h["controller"] != "passive")
        + ".",
        [
            Panel(
                title,
                "time [s]",
                label,
                [
                    _series(h["controller"], h["time"], [v / 1e3 for v in h[key]] if key == "force" else h[key], "line")
                    for h in histories
                    if not (key == "force" and h["controller"] == "passive")
                ],
            )
            for key, title, label in signals
        ],
        columns=1,
    )


def _comparison_table(results: Results, road: str) -> Table:
    """Medians over the seeds that could be matched."""
    rows: list[list[float | str | None]] = []
    for v in _speeds(results, road):
        passive = results.passive(road, v)
        rows.append([v, "passive", None, None, round(passive["response"], 4), *[0.0] * 6])
        for controller in ACTIVE_CONTROLLERS:
            found = [r for s in results.seeds if (r := results.matched(road, v, controller, s)) is not None]
            if not found:
                rows.append([v, controller, None, "not found", *[None] * 7])
                continue
            gain = Distribution(results.improvement(r) for r in found)
            m = {k: Distribution(r[k] for r in found).median for k in ("R", "response", "force", "power", "peak_force")}
            spread = [round(x, 4) for x in (gain.median, gain.low, gain.high)]
            efforts = [round(m["force"], 1), round(m["power"], 1), round(m["peak_force"], 0)]
            matched = None if controller == "explicit" else f"{len(found)} of {len(results.seeds)}"
            rows.append([v, controller, float(f"{m['R']:.3g}"), matched, round(m["response"], 4), *spread, *efforts])
    return Table(
        f"comparison-{road}",
        f"Runs on the {_title(road)}, medians over the seeds",
        [
            "speed [km/h]",
            "controller",
            "R [1/N2]",
            "matched",
            "J [-]",
            "improvement [-]",
            "lowest [-]",
            "highest [-]",
            "force [N]",
            "power [W]",
            "peak force [N]",
        ],
        rows,
        "Matched: seeds in which a weight gives the controller explicit's response; the others are left out.",
    )


def _seeds(results: Results, *, found: Claims) -> Section:
    cases = [("sine", SINE_SPEED), ("perryman3", results.worst_speed("perryman3")), ("curb", CURB_SPEED)]
    rows: list[list[float | str | None]] = []
    for road, v in cases:
        for controller in ACTIVE_CONTROLLERS:
            for seed in results.seeds:
                r = results.published(road, v, controller, seed)
                own = (
                    [None] * 4
                    if r["diverged"]
                    else [
                        round(results.improvement(r), 4),
                        round(r["force"], 1),
                        round(r["power"], 1),
                        round(r["peak_force"], 0),
                    ]
                )
                rows.append([_NAMES[road], v, controller, seed, *own])
    return Section(
        "Spread over identification seeds",
        [
            "A controller depends on the excitation it was identified with. So a claim is judged on the median of the"
            " seeds, and the tables above have the distributions. The paper had one identification: judged on each of"
            f" these alone, {min(found.by_sample)} to {max(found.by_sample)} of {found.published} claims hold in full."
            " In the table every controller has the published weight R = 1e-7: nothing is matched."
        ],
        [],
        [
            Table(
                "seeds",
                f"{R_TEXT}, {len(results.seeds)} identification seeds",
                [
                    "road",
                    "speed [km/h]",
                    "controller",
                    "seed",
                    "improvement [-]",
                    "force [N]",
                    "power [W]",
                    "peak force [N]",
                ],
                rows,
            )
        ],
    )


def _refinement(results: Results) -> Section:
    rows: list[list[float | str | None]] = []
    for r, words, moves in results.refinement():
        cells = [None if k not in moves or math.isnan(moves[k]) else float(f"{100 * moves[k]:.2g}") for k in METRICS]
        rows.append([_NAMES[r["road"]], r["speed_kmh"], r["controller"], words, *cells])
    return Section(
        "Refinement of steps",
        [
            "The car is integrated at 0.5 ms by a predictor-corrector method of Adams, Bashforth and Moulton and"
            " exchanges with road and controller every 1 ms, as in the paper. The method restarts at every exchange,"
            " so what it does depends on how time is divided into steps: with the exchange halved at"
            " the same solver step every step is a first one, and results move a little more than with"
            " both halved. A claim whose figure could be"
            " moved across the edge of its band by the largest number of this table would be open."
        ],
        [],
        [
            Table(
                "refinement",
                "Change of metrics when steps are halved",
                ["road", "speed [km/h]", "controller", "refinement", *(f"{_METRIC_NAMES[k]} [%]" for k in METRICS)],
                rows,
                f"{R_TEXT}, seed {results.seeds[0]}; the controllers stay those identified with the steps of the"
                " study.",
            )
        ],
    )


_METRIC_NAMES = {
    "response": "response",
    "force": "force",
    "power": "power",
    "peak_force": "peak force",
    "rms_az": "r.m.s. acceleration",
    "rms_pitch": "r.m.s. pitch",
}


def _limits(_: Results) -> Section:
    return Section(
        "Differences from the paper",
        [
            (
                "The paper's vehicle is a TruckSim model with measured tire tables, suspension compliances, nonlinear"
                " kinematics and a powertrain; the stand-in has the published masses, springs and dampers, public or"
                " assumed values for the rest (see the parameters), vertical wheel travel with stops, and a tire with"
                " slip lags."
            ),
            (
                "The identification excitation is not given in the paper and decides how well the implicit controller"
                " does: 2 kN per actuator, white up to the Nyquist frequency, is assumed."
            ),
            (
                "Explicit leaves the future road out of its optimization, as published, which amounts to height 0"
                " ahead. Run `cosim run gpc --road curb --controller explicit --hold` to see what holding the last"
                " height changes."
            ),
        ],
    )


# ---------------------------------------------------------------------- what went in


def _parameters(fmus: FmuSet) -> list[Parameter]:
    rows = parameters(fmus.path(PLANT))
    paper = "000 Table 2"
    i, d = IdentificationSettings(), DesignSettings()
    return [
        *rows,
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


def _provenance(fmus: FmuSet, study: Study) -> dict[str, object]:
    return provenance(EXPERIMENT, fmus) | {
        "identification": IdentificationSettings().told(),
        "identification seeds": list(study.seeds),
        "roads": list(ROADS.values()),
        "corners": list(CORNERS),
    }
