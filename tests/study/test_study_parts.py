"""Parts of an experiment: runs with cases and wirings of their own in one study."""

from __future__ import annotations

from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from cosim import ComponentError, PythonComponent, System
from cosim.study import (
    Case,
    CaseError,
    Experiment,
    FmuSet,
    Measures,
    Results,
    Row,
    Run,
    RunFailed,
    Runner,
    RunOptions,
    Study,
    Task,
    Wiring,
    default_report,
    option,
    run_study,
)

RAN: list[str] = []  # labels of the runs that were made, in order


class Slope(PythonComponent):
    """A slope that stays; none goes down."""

    outputs = ("y [m/s]",)
    kind = "discrete"
    default_step = "0.1 s"

    def __init__(self, slope: float) -> None:
        super().__init__()
        self.slope = slope

    def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = self.slope

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        if self.slope < 0:
            raise ValueError("no way down")


@dataclass(frozen=True)
class Ride(Case):
    slope: float = option(1.0, help="slope", unit="m/s")


@dataclass(frozen=True)
class Corner(Case):
    slope: float = option(1.0, help="slope", unit="m/s")


@dataclass(frozen=True)
class Sum:
    """A task of more than one run of the part."""

    part: str = "corner"

    @property
    def label(self) -> str:
        return "sum"

    def __call__(self, runner: Runner) -> float:
        return sum(runner.metrics(Corner(s))["half"] for s in (1.0, 2.0))


def wire(_: FmuSet, case: Any) -> System:
    system = System()
    system.add("road", Slope(case.slope))
    return system


def measure(run: Run) -> Row:
    RAN.append(f"ride {run.case.slope:g}")
    return {"end": run.recording["road.y"][-1]}


def measure_half(run: Run) -> Row:
    RAN.append(f"corner {run.case.slope:g}")
    return {"half": run.recording["road.y"][-1] / 2}


RECORD = RunOptions(1.0, record=["road.y"])
CORNER = Experiment(
    "corner", Corner, Wiring(wire), Measures(measure_half), RECORD, study=Study([Corner(1.0), Corner(2.0)])
)
RIDE = Experiment(
    "ride", Ride, Wiring(wire), Measures(measure), RECORD, study=Study([Ride(1.0), Ride(3.0)], parts=[CORNER])
)


def ride_of(part: Experiment | str) -> Experiment:
    """The whole with another part."""
    return replace(RIDE, study=replace(RIDE.study, parts=[part]))


@pytest.fixture
def executor():
    RAN.clear()
    with ThreadPoolExecutor(1) as pool:
        yield pool


def study(store: Path, executor: Executor, experiment: Experiment = RIDE, **options: Any) -> Results:
    return run_study(experiment, FmuSet(), store, executor=executor, **options)


def test_the_study_does_the_plans_of_its_parts_too(tmp_path: Path, executor: Executor) -> None:
    """Two cases alike in every field are kept apart by what they are cases of."""
    found = study(tmp_path, executor)
    assert {c: dict(found[c]) for c in found} == {
        Ride(1.0): {"end": 1.0},
        Ride(3.0): {"end": 3.0},
        Corner(1.0): {"half": 0.5},
        Corner(2.0): {"half": 1.0},
    }
    assert list(found.of("corner")) == [Corner(1.0), Corner(2.0)]
    assert list(found.of()) == [Ride(1.0), Ride(3.0)]


def test_a_plan_may_hold_cases_of_a_part(tmp_path: Path, executor: Executor) -> None:
    found = study(tmp_path, executor, tasks=[Ride(2.0), Corner(5.0), Task(Corner(5.0)), Sum()])
    assert [getattr(t, "part", "") for t in found.tasks] == ["", "corner", "corner"]
    assert found[Corner(5.0)] == {"half": 2.5}
    assert found.found(Sum()) == 1.5
    assert "corner 1" in RAN


def test_finished_runs_of_parts_are_kept(tmp_path: Path, executor: Executor) -> None:
    study(tmp_path, executor, tasks=[Ride(1.0), Corner(1.0)])
    assert RAN == ["ride 1", "corner 1"]
    study(tmp_path, executor)
    assert RAN == ["ride 1", "corner 1", "ride 3", "corner 2"]


def test_another_part_has_other_runs(tmp_path: Path, executor: Executor) -> None:
    """Same cases, same code, but for the name."""
    study(tmp_path, executor, tasks=[Corner(1.0)])
    study(tmp_path, executor, ride_of(replace(CORNER, name="edge")), tasks=[Corner(1.0)])
    assert RAN == ["corner 1", "corner 1"]


def test_a_failed_run_of_a_part_is_a_row_that_says_whose(tmp_path: Path, executor: Executor, raises) -> None:
    found = study(tmp_path, executor, tasks=[Corner(-1.0), Ride(-1.0), Ride(1.0)])
    assert [name.partition(":")[0] for name in found.failures] == ["corner", "slope--1"]
    assert all("no way down" in message for message in found.failures.values())
    with raises(RunFailed):
        found[Corner(-1.0)]
    assert found[Ride(1.0)] == {"end": 1.0}
    study(tmp_path, executor, tasks=[Corner(-1.0)])
    assert len(study(tmp_path, executor, tasks=[Corner(-1.0)], retry_failed=True).failures) == 1


def test_a_part_runs_by_itself(tmp_path: Path, executor: Executor, raises) -> None:
    assert study(tmp_path, executor, CORNER)[Corner(2.0)] == {"half": 1.0}
    with Runner(CORNER, FmuSet()) as runner, raises(ComponentError):
        runner.run(Corner(-1.0))


def test_the_report_by_default_has_the_parts_apart(tmp_path: Path, executor: Executor) -> None:
    report = default_report(RIDE, study(tmp_path, executor), FmuSet())
    tables = {t.id: t for t in report.tables}
    assert tables["runs"].rows == ((1.0, 1.0), (3.0, 3.0))
    assert tables["corner-runs"].columns == ("slope [m/s]", "half")
    assert tables["corner-runs"].rows == ((1.0, 0.5), (2.0, 1.0))
    assert {f.id for f in report.figures} == {"over-slope", "corner-over-slope"}


def test_parts_need_names_and_cases_of_their_own(raises) -> None:
    for part in (replace(CORNER, name="ride"), replace(CORNER, case=Ride)):
        with raises(CaseError):
            ride_of(part).tasks()
    with raises(CaseError):
        ride_of(replace(RIDE, name="inner", case=Corner)).tasks()


def test_a_part_is_named_by_its_place() -> None:
    """Then a change of the part makes no run of the whole anew: the key follows imports."""
    ride = ride_of(f"{__name__}:CORNER")
    assert ride.every == [ride, CORNER]
