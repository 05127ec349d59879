"""Why one block of claims excludes the other: the static gains of the control laws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.experiments.gpc.published import SPEEDS_KMH
from cosim.experiments.gpc.runs import Assumed, Case, assume, control_law
from fmu_sources.models.corners import CORNERS


@dataclass(frozen=True)
class StaticGain:
    """How much force a control law gives in the end for a road that is higher under all wheels [N/m].

    The root mean square over the actuators, by controller: for explicit the sum over its past heights, for preview
    also over those ahead, which a controller that knows the road ahead needs to cancel it.
    """

    seed: int
    assumed: Assumed = ()
    cost: float = 1.0

    @property
    def label(self) -> str:
        """For people."""
        return f"static-gain-{'-'.join(f'{n}-{v}' for n, v in self.assumed) or 'printed'}-seed{self.seed}"

    def __call__(self, runner: Any) -> dict[str, float]:
        """Identify and add up the gains."""
        found = {}
        for controller in ("explicit", "preview"):
            case = assume(self.assumed, Case("sine", SPEEDS_KMH[0], controller, seed=self.seed))
            law = control_law(runner.fmus, case)
            gain = law.gain_d_hold if law.hold else law.gain_d
            if controller == "preview":
                gain = np.hstack([gain, law.gain_preview])
            force = gain @ np.ones(gain.shape[1])
            found[controller] = float(np.sqrt(np.sum(force**2) / len(CORNERS)))
        return found
