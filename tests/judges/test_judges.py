"""FMUs of this project, and systems exported as one FMU, in every importer that is installed here: `make test-judges`.

Each runs an FMU with the inputs of its documentation and is compared with the reference results beside them. The
importers come from the extra `judges`; OMSimulator and fmusim may be programs in PATH. One that is not there is skipped
with a sentence.
"""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import fmpy
import pytest

from cosim import System

pytestmark = pytest.mark.judges
FMUS = Path(__file__).parents[2] / "fmus"
STEPS = 40
TOLERANCE = 1e-9  # of the largest value of an output: the reference results are written with twelve digits
NAMES = (
    "QuarterCarHmmwv",
    "FullCarHmmwv",
    "FullCarHmmwvPublic",
    "RideCarSedan",
    "ThreeAxleRide",
    "HydraulicActuator",
    "RoadSine",
    "RoadIso8608",
    "RoadProvingGround",
    "SpeedProfile",
    "LqrHmmwv",
    "Skyhook",
    "MpcHmmwv",
    "GpcPreview",
    "PreviewLqComfort",
    "KalmanHmmwv",
    "SensorSuite",
    "RideComfort",
)
"""One or two of each kind."""
JUDGES = {"fmpy": "fmpy", "ecos": "ecospy", "libcosim": "libcosimpy", "omsimulator": "", "fmusim": ""}
PROGRAMS = {"omsimulator": "OMSimulator", "fmusim": "fmusim"}


def require(judge: str) -> None:
    """Skip where an importer is not installed."""
    module, program = JUDGES[judge], PROGRAMS.get(judge)
    if (module and find_spec(module) is None) or (program and shutil.which(program) is None):
        how = f"no program {program} in PATH" if program else f"{module} is not installed"
        pytest.skip(f"{how}; the extra is [judges]: pip install 'suspension-fmus[judges]'")


def table(fmu: Path, what: str) -> dict[str, list[float]]:
    """Columns of a table of the documentation."""
    with zipfile.ZipFile(fmu) as archive:
        text = archive.read(f"documentation/{fmu.stem}_{what}.csv").decode()
    names, *rows = csv.reader(text.splitlines())
    return dict(zip(names, zip(*(map(float, row) for row in rows), strict=True), strict=True))  # type: ignore[arg-type]


def kinds(fmu: Path) -> dict[str, str]:
    """Variables by the functions that access them, as importers call them."""
    found = {"Real": "real", "Float64": "real", "Integer": "integer", "Int32": "integer", "Boolean": "boolean"}
    return {
        v.name: found[v.type]
        for v in fmpy.read_model_description(str(fmu), validate=False).modelVariables
        if v.type in found
    }


def run(
    judge: str, fmu: Path, step: float, steps: int, inputs: dict[str, list[float]], outputs: list[str], folder: Path
) -> list[list[float]]:
    """What an importer shows after each step."""
    job: dict[str, Any] = {
        "judge": judge,
        "fmu": str(fmu),
        "step": step,
        "steps": steps,
        "inputs": inputs,
        "outputs": outputs,
    }
    job |= {"kinds": kinds(fmu), "folder": str(folder)}
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("run.py"))],
        input=json.dumps(job),
        capture_output=True,
        text=True,
        cwd=folder,
        check=False,
    )
    if (
        judge == "libcosim"
        and "refused: " in done.stderr
        and fmpy.read_model_description(str(fmu), validate=False).fmiVersion.startswith("3")
    ):
        pytest.skip("libcosim refuses FMI 3.0: unsupported FMI version")
    assert done.returncode == 0, (
        f"{judge} ends with exit code {done.returncode}:\n{done.stdout[-1500:]}{done.stderr[-3000:]}"
    )
    return json.loads(done.stdout.rstrip().rpartition("\n")[2])  # type: ignore[no-any-return]


def differences(found: list[list[float]], expected: dict[str, list[float]]) -> list[str]:
    """Outputs that differ, each with the largest difference over its largest value."""
    wrong = []
    for i, (name, values) in enumerate(expected.items()):
        scale = max(1e-12, *map(abs, values)) if not name.endswith(".residual") else 1.0
        largest = max(abs(row[i] - value) for row, value in zip(found, values[1:], strict=True)) / scale
        if not largest <= TOLERANCE:
            wrong.append(f"{name}: {largest:.2g}")
    return wrong


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("judge", JUDGES)
def test_an_fmu_gives_its_reference_results(judge: str, version: int, name: str, tmp_path: Path) -> None:
    require(judge)
    fmu = FMUS / f"fmi{version}" / f"{name}.fmu"
    inputs, expected = table(fmu, "in"), table(fmu, "ref")
    time = inputs.pop("time")
    expected.pop("time")
    if inputs and judge == "omsimulator":
        pytest.skip("the program OMSimulator takes no table of inputs")
    steps = min(STEPS, len(time) - 1)
    step = time[-1] / (len(time) - 1)
    expected = {n: list(values[: steps + 1]) for n, values in expected.items()}
    found = run(judge, fmu, step, steps, {n: list(v) for n, v in inputs.items()}, list(expected), tmp_path)
    assert differences(found, expected) == []


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("judge", JUDGES)
def test_a_system_as_one_fmu_gives_the_run_of_the_system(judge: str, version: int, tmp_path: Path) -> None:
    require(judge)
    path = tmp_path / "Ride.fmu"
    shown = ["car.body.z", "car.body.az"]  # of the plant: what is sampled at the end of a step belongs to the next one
    with System() as system:
        system.add("road", FMUS / "fmi3" / "RoadBenchBump.fmu")
        system.add("car", FMUS / "fmi3" / "QuarterCarHmmwv.fmu", step="1 ms", start={"force": 0.0})
        system.connect_matching("road", "car")
        recording = system.run(0.04, record=shown)
        system.export_fmu(path, fmi=version, outputs=shown)
    found = run(judge, path, 1e-3, 40, {}, shown, tmp_path)
    assert differences(found, {n: recording[n].tolist() for n in shown}) == []


def test_a_system_as_ssp_runs_in_omsimulator(tmp_path: Path) -> None:
    """FMPy, Ecos and libcosim read such files in tests/ssp."""
    require("omsimulator")
    path, results = tmp_path / "ride.ssp", tmp_path / "results.csv"
    with System() as system:
        system.add("road", FMUS / "fmi2" / "RoadBenchBump.fmu")
        system.add("car", FMUS / "fmi2" / "QuarterCarHmmwv.fmu", step="1 ms", start={"force": 0.0})
        system.connect_matching("road", "car")
        system.export_ssp(path)
    done = subprocess.run(
        ["OMSimulator", "--stopTime=0.04", "--suppressPath=true", f"--resultFile={results}", str(path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert "error:" not in done.stdout + done.stderr
    assert len(results.read_text().splitlines()) > 2
