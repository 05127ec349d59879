"""Paper 000: a nonlinear HMMWV on three roads, passive and under three GPC laws.

This module wires the FMUs and runs them; ``gpc_study`` lays out the published figures and claims on top of it.
"""

from __future__ import annotations

import math
import shlex
import warnings
from collections.abc import Callable, Collection, Iterator
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from cosim import ComponentError, Recording, StopWhen, System, UnconnectedInputsWarning, metrics
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from cosim.experiments.store import RunStore
from fmu_sources.controllers.gpc import CORNERS, gain_parameters
from fmu_sources.controllers.gpc_identification import (
    DesignSettings,
    IdentificationSettings,
    IdentifiedModels,
    identify,
)

ROADS = {"sine": "RoadSine", "curb": "RoadCurb", "perryman3": "RoadPerryman3"}
CONTROLLERS = {"passive": None, "implicit": "GpcImplicit", "explicit": "GpcExplicit", "preview": "GpcPreview"}
SPEEDS_KMH = (10, 20, 30, 40, 50, 60, 70, 80)
SPEED_RANGE_KMH = (2.0, 200.0)
R_PUBLISHED = 1e-7  # 1/N2
TRAVEL = 150.0  # m, length of every run
SAMPLE_RATE = 100.0  # Hz, of all metrics
EXCHANGE = Fraction(1, 1000)  # s, between car, road and controller
SOLVER_STEP = "solver.step"  # parameter of the car


Refinement = Literal["as run", "solver step halved", "exchange halved", "both halved"]


@dataclass(frozen=True)
class Scenario:
    """One run. ``road`` may be the path of a road FMU; ``R`` and ``seed`` matter for controlled runs only.

    ``refinement`` halves the car's solver step, its exchange with the others, or both; the law stays what it is.
    """

    road: str = "sine"
    speed_kmh: float = 50.0
    controller: str = "preview"
    R: float = R_PUBLISHED
    seed: int = 0
    hold: bool = False
    refinement: Refinement = "as run"

    @property
    def label(self) -> str:
        """What tells this run's files from those of others."""
        parts = [Path(self.road).stem, f"{self.speed_kmh:g}kmh", self.controller]
        if self.controller != "passive":
            parts += [f"R{self.R:g}"] * (self.R != R_PUBLISHED) + [f"seed{self.seed}"] * (self.seed != 0)
        parts += ["hold"] * self.hold + [self.refinement.replace(" ", "-")] * (self.refinement != "as run")
        return "-".join(parts)

    def __post_init__(self) -> None:
        choices_of: dict[str, Collection[str]] = {
            "road": ROADS,
            "controller": CONTROLLERS,
            "refinement": get_args(Refinement),
        }
        for name, choices in choices_of.items():
            value = getattr(self, name)
            if not (name == "road" and value.endswith(".fmu")):
                check_choice(name, value, choices)
        low, high = SPEED_RANGE_KMH
        if not low <= self.speed_kmh <= high:
            raise CaseError(
                f"speed {self.speed_kmh:g} km/h: a run travels {TRAVEL:g} m at a speed between {low:g} and {high:g} km/h"
            )
        if not (math.isfinite(self.R) and self.R > 0):
            raise CaseError(f"control weight R = {self.R:g} must be positive")
        if self.hold and self.controller != "explicit":
            raise CaseError("hold applies to the explicit controller only")


@dataclass(frozen=True)
class GpcFmuSet(FmuSet):
    """The FMUs of a vehicle file."""

    plant: str = "FullCarHmmwvModified"
    suffix: str = ""
    vehicle: str | Path = "hmmwv_modified"  # the vehicle file the FMUs were built from

    def build_command(self, options: str = "") -> str:
        """The command that makes the files, with the vehicle file they come from."""
        own = f"--vehicle {shlex.quote(str(self.vehicle))}" if isinstance(self.vehicle, Path) else ""
        return super().build_command(options or own)

    @property
    def car(self) -> Path:
        return self.path(self.plant)

    @property
    def speed(self) -> Path:
        return self.path("SpeedProfile")

    def road(self, road: str) -> Path:
        """Road FMU by its short name, or by its path (``.fmu``)."""
        if road.endswith(".fmu"):
            return Path(road)
        return self.path(ROADS[road] + self.suffix)

    def controller(self, controller: str) -> Path | None:
        """Controller FMU, None for the passive car."""
        name = CONTROLLERS[controller]
        return None if name is None else self.path(name + self.suffix)

    def all_paths(self) -> list[Path]:
        """Every file a study reads."""
        controllers = [p for c in CONTROLLERS if (p := self.controller(c))]
        return [self.car, self.speed, *map(self.road, ROADS), *controllers]


