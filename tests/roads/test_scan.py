"""What range sensors see of a road: scan.* beside what the wheels follow."""

import numpy as np
import pytest
from looks import look

from fmu_sources.roads import RoadLayout, RoadScan, road_bumps, road_iso8608
from fmu_sources.vehicles import load_ride_car, load_sensors

SCAN = RoadScan(0.0, 0.025, 41)
LENGTH, CONTACT, FIRST = 0.305, 0.25, 10.0


def layout(scan):
    return RoadLayout.of(load_ride_car("ride_car_hmmwv"), preview_count=16, preview_step=0.030, scan=scan)


def test_bumps_are_seen_as_they_are():
    """Parabolas, not averaged over the contact; their mean over the contact is what a wheel follows."""
    y = look(road_bumps(layout(SCAN)), FIRST - 0.3)
    seen = np.array([y[f"scan.left[{i + 1}]"] for i in range(SCAN.count)])
    place = FIRST - 0.3 + SCAN.step * np.arange(SCAN.count)
    parabola = 0.057 * np.maximum(0.0, 1 - ((place - FIRST - LENGTH / 2) / (LENGTH / 2)) ** 2)
    assert seen == pytest.approx(parabola, abs=1e-12)
    crest = FIRST + LENGTH / 2
    inside = np.linspace(crest - CONTACT / 2, crest + CONTACT / 2, 2001)
    mean = np.trapezoid(0.057 * (1 - ((inside - crest) / (LENGTH / 2)) ** 2), inside) / CONTACT
    assert look(road_bumps(layout(SCAN)), crest - 1.651)["road.fl.height"] == pytest.approx(mean, abs=1e-8)


def test_sides_of_a_scan():
    y = look(road_bumps(layout(SCAN)), FIRST, side=1)
    assert max(y[f"scan.left[{i + 1}]"] for i in range(SCAN.count)) > 0.05
    assert not any(y[f"scan.right[{i + 1}]"] for i in range(SCAN.count))


def test_a_table_is_seen_as_the_wheels_follow_it():
    scan = RoadScan(1.651, 0.05, 8)
    road = road_iso8608(layout(scan))
    y, ahead = look(road, 50.0), [look(road, 50.0 + 0.05 * i) for i in range(8)]
    for side, wheel in (("left", "fl"), ("right", "fr")):
        seen = [y[f"scan.{side}[{i + 1}]"] for i in range(8)]
        assert seen == pytest.approx([a[f"road.{wheel}.height"] for a in ahead], abs=1e-9)
    assert (y["scan.start"], y["scan.step"]) == (1.651, 0.05)


def test_only_roads_that_are_asked_for_it_have_a_scan():
    names = {e.name for e in road_bumps(layout(None)).model().output_elements()}
    assert not any(n.startswith("scan.") for n in names)


def test_a_scan_follows_from_the_sensors(raises):
    sensors = load_sensors("sensors_hmmwv")
    coarse, fine = (RoadScan.of(sensors, step=s) for s in (0.1, 0.025))
    assert coarse.start <= fine.start + 0.1
    assert fine.count > 3 * coarse.count
    with raises(ValueError):
        RoadScan(0.0, 0.0, 10)
