"""Paper 003: a 6x6 crosses a trench, passive or under control; any length and speed.

This module wires the FMUs and runs them; ``trench_study`` lays out the published matrix, ``trench_claims`` judges it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from cosim import Recording, StopWhen, System
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from cosim.experiments.store import RunStore
from cosim.metrics_crossing import PSD_RATE, Crossing, cost, crossing, failures, psd
from cosim.peaks import keep_peaks
from fmu_sources.controllers.mpc_three_axle import CORNERS, SAMPLE_TIME

Row = dict[str, Any]

CONTROLS = {  # FMU of the controller, its parameters, and whether it sees the road ahead
    "passive": None,
    "mpc": ("MpcThreeAxle", {}, True),
    "mpc-no-preview": ("MpcThreeAxle", {}, False),
    "mpc-offsets": ("MpcThreeAxle", {"estimator": 1}, False),
    "mpc-free": ("MpcThreeAxle", {"retraction": 0}, True),
    "mpc-printed-sign": ("MpcThreeAxle", {"retraction": 2}, True),
    "mpc-no-height": ("MpcThreeAxle", {"hold_height": False}, True),
    "mpc-printed-limits": ("MpcThreeAxle", {"printed_limits": True}, True),
    "lqr": ("LqrThreeAxle", {}, False),
}
"""Kinds of control; what is not said of ``mpc`` holds for all of its variants."""

MPC = {"estimator": 0, "retraction": 1, "hold_height": True, "printed_limits": False}
STEP = Fraction(1, 4000)  # s, of the vehicle's solver, its exchange and recordings; the study halves it
FRAME = Fraction(1, 50)  # s, between frames of an animation
CURVES = ("car.body.pitch", "car.body.az", "car.body.ax", "car.hub.a1l.fx")  # drawn over time, peaks kept
RUN_OUT = 1.5  # m, that the last axle drives on behind the trench
CLEAR = 0.3  # m, level road before the first thing that happens
LENGTH_RANGE, SPEED_RANGE_KMH = (0.2, 2.5), (0.5, 15.0)
TOUCH = 1.0  # N, body force that counts as contact


@dataclass(frozen=True)
class Case:
    """One run. None: as in the vehicle file."""

    length: float = 1.6  # m
    speed_kmh: float = 6.0
    control: str = "mpc"
    depth: float | None = None  # m
    friction: float | None = None
    mass: float | None = None  # kg, sprung
    cg_offset: float | None = None  # m, ahead
    hydropneumatic: bool = False
    refine: int = 1  # divides solver, exchange and recording step of the vehicle

    def __post_init__(self) -> None:
        check_choice("control", self.control, CONTROLS)
        for name, value, (low, high), unit, what in (
            ("length", self.length, LENGTH_RANGE, "m", "the vehicle itself is about 6.6 m long"),
            ("speed", self.speed_kmh, SPEED_RANGE_KMH, "km/h", "a vehicle at rest crosses nothing"),
        ):
            if not low <= value <= high:
                raise CaseError(f"{name} {value:g} {unit}: give {low:g} to {high:g} {unit} ({what})")
        for name, limit, unit in (("depth", 10.0, " m"), ("friction", 2.0, ""), ("mass", 1e5, " kg")):
            value = getattr(self, name)
            if value is not None and not 0 < value <= limit:
                raise CaseError(f"{name} {value:g}{unit}: give more than 0 and at most {limit:g}{unit}")
        if not 1 <= self.refine <= 16:
            raise CaseError(f"steps divided by {self.refine}: give 1 to 16")
        if self.cg_offset is not None and not abs(self.cg_offset) <= 0.5:
            raise CaseError(f"CG offset {self.cg_offset:g} m: give -0.5 to 0.5 m")

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return self.speed_kmh / 3.6

    @property
    def label(self) -> str:
        """What tells this run's files from those of others."""
        parts = [f"{self.length:g}m", f"{self.speed_kmh:g}kmh", self.control]
        for name, unit in (("depth", "m-deep"), ("friction", "friction"), ("mass", "kg"), ("cg_offset", "m-offset")):
            value = getattr(self, name)
            parts += [f"{value:g}{unit}"] if value is not None else []
        parts += ["hydropneumatic"] * self.hydropneumatic
        return "-".join(parts + [f"steps-over-{self.refine}"] * (self.refine != 1))

    @property
    def step(self) -> Fraction:
        """Solver, exchange and recording step of the vehicle [s]."""
        return STEP / self.refine

    @property
    def title(self) -> str:
        """For people."""
        return f"{self.length:g} m, {self.speed_kmh:g} km/h"

    def fmus(self) -> list[str]:
        """Names of the FMUs of this run."""
        control = CONTROLS[self.control]
        return ["ThreeAxleTrench"] if control is None else ["ThreeAxleTrench", "TrenchCrossing", control[0]]


