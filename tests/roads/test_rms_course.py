"""Synthetic RMS courses: rms, spectrum and correlation are those that are claimed.

Half-rounds and rolling wheels by geometry.
"""

import numpy as np
import pytest
from looks import check_preview, look
from scipy.signal import periodogram

from fmu_sources.roads import RoadLayout, road_from_file, road_proving_ground
from fmu_sources.roads.enveloping import rolled
from fmu_sources.roads.rms_course import (
    COURSES,
    INCH,
    KNOTS,
    LENGTH,
    RAMP,
    STEP,
    course_heights,
    course_spectrum,
    driven,
)
from fmu_sources.vehicles import load_ride_car

TRACK = 1.82  # m
RADIUS = 0.47  # m
RMS = {"1in": 0.02462, "2in": 0.04430, "4in": 0.08383}  # m, of the headers of the measured courses
PEAK = {
    "1in": (0.16, 1.0e-3),
    "2in": (0.16, 4.5e-3),
    "4in": (0.16, 2.6e-2),
}  # cycles/m, m3: least that is near the peak


@pytest.fixture(scope="module")
def layout():
    return RoadLayout.of(load_ride_car("ride_car_hmmwv"), preview_count=4, preview_step=0.03)


@pytest.fixture(scope="module")
def road(layout):
    return road_proving_ground(layout, radius=RADIUS).model()


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("alike", [True, False])
def test_rms_is_that_of_the_measured_course(course, alike):
    for seed in (1, 7, 100):
        for heights in course_heights(course, seed, TRACK, alike=alike):
            assert len(heights) == round(LENGTH / STEP) + 1
            assert np.sqrt(np.mean(heights[:-1] ** 2)) == pytest.approx(RMS[course], rel=5e-4)
            assert heights[:-1].mean() == pytest.approx(0.0, abs=1e-12)
            slope = np.polyfit(np.arange(len(heights)) * STEP, heights, 1)[0]
            assert abs(slope) * LENGTH < 0.15 * RMS[course]  # no trend is left


def spectrum(heights):
    """Wave numbers [cycles/m] and one-sided spectrum [m3] of one period."""
    return periodogram(heights[:-1], 1 / STEP)


@pytest.mark.parametrize("course", COURSES)
def test_spectrum_is_the_fitted_one(course):
    """The mean spectrum of seeds and of both sides, band by band.

    Within four times what that many lines scatter, and the 5 % by which bringing each profile to its rms lifts the mean
    of what is off the peak.
    """
    seeds = 40
    sides = zip(*(course_heights(course, seed, TRACK, alike=False) for seed in range(seeds)), strict=True)
    for heights in sides:
        found = [spectrum(z) for z in heights]
        n, mean = found[0][0], np.mean([s for _, s in found], axis=0)
        for low in np.geomspace(0.02, 6.0, 12):
            band = (n >= low) & (n < 1.5 * low)
            expected = course_spectrum(course, n[band]).mean()
            assert mean[band].mean() == pytest.approx(expected, rel=4 / np.sqrt(seeds * band.sum()) + 0.05), low
    n0, least = PEAK[course]
    assert course_spectrum(course, np.array([n0]))[0] > least
    assert (
        course_spectrum(course, np.array([KNOTS[0], KNOTS[-1]])).max()
        < 0.01 * course_spectrum(course, np.array([n0]))[0]
    )


def test_sides_are_alike_or_correlated_as_stated():
    left, right = course_heights("2in", 1, TRACK)
    np.testing.assert_array_equal(left, right)
    pairs = [course_heights("2in", seed, TRACK, alike=False) for seed in range(40)]
    lines = [[np.fft.rfft(z[:-1]) for z in pair] for pair in pairs]
    n = np.fft.rfftfreq(len(pairs[0][0]) - 1, STEP)
    for low, high in ((0.1, 0.2), (0.3, 0.5), (0.8, 1.6)):
        band = (n >= low) & (n < high)
        cross = sum((a * b.conj()).real[band] for a, b in lines)
        own = sum((abs(a) ** 2 + abs(b) ** 2)[band] / 2 for a, b in lines)
        assert np.mean(cross / own) == pytest.approx(np.exp(-2 * TRACK * n[band]).mean(), abs=0.06)


def test_seeds_are_different_roads():
    first, second = (course_heights("1in", seed, TRACK)[0] for seed in (1, 2))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.2


