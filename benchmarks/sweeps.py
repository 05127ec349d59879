"""Runs per second of a sweep in this project, in a pool written by hand, and in FMPy's example.

This study runs on local processes and on Dask; FMPy in a Dask bag, as its example does it. One FMU, since that example
(`fmpy.examples.parameter_variation`) has one: the full car alone over 2 s in steps of 1 ms, mass and CG height vary,
the outcome is the mean of two outputs. Two workers each. They take turns, since other things run on most machines.
"""

from __future__ import annotations

import multiprocessing
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import dask
import fmpy
import numpy as np
from dask import bag
from fmpy.fmi2 import FMU2Slave

from benchmarks import sweeps_car
from benchmarks.sweeps_car import END, FMU, OUTPUTS, STEP, VARIED
from cosim.study import FmuSet, load
from cosim.study import dask as cluster
from cosim.study.design import Design, axis
from cosim.study.sweep import prepare, run_sweep

WORKERS, ROUNDS = 2, 3
FILE = Path(sweeps_car.__file__)
Points = list[tuple[float, ...]]


def measure(runs: int = 400) -> dict[str, float]:
    """Runs per second of each, the median of three rounds."""
    points = design(runs)
    found: dict[str, list[float]] = {}
    ways: dict[str, Callable[[int, Points], Any]] = {
        "cosim, processes": by_study,
        "cosim, Dask": by_cluster,
        "pool by hand, cosim": by_hand,
        "FMPy, Dask bag": by_fmpy,
    }
    outcomes = {}
    for _ in range(ROUNDS):
        for name, run in ways.items():
            begin = time.perf_counter()
            outcomes[name] = run(runs, points)
            found.setdefault(name, []).append(runs / (time.perf_counter() - begin))
    expected = outcomes["cosim, processes"]
    for name, outcome in outcomes.items():
        # they sample at other instants
        np.testing.assert_allclose(outcome, expected, rtol=2e-2, atol=1e-4, err_msg=name)
    return {name: median(speeds) for name, speeds in found.items()}


def design(runs: int) -> Points:
    """The same points for all."""
    columns = _design(runs).columns()
    return list(zip(*columns, strict=True))


def _design(runs: int) -> Design:
    return Design(tuple(axis(f"car.{name}={low}:{high}") for name, (low, high) in VARIED.items()), samples=runs)


def by_study(runs: int, _: Points) -> Any:
    """`cosim sweep` on processes of this machine."""
    return _study(runs, None)


def by_cluster(runs: int, _: Points) -> Any:
    """`cosim sweep --dask local`."""
    with cluster("local", WORKERS) as executor:
        return _study(runs, executor)


def _study(runs: int, executor: Any) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        sweep = prepare(load(str(FILE)), FmuSet(), _design(runs))
        table = run_sweep(sweep, FmuSet(), Path(folder), executor=executor, processes=WORKERS)
    assert not table.failures
    return np.column_stack([table.metrics[name] for name in OUTPUTS])


def by_hand(_: int, points: Points) -> Any:
    """Processes that wire the system once, as a user would write it."""
    with multiprocessing.get_context("spawn").Pool(WORKERS, _begin) as pool:
        return np.array(pool.map(_one, points, chunksize=max(1, len(points) // (8 * WORKERS))))


_here: dict[str, Any] = {}  # of a worker


def _begin() -> None:
    _here["system"] = sweeps_car.system()


def _one(point: tuple[float, ...]) -> list[float]:
    system = _here["system"]
    system["car"].set(dict(zip(VARIED, point, strict=True)))
    recording = system.run(END, record=sweeps_car.RECORD)
    return [float(np.mean(recording[f"car.{name}"])) for name in OUTPUTS]


def by_fmpy(_: int, points: Points) -> Any:
    """As `fmpy.examples.parameter_variation`: a bag in ten chunks.

    Each chunk has an instance that is reset for each run.
    """
    path = str(FmuSet(fmi=2).path(FMU))
    description = fmpy.read_model_description(path)
    references = {v.name: v.valueReference for v in description.modelVariables}
    folder = fmpy.extract(path)
    arguments = {
        "guid": description.guid,
        "modelIdentifier": description.coSimulation.modelIdentifier,
        "unzipDirectory": folder,
    }
    start, result = [references[n] for n in VARIED], [references[n] for n in OUTPUTS]
    try:
        with dask.config.set(scheduler="processes", num_workers=WORKERS):
            chunks = bag.from_sequence(list(enumerate(points)), npartitions=10)
            found = chunks.map_partitions(_chunk, arguments, start, result).compute()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return np.array([values for _, values in sorted(found)])


def _chunk(points: Any, arguments: dict[str, Any], start: list[int], result: list[int]) -> list[Any]:
    fmu = FMU2Slave(**arguments)
    fmu.instantiate()
    found = []
    for number, values in points:
        fmu.reset()
        fmu.setupExperiment()
        fmu.setReal(vr=start, value=list(values))
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        rows = []
        for k in range(round(END / STEP)):
            fmu.doStep(currentCommunicationPoint=k * STEP, communicationStepSize=STEP)
            rows.append(fmu.getReal(result))
        found.append((number, [float(np.average(column)) for column in zip(*rows, strict=True)]))
    fmu.terminate()
    fmu.freeInstance()
    return found