class TrenchBench:
    """Systems wired once per kind of control, and run as often as needed."""

    def __init__(self, fmus: FmuSet, store: RunStore | None = None) -> None:
        self.fmus = fmus
        self.store = store
        self._systems: dict[tuple[str, Fraction], System] = {}

    def system(self, case: Case) -> System:
        """The wired system of a case, with the parameters of this case set."""
        key = (case.control, case.step)
        if key not in self._systems:
            self._systems[key] = wire(self.fmus, *key)
        system = self._systems[key]
        configure(system, case)
        return system

    def record(
        self,
        case: Case,
        *,
        progress: bool = False,
        csv: Path | None = None,
        record: Sequence[str] = (),
        record_interval: str | Fraction | None = None,
    ) -> Recording:
        """Run a case until the last axle is clear of the trench, or the time is up; recording every step of the vehicle.

        ``record``: variables other than those of the metrics; ``record_interval``: another interval [s] than the step.

        Raises:
            ComponentError: a component failed; ``error.recording`` holds what was recorded.
        """
        system = self.system(case)
        course = Course.of(system, case)
        return system.run(
            course.patience, record=list(record) or recorded(case), record_interval=record_interval or case.step, progress=progress, csv=csv,
            stop_when=[StopWhen("car.x", ">=", course.end)],
        )  # fmt: skip

    def measure(self, case: Case) -> Row:
        """Metrics of a case as JSON values; stored if possible."""
        return self._stored(case)["metrics"]

    def frames(self, case: Case) -> Row:
        """Signals of a case for animations and time plots, at 50 Hz, as JSON values; stored if possible."""
        return self._stored(case)["frames"]

    def _stored(self, case: Case) -> Row:
        def compute() -> Row:
            recording = self.record(case)
            course = Course.of(self.system(case), case)
            return {"metrics": evaluate(case, course, recording), "frames": frames(case, recording)}

        return compute() if self.store is None else self.store.get(["trench", asdict(case)], compute)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


@dataclass(frozen=True)
class Course:
    """Where the trench is on the vehicle's way, positions of the CG along the road [m], and how long a run may take."""

    start: float  # of the trench
    end: float  # of the run: the last axle is RUN_OUT behind the trench
    patience: float  # s

    @classmethod
    def of(cls, system: System, case: Case) -> Course:
        parameter = system["car"].description.parameters
        first, last = float(parameter["wheel.a1l.x"].start), float(parameter["wheel.a3l.x"].start)
        nose = first + float(parameter["outline.front_overhang"].start)
        lead = 0.6 + 0.8 * case.speed  # of the pitch reference
        start = round(max(nose, first + lead + 0.2 * case.speed) + CLEAR, 3)
        end = start + case.length - last + RUN_OUT
        return cls(start, end, round(1.25 * end / case.speed + 2.0, 3))


# ---------------------------------------------------------------------- wiring


