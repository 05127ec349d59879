"""A quarter car on a sine road: amplitude of the body's acceleration once it is periodic."""

from __future__ import annotations

import math

import numpy as np

from cosim import PythonComponent, System
from cosim.study import FmuSet

OMEGA = 12.0  # rad/s, between the two modes
STOP_TIME = 4.0
RECORD = ["car.body.az"]


class SineRoad(PythonComponent):
    """Height of 1 cm amplitude."""

    outputs = ("road.height [m]", "road.rate [m/s]")

    def start(self, u, y):  # noqa: ARG002
        y[:] = 0.0, 0.01 * OMEGA

    def step(self, t, h, u, y):  # noqa: ARG002
        y[:] = 0.01 * math.sin(OMEGA * (t + h)), 0.01 * OMEGA * math.cos(OMEGA * (t + h))


def system() -> System:
    made = System()
    made.add("road", SineRoad(), step="1 ms")
    made.add("car", FmuSet().path("QuarterCarHmmwv"), step="1 ms", start={"force": 0.0})
    made.connect_matching("road", "car")
    return made


def measure(run):
    """By least squares over the last four periods."""
    time = np.asarray(run.recording.time)
    last = time > STOP_TIME - 4 * 2 * math.pi / OMEGA
    basis = np.column_stack([np.sin(OMEGA * time[last]), np.cos(OMEGA * time[last])])
    found, *_ = np.linalg.lstsq(basis, np.asarray(run.recording["car.body.az"])[last], rcond=None)
    return {"amplitude": float(np.hypot(*found))}
