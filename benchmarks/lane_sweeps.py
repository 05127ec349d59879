"""Sweeps of 10,000 passive full cars on random roads: as scalar runs, and in lanes.

`benchmarks/random_roads.py` with seed, class, mass and speed varied: processor time of a run with all that belongs to
it, from the point of the design to the stored row. The tables must be equal byte for byte.
"""

from __future__ import annotations

import hashlib
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks import random_roads
from cosim import Execution
from cosim.batch.library import TARGETS, choose_target
from cosim.study import FmuSet, load
from cosim.study.design import Design, axis
from cosim.study.sweep import prepare, run_sweep

ROUNDS = 3
VARIED = ("road.seed=1..100000", "road.class=1:3", "car.body.mass=2300:3400", "speed.start.speed=8:20")


def measure(runs: int = 10_000) -> dict[str, dict[str, float]]:
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
    return {kind: {"ms per run": took, "times as fast as scalar": found["off"] / took} for kind, took in found.items()}


def _sweep(runs: int, vectors: str, worker: ThreadPoolExecutor) -> str:
    """A hash of the table of a sweep."""
    design = Design(tuple(axis(text) for text in VARIED), samples=runs)
    with tempfile.TemporaryDirectory() as folder:
        sweep = prepare(load(random_roads.__file__), FmuSet(), design)
        table = run_sweep(sweep, FmuSet(), Path(folder) / "runs", executor=worker, execution=Execution(lanes=vectors))
        assert not table.failures
        return hashlib.sha256(table.write(Path(folder) / "table.parquet").read_bytes()).hexdigest()
