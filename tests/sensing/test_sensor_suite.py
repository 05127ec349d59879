"""SensorSuite: noise that is white, Gaussian and independent; beams that meet the road where geometry says."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from fmu_sources.models.corners import CORNERS
from fmu_sources.roads import RoadScan
from fmu_sources.sensing import sensor_suite
from fmu_sources.vehicles import load_sensors

SAMPLES = 6000
MOUNT, SIDE, HEIGHT = 2.45, 0.91, 0.9  # m, of the range sensors
REST = {"radar": HEIGHT / math.cos(math.radians(55)), "optical": HEIGHT / math.cos(math.radians(25))}
NOISE = {  # of Table 1.5, assumed
    **{f"loadcell.{k}": 50.0 for k in CORNERS},
    **{f"lvdt.{k}": 0.5e-3 for k in CORNERS},
    **{f"hub.{k}.az": 0.5 for k in CORNERS},
    "chassis.front.az": 0.1,
    "chassis.rear.az": 0.1,
    "gyro.pitch_rate": 5e-3,
    "gyro.roll_rate": 5e-3,
    "speed.measured": 0.02,
}
RANGES = ("range.left", "range.right")
EXACT = {"noise.scale": 0.0, "range.resolution[1]": 0.0, "range.resolution[2]": 0.0, "range.spot[1]": 0.0}
AT_ONCE = {**EXACT, "range.response[1]": 0.0, "range.response[2]": 0.0}


@pytest.fixture(scope="module")
def scan():
    return RoadScan.of(load_sensors("sensors_hmmwv"))


@pytest.fixture(scope="module")
def suite(scan):
    return sensor_suite(load_sensors("sensors_hmmwv"), scan).model()


def run(suite, rows, **parameters):
    """Outputs by name, one value per row of inputs (name -> value, kept from row to row)."""
    p, u = suite.vector("parameter"), suite.vector("input")
    at = {e.name: e.slot for e in suite.elements("parameter", "input")}
    for name, value in parameters.items():
        p[at[name]] = value
    tick, x, values = suite.functions["tick"], None, []
    for k, row in enumerate(rows):
        for name, value in row.items():
            u[at[name]] = value
        if x is None:
            x = suite.functions["start"](suite.vector("state"), u, p)
        x, y = tick(k * suite.sample_time, x, u, p)
        values.append(np.asarray(y).ravel())
    return dict(zip([e.name for e in suite.output_elements()], np.array(values).T, strict=True))


def surface(scan, x, heights, side="left"):
    """Inputs of the scan for a road `heights(x)` with the CG at `x`."""
    return {f"scan.{side}[{i + 1}]": heights(x + scan.start + i * scan.step) for i in range(scan.count)}


# ---------------------------------------------------------------------------------------------------------------- noise


@pytest.fixture(scope="module")
def noise(suite):
    """Every sensor on a car at rest, in units of its standard deviation."""
    y = run(suite, [{}] * SAMPLES, **{"range.resolution[1]": 0.0})
    values = {n: y[n] / sigma for n, sigma in NOISE.items()}
    return {**values, **{n: (y[n] - REST["radar"]) / 3e-3 for n in RANGES}}


def test_noise_is_gaussian_with_the_given_deviation(noise):
    assert len(noise) == 19
    for name, values in noise.items():
        assert abs(values.mean()) < 4 / math.sqrt(SAMPLES), name
        assert values.std() == pytest.approx(1.0, abs=4 / math.sqrt(2 * SAMPLES)), name
        assert stats.kstest(values, "norm").pvalue > 1e-3, name
        assert np.abs(values).max() < 6, name


def test_noise_is_white_and_channels_are_independent(noise):
    channels = np.array(list(noise.values()))
    bound = 5 / math.sqrt(SAMPLES)  # of a correlation, over some hundred pairs
    for lag in (0, 1, 2, 3, 7):
        correlation = channels[:, lag:] @ channels[:, : SAMPLES - lag].T / (SAMPLES - lag)
        if lag == 0:
            np.fill_diagonal(correlation, 0.0)
        assert np.abs(correlation).max() < bound
    squares = channels**2 - 1  # independence beyond correlation
    correlation = squares @ squares.T / SAMPLES / 2
    np.fill_diagonal(correlation, 0.0)
    assert np.abs(correlation).max() < 2 * bound


def test_seeds(suite):
    """The same seed gives the same numbers, others unrelated ones; also neighbors and the largest."""
    seeds = [0, 1, 2, 3, 1000, 67108859, 67108860, 2**31 - 1]
    runs = [run(suite, [{}] * 400, **{"noise.seed": s})["hub.fl.az"] / 0.5 for s in seeds]
    again = run(suite, [{}] * 400, **{"noise.seed": 2})["hub.fl.az"] / 0.5
    assert np.array_equal(runs[2], again)
    correlation = np.corrcoef(runs)
    np.fill_diagonal(correlation, 0.0)
    assert np.abs(correlation).max() < 5 / math.sqrt(400)
    second = np.corrcoef(np.array(runs[1]) - 2 * np.array(runs[2]) + np.array(runs[3]), runs[0])[0, 1]
    assert abs(second) < 0.3
    assert (np.array(runs[1]) - 2 * np.array(runs[2]) + np.array(runs[3])).std() == pytest.approx(
        math.sqrt(6), rel=0.15
    )


def test_scale_and_single_sensors(suite):
    """Noise scales; switching one sensor's off leaves the others' numbers as they are."""
    one = run(suite, [{}] * 50)
    double = run(suite, [{}] * 50, **{"noise.scale": 2.0})
    assert double["gyro.roll_rate"] == pytest.approx(2 * one["gyro.roll_rate"], rel=1e-12)
    quiet = run(suite, [{}] * 50, **{"noise.lvdt": 0.0})
    assert not quiet["lvdt.fl"].any()
    assert np.array_equal(quiet["hub.fl.az"], one["hub.fl.az"])


# ------------------------------------------------------------------------------------------------------- on the vehicle


def test_without_noise_sensors_show_the_car(suite):
    row = {f"actuator.{k}.force": 100.0 * i for i, k in enumerate(CORNERS)}
    row |= {f"suspension.{k}.deflection": 0.01 * i for i, k in enumerate(CORNERS)}
    row |= {f"wheel.{k}.az": 1.0 + i for i, k in enumerate(CORNERS)}
    row |= {"body.az": 2.0, "body.pitch_acceleration": 0.5, "body.roll_acceleration": 0.7, "body.pitch_rate": 0.1}
    row |= {"body.roll_rate": 0.2, "speed": 9.0, "x": 4.0}
    y = {n: v[0] for n, v in run(suite, [row], **EXACT).items()}
    for i, k in enumerate(CORNERS):
        assert y[f"loadcell.{k}"] == 100.0 * i
        assert y[f"lvdt.{k}"] == 0.01 * i
        assert y[f"hub.{k}.az"] == 1.0 + i
    # nose down lowers the front, left up raises the left: opposite corners, front left and rear right
    assert y["chassis.front.az"] == pytest.approx(2.0 - 1.651 * 0.5 + 0.91 * 0.7)
    assert y["chassis.rear.az"] == pytest.approx(2.0 + 1.651 * 0.5 - 0.91 * 0.7)
    assert (y["gyro.pitch_rate"], y["gyro.roll_rate"], y["speed.measured"]) == (0.1, 0.2, 9.0)


def test_distance_is_the_integral_of_the_speedometer(suite):
    y = run(suite, [{"x": 4.0, "speed": 9.0}] * 1001, **{"speed.gain": 1.02, "x.offset": 0.5, "noise.scale": 0.0})
    assert y["x.measured"][0] == 4.5
    assert y["x.measured"][-1] == pytest.approx(4.5 + 9.0 * 1.02, rel=1e-12)
    noisy = run(suite, [{"x": 4.0, "speed": 9.0}] * 1001)
    assert noisy["x.measured"][-1] == pytest.approx(4.0 + 1e-3 * noisy["speed.measured"][:-1].sum(), rel=1e-12)


# -------------------------------------------------------------------------------------------------------- range sensors


@pytest.mark.parametrize("sensor", ["radar", "optical"])
def test_flat_road_at_rest(suite, sensor):
    y = run(suite, [{}] * 3, **{**EXACT, "range.sensor": ["radar", "optical"].index(sensor)})
    for name in RANGES:
        assert y[name] == pytest.approx([REST[sensor]] * 3, abs=1e-12)
        assert y[f"{name}.valid"].all()
    assert y["range.tilt.used"][0] == pytest.approx(math.radians({"radar": 55, "optical": 25}[sensor]))
    assert y["range.response.used"][0] == {"radar": 1.1e-3, "optical": 5e-3}[sensor]


@pytest.mark.parametrize("pose", [(0.05, 0.0, 0.0), (0.0, 0.03, 0.0), (0.0, 0.0, 0.02), (-0.04, 0.02, -0.03)])
def test_pose(suite, pose):
    """A beam on a flat road: the height of the mount over the cosine of the beam's angle."""
    z, roll, pitch = pose
    y = run(suite, [{"body.z": z, "body.roll": roll, "body.pitch": pitch}], **AT_ONCE)
    for side, sign in (("left", 1), ("right", -1)):
        top = HEIGHT + z - MOUNT * math.sin(pitch) + sign * SIDE * math.sin(roll)
        expected = top / math.cos(math.radians(55) - pitch)
        assert y[f"range.{side}"][0] == pytest.approx(expected, abs=1e-12)