class GpcBench:
    """Systems wired once per road and controller, and run as often as needed."""

    def __init__(self, fmus: GpcFmuSet, store: RunStore | None = None) -> None:
        self.fmus = fmus
        self.store = store
        self._systems: dict[tuple[str, str, bool], System] = {}
        self.models = lru_cache(maxsize=None)(self._models)

    def _models(self, seed: int) -> IdentifiedModels:
        settings = IdentificationSettings(seed=seed)
        return identify(self.fmus.car, self.fmus.road("perryman3"), self.fmus.speed, settings)

    def system(self, road: str, controller: str, *, exchange_halved: bool = False) -> System:
        """Car, road, speed profile and controller, wired as in the paper: car and exchange at 1 kHz, control at 100 Hz."""
        key = (road, controller, exchange_halved)
        if key not in self._systems:
            self._systems[key] = wire(self.fmus, road, controller, EXCHANGE / 2 if exchange_halved else EXCHANGE)
        return self._systems[key]

    def record(self, scenario: Scenario, *, progress: bool = False, csv: Path | None = None) -> Recording:
        """Run one scenario and return its recording at 100 Hz.

        Raises:
            ComponentError: a component failed (a diverging loop, for one); ``error.recording`` holds what was recorded.
        """
        halved = scenario.refinement
        exchange_halved = halved in ("exchange halved", "both halved")
        system = self.system(scenario.road, scenario.controller, exchange_halved=exchange_halved)
        declared = float(system["car"].description.variables[SOLVER_STEP].start)
        solver_halved = halved in ("solver step halved", "both halved")
        system["car"].set({SOLVER_STEP: declared / 2 if solver_halved else declared})
        speed = scenario.speed_kmh / 3.6
        system["speed"].set({"start.speed": speed})
        if scenario.controller != "passive":
            law = self.models(scenario.seed).law(scenario.controller, DesignSettings(R=scenario.R))
            system["controller"].set(gain_parameters(law))
            if scenario.controller == "explicit":
                system["controller"].set({"hold_height": scenario.hold})
        start = float(system["car"].description.variables["start.x"].start)
        # The driver keeps y = 0, and nothing drives the actuators of the passive car.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UnconnectedInputsWarning)
            return system.run(
                1.25 * TRAVEL / speed + 1.0,
                record=["car.x", "car.speed", *(f"car.{n}" for n in RECORDED), *_controls(scenario)],
                record_interval="10 ms",
                stop_when=[StopWhen("car.x", ">=", start + TRAVEL)],
                progress=progress,
                csv=csv,
            )

    def measure(self, scenario: Scenario) -> dict[str, Any]:
        """Metrics of a scenario as JSON values; a diverged run has ``diverged`` true and no numbers. Stored if possible."""

        def compute() -> dict[str, Any]:
            try:
                return evaluate(self.record(scenario))
            except ComponentError as error:
                return {"diverged": True, "reason": str(error)}

        if self.store is None:
            return compute()
        return self.store.get(asdict(scenario), compute)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


RECORDED = (
    "body.z", "body.az", "body.pitch", "body.roll",
    *(f"{s}.{k}.{q}" for k in CORNERS for s, q in (("actuator", "power"), ("tire", "force"))),
)  # fmt: skip


def _controls(scenario: Scenario) -> list[str]:
    return [] if scenario.controller == "passive" else [f"controller.force.{k}" for k in CORNERS]


