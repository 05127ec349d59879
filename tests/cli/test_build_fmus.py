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
    ("change", "message"),
    [
        (("mass =", "mas ="), "body.mas: unknown field; did you mean 'mass'?"),
        (("6000.0", "-5.0"), "body.mass: -5 kg is out of range: it must be at least 10 kg"),
        (('"kg"', '"lb"'), "body.mass: unit 'lb' where 'kg' is expected (accepted: kg)"),
        (("6000.0", "nan"), "body.mass.value: nan is not a finite number"),
        (("6000.0", '"heavy"'), "body.mass.value: input should be a valid number"),
        ((', source = "assumed"', ""), "body.mass.source: missing; say where the value comes from"),
        (("hmmwv_modified", "hmmwv_modifed"), "base: no vehicle 'hmmwv_modifed'"),
        (("[body]", "[body"), "not a TOML file"),
    ],
    ids=lambda x: x[1][:14] if isinstance(x, tuple) else None,
)
def test_mistakes_in_a_vehicle_file(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    (tmp_path / "truck.toml").write_text(VEHICLE.replace(*change))
    text = refused(tmp_path, "build-fmus", "FullCarTruck", "--vehicle", "truck.toml")
    assert text.startswith(f"build-fmus: truck.toml: {message}")


@pytest.mark.parametrize(
    ("road", "message"),
    [
        (ROAD.replace("1,0.1", "1,"), "road.csv, line 3: no value for 'left'; roads must not have gaps"),
        (ROAD.replace("1,0.1,0\n", "\n"), "road.csv, line 3: empty line"),
        (ROAD.replace("0.1", "high"), "road.csv, line 3: left is 'high', which is not a number"),
        (ROAD.replace("\n1,", "\n3,"), "road.csv, line 4: distance 2 m after 3 m; distances must increase"),
        (ROAD.replace(",right [m]", ""), "road.csv, line 1: no column 'right' among 'distance', 'left'"),
        (ROAD.replace("distance [m]", "distance [ft]"), "road.csv, line 1: column 'distance': unit 'ft'"),
        ("", "road.csv: empty; a road needs the header"),
    ],
    ids=["gap", "empty line", "text", "decreasing", "column", "unit", "empty"],
)
def test_mistakes_in_a_road_file(road: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "road.csv").write_text(road)
    text = refused(tmp_path, "build-fmus", "--road", "road.csv", "--name", "RoadMine")
    assert message in text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["RoadSin"], "no FMU named 'RoadSin'; did you mean 'RoadSine'?"),
        (["--fmi", "4"], "--fmi 4: choose 2, 3 or both"),
        (["--qp", "gurobi"], "--qp gurobi: choose daqp or osqp"),
        (["SpeedProfile", "--platform", "amiga"], "unknown platform 'amiga'; choose from host, all"),
        (["--vehicle", "none.toml"], "none.toml: no such file"),
        (["--vehicle", "."], ".: this is a folder"),
        (["--road", "none.csv"], "none.csv: no such file"),
        (["--name", "RoadMine"], "--name names the "),
        (["SpeedProfile", "--out", "file/fmus"], "cannot write to file/fmus"),
        (["--speed"], "No such option"),
    ],
)
def test_mistakes_in_the_arguments(arguments: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert message in refused(tmp_path, "build-fmus", *arguments)


def test_a_users_file_cannot_replace_a_published_fmu(tmp_path: Path) -> None:
    (tmp_path / "sine.csv").write_text(ROAD)
    text = refused(tmp_path, "build-fmus", "--road", "sine.csv")
    assert "sine.csv would replace the FMU RoadSine; rename the file, or choose a name with --name" in text
    (tmp_path / "hmmwv.toml").write_text(VEHICLE)
    text = refused(tmp_path, "build-fmus", "--vehicle", "hmmwv.toml")
    assert "hmmwv.toml would replace the published FullCarHmmwv, RoadProvingGroundHmmwv; rename the file" in text
    (tmp_path / "+.toml").write_text(VEHICLE)
    assert "its name needs letters or digits" in refused(tmp_path, "build-fmus", "--vehicle", "+.toml")


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
    ("source", "argument", "message"),
    [
        (OWN, "own.py:mak", "own.py has no function 'mak'; name one with FILE.py:FUNCTION (it has make, number)"),
        (OWN, "own.py:number", "own.py: number() returned int, not a Component"),
        ("import nothing_of_this_name", "own.py", "own.py: ModuleNotFoundError"),
        (OWN.replace("MyMass", "SpeedProfile"), "own.py", "own.py would replace the published SpeedProfile"),
        (OWN, "other.py", "other.py: no such file"),
        (
            OWN.replace("force / mass", "force / 2"),
            "own.py",
            "MyMass: dimensions: der(v): declared in m/s per s, which has kg^0, but its expression scales with kg^1.",
        ),
    ],
)
def test_mistakes_in_a_component_of_ones_own(source: str, argument: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(source)
    assert refused(tmp_path, "build-fmus", "--from", argument).startswith(f"build-fmus: {message}")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("heave = 3.0", "heave = -3.0"), "acceleration.heave = -3.0: Input should be greater than or equal to 0"),
        (("heave = 3.0", "heav = 3.0"), "acceleration.heave: missing"),
        (("front = 1e-6", "front = 0.0"), "force.front = 0.0: Input should be greater than 0"),
    ],
)
def test_mistakes_in_a_weights_file(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    text = (Path(fmu_sources.__file__).parent / "controllers" / "lq" / "weights" / "comfort.toml").read_text()
    (tmp_path / "mine.toml").write_text(text.replace(*change, 1))
    assert message in refused(tmp_path, "build-fmus", "--weights", "mine.toml")


def test_a_law_of_ones_own_weights(tmp_path: Path) -> None:
    text = (Path(fmu_sources.__file__).parent / "controllers" / "lq" / "weights" / "comfort.toml").read_text()
    (tmp_path / "my_weights.toml").write_text(text.replace("heave = 3.0", "heave = 5.0", 1))
    share_objects(tmp_path / "fmus")
    done = run(tmp_path, "build-fmus", "--weights", "my_weights.toml", "--period", "0.005", "--fmi", "3")
    assert done.returncode == 0
    assert (tmp_path / "fmus" / "fmi3" / "PreviewLqMyWeights.fmu").is_file()
