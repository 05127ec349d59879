"""Tables 5.4 and 5.6 to 5.11 of paper 003, from `published.csv`, and the runs that stand beside them.

The file has one row per length and speed. Cells are as printed, so their decimals tell how they were rounded; an empty
cell is one of those that this project does not have: they are nobody's input.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import resources
from itertools import product
from typing import Any

import click

from cosim.experiments.metrics.crossing import Crossing
from cosim.experiments.trench.runs import Case
from cosim.study.experiment import Task

Key = tuple[float, float]  # length [m], speed [km/h]
LENGTHS = (1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2.0)  # m, Tables 5.2 and 5.5
SPEEDS = (1.0, 3.0, 6.0, 9.0)  # km/h
GRID: tuple[Key, ...] = tuple(product(LENGTHS, SPEEDS))
COLUMNS = {
    "az": "az [m/s2]",
    "ax": "ax [m/s2]",
    "az_rms": "az rms [m/s2]",
    "ax_rms": "ax rms [m/s2]",
    "pitch": "pitch [deg]",
    "hub_front": "front hub [kN]",
    "hub_middle": "middle hub [kN]",
    "hub_rear": "rear hub [kN]",
}


@cache
def rows() -> dict[Key, dict[str, str]]:
    """Printed cells by (length [m], speed [km/h]) and column."""
    text = resources.files("cosim.experiments.trench").joinpath("published.csv").read_text(encoding="utf-8")
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


SYSTEMS = ("passive", "mpc")
BOLD: tuple[Key, ...] = ((1.4, 9.0), (1.5, 1.0), (1.5, 3.0), (1.7, 6.0), (1.9, 1.0), (2.0, 9.0))  # shown in section 5.5
SPECTRUM: Key = (1.8, 6.0)  # figure 5.39
BETWEEN: tuple[Key, ...] = tuple((a, v) for v in (2.0, 4.5, 7.5) for a in (1.25, 1.45, 1.65, 1.85, 1.95))
SOME: tuple[Key, ...] = tuple((a, v) for v in SPEEDS for a in (1.2, 1.6, 2.0))  # for what is not published
OTHER_VEHICLES: Mapping[str, Mapping[str, Any]] = {
    "CG 2 cm ahead": {"cg_offset": 0.02},
    "CG 2 cm behind": {"cg_offset": -0.02},
    "CG 5 cm ahead": {"cg_offset": 0.05},
    "CG 5 cm behind": {"cg_offset": -0.05},
    "friction 0.6": {"friction": 0.6},
    "friction 0.4": {"friction": 0.4},
    "body 10 % heavier": {"mass_factor": 1.1},
    "body 20 % heavier": {"mass_factor": 1.2},
    "hydropneumatic struts": {"hydropneumatic": True},
}
"""What the plant has otherwise than the controller knows: words -> fields of a case."""
WITHOUT = {
    "mpc-no-preview": "road ahead unknown, all states measured",
    "mpc-offsets": "MPC without preview as its tool has it by default (Table 4.1)",
    "mpc-free": "no forced retraction",
    "mpc-printed-sign": "forced ranges with the printed sign (Table 4.8)",
    "mpc-no-height": "body height not weighed (Table 4.10)",
    "mpc-printed-limits": "limits as printed (Tables 4.5, 4.6)",
    "lqr": "LQR (Table 4.1)",
}
"""Control with one thing left out or as printed: controller -> words."""


def matrix(controller: str) -> list[Case]:
    """The published crossings of the passive vehicle or of `mpc`."""
    return [Case(*k, controller) for k in GRID]


def refined(case: Case) -> Case:
    """The same at half the step."""
    return replace(case, solver_parts=2, exchange_parts=2)


def between() -> list[Case]:
    """Controlled crossings at lengths and speeds between those of the paper."""
    return [Case(*k) for k in BETWEEN]


def some(controller: str = "mpc", **changes: Any) -> list[Case]:
    """The crossings by which a change is judged."""
    return [Case(*k, controller, **changes) for k in SOME]


@click.option(
    "--published-only/--no-published-only",
    default=False,
    help="the 36 passive and 36 controlled crossings only, nothing left out or changed",
)
def plan(published_only: bool = False) -> list[Task]:
    """Every run of the study."""
    shown = {Case(*k, s) for k in (*BOLD, SPECTRUM) for s in SYSTEMS}
    cases = [c for s in SYSTEMS for c in matrix(s)]
    cases += [refined(c) for c in cases]
    if not published_only:
        cases += between()
        cases += [c for changes in OTHER_VEHICLES.values() for c in some(**changes)]
        cases += [c for controller in WITHOUT for c in some(controller)]
    return [Task(c, signals=c in shown, cost=_cost(c)) for c in cases]


def _cost(case: Case) -> float:
    """Rough time of a run in those of one at 1 km/h under control."""
    return case.exchange_parts / case.speed_kmh * (0.3 if case.controller == "passive" else 1.0)
