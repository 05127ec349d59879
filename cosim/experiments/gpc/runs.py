"""Runs of paper 000: a nonlinear HMMWV on three roads, passive and under three GPC controllers, wired and measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from cosim import Recording, StopWhen, System
from cosim.core.signals import peak, rms
from cosim.experiments.metrics import response as metrics
from cosim.experiments.steps import Stepped, exchange_step, set_solver_step
from cosim.study.case import option
from cosim.study.experiment import Metric, Row, Run
from cosim.study.fmus import FmuSet
from fmu_sources.controllers.gpc.component import gain_parameters
from fmu_sources.controllers.gpc.identification import (
    DesignSettings,
    IdentificationSettings,
    IdentifiedModels,
    identify,
)
from fmu_sources.models.corners import CORNERS

PLANT, SPEED = "FullCarHmmwvModified", "SpeedProfile"
ROADS = {"sine": "RoadSine", "curb": "RoadCurb", "perryman3": "RoadPerryman3"}
CONTROLLERS = {"passive": None, "implicit": "GpcImplicit", "explicit": "GpcExplicit", "preview": "GpcPreview"}
FMUS = (PLANT, SPEED, *ROADS.values(), *(c for c in CONTROLLERS.values() if c))
R_PUBLISHED = 1e-7  # 1/N2
TRAVEL = 150.0  # m, length of every run
SAMPLE_RATE = 100.0  # Hz, of all metrics
EXCHANGE = Fraction(1, 1000)  # s, between car, road and controller


@dataclass(frozen=True)
class Case(Stepped):
    """One run; `R` and `seed` matter for controlled runs only."""

    road: str = option("sine", choices=ROADS, files=".fmu", help="road under the wheels", always=True)
    speed_kmh: float = option(
        50.0,
        unit="km/h",
        within=(2, 200),
        name="speed",
        help="speed",
        label="{:g}kmh",
        always=True,
    )
    controller: str = option("preview", choices=CONTROLLERS, help="control law", always=True)
    R: float = option(
        R_PUBLISHED, unit="1/N2", within=(1e-30, 1e30), name="weight", help="control weight R", label="R{:g}"
    )
    seed: int = option(0, within=(0, 2**31 - 1), help="seed of the identification run", label="seed{}")
    hold: bool = option(
        False,
        help="explicit only: let the last road height continue ahead",
        only=(lambda c: c.controller == "explicit", "the explicit controller"),
    )


def passive(case: Case) -> Case:
    """What a run is compared with."""
    return replace(case, controller="passive", R=R_PUBLISHED, seed=0, hold=False)


# ------------------------------------------------------------------------------------------------------------- wiring


def structure(case: Case) -> tuple[object, ...]:
    """What decides the wiring."""
    return case.road, case.controller, case.exchange_parts


_wired_from: WeakKeyDictionary[System, FmuSet] = WeakKeyDictionary()  # whose controllers are identified from them


def road_file(fmus: FmuSet, road: str) -> Path:
    """FMU of a road by its short name, or by its path."""
    return fmus.path(ROADS.get(road, road))


def wire(fmus: FmuSet, case: Case) -> System:
    """Car, road, speed profile and controller, as in the paper: car and exchange at 1 kHz, control at 100 Hz."""
    system = System(allow_unconnected=True)  # the driver keeps y = 0; nothing drives the passive car's actuators
    _wired_from[system] = fmus
    system.add("speed", fmus.path(SPEED))
    system.add("road", road_file(fmus, case.road))
    system.add("car", fmus.path(PLANT), step=exchange_step(EXCHANGE, case))
    system.connect("speed.speed", "car.target.speed")
    system.connect("car.x", "road.x")
    system.connect("car.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    if name := CONTROLLERS[case.controller]:
        system.add("controller", fmus.path(name))
        system.connect_matching("car", "controller", "body.*")
        if case.controller != "implicit":
            system.connect_matching("road", "controller")
        system.connect_matching("controller", "car", "force.*")
    return system


@cache
def models(plant: Path, road: Path, speed: Path, seed: int) -> IdentifiedModels:
    """Models identified from these FMUs with the excitation of a seed."""
    return identify(plant, road, speed, IdentificationSettings(seed=seed))


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case; the gains are those of a controller identified from these very FMUs."""
    set_solver_step(system["car"], case)
    system["speed"].set({"start.speed": case.speed_kmh / 3.6})
    if case.controller == "passive":
        return
    fmus = _wired_from[system]
    identified = models(fmus.path(PLANT), road_file(fmus, "perryman3"), fmus.path(SPEED), case.seed)
    system["controller"].set(gain_parameters(identified.law(case.controller, DesignSettings(R=case.R))))  # type: ignore[arg-type]
    if case.controller == "explicit":
        system["controller"].set({"hold_height": case.hold})


