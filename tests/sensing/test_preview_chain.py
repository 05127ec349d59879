"""PreviewSensor and PreviewBuffer: geometry, memory, and what happens when something is missing."""

import math

import numpy as np
import pytest

from fmu_sources.models.corners import CORNERS
from fmu_sources.roads import RoadLayout, RoadScan
from fmu_sources.sensing import preview_buffer, preview_sensor, sensor_suite
from fmu_sources.vehicles import load_ride_car, load_sensors

PERIOD = 5e-3
AXLE = 1.651  # m, of both axles from the CG
TILT, HEIGHT, MOUNT, SIDE = math.radians(55), 0.9, 2.45, 0.91
SPEED = 9.0


class Ticks:
    """A discrete component in Python: inputs and outputs by name."""

    def __init__(self, component, parameters=None):
        self.c = component
        self.p, self.u = component.vector("parameter"), component.vector("input")
        self.at = {e.name: e.slot for e in component.elements("parameter", "input")}
        self.names = [e.name for e in component.output_elements()]
        for name, value in (parameters or {}).items():
            self.p[self.at[name]] = value
        self.x, self.k = None, 0

    def __call__(self, inputs):
        for name, value in inputs.items():
            self.u[self.at[name]] = value
        if self.x is None:
            self.x = self.c.functions["start"](self.c.vector("state"), self.u, self.p)
        self.x, y = self.c.functions["tick"](self.k * self.c.sample_time, self.x, self.u, self.p)
        self.k += 1
        return dict(zip(self.names, np.asarray(y).ravel(), strict=True))


@pytest.fixture(scope="module")
def sensors():
    return load_sensors("sensors_hmmwv")


@pytest.fixture(scope="module")
def layout():
    return RoadLayout.of(load_ride_car("ride_car_hmmwv"), preview_count=16, preview_step=0.030)


@pytest.fixture(scope="module")
def sensor(sensors):
    return preview_sensor(sensors, load_ride_car("ride_car_hmmwv")).model()


@pytest.fixture(scope="module")
def buffer(layout):
    return preview_buffer(layout).model()


# --------------------------------------------------------------------------------------------------------------- sensor


def test_correction_undoes_what_the_pose_does_to_the_ranges(sensor, sensors):
    """SensorSuite on a flat road in any pose, and (1.18) with that pose: height 0, where the beam meets the road."""
    suite = sensor_suite(sensors, RoadScan.of(sensors)).model()
    exact = {"noise.scale": 0.0, "range.resolution[1]": 0.0, "range.response[1]": 0.0, "mount.bias": 0.1}
    rng = np.random.default_rng(3)
    for _ in range(20):
        pose = dict(zip(("body.z", "body.roll", "body.pitch"), rng.uniform(-0.03, 0.03, 3), strict=True))
        ranges = Ticks(suite, exact)({**pose, "x": 7.0})
        seen = {n: ranges[n] for n in ("range.left", "range.right", "range.tilt.used", "range.response.used")}
        y = Ticks(sensor, {"mount.bias": 0.1})({**pose, **seen, "x": 7.0, "speed": SPEED})
        for side in ("left", "right"):
            # D_bias is taken along the beam at rest in (1.18): cos(alpha) there, cos(alpha - pitch) in the reading
            bias = 0.1 * (math.cos(TILT) - math.cos(TILT - pose["body.pitch"]))
            assert y[f"sensed.{side}.height"] == pytest.approx(bias, abs=1e-12)
            reach = (ranges[f"range.{side}"] - 0.1) * math.sin(TILT - pose["body.pitch"])
            assert y[f"sensed.{side}.x"] == pytest.approx(7.0 + MOUNT + reach, abs=1e-12)
            assert y[f"sensed.{side}.valid"] == 1


def test_signs_are_iso_8855(sensor):
    """At the same range, a nose that is down means a lower road, a left side that is up a higher one on the left."""
    rest = HEIGHT / math.cos(TILT)
    ranges = {"range.left": rest, "range.right": rest}
    level = Ticks(sensor)(ranges)
    down = Ticks(sensor)({**ranges, "body.pitch": 0.01})
    left_up = Ticks(sensor)({**ranges, "body.roll": 0.01})
    lifted = Ticks(sensor)({**ranges, "body.z": 0.01})
    assert level["sensed.left.height"] == pytest.approx(0.0, abs=1e-12)
    reach = MOUNT + HEIGHT * math.tan(TILT)
    assert down["sensed.left.height"] == pytest.approx(-0.01 * reach, rel=0.01)
    assert left_up["sensed.left.height"] == pytest.approx(0.01 * SIDE, rel=1e-3)
    assert left_up["sensed.right.height"] == pytest.approx(-0.01 * SIDE, rel=1e-3)
    assert lifted["sensed.left.height"] == pytest.approx(0.01)


