"""Random roads that compute their profile from class, seed and length.

Spectrum, coherence, seeds, lengths, and the FMU's own numbers.
"""

import casadi as ca
import numpy as np
import pytest
from scipy.signal import csd, welch

from build_fmus.component import Component, DeclarationError
from build_fmus.random_profiles import phases
from build_fmus.reference import Evaluator
from cosim import System
from fmu_sources.roads import RoadLayout, WheelPosition, road_random
from fmu_sources.roads.iso8608 import STEP, displacement_spectrum, track_correlation
from fmu_sources.roads.random_road import LONGEST, NODES
from fmu_sources.vehicles import load_full_car

TRACK = 1.82  # m, of the HMMWV
SEEDS = (1, 2, 3, 4)
BITS = ["0x1.a6dc3785c64dcp-6", "0x1.1cb5e0f921369p-6"]  # heights 2.5 m into the road of seed 42
WHOLE = {"flat": 0.0, "ramp": 0.0}  # the profile as it is


@pytest.fixture(scope="module")
def road():
    return road_random(RoadLayout.of(load_full_car("hmmwv"))).model()


def tracks(road, **parameters):
    """Heights [m] of left and right at all nodes of the period."""
    p = {"length": LONGEST, **parameters}
    (heights,) = Evaluator(road, p).random_profiles()
    n = road.profiles[0].nodes(p["length"])
    return heights.reshape(2, -1)[:, :n]


def spectra(road, seed):
    left, right = tracks(road, seed=seed, **{"class": 0})
    options = {"fs": 1 / STEP, "nperseg": 4096}
    n, of_left = welch(left, **options)
    cross = csd(left, right, **options)[1].real
    inside = (n > 0.02) & (n < 2.5)
    return n[inside], of_left[inside], welch(right, **options)[1][inside], cross[inside]


def test_spectrum_is_the_one_of_the_standard(road):
    """As that of the tabled road: level at 0.1 cycles/m within 15 %, whole range within 4 %, slope -2 within 0.05."""
    for seed in SEEDS:
        n, left, right, _ = spectra(road, seed)
        for measured in (left, right):
            slope, _ = np.polyfit(np.log(n), np.log(measured), 1)
            assert slope == pytest.approx(-2.0, abs=0.05)
            relative = measured / displacement_spectrum(n, 0)
            assert relative.mean() == pytest.approx(1.0, abs=0.04)
            assert relative[(n > 0.06) & (n < 0.16)].mean() == pytest.approx(1.0, abs=0.15)


def test_each_line_has_its_power_and_there_are_no_others(road):
    """Over seeds the mean power of each line is the spectrum's, whatever left and right share."""
    length, count = 400.0, 8192
    roads = (tracks(road, seed=s, length=length, **{"class": 3})[0] for s in range(60))
    power = np.mean([np.abs(np.fft.rfft(heights)) ** 2 for heights in roads], axis=0)
    n = np.arange(len(power)) / (count * STEP)
    inside = (n >= 0.011) & (n <= 2.83)
    density = 2 * power / count * STEP
    relative = density[inside] / displacement_spectrum(n[inside], 3)
    assert relative.mean() == pytest.approx(1.0, abs=0.01)
    for part in np.array_split(relative, 20):
        assert part.mean() == pytest.approx(1.0, abs=0.05)
    assert density[~inside].max() < 1e-12 * density[inside].min()


def test_what_both_sides_share_falls_with_wave_number(road):
    for low, high in ((0.03, 0.08), (0.1, 0.2), (0.3, 0.5), (0.8, 1.2), (2.0, 2.5)):
        found, expected = [], []
        for seed in SEEDS:
            n, left, right, cross = spectra(road, seed)
            band = (n > low) & (n < high)
            found.append(np.mean(cross[band] / np.sqrt(left[band] * right[band])))
            expected.append(np.mean(track_correlation(n[band], TRACK)))
        assert np.mean(found) == pytest.approx(np.mean(expected), abs=0.05)


def test_class_scales_and_decay_and_contact_do_as_for_tables(road):
    one = tracks(road, **{"class": 1})
    np.testing.assert_allclose(tracks(road, **{"class": 4}), 8 * one, rtol=1e-12)
    left, right = tracks(road, decay=0.0)
    np.testing.assert_array_equal(left, right)
    before, after = (np.fft.rfft(tracks(road, contact=c)[0]) for c in (0.0, 0.25))
    n = np.arange(len(before)) / (NODES[1] * STEP)
    np.testing.assert_allclose(after, np.sinc(0.25 * n) * before, atol=1e-9 * np.abs(before).max())


def test_seeds_are_unrelated(road):
    """Also neighbors and the largest; phases are even over the circle."""
    slopes = [np.diff(tracks(road, seed=s)[0]) for s in (0, 1, 2, 1000, 2**31 - 2, 2**31 - 1)]
    correlation = np.corrcoef(slopes) - np.eye(len(slopes))
    assert np.abs(correlation).max() < 0.05
    turns = phases(7, np.arange(100_000)) / (2 * np.pi)
    assert np.histogram(turns, 10, (0, 1))[0] == pytest.approx(np.full(10, 10_000), rel=0.04)
    assert abs(np.corrcoef(turns[:-1], turns[1:])[0, 1]) < 0.01


