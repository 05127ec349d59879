"""An FMU that returns early from a step where a heater switches: times are exact with long steps too.

python docs/examples/fmi3/early_return.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from small_fmu import build, number

from cosim import System

HEATER = [
    number("temperature", "Float64", 0, "output"),
    number("low", "Float64", 1, "parameter", "19"),
    number("high", "Float64", 2, "parameter", "21"),
    number("night", "Float64", 3, "parameter", "1e300"),
    number("switched_at", "Float64", 4, "output"),
    number("on", "Int32", 5, "output"),
    number("switched", "Int32", 6, "output"),
]


def switches(fmu: Path, step: str, **parameters: float) -> list[float]:
    """Times at which the heater switches in 10 minutes [s]."""
    with System() as system:
        system.add("heater", fmu, step=step, parameters=parameters)
        times = system.run(600, record=["heater.switched_at"])["heater.switched_at"]
    return sorted({round(float(t), 3) for t in times if t > 0})


def main() -> None:
    """Print when the heater switches, with steps of 5 s and 20 s."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build("heater", HEATER, Path(folder), mightReturnEarlyFromDoStep="true")
        for step in ("5 s", "20 s"):
            print(f"steps of {step}: switches at", *switches(fmu, step), "s")


if __name__ == "__main__":
    main()