def test_age_of_the_ranges(sensor):
    """Pose and place are those of when the range was taken."""
    run = Ticks(sensor)
    old = {"range.response.used": 5e-3, "x": 5.0, "speed": SPEED, "body.z": 0.0}
    run(old)
    y = run({"x": 5.0 + SPEED * PERIOD, "body.z": 0.03})
    assert y["sensed.left.height"] == pytest.approx(0.0, abs=1e-12)
    assert y["sensed.left.x"] == pytest.approx(5.0 + MOUNT + HEIGHT * math.tan(TILT))
    half = Ticks(sensor)
    half({**old, "range.response.used": 2.5e-3})
    assert half({"body.z": 0.03})["sensed.left.height"] == pytest.approx(0.015)


def test_a_range_that_is_not_valid_says_so(sensor):
    y = Ticks(sensor)({"range.right.valid": 0})
    assert (y["sensed.left.valid"], y["sensed.right.valid"]) == (1, 0)
    assert np.isfinite(list(y.values())).all()


def test_position_error(sensor):
    rows = [Ticks(sensor, {"position.error": e})({})["sensed.left.x"] for e in (0.0, 0.25)]
    assert rows[1] - rows[0] == pytest.approx(0.25)


def test_free_response_is_a_quarter_car_per_wheel(sensor):
    """Its rest on a raised road is that road; a wheel alone tilts the pose; none without compensation."""
    raised = {f"road.{k}.height": 0.04 for k in CORNERS}
    run, without = Ticks(sensor, {"compensation": 1}), Ticks(sensor)
    for _ in range(800):
        y, plain = run(raised), without(raised)
    assert y["sensed.left.height"] == pytest.approx(0.04, abs=1e-4)
    assert plain["sensed.left.height"] == pytest.approx(0.0, abs=1e-12)
    front = Ticks(sensor, {"compensation": 1})
    heights = [front({"road.fl.height": 0.04, "road.fr.height": 0.04})["sensed.left.height"] for _ in range(800)]
    reach = MOUNT + HEIGHT * math.tan(TILT)
    assert heights[-1] == pytest.approx(0.02 + 0.02 / AXLE * reach, rel=2e-3)
    assert heights[0] == pytest.approx(0.0, abs=1e-12)
    top = max(heights) / heights[-1]
    assert 1.2 < top < 1.9, "an underdamped quarter car near 2 Hz overshoots"


# --------------------------------------------------------------------------------------------------------------- buffer


def wave(x):
    return 0.03 * np.sin(2 * np.pi * np.asarray(x) / 1.7) * np.clip((np.asarray(x) - 8) / 4, 0, 1)


def drive(buffer, steps, *, speed=SPEED, ahead=3.7, shape=wave, place=None, valid=None, start=5.0, **parameters):
    """Outputs per step of a car that senses `shape` `ahead` meters away.

    `place(k, x)`, `valid(k)` change that.
    """
    run = Ticks(buffer, {"leak.time": 1e6, **{n.replace("__", "."): v for n, v in parameters.items()}})
    rows = []
    for k in range(steps):
        x = start + speed * k * PERIOD
        at = place(k, x) if place else x + ahead
        good = valid(k) if valid else 1
        row = {"x": x, "speed": speed}
        for side in ("left", "right"):
            row |= {f"sensed.{side}.x": at, f"sensed.{side}.height": float(shape(at)), f"sensed.{side}.valid": good}
        rows.append({**run(row), "x": x})
    return rows


def wheel(corner):
    return AXLE if corner[0] == "f" else -AXLE


@pytest.mark.parametrize("speed", [2.0, 9.0, 25.0])
def test_what_was_sensed_comes_back_under_each_wheel(buffer, speed):
    """Heights at the wheels now, one sample later (road.*), and every 30 ms ahead, up to what is sensed."""
    steps = math.ceil(12.0 / speed / PERIOD)
    y = drive(buffer, steps, speed=speed)[-1]
    worst = 0.03 * (2 * np.pi / 1.7) ** 2 * max(0.025, speed * PERIOD) ** 2 / 4  # of interpolating twice
    for k in CORNERS:
        here = y["x"] + wheel(k)
        assert y[f"road.{k}.height"] == pytest.approx(wave(here + speed * PERIOD), abs=worst)
        for i in range(16):
            place = min(here + speed * 0.030 * i, y["x"] + 3.7)
            assert y[f"preview.{k}[{i + 1}]"] == pytest.approx(wave(place), abs=worst + 0.12 * 0.025)
    assert y["road.valid"] == y["preview.valid"] == 1
    assert y["preview.step"] == 0.030
    assert y["preview.reach"] == pytest.approx(3.7 - AXLE, abs=0.026)


