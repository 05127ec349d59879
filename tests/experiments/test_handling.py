"""Metrics of handling: a linear bicycle model with known answers, hand-written signals; and manoeuvres that mirror."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.experiments.handling import EXPERIMENT, metrics
from cosim.experiments.handling.published import plan
from cosim.experiments.handling.runs import CARS, MANOEUVRES, OPEN, Case, path_points, table
from cosim.experiments.handling.web import COURSES, cones
from cosim.scenes.scene import Cone
from cosim.study.case import CaseError
from cosim.study.experiment import Run
from cosim.study.fmus import FmuSet
from fmu_sources.vehicles import load_full_car

TIME = np.arange(0.0, 20.0, 1e-3)


def bicycle(steer, mass, inertia, front, rear, stiff_front, stiff_rear, speed):
    """Yaw rate [rad/s], lateral acceleration [m/s2] and side slip [rad] of the linear bicycle model, by midpoint."""
    A = np.array(
        [
            [
                -(stiff_front + stiff_rear) / (mass * speed),
                -1 + (rear * stiff_rear - front * stiff_front) / (mass * speed**2),
            ],
            [
                (rear * stiff_rear - front * stiff_front) / inertia,
                -(front**2 * stiff_front + rear**2 * stiff_rear) / (inertia * speed),
            ],
        ]
    )
    B = np.array([stiff_front / (mass * speed), front * stiff_front / inertia])
    h = TIME[1] - TIME[0]
    left, x, states = np.linalg.inv(np.eye(2) - h / 2 * A), np.zeros(2), [np.zeros(2)]
    for a, b in pairwise(steer):
        x = left @ (x + h / 2 * (A @ x) + h * B * (a + b) / 2)
        states.append(x)
    slip, yaw_rate = np.array(states).T
    slip_rate = A[0] @ np.array(states).T + B[0] * steer
    return yaw_rate, speed * (slip_rate + yaw_rate), slip


CAR = {
    "mass": st.floats(800, 5000),
    "front": st.floats(0.9, 2.0),
    "rear": st.floats(0.9, 2.0),
    "front_per_load": st.floats(6.0, 20.0),
    "rear_per_load": st.floats(6.0, 20.0),
    "speed": st.floats(8.0, 20.0),
}


@settings(max_examples=25, deadline=None)
@given(**CAR, sign=st.sampled_from([1, -1]))
def test_understeer_gradient_is_that_of_the_linear_bicycle(
    mass, front, rear, front_per_load, rear_per_load, speed, sign
):
    g, base = 9.81, front + rear
    stiff = front_per_load * mass * g * rear / base, rear_per_load * mass * g * front / base
    exact = mass / base * (rear / stiff[0] - front / stiff[1])
    if base + exact * speed**2 < 0.3 * base:  # near or beyond its critical speed it has no steady turn
        return
    steer = sign * TIME / 20.0 * 4.0 * (base / speed**2 + exact)
    yaw_rate, ay, _ = bicycle(steer, mass, mass * front * rear, front, rear, *stiff, speed)
    found = metrics.understeer_gradient(steer, yaw_rate, np.full(len(TIME), speed), ay, base)
    assert found == pytest.approx(exact, abs=2e-3 * base / speed**2 + 0.02 * abs(exact))


def test_step_response_of_the_linear_bicycle():
    steer = 0.02 * np.clip((TIME - 1.0) / 1e-2, 0, 1)
    stiff = (60e3, 80e3)
    yaw_rate, ay, slip = bicycle(steer, 1500.0, 2500.0, 1.2, 1.4, *stiff, 20.0)
    gradient = 1500.0 / 2.6 * (1.4 / stiff[0] - 1.2 / stiff[1])
    assert metrics.settled(yaw_rate) / 0.02 == pytest.approx(20.0 / (2.6 + gradient * 400.0), rel=1e-6)
    assert metrics.settled(ay) == pytest.approx(20.0 * metrics.settled(yaw_rate), rel=1e-6)
    at = metrics.response_time(TIME, steer, yaw_rate)
    assert yaw_rate[round((1.005 + at) * 1e3)] == pytest.approx(0.9 * metrics.settled(yaw_rate), rel=0.01)
    assert metrics.overshoot(yaw_rate) == pytest.approx(yaw_rate.max() / yaw_rate[-1] - 1, abs=1e-6)
    yaw = np.cumsum(yaw_rate) * 1e-3
    vx, vy = (20.0 * f(yaw + slip) for f in (np.cos, np.sin))
    assert metrics.side_slip(vx, vy, yaw) == pytest.approx(slip, abs=1e-12)


@pytest.mark.parametrize("late", [0, 7, 130])
def test_delay_is_that_of_a_shifted_signal(late):
    steer = np.where((TIME > 1) & (TIME < 3), np.sin(np.pi * (TIME - 1)), 0.0)
    assert metrics.delay(TIME, steer, 3.0 * np.roll(steer, late)) == pytest.approx(1e-3 * late)


def test_signals_by_hand():
    assert np.isnan(metrics.understeer_gradient(*(np.zeros(50),) * 2, np.ones(50), np.zeros(50), 2.0))
    assert np.isnan(metrics.reach_time(TIME, np.zeros(len(TIME)), 0.9, 1.0))
    assert metrics.overshoot(np.zeros(10)) == 0.0
    index = metrics.rollover_index(np.array([10.0, 5.0, 0.0, 0.0]), np.array([10.0, 15.0, 20.0, 0.0]))
    assert index.tolist() == [0.0, 0.5, 1.0, 0.0]


@pytest.mark.parametrize("name", OPEN)
def test_tables_of_inputs(name):
    left, right = (table(MANOEUVRES[name], side) for side in (0.7, -0.7))
    assert (np.diff(left["time"]) > 0).all()
    assert (left["steering.wheel"] == -right["steering.wheel"]).all()
    assert np.abs(left["steering.wheel"]).max() == pytest.approx(0.7)
    assert left["steering.wheel"][left["time"] <= 1.0].max() == 0.0
    if name == "sine-with-dwell":
        dwell = np.isclose(left["steering.wheel"], -0.7)
        assert left["time"][dwell][-1] - left["time"][dwell][0] == pytest.approx(0.5, abs=0.011)


def test_paths_have_all_points_of_the_driver():
    values = path_points(((0, 0), (100, 0), (200, 4)))
    assert values["path.x[64]"] == 200.0
    assert values["path.y[64]"] == 4.0
    assert values["path.y[1]"] == 0.0


@pytest.mark.parametrize("manoeuvre", COURSES)
def test_cones_stand_along_the_lanes_of_the_path(manoeuvre):
    """In pairs, as far from the middle of the path as a lane for this car is wide."""
    width, course = 2.0, MANOEUVRES[manoeuvre]
    x, y = np.array(course.path, dtype=float).T
    found = cones(course, width)
    assert len(found) > 12
    for left, right in zip(found[::2], found[1::2], strict=True):
        assert left.x == right.x
        assert (left.y + right.y) / 2 == pytest.approx(np.interp(left.x, x, y))
        assert width + 0.2 < left.y - right.y - 2 * Cone.radius < 1.3 * width + 1.0
    lanes = sorted({c.x for c in found})
    assert (lanes[0], lanes[-1]) == (x[1], x[-2])
    gaps = [(a, b) for a, b in pairwise(lanes) if b - a > 5.0 + 1e-9]
    assert gaps == [(x[2], x[3]), (x[4], x[5])]  # where the car changes from lane to lane


def test_cones_of_the_double_lane_change_are_those_of_the_standard():
    found = cones(MANOEUVRES["lane-change"], 2.0)
    inner = {c.x: abs(c.y - a.y) - 2 * c.radius for c, a in zip(found[::2], found[1::2], strict=True)}
    assert [inner[x] for x in (50.0, 120.0, 160.0)] == pytest.approx([2.45, 2.65, 2.85])


@pytest.mark.usefixtures("built_fmus")
def test_where_a_person_drives_there_is_no_driver():
    case = Case(driven=True)
    with run_of(case) as system:
        assert list(system.components) == ["car"]
        recording = system.run(1.0, record=EXPERIMENT.run.recorded(case))
    found = EXPERIMENT.measures.measure(Run(case, recording, system))
    assert found["ay_peak"] == pytest.approx(0.0, abs=1e-6)
    assert "offset" not in found
    with pytest.raises(CaseError, match="manoeuvres with a driver"):
        Case(manoeuvre="step", driven=True)


def run_of(case):
    return EXPERIMENT.wiring.wire(FmuSet(), case)


@pytest.mark.usefixtures("built_fmus")
@pytest.mark.parametrize("car", CARS)
def test_a_step_steered_left_and_right_mirrors(car):
    """The linear gain of the full car is near that of the bicycle with its tires, which steers neutrally."""
    rows = []
    for angle in (15.0, -15.0):
        case = Case(car, "step", 50.0, angle)
        system = run_of(case)
        with system:
            recording = system.run(4.0, record=list(EXPERIMENT.run.recorded(case)))
            rows.append(EXPERIMENT.measured(Run(case, recording, system)))
    for name, value in rows[0].items():
        assert rows[1][name] == pytest.approx(value, rel=1e-6, abs=1e-9)
    if car == "hmmwv":
        vehicle = load_full_car("hmmwv")
        base = vehicle.body.wheelbase.value
        assert rows[0]["yaw_gain"] == pytest.approx(50 / 3.6 / base / vehicle.steering.ratio.value, rel=0.1)


def test_plan_has_every_manoeuvre_of_every_car():
    assert {(t.case.car, t.case.manoeuvre) for t in plan()} == {(c, m) for c in CARS for m in MANOEUVRES}
