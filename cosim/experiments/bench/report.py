"""Tables and figures of paper 002 as a report."""

from __future__ import annotations

from itertools import product

from cosim.experiments.bench import EXPERIMENT, published
from cosim.experiments.bench.claims import CLAIMS, NAMES, over_passive, peak_force, ratio
from cosim.experiments.bench.published import LONG, RANDOM, SCENARIOS, SHORT, STRETCHES, at
from cosim.experiments.bench.runs import BUMP_HEIGHT_MM, CONTROLLERS, LENGTH, METRICS, Case
from cosim.experiments.steps import with_finer_steps
from cosim.report import Figure, Panel, Parameter, Series, Table, bars, curve, over_time
from cosim.report.model import Look
from cosim.study import Content, FmuSet, Results, StudyReport, parameters
from cosim.study.pages import compared
from fmu_sources.controllers.lq.bench import FORCE_WEIGHT, LQR_PERIOD, WEIGHTS
from fmu_sources.controllers.mpc.bench import FORCE_LIMIT, HORIZON, MPC_PERIOD
from fmu_sources.models.bench_states import STATES

_FIRST = SCENARIOS[RANDOM].offset
_RANDOM_IS = (
    f"Random: {_FIRST:g} to {_FIRST + LENGTH['random']:g} s of the random motion, the first of its {len(STRETCHES)}"
    " stretches."
)


def _parameters(fmus: FmuSet) -> list[Parameter]:
    assumed = "documentation of the bench's maker, assumed for 002"
    return [
        *parameters(fmus.path("QuarterCarBench")),
        *(Parameter(f"weight of {s}", w, "1/SI2", assumed) for s, w in zip(STATES, WEIGHTS, strict=True)),
        Parameter("weight of the force, or of its moves", FORCE_WEIGHT, "1/N2", assumed),
        Parameter("force limit", FORCE_LIMIT, "N", "002 section V"),
        Parameter("sample time, LQR", LQR_PERIOD, "s", "assumed"),
        Parameter("sample time, MPC", MPC_PERIOD, "s", "assumed"),
        Parameter("prediction and control horizon", HORIZON, "-", "assumed"),
        Parameter("height of the bump", BUMP_HEIGHT_MM, "mm", "002 section V"),
    ]


_LOOKS: dict[str, Look] = {
    **dict(zip((NAMES[c] for c in CONTROLLERS), ("gray", "orange", "sky", "green", "purple"), strict=True)),
    "road": ("black", "dot"),
    "wheel": "vermilion",
    "body": "blue",
}
report = StudyReport(EXPERIMENT, "LQR and MPC on a quarter-car bench", CLAIMS, _parameters, _LOOKS)


@report.lead
def _main_result(study: Results) -> Content:
    passive, lqr, mpc = (study[at(LONG, c)] for c in ("passive", "lqr", "mpc"))
    base, with_lqr, with_mpc = (row["acceleration"] for row in (passive, lqr, mpc))
    yield f"""Over a bump of {BUMP_HEIGHT_MM:g} mm in {SCENARIOS[LONG].duration:g} s, the rms acceleration of the body
    is {with_lqr:.3g} m/s2 with the LQR (force up to {peak_force(lqr):.3g} N) and {with_mpc:.3g} m/s2 with the MPC (up
    to {peak_force(mpc):.3g} N): {compared(with_lqr, base)} and {compared(with_mpc, base)} than the {base:.3g} m/s2 of
    the passive bench."""
    heights = {NAMES[c]: [study[at(s, c)]["acceleration"] for s in SCENARIOS] for c in CONTROLLERS}
    panel = bars("road [?]", METRICS["acceleration"].heading, [*SCENARIOS], heights)
    yield Figure("main-result", "Acceleration of the body by road and system", _RANDOM_IS, [panel])


@report.section("Runs of the study")
def _about(_: Results) -> Content:
    yield f"""A laboratory quarter car crosses bumps of {BUMP_HEIGHT_MM:g} mm and random motion of its road plate:
    passive, under an LQR, and under model predictive control that keeps the force within {FORCE_LIMIT:g} N. All
    components are native FMUs. Figures 6 to 10 of Das and Vinodh Kumar stand beside what these runs give. The paper
    prints neither the bench's parameters nor weights and horizons: they are assumed, as the table at the end says."""


def _plate_heights(study: Results, case: Case, title: str) -> Panel:
    signals = study.signals(case)
    return Panel(title, "time [s]", "height [mm]", [curve(n, signals, n, 1e3) for n in ("road", "wheel", "body")])


@report.section("Plates over the bump")
def _plates(study: Results) -> Content:
    for number, system in ((6, "passive"), (7, "lqr"), (8, "mpc")):
        panels = [_plate_heights(study, at(s, system), s) for s in (LONG, SHORT)]
        title = f"Plates over the bump, {NAMES[system]} (figure {number} of the paper)"
        yield Figure(f"figure-{number}", title, "Heights from rest.", panels, columns=2)


