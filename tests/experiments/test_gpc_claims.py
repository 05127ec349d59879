"""Runs, studies and reports of paper 000, from the FMUs."""

from __future__ import annotations

import numpy as np
import pytest

from cosim import metrics
from cosim.experiments import gpc_claims, gpc_report, gpc_study
from cosim.experiments.cases import CaseError
from cosim.experiments.gpc import GpcBench, GpcFmuSet, Match, Scenario, match_weight
from cosim.experiments.gpc_results import METRICS, Results
from cosim.experiments.gpc_study import LAWS, MATCHED, Study


@pytest.fixture(scope="session")
def fmus(built_fmus) -> GpcFmuSet:
    return GpcFmuSet(built_fmus.path("FullCarHmmwvModified", 3).parent.parent)


@pytest.fixture(scope="module")
def study(fmus: GpcFmuSet, tmp_path_factory: pytest.TempPathFactory) -> Study:
    """One seed at the two speeds that claims name: every kind of run, no verdict."""
    return gpc_study.study(fmus, tmp_path_factory.mktemp("runs"), seeds=(0,), speeds=(50.0, 80.0), processes=1)


def test_a_study_has_every_run(study: Study) -> None:
    results = Results(study)
    for road in ("sine", "perryman3", "curb"):
        for speed in (50.0, 80.0, 72.0) if road == "curb" else (50.0, 80.0):
            assert results.passive(road, speed)["force"] == 0.0
            assert all(results.published(road, speed, law, 0)["R"] == 1e-7 for law in LAWS)
    assert len(study.histories) == 3 * (1 + len(LAWS))


def test_matched_runs_have_the_response_of_explicit(study: Study) -> None:
    results = Results(study)
    for law in MATCHED:
        for road, speed in (("sine", 50.0), ("perryman3", 50.0), ("curb", 50.0)):
            matched, explicit = (results.matched(road, speed, c, 0) for c in (law, "explicit"))
            assert matched is not None
            assert explicit is not None
            assert matched["response"] == pytest.approx(explicit["response"], rel=5e-3)


def test_nothing_is_matched_where_explicit_does_not_help(study: Study) -> None:
    """At 80 km/h on the sine road explicit is worse than the passive car."""
    results = Results(study)
    explicit = results.matched("sine", 80.0, "explicit", 0)
    assert explicit is not None
    assert results.improvement(explicit) < 0
    assert all(results.matched("sine", 80.0, law, 0) is None for law in MATCHED)
    assert results.ratios("sine", 80.0, "power", "implicit", "explicit") is None


def test_no_run_diverges(study: Study) -> None:
    assert Results(study).diverged() == 0


def test_report_tells_what_the_study_found(study: Study, fmus: GpcFmuSet, tmp_path) -> None:
    report = gpc_report.report(study, fmus)
    ids = {f.id for f in report.figures}
    assert ids == {f"figure-{n}" for n in range(6, 13)}
    assert all(c.reason for c in report.claims if not c.well)
    assert all(c.criterion for c in report.claims)
    assert "motion_ratio" in next(c.fitted for c in report.claims if c.id == "open-loop-peak")
    assert gpc_report.write(study, fmus, tmp_path).is_file()
    assert (tmp_path / "summary.json").is_file()


def test_report_has_the_distributions_and_the_refinement(study: Study, fmus: GpcFmuSet) -> None:
    report = gpc_report.report(study, fmus)
    tables = {t.id: t for t in report.tables}
    judged = {row[0] for t in tables.values() if t.id.startswith("distributions-") for row in t.rows}
    assert judged == {e.claim for e in gpc_claims.claims(study).evidence}
    refined = tables["refinement"].rows
    assert len(refined) == 3 * 3 * (1 + len(LAWS))  # roads, refinements, controllers
    passive = next(row for row in refined if row[2] == "passive")
    assert len(passive) == 4 + len(METRICS)


def test_halved_steps_change_nothing_visible_and_something(study: Study) -> None:
    """Refined runs are really others, and differ by less than the tolerance of matching."""
    for row, moves in Results(study).refinement():
        assert any(moves.values()), row
        assert all(abs(x) <= gpc_claims.CONVERGED for x in moves.values()), row


def test_fmi_versions_agree_bit_for_bit(fmus: GpcFmuSet) -> None:
    results = []
    for fmi in (2, 3):
        bench = GpcBench(GpcFmuSet(fmus.directory, fmi=fmi))
        results.append(bench.record(Scenario("perryman3", 60.0, "preview")).data)
        bench.close()
    np.testing.assert_array_equal(*results)


def test_holding_the_last_height_helps_on_the_curb(fmus: GpcFmuSet) -> None:
    """Explicit takes the road ahead to be at height 0; behind a step up that is wrong, and holding is right."""
    bench = GpcBench(fmus)
    published = bench.measure(Scenario("curb", 72.0, "explicit"))
    held = bench.measure(Scenario("curb", 72.0, "explicit", hold=True))
    bench.close()
    assert held["response"] < published["response"]


def test_matching_finds_the_crossing_nearest_to_the_published_weight() -> None:
    def measure(R: float) -> dict:
        x = np.log10(R / 1e-7)
        return {"diverged": False, "response": float(1 + x**2 * (x - 1.5))}  # 0.9 at x = -0.24, 0.29 and 1.45

    near = match_weight(measure, 0.9)
    assert near.found
    assert np.log10(near.R / 1e-7) == pytest.approx(-0.24, abs=0.01)
    assert near.metrics["response"] == pytest.approx(0.9, rel=5e-3)


def test_matching_says_not_found() -> None:
    result = match_weight(lambda R: {"diverged": R < 1e-8, "response": 2.0}, 1.0)
    assert isinstance(result, Match)
    assert not result.found
    assert result.metrics["response"] == 2.0


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"road": "sinus"}, "did you mean sine"),
        ({"controller": "previw"}, "did you mean preview"),
        ({"speed_kmh": 0.0}, "speed 0 km/h"),
        ({"speed_kmh": 500.0}, "speed 500 km/h"),
        ({"speed_kmh": float("nan")}, "speed nan"),
        ({"R": -1.0}, "R = -1"),
        ({"controller": "preview", "hold": True}, "hold"),
    ],
)
def test_scenarios_that_do_not_exist(choice: dict, message: str) -> None:
    with pytest.raises(CaseError, match=message):
        Scenario(**choice)


def test_missing_fmus_say_how_to_build_them(tmp_path) -> None:
    with pytest.raises(FileNotFoundError, match="build-fmus"):
        GpcBench(GpcFmuSet(tmp_path)).record(Scenario())


def test_stored_runs_are_not_run_again(tmp_path) -> None:
    from cosim.experiments.store import RunStore

    calls = []
    store = RunStore(tmp_path, "salt")
    for _ in range(2):
        store.get({"a": 1}, lambda: calls.append(1) or {"x": 1.5})
    assert len(calls) == 1
    assert RunStore(tmp_path, "other").get({"a": 1}, lambda: {"x": 2.0}) == {"x": 2.0}


def test_metrics_of_the_passive_car(fmus: GpcFmuSet) -> None:
    bench = GpcBench(fmus)
    m = bench.measure(Scenario("curb", 50.0, "passive"))
    bench.close()
    assert m["force"] == m["power"] == 0.0
    assert np.isnan(metrics.force_normalised_effectiveness(0.0, m["force"]))
