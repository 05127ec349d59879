"""Paper 000 under other readings: which of its claims turn under which of the assumptions that it leaves open.

Every reading is the main study (`gpc`) with open fields of its case set otherwise: what the controllers measure of the
road, what explicit assumes of the road ahead, how the models are identified, whether both tracks have one profile.
First one at a time, then all combinations of the four that matter. A reading is chosen nowhere: the printed control
law stays the main study.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import click

from cosim.experiments import gpc
from cosim.experiments.gpc.published import SEEDS, SPEEDS_KMH, cases, searches, tasks
from cosim.experiments.gpc.runs import Assumed, Case, assume
from cosim.experiments.gpc_readings.static_gain import StaticGain
from cosim.study.experiment import Experiment, Search, Task
from cosim.study.readings import Reading, read_as

PRINTED = "as printed"
FACTORS: dict[str, Assumed] = {
    "identified from rest": (("from_rest", True),),
    "one track": (("one_track", True),),
    "road rate": (("disturbance", "rate"),),
    "last height held": (("hold", True),),
}
"""The four assumptions that matter; all their combinations are tried. The first two are literal corrections."""
COMBINATIONS: dict[str, Assumed] = {
    ", ".join(chosen): sum((FACTORS[name] for name in chosen), ())
    for count in range(2, len(FACTORS) + 1)
    for chosen in combinations(FACTORS, count)
}
"""Two or more of the four at once, in words."""
LITERAL, *_ = COMBINATIONS
READINGS: dict[str, Assumed] = {
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


def readings(full: bool) -> dict[str, Assumed]:
    """The readings of a study, in words."""
    return {**READINGS, **COMBINATIONS} if full else READINGS


def reading(assumed: Assumed) -> Reading:
    """What these assumptions make of a case, or of a search, of the main study."""
    return (lambda t: assume(assumed, t) if isinstance(t, Case) else replace(t, assumed=assumed),)


def seeds(full: bool, assumed: Assumed) -> tuple[int, ...]:
    """Seeds of the identifications of a reading; only the four that matter, alone and combined, get all."""
    return (*SEEDS, *HELD_OUT) if full and set(assumed) <= {pair for (pair,) in FACTORS.values()} else SHORT_SEEDS


def needs(seeds: Sequence[int]) -> list[Any]:
    """The cases and searches of the main study on which its claims rest."""
    return [*searches(seeds, SPEEDS_KMH), *cases(seeds, SPEEDS_KMH)]


def comparisons(full: bool) -> int:
    """Number of comparisons of the controllers in a study, each of about ten runs."""
    return sum(len(searches(seeds(full, assumed), SPEEDS_KMH)) for assumed in readings(full).values())


@click.option(
    "--full/--no-full",
    default=False,
    help=f"all combinations too, with {len(SEEDS)} identification seeds, and as many to confirm what is found:"
    f" {comparisons(True)} comparisons of about ten runs instead of {comparisons(False)}",
)
def plan(full: bool = False) -> list[Task | Search]:
    """One assumption at a time with two seeds; or everything."""
    found: list[Any] = []
    for assumed in readings(full).values():
        chosen = seeds(full, assumed)
        found += [read_as(reading(assumed), t) for t in [*needs(chosen), *map(StaticGain, chosen)]]
    runs = [t for t in found if isinstance(t, Case)]
    return [*(t for t in found if not isinstance(t, Case)), *tasks(runs)]


EXPERIMENT: Experiment = replace(
    gpc.EXPERIMENT,
    name="gpc-readings",
    title="Full car under generalized predictive control: other readings (paper 000)",
    study=replace(gpc.EXPERIMENT.study, plan=plan, claims=None, report="cosim.experiments.gpc_readings.report:report"),
    module=__name__,
)
