"""Poles of the continuous design (Table 2): from the car and the weights of the FMUs that run, but no run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import linalg

from cosim.experiments.preview_lq.runs import CAR, WEIGHTED_CONTROLLERS, designed_weights
from cosim.fmu.file import FmuFile
from cosim.study.runner import Runner
from fmu_sources.controllers.lq.design import continuous_lq, output_index
from fmu_sources.controllers.lq.preview import ride_plant
from fmu_sources.models.corners import CORNERS
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car

MISSING_ENTRY = ("body.roll_rate", "force.rl")  # of N; without it the design has the printed poles


@dataclass(frozen=True)
class Design:
    """Closed-loop eigenvalues with some weights; `without` (state, control) omits one entry of the cross weight N."""

    weights: str
    without: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Which one it is."""
        return f"design-{self.weights}" + "-one-entry-missing" * bool(self.without)

    def __call__(self, runner: Runner) -> dict[str, Any]:
        """Eigenvalues of the upper half plane by falling magnitude, as [real, imaginary] [1/s], and the sprung mass."""
        said = FmuFile(runner.fmus.path(CAR)).description.parameters
        car = ride_car(load_ride_car("sedan"), name=CAR)  # the equations; the numbers are the FMU's
        plant = ride_plant(car, np.array([float(said[e.name].start) for e in car.model().elements("parameter")]))  # type: ignore[arg-type]
        chosen = designed_weights(runner.fmus.path(WEIGHTED_CONTROLLERS[self.weights][0]))
        index = output_index(plant, chosen.outputs(CORNERS), chosen.controls(CORNERS))
        if not self.without:
            eigenvalues = continuous_lq(plant, index).eigenvalues
        # no longer an index (it is not nonnegative), so the design functions refuse it: the bare Riccati equation
        else:
            state, control = self.without
            N = index.N.copy()
            N[plant.states.index(state), plant.controls.index(control)] = 0.0
            P = linalg.solve_continuous_are(plant.A, plant.B, index.Q1, index.R, s=N)
            eigenvalues = linalg.eigvals(plant.A - plant.B @ linalg.solve(index.R, plant.B.T @ P + N.T))
        upper = eigenvalues[eigenvalues.imag > 0]
        mass = said["body.mass"]
        return {
            "eigenvalues": [[e.real, e.imag] for e in upper[np.argsort(-np.abs(upper))].tolist()],
            "sprung mass": f"{mass.start:g} kg (source: {mass.source})",
        }


DESIGNS = {
    "comfort": Design("comfort"),
    "road-holding": Design("road-holding"),
    "comfort, one entry missing": Design("comfort", MISSING_ENTRY),
}
