"""Force tracking of paper 001 on one corner, from the built FMUs.

Tracking error, exchange of car and actuator, a small study.
"""

from __future__ import annotations

import math
import runpy
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hmmwv_made_up import made_up_study

from cosim import ComponentError, Execution, StabilityWarning, System
from cosim.experiments.hmmwv.tracking import EXPERIMENT
from cosim.experiments.hmmwv.tracking.claims import CLAIMS
from cosim.experiments.hmmwv.tracking.published import PUBLISHED, VARIANTS, robustness_case
from cosim.experiments.hmmwv.tracking.report import section
from cosim.experiments.hmmwv.tracking.runs import FILTER, Case
from cosim.report import Report, write_report
from cosim.study import Results, Runner, run_study
from cosim.study.study_report import section_of

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


# ------------------------------------------------------------------------------------------------------- tracking


@pytest.mark.parametrize(("signal", "limit"), [("square", 0.04), ("sweep", 0.12), ("discrete sweep", 0.12)])
def test_the_force_follows(runner, signal, limit):
    row = runner.metrics(Case(signal))
    assert row["error"] < limit
    assert row["saturated"] == 0.0
    assert 30 < row["flow_peak"] < 60


def test_the_physical_set_tracks_as_well_with_half_the_voltage(runner):
    """Twice the flow per stroke, known to the controller: the same forces."""
    paper, physical = (runner.metrics(Case(actuator=name)) for name in ("paper", "physical"))
    assert physical["error"] == pytest.approx(paper["error"], rel=1e-3)
    assert physical["voltage_peak"] == pytest.approx(paper["voltage_peak"] * math.sqrt(850 / 3500), rel=1e-3)


def test_averaging_costs_most_of_the_tracking(runner):
    averaged = runner.metrics(VARIANTS["average (1.14) on"])
    assert averaged["error"] > 4 * runner.metrics(Case())["error"]


def test_averaging_quietens_the_command(runner):
    """What (1.14) is for: with noise in the load cell the command jumps less; the force is none the better for it."""
    plain, averaged = (runner.metrics(VARIANTS["load cell with noise" + x]) for x in ("", ", average (1.14) on"))
    assert averaged["voltage_jumps"] < 0.6 * plain["voltage_jumps"]
    assert averaged["error"] > 4 * plain["error"]
    assert plain["error"] > runner.metrics(Case())["error"]


def test_too_high_a_density_destabilizes_and_too_low_does_not(runner):
    rows = {d: runner.metrics(robustness_case("step", d, 1.0)) for d in (0.7, 1.0, 1.3)}
    assert rows[1.0]["late"] < 0.001
    assert rows[0.7]["late"] < rows[0.7]["early"] / 2
    assert rows[1.3]["late"] > 1.0


# ------------------------------------------------------------------------------------------------------- exchange


def force(runner: Runner, case: Case) -> np.ndarray:
    return runner.record(case, stop_time=1.5, record=["actuator.force"])["actuator.force"]


def test_halving_the_exchange_step_changes_the_tracked_force_by_less_than_one_percent(runner):
    coarse, fine = (force(runner, Case(exchange_parts=n)) for n in (1, 2))
    assert np.linalg.norm(coarse - fine) < 0.01 * np.linalg.norm(fine)


def test_a_plain_exchange_lags_by_half_a_step(runner):
    """Without values of the middle of the step the error is of first order: halving the step halves the difference."""
    exact = force(runner, Case(exchange_parts=4))
    lag = [np.linalg.norm(force(runner, Case(exchange_parts=n, extrapolate=False)) - exact) for n in (1, 2)]
    assert lag[0] / lag[1] == pytest.approx(2.0, abs=0.3)
    assert lag[0] > 0.01 * np.linalg.norm(exact)


