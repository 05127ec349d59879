"""Quarter car against closed forms."""

import numpy as np
import pytest

from build_fmus.reference import Evaluator, simulate
from build_fmus.stability import check_solver
from fmu_sources.plants import quarter_car
from fmu_sources.vehicles import load_quarter_car


@pytest.fixture(scope="module")
def car():
    return quarter_car(load_quarter_car("quarter_car_hmmwv"))


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
    run = Evaluator(car, {"body.mass": 1400.0})
    run.u[:] = 0, 0, 1000.0
    values = dict(zip((e.name for e in car.output_elements()), run.outputs(), strict=True))
    assert values["body.az"] == pytest.approx(1000 / 1400)


def test_reference_run_is_finite_and_solver_stable(car):
    check_solver(car)
    assert np.isfinite(simulate(car).outputs).all()