def wire(fmus: FmuSet, control: str, step: Fraction = STEP) -> System:
    """Vehicle, crossing algorithm and controller; the two latter in this order every 5 ms (LQR every 1 ms).

    ``step`` [s]: of the vehicle's solver and exchange.
    """
    system = System()
    system.add("car", fmus.path("ThreeAxleTrench"), step=step, parameters={"solver.step": float(step)})
    chosen = CONTROLS[control]
    if chosen is None:
        system["car"].set({f"force.{k}": 0.0 for k in CORNERS})
        return system
    name, parameters, sees = chosen
    system.add("crossing", fmus.path("TrenchCrossing"))
    system.connect_matching("car", "crossing")
    system["crossing"].set({"lidar.start.valid": True, "lidar.finish.valid": True})
    system.add("controller", fmus.path(name))
    system.connect_matching("car", "controller")
    if name.startswith("Mpc"):
        system.connect_matching("crossing", "controller")
        system["controller"].set({**MPC, **parameters, "use_preview": sees})
    else:
        system.connect("crossing.reference.pitch[1]", "controller.reference.pitch")
    system.connect_matching("controller", "car", "force.*")
    return system


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case in a system that was wired for its control."""
    car = system["car"]
    names = {
        "trench.depth": case.depth,
        "disc.friction": case.friction,
        "body.mass": case.mass,
        "body.cg_offset": case.cg_offset,
        "strut.hydropneumatic": case.hydropneumatic,
    }
    defaults = {n: car.description.parameters[n].start for n in names}
    car.set({n: defaults[n] if v is None else v for n, v in names.items()})
    car.set({"trench.length": case.length, "trench.start": Course.of(system, case).start, "target.speed": case.speed})


def recorded(case: Case) -> list[str]:
    """Variables that metrics, figures and animations need."""
    names = [f"car.{n}" for n in ("x", "speed", "body.az", "body.ax", "body.pitch", "body.roll", "body.z")]
    names += [f"car.{n}.force" for n in ("bumper.front", "bumper.rear", "belly")]
    for k in CORNERS:
        names += [f"car.hub.{k}.{n}" for n in ("fx", "x", "z")]
        if k.endswith("l"):
            names += [f"car.contact.{k}.{n}" for n in ("fx", "fz", "x", "z")]
    if case.control != "passive":
        names += ["crossing.case", "crossing.reference.pitch[1]", *(f"controller.force.{k}" for k in CORNERS)]
    if case.control.startswith("mpc"):
        names += [f"controller.solver.{n}" for n in ("status", "iterations", "residual")]
    return names


# ---------------------------------------------------------------------- results


def loads(case: Case, recording: Recording) -> Crossing:
    """The quantities of Table 5.3."""
    return crossing(
        recording["car.body.az"], recording["car.body.ax"], recording["car.body.pitch"],
        np.column_stack([recording[f"car.hub.{k}.fx"] for k in CORNERS]), float(1 / case.step),
    )  # fmt: skip


def evaluate(case: Case, course: Course, recording: Recording) -> Row:
    """Metrics of a run as JSON values: the quantities of Table 5.3 and what became of the crossing."""
    measured = loads(case, recording)
    arrived = bool(recording["car.x"][-1] >= course.end - 1e-6)
    touch = {n: float(recording[f"car.{n}.force"].max()) for n in ("belly", "bumper.front", "bumper.rear")}
    reasons = failures(measured, arrived=arrived, belly_contact=touch["belly"] > TOUCH)
    row: Row = {
        "length": case.length, "speed_kmh": case.speed_kmh, "control": case.control, "trench_start": course.start,
        "cg_offset": case.cg_offset or 0.0, **measured.as_dict(),
        "cost": cost(measured), "arrived": arrived, "passed": not reasons, "failures": list(reasons),
        "belly_kn": touch["belly"] / 1e3, "bumper_front_kn": touch["bumper.front"] / 1e3,
        "bumper_rear_kn": touch["bumper.rear"] / 1e3, "roll": math.degrees(np.abs(recording["car.body.roll"]).max()),
        "duration": float(recording.time[-1]),
    }  # fmt: skip
    if "controller.solver.status" in recording:
        row["solver_failures"] = round(
            (recording["controller.solver.status"] > 0).sum() * float(case.step) / SAMPLE_TIME
        )
        row["solver_iterations"] = int(recording["controller.solver.iterations"].max())
        row["solver_residual"] = float(recording["controller.solver.residual"].max())
    if "controller.force.a1l" in recording:
        row["force"] = max(float(np.abs(recording[f"controller.force.{k}"]).max()) for k in CORNERS) / 1e3
    return row


def outcome(row: Row) -> str:
    """How a run ended, in a few words."""
    if row["passed"]:
        bumpers = row["bumper_front_kn"] + row["bumper_rear_kn"] > TOUCH / 1e3
        return "passed, on its bumpers" if bumpers else "passed"
    words = {
        "az": "vertical acceleration", "ax": "longitudinal acceleration", "az_rms": "vertical rms",
        "ax_rms": "longitudinal rms", "hub_front": "hub force", "hub_middle": "hub force", "hub_rear": "hub force",
    }  # fmt: skip
    return "failed: " + ", ".join(dict.fromkeys(words.get(f, f) for f in row["failures"]))


def frames(case: Case, recording: Recording) -> Row:
    """What animation and time plots draw: signals every 20 ms as lists, by name, and whole curves that keep their peaks."""
    part = slice(None, None, int(FRAME / case.step))

    def rounded(name: str, values: np.ndarray) -> list[float]:
        return np.round(values, {"m": 4, "rad": 5, "N": 0}.get(recording.units.get(name, ""), 3)).tolist()

    out: Row = {"step": float(FRAME), "curves": {}}
    for name in recorded(case):
        if not name.startswith("controller.solver"):
            out[name] = rounded(name, recording[name][part])
    for name in CURVES:
        time, values = keep_peaks(recording.time, recording[name])
        out["curves"][name] = [np.round(time, 5).tolist(), rounded(name, values)]
    for axis in ("az", "ax"):
        every = int(1 / (PSD_RATE * case.step))
        frequency, density = bands(*psd(recording[f"car.body.{axis}"][::every], PSD_RATE))
        out |= {"psd.frequency": frequency, f"psd.{axis}": density}
    return out


def bands(frequency: np.ndarray, density: np.ndarray) -> tuple[list[float], list[float]]:
    """Means of a spectrum over bands of a twelfth of a decade, from 0.3 to 300 Hz; bands without a line are left out."""
    edges = 10 ** np.arange(-0.5, 2.55, 1 / 12)
    number = np.digitize(frequency, edges)
    full = [i for i in range(1, len(edges)) if (number == i).any()]
    means = [float(density[number == i].mean()) for i in full]
    return [float(np.sqrt(edges[i - 1] * edges[i])) for i in full], means
