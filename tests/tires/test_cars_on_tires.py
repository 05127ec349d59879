"""Cars on tires of a file: rest, symmetry, grip, rolling, standstill, steps; of either suspension."""

import numpy as np
import pytest
from named import Named

from fmu_sources.plants import full_car, wishbone_car
from fmu_sources.tires.tir_file import read_tire
from fmu_sources.vehicles import load_full_car, load_wishbone_car, loader

FOLDER = loader._HERE.parent / "tires"
G = 9.81
SWAPPED = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
ODD = ("y", "body.roll", "body.yaw", "body.vy", "body.roll_rate", "body.yaw_rate", "target.y")


def on_tires(vehicle, tire):
    return vehicle.model_copy(update={"tire": vehicle.tire.model_copy(update={"file": tire})})


def model(kind, tire="hmmwv"):
    found = read_tire(FOLDER / f"{tire}.tir")
    if kind == "full_car":
        return full_car(on_tires(load_full_car("hmmwv_modified"), found), "CarTest").model()
    return wishbone_car(on_tires(load_wishbone_car("hmmwv_public"), found), "CarTest").model()


@pytest.fixture(scope="module", params=["full_car", "wishbone_car"])
def car(request):
    return model(request.param)


def names(car, role):
    return [e.name for e in car.elements(role)]


def run(car, seconds, step=1e-3, parameters=None, **inputs):
    """Evaluator at the end, and outputs over time; inputs are numbers or functions of time."""
    evaluator = Named(car, parameters)
    evaluator.put({n.replace("__", "."): v(0.0) if callable(v) else v for n, v in inputs.items()})
    evaluator.x = np.asarray(car.functions["start"](car.vector("state"), evaluator.u, evaluator.p)).ravel()
    rows = []
    for i in range(round(seconds / step)):
        evaluator.put({n.replace("__", "."): v(i * step) for n, v in inputs.items() if callable(v)})
        evaluator.step(step)
        rows.append(evaluator.shown())
    return {name: np.array([r[name] for r in rows]) for name in rows[0]}


def mirrored(of, vector):
    """The same situation seen in a mirror along the road."""

    def other(name):
        parts = [p.split("[") for p in name.split(".")]
        return ".".join("[".join([SWAPPED.get(p[0], p[0]), *p[1:]]) for p in parts)

    signs = [-1 if n in ODD or n.endswith("slip_angle") else 1 for n in of]
    return np.array([s * vector[of.index(other(n))] for n, s in zip(of, signs, strict=True)])


def test_left_and_right_are_mirror_images(car):
    """Also on a tire with plysteer and conicity: that of the right side is mirrored; a `full_car` to the last bit."""
    random = np.random.default_rng(3)
    states, inputs = names(car, "state"), names(car, "input")
    u, p = car.vector("input"), car.vector("parameter")
    u[inputs.index("target.speed")] = 12.0
    x = np.asarray(car.functions["start"](car.vector("state"), u, p)).ravel()
    x, u = x + random.normal(size=len(x)) * 0.02, u + random.normal(size=len(u)) * 0.01
    here = np.asarray(car.functions["rhs"](0, x, u, p)).ravel()
    there = np.asarray(car.functions["rhs"](0, mirrored(states, x), mirrored(inputs, u), p)).ravel()
    if "wheel.rigid_body" in names(car, "parameter"):
        assert (there == mirrored(states, here)).all()
    else:  # the equations of its wheels are eliminated one after the other
        assert there == pytest.approx(mirrored(states, here), rel=1e-9, abs=1e-9)


def test_keeps_straight_and_at_rest(car):
    """Side forces of the toe and of the tire's shape cancel from left to right."""
    found = run(car, 1.0, target__speed=15.0)
    assert np.abs(found["y"]).max() < 1e-9
    assert np.abs(found["body.z"]).max() < 2e-3
    assert found["speed"][-1] == pytest.approx(15.0, abs=0.3)


def test_coasts_by_rolling_resistance():
    """M a = -sum of |My| / r, with the wheels' inertia in the mass."""
    car = model("full_car", "truck")
    p = {"speed_control.gain": 0.0, "speed_control.integral_gain": 0.0}
    found = run(car, 2.0, parameters=p, target__speed=20.0)
    v = load_full_car("hmmwv_modified")
    tire = read_tire(FOLDER / "truck.tir")
    radius, mass = v.wheel.radius.value, v.body.mass.value + 4 * v.wheel.mass.value
    inertia = mass + 4 * v.wheel.spin_inertia.value / radius**2
    expected = -tire.values["QSY1"] * mass * G * tire.values["UNLOADED_RADIUS"] / radius / inertia
    late = slice(1000, 2000)
    slope = np.polyfit(np.arange(1000) * 1e-3, found["speed"][late], 1)[0]
    assert slope == pytest.approx(expected, rel=2e-2)


@pytest.mark.parametrize("tire", ["hmmwv", "sedan", "truck"])
def test_grip_limits_the_deceleration(tire):
    """Braked from 20 m/s as hard as the driver can, the car does not slow down faster than friction lets it."""
    car = model("full_car", tire)
    found = run(car, 1.5, target__speed=lambda t: 20.0 if t < 0.1 else 0.0)
    deceleration = -np.diff(found["speed"][200:]).min() / 1e-3
    friction = read_tire(FOLDER / f"{tire}.tir").values["PDX1"]
    assert 0.3 * G < deceleration < 1.3 * friction * G


def test_stands_still_without_chatter(car):
    """Braked to a standstill, the car comes to rest, and its wheels do not swing."""
    found = run(car, 20.0, target__speed=lambda t: 3.0 if t < 0.1 else 0.0)
    last = slice(-1000, None)
    assert np.abs(found["speed"][last]).max() < 0.02
    for k in SWAPPED:
        spin = found[f"wheel.{k}.spin"][last]
        assert np.abs(spin).max() < 0.1
        turns = np.count_nonzero(np.diff(np.sign(np.diff(spin[np.abs(spin) > 1e-4]))))
        assert turns < 10


def test_takes_a_corner_as_its_tires_allow(car):
    """The driver steers to another lane: the side forces of all tires are what accelerates the car sideways."""
    found = run(car, 1.5, target__speed=15.0, target__y=lambda t: 0.0 if t < 0.2 else 3.0)
    assert found["y"][-1] > 1.0
    assert np.abs(found["body.roll"]).max() > 0.002
    assert found["body.roll"][300:700].max() > 0  # turning left, the left side rises


def test_halving_the_step_changes_little():
    """Steps of 1 ms hold two of the solver, those of 0.25 ms half of one."""
    car = model("full_car")
    inputs = {"target__speed": 15.0, "target__y": lambda t: 0.0 if t < 0.1 else 2.0}
    fine, coarse = (run(car, 1.0, step, **inputs)["body.yaw"][-1] for step in (2.5e-4, 1e-3))
    assert abs(fine) > 0.02
    assert coarse == pytest.approx(fine, rel=1e-4)
