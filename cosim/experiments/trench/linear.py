"""Linear and nonlinear passive vehicle over a shallow trench with sloped edges (figures 5.1 to 5.3 of paper 003).

The same masses, wheel positions and tire damping; the linear one's speed is constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim import System
from cosim.fmu.file import FmuFile
from cosim.study import Case, Experiment, FmuSet, Measures, Row, Run, RunOptions, Study, Task, Wiring, option
from fmu_sources.models.corners import SIX_CORNERS

SPEED_KMH, DEPTH = 5.0, 0.15  # km/h, m
START, LENGTH, EDGE = 6.0, 2.0, 0.2  # m, of the trench
BEHIND = 5.0  # m, that the runs continue beyond the trench
STEP = "1 ms"  # of either vehicle's exchange
VEHICLES = {"linear": "ThreeAxleRide", "nonlinear": "ThreeAxleTrench"}
FMUS = ("SpeedProfile", "RoadShallowTrench", *VEHICLES.values())


@dataclass(frozen=True)
class Shallow(Case):
    """One of the two vehicles."""

    vehicle: str = option("linear", choices=VEHICLES, help="equations of the vehicle", label="{}", always=True)


def wire(fmus: FmuSet, case: Shallow) -> System:
    """The linear vehicle on a road, or the nonlinear one over an outline, at the same speed."""
    system = System(allow_unconnected=True)  # nothing drives the actuators
    if case.vehicle == "nonlinear":
        system.add("car", fmus.path("ThreeAxleTrench"), step=STEP, start=_outline(fmus))
        return system
    system.add("speed", fmus.path("SpeedProfile"), start={"start.speed": SPEED_KMH / 3.6, "start.x": 0.0})
    sizes = {"start": START, "length": LENGTH, "depth": DEPTH, "edge": EDGE}
    system.add("road", fmus.path("RoadShallowTrench"), start={f"trench.{n}": v for n, v in sizes.items()})
    system.add("car", fmus.path("ThreeAxleRide"), step=STEP)
    system.connect_matching("speed", "road")
    system.connect_matching("road", "car", "road.*")
    return system


def _outline(fmus: FmuSet) -> dict[str, Any]:
    """Start values of the nonlinear vehicle: that trench as an outline, geometry and tires of the linear vehicle."""
    corners = np.array([-1.0, 1.0]) * EDGE  # the rounded edge as a straight slope as steep as it is in the middle
    x = [*(START + corners), *(START + LENGTH + corners)]
    z = [0.0, -DEPTH, -DEPTH, 0.0]
    values: dict[str, Any] = {"obstacle.shape": 2, "outline.points": 4, "target.speed": SPEED_KMH / 3.6}
    for side in ("left", "right"):
        for i, (at, height) in enumerate(zip(x, z, strict=True), start=1):
            values |= {f"outline.{side}.x[{i}]": float(at), f"outline.{side}.z[{i}]": height}
    known = FmuFile(fmus.path("ThreeAxleRide")).description.parameters
    names = [f"{n}.{k}.{of}" for k in SIX_CORNERS for n, of in (("wheel", "x"), ("tire", "damping"))]
    return values | {n: known[n].start for n in names}


def recorded(case: Shallow) -> list[str]:
    """What is recorded."""
    return ["car.body.z", "car.body.pitch", _speed(case)]


def _speed(case: Shallow) -> str:
    return "speed.speed" if case.vehicle == "linear" else "car.speed"


def measure(_: Run) -> Row:
    """Nothing: the figure shows the signals."""
    return {}


def signals(run: Run) -> Row:
    """What the figure draws, every 10 ms: time [s], height [m], pitch [deg], speed [km/h]."""
    r = run.recording
    shown = {
        "time": r.time,
        "z": r["car.body.z"],
        "pitch": np.degrees(r["car.body.pitch"]),
        "speed": 3.6 * r[_speed(run.case)],
    }
    return {name: signal.tolist() for name, signal in shown.items()}


PART = Experiment(
    "shallow",
    Shallow,
    title="Linear and nonlinear 6x6 over a shallow trench (paper 003)",
    wiring=Wiring(wire, fmus=FMUS),
    measures=Measures(measure, signals=signals),
    run=RunOptions(round((START + LENGTH + BEHIND) / (SPEED_KMH / 3.6), 3), record=recorded, interval="10 ms"),
    study=Study([Task(Shallow(v), signals=True, cost=0.1) for v in VEHICLES]),
)
