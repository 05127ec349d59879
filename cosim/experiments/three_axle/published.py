"""The runs of Table 5.1 and Figures 5.4 to 5.14 of paper 003, and what stands beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

from cosim.experiments.steps import halved
from cosim.experiments.three_axle.runs import CONTROLLERS, Case
from cosim.study.experiment import Task

SPEEDS_KMH, DEPTHS = (5.0, 10.0, 20.0), (0.15, 0.25)  # km/h, m: Table 5.1
Place = tuple[float, float]  # speed [km/h], depth [m]
PLACES: tuple[Place, ...] = tuple(product(SPEEDS_KMH, DEPTHS))
SHOWN: Place = (5.0, 0.15)  # of Figures 5.11 to 5.14
CONTROLLED = tuple(c for c in CONTROLLERS if c != "passive")
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "with preview, height of the body held": {"controller": "mpc-preview", "hold_height": True},
    "without preview, height of the body held": {"controller": "mpc", "hold_height": True},
    "with preview, all states measured": {"controller": "mpc-preview", "estimator": "measured"},
    "without preview, estimator with road heights": {"controller": "mpc", "estimator": "road"},
}
"""What else is run at each place: words -> fields of a case."""


def variant(place: Place, words: str) -> Case:
    """The run of one of `VARIANTS` at a place."""
    return Case(*place, **VARIANTS[words])


def places(study: Mapping[Case, Any]) -> list[Place]:
    """The places that a study went to."""
    return [p for p in PLACES if Case(*p) in study]


def plan(places: Sequence[Place] = PLACES, variants: Sequence[str] = tuple(VARIANTS)) -> list[Task]:
    """Every run of the study; finer steps at the last place, which is the hardest."""
    cases = [variant(p, v) for v in variants for p in places]
    cases += [finer for c in CONTROLLERS for finer in halved(Case(*places[-1], c)).values()]
    return [Task(Case(*p, c), signals=True) for p in places for c in CONTROLLERS] + [Task(c) for c in cases]
