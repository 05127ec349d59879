"""The states that the controllers of the quarter-car bench feed back (paper 002), and the bench's model in them.

Suspension deflection, body velocity, tire deflection, wheel velocity. The plant's own states are heights;
`bench_model` changes to those of the paper.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from build_fmus.component import Component, Linearization
from fmu_sources.models.relative import relative_model

STATES = ("suspension.deflection", "body.vz", "tire.deflection", "wheel.vz")


def bench_model(car: Component) -> Linearization:
    """The quarter car in the states of paper 002, equation (3).

    Inputs are `force` and `road.rate`, outputs the states.
    """
    car_in_states = relative_model(car, STATES, forces=["force"], heights=["road.height"], rates=["road.rate"])
    return car_in_states.linearization()


def reference_inputs() -> dict[str, Callable[[float], float]]:
    """States as in a bump, large enough to meet the limit."""

    def wave(amplitude: float, phase: float) -> Callable[[float], float]:
        return lambda t: amplitude * math.sin(12.0 * t + phase)

    return {s: wave(a, float(i)) for i, (s, a) in enumerate(zip(STATES, (0.02, 0.2, 0.02, 0.3), strict=True))}
