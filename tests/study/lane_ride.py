"""A car over a random road, as an experiment for sweeps in lanes, unless `python` adds a component that cannot be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim import PythonComponent, StopWhen, System
from cosim.study import Case, Experiment, FmuSet, Measures, RunOptions, Wiring, option


class Load(PythonComponent):
    """A force on the body that is written in Python."""

    inputs = ("z [m]",)
    outputs = ("force [N]",)

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = -100.0 * u[0]


@dataclass(frozen=True)
class Ride(Case):
    """A car on its road."""

    car: str = option("QuarterCarHmmwv", help="FMU of the car")
    python: bool = option(False, help="with a component that is written in Python")
    seconds: float = option(0.4, unit="s", help="duration of the run")
    low: float = option(-1.0, unit="m", help="height of the body at which a run ends")


def wire(fmus: FmuSet, case: Ride) -> System:
    system = System(allow_unconnected=True)
    system.add("speed", fmus.path("SpeedProfile"))
    system.add("road", fmus.path("RoadRandom"), start={"flat": 0.0, "ramp": 0.5})
    system.add("car", fmus.path(case.car), step="1 ms")
    system.connect("speed.speed", "road.speed")
    if case.car == "QuarterCarHmmwv":
        system.connect("speed.x", "road.x")
        system.connect("road.road.fl.height", "car.road.height")
        system.connect("road.road.fl.rate", "car.road.rate")
    else:
        system.connect("speed.speed", "car.target.speed")
        system.connect("car.x", "road.x")
        system.connect_matching("road", "car", "road.*")
    if case.python:
        system.add("load", Load(), step="5 ms")
        system.connect("car.body.z", "load.z")
        system.connect("load.force", "car.force")
    return system


def measure(run):
    az = np.asarray(run.recording["car.body.az"])
    return {
        "rms": float(np.sqrt(np.mean(az**2))),
        "last": float(run.recording.time[-1]),
        "samples": len(az),
        "mass": run.start("car.body.mass"),
        "end": run.recording.stopped_by or "",
    }


@dataclass(frozen=True)
class Shaken:
    """Looks for the time up to which the r.m.s. acceleration is no larger, where each run depends on the last."""

    rms: float
    until: float
    cost: float = 3.0

    @property
    def label(self) -> str:
        return f"shaken-{self.rms:g}-until-{self.until:g}"

    @property
    def beside(self) -> str:
        return "all of them"

    def __call__(self, runner):
        low, high = 0.0, self.until
        for _ in range(3):
            middle = round((low + high) / 2, 3)
            if runner.metrics(Ride(seconds=middle))["rms"] > self.rms:
                high = middle
            else:
                low = middle
        if self.rms < 0:
            raise ValueError("nothing is shaken as little")
        return [low, high]


EXPERIMENT = Experiment(
    "lane-ride",
    Ride,
    Wiring(wire, lambda case: (case.car, case.python), lambda system, case: None, fmus=["RoadRandom"]),
    Measures(measure),
    RunOptions(
        lambda _, case: case.seconds,
        record=["car.body.az", "car.body.z"],
        interval="2 ms",
        stop_when=lambda _, case: [StopWhen("car.body.z", "<=", case.low)],
    ),
    module=__name__,
)
