"""Hole and bump road: exact shapes, where and when wheels meet them, slopes that belong to the heights."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from looks import check_preview, look

from build_fmus.reference import simulate
from fmu_sources.roads import RoadLayout, WheelPosition, road_hole_bump
from fmu_sources.vehicles import load_ride_car

CORNERS = ("fl", "fr", "rl", "rr")
HAVERSINE, SINE, TRIANGLE, STEP = range(4)
SPEED = 75 / 3.6
ONE_WHEEL = RoadLayout((WheelPosition("fl", 0.0, 0.9), WheelPosition("fr", 0.0, -0.9)), 2, 0.01)


@pytest.fixture(scope="module")
def road():
    return road_hole_bump(RoadLayout.of(load_ride_car("sedan"), preview_count=48, preview_step=0.005)).model()


@pytest.fixture(scope="module")
def simple():
    """Wheels under the CG, so that x is their position."""
    return road_hole_bump(ONE_WHEEL).model()


def shapes(part):
    """Height 0..1 and its slope over the part 0..1 of a hole or bump, written the other way than in the component."""
    edge = 0.1 / 2.5
    step = np.clip(np.minimum(part, 1 - part) / edge, 0, 1)
    return {
        HAVERSINE: (0.5 - 0.5 * np.cos(2 * np.pi * part), np.pi * np.sin(2 * np.pi * part)),
        SINE: (np.sin(np.pi * part), np.pi * np.cos(np.pi * part)),
        TRIANGLE: (1 - np.abs(2 * part - 1), -2 * np.sign(part - 0.5)),
        STEP: (step, np.where(step < 1, -np.sign(part - 0.5) / edge, 0.0)),
    }


@pytest.mark.parametrize("shape", range(4))
def test_shapes_are_exact_at_every_position(simple, shape):
    lengths = {"hole__start": 5.0, "hole__length": 2.5, "gap": 1.5, "bump__length": 2.5, "hole__depth": 0.07}
    part = np.random.default_rng(shape).uniform(0, 1, 60)
    part = part[np.abs(part - 0.5) > 1e-3]
    height, slope = shapes(part)[shape]
    hole = look(simple, 5.0 + 2.5 * part, speed=10.0, shape=shape, **lengths)
    bump = look(simple, 9.0 + 2.5 * part, speed=10.0, shape=shape, **lengths)
    for y, size in ((hole, -0.07), (bump, 0.05)):
        for k in ("fl", "fr"):
            assert y[f"road.{k}.height"] == pytest.approx(size * height, abs=1e-14)
            assert y[f"road.{k}.slope"] == pytest.approx(size * slope / 2.5, abs=1e-12)
            assert y[f"road.{k}.rate"] == pytest.approx(10.0 * size * slope / 2.5, abs=1e-11)


@pytest.mark.parametrize("shape", range(4))
def test_slope_is_the_derivative_of_the_height(simple, shape):
    x = np.linspace(3.0, 11.0, 3001)
    y = look(simple, x, speed=1.0, shape=shape)
    integral = np.concatenate([[0], np.cumsum((y["road.fl.rate"][1:] + y["road.fl.rate"][:-1]) / 2) * (x[1] - x[0])])
    tolerance = 2 * (x[1] - x[0]) * np.abs(y["road.fl.slope"]).max()  # corners lie between the points
    assert np.abs(integral - (y["road.fl.height"] - y["road.fl.height"][0])).max() < tolerance


@pytest.mark.parametrize("shape", range(4))
def test_flat_before_between_and_behind(simple, shape):
    start, length = 0.12 * SPEED, 0.1 * SPEED
    flat = [-100.0, 0.0, start - 1e-6, start + 1.5 * length, start + 3 * length + 1e-6, 150.0, 1e300]
    y = look(simple, np.array(flat), speed=20.0, shape=shape)
    for k in ("fl", "fr"):
        assert np.all(np.abs(y[f"road.{k}.height"]) == 0)
        assert np.all(y[f"road.{k}.slope"] == 0)
    assert list(y["end_of_road"]) == [0, 0, 0, 0, 0, 0, 1]


def test_wheels_of_the_sedan_meet_the_hole_when_the_paper_says(road):
    """At 75 km/h from x = 0: hole 0.12 to 0.22 s, bump 0.32 to 0.42 s at the front; 0.1351 s later at the rear."""
    time = np.arange(0, 700) * 1e-3
    y = look(road, SPEED * time, SPEED)
    delay = 2.814 / SPEED
    assert delay == pytest.approx(0.1351, abs=5e-5)
    for k in CORNERS:
        since = time - 0.12 - (delay if k[0] == "r" else 0.0)
        haversine = 0.05 * np.sin(np.pi * since / 0.1) ** 2
        expected = np.where((since >= 0) & (since < 0.1), -haversine, 0) + np.where(
            (since >= 0.2) & (since < 0.3), haversine, 0
        )
        assert y[f"road.{k}.height"] == pytest.approx(expected, abs=1e-12)
    for name, at in (("hole", 0.12), ("bump", 0.32)):  # sample instants on the edges, whatever the rounding of x
        first = int(np.flatnonzero(np.abs(y["road.fl.rate"][round(at * 1e3) :]) > 1e-9)[0])
        assert first <= 1, name


@pytest.mark.parametrize("shape", [SINE, TRIANGLE, STEP])
def test_edges_at_sample_instants_do_not_depend_on_rounding(road, shape):
    """At 75 km/h every edge lies on a sample instant: the slope there is that ahead, and 100 samples are inside."""
    time = np.arange(0, 700) * 1e-3
    sloped = look(road, SPEED * time, SPEED, shape=shape, step__edge=0.1 * SPEED / 2)["road.fl.slope"] != 0
    instants = np.flatnonzero(sloped)
    if shape == SINE:  # its slope is 0 half-way
        instants = np.sort(np.concatenate([instants, np.flatnonzero(~sloped & np.isin(np.arange(700), (170, 370)))]))
    assert instants.tolist() == [*range(120, 220), *range(320, 420)]


def test_one_side(road):
    x = 0.17 * SPEED
    heights = {side: [look(road, x, side=side)[f"road.{k}.height"] for k in ("fl", "fr")] for side in range(3)}
    assert heights[0] == pytest.approx([-0.05, -0.05])
    assert heights[1] == pytest.approx([-0.05, 0.0])
    assert heights[2] == pytest.approx([0.0, -0.05])
    ahead = look(road, x, SPEED, side=2)
    assert not any(ahead[f"preview.fl[{i}]"] for i in range(1, 49))
    assert any(ahead[f"preview.fr[{i}]"] for i in range(1, 49))


def test_depth_and_height_are_separate(simple):
    x = np.array([0.17, 0.37]) * SPEED
    assert look(simple, x, hole__depth=0.0)["road.fl.height"] == pytest.approx([0.0, 0.05])
    assert look(simple, x, bump__height=-0.02, hole__depth=-0.03)["road.fl.height"] == pytest.approx([0.03, -0.02])


def test_a_step_edge_that_is_too_long_gives_a_triangle(simple):
    x = np.linspace(2, 10, 300)
    step, triangle = (look(simple, x, shape=s, step__edge=50.0)["road.fl.height"] for s in (STEP, TRIANGLE))
    assert step == pytest.approx(triangle, abs=1e-14)


def test_hole_and_bump_without_a_gap(simple):
    x = (0.22 + np.array([-1e-4, 0, 1e-4])) * SPEED
    y = look(simple, x, shape=TRIANGLE, gap=0.0)["road.fl.height"]
    assert y == pytest.approx([-1e-4, 0, 1e-4], abs=1e-12)


@given(st.floats(-20, 60), st.floats(0, 40), st.integers(0, 3), st.integers(0, 2))
@settings(deadline=None, max_examples=60)
def test_preview_is_what_the_wheels_meet_later(road, x, speed, shape, side):
    check_preview(road, x, speed, (0, 1, 17, 47), step=0.005, within=1e-9, shape=shape, side=side)


def test_road_has_no_memory_and_says_what_it_depends_on(road):
    assert road.size("state") == 0
    result = simulate(road)
    assert np.isfinite(result.outputs).all()
    heights = result.outputs[:, result.output_names.index("road.fl.height")]
    assert heights.min() < -0.04  # the reference run sees the hole
    assert set(road.dependencies["road.fl.height"]) == {"x"}
    assert set(road.dependencies["preview.rr[48]"]) == {"x", "speed"}