def test_a_road_shows_what_a_wheel_follows(road):
    """In the course, on its ramps, and beyond; of the side and seed that were chosen."""
    left, right = course_heights("4in", 3, TRACK, alike=False)
    nodes = np.array([0, 7, 1234, round(LENGTH / STEP)])
    front = 1.651
    for alike in (True, False):
        seen = look(road, nodes * STEP - front, course=2, seed=3, alike=alike)
        ramp = round(RAMP / STEP)
        np.testing.assert_allclose(seen["road.fl.height"], driven(left, RADIUS)[ramp + nodes], atol=1e-9)
        other = left if alike else right
        np.testing.assert_allclose(seen["road.fr.height"], driven(other, RADIUS)[ramp + nodes], atol=1e-9)
    for x in (-RAMP - 3.0, LENGTH + RAMP + 3.0):
        assert look(road, x - front, course=2)["road.fl.height"] == pytest.approx(0.0, abs=1e-9)


def test_preview_is_what_comes(road):
    check_preview(road, 100.0, 9.0, (1, 3), step=0.03, within=1e-12, course=1, seed=2, alike=False)


# ------------------------------------------------------------------------------------------------------- rolling wheels


def test_a_disc_touches_a_half_round_where_geometry_says():
    """The path over a half circle is an arc of the sum of the radii, and nothing before the disc touches."""
    step, height, radius = 0.002, 0.2, 0.5
    s = np.arange(-1500, 1501) * step
    ground = np.sqrt(np.maximum(height**2 - s**2, 0.0))
    expected = np.maximum(np.sqrt(np.maximum((height + radius) ** 2 - s**2, 0.0)) - radius, 0.0)
    np.testing.assert_allclose(rolled(ground, step, radius), expected, atol=2e-3)


def test_rolling_keeps_long_waves_and_bridges_short_ones(raises):
    x = np.arange(4000) * 0.01
    long, short = 0.05 * np.sin(2 * np.pi * x / 10), 0.02 * np.sin(2 * np.pi * x / 0.1)
    np.testing.assert_allclose(rolled(long, 0.01, 0.5)[100:-100], long[100:-100], atol=5e-4)
    bridged = rolled(short, 0.01, 0.5)[100:-100]
    assert bridged.min() > 0.015
    np.testing.assert_array_equal(rolled(short, 0.01, 0.0), short)
    with raises(ValueError):
        rolled(short, 0.01, -1.0)


@pytest.mark.parametrize("height", [0.1016, 0.3048])
def test_half_round_is_the_path_of_the_disc(road, height):
    x = 30.0 + np.linspace(-1.2, 1.2, 241)
    seen = look(road, x - 1.651, speed=2.0, course=3, half_round__height=height)
    s = x - 30.0
    reach = np.sqrt((height + RADIUS) ** 2 - RADIUS**2)
    inside = np.abs(s) < reach - 1e-6
    arc = np.sqrt((height + RADIUS) ** 2 - s[inside] ** 2)
    for k in ("fl", "fr"):
        np.testing.assert_allclose(seen[f"road.{k}.height"][inside], arc - RADIUS, atol=1e-12)
        np.testing.assert_allclose(seen[f"road.{k}.slope"][inside], -s[inside] / arc, atol=1e-12)
        np.testing.assert_allclose(seen[f"road.{k}.rate"], 2.0 * seen[f"road.{k}.slope"], atol=1e-12)
        assert (seen[f"road.{k}.height"][np.abs(s) > reach + 1e-6] == 0).all()
    assert seen["road.fl.height"].max() == pytest.approx(height)
    check_preview(road, 27.0, 10.0, (1, 2), step=0.03, within=1e-12, course=3)


def test_a_users_file_is_rolled_over_too(tmp_path, layout):
    """A wall of 0.1 m: the wheel rises before it, on the arc about its edge."""
    path = tmp_path / "step.csv"
    path.write_text(
        "distance [m],left [m],right [m]\n"
        + "".join(f"{x / 100},{z},{z}\n" for x in range(1001) for z in [0.1 * (x >= 500)])
    )
    front = 1.651
    point, disc = (road_from_file(path, layout, radius=r) for r in (0.0, RADIUS))
    ahead = 5.0 - 0.2 - front
    assert look(point, ahead)["road.fl.height"] == 0.0
    expected = 0.1 + np.sqrt(RADIUS**2 - 0.2**2) - RADIUS
    assert look(disc, ahead)["road.fl.height"] == pytest.approx(expected, abs=1e-9)
    assert COURSES["1in"].rms / INCH == pytest.approx(0.96944)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_smoothest_course_has_more_short_waves_than_the_next(seed: int) -> None:
    """What the study says where a car that rides on its tires is slower on it; waves of less than a meter."""

    def short(course: str) -> float:
        heights = course_heights(course, seed, TRACK)[0][:-1]
        waves = np.fft.rfft(heights)
        waves[np.fft.rfftfreq(len(heights), STEP) < 1.0] = 0.0
        return float(np.std(np.fft.irfft(waves, len(heights))))

    assert short("1in") > 1.4 * short("2in")
