"""FMUs of a user's vehicle files of every kind, and of their roads under any vehicle."""

from __future__ import annotations

import json
import math
import re
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from built import FMUS, BuiltFmus, share_objects
from programs import refused, run

import fmu_sources
from build_fmus.builder import Options
from build_fmus.description_xml import model_description
from cosim import System
from cosim.fmu.model_description import parse
from fmu_sources import cli
from fmu_sources.catalog import Context
from fmu_sources.cli import UserFiles
from fmu_sources.own_catalog import catalog_suffix, own_catalog
from fmu_sources.vehicles import load_three_axle_trench, load_vehicle, vehicle_files, vehicle_names

FILE = 'base = "{base}"\nname = "Mine"\ndescription = "another"\n{more}'
MASS = '[body]\nmass = {{ value = {mass}, unit = "kg", source = "assumed" }}\n'
ROAD = "distance [m],left [m],right [m]\n0,0,0\n20,0,0\n20.3,0.05,0.02\n20.6,0,0\n100,0,0\n"
FULL_CAR = {
    "FullCar",
    "RoadSine",
    "RoadCurb",
    "RoadPerryman3",
    "RoadRandom",
    "RoadProvingGround",
    "GpcImplicit",
    "GpcExplicit",
    "GpcPreview",
}
HMMWV = {
    "RideCar",
    "Lqr",
    "Lqr{}Kilonewton",
    "Skyhook",
    *(f"SemiActive{law}" for law in ("Skyhook", "Groundhook", "Add", "ShAdd", "Lqr", "Mpc")),
    "Mpc",
    "Mpc{}Tunable",
    "Kalman",
    "Kalman{}Printed",
    "PreviewSensor",
    "PreviewBuffer",
    "RoadBumps",
    "RoadOffroad",
    "RoadHoleBump",
    "RoadIso8608",
    "RoadProvingGround",
    "RoadProvingGround5ms",
}
BENCH = {"QuarterCar", "Lqr", "Mpc", "Mpc{}Moves", "Mpc{}Tunable"}
SIX = {"ThreeAxleRide", "LqrThreeAxle", "MpcThreeAxle", "RoadShallowTrench", "RoadProvingGroundThreeAxle"}
MADE = {
    "hmmwv": FULL_CAR,
    "ride_car_hmmwv": HMMWV,
    "sedan": HMMWV | {"PreviewLqComfort", "PreviewLqComfort5ms", "PreviewLqRoadHolding", "PreviewLqTunable"},
    "quarter_car_hmmwv": BENCH,
    "quarter_car_bench": BENCH,
    "three_axle": SIX,
    "three_axle_trench": SIX | {"ThreeAxleTrench", "TrenchCrossing"},
    "hmmwv_public": {"FullCar", "RideCar", "RoadHalfRound", "RoadProvingGround"},
    "actuator_hmmwv": {"HydraulicActuator", "ForceTracking"},
    "sensors_hmmwv": {"SensorSuite", "Kalman", "PreviewSensor", "RoadBumps", "RoadOffroad"},
}


def own(folder: Path, base: str, more: str = "", name: str = "mine") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(FILE.format(base=base, more=more), encoding="utf-8")
    return path


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_words_of_a_file_on_its_values_come_through(fmi: int, tmp_path: Path) -> None:
    """Whatever they are: they lie in XML, and the master reads them there."""
    words = """Prüfstand 7 <Größe> & 'Maß' "17", siehe ]]> </Variable>\tµ≈π 質量 \U0001f697\nZeile 2 """.ljust(
        1000, "…"
    )
    quoted = json.dumps(words, ensure_ascii=False)  # a string of TOML, too
    path = own(tmp_path, "quarter_car_hmmwv", f'[body]\nmass = {{ value = 3600.0, unit = "kg", source = {quoted} }}\n')
    car = own_catalog(path, "Mine")["QuarterCarMine"].make(Context(tmp_path, tmp_path)).model()
    about = parse(model_description(car, fmi, token="t", sources=[]), "mine.fmu")
    assert len(words) == 1000
    assert about.parameters["body.mass"].source == words
    assert about.parameters["wheel.mass"].source == car.variable("wheel.mass").source


@pytest.mark.parametrize("base", MADE)
def test_what_a_file_of_each_kind_makes(base: str, tmp_path: Path) -> None:
    names = {n for n in own_catalog(own(tmp_path, base), "Mine") if "Mine" in n}
    assert names == {(n if "{}" in n else n + "{}").format("Mine") for n in MADE[base]}


