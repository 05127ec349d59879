"""Force tracking of paper 001 on one corner: tracking error, exchange of car and actuator, claims, report."""

from __future__ import annotations

import math
import runpy
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hmmwv_made_up import made_up_tracking

from cosim import ComponentError, StabilityWarning, System
from cosim.experiments import hmmwv_tracking as tracking
from cosim.experiments.cases import CaseError, FmuSet
from cosim.experiments.hmmwv_tracking import SIGNALS, VARIANTS, TrackingBench, TrackingCase
from cosim.experiments.store import RunStore
from cosim.report import Report, write_report

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


@pytest.fixture(scope="module")
def bench(fmus) -> TrackingBench:
    return TrackingBench(fmus)


# ------------------------------------------------------------------------------------------------------- tracking


@pytest.mark.parametrize(("signal", "limit"), [("square", 0.04), ("sweep", 0.12), ("discrete sweep", 0.12)])
def test_the_force_follows(bench, signal, limit):
    row = bench.measure(TrackingCase(signal))
    assert row["error"] < limit
    assert row["saturated"] == 0.0
    assert 30 < row["flow_peak"] < 60


def test_the_physical_set_tracks_as_well_with_half_the_voltage(bench):
    """Twice the flow per stroke, known to the controller: the same forces."""
    paper, physical = (bench.measure(TrackingCase(actuator=name)) for name in ("paper", "physical"))
    assert physical["error"] == pytest.approx(paper["error"], rel=1e-3)
    assert physical["voltage_peak"] == pytest.approx(paper["voltage_peak"] * math.sqrt(850 / 3500), rel=1e-3)


def test_averaging_costs_most_of_the_tracking(bench):
    averaged = bench.measure(VARIANTS["average (1.14) on"])
    assert averaged["error"] > 4 * bench.measure(TrackingCase())["error"]


def test_averaging_quietens_the_command(bench):
    """What (1.14) is for: with noise in the load cell the command jumps less; the force is none the better for it."""
    plain, averaged = (bench.measure(VARIANTS["load cell with noise" + x]) for x in ("", ", average (1.14) on"))
    assert averaged["voltage_jumps"] < 0.6 * plain["voltage_jumps"]
    assert averaged["error"] > 4 * plain["error"]
    assert plain["error"] > bench.measure(TrackingCase())["error"]


def test_too_high_a_density_destabilises_and_too_low_does_not(bench):
    rows = {d: bench.measure(tracking.robustness_case("step", d, 1.0)) for d in (0.7, 1.0, 1.3)}
    assert rows[1.0]["late"] < 0.001
    assert rows[0.7]["late"] < rows[0.7]["early"] / 2
    assert rows[1.3]["late"] > 1.0


# ------------------------------------------------------------------------------------------------------- exchange


def force(bench: TrackingBench, case: TrackingCase) -> np.ndarray:
    with bench.wire(case) as system:
        return system.run(1.5, record=["actuator.force"], record_interval="1 ms")["actuator.force"]


def test_halving_the_exchange_step_changes_the_tracked_force_by_less_than_one_percent(bench):
    coarse, fine = (force(bench, TrackingCase(exchange=h)) for h in ("0.5 ms", "0.25 ms"))
    assert np.linalg.norm(coarse - fine) < 0.01 * np.linalg.norm(fine)


def test_a_plain_exchange_lags_by_half_a_step(bench):
    """Without values of the middle of the step the error is of first order: halving the step halves the difference."""
    exact = force(bench, TrackingCase(exchange="0.125 ms"))
    lag = [
        np.linalg.norm(force(bench, TrackingCase(exchange=h, extrapolate=False)) - exact) for h in ("0.5 ms", "0.25 ms")
    ]
    assert lag[0] / lag[1] == pytest.approx(2.0, abs=0.3)
    assert lag[0] > 0.01 * np.linalg.norm(exact)


@pytest.mark.parametrize(("exchange", "radius"), [("0.5 ms", 1.026), ("1 ms", 1.14)])
def test_side_by_side_the_check_warns_before_the_run_diverges(fmus, exchange, radius):
    """Ride car and four actuators, valves shut. Jacobi: the check warns before anything is run, and the run diverges.
    Gauss-Seidel, car first: no warning at 0.5 ms, and it stays where it is."""
    corners = ("fl", "fr", "rl", "rr")
    with System() as system:
        system.add("car", fmus.path("RideCarHmmwv"), step=exchange, start={"wheel.fl.vz": 1e-3})
        for k in corners:
            system.add(f"actuator_{k}", fmus.path("HydraulicActuator"), step=exchange)
            system.connect(f"actuator_{k}.force", f"car.force.{k}")
            system.connect(f"car.suspension.{k}.velocity", f"actuator_{k}.piston.velocity")
        members = ["car", *(f"actuator_{k}" for k in corners)]
        system.group("vehicle", members, "jacobi")
        stability = system.coupled_spectral_radius()
        assert stability.radius == pytest.approx(radius, abs=0.01)
        assert not stability.stable
        with pytest.warns(StabilityWarning, match="Use a Gauss-Seidel group or smaller steps"):
            simulation = system.initialize(check_stability=True, record=["actuator_fl.force"])
        assert simulation.time == 0.0
        with suppress(ComponentError):  # it may end in one
            simulation.advance(1.0)
        diverged = np.abs(simulation.recording["actuator_fl.force"])
        assert diverged.max() > 1e4
        if exchange == "0.5 ms":
            system.group("vehicle", members)
            with warnings.catch_warnings():
                warnings.simplefilter("error", StabilityWarning)
                calm = system.run(1.0, check_stability=True, record=["actuator_fl.force"])["actuator_fl.force"]
            assert np.abs(calm).max() < 1e3


