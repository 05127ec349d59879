"""Runs, studies and reports of paper 000, from the FMUs."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.experiments.gpc import EXPERIMENT
from cosim.experiments.gpc.claims import CLAIMS, CONVERGED, Judge
from cosim.experiments.gpc.published import ACTIVE_CONTROLLERS, MATCHED
from cosim.experiments.gpc.report import report as make_report
from cosim.experiments.gpc.results import METRICS, Results
from cosim.experiments.gpc.runs import Case
from cosim.report import write_report
from cosim.study import FmuSet, Runner, run_study
from cosim.study import Results as Runs


@pytest.fixture(scope="module")
def runs(fmus: FmuSet, tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """One seed at the two speeds that claims name: every kind of run, no verdict."""
    options = {"seeds": (0,), "speeds": (50.0, 80.0)}
    return run_study(EXPERIMENT, fmus, tmp_path_factory.mktemp("runs"), options=options, processes=1)


@pytest.fixture(scope="module")
def results(runs: Runs) -> Results:
    return Results(runs)


def test_a_study_has_every_run(results: Results) -> None:
    for road in ("sine", "perryman3", "curb"):
        for speed in (50.0, 80.0, 72.0) if road == "curb" else (50.0, 80.0):
            assert results.passive(road, speed)["force"] == 0.0
            assert all(results.published(road, speed, law, 0)["R"] == 1e-7 for law in ACTIVE_CONTROLLERS)
    assert len(results.histories) == 3 * (1 + len(ACTIVE_CONTROLLERS))


def test_matched_runs_have_the_response_of_explicit(results: Results) -> None:
    for law in MATCHED:
        for road, speed in (("sine", 50.0), ("perryman3", 50.0), ("curb", 50.0)):
            matched, explicit = (results.matched(road, speed, c, 0) for c in (law, "explicit"))
            assert matched is not None
            assert explicit is not None
            assert matched["response"] == pytest.approx(explicit["response"], rel=5e-3)


def test_nothing_is_matched_where_explicit_does_not_help(results: Results) -> None:
    """At 80 km/h on the sine road explicit is worse than the passive car."""
    explicit = results.matched("sine", 80.0, "explicit", 0)
    assert explicit is not None
    assert results.improvement(explicit) < 0
    assert all(results.matched("sine", 80.0, law, 0) is None for law in MATCHED)
    assert results.at_equal_response("sine", 80.0, ("implicit", "explicit"), lambda *_: 1.0) is None


def test_no_run_diverges(results: Results) -> None:
    assert results.diverged() == []


def test_report_tells_what_the_study_found(runs: Runs, fmus: FmuSet, tmp_path) -> None:
    report = make_report(runs, fmus)
    ids = {f.id for f in report.figures}
    assert ids == {"main-result", *(f"figure-{n}" for n in range(6, 13))}
    assert all(c.reason for c in report.claims if not c.passed)
    assert all(c.criterion for c in report.claims)
    assert "motion_ratio" in next(c.fitted for c in report.claims if c.id == "open-loop-peak")
    assert write_report(report, tmp_path).is_file()
    assert (tmp_path / "summary.json").is_file()


def test_report_has_the_distributions_and_the_refinement(runs: Runs, results: Results, fmus: FmuSet) -> None:
    report = make_report(runs, fmus)
    tables = {t.id: t for t in report.tables}
    judged = {row[0] for t in tables.values() if t.id.startswith("distributions-") for row in t.rows}
    assert judged == {e.claim for e in CLAIMS.judge(Judge(results)).evidence}
    refined = tables["refinement"].rows
    assert len(refined) == 3 * 3 * (1 + len(ACTIVE_CONTROLLERS))  # roads, refinements, controllers
    passive = next(row for row in refined if row[2] == "passive")
    assert len(passive) == 4 + len(METRICS)


def test_halved_steps_change_nothing_visible_and_something(results: Results) -> None:
    """Refined runs are really others, and differ by less than the tolerance of matching."""
    for row, _, moves in results.moves():
        assert any(moves.values()), row
        assert all(abs(x) <= CONVERGED for x in moves.values()), row


def test_fmi_versions_agree_bit_for_bit(fmus: FmuSet) -> None:
    results = []
    for fmi in (2, 3):
        with Runner(EXPERIMENT, FmuSet(fmus.directory, fmi)) as runner:
            results.append(runner.record(Case("perryman3", 60.0, "preview")).data)
    np.testing.assert_array_equal(*results)


def test_holding_the_last_height_helps_on_the_curb(runner: Runner) -> None:
    """Explicit takes the road ahead to be at height 0; behind a step up that is wrong, and holding is right."""
    published = runner.metrics(Case("curb", 72.0, "explicit"))
    held = runner.metrics(Case("curb", 72.0, "explicit", hold=True))
    assert held["response"] < published["response"]


def test_missing_fmus_say_how_to_build_them(tmp_path) -> None:
    with pytest.raises(FileNotFoundError, match="build-fmus"):
        Runner(EXPERIMENT, FmuSet(tmp_path)).record(Case())
