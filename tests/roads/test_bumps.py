"""Bump road: exact smoothed parabolas, places, sides, and what is reported of bumps that do not fit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from looks import check_preview, look
from scipy.integrate import quad

from build_fmus.reference import simulate
from fmu_sources.roads import RoadLayout, WheelPosition, road_bumps
from fmu_sources.vehicles import load_ride_car

CORNERS = ("fl", "fr", "rl", "rr")
ONE_AXLE = RoadLayout((WheelPosition("fl", 0.0, 0.9), WheelPosition("fr", 0.0, -0.9)), 2, 0.01)
START, LENGTH, CONTACT = 10.0, 0.305, 0.25
MPH_20 = 20 * 0.44704


@pytest.fixture(scope="module")
def road():
    return road_bumps(RoadLayout.of(load_ride_car("ride_car_hmmwv"), preview_count=16, preview_step=0.030)).model()


@pytest.fixture(scope="module")
def simple():
    """Wheels under the CG, so that x is their position."""
    return road_bumps(ONE_AXLE).model()


def bumps(heights):
    """Heights of the bumps as parameters, by place counted from 1; the others are 0."""
    return {f"bump.height[{i}]": heights.get(i, 0.0) for i in range(1, 11)}


def parabola(x, start=START, length=LENGTH):
    """Bump of height 1, written the other way than in the component."""
    part = (x - start) / length
    return 4 * part * (1 - part) if 0 < part < 1 else 0.0


@pytest.mark.parametrize("contact", [0.01, 0.25, 0.305, 1.0])
def test_height_is_the_mean_of_the_parabola_over_the_contact(simple, contact):
    x = START + np.linspace(-0.6, 0.9, 61)
    y = look(simple, x, 7.0, **bumps({1: 0.076}), contact__length=contact)
    corners = (START, START + LENGTH)
    for k, xi in enumerate(x):
        a, b = xi - contact / 2, xi + contact / 2
        inside = [c for c in corners if a < c < b]
        height = 0.076 * quad(parabola, a, b, points=inside or None)[0] / contact
        slope = 0.076 * (parabola(b) - parabola(a)) / contact
        for side in ("fl", "fr"):
            assert y[f"road.{side}.height"][k] == pytest.approx(height, abs=1e-12)
            assert y[f"road.{side}.slope"][k] == pytest.approx(slope, abs=1e-11)
            assert y[f"road.{side}.rate"][k] == pytest.approx(7.0 * slope, abs=1e-10)


def test_slope_is_the_derivative_of_the_height(simple):
    x = np.linspace(9.5, 17.5, 16001)
    y = look(simple, x)
    numeric = np.gradient(y["road.fl.height"], x)
    kinks = np.abs(np.diff(y["road.fl.slope"])).max()  # of the slope from point to point
    assert np.abs(numeric - y["road.fl.slope"]).max() < kinks


def test_crest_and_area(simple):
    """At its crest 1 - (contact / length)^2 / 3 of the height; smoothing keeps the area of 2/3 height x length."""
    crest = look(simple, START + LENGTH / 2, **bumps({1: 0.076}))["road.fl.height"]
    assert crest == pytest.approx(0.076 * (1 - (CONTACT / LENGTH) ** 2 / 3), rel=1e-12)
    assert crest == pytest.approx(0.0590, abs=5e-5)
    x = np.linspace(START - 0.2, START + 0.5, 7001)
    area = np.sum(look(simple, x, **bumps({1: 0.076}))["road.fl.height"]) * (x[1] - x[0])
    assert area == pytest.approx(2 / 3 * 0.076 * LENGTH, rel=1e-6)


def test_short_contact_follows_the_parabola_itself(simple):
    x = START + np.linspace(0.01, 0.29, 15)
    y = look(simple, x, **bumps({1: 0.05}), contact__length=1e-3)["road.fl.height"]
    assert y == pytest.approx([0.05 * parabola(xi) for xi in x], abs=1e-6)


def test_default_track_is_57_then_38_mm_6_m_apart(simple):
    x = np.arange(0, 40, 0.001)
    y = look(simple, x)["road.fl.height"]
    tops = [i for i in range(1, len(y) - 1) if y[i] > 0.01 and y[i - 1] < y[i] >= y[i + 1]]
    assert len(tops) == 2
    assert x[tops[1]] - x[tops[0]] == pytest.approx(6.0, abs=2e-3)
    assert y[tops] / (1 - (CONTACT / LENGTH) ** 2 / 3) == pytest.approx([0.057, 0.038], rel=1e-4)


def test_ten_places(simple):
    heights = {i: 0.01 * i for i in range(1, 11)}
    crests = START + LENGTH / 2 + 1.3 * np.arange(10)
    y = look(simple, crests, **bumps(heights), bump__spacing=1.3)["road.fr.height"]
    assert y == pytest.approx([0.01 * i * (1 - (CONTACT / LENGTH) ** 2 / 3) for i in range(1, 11)])


def test_overlapping_bumps_add_up(simple):
    x = np.linspace(9.5, 11, 40)
    both = look(simple, x, **bumps({1: 0.05, 2: 0.03}), bump__spacing=0.2)["road.fl.height"]
    one, two = (look(simple, x, **bumps(h), bump__spacing=0.2)["road.fl.height"] for h in ({1: 0.05}, {2: 0.03}))
    assert both == pytest.approx(one + two, abs=1e-15)


def test_flat_elsewhere_and_without_bumps(simple):
    reach = CONTACT / 2
    flat = [-1e300, -5.0, 0.0, START - reach - 1e-6, START + LENGTH + reach + 1e-6, 13.0, 18.0, 150.0, 1e300]
    y = look(simple, np.array(flat), 20.0)
    for k in ("fl", "fr"):
        assert not y[f"road.{k}.height"].any()
        assert not y[f"road.{k}.slope"].any()
    assert list(y["end_of_road"]) == [0] * 8 + [1]
    none = look(simple, np.linspace(0, 30, 200), 20.0, **bumps({}))
    assert not none["road.fl.height"].any()
    assert not none["height_above_travel"].any()


@pytest.mark.parametrize("side", range(3))
def test_sides(road, side):
    y = look(road, START + LENGTH / 2 - 1.651, MPH_20, side=side)
    raised = {k: y[f"road.{k}.height"] > 0.04 for k in ("fl", "fr")}
    assert raised == {"fl": side != 2, "fr": side != 1}
    ahead = look(road, START - 1.651 - MPH_20 * 0.1, MPH_20, side=side)
    seen = {k: any(ahead[f"preview.{k}[{i}]"] > 0 for i in range(1, 17)) for k in ("fl", "fr")}
    assert seen == raised


def test_rear_wheels_follow_by_the_wheelbase(road):
    x = np.linspace(6, 22, 400)
    front, rear = look(road, x), look(road, x + 2 * 1.651)
    for side in "lr":
        assert rear[f"road.r{side}.height"] == pytest.approx(front[f"road.f{side}.height"], abs=1e-12)


@given(st.floats(-5, 40), st.floats(0, 30), st.integers(0, 2))
@settings(deadline=None, max_examples=40)
def test_preview_is_what_the_wheels_meet_later(road, x, speed, side):
    check_preview(road, x, speed, (0, 1, 7, 15), step=0.030, within=1e-9, side=side)


@pytest.mark.parametrize(
    ("heights", "above"),
    [({1: 0.06}, 0), ({1: 0.0601}, 1), ({10: 0.076}, 1), ({5: -0.076}, 1), ({1: 0.057, 7: 0.038}, 0), ({}, 0)],
)
def test_a_bump_above_the_travel_is_reported(simple, heights, above):
    assert look(simple, 0.0, **bumps(heights))["height_above_travel"] == above
    assert look(simple, 0.0, **bumps(heights), travel=0.1)["height_above_travel"] == 0


def test_a_bump_beyond_the_end_is_reported_and_not_driven_over(simple):
    heights = {1: 0.05, 10: 0.05}
    last = START + 9.0
    assert look(simple, 0.0, **bumps(heights))["bumps_beyond_end"] == 0
    assert look(simple, 0.0, **bumps(heights), length=15.0)["bumps_beyond_end"] == 1
    assert look(simple, 0.0, **bumps({1: 0.05}), length=15.0)["bumps_beyond_end"] == 0  # empty places do not count
    whole = last + LENGTH + CONTACT / 2
    assert look(simple, 0.0, **bumps(heights), length=whole + 1e-6)["bumps_beyond_end"] == 0
    assert look(simple, 0.0, **bumps(heights), length=whole - 1e-6)["bumps_beyond_end"] == 1
    assert not look(simple, np.linspace(15, 30, 300), **bumps(heights), length=15.0)["road.fl.height"].any()


def test_beyond_its_end_the_road_is_held_at_its_last_height(simple):
    end = START + LENGTH / 2 - 0.05
    y = look(simple, end + np.array([-1e-9, 1e-9, 0.1, 50.0]), 10.0, **bumps({1: 0.05}), length=end)
    assert y["road.fl.height"] == pytest.approx([y["road.fl.height"][0]] * 4, abs=1e-9)
    assert y["road.fl.height"][0] > 0.03
    assert list(y["road.fl.slope"] != 0) == [True, False, False, False]
    assert list(y["end_of_road"]) == [0, 1, 1, 1]


def test_road_has_no_memory_and_says_what_it_depends_on(road):
    assert road.size("state") == 0
    result = simulate(road)
    assert np.isfinite(result.outputs).all()
    heights = result.outputs[:, result.output_names.index("road.fl.height")]
    assert heights.max() > 0.04  # the reference run sees a bump
    assert set(road.dependencies["road.fl.height"]) == {"x"}
    assert set(road.dependencies["preview.rr[16]"]) == {"x", "speed"}
    assert road.dependencies["height_above_travel"] == []
