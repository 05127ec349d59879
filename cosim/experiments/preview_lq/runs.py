"""Runs of paper 004: car, road and controller, wired and measured."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from cosim import Recording, System
from cosim.core.signals import columns, rms
from cosim.experiments.options import Controlled, milliseconds, quantity, speed_option
from cosim.experiments.steps import exchange_step, set_solver_step
from cosim.study import CaseError, FmuSet, Metric, Row, Run, option
from cosim.study.fmus import designed_with
from fmu_sources.controllers.lq.preview import MODES, WEIGHTED, weight_parameters
from fmu_sources.controllers.lq.preview_weights import PreviewLqWeights, load_weights
from fmu_sources.models.corners import CORNERS
from fmu_sources.own_catalog import weights_name

CAR, ROAD, SPEED = "RideCarSedan", "RoadHoleBump", "SpeedProfile"
WEIGHTED_CONTROLLERS = {  # name of the weights -> FMU of the controller, file of the weights
    "comfort": ("PreviewLqComfort", "comfort"),
    "road-holding": ("PreviewLqRoadHolding", "road_holding"),
    "comfort-5ms": ("PreviewLqComfort5ms", "comfort"),
}
TUNABLE = "PreviewLqTunable"  # the controller whose weights are parameters
FMUS = (CAR, ROAD, SPEED, *(fmu for fmu, _ in WEIGHTED_CONTROLLERS.values()), TUNABLE)
CONTROLLERS = ("passive", *MODES)
INPUTS = {"both": 0, "left": 1}  # parameter `side` of the road
PLATEAU_MM = 50.0
SHAPES: dict[str, dict[str, float]] = {  # parameters of the road
    "haversine": {"shape": 0},
    "sine": {"shape": 1},
    "triangle": {"shape": 2},
    "step": {"shape": 3},
    "plateau": {"shape": 3, "hole.depth": 0.0, "bump.height": PLATEAU_MM / 1e3, "bump.length": 1e4},
}
SPEED_KMH = 75.0
PREVIEW_TIME = 0.12  # s
EXCHANGE = Fraction(1, 1000)  # s, of the car
INTERVAL = "1 ms"  # between samples
FLAGS = {
    "controller.horizon_truncated": "horizon_truncated: preview or memory end before the horizon that was requested"
}
DURATION, PLATEAU_DURATION = 1.2, 3.0  # s, of a run: of the means in Table 3, and of driving onto a plateau

_PREVIEW = (lambda c: c.controller == "preview", "the controller with preview")
_CONTROLLED = (lambda c: c.controller != "passive", "a controlled car")


@dataclass(frozen=True)
class Case(Controlled):
    """One run: road, weights of the controller, and what it uses of the road."""

    input: str = option("both", choices=INPUTS, help="wheels that meet hole and bump", always=True)
    weights: str = option(
        "comfort",
        choices=WEIGHTED_CONTROLLERS,
        files=".toml",
        help="weights of the controller: published ones, or a weights file (see build-fmus --weights)",
        always=True,
    )
    controller: str = option(
        "preview",
        choices=CONTROLLERS,
        aliases=("system",),
        help="road information that the controller uses",
        always=True,
    )
    preview_time: float = quantity(
        "preview time [s]", PREVIEW_TIME, (0, 10), "preview ahead of the front wheels", _PREVIEW, milliseconds
    )
    speed_kmh: float = speed_option(SPEED_KMH, (0, 200), "speed of the car", always=False)
    shape: str = option("haversine", choices=SHAPES, help="shape of hole and bump, or a plateau behind a step")
    hold_tail: bool = option(False, only=_CONTROLLED, help="take the road to continue at its last height", label="hold")
    tunable: bool = option(
        False,
        only=_CONTROLLED,
        help=(
            "use the controller whose weights are parameters: designed at initialization, and free to vary in sweeps"
            " (controller.weight...)"
        ),
    )

    @property
    def own_weights(self) -> Path | None:
        """The file of a user's weights; None for published ones."""
        return Path(self.weights) if self.weights.endswith(".toml") else None

    @property
    def controller_fmu(self) -> str | None:
        """Name of the controller's FMU; None for the passive car."""
        if self.controller == "passive":
            return None
        if self.tunable:
            return TUNABLE
        return WEIGHTED_CONTROLLERS[self.weights][0] if self.own_weights is None else weights_name(self.own_weights)


def weights_of(case: Case) -> PreviewLqWeights:
    """The weights of a case's index, which are those that its controller was designed with."""
    return load_weights(case.own_weights or WEIGHTED_CONTROLLERS[case.weights][1])


def designed_weights(controller: Path) -> PreviewLqWeights:
    """The weights that an FMU's controller was designed with."""
    return PreviewLqWeights.model_validate(designed_with(controller)["weights"])


def structure(case: Case) -> tuple[object, ...]:
    """What decides the wiring."""
    return case.controller_fmu, case.weights if case.controller_fmu and not case.tunable else "", case.exchange_parts


