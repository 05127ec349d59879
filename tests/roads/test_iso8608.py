"""ISO 8608 roads: spectrum, classes, what left and right share, and how a run starts."""

import numpy as np
import pytest
from looks import check_preview, look
from scipy.signal import csd, welch

from build_fmus.reference import simulate
from fmu_sources.roads import RoadLayout, WheelPosition, iso8608_table, road_iso8608, road_offroad
from fmu_sources.roads.iso8608 import LENGTH, displacement_spectrum, track_correlation
from fmu_sources.vehicles import load_ride_car

CORNERS = ("fl", "fr", "rl", "rr")
TRACK = 1.516  # m, mean of both axles of the sedan
SEEDS = (1, 2, 3, 4)


@pytest.fixture(scope="module")
def road():
    return road_iso8608(RoadLayout.of(load_ride_car("sedan"), preview_count=48, preview_step=0.005)).model()


def spectra(seed, track=TRACK):
    """Wave numbers [cycles/m], one-sided spectra of left and right, real part of the cross spectrum [m3]."""
    table = iso8608_table(track, seed)
    options = {"fs": 1 / table.step, "nperseg": 4096}
    n, left = welch(table.left[:-1], **options)
    right = welch(table.right[:-1], **options)[1]
    cross = csd(table.left[:-1], table.right[:-1], **options)[1]
    inside = (n > 0.02) & (n < 2.5)
    return n[inside], left[inside], right[inside], cross[inside].real


def test_spectrum_is_the_one_of_the_standard():
    """Level at 0.1 cycles/m within 15 %, mean over the whole range within 4 %, slope -2 within 0.05."""
    for seed in SEEDS:
        n, left, right, _ = spectra(seed)
        for measured in (left, right):
            slope, _ = np.polyfit(np.log(n), np.log(measured), 1)
            assert slope == pytest.approx(-2.0, abs=0.05)
            relative = measured / displacement_spectrum(n, 0)
            assert relative.mean() == pytest.approx(1.0, abs=0.04)
            near = (n > 0.06) & (n < 0.16)
            assert relative[near].mean() == pytest.approx(1.0, abs=0.15)


def test_geometric_means_of_the_classes():
    """ISO 8608: 16, 64, 256, ... 1e-6 m3 at 0.1 cycles/m."""
    given = [displacement_spectrum(0.1, k) for k in range(8)]
    assert given == pytest.approx([16e-6, 64e-6, 256e-6, 1024e-6, 4096e-6, 16384e-6, 65536e-6, 262144e-6])


def test_nothing_outside_the_wave_numbers_of_the_standard():
    lines = np.abs(np.fft.rfft(iso8608_table(TRACK).left[:-1]))
    n = np.arange(len(lines)) / LENGTH
    rounding = lines[n > 3].max()
    assert rounding < 1e-3 * lines[(n > 2.7) & (n < 2.8)].mean()
    assert lines[n < 0.0109].max() < 1e-3


def test_what_both_sides_share_falls_with_wave_number():
    means = {}
    for low, high in ((0.03, 0.08), (0.1, 0.2), (0.3, 0.5), (0.8, 1.2), (2.0, 2.5)):
        found, expected = [], []
        for seed in SEEDS:
            n, left, right, cross = spectra(seed)
            band = (n > low) & (n < high)
            found.append(np.mean(cross[band] / np.sqrt(left[band] * right[band])))
            expected.append(np.mean(track_correlation(n[band], TRACK)))
        means[low] = np.mean(found)
        assert means[low] == pytest.approx(np.mean(expected), abs=0.05)
    assert list(means.values()) == sorted(means.values(), reverse=True)
    assert means[0.03] > 0.8
    assert abs(means[2.0]) < 0.05


def test_no_decay_or_no_track_is_the_same_road_on_both_sides(raises):
    for table in (iso8608_table(0.0), iso8608_table(TRACK, decay=0.0)):
        assert np.array_equal(table.left, table.right)
    for bad in ({"track": -1.0}, {"track": 1.0, "contact": -0.1}):
        with raises(ValueError):
            iso8608_table(**bad)


def test_seeds_are_independent_and_reproducible():
    one, two = iso8608_table(TRACK, 1), iso8608_table(TRACK, 2)
    assert abs(np.corrcoef(one.left, two.left)[0, 1]) < 0.4  # few long waves carry most of the height
    high = np.diff(one.left), np.diff(two.left)
    assert abs(np.corrcoef(*high)[0, 1]) < 0.05
    assert np.array_equal(one.left, np.round(one.left, 7))
    # The same numbers on every machine.
    found = np.rint(1e7 * np.concatenate([one.left[1000:1003], one.right[1000:1003]])).astype(int)
    expected = np.array([47698, 49579, 52104, 35938, 38842, 43696])
    assert np.abs(found - expected).max() <= 1


