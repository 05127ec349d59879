"""Paper 004: what preview buys on a seven-degree car, by optimal LQ control with three information patterns.

This module wires the FMUs and runs them; ``preview_lq_study`` lays out tables, figures and claims on top of it.
"""

from __future__ import annotations

import json
import math
import warnings
import zipfile
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim import Recording, System, UnconnectedInputsWarning
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from fmu_sources.catalog import weights_name
from fmu_sources.controllers.preview_lq import CORNERS, MODES, WEIGHTED
from fmu_sources.controllers.preview_lq_weights import PreviewLqWeights, load_weights

CONTROLLERS = {
    "comfort": "PreviewLqComfort",
    "road-holding": "PreviewLqRoadHolding",
    "comfort-5ms": "PreviewLqComfort5ms",
}
WEIGHTS = {"comfort": "comfort", "road-holding": "road_holding", "comfort-5ms": "comfort"}
SYSTEMS = ("passive", *MODES)
INPUTS = {"both": 0, "left": 1}  # parameter `side` of the road
SHAPES = {"haversine": 0, "sine": 1, "triangle": 2, "step": 3}
SPEED_KMH = 75.0
PREVIEW_TIME = 0.12  # s
EXCHANGE_STEP = "1 ms"  # of the car
DURATION = 1.2  # s, of the means in Table 3
INDEX_RATE = 1000.0  # Hz, samples of the means


@dataclass(frozen=True)
class Case:
    """One run of the experiment. ``weights``: a name of :data:`CONTROLLERS`, or the path of a weights file (``.toml``)."""

    input: str = "both"
    weights: str = "comfort"
    system: str = "preview"
    preview_time: float = PREVIEW_TIME
    speed_kmh: float = SPEED_KMH
    shape: str = "haversine"
    hold_tail: bool = False

    @property
    def label(self) -> str:
        """What tells this run's files from those of others."""
        parts = [self.input, Path(self.weights).stem, self.system]
        if self.system == "preview" and self.preview_time != PREVIEW_TIME:
            parts.append(f"{1e3 * self.preview_time:g}ms")
        parts += [f"{self.speed_kmh:g}kmh"] * (self.speed_kmh != SPEED_KMH)
        parts += [self.shape] * (self.shape != "haversine") + ["hold"] * self.hold_tail
        return "-".join(parts)

    @property
    def own_weights(self) -> Path | None:
        """The file of a user's weights; None for published ones."""
        return Path(self.weights) if self.weights.endswith(".toml") else None

    @property
    def controller(self) -> str | None:
        """Name of the controller's FMU; None for the passive car."""
        if self.system == "passive":
            return None
        return CONTROLLERS[self.weights] if self.own_weights is None else weights_name(self.own_weights)

    def __post_init__(self) -> None:
        choices: dict[str, Collection[str]] = {
            "input": INPUTS,
            "weights": CONTROLLERS,
            "system": SYSTEMS,
            "shape": SHAPES,
        }
        for name, known in choices.items():
            if not (name == "weights" and self.own_weights):
                check_choice(name, getattr(self, name), known)
        if not (math.isfinite(self.preview_time) and 0 <= self.preview_time <= 10):
            raise CaseError(f"preview time {self.preview_time:g} s: give 0 to 10 s")
        if not 0 <= self.speed_kmh <= 200:
            raise CaseError(f"speed {self.speed_kmh:g} km/h: give 0 to 200 km/h")


