"""Sweeps and searches in lanes: the same bytes as scalar runs, also of copies that fail or end early."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from built import FMUS as FOLDER
from click.testing import CliRunner
from sweep_tables import FMUS, made

import cosim.cli
from cosim import Execution, System
from cosim.study import FmuSet, load, run_study
from cosim.study.calibration import SystemResponse, calibrate
from cosim.study.optimise_command import PointRuns
from cosim.study.sweep import SweepTable, history, run_sweep

pytestmark = pytest.mark.usefixtures("built_fmus")
FILE = Path(__file__).with_name("lane_ride.py")


@pytest.fixture(scope="module")
def experiment() -> Any:
    return load(str(FILE))


def swept(experiment: Any, folder: Path, lanes: str, *vary: str, **options: Any) -> tuple[SweepTable, bytes]:
    """The table of a sweep that one thread of this process makes, and its file."""
    sweep = made(experiment, *vary)
    with ThreadPoolExecutor(1) as worker:
        table = run_sweep(
            sweep, FMUS, folder / lanes / "runs", executor=worker, execution=Execution(lanes=lanes), **options
        )
    return table, table.write(folder / lanes / "table.parquet").read_bytes()


def compare(experiment: Any, folder: Path, *vary: str, **options: Any) -> tuple[SweepTable, SweepTable]:
    """Sweeps as scalar runs and in lanes, whose tables must be equal byte for byte."""
    (scalar, wanted), (table, found) = (swept(experiment, folder, k, *vary, **options) for k in ("off", "auto"))
    assert scalar.in_lanes == 0
    assert found == wanted
    return scalar, table


def test_a_sweep_in_lanes_has_the_table_of_scalar_runs(experiment: Any, tmp_path: Path) -> None:
    """A full car on random roads, of which some runs last longer than others."""
    vary = ("road.seed=1..500", "road.class=2:5", "road.length=30:900", "car.body.mass=2300:3400", "seconds=0.05,0.1")
    _, table = compare(experiment, tmp_path, *vary, "speed.start.speed=5:25", "car=FullCarHmmwv")
    assert len(set(table.metrics["rms"])) == len(table.sweep)
    assert table.in_lanes > 0.9 * len(table.sweep)  # one that is left for the last chunk is alone


def test_copies_that_fail_or_end_early_are_single_runs(experiment: Any, tmp_path: Path) -> None:
    """A mass that the solver cannot follow fails when it is initialized; others end where the body is too low."""
    vary = ("road.seed=1..500", "road.class=5,7", "car.body.mass=1,900,3000", "low=-0.02,-1", "car.force=0,1e306")
    scalar, table = compare(experiment, tmp_path, *vary, "speed.start.speed=5:25", histories=True)
    assert 0 < len(table.failures) < len(table.sweep)
    assert {len(set(table.failures.values()))} != {1}
    assert len({table.metrics["samples"][i] for i in range(len(table.sweep)) if i not in table.failures}) > 1
    assert 0 < table.in_lanes < len(table.sweep)
    for i in range(len(table.sweep)):
        if table.histories[i] and i not in table.failures:
            one, other = (history(tmp_path / k, i) for k in ("off", "auto"))
            np.testing.assert_array_equal(one.data, other.data)
    assert scalar.failures == table.failures


def test_systems_that_are_not_vectorizable_run_as_before(experiment: Any, tmp_path: Path) -> None:
    _, table = compare(experiment, tmp_path, "car.body.mass=2300:3400", "python=true")
    assert table.in_lanes == 0
    assert not table.failures


def test_searches_that_are_done_together_find_what_each_finds_alone(experiment: Any, tmp_path: Path) -> None:
    """Their runs are made in lanes, though none knows its next one; one that fails does so alone."""
    shaken = sys.modules[experiment.case.__module__].Shaken
    tasks = [shaken(rms, 0.2 + 0.01 * i) for i, rms in enumerate([0.1, 0.5, 1.0, -1.0, 2.0, 9.0])]
    found = []
    for lanes in ("off", "auto"):
        with ThreadPoolExecutor(1) as worker:
            results = run_study(
                experiment, FMUS, tmp_path / lanes, tasks=tasks, executor=worker, execution=Execution(lanes=lanes)
            )
        assert (results.in_lanes >= 6) == (lanes == "auto")
        found.append([results.failures, *(results.found(t) for t in tasks if t.rms > 0)])
    assert found[0] == found[1]
    assert len({str(f) for f in found[0][1:]}) == 5
    assert list(found[0][0].values()) == ["ValueError: nothing is shaken as little"]


def test_an_isolated_sweep_is_not_in_lanes(experiment: Any, tmp_path: Path) -> None:
    sweep = made(experiment, "car.body.mass=2300:3400", samples=5)
    execution = Execution(isolate=("car",), lanes="auto")
    with ThreadPoolExecutor(1) as worker:
        table = run_sweep(sweep, FMUS, tmp_path / "runs", executor=worker, execution=execution)
    assert (table.in_lanes, table.failures) == (0, {})


def test_a_command_says_how_many_runs_were_in_lanes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It turns them on by itself where the work pays for their compilation."""
    monkeypatch.setattr("cosim.study.dispatch.LANES_PAY", 0.0)
    command = ["sweep", str(FILE), "--fmus", str(FOLDER), "--out", str(tmp_path), "--processes", "1", "--samples", "12"]
    result = CliRunner().invoke(cosim.cli.app, [*command, "--vary", "car.body.mass=2300:3400"])
    assert result.exit_code == 0, result.output
    said = next(line for line in result.output.splitlines() if "vector lanes" in line)
    assert 8 <= int(said.split()[0]) <= 12


def test_a_search_turns_lanes_on_where_its_trials_take_long(
    experiment: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cosim.study.optimise_command.LANES_PAY", 0.0)
    sweep = made(experiment, "car.body.mass=2300:3400", samples=1)
    first, second = ([{"car.body.mass": 2300.0 + 100 * b + k} for k in range(6)] for b in range(2))
    with ThreadPoolExecutor(1) as worker:
        runs = PointRuns(sweep, FMUS, tmp_path / "lanes", worker, trials=12)
        scalar = PointRuns(sweep, FMUS, tmp_path / "scalar", worker, Execution(lanes="off"), trials=12)
        for tried in (first, second):
            assert runs.evaluate_batch(tried) == scalar.evaluate_batch(tried)
    assert runs.in_lanes == [0, 6]
    assert scalar.in_lanes == [0, 0]


def test_a_calibration_in_lanes_finds_the_same_values() -> None:
    with System(allow_unconnected=True) as system:
        system.add("car", FmuSet(FOLDER).path("QuarterCarHmmwv"), step="1 ms", start={"road.height": 0.05})
        outputs = ["car.body.z", "car.wheel.z"]
        found = []
        for lanes in ("off", "auto"):
            model = SystemResponse(system, outputs, stop_time=0.5, interval="5 ms", lanes=lanes)
            measured = model({"car.body.mass": 2100.0, "car.suspension.damping": 9e3})
            ranges = {"car.body.mass": (2500.0, 1000.0, 4000.0), "car.suspension.damping": (12e3, 3e3, 24e3)}
            found.append(calibrate(model, measured, ranges))
            assert (model.in_lanes > 0) == (lanes == "auto")
    assert found[0].values.tolist() == found[1].values.tolist()
    np.testing.assert_allclose(found[0].values, [2100.0, 9e3], rtol=1e-6)
