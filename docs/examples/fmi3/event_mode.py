"""An FMU that announces an event: at 130 s the bounds of its heater fall, within a step of 20 s.

python docs/examples/fmi3/event_mode.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from early_return import HEATER, switches
from small_fmu import build


def main() -> None:
    """Print when the heater switches by day, and with a night that begins at 130 s."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build("heater", HEATER, Path(folder))
        print("day:", *switches(fmu, "20 s"))
        for step in ("20 s", "5 s"):
            print(f"night from 130 s, steps of {step}:", *switches(fmu, step, night=130.0))


if __name__ == "__main__":
    main()
