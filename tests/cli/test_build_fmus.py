"""What users of `build-fmus` can do wrong: each message names the thing and says what to do."""

from __future__ import annotations

from pathlib import Path

import pytest
from built import share_objects
from programs import refused, run

import fmu_sources

VEHICLE = """
base = "hmmwv_modified"
name = "My truck"
description = "a heavier one"
[body]
mass = { value = 6000.0, unit = "kg", source = "assumed" }
"""
ROAD = "distance [m],left [m],right [m]\n0,0,0\n1,0.1,0\n2,0,0\n"


@pytest.mark.parametrize(
    "change",
    [
        ("mass =", "mas ="),
        ("6000.0", "-5.0"),
        ('"kg"', '"lb"'),
        ("6000.0", "nan"),
        ("6000.0", '"heavy"'),
        (', source = "assumed"', ""),
        ("hmmwv_modified", "hmmwv_modifed"),
        ("[body]", "[body"),
    ],
    ids=lambda x: x[1][:14] if isinstance(x, tuple) else None,
)
def test_mistakes_in_a_vehicle_file(change: tuple[str, str], tmp_path: Path, sentence) -> None:
    (tmp_path / "truck.toml").write_text(VEHICLE.replace(*change))
    sentence(refused(tmp_path, "build-fmus", "FullCarTruck", "--vehicle", "truck.toml"))


@pytest.mark.parametrize(
    "road",
    [
        ROAD.replace("1,0.1", "1,"),
        ROAD.replace("1,0.1,0\n", "\n"),
        ROAD.replace("0.1", "high"),
        ROAD.replace("\n1,", "\n3,"),
        ROAD.replace(",right [m]", ""),
        ROAD.replace("distance [m]", "distance [ft]"),
        "",
    ],
    ids=["gap", "empty line", "text", "decreasing", "column", "unit", "empty"],
)
def test_mistakes_in_a_road_file(road: str, tmp_path: Path, sentence) -> None:
    (tmp_path / "road.csv").write_text(road)
    sentence(refused(tmp_path, "build-fmus", "--road", "road.csv", "--name", "RoadMine"))


@pytest.mark.parametrize(
    "arguments",
    [
        ["RoadSin"],
        ["NoSuchFmu"],
        ["--fmi", "4"],
        ["--qp", "gurobi"],
        ["Skyhook", "--precision", "single"],
        ["Skyhook", "--target", "cortex-m7", "--precision", "half"],
        ["SpeedProfile", "--platform", "amiga"],
        ["--vehicle", "none.toml"],
        ["--vehicle", "."],
        ["--road", "none.csv"],
        ["--name", "RoadMine"],
        ["SpeedProfile", "--out", "file/fmus"],
    ],
    ids=" ".join,
)
def test_mistakes_in_the_arguments(arguments: list[str], tmp_path: Path, sentence) -> None:
    (tmp_path / "file").touch()
    sentence(refused(tmp_path, "build-fmus", *arguments))


def test_an_option_that_does_not_exist(tmp_path: Path) -> None:
    assert "--speed" in refused(tmp_path, "build-fmus", "--speed")


def test_a_users_file_cannot_replace_a_published_fmu(tmp_path: Path, sentence) -> None:
    (tmp_path / "sine.csv").write_text(ROAD)
    sentence(refused(tmp_path, "build-fmus", "--road", "sine.csv"))
    (tmp_path / "hmmwv.toml").write_text(VEHICLE)
    sentence(refused(tmp_path, "build-fmus", "--vehicle", "hmmwv.toml"))
    (tmp_path / "+.toml").write_text(VEHICLE)
    sentence(refused(tmp_path, "build-fmus", "--vehicle", "+.toml"))


def test_list_shows_what_a_vehicle_file_makes(tmp_path: Path) -> None:
    (tmp_path / "my_truck.toml").write_text(VEHICLE)
    done = run(tmp_path, "build-fmus", "--vehicle", "my_truck.toml", "--list")
    assert done.returncode == 0, done.stderr
    for name in ("SpeedProfile", "FullCarMyTruck", "RoadSineMyTruck", "GpcPreviewMyTruck"):
        assert name in done.stdout


OWN = """
from build_fmus.component import Component


def make():
    c = Component("MyMass", kind="continuous", description="A mass", source="Newton")
    mass = c.parameter("mass", 2.0, "kg", "mass", min=0.1, source="own")
    force = c.input("force", "N", "applied force")
    v = c.state("v", "m/s", "velocity", output=True)
    c.derivative(v, force / mass)
    return c


def number():
    return 3
"""


def test_a_component_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    share_objects(tmp_path / "fmus")
    done = run(tmp_path, "build-fmus", "--from", "own.py", "--fmi", "2")
    assert done.returncode == 0
    assert (tmp_path / "fmus" / "fmi2" / "MyMass.fmu").is_file()


@pytest.mark.parametrize(
    ("source", "argument"),
    [
        (OWN, "own.py:mak"),
        (OWN, "own.py:number"),
        ("import nothing_of_this_name", "own.py"),
        (OWN.replace("MyMass", "SpeedProfile"), "own.py"),
        (OWN, "other.py"),
        (OWN.replace("force / mass", "force / 2"), "own.py"),
    ],
)
def test_mistakes_in_a_component_of_ones_own(source: str, argument: str, tmp_path: Path, sentence) -> None:
    (tmp_path / "own.py").write_text(source)
    sentence(refused(tmp_path, "build-fmus", "--from", argument))


@pytest.mark.parametrize(
    "change", [("heave = 3.0", "heave = -3.0"), ("heave = 3.0", "heav = 3.0"), ("front = 1e-6", "front = 0.0")]
)
def test_mistakes_in_a_weights_file(change: tuple[str, str], tmp_path: Path, sentence) -> None:
    text = (Path(fmu_sources.__file__).parent / "controllers" / "lq" / "weights" / "comfort.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace(*change, 1))
    sentence(refused(tmp_path, "build-fmus", "--weights", "mine.toml"))


def test_a_law_of_ones_own_weights(tmp_path: Path) -> None:
    text = (Path(fmu_sources.__file__).parent / "controllers" / "lq" / "weights" / "comfort.toml").read_text()
    (tmp_path / "my_weights.toml").write_text(text.replace("heave = 3.0", "heave = 5.0", 1))
    share_objects(tmp_path / "fmus")
    done = run(tmp_path, "build-fmus", "--weights", "my_weights.toml", "--period", "0.005", "--fmi", "3")
    assert done.returncode == 0
    assert (tmp_path / "fmus" / "fmi3" / "PreviewLqMyWeights.fmu").is_file()