class PreviewLqBench:
    """Systems wired once per controller, and run as often as needed."""

    def __init__(self, fmus: FmuSet) -> None:
        self.fmus = fmus
        self._systems: dict[tuple[str | None, str], System] = {}

    def system(self, controller: str | None, exchange_step: str = EXCHANGE_STEP) -> System:
        """Car, road, speed and the FMU of a controller, all exchanging every millisecond; without controller when None."""
        key = (controller, exchange_step)
        if key not in self._systems:
            self._systems[key] = wire(self.fmus, controller, exchange_step)
        return self._systems[key]

    def record(
        self,
        case: Case,
        *,
        road: dict[str, Any] | None = None,
        duration: float = DURATION,
        csv: Path | None = None,
        solver_step: float | None = None,
        exchange_step: str = EXCHANGE_STEP,
    ) -> Recording:
        """Run one case and return its recording at 1 kHz; ``road`` sets further parameters of the road FMU.

        ``solver_step`` [s] and ``exchange_step`` are those of the car; controllers and road keep their sample times.
        """
        system = self.system(case.controller, exchange_step)
        system["speed"].set({"start.speed": case.speed_kmh / 3.6, "start.x": 0.0})
        defaults = {n: system["road"].description.parameters[n].start for n in ROAD_SIZES}
        system["road"].set({**defaults, "side": INPUTS[case.input], "shape": SHAPES[case.shape], **(road or {})})
        own_step = system["car"].description.parameters["solver.step"].start
        system["car"].set({"solver.step": own_step if solver_step is None else solver_step})
        if case.system != "passive":
            system["controller"].set(
                {"mode": MODES[case.system], "preview_time": case.preview_time, "hold_tail": case.hold_tail}
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UnconnectedInputsWarning)  # nothing drives the passive car's actuators
            return system.run(duration, record=_recorded(case), record_interval="1 ms", csv=csv)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


ROAD_SIZES = ("hole.depth", "bump.height", "hole.length", "bump.length", "gap")


def wire(fmus: FmuSet, controller: str | None, exchange_step: str = EXCHANGE_STEP) -> System:
    """One system of the experiment; ``exchange_step`` is the car's."""
    system = System()
    system.add("speed", fmus.path("SpeedProfile"))
    system.add("road", fmus.path("RoadHoleBump"))
    system.add("car", fmus.path("RideCarSedan"), step=exchange_step)
    system.connect("speed.x", "road.x")
    system.connect("speed.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    if controller is not None:
        system.add("controller", fmus.path(controller))
        system.connect_matching("car", "controller")
        system.connect_matching("road", "controller")
        system.connect("speed.speed", "controller.speed")
        system.connect_matching("controller", "car", "force.*")
    return system


def _recorded(case: Case) -> list[str]:
    names = [f"car.{n}" for n in WEIGHTED]
    names += [f"car.wheel.{k}.z" for k in CORNERS] + ["car.body.z"]
    names += [f"road.road.{k}.height" for k in CORNERS]
    if case.system != "passive":
        names += [f"controller.force.{k}" for k in CORNERS] + ["controller.horizon_truncated"]
    return names


def forces(recording: Recording) -> np.ndarray:
    """Commanded forces (samples, 4) [N] by corner fl, fr, rl, rr; zero for the passive car."""
    if f"controller.force.{CORNERS[0]}" not in recording:
        return np.zeros((len(recording), len(CORNERS)))
    return np.column_stack([recording[f"controller.force.{k}"] for k in CORNERS])


def components(recording: Recording) -> dict[str, float]:
    """Mean squares of the weighted outputs over the run, trapezoidal, by output name (the E(.) of Table 3)."""
    return {n: _mean_square(recording[f"car.{n}"]) for n in WEIGHTED}


def index(recording: Recording, weights: PreviewLqWeights) -> float:
    """The index (10) without its factor 1/2: weighted mean squares of outputs and forces."""
    outputs = sum(w * m for w, m in zip(weights.outputs(CORNERS), components(recording).values(), strict=True))
    controls = sum(w * _mean_square(u) for w, u in zip(weights.controls(CORNERS), forces(recording).T, strict=True))
    return float(outputs + controls)


def weights_of(case: Case) -> PreviewLqWeights:
    """The weights behind a case's controller."""
    return load_weights(case.own_weights or WEIGHTS[case.weights])


def check_weights(fmus: FmuSet, case: Case) -> None:
    """Refuse a law of a user's weights that was designed with others than its file has now.

    Raises:
        FileNotFoundError: the FMU is not there; the message says how to build it.
        CaseError: it has other weights.
    """
    if case.own_weights is None or case.controller is None:
        return
    path = fmus.path(case.controller)
    with zipfile.ZipFile(path) as z:
        designed = json.loads(z.read("resources/provenance.json"))["weights"]
    if designed != weights_of(case).as_dict():
        command = fmus.build_command(fmus.own[case.controller][1])
        raise CaseError(
            f"{path} was designed with other weights than {case.own_weights} has now: run `{command}` again"
        )


def _mean_square(signal: np.ndarray) -> float:
    square = signal**2
    return float((square[:-1] + square[1:]).sum() / 2 / (len(square) - 1))