def test_long_enough_for_a_minute_at_80_km_h(road):
    y = look(road, np.array([60 * 80 / 3.6, LENGTH + 2.0]))
    assert list(y["end_of_road"]) == [0, 1]


def test_heights_are_those_of_the_table_times_class(road):
    table = iso8608_table(TRACK)
    x = np.array([40.0, 300.0, 777.75, 1200.05])
    node = np.rint(x / 0.05).astype(int)
    for number in range(8):
        y = look(road, x, 30.0, **{"class": number})
        here = look(road, x - 1.011, **{"class": number})
        assert here["road.fl.height"] == pytest.approx(2.0**number * table.left[node], rel=1e-6, abs=1e-12)
        assert here["road.fr.height"] == pytest.approx(2.0**number * table.right[node], rel=1e-6, abs=1e-12)
        assert np.all(np.isfinite(y["preview.rr[48]"]))


def test_a_run_starts_at_rest_and_grows(road):
    y = look(road, np.linspace(-5, 8, 50), 20.0)
    for k in CORNERS:
        assert not np.any(y[f"road.{k}.height"])
        assert not np.any(y[f"road.{k}.rate"])
    whole = look(road, np.linspace(29, 60, 200), flat=0.0, ramp=0.0)["road.fl.height"]
    grown = look(road, np.linspace(29, 60, 200))["road.fl.height"]
    np.testing.assert_array_equal(grown, whole)
    at_once = look(road, np.array([-1.011 + 0.05]), flat=0.0, ramp=0.0)["road.fl.height"][0]
    assert at_once == pytest.approx(4 * iso8608_table(TRACK).left[1], rel=1e-9)


def test_offset_starts_elsewhere_on_the_profile(road):
    table = iso8608_table(TRACK)
    x = np.array([50.0, 61.05])
    y = look(road, x - 1.011, offset=700.0)["road.fl.height"]
    assert y == pytest.approx(4 * table.left[np.rint((x + 700) / 0.05).astype(int)], rel=1e-6)
    ends = look(road, np.array([698.0, 700.0]), offset=700.0)
    assert list(ends["end_of_road"]) == [0, 1]
    assert not np.any(look(road, np.array([5.0]), offset=700.0)["road.fl.height"])
    last = look(road, np.array([1e6]), offset=1390.0, flat=0.0, ramp=0.0)
    assert last["road.fl.height"][0] == pytest.approx(4 * table.left[-1])


def test_preview_is_what_the_wheels_meet_later(road):
    check_preview(road, 100.0, 20.0, (0, 1, 20, 47), step=0.005, within=1e-9)


def test_track_follows_the_wheels():
    one = RoadLayout((WheelPosition("fl", 0.0, 0.9),), 2, 0.01)
    assert "track of 0 m" in " ".join(road_iso8608(one).notes)
    two = RoadLayout((WheelPosition("fl", 0.0, 0.9), WheelPosition("fr", 0.0, -0.8)), 2, 0.01)
    assert "track of 1.7 m" in " ".join(road_iso8608(two, seed=5).notes)
    assert "seed 5" in road_iso8608(two, seed=5).description


def test_road_has_no_memory(road):
    assert road.size("state") == 0
    assert np.isfinite(simulate(road).outputs).all()
    assert set(road.dependencies["road.fl.height"]) == {"x"}


def test_contact_averages_over_its_length():
    """A mean over 0.25 m is a sinc in wave number: waves of 0.25 m and multiples vanish, long ones stay."""
    plain, smooth = (iso8608_table(TRACK, contact=c).left[:-1] for c in (0.0, 0.25))
    before, after = np.fft.rfft(plain), np.fft.rfft(smooth)
    n = np.arange(len(before)) / LENGTH
    assert (
        np.abs(after - np.sinc(0.25 * n) * before).max() < 1e-4
    )  # the rounding of the heights; the last wave has 0.07
    step = 0.05
    means = np.convolve(np.concatenate([plain[-2:], plain, plain[:2]]), np.ones(5) * step / 0.25, "valid")
    assert np.abs(means - smooth).max() < 0.06 * np.abs(np.diff(plain)).max()


def test_offroad_is_class_e_under_the_hmmwv():
    layout = RoadLayout.of(load_ride_car("ride_car_hmmwv"), preview_count=16, preview_step=0.030)
    offroad = road_offroad(layout, name="RoadOffroadHmmwv").model()
    assert offroad.variable("class").start == (4.0,)
    assert offroad.variable("preview.fl").shape == (16,)
    table = iso8608_table(1.82, contact=0.25)
    y = look(offroad, np.array([100.0]) - 1.651)
    assert y["road.fl.height"][0] == pytest.approx(2.0**4 * table.left[2000], rel=1e-9)
    assert 4.0**4 * displacement_spectrum(0.1, 0) == pytest.approx(4096e-6)
