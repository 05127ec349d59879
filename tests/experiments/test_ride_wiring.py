"""What is connected with what over the courses, roads made of OpenCRG files, and what users can do wrong with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crg_files import crg

from cosim.experiments.own_files import own_fmus
from cosim.experiments.ride import EXPERIMENT, runs
from cosim.experiments.ride.course import extent, wheels_of
from cosim.experiments.ride.published import plan, systems
from cosim.experiments.ride.runs import CARS, NUMBER, Case
from cosim.fmu.file import FmuFile
from cosim.study import FmuSet, Run, Runner
from cosim.study.case import CaseError
from fmu_sources.roads import RoadError, RoadLayout
from fmu_sources.vehicles import VehicleError, load_vehicle

SECTIONS = [f"long section at v = {v:.1f},m" for v in (-2.0, 0.0, 2.0)]


@pytest.mark.parametrize(("car", "law", "actuators"), systems(), ids=lambda s: s)
def test_every_car_under_every_law_is_on_the_courses(fmus: FmuSet, car: str, law: str, actuators: str) -> None:
    case = Case(car, law, actuators, "2in", seed=3, sides="apart")
    with runs.wire(fmus, case) as system:
        runs.configure(system, case)
        made = {c.target_name: c.source_name for c in system.connections.values()}
        for k in CARS[car].corners:
            assert made[f"car.road.{k}.height"] == f"road.road.{k}.height"
        road = system["road"]
        assert "half_round.height" in road.description.parameters
        assert (road.values["course"], road.values["seed"], road.values["alike"]) == (NUMBER["2in"], 3, False)
        first = max(float(road.description.parameters[f"wheel.{k}.x"].start) for k in CARS[car].corners)  # type: ignore[arg-type]
        assert system["speed"].values["start.x"] + first == pytest.approx(-11.0)  # a meter before the ramp
        previews = [t for t in made if t.startswith("controller.preview.")]
        assert bool(previews) == (
            law in ("mpc-preview", "preview") or (car, law) == ("6x6", "mpc") or (car == "sedan" and law != "passive")
        )
        if "reference" in system.components:
            assert system["reference"].values["pitch"] == 0.0


@pytest.mark.parametrize(("car", "times"), [("6x6", 1.0), ("full-car", 2.0)])
def test_how_long_a_run_may_take(fmus: FmuSet, car: str, times: float) -> None:
    """Until all wheels are at the end of the course; a car with a driver may lose half of its speed."""
    case = Case(car, "passive", course="2in", speed_kmh=25.0)
    with runs.wire(fmus, case) as system:
        runs.configure(system, case)
        needed = (runs.window(Run(case, None, system))[1] - system["speed"].values["start.x"]) / case.speed
        found = runs.stop_time(system, case)
        assert 0 <= found - times * needed < 1e-3
        assert round(1e3 * found) / 1e3 == found


def test_what_is_wired_once() -> None:
    """All courses of the road's FMU, each course from a file."""
    case = Case("6x6", "lqr", course="1in")
    for same in ({"course": "2in"}, {"seed": 2}, {"speed_kmh": 50.0}, {"sides": "apart"}):
        assert runs.structure(replace(case, **same)) == runs.structure(case)
    others = [
        {"course": "one.crg"},
        {"course": "another.crg"},
        {"controller": "mpc"},
        {"car": "full-car", "controller": "passive"},
    ]
    assert len({runs.structure(case), *(runs.structure(replace(case, **o)) for o in others)}) == 5


def test_wheels_are_those_of_the_vehicle_file(fmus: FmuSet) -> None:
    for car in CARS.values():
        expected = RoadLayout.of(load_vehicle(car.vehicle)).wheels  # type: ignore[arg-type]
        found = {w.corner: (w.x, w.y) for w in wheels_of(FmuFile(fmus.path(car.plant)))}
        assert found == {w.corner: pytest.approx((w.x, w.y)) for w in expected}
        assert car.size == pytest.approx(
            (max(abs(w.y) for w in expected), max(w.x for w in expected) - min(w.x for w in expected))
        )


def course(path: Path, heights: np.ndarray, increment: float = 0.25) -> Path:
    """A file with these heights, on the right side twice as high."""
    path.write_text(crg([[2 * z, 1.5 * z, z] for z in heights], SECTIONS, increment=increment))
    return path


def waves(count: int = 200) -> np.ndarray:
    """Level for 10 m, then waves 5 m long for 30 m, then level."""
    x = 0.25 * np.arange(count)
    return np.where((x > 10) & (x < 40), 0.02 * np.sin(2 * np.pi * (x - 10) / 5), 0.0)


def test_where_a_course_begins_and_ends(tmp_path: Path) -> None:
    path = course(tmp_path / "waves.crg", waves())
    assert extent(path, 0.9, 3.3) == pytest.approx((10.0, 40.0))


def test_a_car_over_a_course_from_a_file(tmp_path: Path, fmus: FmuSet) -> None:
    """The linear car over a course of twice the heights absorbs four times the power.

    Left and right are those of the file.
    """
    powers = []
    for i, size in enumerate((1.0, 2.0)):
        path = course(tmp_path / f"course{i}.crg", size * waves())
        with Runner(EXPERIMENT, fmus) as runner:
            run = runner.run(Case("sedan", "passive", "ideal", str(path), speed_kmh=36.0), record=["*"])
            found = runs.measure(run)
            begin, end = runs.window(run)
            first, last = runs.axles(run)
            assert (begin, end) == pytest.approx((10.0 - last, 40.0 - first))
            left, right = (run.recording[f"road.road.{k}.height"] for k in ("fl", "fr"))
            assert right.max() > 1.2 * left.max() > 0
        assert found["arrived"]
        powers.append(found["absorbed_power_nrmm"])
    assert powers[1] == pytest.approx(4 * powers[0], rel=0.2)  # but for where the wheels bridge


