"""Paper 003, linear part: a 6x6 crosses shallow trenches and follows a pitch reference under three controllers.

This module wires the FMUs and runs them; ``three_axle_study`` lays out the published runs on top of it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim import Recording, System, UnconnectedInputsWarning
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from fmu_sources.controllers.mpc_three_axle import CORNERS, ESTIMATORS, FORCES

SYSTEMS = ("passive", "lqr", "mpc", "mpc-preview")
SPEEDS_KMH, DEPTHS = (5.0, 10.0, 20.0), (0.15, 0.25)  # km/h, m: Table 5.1
DURATION = 30.0  # s; the reference is back at 0 at 24 s
REFERENCE_START, HOLD, HOLD_END = 15.0, (17.0, 22.0), 24.0  # s
SETTLED = 1.0  # s at the end of the hold over which the steady-state error is taken


@dataclass(frozen=True)
class Case:
    """One run of the experiment."""

    speed_kmh: float = 5.0
    depth: float = 0.15
    system: str = "mpc-preview"
    estimator: str = "offsets"
    hold_height: bool = False

    @property
    def label(self) -> str:
        """What tells this run's files from those of others."""
        parts = [f"{self.speed_kmh:g}kmh", f"{1e3 * self.depth:g}mm", self.system]
        parts += [self.estimator] * (self.estimator != "offsets") + ["height"] * self.hold_height
        return "-".join(parts)

    def __post_init__(self) -> None:
        choices: dict[str, Collection[str]] = {"system": SYSTEMS, "estimator": ESTIMATORS}
        for name, known in choices.items():
            check_choice(name, getattr(self, name), known)
        if not 0 <= self.speed_kmh <= 60:
            raise CaseError(f"speed {self.speed_kmh:g} km/h: give 0 to 60 km/h")
        if not 0 <= self.depth <= 1:
            raise CaseError(f"depth {self.depth:g} m: give 0 to 1 m")


class ThreeAxleBench:
    """Systems wired once per controller, and run as often as needed."""

    def __init__(self, fmus: FmuSet) -> None:
        self.fmus = fmus
        self._systems: dict[str | None, System] = {}

    def system(self, controller: str | None) -> System:
        """The vehicle on its road with a controller FMU, or without one."""
        if controller not in self._systems:
            self._systems[controller] = wire(self.fmus, controller)
        return self._systems[controller]

    def record(
        self,
        case: Case,
        *,
        duration: float = DURATION,
        reference: dict[str, float] | None = None,
        csv: Path | None = None,
    ) -> Recording:
        """Run one case and return its recording at 200 Hz; ``reference`` sets parameters of PitchReference."""
        controller = {"passive": None, "lqr": "LqrThreeAxle"}.get(case.system, "MpcThreeAxle")
        system = self.system(controller)
        system["speed"].set({"start.speed": case.speed_kmh / 3.6, "start.x": 0.0})
        system["road"].set({"trench.depth": case.depth})
        pitch = system["reference"]
        defaults = {n: pitch.description.parameters[n].start for n in pitch.description.parameters}
        pitch.set({**defaults, **(reference or {})})
        if controller == "MpcThreeAxle":
            system["controller"].set({
                "estimator": ESTIMATORS.index(case.estimator), "hold_height": case.hold_height, "retraction": 0,
                "use_preview": case.system == "mpc-preview",
            })  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", UnconnectedInputsWarning
            )  # `case` stays 0; nothing drives a passive vehicle
            return system.run(duration, record=recorded(case), record_interval="5 ms", csv=csv)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


def wire(fmus: FmuSet, controller: str | None) -> System:
    """One system of the experiment: everything every millisecond, the predictive controller every five."""
    system = System()
    system.add("speed", fmus.path("SpeedProfile"))
    system.add("road", fmus.path("RoadShallowTrench"))
    system.add("reference", fmus.path("PitchReference"))
    system.add("car", fmus.path("ThreeAxleRide"), step="1 ms")
    system.connect("speed.x", "road.x")
    system.connect("speed.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    if controller is None:
        return system
    system.add("controller", fmus.path(controller))
    system.connect_matching("car", "controller")
    system.connect_matching("controller", "car", "force.*")
    if controller == "LqrThreeAxle":
        system.connect("reference.reference.pitch[1]", "controller.reference.pitch")
    else:
        system.connect_matching("road", "controller", "preview.*")
        system.connect_matching("reference", "controller", "reference.pitch*")
    return system


def recorded(case: Case) -> list[str]:
    """What a run records."""
    names = ["car.body.pitch", "car.body.roll", "car.body.z", "car.body.az", "reference.reference.pitch[1]"]
    names += [f"road.road.{k}.height" for k in CORNERS]
    if case.system != "passive":
        names += [f"controller.{f}" for f in FORCES]
    if case.system.startswith("mpc"):
        names += [f"controller.{n}" for n in ("solver.status", "solver.residual", "solver.iterations", "slack")]
    return names


def pitch_error(recording: Recording) -> np.ndarray:
    """Pitch less its reference [rad]."""
    return recording["car.body.pitch"] - recording["reference.reference.pitch[1]"]


def forces(recording: Recording) -> np.ndarray:
    """Commanded forces (samples, 6) [N] by corner; zero for the passive vehicle."""
    if f"controller.{FORCES[0]}" not in recording:
        return np.zeros((len(recording), len(FORCES)))
    return np.column_stack([recording[f"controller.{f}"] for f in FORCES])


def edge_time(case: Case, *, start: float = 5.0, front: float = 1.98, rounding: float = 0.2) -> float:
    """When the first axle comes to where the trench begins to fall, three times its rounding before its edge [s]."""
    return (start - 3 * rounding - front) / (case.speed_kmh / 3.6) if case.speed_kmh else math.inf


def metrics(recording: Recording, case: Case) -> dict[str, float]:
    """Figures of one run: angles in degrees, forces in kN, solver figures as they are."""
    t, error = recording.time, np.degrees(pitch_error(recording))
    trench = t < REFERENCE_START - 0.5
    ramp = (t >= REFERENCE_START) & (t < HOLD_END)
    settled = (t >= HOLD[1] - SETTLED) & (t < HOLD[1])
    force = np.abs(forces(recording)) / 1e3
    found = {
        "peak_error_deg": float(np.abs(error[trench]).max()),
        "rms_error_deg": float(np.sqrt(np.mean(error[trench] ** 2))),
        "peak_force_kN": float(force.max()),
        "peak_heave_m": float(np.abs(recording["car.body.z"]).max()),
    }
    if t[-1] >= HOLD_END:
        up = (t >= REFERENCE_START) & (t < HOLD[0])
        found["steady_error_deg"] = float(np.abs(error[settled]).max())
        found["ramp_error_deg"] = float(np.sqrt(np.mean(error[up] ** 2)))
        found["reference_peak_error_deg"] = float(np.abs(error[ramp]).max())
    if case.speed_kmh:
        before = t < edge_time(case)
        found["force_before_edge_kN"] = float(force[before].max())
    if "controller.solver.status" in recording:
        found["solver_failures"] = float(np.count_nonzero(recording["controller.solver.status"]))
        found["solver_residual"] = float(recording["controller.solver.residual"].max())
        found["solver_iterations"] = float(recording["controller.solver.iterations"].max())
        found["slack"] = float(recording["controller.slack"].max())
    return found
