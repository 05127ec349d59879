"""An FMU whose arrays have the size of a structural parameter, which is set when the component is added.

python docs/examples/fmi3/structural_parameters.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from small_fmu import build, number

from cosim import System

SUMS = [
    number("n", "UInt64", 0, "structuralParameter", "3", min="1", max="16"),
    number("u", "Float64", 1, "input", "0", dimension="0"),
    number("sum", "Float64", 2, "output", dimension="0"),
]


def main() -> None:
    """Print sums of 1, 2, ... 5 with five elements, and of the sums of these."""
    with tempfile.TemporaryDirectory() as folder:
        fmu = build("running_sums", SUMS, Path(folder))
        with System() as system:
            system.add("first", fmu, step=1, parameters={"n": 5}, start={"u": [1, 2, 3, 4, 5]})
            system.add("second", fmu, step=1, parameters={"n": 5})
            system.connect("first.sum", "second.u")
            found = system.run(2, record=["first.sum", "second.sum"])
    for name in ("first", "second"):
        print(name, *(f"{found[f'{name}.sum[{i}]'][-1]:g}" for i in range(1, 6)))


if __name__ == "__main__":
    main()
