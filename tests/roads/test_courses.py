"""Measured courses, from the folder that the environment variable SUSPENSION_ROADS names: `make test-courses`.

They are data of others and not part of this repository; what is known of them stands in their own headers.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
from looks import look
from scipy.signal import periodogram

from fmu_sources.roads import RoadLayout, road_from_file
from fmu_sources.roads.opencrg import read_opencrg
from fmu_sources.roads.rms_course import COURSES, LENGTH, course_spectrum
from fmu_sources.vehicles import load_full_car

VARIABLE = "SUSPENSION_ROADS"
FILES = sorted(Path(os.environ[VARIABLE]).glob("*.crg")) if VARIABLE in os.environ else []
INCH = 0.0254  # m
HALF = 0.91  # m, half of the track

pytestmark = pytest.mark.courses


def comments(path: Path) -> str:
    """The comment block of a file."""
    return path.read_bytes().partition(b"$ROAD_CRG")[0].decode("latin-1")


def named(pattern: str) -> list[Path]:
    return [f for f in FILES if re.search(pattern, comments(f))]


def test_there_are_courses() -> None:
    assert VARIABLE in os.environ, f"set {VARIABLE} to the folder of the courses"
    assert FILES, f"{os.environ[VARIABLE]} holds no .crg files"


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_course_becomes_a_road(path: Path) -> None:
    """A road FMU's component shows at a node what the file has there."""
    distance, left, right = read_opencrg(path, left=HALF, right=-HALF)
    assert np.isfinite([left, right]).all()
    layout = RoadLayout.of(load_full_car("hmmwv_modified"))
    half = max(abs(w.y) for w in layout.wheels)
    distance, left, right = read_opencrg(path, left=half, right=-half)
    k = int(np.argmax(np.abs(left - left[0])))
    front = next(w for w in layout.wheels if w.corner == "fl")
    shown = look(road_from_file(path, layout), distance[k] - front.x)
    assert shown["road.fl.height"] == pytest.approx(left[k] - (left[0] + right[0]) / 2, abs=1e-6)


@pytest.mark.parametrize("path", named("Detrended RMS"), ids=lambda p: p.stem)
def test_the_rms_is_that_of_the_header(path: Path) -> None:
    """Of the stretch that the header names.

    It gives the rms of the data before they were sampled: 1.3 % off at most.
    """
    text = comments(path)
    told, length, begin = (
        float(re.search(rf"{words} = ([\d.]+)", text)[1])  # type: ignore[index]
        for words in ("Detrended RMS", "Length of undulated surface", "Undulated surface starts at")
    )
    distance, left, right = read_opencrg(path, left=HALF, right=-HALF)
    np.testing.assert_array_equal(left, right)
    stretch = left[(distance >= begin) & (distance <= begin + length)]
    assert np.sqrt(np.mean(stretch**2)) / INCH == pytest.approx(told, rel=0.013)


@pytest.mark.parametrize("path", named("Detrended RMS"), ids=lambda p: p.stem)
def test_the_synthetic_course_of_that_rms_has_its_spectrum(path: Path) -> None:
    """The rms is that of the header.

    Band by band the spectrum is the one that was fitted to the file, within 25 % and what that many lines scatter.
    """
    told = float(re.search(r"Detrended RMS = ([\d.]+)", comments(path))[1]) * INCH  # type: ignore[index]
    name = next(n for n, c in COURSES.items() if c.rms == pytest.approx(told, rel=1e-4))
    assert name in path.stem
    distance, left, _ = read_opencrg(path, left=HALF, right=-HALF)
    stretch = left[(distance >= 100) & (distance < 100 + LENGTH)]
    n, found = periodogram(stretch, 1 / np.diff(distance)[0])
    for low in np.geomspace(0.05, 6.0, 10):
        band = (n >= low) & (n < 1.6 * low)
        expected = course_spectrum(name, n[band]).mean() * np.mean(stretch**2) / told**2
        assert found[band].mean() == pytest.approx(expected, rel=0.25 + 2 / np.sqrt(band.sum())), low


@pytest.mark.parametrize("path", named("halfround obstacle H ="), ids=lambda p: p.stem)
def test_the_height_of_an_obstacle_is_that_of_the_header(path: Path) -> None:
    told = float(re.search(r"H = ([\d.]+) in", comments(path))[1])  # type: ignore[index]
    _, left, _ = read_opencrg(path, left=HALF, right=-HALF)
    assert left.max() / INCH == pytest.approx(told, rel=2e-4)
    assert left.min() == 0.0
