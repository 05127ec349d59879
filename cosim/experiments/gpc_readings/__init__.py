"""Paper 000 under other readings: which of its claims turn under which of the assumptions that it leaves open.

Every reading is the main study (`gpc`) with open fields of its case set otherwise: what the controllers measure of the
road, what explicit assumes of the road ahead, how the models are identified, whether both tracks have one profile.
First one at a time, then all combinations of the four that matter. A reading is chosen nowhere: the printed control
law stays the main study.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import click
import numpy as np

from cosim.experiments import gpc
from cosim.experiments.gpc.published import SEEDS, SPEEDS_KMH, cases, on, searches, tasks
from cosim.experiments.gpc.runs import ROADS, Reading, control_law, read_as
from cosim.study.experiment import Experiment, Search, Task
from fmu_sources.models.corners import CORNERS

PRINTED = "as printed"
FACTORS: dict[str, Reading] = {
    "identified from rest": (("from_rest", True),),
    "one track": (("one_track", True),),
    "road rate": (("disturbance", "rate"),),
    "last height held": (("hold", True),),
}
"""The four assumptions that matter; all their combinations are tried. The first two are literal corrections."""
COMBINATIONS: dict[str, Reading] = {
    ", ".join(chosen): sum((FACTORS[name] for name in chosen), ())
    for count in range(2, len(FACTORS) + 1)
    for chosen in combinations(FACTORS, count)
}
"""Two or more of the four at once, in words."""
LITERAL, *_ = COMBINATIONS
READINGS: dict[str, Reading] = {
    PRINTED: (),
    **dict(list(FACTORS.items())[:2]),
    LITERAL: COMBINATIONS.pop(LITERAL),
    "road rate at 1 kHz": (("disturbance", "rate-1kHz"),),
    "limit 15 kN": (("limit", 1.5e4),),
    **dict(list(FACTORS.items())[2:]),
    "road slope": (("disturbance", "slope"),),
    "excitation 1 kN": (("excitation", 1e3),),
    "excitation 5 kN": (("excitation", 5e3),),
    "excitation up to 20 Hz": (("roll_off", 20.0),),
    "responses before the command": (("sampled_after", 0),),
    "heights not trimmed, 0.1 m": (("datum", 0.1),),
    "dropped from 20 mm": (("start_height", 0.02),),
    "actuator at the spring": (("actuator", "spring"),),
    "smoother course": (("road_roll_off", 0.1),),
    "horizon 16 (not the paper's)": (("horizon", 16),),
}
"""One assumption at a time, in words; first both literal corrections, alone and together, then two open questions."""
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
        found = {}
        for controller in ("explicit", "preview"):
            case = read_as(self.reading, "sine", SPEEDS_KMH[0], controller, seed=self.seed)
            law = control_law(runner.fmus, case)
            gain = law.gain_d_hold if law.hold else law.gain_d
            if controller == "preview":
                gain = np.hstack([gain, law.gain_preview])
            force = gain @ np.ones(gain.shape[1])
            found[controller] = float(np.sqrt(np.sum(force**2) / len(CORNERS)))
        return found


def readings(full: bool) -> dict[str, Reading]:
    """The readings of a study, in words."""
    return {**READINGS, **COMBINATIONS} if full else READINGS


def seeds(full: bool, reading: Reading) -> tuple[int, ...]:
    """Seeds of the identifications of a reading; only the four that matter, alone and combined, get all."""
    return (*SEEDS, *HELD_OUT) if full and set(reading) <= {pair for (pair,) in FACTORS.values()} else SHORT_SEEDS


def comparisons(full: bool) -> int:
    """Number of comparisons of the controllers in a study, each of about ten runs."""
    each = sum(len(on(road, SPEEDS_KMH)) for road in ROADS)
    return each * sum(len(seeds(full, reading)) for reading in readings(full).values())


@click.option(
    "--full/--no-full",
    default=False,
    help=f"all combinations too, with {len(SEEDS)} identification seeds, and as many to confirm what is found:"
    f" {comparisons(True)} comparisons of about ten runs instead of {comparisons(False)}",
)
def plan(full: bool = False) -> list[Task | Search]:
    """One assumption at a time with two seeds; or everything."""
    found: list[Task | Search] = []
    alone = []
    for reading in readings(full).values():
        found += searches(seeds(full, reading), SPEEDS_KMH, reading)
        alone += cases(seeds(full, reading), SPEEDS_KMH, reading)
        found += [StaticGain(reading, seed) for seed in seeds(full, reading)]
    return [*found, *tasks(alone)]


EXPERIMENT: Experiment = replace(
    gpc.EXPERIMENT,
    name="gpc-readings",
    title="Full car under generalized predictive control: other readings (paper 000)",
    study=replace(gpc.EXPERIMENT.study, plan=plan, claims=None, report="cosim.experiments.gpc_readings.report:report"),
    module=__name__,
)