def test_every_published_vehicle_can_be_a_base() -> None:
    of_the_same_kind = {"hmmwv_modified": "hmmwv", "hmmwv_tires": "hmmwv", "actuator_hmmwv_physical": "actuator_hmmwv"}
    assert {of_the_same_kind.get(n, n) for n in vehicle_names()} == set(MADE)


@pytest.mark.filterwarnings("error")
def test_a_heavier_car_under_its_own_mpc(tmp_path: Path) -> None:
    """Plant, law and road of one file run together; the law is another one than that of the published car."""
    own(tmp_path, "ride_car_hmmwv", MASS.format(mass=3600.0), "my_car")
    share_objects(tmp_path / "fmus")
    names = ("RideCarMyCar", "MpcMyCar", "RoadBumpsMyCar")
    done = run(tmp_path, "build-fmus", *names, "--vehicle", "my_car.toml", "--fmi", "3")
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "fmus" / "fmi3"
    assert "made for my_car.toml" in fmpy.read_model_description(str(folder / "MpcMyCar.fmu")).description
    with System() as system:
        for name, fmu in zip(("car", "mpc", "road"), names, strict=True):
            more = {"step": "1 ms"} if name == "car" else {}
            system.add(name, folder / f"{fmu}.fmu", **more)
        for pair in (("road", "car"), ("road", "mpc"), ("car", "mpc"), ("mpc", "car")):
            system.connect_matching(*pair)
        system["road"].set({"x": 7.0, "speed": 0.0, "bump.first": 8.5})  # stands with its front wheels on the bump
        system["mpc"].set({"use_preview": True})
        assert system["car"].description.parameters["body.mass"].start == 3600.0
        recording = system.run(1.0)
    assert recording["mpc.solver.status"].max() == 0
    assert np.abs(recording["mpc.force.fl"]).max() > 100.0


def test_linear_part_of_a_trench_vehicle(tmp_path: Path) -> None:
    """Its laws are designed on the same numbers, with the wheels where the offset of the CG has them."""
    offset = "[body]\ncg_offset = { value = 0.05, unit = 'm', source = 'assumed' }\n"
    vehicle = load_three_axle_trench(own(tmp_path, "three_axle_trench", offset))
    linear = vehicle.linear()
    assert linear.kind == "three_axle"
    assert linear.wheel.a1.x.value == pytest.approx(vehicle.wheel.a1.x.value - 0.05)
    assert linear.tire == vehicle.tire
    assert linear.body.mass == vehicle.body.mass


@pytest.mark.parametrize(
    ("vehicle", "count", "step", "corners"),
    [("hmmwv", 8, 0.01, 4), ("ride_car_hmmwv", 16, 0.03, 4), ("three_axle", 50, 0.005, 6), ("mine.toml", 48, 0.005, 4)],
)
def test_a_road_under_any_vehicle(vehicle: str, count: int, step: float, corners: int, tmp_path: Path) -> None:
    own(tmp_path, "sedan")
    share_objects(tmp_path / "fmus")
    (tmp_path / "washboard.csv").write_text(ROAD)
    preview = ["--preview", "48x5"] if vehicle == "mine.toml" else []
    name = f"RoadWashboard{catalog_suffix(Path(vehicle))}"  # not that of the same road under another vehicle
    done = run(tmp_path, "build-fmus", name, "--road", "washboard.csv", "--vehicle", vehicle, *preview, "--fmi", "3")
    assert done.returncode == 0, done.stderr
    description = fmpy.read_model_description(str(tmp_path / "fmus" / "fmi3" / f"{name}.fmu"))
    names = [v.name for v in description.modelVariables]
    assert sum(n.startswith("preview.") and n.endswith("[1]") for n in names) == corners
    assert sum(n.startswith(("preview.fl[", "preview.a1l[")) for n in names) == count
    assert ("scan.left[1]" in names) == (vehicle in ("ride_car_hmmwv", "mine.toml"))
    result = fmpy.simulate_fmu(
        str(tmp_path / "fmus" / "fmi3" / f"{name}.fmu"), stop_time=0.001, output=["preview.step"]
    )
    assert math.isclose(result["preview.step"][-1], step)