def test_splitmix64_as_published():
    """The first numbers of the sequence that begins at 1234567, as its authors' code gives them."""
    from build_fmus.random_profiles import _GOLDEN, _mixed

    first = [int(_mixed(np.array([(1234567 + k * _GOLDEN) % 2**64], np.uint64))[0]) for k in (1, 2, 3)]
    assert first == [6457827717110365317, 3203168211198807973, 9817491932198370423]


@pytest.mark.parametrize(
    ("length", "nodes"), [(1.0, 4096), (204.7, 4096), (204.8, 8192), (500.0, 16384), (1600.0, 32768)]
)
def test_the_period_covers_the_length(road, length, nodes):
    assert road.profiles[0].nodes(length) == nodes


@pytest.fixture(scope="module")
def driven(built_fmus):
    """A function that drives one system over a road, 50 m/s or a node each millisecond."""
    systems = {}

    def drive(fmi, state=None, **parameters):
        if fmi not in systems:
            made = System()
            made.add("speed", built_fmus.path("SpeedProfile", fmi), start={"start.speed": 50.0, "start.x": 0.0})
            made.add("road", built_fmus.path("RoadRandom", fmi), start={"wheel.fl.x": 0.0, "wheel.fr.x": 0.0})
            made.connect("speed.x", "road.x")
            made.connect("speed.speed", "road.speed")
            systems[fmi] = made
        system = systems[fmi]
        system["road"].set({**WHOLE, **parameters})
        return system.initialize(record=["road.road.fl.height", "road.road.fr.height"], state=state)

    return drive


def heights(simulation):
    recording = simulation.recording
    return np.array([recording[f"road.road.{c}.height"] for c in ("fl", "fr")])


@pytest.mark.parametrize(("seed", "length"), [(1, 200.0), (2**31 - 1, 410.0)])
def test_the_fmu_has_these_numbers_and_both_versions_the_same_bits(road, driven, seed, length):
    found = []
    for fmi in (2, 3):
        simulation = driven(fmi, seed=seed, length=length)
        simulation.advance(3.0)
        found.append(heights(simulation))
    assert found[0].tobytes() == found[1].tobytes()
    expected = tracks(road, seed=seed, length=length)
    np.testing.assert_allclose(found[0][:, 1:-1], expected[:, 1 : found[0].shape[1] - 1], rtol=0, atol=1e-9)


def test_bits_of_a_seed(driven):
    """The same on every platform: the numbers of x86-64 Linux with gcc."""
    simulation = driven(3, seed=42, length=200.0)
    simulation.advance(0.1)
    assert [float(h).hex() for h in heights(simulation)[:, 50]] == BITS


def test_a_state_brings_its_own_road(driven):
    """Saved on one road, continued where another one was computed in the meantime: the same bits."""
    simulation = driven(3, seed=5)
    simulation.advance(1.0)
    state = simulation.save()
    simulation.advance(2.0)
    straight = heights(simulation)
    again = driven(3, seed=6)
    again.advance(0.5)
    assert not np.array_equal(heights(again)[:, -1], straight[:, 500])
    again = driven(3, seed=5, state=state)
    again.advance(2.0)
    np.testing.assert_array_equal(heights(again)[:, -900:], straight[:, -900:])


def test_reset_and_another_seed(driven):
    """One instance, seed after seed: what a fresh one would have."""
    first, second, third = [], [], []
    for seed, into in ((1, first), (2, second), (1, third)):
        simulation = driven(2, seed=seed)
        simulation.advance(0.2)
        into.append(heights(simulation))
    np.testing.assert_array_equal(first, third)
    assert not np.array_equal(first, second)


def component():
    made = Component("Rough", kind="discrete", sample_time=1e-3, description="rough", source="own", symbols=ca.MX)
    return made, made.parameter("seed", 1, None, "seed", source="own"), made.input("x", "m", "position")


def declare(made, seed, **other):
    options = {
        "length": 10.0,
        "spectra": lambda n: (1e-6 + 0 * n, 0 * n),
        "step": 0.1,
        "nodes": (8, 16),
        "wave_numbers": (0.5, 4.0),
    }
    return made.random_profiles("profile", seed=seed, **options | other)


@pytest.mark.parametrize(
    "other",
    [
        {"nodes": (8, 12)},
        {"nodes": (16, 8)},
        {"wave_numbers": (0.5, 6.0)},
        {"step": 0.0},
        {"spectra": lambda n: (n, ca.vertcat(n, n))},
    ],
)
def test_what_is_declared_wrongly(other, raises):
    made, seed, _ = component()
    with raises(DeclarationError):
        declare(made, seed, **other)


def test_profiles_follow_from_parameters_only(raises):
    made, seed, x = component()
    with raises(DeclarationError):
        declare(made, seed, length=x)
    declare(made, seed)
    with raises(DeclarationError):
        declare(made, seed)
    with pytest.raises(DeclarationError, match=r"symbols=ca\.MX"):
        declare(Component("Fine", kind="discrete", sample_time=1.0, description="fine", source="own"), 1)


def test_track_follows_the_wheels():
    one = RoadLayout((WheelPosition("fl", 0.0, 0.9),), 2, 0.01)
    assert road_random(one).model().variable("track").start == (0.0,)
    two = RoadLayout((WheelPosition("fl", 0.0, 0.9), WheelPosition("fr", 0.0, -0.8)), 2, 0.01)
    assert road_random(two).model().variable("track").start == pytest.approx((1.7,))
