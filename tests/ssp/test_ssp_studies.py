"""Studies and sweeps of an SSP file.

Its parameters vary as those of any experiment, and the numbers are those of the system itself.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from built import BuiltFmus

from cosim import System
from cosim.study import FmuSet, load, run_study
from cosim.study.design import Design, axis
from cosim.study.sweep import prepare, run_sweep

MASSES = (1000.0, 1200.0, 1400.0)


def bench(built_fmus: BuiltFmus) -> System:
    system = System()
    system.add("road", built_fmus.path("RoadBenchBump", 3))
    system.add("car", built_fmus.path("QuarterCarHmmwv", 3), step="1 ms", start={"force": 0.0})
    system.connect_matching("road", "car")
    return system


@pytest.fixture(scope="module")
def file(built_fmus: BuiltFmus, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with bench(built_fmus) as system:
        return system.export_ssp(tmp_path_factory.mktemp("ssp") / "Bench.ssp", version="2.0", stop_time=0.3)


@pytest.fixture(scope="module")
def largest(built_fmus: BuiltFmus) -> list[float]:
    """The largest height of the body for each mass, of the system that was exported."""
    found = []
    with bench(built_fmus) as system:
        for mass in MASSES:
            system["car"].set({"body.mass": mass})
            found.append(float(system.run(0.3, record=["car.body.z"])["car.body.z"].max()))
    assert len(set(found)) == len(MASSES)
    return found


def test_a_sweep_varies_parameters_of_components(file: Path, largest: list[float], tmp_path: Path) -> None:
    experiment = load(str(file))
    varied = Design((axis(f"car.body.mass={','.join(map(str, MASSES))}"),), "grid")
    table = run_sweep(
        prepare(experiment, FmuSet(), varied, {"record": "car.body.z"}), FmuSet(), tmp_path / "runs", processes=1
    )
    assert not table.failures
    assert table.axes["car.body.mass"] == list(MASSES)
    np.testing.assert_array_equal(table.metrics["car.body.z max"], largest)


def test_a_study_runs_the_cases_that_are_given(file: Path, largest: list[float], tmp_path: Path) -> None:
    experiment = load(str(file))
    cases = [experiment.case(parameters=f"car.body.mass={mass}", record="car.body.z") for mass in MASSES]
    results = run_study(experiment, FmuSet(), tmp_path / "runs", tasks=cases, processes=1)
    assert [results[case]["car.body.z max"] for case in cases] == largest
