"""Control laws of semi-active dampers: definitions, the range of the damper, symmetry, clipped LQR within it."""

from __future__ import annotations

import numpy as np
import pytest
from named import Named

from fmu_sources.controllers.lq.hmmwv import lqr_gain
from fmu_sources.controllers.mpc.semi_active import semi_active_mpc, semi_active_settings
from fmu_sources.controllers.semi_active import (
    CROSSOVER,
    PERIOD,
    WEIGHTS,
    semi_active_add,
    semi_active_hook,
    semi_active_lqr,
)
from fmu_sources.models.corners import CORNERS
from fmu_sources.models.hmmwv_states import FORCES, RELATIVE_STATES
from fmu_sources.plants import ride_car
from fmu_sources.plants.semi_active_damper import LARGEST_CURRENT, LEAST, MOST, VELOCITY
from fmu_sources.vehicles import load_ride_car

HALF_TRACK, AHEAD = 0.91, {"f": 1.651, "r": -1.651}
DAMPING = 6000.0
MOTION = ("body.vz", "body.roll_rate", "body.pitch_rate")
ACCELERATION = ("body.az", "body.roll_acceleration", "body.pitch_acceleration")
MIRROR = {"l": "r", "r": "l"}


@pytest.fixture(scope="module")
def car():
    return ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")


@pytest.fixture(scope="module")
def laws(car):
    return {
        "skyhook": semi_active_hook(car).model(),
        "groundhook": semi_active_hook(car, hook="ground").model(),
        "add": semi_active_add(car).model(),
        "sh-add": semi_active_add(car, mixed=True).model(),
        "lqr": semi_active_lqr(car).model(),
    }


def states(seed: int, size: float = 1.0) -> dict[str, float]:
    """Random inputs of any law."""
    rng = np.random.default_rng(seed)
    sizes = [0.03] * 4 + [0.005] * 4 + [0.6] * 4 + [0.4, 0.3, 0.3, 4.0, 4.0, 4.0]
    names = (*RELATIVE_STATES, *ACCELERATION)
    return {n: float(rng.normal(0, size * s)) for n, s in zip(names, sizes, strict=True)}


def at_corner(x: dict[str, float], k: str, names=MOTION) -> float:
    heave, roll, pitch = (x[n] for n in names)
    return heave + (1 if k[1] == "l" else -1) * HALF_TRACK * roll - AHEAD[k[0]] * pitch


def shown(model, x, **parameters):
    """Outputs by name for those inputs that the law has."""
    run = Named(model, {n.replace("__", "."): v for n, v in parameters.items()})
    return run.put({n: v for n, v in x.items() if n in run.slots}).shown()


def resistance(velocity: float, share: float) -> float:
    least, most = (np.sign(velocity) * np.interp(abs(velocity), (0.0, *VELOCITY), (0.0, *c)) for c in (LEAST, MOST))
    return least + share * (most - least)


