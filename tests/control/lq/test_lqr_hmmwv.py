"""The LQR of the HMMWV: optimal on the car, mapped to relative states, the two readings of its weights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from build_fmus.reference import Evaluator
from fmu_sources.controllers.lq.hmmwv import (
    SAMPLE_TIME,
    TABLE_1_1,
    TABLE_1_1_KILONEWTON,
    LqrWeights,
    lqr_gain,
    lqr_hmmwv,
)
from fmu_sources.models.hmmwv_states import FORCES, RELATIVE_STATES, ROAD_HEIGHTS, SUSPENSION, relative_model
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car


@pytest.fixture(scope="module")
def car():
    return ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")


def sampled(car):
    """Ad, Bd of the car at 30 ms, zero-order hold of the forces, flat road."""
    lin = car.linearize()
    B = lin.B[:, [lin.inputs.index(n) for n in FORCES]]
    n, m = B.shape
    step = expm(SAMPLE_TIME * np.block([[lin.A, B], [np.zeros((m, n + m))]]))
    return lin, step[:n, :n], step[:n, n:]


def cost_over_a_sample(car, weights, parts=3000):
    """Q, N, R of one sample by summation over fine steps (midpoints): another way than the design takes."""
    lin, _, _ = sampled(car)
    B = lin.B[:, [lin.inputs.index(n) for n in FORCES]]
    kinds = [
        ("body.az", weights.acceleration),
        ("body.roll_rate", weights.rates),
        ("body.pitch_rate", weights.rates),
        *((n, weights.travel) for n in SUSPENSION),
        *((f"wheel.{k}.vz", weights.hub_velocity) for k in ("fl", "fr", "rl", "rr")),
        *((f"tire.{k}.deflection", weights.tire) for k in ("fl", "fr", "rl", "rr")),
    ]
    rows = [lin.outputs.index(n) for n, _ in kinds]
    out = np.hstack([lin.C[rows], lin.D[np.ix_(rows, [lin.inputs.index(n) for n in FORCES])]])
    w = np.array([v for _, v in kinds])
    h = SAMPLE_TIME / parts
    n, m = B.shape
    generator = np.block([[lin.A, B], [np.zeros((m, n + m))]])
    fine, now = expm(h * generator), expm(h / 2 * generator)
    total = np.zeros((n + m, n + m))
    for _ in range(parts):
        y = out @ now
        total += h * (y.T * w) @ y
        now = fine @ now
    total[n:, n:] += SAMPLE_TIME * weights.force * np.eye(m)
    return total[:n, :n], total[:n, n:], total[n:, n:]


@pytest.mark.parametrize("weights", [TABLE_1_1, TABLE_1_1_KILONEWTON], ids=["newton", "kilonewton"])
def test_gain_solves_the_sampled_riccati_equation(car, weights):
    _, Ad, Bd = sampled(car)
    Q, N, R = cost_over_a_sample(car, weights)
    P = solve_discrete_are(Ad, Bd, Q, R, s=N)
    expected = np.linalg.solve(R + Bd.T @ P @ Bd, Bd.T @ P @ Ad + N.T)
    _, absolute = lqr_gain(car, weights)
    assert np.abs(absolute - expected).max() < 1e-4 * np.abs(expected).max()
    assert np.abs(np.linalg.eigvals(Ad - Bd @ absolute)).max() < 1


@pytest.mark.parametrize("weights", [TABLE_1_1, TABLE_1_1_KILONEWTON], ids=["newton", "kilonewton"])
def test_relative_gain_is_the_absolute_one_and_leaves_the_warp_of_the_road_out(car, weights):
    relative, absolute = lqr_gain(car, weights)
    model = relative_model(car)
    assert relative @ model.T == pytest.approx(absolute, rel=1e-9, abs=1e-9 * np.abs(absolute).max())
    warp = np.array([1, -1, -1, 1, 1, -1, -1, 1, *[0] * 7], dtype=float)
    assert np.abs(relative @ warp).max() < 1e-9 * np.abs(relative).max()


def test_mirrored_states_give_mirrored_forces(car):
    """Left and right, and front and rear of this car (its CG is in the middle), are alike."""
    gain, _ = lqr_gain(car, TABLE_1_1)
    left_right = [1, 0, 3, 2]
    front_rear = [2, 3, 0, 1]
    for swap, signs in ((left_right, (1, -1, 1)), (front_rear, (1, 1, -1))):
        order = [4 * g + s for g in range(3) for s in swap] + [12, 13, 14]
        mirrored = gain[swap][:, order] * np.array([1.0] * 12 + list(signs))
        assert mirrored == pytest.approx(gain, abs=1e-6 * np.abs(gain).max())


def test_the_component_applies_the_gain(car):
    controller = lqr_hmmwv(car).model()
    gain, _ = lqr_gain(car, TABLE_1_1)
    evaluator = Evaluator(controller)
    assert [e.name for e in controller.elements("input")] == [*RELATIVE_STATES, "body.az"]
    x = np.random.default_rng(1).normal(size=15) * 0.05
    evaluator.u[:15], evaluator.u[15] = x, 3.0
    assert evaluator.outputs()[:4] == pytest.approx(-gain @ x)
    assert controller.sample_time == 0.030
    other = Evaluator(controller, {"gain[1,1]": 1e6})  # tunable: a new design needs no rebuild
    other.u[0] = 0.05
    assert other.outputs()[0] == -8000.0
    assert other.outputs()[4] == 1  # limited


def test_newton_is_small_and_kilonewton_saturates(car):
    """On the published track the first asks for hundreds of newtons, the second for thousands."""
    lin, Ad, Bd = sampled(car)
    heights = lin.B[:, [lin.inputs.index(n) for n in ROAD_HEIGHTS]]
    kick = expm(lin.A * 0.01) @ heights @ np.array([0.045, 0.045, 0, 0]) * 0.03  # 45 mm under the front for 30 ms
    largest = {}
    for name, weights in (("newton", TABLE_1_1), ("kilonewton", TABLE_1_1_KILONEWTON)):
        _, K = lqr_gain(car, weights)
        x, peak = kick.copy(), 0.0
        for _ in range(40):
            u = -K @ x
            peak = max(peak, np.abs(u).max())
            x = Ad @ x + Bd @ u
        largest[name] = peak
    assert 20 < largest["newton"] < 500
    assert largest["kilonewton"] > 5000
    assert largest["kilonewton"] > 20 * largest["newton"]


@pytest.mark.parametrize(
    ("field", "value"), [("force", 0.0), ("travel", -1.0), ("tire", math.nan), ("rates", math.inf)]
)
def test_bad_weights(field, value, raises):
    with raises(ValueError, match=f"(?s){field}.*{value:g}"):
        LqrWeights(**{**TABLE_1_1.__dict__, field: value})
