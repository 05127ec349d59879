"""The full car alone at 1 ms: simulated time per wall time."""

from __future__ import annotations

import warnings

from cosim import Record, System
from cosim.experiments.gpc.runs import PLANT
from cosim.study import FmuSet


def measure() -> dict[str, float]:
    """Simulated time per wall time."""
    warnings.simplefilter("ignore")
    with System() as system:
        system.add("car", FmuSet().path(PLANT), step="1 ms")
        recording = system.run(20.0, record=Record(["car.x"], "100 ms"))
    return {"simulated time / wall time": recording.real_time_factor}
