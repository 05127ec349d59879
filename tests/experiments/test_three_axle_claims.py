"""Paper 003, linear part, from the FMUs: what the claims rest on, in reduced runs; bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cosim.experiments import three_axle_report, three_axle_study
from cosim.experiments.cases import CaseError, FmuSet
from cosim.experiments.three_axle import SYSTEMS, Case, ThreeAxleBench, edge_time, forces, metrics, pitch_error
from cosim.experiments.three_axle_report import SHOWN
from cosim.experiments.three_axle_study import Study
from fmu_sources.roads.shallow_trench import EDGE, START


@pytest.fixture(scope="module")
def study(fmus: FmuSet, tmp_path_factory) -> Study:
    """One column of Table 5.1, whole runs."""
    cache = tmp_path_factory.mktemp("runs")
    result = three_axle_study.study(fmus, cache, places=[SHOWN], variants=[])
    again = three_axle_study.study(fmus, cache, places=[SHOWN], variants=[], processes=1)
    assert again.rows == result.rows  # from the store
    return result


@pytest.fixture(scope="module")
def fastest(fmus: FmuSet) -> dict[str, dict[str, float]]:
    """20 km/h, 0.25 m: the trench alone, where forces and bounds meet their limits."""
    bench = ThreeAxleBench(fmus)
    cases = {s: Case(20.0, 0.25, s) for s in SYSTEMS}
    rows = {s: metrics(bench.record(c, duration=3.0), c) for s, c in cases.items()}
    bench.close()
    return rows


def test_preview_is_best_at_the_trench(study: Study) -> None:
    peaks = {s: study.value("peak_error_deg", SHOWN, s) for s in SYSTEMS}
    assert min(peaks, key=lambda s: peaks[s]) == "mpc-preview"
    assert peaks["mpc-preview"] <= 0.1 * min(peaks["passive"], peaks["mpc"])
    assert peaks["mpc"] == pytest.approx(1.94, abs=0.02)  # about 2 degrees where the estimator knows no road
    assert peaks["passive"] == pytest.approx(2.98, abs=0.02)


def test_preview_acts_before_the_edge_and_before_the_reference(study: Study) -> None:
    force = {s: study.value("force_before_edge_kN", SHOWN, s) for s in ("mpc", "mpc-preview")}
    assert force["mpc-preview"] >= 10 * force["mpc"]
    ramp = {s: study.value("force_before_ramp_kN", SHOWN, s) for s in ("lqr", "mpc", "mpc-preview")}
    assert ramp["lqr"] < 1e-3
    assert ramp["mpc-preview"] > 10 * ramp["mpc"]
    history = study.histories[Case(*SHOWN, "mpc-preview")]
    edge = edge_time(np.array(history["time"]), np.array(history["road"]), 1e3 * SHOWN[1])
    begins = (START - 3 * EDGE - 1.98) / (SHOWN[0] / 3.6)  # first axle three roundings ahead of the edge
    assert edge == pytest.approx(begins, abs=0.02)


def test_steady_errors(study: Study) -> None:
    steady = {s: study.value("steady_error_deg", SHOWN, s) for s in ("lqr", "mpc", "mpc-preview")}
    assert max(steady["mpc"], steady["mpc-preview"]) <= 0.02
    assert steady["lqr"] == pytest.approx(1.01, abs=0.01)


def test_ramp(study: Study) -> None:
    ramp = {s: study.value("ramp_error_deg", SHOWN, s) for s in ("lqr", "mpc", "mpc-preview")}
    assert ramp["mpc-preview"] < ramp["mpc"] < ramp["lqr"]


def test_every_program_is_solved(study: Study, fastest) -> None:
    for row in (*study.rows.values(), *fastest.values()):
        if "solver_residual" in row:
            assert row["solver_failures"] == 0
            assert row["solver_residual"] <= 1e-6


def test_at_the_limits(fastest) -> None:
    """Preview is best still, with a tenth of the blind controller's error just met: 0.0926."""
    peak = {s: row["peak_error_deg"] for s, row in fastest.items()}
    assert peak["mpc-preview"] <= 0.1 * peak["passive"]
    assert peak["mpc-preview"] <= 0.1 * peak["mpc"]
    assert all(row["peak_force_kN"] <= 150.0 for row in fastest.values())
    assert fastest["mpc-preview"]["slack"] > 1.0


