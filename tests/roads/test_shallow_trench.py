"""Shallow trench: depth, length, slope, sides, and the preview of six wheels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from looks import check_preview, look

from build_fmus.reference import simulate
from fmu_sources.roads import RoadLayout, WheelPosition, road_shallow_trench
from fmu_sources.vehicles import load_three_axle

CORNERS = ("a1l", "a1r", "a2l", "a2r", "a3l", "a3r")
START, LENGTH, DEPTH, EDGE = 5.0, 2.0, 0.15, 0.2


@pytest.fixture(scope="module")
def road():
    return road_shallow_trench(
        RoadLayout.of(load_three_axle("three_axle"), preview_count=50, preview_step=0.005)
    ).model()


@pytest.fixture(scope="module")
def simple():
    """Wheels under the CG, so that x is their position."""
    return road_shallow_trench(
        RoadLayout((WheelPosition("a1l", 0.0, 1.0), WheelPosition("a1r", 0.0, -1.0)), 2, 0.005)
    ).model()


@pytest.mark.parametrize("depth", [0.15, 0.25])
def test_depth_and_length(simple, depth):
    height = look(simple, np.array([START, START + LENGTH / 2, START + LENGTH]), trench__depth=depth)["road.a1l.height"]
    assert height == pytest.approx([-depth / 2, -depth, -depth / 2], rel=1e-3)
    x = np.linspace(0, 12, 2401)
    profile = look(simple, x, trench__depth=depth)["road.a1l.height"]
    assert np.sum(profile) * 5e-3 == pytest.approx(-depth * LENGTH, rel=1e-6)  # rounding keeps the area
    mirrored = look(simple, 2 * START + LENGTH - x, trench__depth=depth)["road.a1l.height"]
    np.testing.assert_allclose(profile, mirrored, atol=1e-15)


def test_edge_is_the_scale_of_the_tanh(simple):
    """Within one edge length to either side the road falls by tanh(1) of the depth."""
    y = look(simple, np.array([START - EDGE, START + EDGE]))["road.a1r.height"]
    assert y[0] - y[1] == pytest.approx(DEPTH * np.tanh(1.0), rel=1e-6)


def test_slope_and_rate_are_derivatives_of_the_height(simple):
    x = np.linspace(3, 9, 1201)
    for edge in (0.05, 0.2, 0.6):
        y = look(simple, x, 4.0, trench__edge=edge)
        ahead, behind = (look(simple, x + d, trench__edge=edge)["road.a1l.height"] for d in (1e-5, -1e-5))
        assert y["road.a1l.slope"] == pytest.approx((ahead - behind) / 2e-5, abs=1e-7)
        assert y["road.a1l.rate"] == pytest.approx(4.0 * y["road.a1l.slope"], abs=1e-15)


def test_flat_elsewhere_and_without_depth(simple):
    y = look(simple, np.array([-1e300, -10.0, 0.0, 12.0, 150.0, 1e300]), 10.0)
    assert np.abs(y["road.a1l.height"]).max() < 1e-9
    assert list(y["end_of_road"]) == [0, 0, 0, 0, 0, 1]
    assert not look(simple, np.linspace(0, 12, 100), 5.0, trench__depth=0.0)["road.a1l.height"].any()


@pytest.mark.parametrize("side", range(3))
def test_sides(road, side):
    y = look(road, START + 1.0, side=side)
    lower = {k: y[f"road.{k}.height"] < -0.1 for k in ("a2l", "a2r")}
    assert lower == {"a2l": side != 2, "a2r": side != 1}


def test_beyond_its_end_the_road_is_held(simple):
    y = look(simple, np.array([6.0, 6.001, 30.0]), 3.0, length=6.0)
    assert y["road.a1l.height"] == pytest.approx([y["road.a1l.height"][0]] * 3)
    assert y["road.a1l.height"][0] < -0.14
    assert not y["road.a1l.slope"][1:].any()


def test_axles_meet_the_trench_one_after_the_other(road):
    x = np.linspace(0, 12, 600)
    first = look(road, x)["road.a1l.height"]
    assert look(road, x + 2.0)["road.a2l.height"] == pytest.approx(first, abs=1e-12)
    assert look(road, x + 4.0)["road.a3r.height"] == pytest.approx(first, abs=1e-12)


@given(st.floats(-5, 20), st.floats(0, 10), st.integers(0, 2))
@settings(deadline=None, max_examples=25)
def test_preview_is_what_the_wheels_meet_later(road, x, speed, side):
    check_preview(road, x, speed, (0, 1, 24, 49), step=0.005, within=1e-12, side=side)


def test_reference_run_crosses_the_trench(road):
    result = simulate(road)
    assert road.size("state") == 0
    assert np.isfinite(result.outputs).all()
    heights = result.outputs[:, result.output_names.index("road.a1l.height")]
    assert heights.min() < -0.14
