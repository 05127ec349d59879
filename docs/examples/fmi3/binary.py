"""Two FMUs that exchange bytes: each puts its letter before what it was given, in reverse order.

python docs/examples/fmi3/binary.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from small_fmu import build, number

from cosim import System

BYTES = {"variability": "discrete", "mimeType": "text/plain", "maxSize": "8"}
MIRROR = [
    number("letter", "UInt32", 0, "parameter", "0"),
    ("in", "Binary", 1, {"causality": "input", "start": "", **BYTES}),
    ("out", "Binary", 2, {"causality": "output", **BYTES}),
]


def main() -> None:
    """Print the bytes of both after each of five communication steps."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build("mirror", MIRROR, Path(folder))
        with System() as system:
            system.add("a", fmu, step=1, parameters={"letter": ord("a")})
            system.add("b", fmu, step=1, parameters={"letter": ord("b")})
            system.connect("a.out", "b.in")
            system.connect("b.out", "a.in")
            with system.initialize(record=[]) as simulation:
                for t in range(1, 6):
                    simulation.advance(t)
                    print(f"after {t} s:", simulation.text("a.out"), simulation.text("b.out"))


if __name__ == "__main__":
    main()
