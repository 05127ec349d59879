"""Paper 002 from the FMUs: the quadratic programs of every step, the force limit, claims, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from altered import failed
from kept_results import kept_verdicts
from oracles.mpc import MpcReference

from cosim import Recording
from cosim.experiments.bench import EXPERIMENT, published
from cosim.experiments.bench.claims import CLAIMS, ratio
from cosim.experiments.bench.published import LONG, SCENARIOS, SHORT, at
from cosim.experiments.bench.report import report
from cosim.experiments.bench.runs import CONTROLLERS, force
from cosim.experiments.steps import halved
from cosim.report import write_report
from cosim.study import FmuSet, Results, Runner, run_study
from fmu_sources.controllers.lq.bench import lqr_gain
from fmu_sources.controllers.mpc.bench import FORCE_LIMIT, MPC_PERIOD, bench_mpc
from fmu_sources.models.bench_states import STATES
from fmu_sources.plants import quarter_car
from fmu_sources.vehicles import load_quarter_car

COSTS = {"mpc": "force", "mpc-moves": "moves"}


@pytest.fixture(scope="session")
def study(fmus: FmuSet, tmp_path_factory) -> Results:
    return run_study(EXPERIMENT, fmus, tmp_path_factory.mktemp("bench"), processes=2)


@pytest.fixture(scope="session")
def car():
    return quarter_car(load_quarter_car("quarter_car_bench"), name="QuarterCarBench")


def states_at_samples(recording: Recording, period: float) -> np.ndarray:
    """States (samples, 4) that the controller saw, in the order of the paper."""
    every = round(period * 1000)
    source = "encoders" if "encoders.body.vz" in recording else "plant"
    return np.column_stack([recording[f"{source}.{s}"][::every] for s in STATES])


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("controller", COSTS)
def test_every_command_is_that_of_the_independent_solver(runner: Runner, car, controller: str, scenario: str) -> None:
    recording = runner.record(at(scenario, controller))
    reference = MpcReference(bench_mpc(car, COSTS[controller]))
    states = states_at_samples(recording, MPC_PERIOD)
    commands = force(recording)[:: round(MPC_PERIOD * 1000)]
    previous = np.concatenate([[0.0], commands[:-1]])
    expected = [
        reference.step(x, np.array([p])).command[0] if np.any(x) or p else 0.0
        for x, p in zip(states, previous, strict=True)
    ]
    assert np.abs(commands - expected).max() <= 1e-3 * FORCE_LIMIT
    assert recording["controller.solver.residual"].max() <= 1e-6
    assert not recording["controller.command.held"].any()
    assert np.abs(force(recording)).max() <= FORCE_LIMIT
    assert np.abs(commands).max() > 0.2 * FORCE_LIMIT


def test_lqr_is_the_state_feedback_of_the_riccati_equation(car) -> None:
    """Against the gain of the matrices (6), (7) as the paper prints them.

    The bench's values are written down again here.
    """
    from scipy.linalg import solve_continuous_are

    ms, mu, ks, ku, bs, bu = 2.45, 1.0, 900.0, 1250.0, 7.5, 5.0
    A = np.array(
        [[0, 1, 0, -1], [-ks / ms, -bs / ms, 0, bs / ms], [0, 0, 0, 1], [ks / mu, bs / mu, -ku / mu, -(bs + bu) / mu]]
    )
    B = np.array([[0], [1 / ms], [0], [-1 / mu]])
    P = solve_continuous_are(A, B, np.diag([450.0, 30.0, 5.0, 0.01]), [[0.01]])
    np.testing.assert_allclose(lqr_gain(car), (B.T @ P / 0.01).ravel(), rtol=1e-9)


def verdicts(study: Results) -> dict[str, str]:
    return {c.id: c.verdict for c in CLAIMS.judge(study)}


def test_claims_and_report(study: Results, fmus: FmuSet, tmp_path) -> None:
    assert all(c.criterion for c in CLAIMS.judge(study))
    assert verdicts(study) == kept_verdicts("bench")
    long, short = (study[at(s, "lqr")] for s in (LONG, SHORT))
    assert long["force.max"] == pytest.approx(8.4, abs=0.05)
    assert short["force.min"] == pytest.approx(-9.2, abs=0.05)
    assert study[at(LONG, "passive")]["acceleration"] == pytest.approx(2.1, abs=0.1)
    assert study[at(LONG, "mpc")]["acceleration"] == pytest.approx(0.5, abs=0.06)
    for s in (LONG, SHORT):
        assert ratio(study, s, "acceleration", "mpc", "lqr-clipped") == pytest.approx(1.0, abs=0.01)
    assert write_report(report(study, fmus), tmp_path).is_file()


def test_a_failed_run_leaves_open_what_needs_it_and_nothing_else(study: Results, fmus: FmuSet, tmp_path) -> None:
    broken = failed(study, at(LONG, "lqr"))
    changed = {k: v for k, v in verdicts(broken).items() if v != verdicts(study)[k]}
    assert changed == dict.fromkeys(("lqr-force", "bump-lqr", "far-superior"), "open")
    page = write_report(report(broken, fmus), tmp_path).read_text(encoding="utf-8")
    assert "Left out: the run lqr-bump-500ms failed: ComponentError: it broke" in page


def test_steps_do_not_matter(study: Results) -> None:
    for controller in CONTROLLERS:
        base = study[at(SHORT, controller)]["acceleration"]
        for finer in halved(at(SHORT, controller)).values():
            assert study[finer]["acceleration"] == pytest.approx(base, rel=1e-3)
    passive = at(SHORT, "passive")
    assert study[halved(passive)["solver step"]]["acceleration"] != study[passive]["acceleration"]


def test_stretches_of_the_random_road_differ(study: Results) -> None:
    stretches = published.over_stretches("passive")
    assert len({study[c]["acceleration"] for c in stretches}) == len(published.STRETCHES)
    assert published.over_stretches("mpc")[0] == at(published.RANDOM, "mpc")


def test_encoders_cost_little(study: Results) -> None:
    for scenario in SCENARIOS:
        for controller in published.CONTROLLED:
            exact = study[at(scenario, controller)]["acceleration"]
            measured = study[at(scenario, controller, encoders=True)]["acceleration"]
            assert measured != exact
            assert measured <= 1.3 * exact


def test_fmi_2_gives_the_same_run(fmus: FmuSet, study: Results) -> None:
    with Runner(EXPERIMENT, FmuSet(fmus.directory, 2)) as again:
        assert force(again.record(at(SHORT, "mpc"))).tolist() == study.signals(at(SHORT, "mpc"))["force"]