# ----------------------------------------------------------------------------------------------- signals and bad input


def test_signals():
    assert [tracking.square(t) for t in (0.0, 0.4999, 0.5, 0.9999, 1.0)] == [2000, 2000, -2000, -2000, 2000]
    t = np.linspace(0, 10, 2_000_001)
    crossings = t[1:][np.diff(np.sign([tracking.sweep(x) for x in t[::20]])).nonzero()[0] * 20]
    assert 0.5 / np.diff(crossings[:3]).mean() == pytest.approx(1.4, abs=0.3)
    assert 0.5 / np.diff(crossings[-4:]).mean() == pytest.approx(10.0, abs=0.3)
    assert SIGNALS["discrete sweep"][1] == 0.030


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({"signal": "sqare"}, "did you mean square"),
        ({"actuator": "oil"}, "no actuator 'oil'"),
        ({"order": "gauss"}, "no order 'gauss'"),
        ({"controller": (("fluid.density", -1.0),)}, "fluid.density"),
        ({"noise": -1.0}, "noise -1 N"),
    ],
)
def test_runs_that_do_not_exist(choice, words):
    with pytest.raises(CaseError, match=words):
        TrackingCase(**choice)


# ------------------------------------------------------------------------------------------------- study and report


def test_claims_follow_the_numbers():
    good = {c.id: c.well for c in tracking.tracking_claims(made_up_tracking())}
    assert good == {
        "tracking-filter": False,  # the made-up filter is at 1 after 23 ms
        "tracking-square": True,
        "tracking-sweep": True,
        "tracking-discrete-sweep": True,
        "tracking-difference": True,
        "tracking-average": False,
        "tracking-notches": True,
    }
    bad = {c.id: c.well for c in tracking.tracking_claims(made_up_tracking(worse=(next(iter(VARIANTS)),)))}
    assert [bad[f"tracking-{n}"] for n in ("square", "sweep", "difference", "average", "notches")] == [
        False,
        False,
        False,
        True,
        False,
    ]


def test_margin_is_where_the_loop_becomes_unstable():
    study = made_up_tracking()
    assert tracking.largest_stable_density(study) == 1.1
    assert tracking.largest_stable_density(study, leakage=5.0) == 1.1
    for density in tracking.DENSITIES:
        study.rows[tracking.robustness_case("step", density, 1.0)]["late"] = 1.0
    assert tracking.largest_stable_density(study) is None


def test_a_small_study_is_kept_and_reported(fmus, tmp_path):
    """Figure 1.4 from the FMU: rise, first crossing, bandwidth; stored runs are not made again."""
    seen = []
    store = RunStore(tmp_path / "runs", "salt")
    cases = [TrackingCase()]
    study = tracking.tracking_study(fmus, store, lambda done, total: seen.append((done, total)), cases)
    assert seen == [(k, 5) for k in range(6)]
    figures = tracking.filter_figures(study)
    assert figures["rise"] == pytest.approx(12.9e-3, abs=0.2e-3)
    assert figures["crossing"] == pytest.approx(25e-3, abs=0.5e-3)
    assert figures["bandwidth"] == pytest.approx(26.75, abs=0.1)
    again = tracking.tracking_study(FmuSet(tmp_path / "nowhere"), store, cases=cases)
    assert again.rows == study.rows
    assert again.histories == study.histories
    full = made_up_tracking()
    full.filter_step, full.histories = study.filter_step, study.histories
    page = write_report(
        Report(
            "tracking", "Force tracking", "Lead.", tracking.tracking_claims(full), [tracking.tracking_section(full)]
        ),
        tmp_path / "report",
    )
    text = page.read_text(encoding="utf-8")
    for words in ("Figure 1.4", "Figure 1.8", "Robustness of the force tracking", "average (1.14) on"):
        assert words in text
    assert "nan" not in "".join(tracking.tracking_section(full).paragraphs).lower()


def test_the_corner_of_the_example(built_fmus):
    """Road, quarter car, actuator, force tracking and comfort: taking the force out of the strut helps over the bumps."""
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
