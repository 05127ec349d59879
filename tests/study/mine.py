"""A user's experiment: a mass that is let go, with notes of who ran.

One run fails, one ends the process.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from cosim import PythonComponent, System
from cosim.study import (
    Case,
    ClaimList,
    Experiment,
    Finding,
    Measures,
    Metric,
    RunOptions,
    Study,
    Task,
    Wiring,
    grid,
    option,
)

NOTES = os.environ.get("NOTES_OF_RUNS", "")


class Mass(PythonComponent):
    """Falls exponentially to 0; a rate of 13 is its end."""

    outputs = ("z [m]",)
    parameters = {"rate": 1.0}  # noqa: RUF012

    def start(self, u, y):  # noqa: ARG002
        y[0] = 1.0

    def step(self, t, h, u, y):  # noqa: ARG002
        if self.rate == 13:
            raise ValueError("thirteen is not for me")
        if self.rate == 666:
            os._exit(3)
        if self.rate == 99:
            time.sleep(0.02)
        y[0] *= 1 - self.rate * h


@dataclass(frozen=True)
class Fall(Case):
    rate: float = option(1.0, unit="1/s", within=(0, 1000), help="rate", label="rate{:g}", always=True)
    note: str = option("", help="a note")


def wire(fmus, case):  # noqa: ARG001
    system = System()
    system.add("mass", Mass(), step="10 ms")
    return system


def configure(system, case):
    if NOTES:
        with (Path(NOTES) / f"{case.rate:g}").open("a") as file:
            file.write(f"{os.getpid()}\n")
    system["mass"].set({"rate": case.rate})


def measure(run):
    z = run.recording["mass.z"]
    return {"last": float(z[-1]), "mean": float(z.mean())}


def signals(run):
    return {"time": run.recording.time.tolist(), "z": run.recording["mass.z"].tolist()}


CLAIMS = ClaimList()


@CLAIMS.claim("falls", "It falls faster with a higher rate", published="faster", source="common sense")
def _falls(study):
    slow, fast = study[Fall(1.0)], study[Fall(2.0)]
    return Finding(f"{slow['last']:.3f} m, {fast['last']:.3f} m", fast["last"] < slow["last"], "it does not")


@CLAIMS.check("slow", "It falls at all", expected="below 1 m")
def _slow(study):
    return Finding(f"{study[Fall(1.0)]['last']:.3f} m", study[Fall(1.0)]["last"] < 1, "it does not")


EXPERIMENT = Experiment(
    "fall",
    Fall,
    title="A mass that is let go",
    wiring=Wiring(wire, configure=configure),
    measures=Measures(
        measure, {"last": Metric("last height", "mm", 1e3), "mean": Metric("mean height", "m")}, signals=signals
    ),
    run=RunOptions(1.0, record=["mass.z"], interval="10 ms"),
    study=Study([Task(Fall(1.0), signals=True), *grid(Fall, rate=(2.0, 3.0, 13.0, 5.0))], claims=CLAIMS),
)
