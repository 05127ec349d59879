"""Runs of paper 002: road, bench and controller, wired and measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from operator import attrgetter

import numpy as np

from cosim import Recording, System
from cosim.core.signals import rms
from cosim.experiments.options import Controlled, milliseconds, quantity, tunable_option
from cosim.experiments.steps import exchange_step, set_solver_step
from cosim.study import FmuSet, Metric, Row, Run, option
from fmu_sources.controllers.mpc.bench import FORCE_LIMIT

CONTROLLERS = {  # name -> FMU, parameters
    "passive": (None, {}),
    "lqr": ("LqrBench", {}),
    "lqr-clipped": ("LqrBench", {"limit": FORCE_LIMIT}),
    "mpc": ("MpcBench", {}),
    "mpc-moves": ("MpcBenchMoves", {}),
}
TUNABLE = "MpcBenchTunable"  # the MPC whose weights are parameters
ROADS = {"bump": "RoadBenchBump", "random": "RoadBenchRandom"}
ENCODERS = "BenchEncoders"
FLAGS = {
    "controller.command.held": "command.held: the solver found no solution at some samples; the last force was kept"
}
FMUS = tuple(
    dict.fromkeys(["QuarterCarBench", *(f for f, _ in CONTROLLERS.values() if f), TUNABLE, ENCODERS, *ROADS.values()])
)
BUMP_DURATION, BUMP_HEIGHT_MM, BUMP_START = 0.5, 20.0, 0.1  # s, mm, s
EXCHANGE = Fraction(1, 1000)  # s, of the plant
LENGTH = {"bump": 3.0, "random": 10.0}  # s, of a run

_BUMP = (lambda c: c.road == "bump", "the bump")
_RANDOM = (lambda c: c.road == "random", "the random road")
_CONTROLLED = (lambda c: c.controller != "passive", "a controlled bench")


@dataclass(frozen=True)
class Case(Controlled):
    """One run: controller, road, and whether the states come from encoders."""

    controller: str = option("mpc", choices=CONTROLLERS, help="control of the bench", always=True)
    road: str = option("bump", choices=ROADS, help="motion of the road", always=True)
    duration: float = quantity(
        "duration [s]", BUMP_DURATION, (0.01, LENGTH["bump"]), "duration of the bump", _BUMP, milliseconds, always=True
    )
    height_mm: float = quantity("height [mm]", BUMP_HEIGHT_MM, (-100, 100), "height of the bump", _BUMP)
    encoders: bool = option(False, only=_CONTROLLED, help="states from quantized encoders")
    tunable: bool = tunable_option((lambda c: c.controller == "mpc", "the controller mpc"))
    offset: float = quantity(
        "offset [s]", 0.0, (0.0, 1e5), "where in the random motion the run starts", _RANDOM, "from-{:g}s"
    )

    @property
    def controller_fmu(self) -> str | None:
        """Name of the controller's FMU; None for the passive bench."""
        return TUNABLE if self.tunable else CONTROLLERS[self.controller][0]


structure = attrgetter("road", "controller_fmu", "encoders", "exchange_parts")
"""What of a case decides the wiring."""


def wire(fmus: FmuSet, case: Case) -> System:
    """Road, bench and controller, with or without encoders in between."""
    system = System(allow_unconnected=True)  # nothing drives the passive bench
    system.add("road", fmus.path(ROADS[case.road]))
    system.add("plant", fmus.path("QuarterCarBench"), step=exchange_step(EXCHANGE, case))
    system.connect_matching("road", "plant")
    if case.controller_fmu is None:
        return system
    system.add("controller", fmus.path(case.controller_fmu))
    if case.encoders:
        system.add("encoders", fmus.path(ENCODERS))
        system.connect("plant.suspension.deflection", "encoders.encoder.suspension")
        system.connect("plant.body.z", "encoders.encoder.body")
        system.connect("road.road.height", "encoders.encoder.road")
        system.connect_matching("encoders", "controller")
    else:
        system.connect_matching("plant", "controller")
    system.connect_matching("controller", "plant", "force")
    return system


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case."""
    set_solver_step(system["plant"], case)
    if case.road == "random":
        system["road"].set({"offset": case.offset})
    else:
        system["road"].set(
            {"bump.start": BUMP_START, "bump.duration": case.duration, "bump.height": case.height_mm / 1e3}
        )
    controller, parameters = CONTROLLERS[case.controller]
    if controller == "LqrBench":
        default = {"limit": system["controller"].description.parameters["limit"].start}
        system["controller"].set({**default, **parameters})


def stop_time(_: System, case: Case) -> float:
    """Length of a run [s]."""
    return LENGTH[case.road]


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    names = ["road.road.height", "plant.*"] + ["controller.*"] * (case.controller_fmu is not None)
    return names + ["encoders.*"] * case.encoders


METRICS = {
    "acceleration": Metric("rms acceleration of the body", "m/s2"),
    "overshoot": Metric("body beyond the road's extremes", "mm", 1e3),
    "travel": Metric("rms suspension deflection", "mm", 1e3),
    "tire": Metric("rms tire deflection", "mm", 1e3),
    "force": Metric("rms force", "N"),
    "force.max": Metric("largest force", "N"),
    "force.min": Metric("smallest force", "N"),
}
"""What is compared between the controllers."""


def force(recording: Recording) -> np.ndarray:
    """Commanded force [N]; 0 on the passive bench."""
    return recording["controller.force"] if "controller.force" in recording else np.zeros(len(recording))


def measure(run: Run) -> Row:
    """`METRICS` in SI units, and the worst outcome of the solver."""
    r = run.recording
    road, body, f = r["road.road.height"], r["plant.body.z"], force(r)

    found = {
        "acceleration": rms(r["plant.body.az"]),
        "overshoot": float(max(body.max() - road.max(), road.min() - body.min(), 0.0)),
        "travel": rms(r["plant.suspension.deflection"]),
        "tire": rms(r["plant.tire.deflection"]),
        "force": rms(f),
        "force.max": float(f.max()),
        "force.min": float(f.min()),
    }
    if "controller.solver.status" in r:
        found |= {
            f"solver.{n}": float(np.max(r[f"controller.solver.{n}"])) for n in ("status", "iterations", "residual")
        }
    return found


def signals(run: Run) -> Row:
    """Signals over time that the figures show, every millisecond [s, m, N]."""
    r = run.recording
    shown = {
        "time": r.time,
        "road": r["road.road.height"],
        "wheel": r["plant.wheel.z"],
        "body": r["plant.body.z"],
        "force": force(r),
    }
    return {name: signal.tolist() for name, signal in shown.items()}