def test_a_course_shorter_than_the_car_between_level_stretches_is_an_obstacle(tmp_path: Path, fmus: FmuSet) -> None:
    heights = np.zeros(160)
    heights[80:84] = 0.05
    path = course(tmp_path / "bump.crg", heights)
    with Runner(EXPERIMENT, fmus) as runner:
        run = runner.run(Case("6x6", "passive", "ideal", str(path), speed_kmh=18.0))
        assert runs.measure(run)["arrived"]
        begin, end = runs.window(run)
        first, last = runs.axles(run)
        assert (begin, end) == pytest.approx((19.75 - first - 3.0, 21.0 - last + 5.0 + 1.0))


@pytest.mark.parametrize(
    ("heights", "increment", "words"),
    [
        (np.linspace(0, 0.1, 8), 0.25, ["1.75 m long", "shorter than the car", "2.814 m"]),
        (np.zeros(100), 0.25, ["is level", "nothing to ride over"]),
        (np.where(np.arange(100) == 50, np.nan, 0.1), 0.25, ["no height", "gaps"]),
    ],
)
def test_courses_that_cannot_be_driven(tmp_path: Path, heights: np.ndarray, increment: float, words: list[str]) -> None:
    path = tmp_path / "bad.crg"
    rows = [[None if np.isnan(z) else z] * 3 for z in heights]
    path.write_text(crg(rows, SECTIONS, increment=increment))
    with pytest.raises(RoadError) as error:
        plan(course=path, car="sedan")
    for word in (str(path), *words):
        assert word in str(error.value)


def test_files_that_are_no_courses(tmp_path: Path, raises) -> None:
    with raises(RoadError):
        plan(course=tmp_path / "nowhere.crg")
    with pytest.raises(CaseError, match=r"road\.csv': give an OpenCRG file"):
        plan(course=tmp_path / "road.csv")


def test_a_plan_on_a_file_has_both_limits(tmp_path: Path) -> None:
    path = course(tmp_path / "waves.crg", waves())
    searches = plan(course=path, car="6x6")
    assert [s.case.controller for s in searches] == ["passive", "lqr", "mpc", "mpc-preview"]
    assert {s.metrics for s in searches} == {("absorbed_power_nrmm", "absorbed_power", "seat_peak")}
    assert {s.case.course for s in searches} == {str(path)}


def test_tires_that_envelop_get_the_course_as_it_is(fmus: FmuSet) -> None:
    case = Case("public", "passive", course="half-round", height=0.1016, speed_kmh=16.09)
    with Runner(EXPERIMENT, fmus) as runner:
        run = runner.run(case, record=["*"])
        made = {c.target_name for c in run.system.connections.values()}
        assert {f"car.contact.{k}[{i}]" for k in CARS["public"].corners for i in (1, 31)} | {"car.contact.step"} <= made
        height = run.recording["road.road.fl.height"]
        assert height.max() == pytest.approx(0.1016, rel=2e-3)
        assert (
            0 < np.count_nonzero(height) * case.speed / runs.RATE == pytest.approx(2 * 0.1016, abs=0.02)
        )  # as long as the obstacle, on which it loses some speed
        assert runs.measure(run)["seat_peak"] == pytest.approx(
            13.1, abs=0.3
        )  # docs/reference/public-hmmwv.md, over a half-round elsewhere


def test_a_car_that_envelops_over_a_course_from_a_file(tmp_path: Path, fmus: FmuSet) -> None:
    path = course(tmp_path / "waves.crg", waves())
    with Runner(EXPERIMENT, fmus) as runner:
        run = runner.run(Case("public", "passive", course=str(path), speed_kmh=18.0), record=["*"])
        assert runs.measure(run)["arrived"]
        assert np.abs(run.recording["road.contact.fl[1]"]).max() > 0.005


def test_a_vehicle_of_a_user_stands_in_for_the_cars_of_its_kind(tmp_path: Path, fmus: FmuSet, raises) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('base = "ride_car_hmmwv"\nname = "Mine"\ndescription = "another"\n')
    own = own_fmus("ride", fmus.directory, fmus.fmi, [file])
    for published, name in (
        ("RideCarHmmwv", "RideCarMine"),
        ("RideCarSedan", "RideCarMine"),
        ("RoadProvingGroundHmmwv", "RoadProvingGroundMine"),
        ("MpcHmmwv", "MpcMine"),
        ("RoadProvingGround5ms", "RoadProvingGround5msMine"),
    ):
        assert own.name(published) == name
    assert own.name("ThreeAxleRide") == "ThreeAxleRide"
    with pytest.raises(FileNotFoundError, match=r"RoadProvingGroundMine.*`build-fmus --vehicle .*mine\.toml --out"):
        runs.wire(own, Case("hmmwv", "zero", "ideal"))
    with raises(CaseError):
        runs.wire(own, Case("sedan", "comfort-active"))
    file.write_text('base = "quarter_car_hmmwv"\nname = "Mine"\n')
    with raises(VehicleError):
        own_fmus("ride", fmus.directory, fmus.fmi, [file])


def test_another_vehicle_is_what_is_driven(fmus: FmuSet) -> None:
    """The sedan's FMUs in place of the HMMWV's, as `--vehicle` puts them there."""
    other = replace(
        fmus, own={"RideCarHmmwv": ("RideCarSedan", ""), "RoadProvingGroundHmmwv": ("RoadProvingGround5ms", "")}
    )
    with runs.wire(other, Case("hmmwv", "zero", "ideal")) as system:
        assert float(system["car"].description.parameters["body.mass"].start) == 1460.0  # type: ignore[arg-type]
