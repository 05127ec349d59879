"""Paper 004 from the FMUs: tables, exactness of the co-simulation, bad input."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from altered import altered, failed
from kept_results import kept_verdicts
from oracles.lq import sampled_loop
from scipy import linalg

from cosim import System, WiringError
from cosim.core.errors import CosimError
from cosim.experiments.preview_lq import EXPERIMENT, published
from cosim.experiments.preview_lq.claims import CLAIMS, relative, relative_index
from cosim.experiments.preview_lq.published import PRINTED, corrected, over_preview, plateau
from cosim.experiments.preview_lq.report import report
from cosim.experiments.preview_lq.runs import CONTROLLERS, WEIGHTED_CONTROLLERS, Case
from cosim.experiments.steps import HALVED, halved
from cosim.report import write_report
from cosim.study import FmuSet, Results, Runner, run_study
from fmu_sources.controllers.lq.preview import WEIGHTED, design_taps, ride_plant
from fmu_sources.controllers.lq.preview_weights import load_weights
from fmu_sources.models.corners import CORNERS
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car


@pytest.fixture(scope="session")
def study(fmus: FmuSet, tmp_path_factory) -> Results:
    return run_study(EXPERIMENT, fmus, tmp_path_factory.mktemp("preview-lq"), processes=2)


def verdicts(study: Results) -> dict[str, str]:
    return {c.id: c.verdict for c in CLAIMS.judge(study)}


@pytest.mark.parametrize(("input_", "controller"), PRINTED)
def test_table_3(study: Results, input_: str, controller: str) -> None:
    ours = relative(study, input_, "comfort", controller)
    printed = corrected(input_, controller)
    assert ours[-1] == pytest.approx(PRINTED[input_, controller][-1], rel=0.05)
    for a, b in zip(ours[:-1], printed[:-1], strict=True):
        if a is not None and b is not None:
            assert a == pytest.approx(b, rel=0.25)


@pytest.mark.parametrize("weights", ["comfort", "road-holding"])
@pytest.mark.parametrize("input_", ["both", "left"])
def test_information_helps(study: Results, input_: str, weights: str) -> None:
    row = [relative_index(study, input_, weights, c) for c in ("active", "delay", "preview")]
    assert row[0] > row[1] > row[2]


def test_five_milliseconds(study: Results) -> None:
    assert study[published.COARSE]["J"] == pytest.approx(study[Case("both", "comfort", "preview")]["J"], rel=0.03)


def test_verdicts(study: Results) -> None:
    """Every claim with its verdict: a changed one is a changed result."""
    found = verdicts(study)
    assert all(c.criterion for c in CLAIMS.judge(study))
    assert list(found.items()) == list(kept_verdicts("preview-lq").items())


def test_steps_do_not_matter(study: Results) -> None:
    for what in HALVED:
        for case in (Case("both", "comfort", c) for c in CONTROLLERS):
            assert study[halved(case)[what]]["J"] == pytest.approx(study[case]["J"], rel=1e-4)
    case = Case("both", "comfort", "passive")
    assert study[halved(case)["solver step"]]["J"] != study[case]["J"]


def test_a_short_preview_is_worse_by_an_independent_solution(study: Results) -> None:
    """Continuous law by quadrature on the car's matrices, nothing of the design functions.

    The same rise at 10, 20 ms.
    """
    car = ride_car(load_ride_car("sedan"), name="RideCarSedan")
    weights = load_weights("comfort")
    linear = car.linearize()
    heights = [linear.inputs.index(f"road.{k}.height") for k in CORNERS]
    forces = [linear.inputs.index(f"force.{k}") for k in CORNERS]
    outputs = [linear.outputs.index(n) for n in WEIGHTED]
    A, B, E = linear.A, linear.B[:, forces], linear.B[:, heights]
    C, D, F = linear.C[outputs], linear.D[np.ix_(outputs, forces)], linear.D[np.ix_(outputs, heights)]
    W = np.diag(weights.outputs(CORNERS))
    Q, N, R, Q12 = C.T @ W @ C, C.T @ W @ D, D.T @ W @ D + np.diag(weights.controls(CORNERS)), C.T @ W @ F
    P = linalg.solve_continuous_are(A, B, Q, R, s=N)
    K = linalg.solve(R, B.T @ P + N.T)
    Ac = A - B @ K
    h, tau = 2e-4, 2.814 / (75 / 3.6)
    t = np.arange(0, 1.2 + 0.5 * h, h)

    def height(at: np.ndarray) -> np.ndarray:  # hole, flat, bump of 0.1 s each
        haversine = lambda x: np.where((x > 0) & (x < 0.1), 0.5 * (1 - np.cos(2 * np.pi * x / 0.1)), 0.0)  # noqa: E731
        return haversine(at - 0.32) - haversine(at - 0.12)

    lags = np.arange(round((tau + 0.02) / h) + 1) * h
    step, kernel, G = linalg.expm(Ac.T * h), [], P @ E + Q12
    for _ in lags:
        kernel.append(-linalg.solve(R, B.T @ G))
        G = step @ G
    kernel = np.array(kernel)  # lags, forces, wheels
    delay = np.array([tau if k.startswith("r") else 0.0 for k in CORNERS])

    def index(preview: float) -> float:
        u = np.zeros((len(t), 4))
        for c in range(4):
            n = round((preview + delay[c]) / h)
            if n == 0:
                continue
            end = preview + delay[c] - n * h  # the horizon ends between two points of the grid
            known = height(t[:, None] + lags[None, : n + 1] - delay[c])
            weight = np.full(n + 1, h)
            weight[[0, -1]] = h / 2
            weight[-1] += end
            u += (known * weight) @ kernel[: n + 1, :, c]
        w = np.column_stack([height(t - d) for d in delay])
        drive, x, sum_ = u @ B.T + w @ E.T, np.zeros(len(A)), np.zeros((len(t), len(A)))
        half = linalg.solve(np.eye(len(A)) - h / 2 * Ac, np.eye(len(A)))
        for i in range(len(t) - 1):  # trapezoidal rule
            x = half @ (x + h / 2 * (Ac @ x) + h / 2 * (drive[i] + drive[i + 1]))
            sum_[i + 1] = x
        force = u - sum_ @ K.T
        y = sum_ @ C.T + force @ D.T + w @ F.T
        return float(np.trapezoid((y**2) @ np.diag(W) + (force**2) @ np.array(weights.controls(CORNERS)), t))

    base, ours = index(0.0), {t: study[c]["J"] for t, c in over_preview("both", "comfort").items()}
    for preview in (0.01, 0.02):
        rise = index(preview) / base
        assert rise > 1.05
        assert ours[preview] / ours[0.0] == pytest.approx(rise, abs=0.02)


def test_holding_the_last_height_explains_it(study: Results) -> None:
    """A law that does not gain from hold_tail, or gains nothing from short previews with it, fails the check."""
    places = [(i, w) for i in ("both", "left") for w in ("comfort", "road-holding")]
    changes = {
        held: study[cut]
        for place in places
        for cut, held in zip(over_preview(*place).values(), over_preview(*place, hold_tail=True).values(), strict=True)
    }
    assert verdicts(study)["short-preview"] == "holds"
    assert verdicts(altered(study, changes))["short-preview"] == "does not hold"


def test_report(study: Results, fmus: FmuSet, tmp_path) -> None:
    assert write_report(report(study, fmus), tmp_path).is_file()
    forces = {h: np.abs(study.signals(plateau(hold_tail=h))["controller.force.fl"][-100:]).max() for h in (False, True)}
    assert forces[False] > 50.0
    assert forces[True] < 0.05 * forces[False]


def test_a_failed_run_leaves_open_what_needs_it_and_nothing_else(study: Results, fmus: FmuSet, tmp_path) -> None:
    broken = failed(study, Case("left", "comfort", "active"))
    changed = {k: v for k, v in verdicts(broken).items() if v != verdicts(study)[k]}
    assert changed == dict.fromkeys(("index-left-active", "parts-left-active", "order-c"), "open")
    page = write_report(report(broken, fmus), tmp_path).read_text(encoding="utf-8")
    assert (
        page.count("Left out: the run left-comfort-active failed: ComponentError: it broke") == 2
    )  # table 3, time histories


@pytest.mark.parametrize("weights", ["comfort", "road-holding"])
@pytest.mark.parametrize("controller", ["active", "delay", "preview"])
def test_cosimulation_equals_the_exact_discrete_loop(runner: Runner, weights: str, controller: str) -> None:
    """Car, controller and road FMUs at 1 ms against matrix exponentials and a law written down here again."""
    steps, tp, tau = 1200, 120, 2.814 / (75 / 3.6) / 1e-3
    longer = runner.record(Case("left", weights, controller, solver_parts=4), stop_time=1.5)
    height = {k: longer[f"road.road.{k}.height"] for k in CORNERS}
    plant = ride_plant(ride_car(load_ride_car("sedan"), name="RideCarSedan"))
    taps = design_taps(plant, load_weights(WEIGHTED_CONTROLLERS[weights][1]), 1e-3, 600)
    before = 400
    past = {k: np.concatenate([np.zeros(before), height[k]]) for k in ("fl", "fr")}

    def feed_forward(k: int) -> np.ndarray:
        u = np.zeros(4)
        points = np.arange(0, 236, 5)
        for side in ("fl", "fr"):
            ahead = np.interp(np.arange(236), points, height[side][k + points])
            road = np.concatenate([past[side][: before + k], ahead])  # index before + k is now
            front = tp if controller == "preview" else 0
            rear = front + int(tau) if controller != "active" else 0
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
        with Runner(EXPERIMENT, FmuSet(fmus.directory, fmi)) as one:
            results.append(one.record(Case("left", "road-holding", "preview")).data)
    np.testing.assert_array_equal(*results)


def test_standstill_is_defined(runner: Runner) -> None:
    recording = runner.record(Case(speed_kmh=0.0), stop_time=0.1)
    assert recording["controller.horizon_truncated"].all()
    assert np.abs(recording["controller.force.rl"]).max() == 0.0


def test_a_road_with_another_step_is_refused(fmus: FmuSet) -> None:
    """The GPC roads look ahead in steps of 10 ms: the master says so when they are wired."""
    with System() as system:
        system.add("road", fmus.path("RoadSine"))
        system.add("controller", fmus.path("PreviewLqComfort"))
        with pytest.raises(WiringError, match=r"preview\.step.* must equal 0\.005 s, not 0\.01 s"):
            system.connect("road.preview.step", "controller.preview.step")


def test_horizon_beyond_the_preview_is_told(runner: Runner) -> None:
    run = runner.run(Case(preview_time=0.5), stop_time=0.05)
    assert run.recording["controller.horizon_truncated"].all()


@pytest.mark.parametrize("weights", ["comfort", "road-holding"])
@pytest.mark.parametrize("controller", ["active", "delay", "preview"])
def test_the_tunable_law_with_published_weights_is_the_published_law(
    fmus: FmuSet, controller: str, weights: str
) -> None:
    """Designed by the FMU as it is initialized.

    The numbers are those of the FMU that was designed in Python, to rounding.
    """
    case = Case(controller=controller, weights=weights)
    with Runner(EXPERIMENT, fmus) as runner:
        expected, found = runner.metrics(case), runner.metrics(replace(case, tunable=True))
    assert found == pytest.approx(expected, rel=1e-10)


WITHOUT_LAW = {
    "acceleration.heave": 1e4,
    "acceleration.pitch": 1e4,
    "acceleration.roll": 0.0,
    "suspension.front": 1e7,
    "suspension.rear": 0.0,
    "tire.front": 1.0,
    "tire.rear": 1e8,
    "force.front": 1e-9,
    "force.rear": 1e-9,
}


def test_weights_without_a_law_are_refused(fmus: FmuSet, raises) -> None:
    """Doubling ends with numbers all the same, and these would be no law."""
    with Runner(EXPERIMENT, fmus) as runner:
        system = runner.system(Case(tunable=True))
        system["controller"].set({f"weight.{n}": v for n, v in WITHOUT_LAW.items()})
        with raises(CosimError):
            system.run(0.01)


def test_weights_of_a_tunable_law_are_those_of_the_case(fmus: FmuSet, tmp_path: Path) -> None:
    """Also those of a file, without an FMU of its own; a heavier weight of the tires holds the road better."""
    mine = tmp_path / "mine.toml"
    text = (files("fmu_sources.controllers.lq") / "weights" / "comfort.toml").read_text()
    mine.write_text(text.replace("front = 12000.0", "front = 120000.0").replace("rear = 11000.0", "rear = 110000.0"))
    with Runner(EXPERIMENT, fmus) as runner:
        base, heavy = (runner.metrics(Case(weights=w, tunable=True)) for w in ("comfort", str(mine)))
    tires = [f"tire.{k}.deflection" for k in CORNERS]
    assert sum(heavy[t] for t in tires) < 0.8 * sum(base[t] for t in tires)
    assert heavy["body.az"] > base["body.az"]
