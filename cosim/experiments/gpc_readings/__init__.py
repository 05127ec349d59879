"""Paper 000 under other readings: which of its claims turn under which of the assumptions that it leaves open.

Every reading is the main study (`gpc`) with open fields of its case set otherwise: what the controllers measure of the
road, what explicit assumes of the road ahead, how the models are identified, whether both tracks have one profile.
First one at a time, then all combinations of the four that matter. A reading is chosen nowhere: the printed control
law stays the main study.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import click
import numpy as np

from cosim.experiments import gpc
from cosim.experiments.gpc.published import SEEDS, SPEEDS_KMH, cases, searches, tasks
from cosim.experiments.gpc.runs import PLANT, SPEED, Reading, identification, models, read_as, road_file
from cosim.study.experiment import Experiment, Search, Task
from fmu_sources.controllers.gpc.identification import DesignSettings
from fmu_sources.models.corners import CORNERS

PRINTED = "as printed"
FACTORS: Reading = (("disturbance", "rate"), ("hold", True), ("from_rest", True), ("one_track", True))
"""The four assumptions that matter; all their combinations are tried."""
READINGS: dict[str, Reading] = {
    PRINTED: (),
    "road rate": FACTORS[:1],
    "road slope": (("disturbance", "slope"),),
    "last height held": FACTORS[1:2],
    "identified from rest": FACTORS[2:3],
    "excitation 1 kN": (("excitation", 1e3),),
    "excitation 5 kN": (("excitation", 5e3),),
    "excitation up to 20 Hz": (("roll_off", 20.0),),
    "one track": FACTORS[3:],
    "horizon 16 (not the paper's)": (("horizon", 16),),
}
"""One assumption at a time, in words."""
COMBINATIONS: dict[str, Reading] = {
    ", ".join(next(n for n, r in READINGS.items() if r == (factor,)) for factor in chosen): chosen
    for which in product((False, True), repeat=len(FACTORS))
    if sum(which) > 1
    for chosen in [tuple(f for f, used in zip(FACTORS, which, strict=True) if used)]
}
"""Two or more of the four at once, in words."""
SHORT_SEEDS, HELD_OUT = SEEDS[:2], tuple(range(len(SEEDS), 2 * len(SEEDS)))


@dataclass(frozen=True)
class StaticGain:
    """How much force a control law gives in the end for a road that is higher under all wheels [N/m].

    The root mean square over the actuators, by controller: for explicit the sum over its past heights, for preview
    also over those ahead, which a controller that knows the road ahead needs to cancel it.
    """

    reading: Reading
    seed: int
    cost: float = 1.0

    @property
    def label(self) -> str:
        """For people."""
        return f"static-gain-{'-'.join(f'{n}-{v}' for n, v in self.reading) or 'printed'}-seed{self.seed}"

    def __call__(self, runner: Any) -> dict[str, float]:
        """Identify and add up the gains."""
        found, fmus = {}, runner.fmus
        for controller in ("explicit", "preview"):
            case = read_as(self.reading, "sine", SPEEDS_KMH[0], controller, seed=self.seed)
            files = fmus.path(PLANT), road_file(fmus, "perryman3"), fmus.path(SPEED)
            design = DesignSettings(R=case.R, h_p=case.horizon, h_c=case.horizon)
            law = models(*files, identification(case)).law(controller, design)
            gain = law.gain_d_hold if case.hold else law.gain_d
            if controller == "preview":
                gain = np.hstack([gain, law.gain_preview])
            force = gain @ np.ones(gain.shape[1])
            found[controller] = float(np.sqrt(np.sum(force**2) / len(CORNERS)))
        return found


@click.option(
    "--full/--no-full",
    default=False,
    help=f"all combinations too, {len(SEEDS)} identification seeds, and as many to confirm what is found",
)
def plan(full: bool = False) -> list[Task | Search]:
    """One assumption at a time with two seeds; or everything."""
    seeds = (*SEEDS, *HELD_OUT) if full else SHORT_SEEDS
    found: list[Task | Search] = []
    alone = []
    for reading in readings(full).values():
        found += searches(seeds, SPEEDS_KMH, reading)
        alone += cases(seeds, SPEEDS_KMH, reading)
        found += [StaticGain(reading, seed) for seed in seeds]
    return [*found, *tasks(alone)]


def readings(full: bool) -> dict[str, Reading]:
    """The readings of a study, in words."""
    return {**READINGS, **COMBINATIONS} if full else READINGS


EXPERIMENT: Experiment = replace(
    gpc.EXPERIMENT,
    name="gpc-readings",
    title="Full car under generalized predictive control: other readings (paper 000)",
    study=replace(gpc.EXPERIMENT.study, plan=plan, claims=None, report="cosim.experiments.gpc_readings.report:report"),
    module=__name__,
)
