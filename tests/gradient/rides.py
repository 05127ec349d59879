"""Systems of experiments and the metrics that gradients are taken of; the equations of the test bench."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
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


def bench_step(values: Mapping[str, Any]) -> tuple[Any, Any]:
    """Matrix of a solver step of the bench's equations (paper 002, (1) and (2)), and what a constant force adds to it.

    The step is one of 0.5 ms of the Runge-Kutta method; states are body.z, body.vz, wheel.z, wheel.vz.
    """
    mb, mw, k, c = (values[n] for n in ("body.mass", "wheel.mass", "suspension.stiffness", "suspension.damping"))
    kt, ct = values["tire.stiffness"], values["tire.damping"]
    a = np.array(  # states: body.z, body.vz, wheel.z, wheel.vz
        [
            [0.0, 1.0, 0.0, 0.0],
            [-k / mb, -c / mb, k / mb, c / mb],
            [0.0, 0.0, 0.0, 1.0],
            [k / mw, c / mw, -(k + kt) / mw, -(c + ct) / mw],
        ]
    )
    h, one = 0.0005 * a, np.eye(4)
    by_state = one + h / 2 + h @ h / 6 + h @ h @ h / 24
    return one + h @ by_state, 0.0005 * by_state @ np.array([0.0, 1.0 / mb, 0.0, -1.0 / mw])
