"""The mathematical library inside the FMUs (musl) beside the one of this machine: time, and digits that move.

The sources in each FMU are compiled once more with the header that renames the functions replaced by `math.h`, and
linked with the system's library. Both builds run in the bare C loop of `benchmarks.master_cost`, and over the
reference inputs of the FMU's documentation.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import fmpy
import numpy as np
from fmpy import read_model_description, simulate_fmu

from benchmarks.master_cost import Wired, bare_program, seconds
from build_fmus.compile import CFLAGS, find_toolchain, host
from build_fmus.mathematics import FOLDER
from cosim.study import FmuSet

NAMES = ("FullCarHmmwv", "ThreeAxleTrench", "KalmanHmmwv", "SensorSuite", "RoadIso8608", "TrenchCrossing")
STEPS, REPEATS = 1000, 60  # many short runs: the fastest of them met no other work on the machine


def with_system_library(fmu: Path, folder: Path) -> Path:
    """The same FMU with a binary for this machine that calls its own mathematical library."""
    unpacked = Path(fmpy.extract(fmu, folder / fmu.stem))
    sources = unpacked / "sources"
    shutil.rmtree(sources / FOLDER)
    (sources / "fmu_math.h").write_text("#include <math.h>\n")
    binary = next((unpacked / "binaries" / host()).iterdir())
    files = sorted(map(str, sources.rglob("*.c")))
    command = [*find_toolchain(host()).command, *CFLAGS, "-fPIC", "-shared", "-s", f"-I{sources}", *files]
    subprocess.run([*command, "-o", str(binary), "-lm"], check=True)
    archive = shutil.make_archive(str(folder / fmu.stem), "zip", unpacked)
    return Path(archive).replace(folder / fmu.name)


def trajectory(fmu: Path) -> np.ndarray:
    """Outputs (rows, outputs) over the reference inputs of the documentation, by FMPy."""
    with tempfile.TemporaryDirectory() as tmp:
        path = Path(fmpy.extract(fmu, tmp)) / "documentation" / f"{fmu.stem}_in.csv"
        inputs = fmpy.util.read_csv(path)
    step = float(read_model_description(fmu).defaultExperiment.stepSize)
    result = simulate_fmu(
        fmu, input=inputs, stop_time=float(inputs["time"][-1]), output_interval=step, fmi_type="CoSimulation"
    )
    return np.array([[float(x) for x in row][1:] for row in result.tolist()])


def measure(names: tuple[str, ...] = NAMES) -> dict[str, float]:
    """Time per step of each FMU, and its ratio to the time with the system's library.

    Also the largest difference of an output, relative to its largest value.
    """
    results: dict[str, float] = {}
    for name in names:
        with tempfile.TemporaryDirectory() as tmp:
            ours = FmuSet().path(name)
            system = with_system_library(ours, Path(tmp))
            variables = read_model_description(ours).modelVariables
            real = [v.valueReference for v in variables if v.causality == "output" and v.type == "Float64"]
            programs = []
            for label, fmu in (("ours", ours), ("system", system)):
                (Path(tmp) / label).mkdir()
                programs.append(bare_program([Wired(name, fmu, 3, [], [], real, 0)], STEPS, Path(tmp) / label))
            times = [[seconds([p]) / STEPS * 1e6 for p in programs] for _ in range(REPEATS)]
            own, other = map(min, zip(*times, strict=True))
            a, b = trajectory(ours), trajectory(system)
        scale = np.maximum(np.abs(a).max(axis=0), np.finfo(float).tiny)
        results[f"{name}: time per step [us]"] = own
        results[f"{name}: own library / system's, time"] = own / other
        results[f"{name}: largest difference of an output"] = float((np.abs(a - b) / scale).max())
    return results
