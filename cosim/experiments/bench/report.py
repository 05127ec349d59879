"""Tables and figures of paper 002 as a report."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from cosim.experiments.bench import EXPERIMENT
from cosim.experiments.bench.claims import CLAIMS, NAMES, over_passive, ratio
from cosim.experiments.bench.published import (
    BUMP_DURATIONS,
    CONTROLLED,
    HEIGHTS_MM,
    LIMITED,
    LONG,
    RANDOM,
    SCENARIOS,
    SHORT,
    STRETCHES,
    at,
    over_height,
    over_stretches,
)
from cosim.experiments.bench.runs import BUMP_HEIGHT_MM, CONTROLLERS, LENGTH, METRICS
from cosim.experiments.steps import HALVED, halved
from cosim.report import Figure, Panel, Parameter, Report, Section, Series, Table
from cosim.report.model import Scalar
from cosim.study import FmuSet, Results, Row, make_lead, parameters, provenance, sections
from cosim.study.pages import compared
from fmu_sources.controllers.lq.bench import FORCE_WEIGHT, LQR_PERIOD, WEIGHTS
from fmu_sources.controllers.mpc.bench import FORCE_LIMIT, HORIZON, MPC_PERIOD
from fmu_sources.models.bench_states import STATES

_FIRST = SCENARIOS[RANDOM].offset
_RANDOM_IS = (
    f"Random: {_FIRST:g} to {_FIRST + LENGTH['random']:g} s of the random motion, the first of its {len(STRETCHES)}"
    " stretches."
)
_LOOKS = {"passive": "gray", "lqr": "orange", "lqr-clipped": "sky", "mpc": "green", "mpc-moves": "purple"}


def report(study: Results, fmus: FmuSet) -> Report:
    """The whole report of a study."""
    makers = (_plates, _forces, _random, _comparison, _limit, _encoders, _solver, _refinement)
    lead, figure = make_lead(study, _main_result)
    about = Section(
        "Runs of the study",
        [
            f"A laboratory quarter car crosses bumps of {BUMP_HEIGHT_MM:g} mm and random motion of its road plate:"
            f" passive, under an LQR, and under model predictive control that keeps the force within {FORCE_LIMIT:g} N."
            " All components are native FMUs. Figures 6 to 10 of Das and Vinodh Kumar stand beside what these runs"
            " give. The paper prints neither the bench's parameters nor weights and horizons: they are assumed, as the"
            " table at the end says."
        ],
    )
    return Report(
        experiment=EXPERIMENT.name,
        title="LQR and MPC on a quarter-car bench",
        lead=lead,
        figure=figure,
        claims=CLAIMS.judge(study),
        sections=[about, *sections(study, makers)],
        parameters=_parameters(fmus),
        provenance=provenance(EXPERIMENT, fmus),
    )


def _main_result(study: Results) -> tuple[str, Figure]:
    """Acceleration of the body, and the force that it takes."""
    name, heading = "acceleration", METRICS["acceleration"].heading
    passive, lqr, mpc = (study[at(LONG, c)] for c in ("passive", "lqr", "mpc"))
    lead = (
        f"Over a bump of {BUMP_HEIGHT_MM:g} mm in {SCENARIOS[LONG].duration:g} s, the rms acceleration of the body is"
        f" {lqr[name]:.3g} m/s2 with the LQR (force up to {_peak(lqr):.3g} N) and {mpc[name]:.3g} m/s2 with the MPC"
        f" (up to {_peak(mpc):.3g} N): {compared(lqr[name], passive[name])} and"
        f" {compared(mpc[name], passive[name])} than the {passive[name]:.3g} m/s2 of the passive bench."
    )
    bars = [
        Series(
            NAMES[c],
            range(len(SCENARIOS)),
            [study[at(s, c)][name] for s in SCENARIOS],
            color=_LOOKS[c],  # type: ignore[arg-type]
            mode="bar",
        )
        for c in CONTROLLERS
    ]
    panel = Panel("", "road [?]", heading, bars, x_names=list(SCENARIOS))
    return lead, Figure("main-result", "Acceleration of the body by road and system", _RANDOM_IS, [panel])


def _positions(signals: Row) -> list[Series]:
    def curve(name: str, **look: Any) -> Series:
        return Series(name, signals["time"], 1e3 * np.array(signals[name]), **look)

    return [curve("road", color="black", dash="dot"), curve("wheel", color="vermilion"), curve("body", color="blue")]


def _plates(study: Results) -> Section:
    figures = []
    for number, system in ((6, "passive"), (7, "lqr"), (8, "mpc")):
        panels = [Panel(s, "time [s]", "height [mm]", _positions(study.signals(at(s, system)))) for s in (LONG, SHORT)]
        figures.append(
            Figure(
                f"figure-{number}",
                f"Plates over the bump, {NAMES[system]} (figure {number} of the paper)",
                "Heights from rest.",
                panels,
                columns=2,
            )
        )
    return Section("Plates over the bump", [], figures)


def _forces(study: Results) -> Section:
    panels = []
    for s in (LONG, SHORT):
        n = 1501
        curves = []
        for system in ("lqr", "mpc", "mpc-moves"):
            r = study.signals(at(s, system))
            curves.append(Series(NAMES[system], r["time"][:n], r["force"][:n], color=_LOOKS[system]))  # type: ignore[arg-type]
        panels.append(Panel(s, "time [s]", "force [N]", curves))
    energy = ratio(study, LONG, "force", "mpc-moves", "lqr")
    return Section(
        "Actuator force",
        [
            (
                f"The LQR requests a little more than {FORCE_LIMIT:g} N, the MPC never. The rms of the MPC's force is"
                f" {100 * ratio(study, LONG, 'force', 'mpc', 'lqr'):.0f} % of the LQR's over the longer bump, with the"
                f" weight on the moves {100 * energy:.0f} %."
            ),
        ],
        [
            Figure(
                "figure-9", "Actuator force, LQR and MPC (figure 9 of the paper)", "Bumps of 20 mm.", panels, columns=2
            )
        ],
    )


def _random(study: Results) -> Section:
    panels = [
        Panel(NAMES[s], "time [s]", "height [mm]", _positions(study.signals(at(RANDOM, s)))) for s in ("passive", "mpc")
    ]
    shares = {k: over_passive(study, k) for k in METRICS if min(study[c][k] for c in over_stretches("passive")) > 0}
    table = Table(
        "random-stretches",
        f"MPC over passive on {len(STRETCHES)} stretches of the random road",
        ["quantity", "median [-]", "lowest [-]", "highest [-]"],
        [[METRICS[k].text, d.median, d.low, d.high] for k, d in shares.items()],
        f"Each {LENGTH['random']:g} s long.",
    )
    figure = Figure(
        "figure-10",
        "Plates on the random road (figure 10 of the paper)",
        f"The paper shows the MPC alone. {_RANDOM_IS}",
        panels,
        columns=1,
    )
    return Section("Random road", [], [figure], [table])


def _comparison(study: Results) -> Section:
    rows: list[list[Scalar]] = [
        [
            scenario,
            NAMES[system],
            *(round(m.factor * study[at(scenario, system)][k], 3) for k, m in METRICS.items()),
        ]
        for scenario in SCENARIOS
        for system in CONTROLLERS
    ]
    table = Table(
        "comparison",
        "All systems on all roads",
        ["road", "system", *(m.heading for m in METRICS.values())],
        rows,
        _RANDOM_IS,
    )
    return Section(
        "Comparison",
        [
            (
                "The LQR minimizes an index of states and force without end and without limit; the MPC minimizes the"
                f" same index over {HORIZON * MPC_PERIOD:g} s with the limit. Where the limit does not act both are the"
                f" same controller but for the sample time ({1e3 * LQR_PERIOD:g} and {1e3 * MPC_PERIOD:g} ms)."
                " Equation (16) of the paper weighs the changes of the force instead: that is another"
                " index, with less acceleration and more force."
            ),
        ],
        [],
        [table],
    )


def _limit(study: Results) -> Section:
    panels = []
    for duration in BUMP_DURATIONS:
        curves = [
            Series(
                NAMES[s],
                HEIGHTS_MM,
                [study[c]["acceleration"] for c in over_height(duration, s)],
                color=_LOOKS[s],  # type: ignore[arg-type]
                mode="line+markers",
            )
            for s in LIMITED
        ]
        panels.append(Panel(f"bump {duration:g} s", "height of the bump [mm]", "rms acceleration [m/s2]", curves))
    return Section(
        "The limit at work",
        [
            "Higher bumps keep the force at its limit for longer. The figure shows the benefit of the MPC over"
            " clipping the LQR."
        ],
        [Figure("limit", "Acceleration over the height of the bump", "Force within 8 N.", panels, columns=2)],
    )


def _encoders(study: Results) -> Section:
    rows: list[list[Scalar]] = []
    for scenario, system in product(SCENARIOS, CONTROLLED):
        m, base = study[at(scenario, system, encoders=True)], study[at(scenario, system)]
        rows.append(
            [
                scenario,
                NAMES[system],
                round(base["acceleration"], 3),
                round(m["acceleration"], 3),
                round(100 * (m["acceleration"] / base["acceleration"] - 1), 1),
                round(m["force.max"], 3),
                round(m["force.min"], 3),
            ]
        )
    table = Table(
        "encoders",
        "States from encoders",
        [
            "road",
            "system",
            "exact states [m/s2]",
            "encoders [m/s2]",
            "change [%]",
            "largest force [N]",
            "smallest force [N]",
        ],
        rows,
        _RANDOM_IS,
    )
    return Section(
        "Encoders",
        [
            "The bench measures three positions; velocities are filtered differences. rms acceleration of the body with"
            " exact and with measured states."
        ],
        [],
        [table],
    )


def _solver(study: Results) -> Section:
    rows: list[list[Scalar]] = [
        [s, NAMES[c], int(v["solver.status"]), int(v["solver.iterations"]), f"{v['solver.residual']:.1e}"]
        for s, c in product(SCENARIOS, CONTROLLERS)
        if "solver.status" in (v := study[at(s, c)])
    ]
    table = Table(
        "solver",
        "Quadratic programs, worst of each run",
        ["road", "system", "status [-]", "iterations [-]", "residual [-]"],
        rows,
        _RANDOM_IS,
    )
    return Section(
        "Solver",
        ["Status 0 is solved; residual as defined for all MPC FMUs. Times per back end are in benchmarks."],
        [],
        [table],
    )


def _refinement(study: Results) -> Section:
    base = {c: study[at(SHORT, c)] for c in CONTROLLERS}
    rows: list[list[Scalar]] = [
        ["as in the runs", NAMES[s], base[s]["acceleration"], _peak(base[s]), 0.0] for s in CONTROLLERS
    ]
    for what in HALVED:
        for c in CONTROLLERS:
            finer = study[halved(at(SHORT, c))[what]]
            change = 100 * (finer["acceleration"] / base[c]["acceleration"] - 1)
            rows.append([f"{what} halved", NAMES[c], finer["acceleration"], _peak(finer), change])
    table = Table(
        "refinement",
        f"Results with finer steps, {SHORT}",
        ["steps", "system", "rms acceleration [m/s2]", "peak force [N]", "change of the acceleration [%]"],
        rows,
        "Solver step and communication step of the plant; controllers and road keep their sample times.",
    )
    return Section("Steps", ["Whether the results depend on the steps."], [], [table])


def _peak(metrics: Row) -> float:
    return max(metrics["force.max"], -metrics["force.min"])


def _parameters(fmus: FmuSet) -> list[Parameter]:
    rows = parameters(fmus.path("QuarterCarBench"))
    assumed = "documentation of the bench's maker, assumed for 002"
    rows += [Parameter(f"weight of {s}", w, "1/SI2", assumed) for s, w in zip(STATES, WEIGHTS, strict=True)]
    rows += [
        Parameter("weight of the force, or of its moves", FORCE_WEIGHT, "1/N2", assumed),
        Parameter("force limit", FORCE_LIMIT, "N", "002 section V"),
        Parameter("sample time, LQR", LQR_PERIOD, "s", "assumed"),
        Parameter("sample time, MPC", MPC_PERIOD, "s", "assumed"),
        Parameter("prediction and control horizon", HORIZON, "-", "assumed"),
        Parameter("height of the bump", BUMP_HEIGHT_MM, "mm", "002 section V"),
    ]
    return rows