@report.section("Actuator force")
def _forces(study: Results) -> Content:
    shares = [100 * ratio(study, LONG, "force", c, "lqr") for c in ("mpc", "mpc-moves")]
    yield f"""The LQR requests a little more than {FORCE_LIMIT:g} N, the MPC never. The rms of the MPC's force is
    {shares[0]:.0f} % of the LQR's over the longer bump, with the weight on the moves {shares[1]:.0f} %."""
    runs = {s: {NAMES[c]: study.signals(at(s, c)) for c in ("lqr", "mpc", "mpc-moves")} for s in (LONG, SHORT)}
    panels = [p for s, shown in runs.items() for p in over_time(shown, [(s, "force [N]", "force", 1.0)], end=1.5)]
    title = "Actuator force, LQR and MPC (figure 9 of the paper)"
    yield Figure("figure-9", title, "Bumps of 20 mm.", panels, columns=2)


@report.section("Random road")
def _random(study: Results) -> Content:
    panels = [_plate_heights(study, at(RANDOM, s), NAMES[s]) for s in ("passive", "mpc")]
    caption = f"The paper shows the MPC alone. {_RANDOM_IS}"
    yield Figure("figure-10", "Plates on the random road (figure 10 of the paper)", caption, panels)
    shares = {
        k: over_passive(study, k) for k in METRICS if min(study[c][k] for c in published.over_stretches("passive")) > 0
    }
    yield Table.of(
        "random-stretches",
        f"MPC over passive on {len(STRETCHES)} stretches of the random road",
        [
            {"quantity": METRICS[k].text, "median [-]": d.median, "lowest [-]": d.low, "highest [-]": d.high}
            for k, d in shares.items()
        ],
        f"Each {LENGTH['random']:g} s long.",
    )


@report.section("Comparison")
def _comparison(study: Results) -> Content:
    yield f"""The LQR minimizes an index of states and force without end and without limit; the MPC minimizes the same
    index over {HORIZON * MPC_PERIOD:g} s with the limit. Where the limit does not act both are the same controller but
    for the sample time ({1e3 * LQR_PERIOD:g} and {1e3 * MPC_PERIOD:g} ms). Equation (16) of the paper weighs the
    changes of the force instead: that is another index, with less acceleration and more force."""
    rows = (
        {"road": s, "system": NAMES[c]}
        | {m.heading: round(m.factor * study[at(s, c)][k], 3) for k, m in METRICS.items()}
        for s, c in product(SCENARIOS, CONTROLLERS)
    )
    yield Table.of("comparison", "All systems on all roads", rows, _RANDOM_IS)


@report.section("The limit at work")
def _limit(study: Results) -> Content:
    yield """Higher bumps keep the force at its limit for longer. The figure shows the benefit of the MPC over clipping
    the LQR."""
    panels = []
    for duration in published.BUMP_DURATIONS:
        values = {
            NAMES[s]: [study[c]["acceleration"] for c in published.over_height(duration, s)] for s in published.LIMITED
        }
        curves = [Series(name, published.HEIGHTS_MM, y, mode="line+markers") for name, y in values.items()]
        panels.append(Panel(f"bump {duration:g} s", "height of the bump [mm]", "rms acceleration [m/s2]", curves))
    yield Figure("limit", "Acceleration over the height of the bump", "Force within 8 N.", panels, columns=2)


@report.section("Encoders")
def _encoders(study: Results) -> Content:
    yield """The bench measures three positions; velocities are filtered differences. rms acceleration of the body with
    exact and with measured states."""
    rows = (
        {
            "road": s,
            "system": NAMES[c],
            "exact states [m/s2]": round(exact["acceleration"], 3),
            "encoders [m/s2]": round(measured["acceleration"], 3),
            "change [%]": round(100 * (measured["acceleration"] / exact["acceleration"] - 1), 1),
            "largest force [N]": round(measured["force.max"], 3),
            "smallest force [N]": round(measured["force.min"], 3),
        }
        for s, c in product(SCENARIOS, published.CONTROLLED)
        for exact, measured in [(study[at(s, c)], study[at(s, c, encoders=True)])]
    )
    yield Table.of("encoders", "States from encoders", rows, _RANDOM_IS)


@report.section("Solver")
def _solver(study: Results) -> Content:
    yield "Status 0 is solved; residual as defined for all MPC FMUs. Times per back end are in benchmarks."
    rows = (
        {
            "road": s,
            "system": NAMES[c],
            "status [-]": int(row["solver.status"]),
            "iterations [-]": int(row["solver.iterations"]),
            "residual [-]": f"{row['solver.residual']:.1e}",
        }
        for s, c in product(SCENARIOS, CONTROLLERS)
        if "solver.status" in (row := study[at(s, c)])
    )
    yield Table.of("solver", "Quadratic programs, worst of each run", rows, _RANDOM_IS)


@report.section("Steps")
def _refinement(study: Results) -> Content:
    yield "Whether the results depend on the steps."
    found = {c: with_finer_steps(study, at(SHORT, c)) for c in CONTROLLERS}
    rows = (
        {
            "steps": steps,
            "system": NAMES[c],
            "rms acceleration [m/s2]": found[c][steps]["acceleration"],
            "peak force [N]": peak_force(found[c][steps]),
            "change of the acceleration [%]": 100
            * (found[c][steps]["acceleration"] / study[at(SHORT, c)]["acceleration"] - 1),
        }
        for steps, c in product(found["passive"], CONTROLLERS)
    )
    caption = "Solver step and communication step of the plant; controllers and road keep their sample times."
    yield Table.of("refinement", f"Results with finer steps, {SHORT}", rows, caption)