def stop_time(_: System, case: Case) -> float:
    """Longest run [s], for a car that is slowed down."""
    return 1.25 * TRAVEL / (case.speed_kmh / 3.6) + 1.0


def stop_when(system: System, _: Case) -> list[StopWhen]:
    """A run ends where the car has traveled its way."""
    start = float(system["car"].description.variables["start.x"].start)  # type: ignore[arg-type]
    return [StopWhen("car.x", ">=", start + TRAVEL)]


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    names = [f"car.{n}" for n in ("x", "speed", "body.z", "body.az", "body.pitch", "body.roll")]
    names += [f"car.{s}.{k}.{q}" for k in CORNERS for s, q in (("actuator", "power"), ("tire", "force"))]
    return names if case.controller == "passive" else [*names, *(f"controller.force.{k}" for k in CORNERS)]


# ---------------------------------------------------------------------------------------------------------- measuring


METRICS = {
    "response": Metric("response objective J", form="{:.4f}"),
    "force": Metric("actuator force", "N", form="{:.0f}"),
    "power": Metric("actuator power", "W", form="{:.0f}"),
    "peak_force": Metric("peak force", "N", form="{:.0f}"),
    "rms_az": Metric("rms vertical acceleration", "m/s2", form="{:.3f}"),
    "rms_pitch": Metric("rms pitch", "rad", form="{:.5f}"),
    "rms_roll": Metric("rms roll", "rad", form="{:.5f}"),
    "improvement": Metric("response improvement", form="{:.3f}"),
}
"""What is compared between the controllers."""


def forces(recording: Recording) -> np.ndarray:
    """Commanded actuator forces (samples, 4) [N]; zero for the passive car."""
    names = [f"controller.force.{k}" for k in CORNERS]
    if names[0] not in recording:
        return np.zeros((len(recording), len(CORNERS)))
    return np.column_stack([recording[n] for n in names])


def measure(run: Run) -> Row:
    """The published metrics of one run (equations 22a-c), and what else the claims need."""
    r = run.recording
    az, pitch, roll = (r[f"car.{n}"] for n in ("body.az", "body.pitch", "body.roll"))
    u = forces(r)
    power = np.column_stack([r[f"car.actuator.{k}.power"] for k in CORNERS])
    return {
        "diverged": r.stopped_by is None,
        "response": metrics.response_objective(az, pitch, roll, SAMPLE_RATE),
        "force": metrics.actuator_force(u, SAMPLE_RATE),
        "power": metrics.actuator_power(power, SAMPLE_RATE),
        "peak_force": peak(u),
        "peak_pitch": peak(pitch),
        "rms_az": rms(az),
        "rms_pitch": rms(pitch),
        "rms_roll": rms(roll),
    }


def compared(row: Row, baseline: Row) -> Row:
    """What a run gains on the passive car (23)."""
    return {"improvement": metrics.improvement(row["response"], baseline["response"])}


def diverged(_: Case, error: Exception) -> Row:
    """Metrics of a run that a component ended: a closed loop that diverges is an outcome, and has no numbers."""
    return {"diverged": True, "reason": str(error)}


def remarks(run: Run) -> list[str]:
    """How much of the passive response is left is the published figure; a run that did not arrive says so."""
    return ["the run ended before its way was traveled"] if run.recording.stopped_by is None else []


def signals(run: Run) -> Row:
    """Signals of figures 8, 10 and 12 at 100 Hz: time [s], acceleration [m/s2], angles [deg], force [N]."""
    r: Any = run.recording
    shown = {
        "az": r["car.body.az"],
        "pitch": np.degrees(r["car.body.pitch"]),
        "roll": np.degrees(r["car.body.roll"]),
        "force": forces(r)[:, 0],
    }
    rounded = {k: [float(f"{x:.6g}") for x in v] for k, v in shown.items()}
    return {"time": np.round(r.time, 9).tolist(), **rounded}
