"""Simulated time per processor time of one core: cars alone, and the hydraulic HMMWV of paper 001.

The cars are a full car on tires of a friction ellipse and of a file, and the contact plant of paper 003. Of the HMMWV
there are one corner and the whole vehicle. Other work on the machine does not count, since the master has one thread.
"""

from __future__ import annotations

import runpy
import warnings
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from benchmarks import spent
from cosim import Record, StopWhen, System
from cosim.experiments.gpc.runs import PLANT
from cosim.experiments.hmmwv import EXPERIMENT
from cosim.experiments.hmmwv.runs import Case
from cosim.study import FmuSet, Runner

REPEATS = 3  # the fastest run counts
CORNER = Path(__file__).parents[1] / "docs" / "examples" / "hmmwv_corner.py"
COMFORT = ["comfort.absorbed_power.peak"]
VEHICLES = {
    "passive": Case("track", "passive"),
    "LQR": Case("track", "lqr"),
    "MPC with preview": Case("track", "mpc-preview"),
    "MPC with sensed preview and estimated states": Case("track", "mpc-preview", states="estimated", preview="sensed"),
}
"""Four actuators each; the last one has everything: sensors, range correction, buffer, filter, MPC, force tracking."""
CARS = (PLANT, "FullCarHmmwvTires")
TRENCH, SLOW = {"trench.length": 1.5}, {"target.speed": 3.0 / 3.6}  # m, m/s: impacts of both bumpers
METRICS = ["car.x", "car.body.*", "car.hub.*.fx", "car.*.force"]
CROSSED = StopWhen("car.x", ">=", 11.0)


def factor(system: System, seconds: float, record: Sequence[str], every: str, stop: Sequence[StopWhen] = ()) -> float:
    """Simulated time over processor time of one run."""
    system.allow_unconnected = True
    with system.initialize(record=Record(record, every)) as simulation:
        took = spent(simulation.advance, seconds, stop_when=stop)
        return simulation.time / took


def measure() -> dict[str, float]:
    """Factors of real time, of the fastest of runs in turn; the cost of a tire file; numbers of FMUs of the HMMWV."""
    warnings.simplefilter("ignore")
    fmus, subjects = FmuSet(), {}
    with ExitStack() as opened:
        for name in CARS:
            car = opened.enter_context(System())
            car.add("car", fmus.path(name), step="1 ms")
            subjects[name] = partial(factor, car, 50.0, ["car.x"], "100 ms")
        for step in ("1 ms", "0.5 ms"):
            plant = opened.enter_context(System())
            plant.add("car", fmus.path("ThreeAxleTrench"), step=step, parameters=TRENCH, start=SLOW)
            subjects[f"ThreeAxleTrench, exchange every {step}"] = partial(factor, plant, 30.0, METRICS, step, [CROSSED])
        corner = opened.enter_context(runpy.run_path(str(CORNER))["corner"]())
        subjects["corner"] = partial(factor, corner, 6.0, COMFORT, "1 ms")
        counts = {"corner, FMUs": float(len(corner.components))}
        turns = [{name: run() for name, run in subjects.items()} for _ in range(REPEATS)]
    with Runner(EXPERIMENT, fmus) as runner:
        for kind, case in VEHICLES.items():  # a runner has one system at a time
            vehicle, name = runner.system(case), f"vehicle, {kind}"
            turns.append({name: max(factor(vehicle, 6.0, COMFORT, "1 ms") for _ in range(REPEATS))})
            counts[f"{name}, FMUs"] = float(len(vehicle.components))
    found: dict[str, float] = {}
    for turn in turns:
        found |= {name: max(value, found.get(name, 0.0)) for name, value in turn.items()}
    plain, file = (found[name] for name in CARS)
    return found | counts | {"cost of a tire file": plain / file}
