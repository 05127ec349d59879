"""Every experiment on every published vehicle that it takes as a base of a user's file.

The FMUs are built, wired, initialized and run for a short time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import FMUS, ROOT, BuiltFmus, one_at_a_time, share_objects

from build_fmus.builder import Options
from cosim import System
from cosim.experiments import bench, gpc, handling, hmmwv, preview_lq, ride, three_axle, trench
from cosim.experiments.own_files import KINDS, own_fmus, unfit
from cosim.study import FmuSet, Runner
from fmu_sources import cli
from fmu_sources.cli import UserFiles
from fmu_sources.own_catalog import catalog_suffix
from fmu_sources.vehicles import load_vehicle, vehicle_names

OWN = FMUS / ".own"  # kept from one test run to the next like the other FMUs
RUN = 0.04  # s, longer than every sample time


def _bench(fmus: FmuSet) -> Iterator[System]:
    with Runner(bench.EXPERIMENT, fmus) as runner:
        for controller in bench.runs.CONTROLLERS:
            yield runner.system(bench.runs.Case(controller, encoders=controller != "passive"))


def _gpc(fmus: FmuSet) -> Iterator[System]:
    for road, controller in zip((*gpc.runs.ROADS, "sine"), gpc.runs.CONTROLLERS, strict=True):
        yield gpc.runs.wire(fmus, gpc.runs.Case(road, controller=controller))


def _hmmwv(fmus: FmuSet) -> Iterator[System]:
    case = hmmwv.runs.Case
    cases = [case("bump", "passive"), case("off-road", "skyhook", actuators="ideal")]
    cases += [case("track", "mpc-preview", states="estimated", preview="sensed"), case("track", "lqr")]
    cases += [case("track", "mpc", tunable=True)]
    with Runner(hmmwv.EXPERIMENT, fmus) as runner:
        for one in cases:
            yield runner.system(one)


def _preview_lq(fmus: FmuSet) -> Iterator[System]:
    with Runner(preview_lq.EXPERIMENT, fmus) as runner:
        for weights in preview_lq.runs.WEIGHTED_CONTROLLERS:
            yield runner.system(preview_lq.runs.Case(weights=weights))
        yield runner.system(preview_lq.runs.Case(tunable=True))


def _handling(fmus: FmuSet) -> Iterator[System]:
    with Runner(handling.EXPERIMENT, fmus) as runner:
        for car, fmu in handling.runs.CARS.items():
            if fmu in fmus.own:
                yield runner.system(handling.runs.Case(car, "straight", road="1in"))
                for law in gpc.runs.CONTROLLERS if car == "modified" else ("passive",):
                    yield runner.system(handling.runs.Case(car, "lane-change", controller=law))


def _ride(fmus: FmuSet) -> Iterator[System]:
    """The derived cars, under all their control laws but those that a ride car may not have.

    Actuators under the HMMWV.
    """
    with Runner(ride.EXPERIMENT, fmus) as runner:
        if "HydraulicActuator" in fmus.own:
            yield runner.system(ride.runs.Case("hmmwv", "lqr", "hydraulic"))
        for name, car in ride.runs.CARS.items():
            for law in (("passive",) if name == "sedan" else car.controllers) if car.plant in fmus.own else ():
                pump_off = (name, law) == ("hmmwv", "passive")
                yield runner.system(ride.runs.Case(name, law, "hydraulic" if pump_off else "ideal"))


def _three_axle(fmus: FmuSet) -> Iterator[System]:
    with Runner(three_axle.EXPERIMENT, fmus) as runner:
        for controller in three_axle.runs.CONTROLLERS:
            yield runner.system(three_axle.runs.Case(controller=controller))


def _trench(fmus: FmuSet) -> Iterator[System]:
    with Runner(trench.EXPERIMENT, fmus) as runner:
        for controller in ("passive", "mpc", "lqr"):
            yield runner.system(trench.runs.Case(controller=controller))
    with Runner(trench.linear.PART, fmus) as runner:
        for vehicle in trench.linear.VEHICLES:
            yield runner.system(trench.linear.Shallow(vehicle))


@dataclass(frozen=True)
class Experiment:
    """How to wire an experiment, and the FMUs of a user's vehicle that it then needs.

    Their names stand without the file's name at the end.
    """

    systems: Any
    needs: dict[str, tuple[str, ...]]  # by kind of vehicle file


EXPERIMENTS = {
    "bench": Experiment(_bench, {"quarter_car": ("QuarterCar{}", "Lqr{}", "Mpc{}", "Mpc{}Moves")}),
    "gpc": Experiment(
        _gpc,
        {
            "full_car": (
                "FullCar{}",
                "RoadSine{}",
                "RoadCurb{}",
                "RoadPerryman3{}",
                "GpcImplicit{}",
                "GpcExplicit{}",
                "GpcPreview{}",
            )
        },
    ),
    "handling": Experiment(
        _handling,
        {
            "full_car": ("FullCar{}", "RoadProvingGround{}", "GpcImplicit{}", "GpcExplicit{}", "GpcPreview{}"),
            "wishbone_car": ("FullCar{}", "RoadProvingGround{}"),
        },
    ),
    "hmmwv": Experiment(
        _hmmwv,
        {
            "ride_car": (
                "RideCar{}",
                "Skyhook{}",
                "Lqr{}",
                "Mpc{}",
                "Mpc{}Tunable",
                "Kalman{}",
                "PreviewSensor{}",
                "PreviewBuffer{}",
                "RoadBumps{}",
                "RoadOffroad{}",
            ),
            "actuator": ("HydraulicActuator{}", "ForceTracking{}"),
            "sensors": ("SensorSuite{}", "Kalman{}", "PreviewSensor{}", "RoadBumps{}", "RoadOffroad{}"),
        },
    ),
    "preview-lq": Experiment(
        _preview_lq,
        {
            "ride_car": (
                "RideCar{}",
                "RoadHoleBump{}",
                "PreviewLqComfort{}",
                "PreviewLqRoadHolding{}",
                "PreviewLqComfort5ms{}",
                "PreviewLqTunable{}",
            )
        },
    ),
    "ride": Experiment(
        _ride,
        {
            "ride_car": (
                "RideCar{}",
                "RoadProvingGround{}",
                "RoadProvingGround5ms{}",
                "Skyhook{}",
                "Lqr{}",
                "Lqr{}Kilonewton",
                "Mpc{}",
            ),
            "full_car": ("FullCar{}", "RoadProvingGround{}", "GpcImplicit{}", "GpcExplicit{}", "GpcPreview{}"),
            "three_axle": ("ThreeAxleRide{}", "RoadProvingGroundThreeAxle{}", "LqrThreeAxle{}", "MpcThreeAxle{}"),
            "wishbone_car": ("FullCar{}", "RoadProvingGround{}"),
            "actuator": ("HydraulicActuator{}", "ForceTracking{}"),
        },
    ),
    "three-axle": Experiment(
        _three_axle,
        dict.fromkeys(
            ("three_axle", "three_axle_trench"),
            ("ThreeAxleRide{}", "LqrThreeAxle{}", "MpcThreeAxle{}", "RoadShallowTrench{}"),
        ),
    ),
    "trench": Experiment(
        _trench,
        {
            "three_axle_trench": (
                "ThreeAxleTrench{}",
                "TrenchCrossing{}",
                "LqrThreeAxle{}",
                "MpcThreeAxle{}",
                "ThreeAxleRide{}",
                "RoadShallowTrench{}",
            )
        },
    ),
}
VEHICLES = {n: load_vehicle(n) for n in vehicle_names()}
PAIRS = [(e, n) for e in EXPERIMENTS for n, vehicle in VEHICLES.items() if not unfit(e, vehicle)]
COSTLY = {
    ("gpc", "hmmwv_modified"),
    ("gpc", "hmmwv_tires"),
    ("hmmwv", "ride_car_hmmwv"),
    ("hmmwv", "sensors_hmmwv"),
    ("preview-lq", "sedan"),
    ("three-axle", "three_axle"),
    ("trench", "three_axle_trench"),
    *(("handling", b) for b in ("hmmwv_modified", "hmmwv_tires", "hmmwv_public")),
    *(
        ("ride", b)
        for b in ("hmmwv", "hmmwv_modified", "hmmwv_tires", "hmmwv_public", "ride_car_hmmwv", "sedan", "three_axle")
    ),
}
"""Pairs that are the published experiment under other names and take minutes to build: left to `make test-full`."""


def _costly(pair: tuple[str, str]) -> Any:
    return pytest.param(*pair, id="-".join(pair), marks=[pytest.mark.full] * (pair in COSTLY))


def test_every_experiment_and_every_published_vehicle_is_here() -> None:
    assert {e: tuple(x.needs) for e, x in EXPERIMENTS.items()} == KINDS
    assert {b for _, b in PAIRS} == set(vehicle_names())
    assert set(PAIRS) > COSTLY


def test_the_page_says_what_fits() -> None:
    """Two tables of docs/how-to/vehicles-and-roads.md: bases of each kind, kinds that each experiment takes."""
    page = (ROOT / "docs" / "how-to" / "vehicles-and-roads.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z_-]+)` \| ([^|]*) \|", page, re.MULTILINE)
    names = {first: tuple(re.findall(r"`([a-z_]+)`", second.split(";")[0])) for first, second in rows}
    kinds = {v.kind for v in VEHICLES.values()}
    assert {k: set(names[k]) for k in kinds} == {k: {n for n, v in VEHICLES.items() if v.kind == k} for k in kinds}
    for experiment, taken in KINDS.items():
        assert tuple(n for n in names[experiment] if n in kinds) == taken


def own_names(experiment: str, base: str) -> list[str]:
    """Names of the FMUs of `built`."""
    needs = EXPERIMENTS[experiment].needs[VEHICLES[base].kind]
    return [n.format(catalog_suffix(Path(f"on_{base}"))) for n in needs]


def built(experiment: str, base: str) -> FmuSet:
    """The FMUs of an experiment on a file that is only based on a published vehicle.

    They are built beside links to the published ones.
    """
    with one_at_a_time(share_objects(OWN) / "lock"):
        file = OWN / f"on_{base}.toml"
        file.write_text(f'base = "{base}"\nname = "Mine"\ndescription = "another"\n')
        cli.build(["SpeedProfile"], Options(OWN, fmi=(3,)))  # which laws of a full car need too
        cli.build(own_names(experiment, base), Options(OWN, fmi=(3,)), user=UserFiles(vehicle=file))
        for fmu in (FMUS / "fmi3").glob("*.fmu"):
            if not (link := OWN / "fmi3" / fmu.name).exists():
                link.symlink_to(fmu)
    return own_fmus(experiment, OWN, 3, [file])


@pytest.mark.parametrize(("experiment", "base"), [*map(_costly, PAIRS)])
def test_an_experiment_on_a_file_with_this_base(experiment: str, base: str, built_fmus: BuiltFmus) -> None:  # noqa: ARG001
    fmus = built(experiment, base)
    used = set()
    for system in EXPERIMENTS[experiment].systems(fmus):
        with system:
            system.allow_unconnected = True
            recording = system.run(RUN)  # as in the experiments themselves
        assert math.isclose(recording.time[-1], RUN)
        assert np.isfinite(recording.data).all()
        used |= {m.implementation.description.name for m in system.components.values()}
    assert used >= set(own_names(experiment, base))