def test_order_of_samples_does_not_matter(buffer):
    """Samples that jump forth and back by up to 0.2 m, as with a nodding beam, fill the same cells."""

    def jumping(k, x):
        return x + 3.7 + 0.1 * math.sin(2.1 * k)

    straight, mixed = (drive(buffer, 260, place=p, forgetting=0.0)[-1] for p in (None, jumping))
    for k in CORNERS:
        assert mixed[f"road.{k}.height"] == pytest.approx(straight[f"road.{k}.height"], abs=3e-3)
    assert mixed["road.valid"] == 1


def test_forgetting_averages_what_is_measured_again(buffer):
    """Driving back and forth over a place with noise: the more of the old is kept, the less noise is left."""

    def spread(forgetting):
        rng = np.random.default_rng(5)
        rows = drive(
            buffer,
            400,
            speed=0.0,
            start=5.0,
            forgetting=forgetting,
            shape=lambda _: 0.01 * rng.standard_normal(),
            place=lambda k, x: x + AXLE + 0.2 * math.sin(0.7 * k),
        )
        return np.std([r["preview.fl[1]"] for r in rows[50:]])

    assert spread(0.9) < 0.6 * spread(0.0)


def test_memory_goes_round(buffer):
    """After several times its length, and far from the origin, also at negative distances."""
    for start in (5.0, -70.0, 4000.0):
        rows = drive(buffer, 900, speed=25.0, start=start, shape=lambda x: 0.02 * np.sin(x))
        for r in rows[100::160]:
            expected = 0.02 * np.sin(r["x"] + np.array([AXLE, -AXLE]))
            assert [r["preview.fl[1]"], r["preview.rr[1]"]] == pytest.approx(expected, abs=3e-4)
            assert r["road.valid"] == 1


def test_start_holds_the_first_height(buffer):
    """Nothing is known before the first sample, nor under the rear wheels until they have come to where it was."""
    rows = drive(buffer, 200, shape=lambda _: 0.02, valid=lambda k: k >= 10)
    assert [r["preview.fl[1]"] for r in rows[:10]] == [0.0] * 10
    assert not any(r["preview.valid"] or r["road.valid"] for r in rows[:11])
    assert rows[10]["preview.rl[16]"] == pytest.approx(0.02)
    known = next(r["x"] for r in rows if r["road.valid"])
    assert known - rows[10]["x"] == pytest.approx(3.7 + AXLE, abs=0.1)


def test_dropout_is_held_flagged_and_passed(buffer):
    """A sensor fails for 0.2 s: the last height stays, flags tell, and the run continues to a valid preview."""
    rows = drive(buffer, 500, valid=lambda k: not 200 <= k < 240)
    assert np.isfinite([list(r.values()) for r in rows]).all()
    last = rows[199]["preview.fl[16]"]
    assert [r["preview.fl[16]"] for r in rows[200:240]] == pytest.approx([last] * 40, abs=1e-3)
    assert rows[199]["preview.valid"] == 1
    assert not any(r["preview.valid"] for r in rows[200:240])
    assert rows[220]["road.valid"] == 1, "the wheels are still on what was measured"
    gap = [r["x"] for r in rows[200:] if not r["road.valid"]]
    start = rows[200]["x"] + 3.7
    assert gap[0] == pytest.approx(start - AXLE, abs=0.15)
    assert gap[-1] == pytest.approx(start + 40 * SPEED * PERIOD + AXLE, abs=0.15)
    assert rows[-1]["preview.valid"] == rows[-1]["road.valid"] == 1
    assert rows[-1]["road.fl.height"] == pytest.approx(wave(rows[-1]["x"] + AXLE + SPEED * PERIOD), abs=2e-3)


