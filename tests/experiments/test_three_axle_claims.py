"""Paper 003, linear part, from the FMUs: what the claims rest on, in reduced runs; bad input."""

from __future__ import annotations

import numpy as np
import pytest
from altered import altered, failed
from kept_results import kept_verdicts

from cosim.experiments.steps import halved
from cosim.experiments.three_axle import EXPERIMENT, published
from cosim.experiments.three_axle.claims import CLAIMS
from cosim.experiments.three_axle.published import SHOWN
from cosim.experiments.three_axle.report import report
from cosim.experiments.three_axle.runs import CONTROLLERS, Case, edge_time, forces, measure, pitch_error
from cosim.report import write_report
from cosim.study import FmuSet, Results, Runner, run_study
from fmu_sources.roads.shallow_trench import EDGE, START

AT = {c: Case(*SHOWN, c) for c in CONTROLLERS}


@pytest.fixture(scope="module")
def study(fmus: FmuSet, tmp_path_factory) -> Results:
    """One column of Table 5.1, whole runs."""
    store = tmp_path_factory.mktemp("runs")
    tasks = published.plan([SHOWN], [])
    result = run_study(EXPERIMENT, fmus, store, tasks=tasks, processes=2)
    again = run_study(EXPERIMENT, fmus, store, tasks=tasks, processes=1)
    assert again.rows() == result.rows()  # from the store
    return result


@pytest.fixture(scope="module")
def fastest(runner: Runner) -> dict[str, dict[str, float]]:
    """20 km/h, 0.25 m: the trench alone, where forces and bounds meet their limits."""
    return {c: measure(runner.run(Case(20.0, 0.25, c), stop_time=3.0)) for c in CONTROLLERS}


def values(study: Results, metric: str, *controllers: str) -> dict[str, float]:
    return {c: study[AT[c]][metric] for c in controllers}


def verdicts(study: Results) -> dict[str, str]:
    return {c.id: c.verdict for c in CLAIMS.judge(study)}


def test_preview_is_best_at_the_trench(study: Results) -> None:
    peaks = values(study, "peak_error_deg", *CONTROLLERS)
    assert min(peaks, key=lambda s: peaks[s]) == "mpc-preview"
    assert peaks["mpc-preview"] <= 0.1 * min(peaks["passive"], peaks["mpc"])
    assert peaks["mpc"] == pytest.approx(1.94, abs=0.02)  # about 2 degrees where the estimator knows no road
    assert peaks["passive"] == pytest.approx(2.98, abs=0.02)


def test_preview_acts_before_the_edge_and_before_the_reference(study: Results) -> None:
    force = values(study, "force_before_edge_kN", "mpc", "mpc-preview")
    assert force["mpc-preview"] >= 10 * force["mpc"]
    ramp = values(study, "force_before_ramp_kN", "lqr", "mpc", "mpc-preview")
    assert ramp["lqr"] < 1e-3
    assert ramp["mpc-preview"] > 10 * ramp["mpc"]
    history = study.signals(AT["mpc-preview"])
    edge = edge_time(np.array(history["time"]), np.array(history["road"]), 1e3 * SHOWN[1])
    begins = (START - 3 * EDGE - 1.98) / (SHOWN[0] / 3.6)  # first axle three roundings ahead of the edge
    assert edge == pytest.approx(begins, abs=0.02)


def test_steady_errors(study: Results) -> None:
    steady = values(study, "steady_error_deg", "lqr", "mpc", "mpc-preview")
    assert max(steady["mpc"], steady["mpc-preview"]) <= 0.02
    assert steady["lqr"] == pytest.approx(1.01, abs=0.01)


def test_ramp(study: Results) -> None:
    ramp = values(study, "ramp_error_deg", "lqr", "mpc", "mpc-preview")
    assert ramp["mpc-preview"] < ramp["mpc"] < ramp["lqr"]


def test_every_program_is_solved(study: Results, fastest) -> None:
    solved = [row for row in (*study.values(), *fastest.values()) if "solver_residual" in row]
    assert len(solved) == 2 + 4 + 2  # both predictive controllers: here, with finer steps, at the fastest place
    for row in solved:
        assert row["solver_failures"] == 0
        assert row["solver_residual"] <= 1e-6


