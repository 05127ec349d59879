"""Tables 5.4 and 5.6 to 5.11 of paper 003, from ``trench_published.csv``.

The file has one row per length and speed. Cells are as printed, so their decimals tell how they were rounded; an empty
cell is one of those that this project does not have: they are nobody's input.
"""

from __future__ import annotations

import csv
from functools import cache
from importlib import resources

from cosim.metrics_crossing import Crossing

LENGTHS = (1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2.0)  # m, Tables 5.2 and 5.5
SPEEDS = (1.0, 3.0, 6.0, 9.0)  # km/h
COLUMNS = {
    "az": "az [m/s2]", "ax": "ax [m/s2]", "az_rms": "az rms [m/s2]", "ax_rms": "ax rms [m/s2]", "pitch": "pitch [deg]",
    "hub_front": "front hub [kN]", "hub_middle": "middle hub [kN]", "hub_rear": "rear hub [kN]",
}  # fmt: skip


@cache
def rows() -> dict[tuple[float, float], dict[str, str]]:
    """Printed cells by (length [m], speed [km/h]) and column."""
    text = resources.files("cosim.experiments").joinpath("trench_published.csv").read_text(encoding="utf-8")
    return {(float(r["length [m]"]), float(r["speed [km/h]"])): r for r in csv.DictReader(text.splitlines())}


def passive(length: float, speed: float) -> Crossing:
    """The passive run as printed, root mean squares with the two decimals of Table 5.8."""
    row = rows()[length, speed]
    return Crossing(**{n: float(row[f"passive {c}"]) for n, c in COLUMNS.items()})


def passed(length: float, speed: float) -> bool:
    """Verdict of Table 5.4 on the passive vehicle."""
    return rows()[length, speed]["passive passed"] == "yes"


def number(length: float, speed: float, column: str) -> float | None:
    """A printed cell, None where it is not known."""
    cell = rows()[length, speed][column]
    return float(cell) if cell else None
