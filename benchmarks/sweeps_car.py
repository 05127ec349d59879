"""The full car alone, as an experiment for sweeps (`benchmarks.sweeps`)."""

import numpy as np

from cosim import System
from cosim.study import FmuSet

FMU = "FullCarHmmwv"
END, STEP = 2.0, 1e-3  # s
VARIED = {"body.mass": (2200.0, 3400.0), "body.cg_height": (0.7, 1.0)}
OUTPUTS = ("body.z", "speed")
STOP_TIME = END
RECORD = [f"car.{name}" for name in OUTPUTS]


def system() -> System:
    made = System()
    made.add("car", FmuSet().path(FMU), step="1 ms")
    made["car"].set({v.name: v.start for v in made["car"].description.inputs.values() if v.start is not None})
    return made


def measure(run):
    return {name: float(np.mean(run.recording[f"car.{name}"])) for name in OUTPUTS}
