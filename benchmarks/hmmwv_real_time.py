"""How much faster than real time the hydraulic HMMWV of paper 001 runs: one corner, and the whole vehicle.

Simulated time over the processor time of one core (the master has one thread), so that other work on the machine does
not count.
"""

from __future__ import annotations

import runpy
from pathlib import Path

from benchmarks import spent
from cosim import Record, System
from cosim.experiments.hmmwv import EXPERIMENT
from cosim.experiments.hmmwv.runs import Case
from cosim.study import FmuSet, Runner

CORNER = Path(__file__).parents[1] / "docs" / "examples" / "hmmwv_corner.py"
COMFORT = ["comfort.absorbed_power.peak"]
VEHICLES = {
    "passive": Case("track", "passive"),
    "LQR": Case("track", "lqr"),
    "MPC with preview": Case("track", "mpc-preview"),
    "MPC with sensed preview and estimated states": Case("track", "mpc-preview", states="estimated", preview="sensed"),
}
"""Four actuators each; the last one has everything: sensors, range correction, buffer, filter, MPC, force tracking."""


def factor(system: System, seconds: float) -> float:
    """Simulated time over processor time of one run, recording the absorbed power every millisecond."""
    system.allow_unconnected = True
    simulation = system.initialize(record=Record(COMFORT, "1 ms"))
    return seconds / spent(simulation.advance, seconds)


def measure(repeats: int = 3, seconds: float = 6.0) -> dict[str, float]:
    """Best of `repeats`: the corner (five FMUs and the speed), and the vehicles of `VEHICLES`."""
    result = {}
    with runpy.run_path(str(CORNER))["corner"]() as corner:
        result["corner"] = max(factor(corner, seconds) for _ in range(repeats))
        result["corner, FMUs"] = float(len(corner.components))
    with Runner(EXPERIMENT, FmuSet()) as runner:
        for name, case in VEHICLES.items():
            vehicle = runner.system(case)
            result[f"vehicle, {name}"] = max(factor(vehicle, seconds) for _ in range(repeats))
            result[f"vehicle, {name}, FMUs"] = float(len(vehicle.components))
    return result
