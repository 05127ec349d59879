"""Published claims of paper 000, as medians over eight identification seeds, from the FMUs."""

from __future__ import annotations

import numpy as np
import pytest

from cosim import metrics
from cosim.experiments import gpc_report, gpc_study
from cosim.experiments.cases import CaseError
from cosim.experiments.gpc import GpcBench, GpcFmuSet, Match, Scenario, match_weight
from cosim.experiments.gpc_study import SEEDS, Study


@pytest.fixture(scope="session")
def fmus(built_fmus) -> GpcFmuSet:
    return GpcFmuSet(built_fmus.path("FullCarHmmwvModified", 3).parent.parent)


@pytest.fixture(scope="session")
def study(fmus: GpcFmuSet, tmp_path_factory: pytest.TempPathFactory) -> Study:
    """The whole study, run once."""
    return gpc_study.study(fmus, tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="session")
def medians(study: Study) -> dict[str, float]:
    return gpc_study.seed_medians(study)


def test_open_loop_peak(medians) -> None:
    assert medians["open_loop_peak_kmh"] == pytest.approx(50.0, abs=5.0)


@pytest.mark.parametrize("law", ["explicit", "preview"])
def test_sine_improvement(medians, law: str) -> None:
    assert medians[f"sine_improvement_{law}"] == pytest.approx(0.57, abs=0.06)


def test_sine_forces_alike(medians) -> None:
    assert medians["sine_force_ratio"] == pytest.approx(1.0, abs=0.12)


def test_perryman_improvement(medians) -> None:
    assert medians["perryman_improvement_explicit"] >= 0.25
    assert medians["perryman_improvement_preview"] >= 0.28


def test_curb_peak_force(medians) -> None:
    assert medians["curb_seeds_preview_lower_peak"] >= 7


def test_implicit_needs_more_power(medians) -> None:
    assert medians["power_seeds_matched"] == len(SEEDS)
    assert medians["power_ratio_implicit_60"] >= 1.5


def test_no_run_diverges(medians) -> None:
    assert medians["diverged_runs"] == 0


def test_report_tells_what_the_study_found(study: Study, fmus: GpcFmuSet, tmp_path) -> None:
    report = gpc_report.report(study, fmus)
    ids = {f.id for f in report.figures}
    assert ids == {f"figure-{n}" for n in range(6, 13)}
    assert all(c.reason for c in report.claims if not c.reproduced)
    assert gpc_report.write(study, fmus, tmp_path).is_file()
    assert (tmp_path / "summary.json").is_file()


def test_halving_the_solver_step_changes_nothing_visible(fmus: GpcFmuSet) -> None:
    bench = GpcBench(fmus)
    for road in ("sine", "perryman3"):
        scenario = Scenario(road, 50.0, "passive")
        full = bench.measure(scenario)["response"]
        system = bench.system(road, "passive")
        system["car"].set({"solver.step": 2.5e-4})
        assert bench.measure(scenario)["response"] == pytest.approx(full, rel=5e-3)
    bench.close()


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
