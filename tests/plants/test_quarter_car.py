"""Quarter car against closed forms."""

import numpy as np
import pytest
from named import Named

from build_fmus.reference import Evaluator, simulate
from build_fmus.stability import check_solver
from fmu_sources.plants import quarter_car
from fmu_sources.vehicles import load_quarter_car


@pytest.fixture(scope="module")
def car():
    return quarter_car(load_quarter_car("quarter_car_hmmwv")).model()


def test_state_matrix_is_that_of_equation_1_1(car):
    ms, mu, ks, cs, kt, ct = 2800.0, 270.0, 240e3, 12e3, 1e6, 200.0
    A = [
        [0, 1, 0, 0],
        [-ks / ms, -cs / ms, ks / ms, cs / ms],
        [0, 0, 0, 1],
        [ks / mu, cs / mu, -(ks + kt) / mu, -(cs + ct) / mu],
    ]
    B = [[0, 0, 0], [0, 0, 1 / ms], [0, 0, 0], [kt / mu, ct / mu, -1 / mu]]
    model = car.linearize()
    assert model.states == ["body.z", "body.vz", "wheel.z", "wheel.vz"]
    assert model.inputs == ["road.height", "road.rate", "force"]
    np.testing.assert_allclose(model.A, A, rtol=1e-14)
    np.testing.assert_allclose(model.B, B, rtol=1e-14)


def test_static_response(car):
    """A lasting force F lifts the body by F/ks; a raised road lifts everything."""
    model = car.linearize()
    dc = model.D - model.C @ np.linalg.solve(model.A, model.B)
    rows = {n: dc[i] for i, n in enumerate(model.outputs)}
    assert rows["body.z"] == pytest.approx([1, 0.0002, 1 / 240e3])
    assert rows["suspension.deflection"] == pytest.approx([0, 0, 1 / 240e3], abs=1e-15)
    assert rows["tire.deflection"] == pytest.approx([0, 0.0002, 0], abs=1e-15)


def test_parameters_take_effect(car):
    shown = Named(car, {"body.mass": 1400.0}).put(force=1000.0).shown()
    assert shown["body.az"] == pytest.approx(1000 / 1400)


def test_reference_run_is_finite_and_solver_stable(car):
    check_solver(car)
    assert np.isfinite(simulate(car).outputs).all()


def test_friction_is_an_option_that_only_dissipates(car):
    """Off by default. On: 120 N against the suspension velocity, on body and wheel, smoothed below 0.01 m/s."""
    x = np.zeros(4)
    for v in (-1.0, -0.3, 0.005, 0.2, 2.0):
        x[1] = v
        runs = []
        for on in (True, False):
            run = Evaluator(car, {"friction.acting": on})
            run.x = x
            runs.append(run.rhs(0.0, run.x))
        change = runs[0] - runs[1]
        force = -120.0 * v / np.hypot(v, 0.01)
        assert change[1] * 2800.0 == pytest.approx(force, rel=1e-9)
        assert change[3] * 270.0 == pytest.approx(-force, rel=1e-9)
        assert change[1] * 2800.0 * v < 0


def test_friction_decays_motion_without_dampers(car):
    """No damping but friction: energy falls at every step of a free motion, and 1 s takes most of it."""
    still = {
        "suspension.damping": 0.0,
        "tire.damping": 0.0,
        "friction.acting": True,
        "suspension.friction.force": 2000.0,
    }
    run = Evaluator(car, still)
    run.x = [0.02, 0.0, 0.0, 0.0]

    def energy(x):
        zb, vb, zw, vw = x
        return (2800 * vb**2 + 270 * vw**2 + 240e3 * (zb - zw) ** 2 + 1e6 * zw**2) / 2

    before = first = energy(run.x)
    for _ in range(1000):
        run.step(1e-3)
        assert energy(run.x) < before * (1 + 1e-9)
        before = energy(run.x)
    assert before < 0.2 * first
