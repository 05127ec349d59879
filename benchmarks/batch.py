"""Passive full cars simulated per second and core: as scalars by the engine, and as copies of one batch.

The batch is measured on each kind of vectors. Simulated time of all copies over the processor time of their steps, so
that other work on the machine hardly counts and the number of threads does not. Initialization, which is the same for
both, is measured separately. Every copy has a mass and a speed of its own.

    python -m benchmarks.batch --sweep 10000

measures whole sweeps instead, `benchmarks/random_roads.py` with seed, class, mass and speed varied: processor time of a
run with all that belongs to it, from the point of the design to the stored row, as scalar runs and in lanes. The tables
must be equal byte for byte.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks import random_roads
from cosim import Execution, Record, System
from cosim.batch import Batch
from cosim.batch.library import TARGETS, choose_target
from cosim.experiments.gpc.runs import Case, wire
from cosim.study import FmuSet, load
from cosim.study.design import Design, axis
from cosim.study.sweep import prepare, run_sweep

COPIES, SECONDS, ROUNDS = 256, 2.0, 3
TITLE = "passive full cars, simulated time of all copies / processor time"


def on_nodes() -> System:
    """Over a road that is looked up node by node, and tells 16 heights ahead under each wheel."""
    system, fmus = System(), FmuSet()
    for name, fmu in (("speed", "SpeedProfile"), ("road", "RoadOffroadHmmwv"), ("car", "FullCarHmmwv")):
        system.add(name, fmus.path(fmu))
    system.connect("speed.speed", "car.target.speed")
    system.connect("car.x", "road.x")
    system.connect("car.speed", "road.speed")
    system.connect_matching("road", "car")
    return system


SYSTEMS = {
    "sine road": lambda: wire(FmuSet(), Case("sine", controller="passive")),
    "road of nodes, with preview": on_nodes,
    "random roads": random_roads.system,
}


def one_by_one(system: System, runs: int = 8) -> tuple[float, float]:
    """Simulated time over processor time of the steps of some runs by the engine.

    Also the processor time of an initialization [s].
    """
    begun = stepped = 0.0
    for mass in np.linspace(2500.0, 5000.0, runs):
        system["car"].set({"body.mass": mass})
        begin = time.process_time()
        system.allow_unconnected = True
        simulation = system.initialize(record=Record(["car.body.az"], "10 ms"))
        begun += time.process_time() - begin
        begin = time.process_time()
        simulation.advance(SECONDS)
        stepped += time.process_time() - begin
    return runs * SECONDS / stepped, begun / runs


def in_batch(system: System, vectors: str, threads: int) -> tuple[float, float]:
    """The same of a batch, per copy."""
    start = {"car.body.mass": np.linspace(2500.0, 5000.0, COPIES), "speed.start.speed": np.linspace(8.0, 20.0, COPIES)}
    system.allow_unconnected = True
    with Batch(system, COPIES, record=Record(["car.body.az"], "10 ms"), vectors=vectors, threads=threads) as batch:
        begin = time.process_time()
        batch.reset(start)
        begun = time.process_time() - begin
        begin = time.process_time()
        batch.advance(SECONDS)
        stepped = time.process_time() - begin
        assert not batch.failures
        return COPIES * SECONDS / stepped, begun / COPIES


def measure() -> dict[str, float]:
    """The best of some rounds, in which all take turns."""
    found: dict[str, float] = {}
    kinds = [name for name, target in TARGETS.items() if target.lanes <= choose_target().lanes]
    for road, make in SYSTEMS.items():
        with make() as system:
            for _ in range(ROUNDS):
                took = {"scalar": one_by_one(system), **{f"lanes, {k}": in_batch(system, k, 1) for k in kinds}}
                took["lanes, two threads"] = in_batch(system, "auto", 2)
                for name, (factor, begun) in took.items():
                    key, init = f"{road}, {name}", f"{road}, {name}, initialization [ms per copy]"
                    found[key] = max(found.get(key, 0.0), factor)
                    found[init] = min(found.get(init, np.inf), begun * 1e3)
    return found


VARIED = ("road.seed=1..100000", "road.class=1:3", "car.body.mass=2300:3400", "speed.start.speed=8:20")


def measure_sweeps(runs: int) -> dict[str, float]:
    """Processor time of a run [ms]: that of a tenth of the runs as scalar ones, and of all in lanes; the best round.

    One thread of this process is the worker, so it is all in one processor time. A sweep before the measured one wires
    the system and compiles the lanes.
    """
    found: dict[str, float] = {}
    kinds = ["off", *(name for name, target in TARGETS.items() if target.lanes <= choose_target().lanes)]
    for _ in range(ROUNDS):
        tables: dict[int, set[str]] = {}
        for kind in kinds:
            count = max(40, runs // 10 if kind == "off" else runs)
            with ThreadPoolExecutor(1) as worker:
                _sweep(40, kind, worker)
                begin = time.process_time()
                tables.setdefault(40, set()).add(_sweep(40, kind, worker))
                tables.setdefault(count, set()).add(_sweep(count, kind, worker))
                took = (time.process_time() - begin) / (count + 40) * 1e3
            found[kind] = min(found.get(kind, np.inf), took)
        assert all(len(same) == 1 for same in tables.values()), "the tables differ"
    return found


def _sweep(runs: int, vectors: str, worker: ThreadPoolExecutor) -> str:
    """A hash of the table of a sweep."""
    design = Design(tuple(axis(text) for text in VARIED), samples=runs)
    with tempfile.TemporaryDirectory() as folder:
        sweep = prepare(load(random_roads.__file__), FmuSet(), design)
        table = run_sweep(sweep, FmuSet(), Path(folder) / "runs", executor=worker, execution=Execution(lanes=vectors))
        assert not table.failures
        return hashlib.sha256(table.write(Path(folder) / "table.parquet").read_bytes()).hexdigest()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.batch", description=TITLE)
    parser.add_argument("--sweep", type=int, metavar="RUNS", help="measure sweeps of so many runs")
    if (given := parser.parse_args().sweep) is None:
        for what, value in measure().items():
            print(f"{what}: {value:.3g}")
    else:
        times = measure_sweeps(given)
        for kind, milliseconds in times.items():
            print(f"{kind}: {milliseconds:.3g} ms per run, {times['off'] / milliseconds:.3g} times as fast as scalar")
