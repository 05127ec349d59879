"""Every copy of a batch has the bits of a run of its own, on every kind of vectors and with any number of threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import FMUS, BuiltFmus
from same import bits

from cosim import Record, System
from cosim.batch import Batch
from cosim.batch.library import TARGETS, choose_target
from cosim.experiments.bench import EXPERIMENT as BENCH
from cosim.experiments.bench.runs import Case as BenchCase
from cosim.experiments.gpc import EXPERIMENT as GPC
from cosim.experiments.gpc.runs import Case as GpcCase
from cosim.experiments.preview_lq import EXPERIMENT as RIDE
from cosim.experiments.preview_lq.runs import Case as RideCase
from cosim.study import FmuSet, Runner
from cosim.study.experiment import Experiment
from cosim.tables import Table

pytestmark = [
    pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning"),
    pytest.mark.usefixtures("built_fmus"),
]
HERE = [name for name, target in TARGETS.items() if choose_target().lanes >= target.lanes]  # what this processor has


def apart(
    system: System, start: Mapping[str, Sequence[float]], copy: int, stop: float, record: Sequence[str], interval: str
) -> Any:
    """The recording of one copy alone."""
    kept = {m: dict(m.values) for m in system.components.values()}
    try:
        for name, each in start.items():
            component, variable = system.components.split(name)
            component.set({variable: each[copy]})
        with system.initialize(record=Record(record, interval)) as simulation:
            simulation.advance(stop)
            return simulation.recording
    finally:
        for m, values in kept.items():
            m.values = values


def check(
    system: System,
    start: Mapping[str, Sequence[float]],
    *,
    stop: float,
    record: Sequence[str],
    interval: str = "1 ms",
    alone: str = "",
    vectors: Sequence[str] = HERE,
) -> None:
    """Compare, in two pieces; on each kind of vectors, and with one and two threads.

    `alone`: members that run one by one.
    """
    copies = len(next(iter(start.values())))
    single = [apart(system, start, c, stop, record, interval) for c in range(copies)]
    for kind, threads in [*((v, 2) for v in vectors), (vectors[-1], 1)]:
        with Batch(
            system, copies, start=start, record=Record(record, interval), vectors=kind, threads=threads
        ) as batch:
            assert " ".join(batch.scalar) == alone
            batch.advance(stop * 0.37)
            batch.advance(stop)
            recording = batch.recording
            assert not batch.failures
        assert recording.names == single[0].names
        for c, one in enumerate(single):
            np.testing.assert_array_equal(bits(recording.time), bits(one.time))
            np.testing.assert_array_equal(bits(recording.data[c]), bits(one.data))
        assert len({recording.data[c].tobytes() for c in range(copies)}) == copies  # the copies do differ


def case(experiment: Experiment, of: Any) -> System:
    """The system of an experiment."""
    return Runner(experiment, FmuSet(FMUS)).system(of)


def test_passive_full_cars_over_their_road() -> None:
    system = case(GPC, GpcCase("sine", controller="passive"))
    start = {"car.body.mass": np.linspace(2500, 5000, 9), "speed.start.speed": np.linspace(6, 24, 9)}
    check(system, start, stop=2.9, record=["car.body.*", "car.tire.*.force", "road.road.*.height"], interval="10 ms")


def test_full_cars_on_random_roads_of_their_own() -> None:
    """Profiles of other lengths have other numbers of nodes; memory serves again at the second reset."""
    system = System(allow_unconnected=True)
    for name, fmu in (("speed", "SpeedProfile"), ("road", "RoadRandom"), ("car", "FullCarHmmwv")):
        system.add(name, FMUS / "fmi3" / f"{fmu}.fmu")
    system.connect("speed.speed", "car.target.speed")
    system.connect("car.x", "road.x")
    system.connect_matching("road", "car", "road.*")
    start = {"road.seed": [1, 2, 3, 4, 5], "road.length": [900.0, 30.0, 200.0, 300.0, 30.0], "road.flat": [0.0] * 5}
    check(system, start, stop=0.2, record=["car.body.az", "road.road.*.height"], interval="10 ms")
    with Batch(system, 5, start=start, record="road.road.*", threads=1) as batch:
        shorter = start | {"road.length": [30.0] * 5}
        batch.reset(shorter)
        batch.advance(0.1)
        with Batch(system, 5, start=shorter, record="road.road.*", threads=1) as fresh:
            fresh.advance(0.1)
            np.testing.assert_array_equal(bits(batch.recording.data), bits(fresh.recording.data))


def test_quarter_cars_with_their_regulator() -> None:
    system = case(BENCH, BenchCase(controller="lqr"))
    start = {"plant.body.mass": [2.1, 2.3, 2.6, 2.9, 3.1], "controller.limit": [38.0, 4.0, 2.0, 1.0, 0.5]}
    check(system, start, stop=0.5, record=["plant.*", "controller.force"])


def test_ride_cars_with_preview() -> None:
    system = case(RIDE, RideCase(controller="preview"))
    start = {"speed.start.speed": [10.0, 15.0, 20.0], "controller.preview_time": [0.05, 0.1, 0.2]}
    check(
        system,
        start,
        stop=0.6,
        record=["car.body.*", "car.suspension.*.deflection", "controller.force.*"],
        vectors=["auto"],
    )


def test_members_that_run_one_by_one_are_among_the_others() -> None:
    system = case(BENCH, BenchCase(controller="mpc"))
    start = {"plant.body.mass": [2.1, 2.45, 2.9]}
    check(system, start, stop=0.3, record=["plant.*", "controller.force"], alone="controller", vectors=["auto"])


def test_converted_delayed_and_extrapolated_connections_tables_and_groups() -> None:
    system = System()
    system.add("road", Table({"time": [0.0, 0.1, 0.3, 0.4], "z [mm]": [0.0, 10.0, -20.0, 5.0]}, after="hold"))
    for name in ("front", "rear"):
        system.add(name, FMUS / "fmi3" / "QuarterCarBench.fmu", step="2 ms" if name == "rear" else "1 ms")
    system.connect("road.z", "front.road.height")
    system.connect("road.z", "rear.road.height", delay=True)
    system.connect("front.body.vz", "rear.road.rate", extrapolate=True)
    system.connect("rear.body.z", "front.force", linear=(100.0, 0.5))
    system.group("both", ["front", "rear"], method="gauss-seidel")
    start = {"front.body.mass": [2.1, 2.45, 2.9], "rear.body.mass": [2.2, 2.5, 3.0]}
    check(
        system,
        start,
        stop=0.5,
        record=["front.*", "rear.*", "rear.road.height", "road.z"],
        alone="road",
        vectors=["auto", "baseline"],
    )


def test_different_solver_steps_are_no_lanes() -> None:
    system = case(BENCH, BenchCase(controller="passive"))
    start = {"plant.solver.step": [0.0005, 0.00025, 0.0005]}
    check(
        system,
        start | {"plant.body.mass": [2.1, 2.2, 2.3]},
        stop=0.6,
        record=["plant.*"],
        interval="10 ms",
        alone="plant",
        vectors=["auto"],
    )


def inputs_of(system: System) -> list[str]:
    """Real inputs of member `m` that may have any value."""
    variables = system["m"].description.inputs
    return [f"m.{n}" for n, v in variables.items() if v.type == "real" and v.must_equal is None]


def driven(path: Path, vectors: str, copies: int = 3, steps: int = 60) -> None:
    """An FMU alone under inputs of its own for each copy, as by `Simulation.set`."""
    with System() as system:
        system.add("m", path)
        names, step = inputs_of(system), system["m"].step
        about = system["m"].description
        outputs = [f"m.{n}" for n, v in about.outputs.items() if v.type in ("real", "integer", "boolean")]
        u = np.random.default_rng(1).normal(size=(steps, copies, len(names))) * 0.05
        for i, name in enumerate(names):
            if "speed" in name or name == "m.x":
                u[:, :, i] += 10.0 + (12.0 * float(step) * np.arange(steps)[:, None] if name == "m.x" else 0.0)
            v = about.inputs[name[2:]]
            u[:, :, i] = np.clip(
                u[:, :, i], *(b if b is not None else s for b, s in ((v.minimum, -1e9), (v.maximum, 1e9)))
            )
        system.allow_unconnected = True
        with Batch(system, copies, inputs=names, outputs=outputs, vectors=vectors, threads=1) as batch:
            got = np.array([batch.step(step, u[k]) for k in range(steps)])
            assert not batch.failures
        for copy in range(copies):
            system.allow_unconnected = True
            simulation = system.initialize(record=Record(watch=outputs))
            read, put = simulation.reader(outputs), simulation.setter(names) if names else None
            for k in range(steps):
                if put is not None:
                    put(u[k, copy])
                simulation.advance((k + 1) * step)
                np.testing.assert_array_equal(bits(read()), bits(got[k, copy]))


# Mathematical functions in lanes and apart, tables that are looked up, matrices, memories, conditions, samples of 10
# ms.
SOME = ("GpcPreview", "KalmanHmmwvPrinted", "PreviewBuffer", "RoadPerryman3", "RideComfort")


@pytest.mark.parametrize("name", SOME)
def test_an_fmu_under_inputs_of_each_copy(name: str) -> None:
    driven(FMUS / "fmi3" / f"{name}.fmu", "auto")


@pytest.mark.full
@pytest.mark.parametrize("vectors", HERE)
def test_every_fmu_under_inputs_of_each_copy(vectors: str, built_fmus: BuiltFmus) -> None:  # noqa: ARG001
    for path in sorted((FMUS / "fmi3").glob("*.fmu")):
        driven(path, vectors)
