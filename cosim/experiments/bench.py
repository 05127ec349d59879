"""Paper 002: a quarter-car bench under LQR and MPC; one run wired, recorded and judged.

``bench_study`` lays out figures and claims on top of this module.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim import Recording, System, UnconnectedInputsWarning
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from fmu_sources.controllers.bench import FORCE_LIMIT, STATES

SYSTEMS = {  # name -> FMU, parameters
    "passive": (None, {}),
    "lqr": ("LqrBench", {}),
    "lqr-clipped": ("LqrBench", {"limit": FORCE_LIMIT}),
    "mpc": ("MpcBench", {}),
    "mpc-moves": ("MpcBenchMoves", {}),
}
ROADS = {"bump": "RoadBenchBump", "random": "RoadBenchRandom"}
BUMP_DURATIONS = (0.5, 0.2)  # s
BUMP_HEIGHT = 0.02  # m
BUMP_START = 0.1  # s
EXCHANGE_STEP = "1 ms"  # of the plant
LENGTH = {"bump": 3.0, "random": 10.0}  # s, of a run


@dataclass(frozen=True)
class Case:
    """One run: road, controller, and whether the states come from encoders.

    ``height`` and ``duration`` are the bump's, ``offset`` is the random road's.
    """

    system: str = "mpc"
    road: str = "bump"
    duration: float = BUMP_DURATIONS[0]
    height: float = BUMP_HEIGHT
    encoders: bool = False
    offset: float = 0.0  # s, where in the random motion the run starts

    def __post_init__(self) -> None:
        check_choice("controller", self.system, SYSTEMS)
        check_choice("road", self.road, ROADS)
        if not (math.isfinite(self.duration) and 0.01 <= self.duration <= LENGTH["bump"]):
            raise CaseError(f"bump of {self.duration:g} s: give 0.01 to {LENGTH['bump']:g} s")
        if not (math.isfinite(self.height) and abs(self.height) <= 0.1):
            raise CaseError(f"bump of {1e3 * self.height:g} mm: give -100 to 100 mm")
        if not (math.isfinite(self.offset) and 0.0 <= self.offset <= 1e5):
            raise CaseError(f"random road from {self.offset:g} s on: give 0 to 100000 s")
        if self.encoders and self.system == "passive":
            raise CaseError("the passive bench has no controller that would use the encoders")

    @property
    def label(self) -> str:
        """What tells this run's files from those of others."""
        parts = [self.road, self.system]
        if self.road == "bump":
            parts.insert(1, f"{1e3 * self.duration:g}ms")
            parts += [f"{1e3 * self.height:g}mm"] * (self.height != BUMP_HEIGHT)
        else:
            parts += [f"from-{self.offset:g}s"] * (self.offset != 0.0)
        return "-".join(parts + ["encoders"] * self.encoders)


class Bench:
    """Systems wired once, and run as often as needed."""

    def __init__(self, fmus: FmuSet) -> None:
        self.fmus = fmus
        self._systems: dict[tuple[str, str | None, bool, str], System] = {}

    def record(
        self,
        case: Case,
        csv: Path | None = None,
        *,
        solver_step: float | None = None,
        exchange_step: str = EXCHANGE_STEP,
    ) -> Recording:
        """Run one case; recording at 1 kHz. ``solver_step`` [s] and ``exchange_step`` are those of the plant."""
        controller, parameters = SYSTEMS[case.system]
        key = (case.road, controller, case.encoders, exchange_step)
        if key not in self._systems:
            self._systems[key] = wire(self.fmus, ROADS[case.road], controller, case.encoders, exchange_step)
        system = self._systems[key]
        own_step = system["plant"].description.parameters["solver.step"].start
        system["plant"].set({"solver.step": own_step if solver_step is None else solver_step})
        if case.road == "random":
            system["road"].set({"offset": case.offset})
        if case.road == "bump":
            system["road"].set({"bump.start": BUMP_START, "bump.duration": case.duration, "bump.height": case.height})
        if controller == "LqrBench":
            default = {"limit": system["controller"].description.parameters["limit"].start}
            system["controller"].set({**default, **parameters})
        recorded = ["road.road.height", "plant.*"] + (["controller.*"] if controller else [])
        recorded += ["encoders.*"] * case.encoders
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UnconnectedInputsWarning)  # nothing drives the passive bench
            return system.run(LENGTH[case.road], record=recorded, record_interval="1 ms", csv=csv)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


def wire(fmus: FmuSet, road: str, controller: str | None, encoders: bool, exchange_step: str = EXCHANGE_STEP) -> System:
    """Road, bench and controller, with or without encoders in between; ``exchange_step`` is the plant's."""
    system = System()
    system.add("road", fmus.path(road))
    system.add("plant", fmus.path("QuarterCarBench"), step=exchange_step)
    system.connect_matching("road", "plant")
    if controller is None:
        return system
    system.add("controller", fmus.path(controller))
    if encoders:
        system.add("encoders", fmus.path("BenchEncoders"))
        system.connect("plant.suspension.deflection", "encoders.encoder.suspension")
        system.connect("plant.body.z", "encoders.encoder.body")
        system.connect("road.road.height", "encoders.encoder.road")
        system.connect_matching("encoders", "controller")
    else:
        system.connect_matching("plant", "controller")
    system.connect_matching("controller", "plant", "force")
    return system


def force(recording: Recording) -> np.ndarray:
    """Commanded force [N]; 0 on the passive bench."""
    return recording["controller.force"] if "controller.force" in recording else np.zeros(len(recording))


def metrics(recording: Recording) -> dict[str, float]:
    """What is compared between the systems; see :data:`UNITS`."""
    road, body = recording["road.road.height"], recording["plant.body.z"]
    f = force(recording)

    def rms(signal: np.ndarray) -> float:
        return float(np.sqrt(np.mean(signal**2)))

    return {
        "acceleration": rms(recording["plant.body.az"]),
        "overshoot": float(max(body.max() - road.max(), road.min() - body.min(), 0.0)),
        "travel": rms(recording["plant.suspension.deflection"]),
        "tire": rms(recording["plant.tire.deflection"]),
        "force": rms(f),
        "force.max": float(f.max()),
        "force.min": float(f.min()),
    }


UNITS = {
    "acceleration": ("rms acceleration of the body", "m/s2", 1.0),
    "overshoot": ("body beyond the road's extremes", "mm", 1e3),
    "travel": ("rms suspension deflection", "mm", 1e3),
    "tire": ("rms tyre deflection", "mm", 1e3),
    "force": ("rms force", "N", 1.0),
    "force.max": ("largest force", "N", 1.0),
    "force.min": ("smallest force", "N", 1.0),
}
"""Metric -> text, unit, factor from SI."""


def states_at_samples(recording: Recording, period: float) -> np.ndarray:
    """States (samples, 4) that the controller saw, in the order of the paper."""
    every = round(period * 1000)
    source = "encoders" if "encoders.body.vz" in recording else "plant"
    return np.column_stack([recording[f"{source}.{s}"][::every] for s in STATES])
