"""Paper 002 from the FMUs: the quadratic programs of every step, the force limit, claims, bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from kept_results import kept_verdicts

from cosim.experiments import bench_report, bench_study
from cosim.experiments.bench import Bench, Case, force, states_at_samples
from cosim.experiments.bench_study import SCENARIOS, Study
from cosim.experiments.cases import CaseError, FmuSet
from fmu_sources.controllers.bench import FORCE_LIMIT, MPC_PERIOD, bench_mpc, lqr_gain
from fmu_sources.controllers.mpc_reference import MpcReference
from fmu_sources.plants import quarter_car
from fmu_sources.vehicles import load_quarter_car

COSTS = {"mpc": "force", "mpc-moves": "moves"}


@pytest.fixture(scope="session")
def study(fmus: FmuSet) -> Study:
    return bench_study.study(fmus)


@pytest.fixture(scope="session")
def car():
    return quarter_car(load_quarter_car("quarter_car_bench"), name="QuarterCarBench")


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("system", COSTS)
def test_every_command_is_that_of_the_independent_solver(study: Study, car, system: str, scenario: str) -> None:
    recording = study.histories[scenario, system]
    reference = MpcReference(bench_mpc(car, COSTS[system]))
    states = states_at_samples(recording, MPC_PERIOD)[:-1]  # nothing runs at the end
    commands = force(recording)[:: round(MPC_PERIOD * 1000)][:-1]
    previous = np.concatenate([[0.0], commands[:-1]])
    wanted = [
        reference.step(x, np.array([p])).command[0] if np.any(x) or p else 0.0
        for x, p in zip(states, previous, strict=True)
    ]
    assert np.abs(commands - wanted).max() <= 1e-3 * FORCE_LIMIT
    assert recording["controller.solver.residual"].max() <= 1e-6
    assert not recording["controller.command.held"].any()
    assert np.abs(force(recording)).max() <= FORCE_LIMIT
    assert np.abs(commands).max() > 0.2 * FORCE_LIMIT


def test_lqr_is_the_state_feedback_of_the_riccati_equation(car) -> None:
    """Against the gain of the matrices (6), (7) as the paper prints them, with the bench's values written down again."""
    from scipy.linalg import solve_continuous_are

    ms, mu, ks, ku, bs, bu = 2.45, 1.0, 900.0, 1250.0, 7.5, 5.0
    A = np.array(
        [[0, 1, 0, -1], [-ks / ms, -bs / ms, 0, bs / ms], [0, 0, 0, 1], [ks / mu, bs / mu, -ku / mu, -(bs + bu) / mu]]
    )
    B = np.array([[0], [1 / ms], [0], [-1 / mu]])
    P = solve_continuous_are(A, B, np.diag([450.0, 30.0, 5.0, 0.01]), [[0.01]])
    np.testing.assert_allclose(lqr_gain(car), (B.T @ P / 0.01).ravel(), rtol=1e-9)


def test_claims_and_report(study: Study, fmus: FmuSet, tmp_path) -> None:
    claims = bench_report.claims(study)
    assert {c.id: c.verdict for c in claims} == {
        "force-limit": "reproduced",
        "lqr-force": "reproduced",
        "bump-lqr": "reproduced",
        "bump-mpc": "reproduced",
        "far-superior": "not reproduced",
        "active-constraint": "not reproduced",
        "random-body": "reproduced",
        "random-wheel": "reproduced",
        "solver": "holds",
    }
    assert all(c.criterion for c in claims)
    assert {c.id: c.verdict for c in claims} == kept_verdicts("bench")
    long, short = (study.metrics[s, "lqr"] for s in ("bump 0.5 s", "bump 0.2 s"))
    assert long["force.max"] == pytest.approx(8.4, abs=0.05)
    assert short["force.min"] == pytest.approx(-9.2, abs=0.05)
    assert study.metrics["bump 0.5 s", "passive"]["acceleration"] == pytest.approx(2.1, abs=0.1)
    assert study.metrics["bump 0.5 s", "mpc"]["acceleration"] == pytest.approx(0.5, abs=0.06)
    for s in ("bump 0.5 s", "bump 0.2 s"):
        assert bench_study.ratio(study, s, "acceleration", "mpc", "lqr-clipped") == pytest.approx(1.0, abs=0.01)
    assert bench_report.write(study, fmus, tmp_path).is_file()


def test_one_good_stretch_of_road_is_no_result(study: Study) -> None:
    passive = study.stretches["passive"]
    worse = [{**row, "acceleration": 0.9 * row["acceleration"]} for row in passive[1:]]
    lucky = dataclasses.replace(study, stretches={"passive": passive, "mpc": [study.stretches["mpc"][0], *worse]})
    assert {c.id: c.verdict for c in bench_report.claims(lucky)}["random-body"] == "not reproduced"


def test_a_large_excess_is_not_slight(study: Study) -> None:
    metrics = {k: dict(v) for k, v in study.metrics.items()}
    metrics["bump 0.2 s", "lqr"]["force.min"] = -10.0
    found = {c.id: c.verdict for c in bench_report.claims(dataclasses.replace(study, metrics=metrics))}
    assert found["lqr-force"] == "order reproduced, magnitude not"


def test_steps_do_not_matter(study: Study) -> None:
    for finer in study.refined.values():
        for system, row in finer.items():
            assert row["acceleration"] == pytest.approx(study.metrics["bump 0.2 s", system]["acceleration"], rel=1e-3)
    solver = study.refined["solver step"]["passive"]
    assert solver["acceleration"] != study.metrics["bump 0.2 s", "passive"]["acceleration"]


def test_stretches_of_the_random_road_differ(study: Study) -> None:
    assert len({row["acceleration"] for row in study.stretches["passive"]}) == len(bench_study.STRETCHES)
    assert study.stretches["mpc"][0] == study.metrics["random", "mpc"]


def test_encoders_cost_little(study: Study) -> None:
    for (scenario, system), measured in study.encoders.items():
        exact = study.metrics[scenario, system]
        assert measured["acceleration"] != exact["acceleration"]
        assert measured["acceleration"] <= 1.3 * exact["acceleration"]


def test_fmi_2_gives_the_same_run(fmus: FmuSet, study: Study) -> None:
    bench = Bench(FmuSet(fmus.directory, 2))
    again = bench.record(Case("mpc", "bump", 0.2))
    bench.close()
    np.testing.assert_array_equal(force(again), force(study.histories["bump 0.2 s", "mpc"]))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"system": "mcp"}, "no controller 'mcp'; did you mean mpc"),
        ({"road": "bumpy"}, "did you mean bump"),
        ({"duration": 0.0}, "bump of 0 s"),
        ({"offset": -1.0}, "random road from -1 s on"),
        ({"height": 1.0}, "bump of 1000 mm"),
        ({"system": "passive", "encoders": True}, "no controller that would use"),
    ],
)
def test_runs_that_do_not_exist(given, message) -> None:
    with pytest.raises(CaseError, match=message):
        Case(**given)
