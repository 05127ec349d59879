"""Run one FMU in another program: reads a job as JSON from standard input, prints the outputs after each step as JSON.

In a process of its own, since an importer may crash, and Ecos needs a library that only Python knows where to find.
"""

import csv
import ctypes
import json
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

job = json.load(sys.stdin)
OUTPUTS, KINDS, STEP = job["outputs"], job["kinds"], job["step"]
STEPS = job["steps"]


def row(k):
    """Inputs of a step, by name and kind."""
    return [(name, KINDS[name], values[k]) for name, values in job["inputs"].items()]


def held():
    """A table of inputs that changes in jumps: two rows at each communication point."""
    path = Path(job["folder"]) / "inputs.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *job["inputs"]])
        for k in range(STEPS):
            writer.writerows([at * STEP, *(values[k] for values in job["inputs"].values())] for at in (k, k + 1))
    return path


def read(path):
    """The rows of a result file at the communication points after the first."""
    with path.open(newline="") as file:
        table = list(csv.DictReader(file))
    rows = {}
    for line in table:
        rows.setdefault(round(float(line["time"]) / STEP), line)  # before an event, where there are two
    return [[float(rows[k][name]) for name in OUTPUTS] for k in range(1, STEPS + 1)]


def by_fmpy():
    import fmpy
    import numpy as np

    types = {"real": np.double, "integer": np.int32, "boolean": np.bool_}
    signals = None
    if job["inputs"]:
        with held().open(newline="") as file:
            _, *rows = csv.reader(file)
        signals = np.array(
            [tuple(map(float, r)) for r in rows],
            dtype=[("time", np.double), *((n, types[KINDS[n]]) for n in job["inputs"])],
        )
    found = fmpy.simulate_fmu(
        job["fmu"],
        fmi_type="CoSimulation",
        stop_time=STEPS * STEP,
        step_size=STEP,
        output_interval=STEP,
        input=signals,
        output=OUTPUTS,
    )
    _, first = np.unique(np.round(found["time"] / STEP).astype(int), return_index=True)
    return [[float(found[n][i]) for n in OUTPUTS] for i in first[1:]]


def by_ecos():
    tbb = next(f for f in metadata.files("tbb") or () if f.name.startswith("libtbb.so.12"))
    ctypes.CDLL(str(tbb.locate()), ctypes.RTLD_GLOBAL)
    from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure

    EcosLib.set_log_level("warn")
    names, cast = (
        {"real": "real", "integer": "integer", "boolean": "bool"},
        {"real": float, "integer": int, "boolean": bool},
    )
    structure = EcosSimulationStructure()
    structure.add_model("model", job["fmu"])
    structure.add_parameter_set("initialValues", {f"model::{name}": cast[kind](value) for name, kind, value in row(0)})
    rows = []
    with EcosSimulation(structure=structure, step_size=STEP) as simulation:
        simulation.init(parameter_set="initialValues")
        for k in range(STEPS):
            for name, kind, value in row(k):
                getattr(simulation, f"set_{names[kind]}")(f"model::{name}", cast[kind](value))
            simulation.step(1)
            rows.append([float(getattr(simulation, f"get_{names[KINDS[n]]}")(f"model::{n}")) for n in OUTPUTS])
        simulation.terminate()
    return rows


def by_libcosim():
    from libcosimpy._internal import get_last_error_message
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(STEP * 1e9)
    opened = CosimLocalSlave(fmu_path=job["fmu"], instance_name="model")
    if not opened.ptr():
        sys.exit(f"refused: {get_last_error_message()}")
    slave = execution.add_local_slave(opened)
    observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
    execution.add_observer(observer)
    execution.add_manipulator(manipulator)
    references = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
    for name, kind, value in row(0) if STEPS else ():
        getattr(execution, f"{kind}_initial_value")(
            slave, references[name], {"real": float, "integer": int, "boolean": bool}[kind](value)
        )
    rows = []
    for k in range(STEPS):
        for kind, cast in (("real", float), ("integer", int), ("boolean", bool)):
            given = [(references[n], cast(v)) for n, of, v in row(k) if of == kind]
            if given:
                getattr(manipulator, f"slave_{kind}_values")(slave, [r for r, _ in given], [v for _, v in given])
        execution.step()
        rows.append([float(getattr(observer, f"last_{KINDS[n]}_values")(slave, [references[n]])[0]) for n in OUTPUTS])
    return rows


def by_omsimulator():
    """Its program; it has no table of inputs, so it gets FMUs without."""
    out = Path(job["folder"]) / "results.csv"
    command = [
        shutil.which("OMSimulator"),
        "--mode=cs",
        "--startTime=0",
        f"--stopTime={STEPS * STEP!r}",
        f"--stepSize={STEP!r}",
        "--suppressPath=true",
        "--stripRoot=true",
        f"--resultFile={out}",
        job["fmu"],
    ]
    subprocess.run(command, check=True, cwd=job["folder"], stdout=sys.stderr)
    return read(out)


def by_fmusim():
    out = Path(job["folder"]) / "results.csv"
    given = ["--input-file", str(held())] if job["inputs"] else []
    command = [
        shutil.which("fmusim"),
        "--interface-type",
        "cs",
        "--stop-time",
        repr(STEPS * STEP),
        "--output-interval",
        repr(STEP),
        *given,
        "--output-file",
        str(out),
        job["fmu"],
    ]
    subprocess.run(command, check=True, cwd=job["folder"], stdout=sys.stderr)
    return read(out)


print()
print(
    json.dumps(
        {"fmpy": by_fmpy, "ecos": by_ecos, "libcosim": by_libcosim, "omsimulator": by_omsimulator, "fmusim": by_fmusim}[
            job["judge"]
        ]()
    )
)
