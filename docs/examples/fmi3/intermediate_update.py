"""An FMU that asks for its input inside its steps: an extrapolated input follows the line through its last two values.

python docs/examples/fmi3/intermediate_update.py
"""

from __future__ import annotations

import tempfile
from math import atan, sin, sqrt
from pathlib import Path

import numpy as np
from small_fmu import build, number

from cosim import PythonComponent, System

TRACKER = [
    number("u", "Float64", 0, "input", "0", variability="continuous", intermediateUpdate="true"),
    number("x", "Float64", 1, "output", variability="continuous"),
    number("asked", "Int32", 2, "output"),
]
FREQUENCY, TIME_CONSTANT = 5.0, 0.1  # rad/s, s


class Wave(PythonComponent):
    """sin(5 t)."""

    outputs = ("y",)

    def step(self, t, h, u, y):  # noqa: ARG002
        """The value at the end of the step."""
        y[0] = sin(FREQUENCY * (t + h))


def error(fmu: Path, step: str, *, extrapolate: bool) -> float:
    """Largest difference from the exact answer to the wave, after the transient."""
    with System() as system:
        system.add("wave", Wave(), step=step)
        system.add("tracker", fmu, step=step)
        system.connect("wave.y", "tracker.u", extrapolate=extrapolate)
        found = system.run(5, record=["tracker.x"])
    delay = FREQUENCY * TIME_CONSTANT
    exact = np.sin(FREQUENCY * found.time - atan(delay)) / sqrt(1.0 + delay**2)
    return float(np.abs(found["tracker.x"] - exact)[found.time > 2].max())


def main() -> None:
    """Print the error with an input that is held, and with one that follows."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build("tracker", TRACKER, Path(folder), hasEventMode="false", providesIntermediateUpdate="true")
        for step in ("40 ms", "20 ms", "10 ms"):
            held, follows = (error(fmu, step, extrapolate=e) for e in (False, True))
            print(f"steps of {step}: held {held:.4f}, follows {follows:.4f}")


if __name__ == "__main__":
    main()
