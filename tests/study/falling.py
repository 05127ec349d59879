"""A file with a function `system`: a mass that is let go, with parameters of its component.

One of them is the end of the process.
"""

from __future__ import annotations

import os

from cosim import PythonComponent, System

STOP_TIME = 0.1
RECORD = ["mass.z"]


class Mass(PythonComponent):
    """Falls from a height at constant rate."""

    outputs = ("z [m]",)
    parameters = {"rate": 1.0, "height": 1.0}  # noqa: RUF012

    def start(self, u, y):  # noqa: ARG002
        y[0] = self.height

    def step(self, t, h, u, y):  # noqa: ARG002
        if self.rate > 900:
            os._exit(3)
        if self.rate > 800:
            raise ValueError("too fast")
        y[0] -= self.rate * h


def system(offset: float = 0.0, count: int = 1) -> System:  # noqa: ARG001
    made = System()
    made.add("mass", Mass(), step="10 ms")
    return made


def measure(run):
    case = run.case
    return {
        "fallen": float(run.recording["mass.z"][0] - run.recording["mass.z"][-1]) + case.offset,
        "count": case.count,
    }
