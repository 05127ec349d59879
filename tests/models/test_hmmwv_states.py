"""The 15 relative states of the HMMWV: names, units, signs, and the model in them against the car itself."""

from __future__ import annotations

import numpy as np
import pytest
from named import Named

from build_fmus.component import Component
from fmu_sources.models import hmmwv_states as states
from fmu_sources.models.corners import CORNERS
from fmu_sources.models.hmmwv_states import RELATIVE_STATES, relative_inputs, relative_model
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car

DYNAMIC = ("body.az", "body.roll_acceleration", "body.pitch_acceleration", *(f"wheel.{k}.az" for k in CORNERS))


@pytest.fixture(scope="module")
def car():
    return ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")


@pytest.fixture(scope="module")
def model(car):
    return relative_model(car)


@pytest.fixture
def anywhere(car):
    """The car at random states, forces and road, with its outputs by name, its derivatives and its inputs.

    Its tires take tension: the model is that of a car on the road.
    """
    evaluator = Named(car.model(), {"tires.lift_off": False})
    rng = np.random.default_rng(3)
    evaluator.x[:] = rng.normal(size=evaluator.x.size)
    evaluator.u[:] = rng.normal(size=evaluator.u.size) * [
        1000.0 if "force" in n else 1.0 for n in car.linearize().inputs
    ]
    outputs = evaluator.shown()
    inputs = dict(zip(car.linearize().inputs, evaluator.u, strict=True))
    return outputs, inputs


def test_names_and_units_are_those_of_the_car(car):
    outputs = {e.name for e in car.model().output_elements()}
    assert len(RELATIVE_STATES) == len(set(RELATIVE_STATES)) == 15
    assert set(RELATIVE_STATES) <= outputs
    units = [car.variable(n).unit for n in RELATIVE_STATES]
    assert units == ["m"] * 8 + ["m/s"] * 5 + ["rad/s"] * 2

    component = Component("Any", kind="discrete", sample_time=0.03, description="", source="none")
    column = relative_inputs(component, car)
    assert column.shape == (15, 1)
    assert [(e.name, e.variable.unit) for e in component.model().elements("input")] == list(
        zip(RELATIVE_STATES, units, strict=True)
    )


def test_the_map_gives_the_outputs_of_the_car(model, anywhere, car):
    outputs, inputs = anywhere
    x = model.T @ [outputs[n] for n in model.absolute] + model.R @ [inputs[n] for n in states.ROAD_HEIGHTS]
    assert x == pytest.approx([outputs[n] for n in RELATIVE_STATES], rel=1e-12, abs=1e-12)
    assert model.absolute == tuple(car.linearize().states)


def test_signs():
    """Deflection grows when the body rises; a road that rises shortens the tire; a force lifts body, pushes wheel."""
    m = relative_model(ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv"))
    row = {n: i for i, n in enumerate(RELATIVE_STATES)}
    fl = 0
    assert m.A[row["suspension.fl.deflection"], row["body.vz"]] == pytest.approx(1)
    assert m.A[row["suspension.fl.deflection"], row["wheel.fl.vz"]] == pytest.approx(-1)
    assert m.A[row["suspension.fl.deflection"], row["body.pitch_rate"]] < 0  # nose down shortens the front
    assert m.A[row["suspension.fl.deflection"], row["body.roll_rate"]] > 0  # left side up lengthens the left
    assert m.E[row["tire.fl.deflection"], fl] == pytest.approx(-1)
    assert m.B[row["body.vz"], fl] > 0 > m.B[row["wheel.fl.vz"], fl]


def test_the_model_has_the_derivatives_and_outputs_of_the_car(model, anywhere):
    outputs, inputs = anywhere
    x = np.array([outputs[n] for n in RELATIVE_STATES])
    u, w = (np.array([inputs[n] for n in group]) for group in (states.FORCES, states.ROAD_RATES))
    dx = dict(zip(RELATIVE_STATES, model.A @ x + model.B @ u + model.E @ w, strict=True))
    for k in CORNERS:
        assert dx[f"suspension.{k}.deflection"] == pytest.approx(outputs[f"suspension.{k}.velocity"])
        assert dx[f"tire.{k}.deflection"] == pytest.approx(outputs[f"wheel.{k}.vz"] - inputs[f"road.{k}.rate"])
        assert dx[f"wheel.{k}.vz"] == pytest.approx(outputs[f"wheel.{k}.az"])
    assert [dx[n] for n in states.BODY_SPEED] == pytest.approx([outputs[n] for n in (DYNAMIC[0], *DYNAMIC[1:3])])
    C, D, F = model.output(DYNAMIC)
    assert C @ x + D @ u + F @ w == pytest.approx([outputs[n] for n in DYNAMIC])


def test_the_warp_of_the_road_is_the_one_mode_that_is_no_motion(model):
    assert np.linalg.matrix_rank(model.T) == len(model.absolute) == 14
    still = np.abs(np.linalg.eigvals(model.A)) < 1e-6
    assert still.sum() == 1
    warp = np.array([1, -1, -1, 1, 1, -1, -1, 1, *[0] * 7], dtype=float)
    assert warp @ model.T == pytest.approx(np.zeros(14))
    assert warp @ model.A == pytest.approx(np.zeros(15), abs=1e-9)
    assert warp @ model.B == pytest.approx(np.zeros(4), abs=1e-9)


def test_an_absolute_height_is_refused(model, refused):
    refused(ValueError, lambda: model.output(["body.az", "body.z"]), lambda: model.output(["body.zz"]))