def test_standstill_and_backwards(buffer):
    """Standing, all of the preview is the road under the wheel; backwards, what was driven over comes again."""
    run = Ticks(buffer, {"leak.time": 1e6})
    x, rows = 5.0, []
    for k in range(700):
        speed = SPEED if k < 300 else 0.0 if k < 350 else -3.0
        row = {"x": x, "speed": speed}
        for side in ("left", "right"):
            row |= {
                f"sensed.{side}.x": x + 3.7,
                f"sensed.{side}.height": float(wave(x + 3.7)),
                f"sensed.{side}.valid": 1,
            }
        rows.append({**run(row), "x": x, "speed": speed})
        x += speed * PERIOD
    stand = rows[340]
    assert [stand[f"preview.fl[{i + 1}]"] for i in range(16)] == pytest.approx([stand["preview.fl[1]"]] * 16)
    assert stand["preview.fl[1]"] == pytest.approx(wave(stand["x"] + AXLE), abs=1e-3)
    back = rows[500]
    for k in CORNERS:
        later = back["x"] + wheel(k) - 3.0 * 0.030 * np.arange(16)
        assert [back[f"preview.{k}[{i + 1}]"] for i in range(16)] == pytest.approx(wave(later), abs=1.5e-3)
    assert back["road.valid"] == 1


def test_far_behind_or_after_a_jump_it_starts_anew(buffer):
    """Backwards out of the memory, or a car set elsewhere: nothing old is taken for measured."""
    for there in (-40.0, 300.0):
        run = Ticks(buffer, {"leak.time": 1e6})
        for k in range(400):
            x = (5.0 if k < 300 else there) + SPEED * PERIOD * k
            row = {"x": x, "speed": SPEED}
            for side in ("left", "right"):
                row |= {f"sensed.{side}.x": x + 3.7, f"sensed.{side}.height": 0.03 if k < 300 else -0.01}
                row |= {f"sensed.{side}.valid": 1}
            y = run(row)
            if k == 300:
                assert y["road.valid"] == 0
        assert [y[f"preview.rl[{i + 1}]"] for i in range(16)] == pytest.approx([-0.01] * 16, abs=1e-4)


def test_contact_length_averages(buffer):
    """A parabola 0.305 m long under a contact of 0.25 m, as the wheels of RoadBumps follow it."""
    rows = drive(
        buffer, 260, speed=3.0, contact__length=0.25, shape=lambda s: 0.03 * max(0.0, 1 - ((s - 10.0) / 0.1525) ** 2)
    )
    x, z = (np.array([r[n] for r in rows]) for n in ("x", "preview.fl[1]"))
    assert z.max() == pytest.approx(0.03 * (1 - (0.25 / 0.305) ** 2 / 3), rel=0.02)
    assert np.trapezoid(z, x) == pytest.approx(0.03 * 0.305 * 2 / 3, rel=0.01)


def test_leak_takes_a_bias_off(buffer):
    """A constant error of the ranges fades with leak.time; a bump stays."""
    rows = drive(buffer, 1600, shape=lambda _: 0.05, leak__time=1.0)
    assert rows[100]["preview.fl[16]"] > 0.02
    assert abs(rows[-1]["preview.fl[1]"]) < 2e-3
    bump = drive(buffer, 400, shape=lambda s: 0.05 * math.exp(-(((s - 14.0) / 0.15) ** 2)), leak__time=10.0)
    assert max(r["preview.fl[1]"] for r in bump) == pytest.approx(0.05, rel=0.05)


def test_sides_are_apart(buffer):
    run = Ticks(buffer)
    for k in range(300):
        x = 5.0 + SPEED * PERIOD * k
        row = {"x": x, "speed": SPEED}
        for side, height in (("left", 0.02), ("right", -0.03)):
            row |= {f"sensed.{side}.x": x + 3.7, f"sensed.{side}.height": height, f"sensed.{side}.valid": 1}
        y = run(row)
    assert y["preview.rl[1]"] > 0.01 > -0.01 > y["preview.fr[1]"]


def test_a_horizon_longer_than_the_buffer_is_refused(layout, raises):
    with raises(ValueError):
        preview_buffer(layout, cells=512)
    long = RoadLayout.of(load_ride_car("ride_car_hmmwv"), preview_count=64, preview_step=0.030)
    with raises(ValueError):
        preview_buffer(long)
    preview_buffer(layout, cells=512, max_speed=12.0)


def test_a_preview_step_that_does_not_divide_is_refused(raises):
    odd = RoadLayout.of(load_ride_car("ride_car_hmmwv"), preview_count=16, preview_step=0.012)
    with raises(ValueError):
        preview_buffer(odd)


def test_the_road_closes_a_loop_that_needs_a_delay(buffer, sensor):
    """Buffer to filter feeds through at once: the master refuses it without delay. The memory itself does not."""
    assert "sensed.left.height" in buffer.dependencies["road.fl.height"]
    assert "body.pitch" in sensor.dependencies["sensed.left.height"]