@pytest.mark.parametrize("seed", range(12))
def test_on_off_laws_are_their_definitions(laws, seed):
    """The condition of each paper decides between both curves, corner by corner."""
    x = states(seed)
    found = {
        "skyhook": shown(laws["skyhook"], x, on_off=True),
        "groundhook": shown(laws["groundhook"], x, on_off=True),
        "add": shown(laws["add"], x),
        "sh-add": shown(laws["sh-add"], x),
    }
    for k in CORNERS:
        body, wheel, a = at_corner(x, k), x[f"wheel.{k}.vz"], at_corner(x, k, ACCELERATION)
        v = body - wheel
        slow = a**2 <= CROSSOVER**2 * body**2
        on = {
            "skyhook": body * v > 0,
            "groundhook": -wheel * v > 0,
            "add": a * v > 0,
            "sh-add": (slow and body * v > 0) or (not slow and a * v > 0),
        }
        for law, most in on.items():
            assert found[law][f"current.{k}"] == LARGEST_CURRENT * most, law
            expected = -resistance(v, float(most))
            assert found[law][f"force.{k}"] == pytest.approx(np.clip(expected, -8000, 8000), rel=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_continuous_laws_give_the_nearest_resistance(laws, seed):
    """Requests within the range are met, others clipped to the curve; no force ever drives the car."""
    x = states(seed, 0.5)
    for law, hooks in {"skyhook": (10e3, 0.0), "groundhook": (0.0, 6e3)}.items():
        found = shown(laws[law], x)
        for k in CORNERS:
            body, wheel = at_corner(x, k), x[f"wheel.{k}.vz"]
            v = body - wheel
            request = hooks[0] * body - hooks[1] * wheel + 1500.0 * v
            low, high = sorted([resistance(v, 0.0), resistance(v, 1.0)])
            assert found[f"force.{k}"] == pytest.approx(-np.clip(request, low, high), rel=1e-9)
            assert found[f"force.{k}"] * v <= 0
            current = found[f"current.{k}"]
            assert -resistance(v, current / LARGEST_CURRENT) == pytest.approx(found[f"force.{k}"], rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_left_and_right_are_alike(laws, seed):
    """The mirrored motion gives the mirrored currents and forces."""
    x = states(seed, 0.4)
    mirrored = {n: -v if "roll" in n else v for n, v in x.items()}
    for n in x:
        if any(f".{k}." in n for k in CORNERS):
            kind, k, what = n.split(".")
            mirrored[f"{kind}.{k[0]}{MIRROR[k[1]]}.{what}"] = x[n]
    for law in laws.values():
        one, other = shown(law, x), shown(law, mirrored)
        for k in CORNERS:
            for kind in ("force", "current"):
                expected = one[f"{kind}.{k}"]
                assert other[f"{kind}.{k[0]}{MIRROR[k[1]]}"] == pytest.approx(expected, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_active_laws_give_their_request(car, laws, seed):
    """Ideal actuators: the LQR on the car with its own dampers, skyhook without a damper; no current."""
    x = states(seed, 0.2)
    K, _ = lqr_gain(car, WEIGHTS, PERIOD)
    control = -K @ [x[n] for n in RELATIVE_STATES]
    lqr, skyhook = (shown(laws[law], x, passive=False) for law in ("lqr", "skyhook"))
    for k, u in zip(CORNERS, control, strict=True):
        body = at_corner(x, k)
        v = body - x[f"wheel.{k}.vz"]
        assert lqr[f"force.{k}"] == pytest.approx(np.clip(u - DAMPING * v, -8000, 8000), rel=1e-6)
        assert skyhook[f"force.{k}"] == pytest.approx(np.clip(-10e3 * body - 1500.0 * v, -8000, 8000), rel=1e-9)
        assert lqr[f"current.{k}"] == skyhook[f"current.{k}"] == 0.0


def test_clipped_lqr_is_the_lqr_within_the_range(laws):
    """Whenever the active request lies between the curves, the semi-active force is the same, else at a curve."""
    inside = outside = 0
    for seed in range(40):
        x = states(seed, 0.2)
        active, clipped = shown(laws["lqr"], x, passive=False), shown(laws["lqr"], x)
        for k, force in zip(CORNERS, FORCES, strict=True):
            v = at_corner(x, k) - x[f"wheel.{k}.vz"]
            low, high = sorted([-resistance(v, 0.0), -resistance(v, 1.0)])
            if low <= active[force] <= high:
                inside += 1
                assert clipped[force] == pytest.approx(active[force], rel=1e-9)
            else:
                outside += 1
                assert clipped[force] == pytest.approx(low if active[force] < low else high, rel=1e-9)
    assert min(inside, outside) > 20


def test_damper_at_rest_gets_no_force(laws):
    """Both curves meet at no velocity: there is nothing to choose."""
    for law in laws.values():
        still = shown(law, dict.fromkeys((*RELATIVE_STATES, *ACCELERATION), 0.0))
        assert [still[f] for f in FORCES] == [0.0] * 4


@pytest.fixture(scope="module")
def mpc(car):
    return semi_active_mpc(car).model()


@pytest.mark.parametrize("seed", range(8))
def test_mpc_keeps_within_the_damper_and_solves(mpc, seed):
    """Every force is between the curves at the velocity now; the program is solved."""
    x = states(seed)
    found = shown(mpc, x)
    assert (found["solver.status"], found["command.held"]) == (0, 0)
    assert found["solver.residual"] < 1e-6
    for k in CORNERS:
        v = at_corner(x, k) - x[f"wheel.{k}.vz"]
        low, high = sorted([-resistance(v, 0.0), -resistance(v, 1.0)])
        assert low - 1e-6 <= found[f"force.{k}"] <= high + 1e-6
        assert found[f"force.{k}"] * v <= 0


def riccati(model, weights, force, steps):
    """Gain (nu, n) of the first of `steps` commands by dynamic programming; outputs are those before the next one."""
    Cy, Dy = model.C @ model.A, model.C @ model.B + model.D
    P, Q = np.zeros_like(model.A), np.diag(weights)
    for i in range(steps):
        R = force * np.eye(len(model.inputs)) * (2 if i == 0 else 1)  # the last command counts at both of its ends
        H = Dy.T @ Q @ Dy + R + model.B.T @ P @ model.B
        K = np.linalg.solve(H, Dy.T @ Q @ Cy + model.B.T @ P @ model.A)
        P = Cy.T @ Q @ Cy + model.A.T @ P @ model.A - K.T @ H @ K
    return K


def test_mpc_without_the_constraint_is_the_unconstrained_optimum(car):
    """Small motion with ideal actuators: the command of dynamic programming for the same index."""
    settings = semi_active_settings(car, (1,) * 12)
    K = riccati(settings.model, [o.weight**2 for o in settings.outputs], WEIGHTS.force, 12)
    mpc = semi_active_mpc(car, blocks=(1,) * 12).model()
    for seed in range(5):
        x = states(seed, 0.02)
        found = shown(mpc, x, passive=False)
        u = -K @ [x[n] for n in RELATIVE_STATES]
        for k, request in zip(CORNERS, u, strict=True):
            v = at_corner(x, k) - x[f"wheel.{k}.vz"]
            assert found[f"force.{k}"] == pytest.approx(request - DAMPING * v, rel=1e-6, abs=1e-3)