def test_beam_meets_a_hill_where_it_does(suite, scan):
    """Against a root finder, over a smooth hill and a hollow, at several poses."""

    def heights(x):
        return 0.06 * np.exp(-(((x - 12.0) / 0.35) ** 2)) - 0.04 * np.exp(-(((x - 13.2) / 0.4) ** 2))

    for x in np.linspace(7.6, 10.2, 14):
        for pitch in (-0.02, 0.0, 0.03):
            beam = math.radians(55) - pitch
            top = HEIGHT - MOUNT * math.sin(pitch)

            def above(d, x=x, beam=beam, top=top):
                return top - d * math.cos(beam) - heights(x + MOUNT + d * math.sin(beam))

            expected = brentq(above, 0.8, 2.4, xtol=1e-12)
            y = run(suite, [{"body.pitch": pitch, **surface(scan, x, heights)}], **AT_ONCE)
            assert y["range.left"][0] == pytest.approx(expected, abs=4e-4)


def test_a_wall_throws_a_shadow(suite, scan):
    """Behind a step of 0.3 m the beam still meets the step."""
    wall = MOUNT + 1.0
    y = run(suite, [surface(scan, 0.0, lambda x: 0.3 if wall <= x < wall + 0.2 else 0.0)], **AT_ONCE)
    assert y["range.left"][0] < 1.0 / math.sin(math.radians(55)) + 0.05
    assert y["range.right"][0] == pytest.approx(REST["radar"])


