"""Systems of experiments and the metrics that gradients are taken of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from built import FMUS

from cosim import System
from cosim.gradient import Final, Mean, Metric, Peak, QuadraticCost, Rms
from cosim.study import FmuSet, Runner

RIDES: Mapping[str, Metric] = {
    "mean": Mean("car.body.z"),
    "rms": Rms("car.body.az"),
    "peak": Peak("car.body.az"),
    "J": QuadraticCost({"car.body.az": 1.0, "car.body.pitch": 10.0}),
    "end": Final("car.body.z"),
}


def system_of(experiment: Any, case: Any) -> System:
    system: System = Runner(experiment, FmuSet(FMUS)).system(case)
    return system