def wire(fmus: FmuSet, case: Case) -> System:
    """Speed, road, car and controller.

    Raises:
        FileNotFoundError: an FMU is not there; the message says how to build it.
        CaseError: the controller was designed with other weights than their file has now.
    """
    controller = None
    if case.controller_fmu is not None:
        controller = fmus.path(case.controller_fmu)
        if not case.tunable and designed_weights(controller) != weights_of(case):
            build = fmus.build_command(fmus.own.get(case.controller_fmu, ("", ""))[1])
            raise CaseError(
                f"{controller} was designed with other weights than {case.weights} has now: run `{build}` again"
            )
    system = System(allow_unconnected=True)  # nothing drives the passive car's actuators
    system.add("speed", fmus.path(SPEED))
    system.add("road", fmus.path(ROAD))
    system.add("car", fmus.path(CAR), step=exchange_step(EXCHANGE, case))
    system.connect_matching("speed", "road")
    system.connect_matching("road", "car", "road.*")
    if controller is not None:
        system.add("controller", controller)
        system.connect_matching("car", "controller")
        system.connect_matching("road", "controller")
        system.connect("speed.speed", "controller.speed")
        system.connect_matching("controller", "car", "force.*")
    return system


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case."""
    set_solver_step(system["car"], case)
    system["speed"].set({"start.speed": case.speed_kmh / 3.6, "start.x": 0.0})
    known = system["road"].description.parameters
    as_built: dict[str, Any] = {n: known[n].start for sizes in SHAPES.values() for n in sizes}
    system["road"].set({**as_built, **SHAPES[case.shape], "side": INPUTS[case.input]})
    configure_controller(system, case)


def configure_controller(system: System, case: Case) -> None:
    """What of a case concerns its controller, on any road."""
    if case.controller != "passive":
        system["controller"].set(
            {"mode": MODES[case.controller], "preview_time": case.preview_time, "hold_tail": case.hold_tail}
        )
        if case.tunable:
            system["controller"].set(weight_parameters(weights_of(case)))


def stop_time(_: System, case: Case) -> float:
    """Length of a run [s]."""
    return PLATEAU_DURATION if case.shape == "plateau" else DURATION


def recorded(case: Case) -> list[str]:
    """What is recorded."""
    names = [f"car.{n}" for n in WEIGHTED]
    names += [f"car.wheel.{k}.z" for k in CORNERS] + ["car.body.z"]
    names += [f"road.road.{k}.height" for k in CORNERS]
    if case.controller != "passive":
        names += [f"controller.force.{k}" for k in CORNERS] + ["controller.horizon_truncated"]
    return names


METRICS = {
    **{n: Metric(f"mean square of {n}", "m2" if n.endswith("deflection") else "rad2/s4") for n in WEIGHTED},
    "body.az": Metric("mean square of body.az", "m2/s4"),
    "J": Metric("index J"),
    **{f"force.{k}": Metric(f"rms force, {k}", "N") for k in CORNERS},
    **{f"force.{k}.rate": Metric(f"rms rate of the force, {k}", "N/s") for k in CORNERS},
}
"""The E(.) of Table 3, and what figures 6 and 7 are read for."""


def forces(recording: Recording) -> np.ndarray:
    """Commanded forces (samples, 4) [N] by corner fl, fr, rl, rr; zero for the passive car."""
    return columns(recording, "controller.force.{}", CORNERS, optional=True)


def mean_square(signal: np.ndarray) -> float:
    """Mean square over the run, trapezoidal."""
    square = signal**2
    return float((square[:-1] + square[1:]).sum() / 2 / (len(square) - 1))


def measure(run: Run) -> Row:
    """`METRICS` in SI units."""
    r = run.recording
    f, rates = forces(r), np.diff(forces(r), axis=0) / np.diff(r.time)[:, None]
    weights = weights_of(run.case)
    parts = {n: mean_square(r[f"car.{n}"]) for n in WEIGHTED}
    # The index (10) without its factor 1/2: weighted mean squares of outputs and forces.
    outputs = sum(w * m for w, m in zip(weights.outputs(CORNERS), parts.values(), strict=True))
    controls = sum(w * mean_square(u) for w, u in zip(weights.controls(CORNERS), f.T, strict=True))
    return {
        **parts,
        "J": float(outputs + controls),
        **{f"force.{k}": rms(u) for k, u in zip(CORNERS, f.T, strict=True)},
        **{f"force.{k}.rate": rms(u) for k, u in zip(CORNERS, rates.T, strict=True)},
    }


def signals(run: Run) -> Row:
    """Signals over time that the figures show, every millisecond [s, m, N], by the names they were recorded under."""
    r = run.recording
    shown = [n for n in r if n.endswith((".z", ".height")) or n.startswith("controller.force.")]
    return {"time": r.time.tolist(), **{n: r[n].tolist() for n in shown}}
