"""Trench crossing: lidar correction, cases, pitch reference, effective road, lost lidar."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from named import Named

from fmu_sources.controllers.trench.crossing import COUNT, STEP, UNSEEN, CrossingGeometry, trench_crossing
from fmu_sources.plants import three_axle_trench
from fmu_sources.vehicles import load_three_axle_trench

GEOMETRY = CrossingGeometry(
    axles=(2.05, 0.0, -2.05), drop=(0.65, 0.65, 0.65), deflection=(0.036, 0.036, 0.036), radius=0.62, lidar_ahead=3.25,
    lidar_above=0.3, cg_height=1.234,
)  # fmt: skip
LENGTH = 1.6


def test_geometry_comes_from_the_plant():
    """The vehicle file, through the plant at rest."""
    found = CrossingGeometry.of(three_axle_trench(load_three_axle_trench("three_axle_trench")).model())
    assert found.axles == pytest.approx(GEOMETRY.axles)
    assert found.drop == pytest.approx(GEOMETRY.drop)
    assert found.deflection == pytest.approx([20000 * 9.81 / 6 / 900e3] * 3)
    assert found.cg_height == pytest.approx(0.62 - found.deflection[0] + 0.65)
    assert (found.radius, found.lidar_ahead, found.lidar_above) == pytest.approx((0.62, 3.25, 0.3))


@pytest.fixture(scope="module")
def component():
    return trench_crossing(GEOMETRY).model()


class Drive:
    """The algorithm beside a body whose CG is `x` before the start of the trench (negative: ahead of it is road)."""

    def __init__(self, component, **parameters):
        self.run = Named(component, parameters)

    def at(self, x, *, pitch=0.0, z=0.0, speed=1.0, length=LENGTH, sees=(True, True), wheels=None):
        """Outputs by name at a position of the CG relative to the start of the trench."""
        lx = x + GEOMETRY.lidar_ahead * math.cos(pitch) + GEOMETRY.lidar_above * math.sin(pitch)
        up = -GEOMETRY.lidar_ahead * math.sin(pitch) + GEOMETRY.lidar_above * math.cos(pitch)
        values = {"body.z": z, "body.pitch": pitch, "speed": speed}
        for end, where, seen in zip(("start", "finish"), (0.0, length), sees, strict=True):
            values |= {
                f"lidar.{end}.dx": where - lx if seen else 12.3,
                f"lidar.{end}.dz": GEOMETRY.cg_height + z + up if seen else -4.5,
                f"lidar.{end}.valid": float(seen),
            }
        values |= {f"wheel.{k}.z": h for k, h in (wheels or {}).items()}
        self.run.put(values).step(STEP)
        return self.run.shown()


def preview(out, corner):
    return np.array([out[f"preview.{corner}[{i + 1}]"] for i in range(COUNT)])


def reference(out):
    return np.array([out[f"reference.pitch[{i + 1}]"] for i in range(COUNT)])


@settings(max_examples=40, deadline=None)
@given(st.floats(-8, 5), st.floats(-0.25, 0.25), st.floats(-0.3, 0.3))
def test_correction_takes_the_movement_of_the_body_out(x, pitch, z):
    """(4.17)-(4.28): whatever the body does, the corrected slopes are those of a body at rest."""
    component = _COMPONENT
    moved, rest = Drive(component).at(x, pitch=pitch, z=z), Drive(component).at(x)
    height = GEOMETRY.cg_height + GEOMETRY.lidar_above
    for end, where in (("start", 0.0), ("finish", LENGTH)):
        expected = math.atan2(height, where - x - GEOMETRY.lidar_ahead)
        assert rest[f"slope.{end}"] == pytest.approx(expected, abs=1e-12)
        assert moved[f"slope.{end}.corrected"] == pytest.approx(expected, abs=1e-9)
    assert moved["trench.distance"] == pytest.approx(-x - GEOMETRY.axles[0], abs=1e-9)
    assert moved["trench.length"] == pytest.approx(LENGTH, abs=1e-9)
    assert moved["case"] == rest["case"]


_COMPONENT = trench_crossing(GEOMETRY).model()


def test_an_uncorrected_slope_would_be_wrong(component):
    """Figure 4.10: the correction matters above some degrees."""
    out = Drive(component).at(-6.0, pitch=math.radians(-10.0))
    assert abs(out["slope.start"] - out["slope.start.corrected"]) > math.radians(5.0)


@pytest.mark.parametrize("speed", [0.3, 2.5])
@pytest.mark.parametrize("length", [1.2, 1.6, 2.0])
def test_cases_open_and_close_where_they_should(component, speed, length):
    """Figure 4.11: from 0.2 s before an axle is 0.1 m behind the start until it is at the finish.

    The front axle first.
    """
    drive = Drive(component)
    for x in np.arange(-4.0, 5.0, 0.0437):
        windows = [0.1 - 0.2 * speed < x + a < length for a in GEOMETRY.axles]
        expected = windows.index(True) + 1 if any(windows) else 0
        edges = [x + a - e for a in GEOMETRY.axles for e in (0.1 - 0.2 * speed, length)]
        if min(map(abs, edges)) > 1e-9:
            assert drive.at(x, speed=speed, length=length)["case"] == expected


class TestReference:
    def test_nose_up_on_time_then_nose_down_then_level(self, component):
        drive, speed = Drive(component), 2.0
        pitches, x = {}, -6.0
        while x < 6.0:
            pitches[round(x, 6)] = reference(drive.at(x, speed=speed))[0]
            x += speed * STEP
        at = np.array(list(pitches))
        value = np.degrees(list(pitches.values()))
        first, last = -GEOMETRY.axles[0], -GEOMETRY.axles[2]  # CG when the axle is at the start
        assert np.all(value[at < first - 2.2 - 1e-6] == 0)  # 0.6 m + 0.8 s
        assert np.all(np.abs(value[(at > first - 1.35) & (at < first + LENGTH)] + 4) < 1e-9)
        assert np.all(np.abs(value[(at > last + 0.0) & (at < last + LENGTH)] - 4) < 1e-9)
        assert np.all(np.abs(value[at > last + LENGTH + 0.83]) < 1e-9)
        assert np.abs(np.diff(value)).max() <= 10 * STEP + 1e-9

    def test_preview_is_what_comes(self, component):
        drive, speed, x = Drive(component), 2.0, -4.5
        ahead = reference(drive.at(x, speed=speed))
        for k in range(1, COUNT):
            x += speed * STEP
            assert reference(drive.at(x, speed=speed))[0] == pytest.approx(ahead[k], abs=1e-12)
        assert ahead[-1] < -math.radians(0.5)  # the nose is about to go up, and the preview knew

    def test_angles_are_parameters(self, component):
        out = Drive(component, **{"pitch.entry": 0.0, "pitch.exit": 0.0}).at(-2.0)
        assert not reference(out).any()


class TestEffectiveRoad:
    def test_level_before_the_trench_and_the_circle_of_the_edge_over_it(self, component):
        out = Drive(component).at(-2.05 - 0.2, speed=4.0)  # axle 1 is 0.2 m before the start, 0.78 m beyond in the end
        beyond = -0.2 + 4.0 * STEP * np.arange(COUNT)
        circle = -(GEOMETRY.radius - np.sqrt(np.maximum(0.0, GEOMETRY.radius**2 - np.maximum(0, beyond) ** 2)))
        expected = np.maximum(circle, -GEOMETRY.deflection[0])  # a linear tire carries nothing on a road that low
        np.testing.assert_allclose(preview(out, "a1l"), expected, atol=1e-12)
        np.testing.assert_array_equal(preview(out, "a3r"), 0.0)

    def test_never_the_floor(self, component):
        """A wheel that hangs over the middle sees the road on which a linear tire has no force, wherever it hangs."""
        for z in (-0.2, 0.0, 0.15):
            out = Drive(component).at(-2.05 + LENGTH / 2, speed=0.0, wheels={"a1l": z})
            edge = math.sqrt(0.62**2 - 0.8**2) - 0.62 if LENGTH / 2 < 0.62 else -0.62
            np.testing.assert_allclose(preview(out, "a1l"), max(edge, z - GEOMETRY.deflection[0]), atol=1e-12)

    def test_lifted_wheel_on_level_road(self, component):
        out = Drive(component).at(-8.0, wheels={"a2r": 0.1})
        np.testing.assert_allclose(preview(out, "a2r"), 0.1 - GEOMETRY.deflection[1])
        np.testing.assert_array_equal(preview(out, "a2l"), 0.0)

    def test_wheels_move_forth_and_back_with_pitch(self, component):
        """Struts along the body: nose up by 5 deg moves the wheels ahead by 0.65 m sin 5 deg, less axle (1 - cos)."""
        pitch = math.radians(-5.0)
        beyond = 0.1
        wheels = {"a1l": -0.5}  # far below, so that the edge shows
        out = Drive(component).at(-2.05 + beyond, pitch=pitch, speed=0.0, wheels=wheels)
        below = (0.65 + 0.5 - 2.05 * math.sin(pitch)) / math.cos(pitch)
        forth = 2.05 * (math.cos(pitch) - 1) - below * math.sin(pitch)
        expected = math.sqrt(0.62**2 - (beyond + forth) ** 2) - 0.62
        assert preview(out, "a1l")[0] == pytest.approx(expected, abs=1e-12)


class TestLidar:
    def test_that_sees_nothing_means_no_trench(self, component):
        drive = Drive(component)
        for x in (-3.0, -2.0, 0.0):
            out = drive.at(x, sees=(False, False))
            assert out["case"] == 0
            assert not out["trench.known"]
            assert out["trench.distance"] == UNSEEN
            assert not reference(out).any()
            np.testing.assert_array_equal(preview(out, "a1l"), 0.0)

    def test_that_looks_ahead_only_still_finds_every_case(self, component):
        """The nose lidar loses each edge when it is over it; the speed takes over, and nothing changes."""
        ahead_only, all_seeing = Drive(component), Drive(component)
        for x in np.arange(-6.0, 6.0, 5.0 * STEP):
            nose = x + GEOMETRY.lidar_ahead
            one = ahead_only.at(x, speed=5.0, sees=(nose < 0, nose < LENGTH))
            two = all_seeing.at(x, speed=5.0)
            assert one["case"] == two["case"]
            np.testing.assert_allclose(reference(one), reference(two), atol=1e-9)
            np.testing.assert_allclose(preview(one, "a3l"), preview(two, "a3l"), atol=1e-9)

    def test_that_never_saw_the_finish(self, component):
        drive = Drive(component, **{"trench.unknown_length": 1.8})
        assert drive.at(-4.0, sees=(True, False))["trench.length"] == pytest.approx(1.8)
        assert drive.at(-4.0, sees=(True, True))["trench.length"] == pytest.approx(LENGTH)

    def test_with_a_finish_before_the_start(self, component):
        out = Drive(component).at(-2.0, length=-0.5)
        assert (out["case"], out["trench.known"], out["trench.length"]) == (0, 0, 0)


def test_standing_and_rolling_back_are_no_errors(component):
    drive = Drive(component)
    for speed in (0.0, -0.4):
        out = drive.at(-1.5, speed=speed)
        assert out["case"] == 1
        assert np.isfinite(list(out.values())).all()