def test_spot_is_a_mean_over_its_length(suite, scan):
    """A bump of 0.1 m in the middle of the radar's 0.3 m shortens the range by a third of what it would."""
    middle = MOUNT + HEIGHT * math.tan(math.radians(55))
    rows = [surface(scan, 0.0, lambda x: 0.03 if abs(x - middle) < 0.05 else 0.0)]
    wide = run(suite, rows, **{**AT_ONCE, "range.spot[1]": 0.3})["range.left"][0]
    assert REST["radar"] - wide == pytest.approx(0.01 / math.cos(math.radians(55)), rel=0.1)


@pytest.mark.parametrize(("sensor", "resolution"), [(0, 0.01), (1, 0.02)])
def test_resolution(suite, sensor, resolution):
    y = run(suite, [{"body.z": 1e-3 * k} for k in range(60)], **{"range.sensor": sensor, "noise.scale": 0.0})
    steps = y["range.left"] / resolution
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    assert len(set(np.round(steps))) > 2


def test_response_time(suite):
    """A step of the pose arrives 1.1 ms later with the radar, 5 ms later with the optical sensor.

    Between samples by interpolation.
    """
    rows = [{"body.z": 0.0}] * 3 + [{"body.z": 0.05}] * 9
    radar = run(suite, rows, **EXACT)["range.left"] - REST["radar"]
    full = 0.05 / math.cos(math.radians(55))
    assert radar == pytest.approx([0.0] * 4 + [0.9 * full] + [full] * 7, abs=1e-9)
    optical = run(suite, rows, **{**EXACT, "range.sensor": 1})["range.left"] - REST["optical"]
    assert optical == pytest.approx([0.0] * 8 + [0.05 / math.cos(math.radians(25))] * 4, abs=1e-9)


def test_out_of_range_holds_the_last_value(suite):
    rows = [{"body.z": z} for z in (0.0, 0.05, 0.3, 0.4, 0.0)]
    y = run(suite, rows, **{**AT_ONCE, "range.sensor": 1})  # the optical one reaches 1.2 m
    assert list(y["range.left.valid"]) == [1, 1, 0, 0, 1]
    assert y["range.left"][2] == y["range.left"][3] == y["range.left"][1]
    assert np.isfinite(y["range.left"]).all()


def test_beam_that_meets_nothing(suite, scan):
    """Nose up by 0.5 rad the beam goes over all that is scanned; at once from the start, and mid-run."""
    y = run(suite, [{"body.pitch": -0.5}] * 3 + [{"body.pitch": 0.0}] * 3, **EXACT)
    assert not y["range.left.valid"][:3].any()
    assert y["range.left.valid"][-1]
    assert np.isfinite(y["range.left"]).all()
    deep = run(suite, [{f"scan.left[{i + 1}]": 5.0 for i in range(scan.count)}], **EXACT)  # beam starts below the road
    assert not deep["range.left.valid"][0]
    assert deep["range.right.valid"][0]


def test_dropout(suite):
    y = run(suite, [{}] * 20, **{"range.dropout.start": 5e-3, "range.dropout.duration": 4e-3})
    assert list(np.flatnonzero(y["range.left.valid"] == 0)) == [5, 6, 7, 8]
    assert len(set(y["range.left"][4:9])) == 1


def test_sensors_that_are_switched_off(suite):
    y = run(suite, [{}] * 3, **{"range.off": 1.0})
    assert not y["range.left.valid"].any()
    assert not y["range.right.valid"].any()
    assert suite.variable("range.off").tunable  # while it runs, too


def test_a_road_with_another_scan_is_refused(suite, scan):
    """By the master, when it is wired: these inputs must equal the constants of the road."""
    for what in ("start", "step"):
        v = suite.variable(f"scan.{what}")
        assert v.must_equal == getattr(scan, what)
        assert v.tolerance < 1e-5


def test_scan_covers_both_sensors(scan):
    assert scan.start < MOUNT + (HEIGHT - 0.1) * math.tan(math.radians(20))
    assert scan.start + (scan.count - 1) * scan.step > MOUNT + (HEIGHT + 0.1) * math.tan(math.radians(59)) + 0.15
    with pytest.raises(ValueError, match="at least 4"):
        RoadScan(0.0, 0.05, 3)