def wire(fmus: GpcFmuSet, road: str, controller: str, exchange: Fraction = EXCHANGE) -> System:
    """One system of the experiment; ``exchange`` [s] is the car's step."""
    system = System()
    system.add("speed", fmus.speed)
    system.add("road", fmus.road(road))
    system.add("car", fmus.car, step=exchange)
    system.connect("speed.speed", "car.target.speed")
    system.connect("car.x", "road.x")
    system.connect("car.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    if path := fmus.controller(controller):
        system.add("controller", path)
        system.connect_matching("car", "controller", "body.*")
        if controller != "implicit":
            system.connect_matching("road", "controller")
        system.connect_matching("controller", "car", "force.*")
    return system


def forces(recording: Recording) -> np.ndarray:
    """Commanded actuator forces (samples, 4) [N]; zero for the passive car."""
    names = [f"controller.force.{k}" for k in CORNERS]
    if names[0] not in recording:
        return np.zeros((len(recording), len(CORNERS)))
    return np.column_stack([recording[n] for n in names])


def evaluate(recording: Recording) -> dict[str, Any]:
    """The published metrics of one run (equations 22a-c) and the peaks the claims need."""
    az, pitch, roll = (recording[f"car.{n}"] for n in ("body.az", "body.pitch", "body.roll"))
    u = forces(recording)
    power = np.column_stack([recording[f"car.actuator.{k}.power"] for k in CORNERS])
    return {
        "diverged": recording.stopped_by is None,
        "response": metrics.response_objective(az, pitch, roll, SAMPLE_RATE),
        "force": metrics.actuator_force(u, SAMPLE_RATE),
        "power": metrics.actuator_power(power, SAMPLE_RATE),
        "peak_force": metrics.peak(u),
        "peak_az": metrics.peak(az),
        "peak_pitch": metrics.peak(pitch),
        "peak_roll": metrics.peak(roll),
        "rms_az": float(np.sqrt(np.mean(az**2))),
        "rms_pitch": float(np.sqrt(np.mean(pitch**2))),
        "rms_roll": float(np.sqrt(np.mean(roll**2))),
        "duration": float(recording.time[-1]),
    }


# ---------------------------------------------------------------------- matching the response of another law


@dataclass(frozen=True)
class Match:
    """Outcome of :func:`match_weight`: the weight and its metrics, or ``found`` false and the nearest one tried."""

    found: bool
    R: float
    metrics: dict[str, Any]
    runs: int


GRID_STEP = 0.25  # decades of R
GRID_RANGE = (-8, 8)  # steps about the published R: 1e-9 .. 1e-5
MATCH_TOLERANCE = 5e-3  # relative, on the response objective


def match_weight(measure: Callable[[float], dict[str, Any]], target: float) -> Match:
    """The control weight at which a law's response objective equals ``target``.

    J(R) is not monotone, so a grid of weights is walked outward from the published one until two neighbours bracket
    the target; the crossing nearest to 1e-7 is then refined in log R. Of two at the same distance the one is taken that
    lies where a J that rises with R has it.
    """
    tried: dict[float, dict[str, Any]] = {}

    def error(R: float) -> float:
        if R not in tried:
            tried[R] = measure(R)
        m = tried[R]
        return math.inf if m["diverged"] else m["response"] / target - 1.0

    for a, b in _outward(up_first=error(R_PUBLISHED) <= 0 or math.isinf(error(R_PUBLISHED))):
        low, high = R_PUBLISHED * 10 ** (GRID_STEP * a), R_PUBLISHED * 10 ** (GRID_STEP * b)
        e_low, e_high = error(low), error(high)
        for R, e in ((low, e_low), (high, e_high)):
            if abs(e) <= MATCH_TOLERANCE:
                return Match(True, R, tried[R], len(tried))
        if not (math.isfinite(e_low) and math.isfinite(e_high)) or e_low * e_high > 0:
            continue
        for _ in range(12):
            # Regula falsi in log R, kept inside the bracket; J is smooth there.
            w = min(max(e_low / (e_low - e_high), 0.1), 0.9)
            R = low ** (1 - w) * high**w
            e = error(R)
            if abs(e) <= MATCH_TOLERANCE:
                return Match(True, R, tried[R], len(tried))
            if e * e_low > 0:
                low, e_low = R, e
            else:
                high, e_high = R, e
        break
    nearest = min(tried, key=lambda R: abs(error(R)))
    return Match(False, nearest, tried[nearest], len(tried))


def _outward(*, up_first: bool) -> Iterator[tuple[int, int]]:
    """Intervals of the grid, those nearest to the published weight first."""
    down, up = GRID_RANGE
    for k in range(max(up, -down)):
        sides = [(k, k + 1)] * (k < up), [(-k, -k - 1)] * (-k > down)
        for side in sides if up_first else reversed(sides):
            yield from side


def matched(bench: GpcBench, scenario: Scenario, target: float) -> Match:
    """Match ``scenario``'s law to the response objective ``target``."""
    return match_weight(lambda R: bench.measure(replace(scenario, R=R)), target)
