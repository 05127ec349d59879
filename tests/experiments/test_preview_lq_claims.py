"""Paper 004 from the FMUs: tables, exactness of the co-simulation, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from cosim import ComponentError, System
from cosim.experiments import preview_lq_report, preview_lq_study
from cosim.experiments.cases import CaseError, FmuSet
from cosim.experiments.preview_lq import WEIGHTS, Case, PreviewLqBench
from cosim.experiments.preview_lq_study import PRINTED, PRINTED_EIGENVALUES, Study
from fmu_sources.controllers.preview_lq import CORNERS, design_taps, ride_plant
from fmu_sources.controllers.preview_lq_design import sampled_loop
from fmu_sources.controllers.preview_lq_weights import load_weights
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car

EXPECTED_EIGENVALUES = (
    -28.19 + 72.34j, -10.91 + 67.29j, -9.16 + 70.08j, -8.70 + 68.04j, -4.92 + 5.79j, -4.44 + 5.23j, -3.52 + 4.54j,
)  # fmt: skip
LOW_PAIRS = (-5.31 + 6.14j, -4.00 + 5.07j)


@pytest.fixture(scope="session")
def study(fmus: FmuSet) -> Study:
    return preview_lq_study.study(fmus)


def test_eigenvalues(study: Study) -> None:
    for _, ours, _ in (
        pairs := preview_lq_study.matched_eigenvalues(study.eigenvalues["comfort"], EXPECTED_EIGENVALUES)
    ):
        near = min(EXPECTED_EIGENVALUES, key=lambda e: abs(e - ours))
        assert ours.real == pytest.approx(near.real, abs=0.01)
        assert ours.imag == pytest.approx(near.imag, abs=0.01)
    assert len(pairs) == 7


def test_printed_eigenvalues(study: Study) -> None:
    for printed, _, distance in preview_lq_study.matched_eigenvalues(study.eigenvalues["comfort"], PRINTED_EIGENVALUES):
        assert distance <= (0.08 if printed in LOW_PAIRS else 0.02)


def test_printed_eigenvalues_lack_one_entry_of_the_cross_weight(study: Study) -> None:
    ours = study.eigenvalues["comfort, one entry missing"]
    for _, _, distance in preview_lq_study.matched_eigenvalues(ours, PRINTED_EIGENVALUES):
        assert distance <= 0.01


@pytest.mark.parametrize(("input_", "system"), PRINTED)
def test_table_3(study: Study, input_: str, system: str) -> None:
    ours = preview_lq_study.relative(study, input_, "comfort", system)
    printed = preview_lq_study.corrected(input_, system)
    assert ours[-1] == pytest.approx(PRINTED[input_, system][-1], rel=0.05)
    for a, b in zip(ours[:-1], printed[:-1], strict=True):
        if a is not None and b is not None:
            assert a == pytest.approx(b, rel=0.25)


@pytest.mark.parametrize("weights", ["comfort", "road-holding"])
@pytest.mark.parametrize("input_", ["both", "left"])
def test_information_helps(study: Study, input_: str, weights: str) -> None:
    row = [preview_lq_study.relative_index(study, input_, weights, s) for s in ("active", "delay", "preview")]
    assert row[0] > row[1] > row[2]


def test_five_milliseconds(study: Study) -> None:
    assert study.coarse == pytest.approx(study.index["both", "comfort", "preview"], rel=0.03)


def test_report(study: Study, fmus: FmuSet, tmp_path) -> None:
    report = preview_lq_report.report(study, fmus)
    assert all(c.reason for c in report.claims if not c.reproduced)
    assert preview_lq_report.write(study, fmus, tmp_path).is_file()
    forces = {hold: np.abs(r["controller.force.fl"][-100:]).max() for hold, r in study.offset.items()}
    assert forces[False] > 50.0
    assert forces[True] < 0.05 * forces[False]


@pytest.mark.parametrize("weights", ["comfort", "road-holding"])
@pytest.mark.parametrize("system", ["active", "delay", "preview"])
def test_cosimulation_equals_the_exact_discrete_loop(fmus: FmuSet, weights: str, system: str) -> None:
    """Car, controller and road FMUs at 1 ms against matrix exponentials and a law written down here again."""
    bench = PreviewLqBench(fmus)
    steps, tp, tau = 1200, 120, 2.814 / (75 / 3.6) / 1e-3
    longer = bench.record(Case("left", weights, system), duration=1.5, solver_step=1.25e-4)
    bench.close()
    height = {k: longer[f"road.road.{k}.height"] for k in CORNERS}
    plant = ride_plant(ride_car(load_ride_car("sedan"), name="RideCarSedan"))
    taps = design_taps(plant, load_weights(WEIGHTS[weights]), 1e-3, 600)
    before = 400
    past = {k: np.concatenate([np.zeros(before), height[k]]) for k in ("fl", "fr")}

    def feed_forward(k: int) -> np.ndarray:
        u = np.zeros(4)
        points = np.arange(0, 236, 5)
        for side in ("fl", "fr"):
            ahead = np.interp(np.arange(236), points, height[side][k + points])
            road = np.concatenate([past[side][: before + k], ahead])  # index before + k is now
            front = tp if system == "preview" else 0
            rear = front + int(tau) if system != "active" else 0
            at = np.arange(rear + 1) - tau + before + k
            behind = np.interp(at, np.arange(len(road)), road)
            for wheel, heights, n in ((side, ahead, front), ("r" + side[1], behind, rear)):
                c = CORNERS.index(wheel)
                u += taps.interior[:n, :, c].T @ heights[:n] + taps.end[n, :, c] * heights[n]
        return u

    w = np.column_stack([height[k][:steps] for k in CORNERS])
    exact = sampled_loop(plant, 1e-3, w, K=taps.K, feed_forward=feed_forward)
    forces = np.column_stack([longer[f"controller.force.{k}"][:steps] for k in CORNERS])
    np.testing.assert_allclose(forces, exact.u, rtol=0, atol=1e-6 * np.abs(exact.u).max())
    body = exact.x[:, plant.states.index("body.z")]
    np.testing.assert_allclose(longer["car.body.z"][:steps], body, rtol=0, atol=1e-6 * np.abs(body).max())


def test_fmi_versions_agree_bit_for_bit(fmus: FmuSet) -> None:
    results = []
    for fmi in (2, 3):
        bench = PreviewLqBench(FmuSet(fmus.directory, fmi))
        results.append(bench.record(Case("left", "road-holding", "preview")).data)
        bench.close()
    np.testing.assert_array_equal(*results)


def test_standstill_is_defined(fmus: FmuSet) -> None:
    bench = PreviewLqBench(fmus)
    recording = bench.record(Case(speed_kmh=0.0), duration=0.1)
    bench.close()
    assert recording["controller.horizon_truncated"].all()
    assert np.abs(recording["controller.force.rl"]).max() == 0.0


def test_a_road_with_another_step_is_refused(fmus: FmuSet) -> None:
    """The GPC roads look ahead in steps of 10 ms: the controller says so when the first value arrives."""
    with System() as system:
        system.add("road", fmus.path("RoadSine"))
        system.add("controller", fmus.path("PreviewLqComfort"))
        system.connect("road.preview.step", "controller.preview.step")
        with pytest.warns(UserWarning, match="unconnected"), pytest.raises(ComponentError, match=r"preview\.step"):
            system.run(0.01)


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"input": "booth"}, "did you mean both"),
        ({"weights": "confort"}, "did you mean comfort"),
        ({"system": "previw"}, "did you mean preview"),
        ({"shape": "square"}, "no shape 'square'"),
        ({"preview_time": -0.1}, "preview time -0.1"),
        ({"speed_kmh": 500.0}, "speed 500"),
    ],
)
def test_cases_that_do_not_exist(choice: dict, message: str) -> None:
    with pytest.raises(CaseError, match=message):
        Case(**choice)


def test_horizon_beyond_the_preview_is_told(fmus: FmuSet) -> None:
    bench = PreviewLqBench(fmus)
    recording = bench.record(Case(preview_time=0.5), duration=0.05)
    bench.close()
    assert recording["controller.horizon_truncated"].all()
