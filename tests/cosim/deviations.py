"""How far a run deviates after a small pulse, and how far its linear model says."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import control
import numpy as np

from cosim import Record, System


def deviation(system: System, model: Any, pulse: float, periods: int) -> tuple[np.ndarray, np.ndarray]:
    """Deviation of the model's outputs after a pulse of one period at all of its inputs.

    Shape (periods + 1, outputs), at each of `periods` + 1 samples: of the second run from the first, and of the model
    from rest.
    """
    names = [model.names[n] for n in model.output_labels]
    runs = []
    for height in (pulse, 0.0):
        simulation = system.initialize(record=Record(names, Fraction(model.dt).limit_denominator(10**6)))
        for name in model.input_labels:
            simulation.set(model.names[name], height)
        simulation.advance(model.dt)
        for name in model.input_labels:
            simulation.set(model.names[name], 0.0)
        simulation.advance((periods + 1) * model.dt)
        runs.append(simulation.recording.data[: periods + 1])
    inputs = np.zeros((model.ninputs, periods + 1))
    inputs[:, 0] = pulse
    said = control.forced_response(model, np.arange(periods + 1) * model.dt, inputs, squeeze=False).outputs.T
    return runs[0] - runs[1], said
