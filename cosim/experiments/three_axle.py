"""Paper 003, linear part: a 6x6 crosses shallow trenches and follows a pitch reference under three controllers.

This module wires the FMUs and runs them; ``three_axle_study`` lays out the published runs on top of it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim import Recording, System, UnconnectedInputsWarning
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from fmu_sources.controllers.mpc_three_axle import CORNERS, ESTIMATORS, FORCES, PREDICTION, SAMPLE_TIME

SYSTEMS = ("passive", "lqr", "mpc", "mpc-preview")
SPEEDS_KMH, DEPTHS = (5.0, 10.0, 20.0), (0.15, 0.25)  # km/h, m: Table 5.1
FMUS = ("SpeedProfile", "RoadShallowTrench", "PitchReference", "ThreeAxleRide", "LqrThreeAxle", "MpcThreeAxle")
EXCHANGE_STEP = "1 ms"  # of the vehicle
HORIZON = PREDICTION * SAMPLE_TIME  # s, of the predictive controllers
DURATION = 25.0  # s; the reference is back at 0 at 24 s
REFERENCE_START, HOLD_START, HOLD_END, REFERENCE_END = 15.0, 17.0, 22.0, 24.0  # s
SETTLED = 1.0  # s at the end of the hold over which the steady-state error is taken
EDGE_BEGINS = 0.0025  # of the depth
LIMIT = 150.0  # kN, Table 4.5

Row = dict[str, Any]


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
        self._systems: dict[tuple[str, str], System] = {}

    def system(self, name: str, exchange_step: str = EXCHANGE_STEP) -> System:
        """The wired system of one of :data:`SYSTEMS`."""
        key = (name, exchange_step)
        if key not in self._systems:
            self._systems[key] = wire(self.fmus, name, exchange_step)
        return self._systems[key]

    def record(
        self,
        case: Case,
        *,
        duration: float = DURATION,
        csv: Path | None = None,
        record: Sequence[str] = (),
        solver_step: float | None = None,
        exchange_step: str = EXCHANGE_STEP,
    ) -> Recording:
        """Run one case and return its recording at 200 Hz; ``record``: variables other than those of the metrics.

        ``solver_step`` [s] and ``exchange_step`` are those of the vehicle; controllers and road keep their sample times.
        """
        system = self.system(case.system, exchange_step)
        own_step = system["car"].description.parameters["solver.step"].start
        system["car"].set({"solver.step": own_step if solver_step is None else solver_step})
        system["speed"].set({"start.speed": case.speed_kmh / 3.6, "start.x": 0.0})
        system["road"].set({"trench.depth": case.depth})
        if case.system.startswith("mpc"):
            system["controller"].set({
                "estimator": ESTIMATORS.index(case.estimator), "hold_height": case.hold_height,
                "use_preview": case.system == "mpc-preview",
            })  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", UnconnectedInputsWarning
            )  # `case` stays 0; nothing drives a passive vehicle
            return system.run(duration, record=list(record) or _recorded(case), record_interval="5 ms", csv=csv)

    def measure(self, case: Case, **steps: Any) -> Row:
        """Metrics of a whole run; ``steps`` as for :meth:`record`."""
        return metrics(self.record(case, **steps), case)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


def wire(fmus: FmuSet, name: str, exchange_step: str = EXCHANGE_STEP) -> System:
    """One system of :data:`SYSTEMS`: everything every millisecond, the predictive controllers every five.

    ``exchange_step`` is the vehicle's.

    Raises:
        CaseError: no such system.
    """
    check_choice("system", name, SYSTEMS)
    system = System()
    system.add("speed", fmus.path("SpeedProfile"))
    system.add("road", fmus.path("RoadShallowTrench"))
    system.add("reference", fmus.path("PitchReference"))
    system.add("car", fmus.path("ThreeAxleRide"), step=exchange_step)
    system.connect("speed.x", "road.x")
    system.connect("speed.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    if name == "passive":
        return system
    system.add("controller", fmus.path("LqrThreeAxle" if name == "lqr" else "MpcThreeAxle"))
    system.connect_matching("car", "controller")
    system.connect_matching("controller", "car", "force.*")
    if name == "lqr":
        system.connect("reference.reference.pitch[1]", "controller.reference.pitch")
        return system
    system.connect_matching("road", "controller", "preview.*")
    if name == "mpc-preview":
        system.connect("reference.reference.pitch", "controller.reference.pitch")
    else:  # without preview the reference, too, is known only as it stands now
        for i in range(PREDICTION):
            system.connect("reference.reference.pitch[1]", f"controller.reference.pitch[{i + 1}]")
    return system


def _recorded(case: Case) -> list[str]:
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


def edge_time(time: np.ndarray, height: np.ndarray, depth: float) -> float:
    """When the first axle comes to where the road begins to fall [s]; inf if it never does.

    Args:
        time: (samples,) [s].
        height: of the road under the first axle (samples,), as ``depth`` of the trench. Begun means 0.25 % of the depth, three
            times the rounding ahead of the edge.
    """
    begun = np.flatnonzero(height < -EDGE_BEGINS * depth)
    return float(time[begun[0]]) if len(begun) else math.inf


def metrics(recording: Recording, case: Case) -> Row:
    """Figures of one run. Errors are those of pitch; a run that ends before the reference lacks its figures."""
    t, error = recording.time, np.degrees(pitch_error(recording))
    trench = t < REFERENCE_START - 0.5
    force = np.abs(forces(recording)) / 1e3
    found: Row = {
        "peak_error_deg": float(np.abs(error[trench]).max()),
        "rms_error_deg": _rms(error[trench]),
        "peak_force_kN": float(force.max()),
        "at_limit": float(np.mean(force >= LIMIT - 1e-6)),
        "force_before_edge_kN": float(force[t < edge_time(t, recording["road.road.a1l.height"], case.depth)].max()),
        "peak_heave_m": float(np.abs(recording["car.body.z"]).max()),
        "rms_az": _rms(recording["car.body.az"][trench]),
    }
    if t[-1] >= REFERENCE_END:
        found["pitch_before_ramp_deg"] = float(np.degrees(recording["car.body.pitch"][t <= REFERENCE_START])[-1])
        moved = forces(recording)[(t >= REFERENCE_START - HORIZON) & (t < REFERENCE_START)] / 1e3
        found["force_before_ramp_kN"] = float(np.abs(moved - moved[0]).max())  # change within the horizon
        found["ramp_error_deg"] = _rms(error[(t >= REFERENCE_START) & (t < HOLD_START)])
        found["steady_error_deg"] = float(np.abs(error[(t >= HOLD_END - SETTLED) & (t < HOLD_END - 0.3)]).max())
    if "controller.solver.status" in recording:
        found["solver_failures"] = int(np.count_nonzero(recording["controller.solver.status"]))
        found["solver_residual"] = float(recording["controller.solver.residual"].max())
        found["solver_iterations"] = int(recording["controller.solver.iterations"].max())
        found["slack"] = float(recording["controller.slack"].max())
    return found


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
