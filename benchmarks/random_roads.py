"""The passive full car over 2 s of random roads: seed and class of the road, mass and speed vary.

An experiment for sweeps.
"""

import numpy as np

from cosim import System
from cosim.study import FmuSet

STOP_TIME = 2.0
RECORD = ["car.body.az", "car.body.pitch", "car.tire.*.force"]


def system() -> System:
    made, fmus = System(), FmuSet()
    made.add("speed", fmus.path("SpeedProfile"))
    made.add("road", fmus.path("RoadRandom"))
    made.add(
        "car",
        fmus.path("FullCarHmmwv"),
        start={"target.y": 0.0} | {f"force.{c}": 0.0 for c in ("fl", "fr", "rl", "rr")},
    )
    made.connect("speed.speed", "car.target.speed")
    made.connect("car.x", "road.x")
    made.connect("car.speed", "road.speed")
    made.connect_matching("road", "car")
    return made


def measure(run):
    az = np.asarray(run.recording["car.body.az"])
    force = np.asarray(run.recording["car.tire.fl.force"])
    return {
        "rms acceleration": float(np.sqrt(np.mean(az**2))),
        "largest acceleration": float(np.abs(az).max()),
        "smallest tire force": float(force.min()),
        "rms pitch": float(np.sqrt(np.mean(np.asarray(run.recording["car.body.pitch"]) ** 2))),
    }