def test_at_the_limits(fastest) -> None:
    """Preview is best still, with a tenth of the blind controller's error just met: 0.0926."""
    peak = {s: row["peak_error_deg"] for s, row in fastest.items()}
    assert peak["mpc-preview"] <= 0.1 * peak["passive"]
    assert peak["mpc-preview"] <= 0.1 * peak["mpc"]
    assert all(row["peak_force_kN"] <= 150.0 for row in fastest.values())
    assert fastest["mpc-preview"]["slack"] > 1.0


def test_start_is_calm(runner: Runner) -> None:
    """Vehicle and controller feed through to each other at initialization: nothing may come of it on a flat road."""
    for controller in ("mpc", "mpc-preview", "lqr"):
        recording = runner.record(AT[controller], stop_time=0.5)
        assert np.abs(forces(recording)).max() < 1e-3
        assert np.abs(pitch_error(recording)).max() < 1e-9


def test_fmi_versions_agree_bit_for_bit(fmus: FmuSet) -> None:
    results = []
    for fmi in (2, 3):
        with Runner(EXPERIMENT, FmuSet(fmus.directory, fmi)) as runner:
            results.append(runner.record(Case(20.0, 0.25), stop_time=0.8).data)
    np.testing.assert_array_equal(*results)


def test_report(study: Results, fmus: FmuSet, tmp_path) -> None:
    made = report(study, fmus)
    assert {c.id: c.verdict for c in made.claims} == kept_verdicts("three-axle")  # one column decides as all do
    assert all(c.criterion for c in made.claims)
    assert write_report(made, tmp_path).is_file()


def test_a_failed_run_leaves_open_what_needs_it_and_nothing_else(study: Results, fmus: FmuSet, tmp_path) -> None:
    broken = failed(study, AT["lqr"])
    found = verdicts(broken)
    assert {k for k, v in found.items() if v == "open"} == {
        "best-at-the-trench",
        "lqr-near-mpc",
        "ramp-preview",
        "ramp-lqr",
        "steady-lqr",
        "force-limits",
    }
    assert {k: v for k, v in found.items() if v != "open"}.items() <= verdicts(study).items()
    page = write_report(report(broken, fmus), tmp_path).read_text(encoding="utf-8")
    assert "Left out: the run 5kmh-150mm-lqr failed: ComponentError: it broke" in page


def test_drift_left_over_from_the_trench_is_no_preview(study: Results) -> None:
    """A pitch of 0.007 deg before the ramp once counted as acting before.

    The controller without preview has it too.
    """
    drift = {"force_before_ramp_kN": study[AT["mpc"]]["force_before_ramp_kN"]}
    assert verdicts(altered(study, {AT["mpc-preview"]: drift}))["before-the-reference"] == "not reproduced"


def test_steps_do_not_matter(study: Results) -> None:
    for case in AT.values():
        for finer in halved(case).values():
            assert study[finer]["peak_error_deg"] == pytest.approx(study[case]["peak_error_deg"], rel=0.02)
            assert study[finer]["rms_az"] == pytest.approx(study[case]["rms_az"], rel=0.02)
    assert len(study) == 3 * len(CONTROLLERS)
    finer = halved(AT["passive"])["solver step"]
    assert study[finer]["peak_error_deg"] != study[AT["passive"]]["peak_error_deg"]


def test_figures_keep_their_peaks(study: Results, fmus: FmuSet) -> None:
    figure = {f.id: f for f in report(study, fmus).figures}["figure-5-14"]
    drawn = max(np.abs(s.y).max() for p in figure.panels for s in p.series if s.name == "MPC with preview")
    history = study.signals(AT["mpc-preview"])
    assert drawn == max(np.abs(history[f"force.{k}"]).max() for k in ("a1l", "a2l", "a3l"))
    assert drawn == pytest.approx(study[AT["mpc-preview"]]["peak_force_kN"], rel=1e-5)


def test_the_plan_is_table_5_1_the_variants_and_finer_steps() -> None:
    tasks = published.plan()
    assert len(set(tasks)) == 24 + 24 + 8
    assert sum(t.signals for t in tasks) == 24
    assert len({t.case.label for t in tasks}) == 56
    assert Case(5.0, 0.15, "mpc", hold_height=True).label == "5kmh-150mm-mpc-height"
    assert Case(20.0, 0.25, "mpc", "road").label == "20kmh-250mm-mpc-road"
