"""Full cars alone at 1 ms: simulated time per processor time, on tires of a friction ellipse and of a file."""

from __future__ import annotations

import time
import warnings

from cosim import Record, System
from cosim.experiments.gpc.runs import PLANT
from cosim.study import FmuSet

LENGTH, TURNS = 50.0, 3  # s, and how often each car runs; the fastest run counts


def measure() -> dict[str, float]:
    """Simulated time per processor time of either car, and their ratio."""
    warnings.simplefilter("ignore")
    names = (PLANT, "FullCarHmmwvTires")
    turns = [[_factor(name) for name in names] for _ in range(TURNS)]
    found = {name: max(of) for name, of in zip(names, zip(*turns, strict=True), strict=True)}
    ellipse, file = found.values()
    return {
        **{f"{n}, simulated time / processor time": v for n, v in found.items()},
        "cost of a tire file": ellipse / file,
    }


def _factor(name: str) -> float:
    """Simulated time per processor time of one run."""
    with System() as system:
        system.add("car", FmuSet().path(name), step="1 ms")
        start = time.process_time()
        system.run(LENGTH, record=Record(["car.x"], "100 ms"))
        return LENGTH / (time.process_time() - start)
