"""Claims, tables and figures of paper 002 as a report."""

from __future__ import annotations

from pathlib import Path

from cosim import Recording
from cosim.experiments.bench import BUMP_HEIGHT, LENGTH, SYSTEMS, UNITS, force
from cosim.experiments.bench_study import HEIGHTS, LIMITED, SCENARIOS, STRETCHES, Study, ratio
from cosim.experiments.cases import FmuSet
from cosim.experiments.provenance import provenance
from cosim.report import (
    Band,
    Claims,
    Distribution,
    Figure,
    Panel,
    Parameter,
    Report,
    Result,
    Section,
    Series,
    Table,
    write_report,
)
from cosim.report.model import Scalar
from fmu_sources.controllers.bench import (
    FORCE_LIMIT,
    FORCE_WEIGHT,
    HORIZON,
    LQR_PERIOD,
    MPC_PERIOD,
    STATES,
    WEIGHTS,
)
from fmu_sources.plants import quarter_car
from fmu_sources.vehicles import load_quarter_car

_LOOKS = {"passive": "grey", "lqr": "orange", "lqr-clipped": "sky", "mpc": "green", "mpc-moves": "purple"}
_NAMES = {
    "passive": "passive",
    "lqr": "LQR",
    "lqr-clipped": "LQR, clipped to 8 N",
    "mpc": "MPC, weight on the force",
    "mpc-moves": "MPC, weight on the moves",
}
FMUS = (
    "QuarterCarBench", "LqrBench", "MpcBench", "MpcBenchMoves", "BenchEncoders", "RoadBenchBump", "RoadBenchRandom",
)  # fmt: skip
_SLIGHTLY = (2.0, 15.0)  # %, how far beyond the limit is "slightly"
_CONSIDERABLY = 0.5  # of passive: what is left after a considerable reduction
_FIRMLY = 0.1  # by which the tire is deflected less
_SUPERIOR = 0.10  # "far superior" takes at least this much in each respect
_SAME = 0.01  # equal within
_COMPARED = ("acceleration", "overshoot", "travel", "tire")
_SHORT, _LONG, _RANDOM = "bump 0.2 s", "bump 0.5 s", "random"


def write(study: Study, fmus: FmuSet, directory: Path) -> Path:
    """Write report.html, summary.json and CSV files; returns the path of the page."""
    return write_report(report(study, fmus), directory)


