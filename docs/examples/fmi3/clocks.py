"""The clock of one FMU ticks every 0.4 s and triggers that of another one, which takes its value at that time.

python docs/examples/fmi3/clocks.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from small_fmu import build, number

from cosim import System

TRIGGERED = {"intervalVariability": "triggered", "variability": "discrete"}
SAMPLER = [
    number("period", "Float64", 0, "parameter", "0"),
    number("value", "Float64", 1, "input", "0", clocks="5"),
    number("sent", "Float64", 2, "output", clocks="6"),
    number("taken", "Float64", 3, "output"),
    number("taken_at", "Float64", 4, "output"),
    ("trigger", "Clock", 5, {"causality": "input", **TRIGGERED}),
    ("tick", "Clock", 6, {"causality": "output", **TRIGGERED}),
]


def main() -> None:
    """Print what the second FMU has taken, and when, at the end of each communication step of 1 s."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build("sampler", SAMPLER, Path(folder))
        with System(allow_unconnected=True) as system:
            system.add("source", fmu, step=1, parameters={"period": 0.4})
            system.add("sink", fmu, step=1)
            system.connect("source.sent", "sink.value")
            system.connect("source.tick", "sink.trigger")
            found = system.run(3, record=["sink.taken", "sink.taken_at"])
    for t, value, at in zip(found.time, found["sink.taken"], found["sink.taken_at"], strict=True):
        if t:
            print(f"at {t:g} s: tick {value:g}, taken at {at:.1f} s")


if __name__ == "__main__":
    main()
