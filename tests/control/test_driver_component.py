"""The driver: where it looks for the path, delay and rates of its commands, and lane changes with the full cars."""

import numpy as np
import pytest
from named import Named

from cosim import System
from fmu_sources.controllers.driver import POINTS, driver


@pytest.fixture(scope="module")
def model():
    return driver("DriverTest").model()


def path(x, y):
    return {f"path.{n}[{i}]": v for n, row in (("x", x), ("y", y)) for i, v in enumerate(row, 1)}


def commands(run, count=1):
    for _ in range(count):
        run.step(0.01)
    return run.shown()


def test_drives_straight_on_and_steers_toward_the_path(model):
    run = Named(model, {"reaction_time": 0.0})
    run.put({"target.speed": 10.0, "speed": 10.0, "x": 3.0})
    assert commands(run, 3)["steering.wheel"] == 0.0
    run.put({"y": -0.5})
    left = commands(run, 200)["steering.wheel"]
    run.put({"y": 0.5})
    assert commands(run, 200)["steering.wheel"] == pytest.approx(-left)
    e, d2 = 0.5, 9.0**2 + 3.0**2 + 0.5**2  # the circle through the car, along its heading, to the previewed point
    curvature = 2 * e / d2
    assert left == pytest.approx(15 * (3.302 * curvature + 0.1 * 10 * curvature))


def test_steady_on_a_circle(model):
    """On the circle with its yaw rate the wheel has the angle of its curvature, beyond a quarter of it."""
    radius, speed = 30.0, 9.0
    angles = np.linspace(0, 2 * np.pi * (1 - 1 / POINTS), POINTS)
    x, y = radius * np.sin(angles), radius * (1 - np.cos(angles))
    run = Named(model, {"reaction_time": 0.0, **path(x, y)})
    shown = []
    for i in range(4000):
        a = speed * i * 0.01 / radius
        if a > 1.6 * np.pi:
            break
        run.put({"target.speed": speed, "speed": speed, "x": radius * np.sin(a), "y": radius * (1 - np.cos(a))})
        run.put({"body.yaw": a, "body.yaw_rate": speed / radius})
        shown.append(commands(run))
    late = shown[200:]
    assert np.mean([s["steering.wheel"] for s in late]) == pytest.approx(15 * 3.302 / radius, rel=0.05)
    assert max(s["path.offset"] for s in late) < 0.6  # of the lines between points


@pytest.mark.parametrize("samples", [0, 1, 12, 50])
def test_reaction_time_delays_by_whole_samples(model, samples):
    run = Named(model, {"reaction_time": 0.01 * samples, "steering.max_rate": 100.0, "steering.max_angle": 0.5})
    run.put({"target.speed": 10.0, "speed": 10.0, "y": -1.0})
    first = next(i for i in range(80) if commands(run)["steering.wheel"] > 0)
    assert first == samples


def test_wheel_turns_no_faster_and_no_further_than_allowed(model):
    run = Named(model, {"steering.max_rate": 2.0, "steering.max_angle": 0.3})
    run.put({"target.speed": 10.0, "speed": 10.0, "y": -50.0})
    wheel = [commands(run)["steering.wheel"] for _ in range(100)]
    assert np.diff(wheel).max() == pytest.approx(0.02)
    assert wheel[-1] == pytest.approx(0.3)


def test_pedals_never_act_together(model):
    run = Named(model, {"reaction_time": 0.0})
    for target, pedal in ((20.0, "throttle"), (2.0, "brake")):
        run.put({"target.speed": target, "speed": 10.0})
        shown = commands(run, 2)
        assert 0 < shown[pedal] <= 1
        assert shown["throttle"] * shown["brake"] == 0


@pytest.mark.parametrize(("car", "kmh", "within"), [("FullCarHmmwv", 60.0, 0.5), ("FullCarHmmwvPublic", 60.0, 0.75)])
@pytest.mark.usefixtures("built_fmus")
def test_changes_the_lane_of_a_full_car(car, kmh, within):
    """A change of lane and back, with the widths of a double lane change; the mirrored one mirrors."""
    speed = kmh / 3.6
    x = np.linspace(0, 400, POINTS)
    y = np.interp(x, [50, 65, 95, 120, 145, 160][1:5], [0.0, 3.5, 3.5, 0.0])
    tracks = []
    for side in (1, -1):
        with System(allow_unconnected=True) as system:
            for name, fmu in (("car", car), ("driver", "Driver")):
                system.add(name, fmu)
            system.connect_matching("car", "driver")
            system.connect_matching("driver", "car")
            system["car"].set({"driver.mode": 1, "target.speed": speed, "start.x": 0.0})
            system["driver"].set({"target.speed": speed, **path(x, side * y)})
            r = system.run(220 / speed, record=["car.x", "car.y", "car.speed", "driver.path.offset"])
        tracks.append(r["car.y"])
        assert r["driver.path.offset"].max() < within
        assert r["car.y"].max() - r["car.y"].min() > 3.0
        assert r["driver.path.offset"][-1] < 0.1
        assert r["car.speed"] == pytest.approx(speed, abs=0.4)
    assert tracks[1] == pytest.approx(-tracks[0], abs=1e-6)