def report(study: Study, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    a = {s: study.metrics[_LONG, s]["acceleration"] for s in SYSTEMS}
    return Report(
        experiment="bench",
        title="LQR and MPC on a quarter-car bench",
        lead=(
            f"A laboratory quarter car crosses bumps of {1e3 * BUMP_HEIGHT:g} mm and random motion of its road plate: passive, under "
            f"an LQR, and under model predictive control that keeps the force within {FORCE_LIMIT:g} N. All components are native "
            "FMUs. Figures 6 to 10 of Das and Vinodh Kumar stand beside what these runs give. The paper prints neither the bench's "
            "parameters nor weights and horizons: they are assumed, as the table at the end says."
        ),
        claims=claims(study),
        results=[
            Result(f"rms acceleration, {_LONG}, {_NAMES[s]}", round(a[s], 3), "m/s2") for s in SYSTEMS
        ],
        sections=[_plates(study), _forces(study), _random(study), _comparison(study), _limit(study), _encoders(study),
                  _solver(study), _refinement(study)],
        parameters=_parameters(),
        provenance=provenance(fmus, fmus.paths(FMUS), ["osqp"]),
    )  # fmt: skip


# ---------------------------------------------------------------------- claims


def _halved(share: float) -> bool:
    return share <= _CONSIDERABLY


def _firmer(share: float) -> bool:
    return share <= 1 - _FIRMLY


def claims(study: Study) -> Claims:
    """What the paper says of the controllers, judged by these runs."""
    result = Claims()
    m = study.metrics

    claim = result.judge

    runs = [v for (_, s), v in (*m.items(), *study.encoders.items()) if s.startswith("mpc")]
    runs += [v for (_, s), rows in study.heights.items() if s.startswith("mpc") for v in rows]
    worst = max(max(abs(v["force.max"]), abs(v["force.min"])) for v in runs)
    claim(
        "force-limit", f"The MPC keeps the force within {FORCE_LIMIT:g} N",
        f"within {FORCE_LIMIT:g} N", f"at most {worst:.6g} N in {len(runs)} runs", worst <= FORCE_LIMIT,
        "the force exceeds its bound", "Section V, Figure 9", criterion="in every run",
    )  # fmt: skip
    peak = {s: max(m[s, "lqr"]["force.max"], -m[s, "lqr"]["force.min"]) for s in (_LONG, _SHORT)}
    excess = 100 * (max(peak.values()) / FORCE_LIMIT - 1)
    claim(
        "lqr-force", f"The LQR goes slightly beyond {FORCE_LIMIT:g} N over the bump",
        f"slightly beyond {FORCE_LIMIT:g} N", f"{peak[_LONG]:.2f} N (0.5 s), {peak[_SHORT]:.2f} N (0.2 s)",
        min(peak.values()) > FORCE_LIMIT,
        "over the shorter bump it goes further; how long the paper's bump lasts is not in print",
        "Section V, Figure 9", excess, "%", band=Band(*_SLIGHTLY, "slightly"),
        criterion="beyond the limit over both bumps; magnitude: the larger excess",
    )  # fmt: skip
    for system, figure in (("lqr", "Figures 6, 7"), ("mpc", "Figures 6, 8")):
        gains = [ratio(study, s, "acceleration", system, "passive") for s in (_LONG, _SHORT)]
        over = [ratio(study, s, "overshoot", system, "passive") for s in (_LONG, _SHORT)]
        claim(
            f"bump-{system}", f"The {_NAMES[system].split(',')[0]} reduces vibration and overshoot over the bump considerably",
            "vibration and overshoot considerably less than in open loop",
            f"rms acceleration {m[_LONG, 'passive']['acceleration']:.2f} to {m[_LONG, system]['acceleration']:.2f} m/s2 (0.5 s), "
            f"{m[_SHORT, 'passive']['acceleration']:.2f} to {m[_SHORT, system]['acceleration']:.2f} m/s2 (0.2 s); overshoot to "
            f"{100 * over[0]:.0f} % and {100 * over[1]:.0f} %",
            max(*gains, *over) <= _CONSIDERABLY, "not halved", figure,
            criterion="considerably: rms acceleration and overshoot at least halved over both bumps",
        )  # fmt: skip
    shares = {(s, k): ratio(study, s, k, "mpc", "lqr") for s in SCENARIOS for k in _COMPARED if m[s, "lqr"][k] > 1e-6}
    moves = [ratio(study, s, "acceleration", "mpc-moves", "lqr") for s in SCENARIOS]
    equal = [ratio(study, s, "acceleration", "mpc", "lqr-clipped") for s in (_LONG, _SHORT)]
    claim(
        "far-superior", "The MPC is far superior to the LQR in all aspects", "far superior",
        f"rms acceleration {100 * (min(v for (_, k), v in shares.items() if k == 'acceleration') - 1):+.1f} to "
        f"{100 * (max(v for (_, k), v in shares.items() if k == 'acceleration') - 1):+.1f} % of the LQR's",
        all(v <= 1 - _SUPERIOR for v in shares.values()),
        f"with the same index, the MPC does what an LQR clipped to {FORCE_LIMIT:g} N does: rms acceleration within "
        f"{100 * max(abs(e - 1) for e in equal):.1f} % over the bumps. Weighting the moves instead of the force, as equation (16) is "
        f"written, gives {100 * (min(moves) - 1):+.0f} to {100 * (max(moves) - 1):+.0f} % of the LQR's acceleration, by another index",
        "Conclusion",
        criterion=f"acceleration, overshoot, travel and tire deflection all at least {100 * _SUPERIOR:g} % lower on every road",
    )  # fmt: skip
    claim(
        "active-constraint", "The MPC improves on the LQR where the constraint is active",
        "an improvement where the constraint is active",
        f"{100 * (equal[0] - 1):+.1f} % (0.5 s), {100 * (equal[1] - 1):+.1f} % (0.2 s) against the clipped LQR",
        max(equal) <= 1 - _SAME,
        f"within {100 * _SAME:.0f} % of an LQR that is simply clipped, for bumps of {1e3 * BUMP_HEIGHT:g} mm", "Conclusion",
        criterion=f"rms acceleration more than {100 * _SAME:g} % below the clipped LQR's over both bumps",
    )  # fmt: skip

    def over_stretches(metric: str) -> Distribution:
        both = zip(study.stretches["mpc"], study.stretches["passive"], strict=True)
        return Distribution((a[metric] / b[metric] for a, b in both), of="stretches")

    body, beyond, tire = (over_stretches(k) for k in ("acceleration", "overshoot", "tire"))
    claim(
        "random-body", "On a random road the MPC removes overshoot and oscillation of the body",
        "no overshoot and oscillation",
        f"of passive: rms acceleration {body.text('{:.2f}', holds=_halved)}, overshoot {beyond.text('{:.2f}', holds=_halved)}",
        body.clearly(_halved) and beyond.clearly(_halved),
        "not halved on most stretches", "Figure 10",
        criterion="at least halved, as over the bumps; clearly so over the stretches of road (sign test at 5 %)",
    )  # fmt: skip
    claim(
        "random-wheel", "On a random road the wheel follows the road firmly under the MPC", "the wheel firmly follows the road",
        f"rms tire deflection of passive: {tire.text('{:.2f}', holds=_firmer)}", tire.clearly(_firmer),
        "the tire is deflected about as much as on the passive bench, or more", "Figure 10",
        criterion=f"tire deflection at least {100 * _FIRMLY:g} % below passive; clearly so over the stretches of road",
    )  # fmt: skip
    failed = sum(v["status"] > 0 for v in study.solver.values())
    residual = max(v["residual"] for v in study.solver.values())
    result.check(
        "solver", "The quadratic program is solved at every step, to 1e-6", "status 0, residual of 1e-6 at most",
        f"{failed} of {len(study.solver)} runs with an unsolved step, largest residual {residual:.1e}",
        not failed and residual <= 1e-6, "a step was not solved", "own", criterion="every step of every run",
    )  # fmt: skip
    return result


# ---------------------------------------------------------------------- sections


def _series(study: Study, scenario: str, system: str, variable: str, scale: float) -> Series:
    r = study.histories[scenario, system]
    return Series(_NAMES[system], r.time, scale * r[variable], color=_LOOKS[system])  # type: ignore[arg-type]


def _positions(r: Recording, until: float) -> list[Series]:
    n = round(until * 1000) + 1
    return [
        Series("road", r.time[:n], 1e3 * r["road.road.height"][:n], color="black", dash="dot"),
        Series("wheel", r.time[:n], 1e3 * r["plant.wheel.z"][:n], color="vermilion"),
        Series("body", r.time[:n], 1e3 * r["plant.body.z"][:n], color="blue"),
    ]


def _plates(study: Study) -> Section:
    figures = []
    for number, system in ((6, "passive"), (7, "lqr"), (8, "mpc")):
        panels = [
            Panel(s, "time [s]", "height [mm]", _positions(study.histories[s, system], 3.0)) for s in (_LONG, _SHORT)
        ]
        figures.append(
            Figure(
                f"figure-{number}", f"Plates over the bump, {_NAMES[system]} (figure {number} of the paper)",
                "Heights from rest.", panels, columns=2,
            )
        )  # fmt: skip
    return Section("Plates over the bump", [], figures)


def _forces(study: Study) -> Section:
    panels = []
    for s in (_LONG, _SHORT):
        n = 1501
        curves = []
        for system in ("lqr", "mpc", "mpc-moves"):
            r = study.histories[s, system]
            curves.append(Series(_NAMES[system], r.time[:n], force(r)[:n], color=_LOOKS[system]))  # type: ignore[arg-type]
        panels.append(Panel(s, "time [s]", "force [N]", curves))
    energy = ratio(study, _LONG, "force", "mpc-moves", "lqr")
    return Section(
        "Actuator force",
        [
            f"The LQR asks for a little more than {FORCE_LIMIT:g} N, the MPC never. The rms of the MPC's force is "
            f"{100 * ratio(study, _LONG, 'force', 'mpc', 'lqr'):.0f} % of the LQR's over the longer bump, with the weight on the moves "
            f"{100 * energy:.0f} %.",
        ],
        [
            Figure(
                "figure-9", "Actuator force, LQR and MPC (figure 9 of the paper)", "Bumps of 20 mm.", panels, columns=2
            )
        ],
    )


def _random(study: Study) -> Section:
    panels = [
        Panel(_NAMES[s], "time [s]", "height [mm]", _positions(study.histories[_RANDOM, s], 10.0))
        for s in ("passive", "mpc")
    ]
    shares = {
        k: Distribution(a[k] / b[k] for a, b in zip(study.stretches["mpc"], study.stretches["passive"], strict=True))
        for k in UNITS
        if min(b[k] for b in study.stretches["passive"]) > 0
    }
    table = Table(
        "random-stretches",
        f"MPC over passive on {len(STRETCHES)} stretches of the random road",
        ["quantity", "median [-]", "lowest [-]", "highest [-]"],
        [[UNITS[k][0], d.median, d.low, d.high] for k, d in shares.items()],
        f"Each {LENGTH['random']:g} s long.",
    )
    figure = Figure(
        "figure-10",
        "Plates on the random road (figure 10 of the paper)",
        "The paper shows the MPC alone.",
        panels,
        columns=1,
    )
    return Section("Random road", [], [figure], [table])


def _comparison(study: Study) -> Section:
    rows: list[list[Scalar]] = [
        [
            scenario,
            _NAMES[system],
            *(round(factor * study.metrics[scenario, system][k], 3) for k, (_, _, factor) in UNITS.items()),
        ]
        for scenario in SCENARIOS
        for system in SYSTEMS
    ]
    table = Table(
        "comparison",
        "All systems on all roads",
        ["road", "system", *(f"{t} [{u}]" for t, u, _ in UNITS.values())],
        rows,
    )
    return Section(
        "Comparison",
        [
            "The LQR minimises an index of states and force without end and without limit; the MPC minimises the same index over "
            f"{HORIZON * MPC_PERIOD:g} s with the limit. Where the limit does not act both are the same law but for the sample time "
            f"({1e3 * LQR_PERIOD:g} and {1e3 * MPC_PERIOD:g} ms). Equation (16) of the paper weighs the changes of the force instead: "
            "that is another index, with less acceleration and more force.",
        ],
        [],
        [table],
    )


def _limit(study: Study) -> Section:
    panels = []
    for duration in sorted({d for d, _ in study.heights}, reverse=True):
        curves = [
            Series(
                _NAMES[s], [1e3 * h for h in HEIGHTS], [row["acceleration"] for row in study.heights[duration, s]],
                color=_LOOKS[s], mode="line+markers",  # type: ignore[arg-type]
            )
            for s in LIMITED
        ]  # fmt: skip
        panels.append(Panel(f"bump {duration:g} s", "height of the bump [mm]", "rms acceleration [m/s2]", curves))
    return Section(
        "The limit at work",
        ["Higher bumps keep the force at its limit for longer. What the MPC gains over clipping the LQR shows here."],
        [Figure("limit", "Acceleration over the height of the bump", "Force within 8 N.", panels, columns=2)],
    )


def _encoders(study: Study) -> Section:
    rows: list[list[Scalar]] = []
    for (scenario, system), m in study.encoders.items():
        base = study.metrics[scenario, system]
        rows.append([
            scenario, _NAMES[system], round(base["acceleration"], 3), round(m["acceleration"], 3),
            round(100 * (m["acceleration"] / base["acceleration"] - 1), 1), round(m["force.max"], 3), round(m["force.min"], 3),
        ])  # fmt: skip
    table = Table(
        "encoders", "States from encoders",
        ["road", "system", "exact states [m/s2]", "encoders [m/s2]", "change [%]", "largest force [N]", "smallest force [N]"],
        rows,
    )  # fmt: skip
    return Section(
        "Encoders",
        ["The bench measures three positions; velocities are filtered differences. rms acceleration of the body with exact and "
         "with measured states."],
        [], [table],
    )  # fmt: skip


def _solver(study: Study) -> Section:
    rows: list[list[Scalar]] = [
        [s, _NAMES[c], int(v["status"]), int(v["iterations"]), f"{v['residual']:.1e}"]
        for (s, c), v in study.solver.items()
    ]
    table = Table(
        "solver", "Quadratic programs, worst of each run",
        ["road", "system", "status [-]", "iterations [-]", "residual [-]"], rows,
    )  # fmt: skip
    return Section(
        "Solver",
        ["Status 0 is solved; residual as defined for all MPC FMUs. Times per back end are in benchmarks."],
        [],
        [table],
    )


def _refinement(study: Study) -> Section:
    base = {s: study.metrics[_SHORT, s] for s in SYSTEMS}
    rows: list[list[Scalar]] = [
        ["as in the runs", _NAMES[s], base[s]["acceleration"], _peak(base[s]), 0.0] for s in SYSTEMS
    ]
    for what, finer in study.refined.items():
        for s in SYSTEMS:
            change = 100 * (finer[s]["acceleration"] / base[s]["acceleration"] - 1)
            rows.append([f"{what} halved", _NAMES[s], finer[s]["acceleration"], _peak(finer[s]), change])
    table = Table(
        "refinement", f"Results with finer steps, {_SHORT}",
        ["steps", "system", "rms acceleration [m/s2]", "peak force [N]", "change of the acceleration [%]"], rows,
        "Solver step and exchange step of the plant; controllers and road keep their sample times.",
    )  # fmt: skip
    return Section("Steps", ["Whether the results depend on how time is cut."], [], [table])


def _peak(metrics: dict[str, float]) -> float:
    return max(metrics["force.max"], -metrics["force.min"])


def _parameters() -> list[Parameter]:
    car = quarter_car(load_quarter_car("quarter_car_bench"), name="QuarterCarBench")
    rows = [
        Parameter(e.name, e.start, e.variable.unit or "-", e.variable.source or "build option")
        for e in car.elements("parameter")
    ]
    assumed = "documentation of the bench's maker, assumed for 002"
    rows += [Parameter(f"weight of {s}", w, "1/SI2", assumed) for s, w in zip(STATES, WEIGHTS, strict=True)]
    rows += [
        Parameter("weight of the force, or of its moves", FORCE_WEIGHT, "1/N2", assumed),
        Parameter("force limit", FORCE_LIMIT, "N", "002 section V"),
        Parameter("sample time, LQR", LQR_PERIOD, "s", "assumed"),
        Parameter("sample time, MPC", MPC_PERIOD, "s", "assumed"),
        Parameter("prediction and control horizon", HORIZON, "-", "assumed"),
        Parameter("height of the bump", BUMP_HEIGHT, "m", "002 section V"),
    ]
    return rows