@pytest.mark.parametrize(("exchange", "radius"), [("0.5 ms", 1.026), ("1 ms", 1.14)])
def test_side_by_side_the_check_warns_before_the_run_diverges(fmus, exchange, radius):
    """Ride car and four actuators, valves shut.

    Jacobi: the check warns before anything is run, and the run diverges. Gauss-Seidel, car first: no warning at 0.5 ms,
    and it stays where it is.
    """
    corners = ("fl", "fr", "rl", "rr")
    with System() as system:
        system.add("car", fmus.path("RideCarHmmwv"), step=exchange, start={"wheel.fl.vz": 1e-3})
        for k in corners:
            system.add(f"actuator_{k}", fmus.path("HydraulicActuator"), step=exchange)
            system.connect(f"actuator_{k}.force", f"car.force.{k}")
            system.connect(f"car.suspension.{k}.velocity", f"actuator_{k}.piston.velocity")
        components = ["car", *(f"actuator_{k}" for k in corners)]
        system.group("vehicle", components, "jacobi")
        stability = system.coupled_spectral_radius()
        assert stability.radius == pytest.approx(radius, abs=0.01)
        assert not stability.stable
        with pytest.warns(StabilityWarning, match=r"car \(\d+%\)"):
            simulation = system.initialize(execution=Execution(check_stability=True), record=["actuator_fl.force"])
        assert simulation.time == 0.0
        with suppress(ComponentError):  # it may end in one
            simulation.advance(1.0)
        diverged = np.abs(simulation.recording["actuator_fl.force"])
        assert diverged.max() > 1e4
        if exchange == "0.5 ms":
            system.group("vehicle", components)
            with warnings.catch_warnings():
                warnings.simplefilter("error", StabilityWarning)
                calm = system.run(1.0, execution=Execution(check_stability=True), record=["actuator_fl.force"])[
                    "actuator_fl.force"
                ]
            assert np.abs(calm).max() < 1e3


# ----------------------------------------------------------------------------------------------- signals and bad input


def test_a_small_study_is_kept_and_reported(fmus, tmp_path):
    """Figure 1.4 from the FMU: rise, first crossing, bandwidth; stored runs are not made again."""
    seen = []
    cases = [t for t in EXPERIMENT.tasks() if t.signals]
    options = {"tasks": cases, "processes": 1}
    study = run_study(
        EXPERIMENT, fmus, tmp_path / "runs", progress=lambda done, total: seen.append((done, total)), **options
    )
    assert seen == [(k, 4) for k in range(5)]
    found = study[Case(FILTER)]
    assert found["rise"] == pytest.approx(12.9e-3, abs=0.2e-3)
    assert found["crossing"] == pytest.approx(25e-3, abs=0.5e-3)
    assert found["bandwidth"] == pytest.approx(26.75, abs=0.1)
    seen.clear()
    again = run_study(
        EXPERIMENT, fmus, tmp_path / "runs", progress=lambda done, total: seen.append((done, total)), **options
    )
    assert seen == [(4, 4)]
    assert dict(again) == dict(study)
    assert all(again.signals(Case(s)) == study.signals(Case(s)) for s in (*PUBLISHED, FILTER))
    full = made_up_study()
    entries = [
        {"metrics": full[t.case]} | ({"signals": study.signals(t.case)} if t.case in cases_of(cases) else {})
        for t in EXPERIMENT.tasks()
    ]
    shown = section_of("Force tracking", section(Results(EXPERIMENT.tasks(), entries)))
    page = write_report(Report("tracking", "Force tracking", "Lead.", CLAIMS.judge(full), [shown]), tmp_path / "report")
    text = page.read_text(encoding="utf-8")
    for words in (
        "(figure 1.4 of the paper)",
        "(figure 1.8 of the paper)",
        "Robustness of the force tracking",
        "average (1.14) on",
    ):
        assert words in text
    assert "nan" not in "".join(shown.paragraphs).lower()


def cases_of(tasks) -> set[Case]:
    return {t.case for t in tasks}


def test_the_corner_of_the_example(built_fmus):
    """Road, quarter car, actuator, force tracking and comfort.

    Taking the force out of the strut helps over the bumps.
    """
    example = runpy.run_path(str(Path(__file__).parents[2] / "docs" / "examples" / "hmmwv_corner.py"))
    fmus = built_fmus.path("ForceTracking", 3).parent
    peak, force = {}, {}
    for active in (False, True):
        recording = example["run"](active=active, fmus=fmus)
        peak[active] = recording["comfort.absorbed_power.peak"][-1]
        force[active] = np.abs(recording["actuator.force"]).max()
        assert np.abs(recording["car.tire.deflection"]).max() > 1e-3  # the bumps were met
    assert peak[True] < 0.7 * peak[False]
    assert force[True] < force[False]