def test_start_is_calm(fmus: FmuSet) -> None:
    """Vehicle and controller feed through to each other at initialization: nothing may come of it on a flat road."""
    bench = ThreeAxleBench(fmus)
    for system in ("mpc", "mpc-preview", "lqr"):
        recording = bench.record(Case(5.0, 0.15, system), duration=0.5)
        assert np.abs(forces(recording)).max() < 1e-3
        assert np.abs(pitch_error(recording)).max() < 1e-9
    bench.close()


def test_fmi_versions_agree_bit_for_bit(fmus: FmuSet) -> None:
    results = []
    for fmi in (2, 3):
        bench = ThreeAxleBench(FmuSet(fmus.directory, fmi))
        results.append(bench.record(Case(20.0, 0.25), duration=0.8).data)
        bench.close()
    np.testing.assert_array_equal(*results)


def test_report(study: Study, fmus: FmuSet, tmp_path) -> None:
    report = three_axle_report.report(study, fmus)
    assert {c.id: c.verdict for c in report.claims} == {
        "best-at-the-trench": "reproduced",
        "tenth-of-passive": "reproduced",
        "tenth-of-blind": "reproduced",
        "lqr-near-mpc": "reproduced",
        "before-the-edge": "reproduced",
        "before-the-reference": "reproduced",
        "ramp-preview": "reproduced",
        "ramp-lqr": "not reproduced",
        "steady-mpc": "reproduced",
        "steady-lqr": "reproduced",
        "force-limits": "reproduced",
        "solver": "holds",
    }
    assert all(c.criterion for c in report.claims)
    assert three_axle_report.write(study, fmus, tmp_path).is_file()


def test_drift_left_over_from_the_trench_is_no_preview(study: Study) -> None:
    """A pitch of 0.007 deg before the ramp, which the controller without preview has too, once counted as acting before."""
    rows = {c: dict(r) for c, r in study.rows.items()}
    rows[Case(*SHOWN, "mpc-preview")]["force_before_ramp_kN"] = rows[Case(*SHOWN, "mpc")]["force_before_ramp_kN"]
    found = {c.id: c.verdict for c in three_axle_report.claims(dataclasses.replace(study, rows=rows))}
    assert found["before-the-reference"] == "not reproduced"


def test_steps_do_not_matter(study: Study) -> None:
    for (_, system), row in study.refined.items():
        base = study.rows[Case(*study.places[-1], system)]
        assert row["peak_error_deg"] == pytest.approx(base["peak_error_deg"], rel=0.02)
        assert row["rms_az"] == pytest.approx(base["rms_az"], rel=0.02)
    assert len(study.refined) == len(three_axle_study.REFINEMENTS) * len(SYSTEMS)


def test_figures_keep_their_peaks(study: Study) -> None:
    report = {f.id: f for f in three_axle_report._forces(study).figures}["figure-5-14"]
    drawn = max(np.abs(s.y).max() for p in report.panels for s in p.series if s.name == "MPC with preview")
    history = study.histories[Case(*SHOWN, "mpc-preview")]
    assert drawn == max(np.abs(history[f"force.{k}"]).max() for k in ("a1l", "a2l", "a3l"))
    assert drawn == pytest.approx(study.value("peak_force_kN", SHOWN, "mpc-preview"), rel=1e-5)


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"system": "mpc-previw"}, "did you mean mpc-preview"),
        ({"estimator": "rode"}, "did you mean road"),
        ({"speed_kmh": 100.0}, "speed 100 km/h"),
        ({"depth": -0.1}, "depth -0.1 m"),
        ({"speed_kmh": float("nan")}, "speed nan"),
    ],
)
def test_cases_that_do_not_exist(choice: dict, message: str) -> None:
    with pytest.raises(CaseError, match=message):
        Case(**choice)