@pytest.mark.parametrize("base", [b for b in MADE if b != "hmmwv"])
def test_texts_speak_of_the_users_vehicle(base: str, tmp_path: Path) -> None:
    """Also of a file that has no name of its own; where values are from stays what it was."""
    path = tmp_path / "van.toml"
    path.write_text(f'base = "{base}"\n')
    published = re.compile(r"HMMWV|6x6|sedan|(RideCar|Mpc|Lqr|Kalman)(Hmmwv|Sedan|Bench)")
    true = (
        re.compile(r"sensors_hmmwv\.toml|KalmanHmmwvPrinted")
        if base == "sensors_hmmwv"
        else re.compile(r"sensors_hmmwv\.toml")
    )
    for entry in own_catalog(path, "Van").values():
        made = entry.make(Context(tmp_path, tmp_path)).model()
        texts = [made.description, entry.summary, *made.notes]
        if base == "sensors_hmmwv":  # the car is the HMMWV still
            texts = [re.sub("RideCarHmmwv|Kalman filter of the HMMWV", "", t) for t in texts]
        found = [t for t in texts if published.search(true.sub("", t))]
        assert not found, entry.name
        assert made.description.endswith("; made for van.toml")
    assert load_vehicle(path).name == "van"


def test_a_build_follows_its_options_and_all_files_that_a_vehicle_builds_on(tmp_path: Path) -> None:
    """Nothing stale is taken for up to date."""
    share_objects(tmp_path / "fmus")
    (tmp_path / "washboard.csv").write_text(ROAD)
    own(tmp_path, "quarter_car_hmmwv", name="ancestor")
    own(tmp_path, "ancestor.toml", name="heir")
    assert [p.name for p in vehicle_files(tmp_path / "heir.toml")] == [
        "heir.toml",
        "ancestor.toml",
        "quarter_car_hmmwv.toml",
    ]
    road = ["build-fmus", "--road", "washboard.csv", "--vehicle", "three_axle", "--fmi", "3"]
    assert "1 built" in run(tmp_path, *road).stderr
    assert "1 up to date" in run(tmp_path, *road).stderr
    assert "1 built" in run(tmp_path, *road, "--preview", "10x5").stderr
    car = ["build-fmus", "QuarterCarHeir", "--vehicle", "heir.toml", "--fmi", "3"]
    assert "1 built" in run(tmp_path, *car).stderr
    assert "1 up to date" in run(tmp_path, *car).stderr
    own(tmp_path, "quarter_car_hmmwv", MASS.format(mass=900.0), "ancestor")
    assert "1 built" in run(tmp_path, *car).stderr


def test_an_experiment_on_ones_own_vehicle(built_fmus: BuiltFmus, tmp_path: Path, sentence) -> None:  # noqa: ARG001
    """Half the sprung mass under the published law's weights.

    Other FMUs, other numbers, and a hint as long as they are missing.
    """
    own(tmp_path, "sedan", MASS.format(mass=730.0), "my_sedan")
    folder = share_objects(tmp_path / "fmus") / "fmi3"
    folder.mkdir()
    for fmu in ("RideCarSedan", "PreviewLqComfort", "RoadHoleBump", "SpeedProfile"):
        (folder / f"{fmu}.fmu").symlink_to(FMUS / "fmi3" / f"{fmu}.fmu")
    experiment = ["cosim", "run", "preview-lq", "--system", "active", "--out"]
    sentence(refused(tmp_path, *experiment, "r", "--vehicle", "my_sedan.toml"))
    names = ("RideCarMySedan", "PreviewLqComfortMySedan", "RoadHoleBumpMySedan")
    assert run(tmp_path, "build-fmus", *names, "--vehicle", "my_sedan.toml", "--fmi", "3").returncode == 0
    heave = {}
    for out, options in (("preview-lq", ()), ("preview-lq-my_sedan", ("--vehicle", "my_sedan.toml"))):
        done = run(tmp_path, *experiment, "results", *options)
        assert done.returncode == 0, done.stderr
        (summary,) = (tmp_path / "results" / out).rglob("*.json")
        heave[out] = json.loads(summary.read_text())["passive"]["J"]
    assert heave["preview-lq-my_sedan"] > 1.5 * heave["preview-lq"]  # a lighter body moves more


