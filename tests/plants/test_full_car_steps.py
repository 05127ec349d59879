"""How the full car depends on how time is divided into steps.

Solver am2 restarts at every doStep (docs/explanation/architecture.md).
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from build_fmus.component import Model
from build_fmus.reference import Evaluator
from fmu_sources.plants import full_car
from fmu_sources.vehicles import load_full_car

CARS = {"FullCarHmmwv": "hmmwv", "FullCarHmmwvModified": "hmmwv_modified"}
ROW = 0.01  # s; inputs are held as long
CUTS = (0.5, 1.0, 2.0, 5.0, 10.0)  # ms
RIDE = re.compile(r"body\.(z|vz|az|pitch|roll)|wheel\..*\.(z|vz|az)|tire\..*\.force|suspension\..*")
ARCHITECTURE = Path(__file__).parents[2] / "docs" / "explanation" / "architecture.md"


@lru_cache
def car(name: str) -> Model:
    return full_car(load_full_car(CARS[name]), name=name).model()


@lru_cache
def run(name: str, cut: float, solver_step: float = 5e-4) -> np.ndarray:
    """Outputs every `ROW` of 1 s over the reference run's patch; `cut` is the length of a doStep [ms]."""
    component = car(name)
    one, outputs = Evaluator(component, {"solver.step": solver_step}), []
    slots = {e.name: e.slot for e in component.elements("input")}
    for k in range(100):
        for n, signal in component.reference_inputs.items():
            one.u[slots[n]] = signal(k * ROW)
        for _ in range(round(ROW / (cut * 1e-3))):
            one.step(cut * 1e-3)
        outputs.append(one.outputs())
    return np.array(outputs)


def differences(name: str, cut: float, solver_step: float = 5e-4) -> dict[str, float]:
    """Largest difference of each output from doSteps of 1 ms, in units of its range."""
    usual = run(name, 1.0)
    outputs = [e.name for e in car(name).output_elements()]
    apart = np.abs(run(name, cut, solver_step) - usual).max(axis=0)
    return dict(zip(outputs, apart / np.maximum(np.ptp(usual, axis=0), 1e-9), strict=True))


def documented() -> dict[str, list[float]]:
    """The table's rows, without their first column."""
    text = ARCHITECTURE.read_text()
    head = re.search(r"^\| 1 s in doSteps of \|(.+)\|$", text, re.MULTILINE)
    assert head, "docs/explanation/architecture.md has no table of 1 s in doSteps"
    assert [float(c.split()[0]) for c in head[1].split("|")] == [c for c in CUTS if c != 1.0]
    rows = {}
    for key in ("motion", "any output"):
        row = re.search(rf"^\| {key}[^|]*\|(.+)\|$", text, re.MULTILINE)
        assert row, key
        rows[key] = [float(c) for c in row[1].split("|")]
    return rows


def worst(cut: float, solver_step: float = 5e-4) -> dict[str, float]:
    """The largest difference of both cars by row of the table."""
    apart = [d for name in CARS for d in differences(name, cut, solver_step).items()]
    return {"motion": max(v for n, v in apart if RIDE.fullmatch(n)), "any output": max(v for _, v in apart)}


@pytest.mark.parametrize("column", range(4))
def test_the_documented_differences(column: int) -> None:
    found = worst([c for c in CUTS if c != 1.0][column])
    for key, values in documented().items():
        assert found[key] == pytest.approx(values[column], rel=0.1), key


def test_the_documented_error_of_the_solver_step() -> None:
    """The effect of halving solver.step at doSteps of 1 ms, for comparison."""
    text = " ".join(ARCHITECTURE.read_text().split())
    said = re.search(
        r"Halving `solver\.step` at 1 ms changes motion by (\S+) and any output by (\S+) of its range", text
    )
    assert said, "docs/explanation/architecture.md does not say what halving solver.step changes"
    found = worst(1.0, 2.5e-4)
    assert found["motion"] == pytest.approx(float(said[1]), rel=0.1)
    assert found["any output"] == pytest.approx(float(said[2]), rel=0.1)


def test_the_note_of_the_car_names_the_largest_of_them() -> None:
    """The page inside the FMU says the same."""
    note = " ".join(n for n in car("FullCarHmmwv").notes if "restarts at every doStep" in n)
    assert [float(x) for x in re.findall(r"\d\.\de-\d", note)] == [max(row) for row in documented().values()]
