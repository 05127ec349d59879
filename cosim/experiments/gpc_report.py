"""Claims and figures of paper 000 as a report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from cosim.experiments import gpc_claims
from cosim.experiments import gpc_study as gs
from cosim.experiments.gpc import CONTROLLERS, R_PUBLISHED, ROADS, SPEEDS_KMH, TRAVEL, GpcFmuSet
from cosim.experiments.gpc_study import SEEDS, Row, Study, one, select
from cosim.experiments.provenance import provenance
from cosim.report import Figure, Panel, Parameter, Report, Result, Section, Series, Table, write_report
from fmu_sources.controllers.gpc import CORNERS, FORCE_LIMIT
from fmu_sources.controllers.gpc_identification import DesignSettings, IdentificationSettings

NAN = float("nan")
_ROAD_FIGURES = {"sine": ("7", "8"), "perryman3": ("9", "10"), "curb": ("11", "12")}
_TITLES = {"sine": "Sine road", "perryman3": "Perryman 3 road (synthetic)", "curb": "Curb"}
_LOOKS = {
    "passive": ("grey", "solid"),
    "implicit": ("orange", "dot"),
    "explicit": ("blue", "dash"),
    "preview": ("green", "solid"),
}
_SPEED = "speed [km/h]"


def write(study: Study, fmus: GpcFmuSet, directory: Path) -> Path:
    """Write report.html, summary.json and CSV files; returns the path of the page."""
    return write_report(report(study, fmus), directory)


def report(study: Study, fmus: GpcFmuSet) -> Report:
    """The whole report of a study."""
    found = gpc_claims.claims(study)
    medians = gs.seed_medians(study)
    return Report(
        experiment="gpc",
        title="Full car under generalized predictive control",
        lead=(
            f"A nonlinear HMMWV ({fmus.plant}) crosses three roads at {len(SPEEDS_KMH)} speeds, passive and under three GPC "
            "laws. Car, roads and controllers are native FMUs; the co-simulation master exchanges at 1 kHz, the laws act at "
            "100 Hz. Figures and claims of Brown, Murugan and Mazza stand beside what these runs give."
        ),
        claims=found,
        results=[
            Result("runs", len(study.rows)),
            Result("open-loop peak on sine", medians["open_loop_peak_kmh"], "km/h"),
            Result("improvement, explicit, sine 50 km/h", round(medians["sine_improvement_explicit"], 3)),
            Result("improvement, preview, sine 50 km/h", round(medians["sine_improvement_preview"], 3)),
        ],
        sections=[_weights(study), *(_road(study, road) for road in _ROAD_FIGURES), _seeds(study), _limits()],
        parameters=_parameters(fmus),
        provenance=_provenance(fmus),
    )


# ---------------------------------------------------------------------- figures


_QUANTITIES = (
    ("response", "Response objective (22a)", "J (g, deg) [-]"),
    ("improvement", "Response improvement (23)", "improvement [-]"),
    ("force", "Actuator force (22b)", "force [kN]"),
    ("power", "Actuator power (22c)", "power [W]"),
    ("per_force", "Force-normalised effectiveness (24a)", "improvement per force [1/kN]"),
    ("per_power", "Power-normalised effectiveness (24b)", "improvement per power [1/kW]"),
)


def _title(road: str) -> str:
    return _TITLES[road][0].lower() + _TITLES[road][1:] if road != "perryman3" else _TITLES[road]


def _series(name: str, x: Sequence[float], y: Sequence[float], mode: str) -> Series:
    color, dash = _LOOKS.get(name, (None, None))
    return Series(name, x, y, color=color, dash=dash, mode=mode)  # type: ignore[arg-type]


def _curves(study: Study, key: str, groups: Sequence[tuple[str, list[Row]]]) -> list[Series]:
    curves = []
    for name, rows in groups:
        by_speed = sorted(rows, key=lambda r: r["speed_kmh"])
        y = [gs.figure_metrics(study, r)[key] for r in by_speed]
        if any(math.isfinite(v) for v in y):
            curves.append(_series(name, [r["speed_kmh"] for r in by_speed], y, "line+markers"))
    return curves


def _weights(study: Study) -> Section:
    weights = sorted({r["R"] for r in study.sweep})
    groups = [(f"R = {w:g}", select(study.sweep, R=w)) for w in weights]
    passive = ("passive", select(study.comparison, road="sine", controller="passive"))
    panels = [
        Panel(title, _SPEED, label, _curves(study, key, [passive, *groups] if key == "response" else groups))
        for key, title, label in _QUANTITIES
    ]
    figure = Figure(
        "figure-6",
        "Control weight, GPC with preview on the sine road (figure 6 of the paper)",
        "Each point is one run over 150 m. An order of magnitude in R buys response and costs force and power.",
        panels,
        columns=2,
    )
    return Section(
        "Effect of the control weight",
        [
            "The preview law is designed anew for every weight R from the same identified model; only gain parameters of the "
            "controller FMU change."
        ],
        [figure],
    )


def _road(study: Study, road: str) -> Section:
    number, history_number = _ROAD_FIGURES[road]
    rows = select(study.comparison, road=road)
    groups = [(c, select(rows, controller=c)) for c in CONTROLLERS]
    panels = []
    for key, title, label in _QUANTITIES:
        use = groups if key == "response" else groups[1:]
        use = [
            (n, [r for r in rs if n == "passive" or r.get("matched", True)])
            if key in ("force", "power", "per_force", "per_power")
            else (n, rs)
            for n, rs in use
        ]
        panels.append(Panel(title, _SPEED, label, _curves(study, key, use)))
    comparison = Figure(
        f"figure-{number}",
        f"The three laws on the {_title(road)} (figure {number} of the paper)",
        "R = 1e-7 for explicit; at each speed the weights of implicit and preview are chosen so that their response objective "
        "equals explicit's. Where no weight does, the closest one is shown in the upper panels and left out of the others.",
        panels,
        columns=2,
    )
    histories = select(study.histories, road=road)
    signals = (
        ("az", "Vertical acceleration", "body.az [m/s2]"),
        ("pitch", "Pitch, nose down", "pitch [deg]"),
        ("roll", "Roll, left side up", "roll [deg]"),
        ("force", "Actuator force, front left", "force.fl [kN]"),
    )
    speed = histories[0]["speed_kmh"]
    history = Figure(
        f"figure-{history_number}",
        f"Time histories on the {_title(road)} at {speed:g} km/h (figure {history_number} of the paper)",
        "Weights: "
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
    table = Table(
        f"comparison-{road}",
        f"Runs on the {_title(road)}",
        [
            "speed [km/h]",
            "law",
            "R [1/N2]",
            "matched",
            "J [-]",
            "improvement [-]",
            "force [N]",
            "power [W]",
            "peak force [N]",
        ],
        [
            [
                r["speed_kmh"],
                r["controller"],
                None if r["controller"] == "passive" else float(f"{r['R']:.3g}"),
                _matched(r),
                *_table_cells(study, r),
            ]
            for r in sorted(rows, key=lambda r: (r["speed_kmh"], list(CONTROLLERS).index(r["controller"])))
        ],
    )
    text = {
        "sine": "Half-amplitude 0.10 m, wavelength 10 m, after 30 m of flat road.",
        "curb": "A step of 0.10 m up after 30 m, 10 m long, and down again. The explicit law ignores the road ahead (height 0).",
        "perryman3": "The measured course is not public. This road is synthetic: it has the published character (neither linear, "
        "Gaussian nor stationary, large peaks between 0.5 and 3 Hz at 40 km/h), not the published profile.",
    }[road]
    return Section(_TITLES[road], [text], [comparison, history], [table])


def _matched(r: Row) -> str | None:
    return None if "matched" not in r else "yes" if r["matched"] else "not found"


def _table_cells(study: Study, r: Row) -> list[float | str | None]:
    if r["diverged"]:
        return ["diverged", None, None, None, None]
    m = gs.figure_metrics(study, r)
    return [
        round(r["response"], 4),
        round(m["improvement"], 4),
        round(r["force"], 1),
        round(r["power"], 1),
        round(r["peak_force"], 0),
    ]


def _seeds(study: Study) -> Section:
    rows = []
    for r in study.seeds:
        rows.append(
            [
                r["road"],
                r["speed_kmh"],
                r["controller"],
                r["seed"],
                None if r["diverged"] else round(r["improvement"], 4),
                r.get("force") and round(r["force"], 1),
                r.get("peak_force") and round(r["peak_force"], 0),
            ]
        )
    power = [
        [
            s,
            (one(study.power, seed=s, controller="implicit")["matched"] and "yes") or "not found",
            float(f"{one(study.power, seed=s, controller='implicit')['R']:.3g}"),
            round(
                one(study.power, seed=s, controller="implicit")["power"]
                / one(study.power, seed=s, controller="explicit")["power"],
                3,
            ),
        ]
        for s in SEEDS
    ]
    return Section(
        "Spread over identification seeds",
        [
            "A law depends on the excitation it was identified with. Claims that depend on R = 1e-7 are judged by the median over "
            "eight seeds of the excitation."
        ],
        [],
        [
            Table(
                "seeds",
                "R = 1e-7, eight identification seeds",
                ["road", "speed [km/h]", "law", "seed", "improvement [-]", "force [N]", "peak force [N]"],
                rows,
            ),
            Table(
                "power-60",
                "Implicit matched to explicit on the sine road at 60 km/h",
                ["seed", "matched", "R of implicit [1/N2]", "power ratio [-]"],
                power,
            ),
        ],
    )


def _limits() -> Section:
    return Section(
        "What differs from the paper",
        [
            "The paper's vehicle is a TruckSim model with measured tyre tables, suspension compliances, nonlinear kinematics and a "
            "powertrain; the stand-in has the published masses, springs and dampers, public or assumed values for the rest (see the "
            "parameters), vertical wheel travel with stops, and a tyre with slip lags.",
            "The identification excitation is not given in the paper and decides how well the implicit law does: 2 kN per actuator, "
            "white up to the Nyquist frequency, is assumed.",
            "Explicit leaves the future road out of its optimization, as published, which amounts to height 0 ahead. Run "
            "`cosim run gpc --road curb --controller explicit --hold` to see what holding the last height changes.",
        ],
    )


# ---------------------------------------------------------------------- what went in


def _parameters(fmus: GpcFmuSet) -> list[Parameter]:
    from fmu_sources.plants import full_car
    from fmu_sources.vehicles import load_full_car

    car = full_car(load_full_car(fmus.vehicle), name=fmus.plant)
    rows = [
        Parameter(e.name, e.start, e.variable.unit or "-", e.variable.source or "assumed")
        for e in car.elements("parameter")
    ]
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


def _provenance(fmus: GpcFmuSet) -> dict[str, object]:
    return provenance(fmus, fmus.all_paths(), ["cffi"]) | {
        "identification": asdict(IdentificationSettings()),
        "identification seeds": list(SEEDS),
        "roads": list(ROADS.values()),
        "corners": list(CORNERS),
    }