@pytest.mark.parametrize(
    ("experiment", "arguments"),
    [
        ("hmmwv", ["my_car.toml", "my_sensors.toml"]),
        ("hmmwv", ["my_full_car.toml"]),
        ("gpc", ["my_car.toml"]),
        ("trench", ["my_six.toml"]),
        ("bench", ["my_car.toml"]),
        ("preview-lq", ["my_car.toml"]),
        ("hmmwv", ["my_sedan.toml", "--friction"]),
        ("hmmwv", ["sedan"]),
    ],
)
def test_what_an_experiment_cannot_take_is_refused_before_anything_is_built(
    experiment: str, arguments: list[str], tmp_path: Path, sentence
) -> None:
    """There is no FMU in this folder: the sentence is the first one, not one on a build that would be in vain."""
    files = {"my_car": "ride_car_hmmwv", "my_sensors": "sensors_hmmwv", "my_full_car": "hmmwv", "my_six": "three_axle"}
    for name, base in {**files, "my_sedan": "sedan"}.items():
        own(tmp_path, base, name=name)
    given = [x for a in arguments for x in ([a] if a.startswith("--") else ["--vehicle", a])]
    sentence(refused(tmp_path, "cosim", "run", experiment, *given))
    assert not list(tmp_path.rglob("*.fmu"))


def test_a_law_of_ones_own_weights_and_vehicle(built_fmus: BuiltFmus, tmp_path: Path, sentence) -> None:  # noqa: ARG001
    """The law of both files: neither that of the sedan nor that of the published weights.

    It is redesigned with its file.
    """
    own(tmp_path, "sedan", MASS.format(mass=2920.0), "my_sedan")
    published = Path(fmu_sources.__file__).parent / "controllers" / "lq" / "weights" / "comfort.toml"
    weights = tmp_path / "my_weights.toml"
    weights.write_text(published.read_text().replace("heave = 3.0", "heave = 300.0", 1))
    folder = share_objects(tmp_path / "fmus") / "fmi3"
    folder.mkdir()
    for fmu in ("RideCarSedan", "RoadHoleBump", "SpeedProfile"):
        (folder / f"{fmu}.fmu").symlink_to(FMUS / "fmi3" / f"{fmu}.fmu")
    both = ["--vehicle", "my_sedan.toml", "--weights", "my_weights.toml"]
    run_both = ["cosim", "run", "preview-lq", *both]
    needed = ["RideCarMySedan", "RoadHoleBumpMySedan", "PreviewLqMyWeightsMySedan"]
    sentence(refused(tmp_path, *run_both))
    own_files = UserFiles(vehicle=tmp_path / "my_sedan.toml", weights=weights)
    for names, user in ((["PreviewLqMyWeights"], UserFiles(weights=weights)), (needed, own_files)):
        assert set(cli.build(names, Options(tmp_path / "fmus", fmi=(3,)), user=user)) == set(names)
    gain = {n: provenance(folder / f"PreviewLq{n}.fmu")["feedback"] for n in ("MyWeights", "MyWeightsMySedan")}
    assert not np.allclose(gain["MyWeights"], gain["MyWeightsMySedan"], rtol=0.01)
    assert "made for my_sedan.toml" in fmpy.read_model_description(str(folder / f"{needed[2]}.fmu")).description
    heave = {}
    for label, command in (("weights", [*run_both[:3], *both[2:]]), ("both", run_both)):
        done = run(tmp_path, *command, "--out", label)
        assert done.returncode == 0, done.stderr
        folder = tmp_path / label / ("preview-lq-my_sedan" if label == "both" else "preview-lq")
        measured = json.loads((folder / "both-my_weights-preview.json").read_text())
        heave[label] = measured["preview"]["body.az"] / measured["passive"]["body.az"]
    assert heave["weights"] < 0.2  # heave weighs a hundred times as much as for comfort
    assert heave["both"] != heave["weights"]
    weights.write_text(weights.read_text().replace("heave = 300.0", "heave = 30.0", 1))
    sentence(refused(tmp_path, *run_both))


def provenance(fmu: Path) -> dict[str, Any]:
    with zipfile.ZipFile(fmu) as z:
        return json.loads(z.read("resources/provenance.json"))


@pytest.mark.parametrize(
    "arguments",
    [
        ["--vehicle", "sedan"],
        ["--vehicle", "sedn"],
        ["--preview", "16x30"],
        ["--road", "washboard.csv", "--preview", "16"],
        ["--road", "washboard.csv", "--preview", "1x30"],
        ["--road", "washboard.csv", "--vehicle", "actuator_hmmwv"],
        ["--weights", "w.toml", "--vehicle", "truck.toml"],
        ["--vehicle", "loop.toml"],
    ],
    ids=" ".join,
)
def test_mistakes(arguments: list[str], tmp_path: Path, sentence) -> None:
    (tmp_path / "washboard.csv").write_text(ROAD)
    own(tmp_path, "loop.toml", name="loop")
    own(tmp_path, "hmmwv", name="truck")
    (tmp_path / "w.toml").touch()
    sentence(refused(tmp_path, "build-fmus", *arguments))
