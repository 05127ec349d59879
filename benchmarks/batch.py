"""Passive full cars simulated per second and core: as scalars by the engine, and as copies of one batch.

The batch is measured on each kind of vectors. Simulated time of all copies over the processor time of their steps, so
that other work on the machine hardly counts and the number of threads does not. Initialization, which is the same for
both, is measured separately. Every copy has a mass and a speed of its own.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks import spent
from benchmarks.random_roads import system as on_random_roads
from cosim import Record, System
from cosim.batch import Batch
from cosim.batch.library import TARGETS, choose_target
from cosim.experiments.gpc.runs import Case, wire
from cosim.study import FmuSet

COPIES, SECONDS, ROUNDS = 256, 2.0, 3


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
    "random roads": on_random_roads,
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
        stepped += spent(simulation.advance, SECONDS)
    return runs * SECONDS / stepped, begun / runs


def in_batch(system: System, vectors: str, threads: int) -> tuple[float, float]:
    """The same of a batch, per copy."""
    start = {"car.body.mass": np.linspace(2500.0, 5000.0, COPIES), "speed.start.speed": np.linspace(8.0, 20.0, COPIES)}
    system.allow_unconnected = True
    with Batch(system, COPIES, record=Record(["car.body.az"], "10 ms"), vectors=vectors, threads=threads) as batch:
        begun = spent(batch.reset, start)
        stepped = spent(batch.advance, SECONDS)
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
