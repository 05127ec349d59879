"""A study in which one case in a hundred is hostile.

All others have their results, and these are failures with a name.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from foreign import hostile

from cosim import Execution, System, WiringError
from cosim.study import Case, Experiment, FmuSet, Measures, Run, RunOptions, Wiring, option, run_study

DEEDS = ("segfault", "hang", "abort", "devour", "quit", "round", "status", "kill", "overflow", "fork")
LIMITS = Execution(isolate=("*",), step_timeout=10.0, memory_limit=100_000_000)


@dataclass(frozen=True)
class Number(Case):
    """One FMU of many."""

    number: int = option(0, help="which", always=True)
    fmu: str = option("", help="its file", always=True)


def wire(fmus: FmuSet, case: Any) -> System:
    system = System()
    system.add("plant", fmus.path(case.fmu))
    return system


def file_of(case: Any) -> str:
    return str(case.fmu)


def measure(run: Run) -> dict[str, float]:
    return {"steps": float(run.recording["plant.y"][-1])}


EXPERIMENT = Experiment(
    "hostile", Number, Wiring(wire, file_of), Measures(measure), RunOptions(0.02, record=["plant.y"])
)


def study(folder: Path, store: Path, cases: int) -> None:
    fmus = {d: str(hostile.build(3, folder, "step", d)) for d in ("nothing", *DEEDS)}
    bad = {i for i in range(cases) if i % 100 == 50}
    tasks = [Number(i, fmus[DEEDS[i // 100 % len(DEEDS)] if i in bad else "nothing"]) for i in range(cases)]
    results = run_study(EXPERIMENT, FmuSet(), store, tasks=tasks, processes=2, execution=LIMITS)
    failures = list(results.failures.values())
    assert len(failures) == len(bad) == cases // 100
    assert all("component 'plant'" in f and "DoStep" in f for f in failures), failures
    assert sorted(case.number for case in results.ran) == [i for i in range(cases) if i not in bad]
    assert {results[case]["steps"] for case in results.ran} == {20.0}


def test_a_hostile_case_costs_its_own_row(folder, tmp_path):
    study(folder, tmp_path / "runs", 100)


@pytest.mark.full
def test_ten_of_a_thousand_cases(folder, tmp_path):
    study(folder, tmp_path / "runs", 1000)


def test_names_of_what_not_every_case_has_are_passed_over(harmless):
    with System() as system:
        system.add("plant", harmless)
        execution = Execution(isolate=("plant", "controller*"))
        execution.prepare(system, every=False)
        component: Any = system["plant"].implementation
        assert component.isolation is not None
        with pytest.raises(WiringError, match="no component 'controller"):
            execution.prepare(system)
