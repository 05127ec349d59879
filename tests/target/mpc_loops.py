"""Closed loops of the studies in which any component may stand for the MPC."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from cosim import Record, System
from cosim.experiments.bench import runs as bench
from cosim.experiments.hmmwv import runs as hmmwv
from cosim.experiments.three_axle import runs as three_axle
from cosim.study.fmus import FmuSet


@dataclass(frozen=True)
class WithController(FmuSet):
    """FMUs of a folder, of which one is replaced by another component."""

    controller: Any = None
    replaced: str = ""

    def path(self, name: str) -> Any:
        return self.controller if name == self.replaced and self.controller is not None else super().path(name)


_ROUGH = hmmwv.Case(
    controller="mpc-preview", road="off-road", terrain="E", actuators="ideal", states="true", speed_kmh=15.0
)
LOOPS: dict[str, tuple[ModuleType, Any]] = {
    "MpcBench": (bench, bench.Case(controller="mpc", road="random")),
    "MpcBenchMoves": (bench, bench.Case(controller="mpc-moves", road="random")),
    "MpcHmmwv": (hmmwv, _ROUGH),
    "MpcThreeAxle": (three_axle, three_axle.Case(controller="mpc-preview", speed_kmh=5.0)),
}


def mpc_loop(name: str, fmus: Path, samples: int, controller: Any = None, **case: Any) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and outputs of the MPC (samples x variables) in the closed loop of its study, with changes of the case.

    `controller`: the component in place of the FMU.
    """
    runs, study_case = LOOPS[name]
    study_case = replace(study_case, **case)
    system: System = runs.wire(WithController(fmus, controller=controller, replaced=name), study_case)
    runs.configure(system, study_case)
    about = system["controller"].description
    inputs = [f"controller.{n}" for n in about.inputs]
    outputs = [f"controller.{n}" for n in about.outputs]
    period = about.default_step
    recording = system.run((samples - 1) * period, record=Record([*inputs, *outputs], interval=about.default_step))
    return tuple(np.array([recording[n] for n in names]).T for names in (inputs, outputs))  # type: ignore[return-value]
