"""Cost of the master per FMU step, beside FMPy's wrapper calls and a bare C loop over the same FMUs, in one run.

All three exchange the same variables of the same FMI 3.0 FMUs in the same order; the bare loop is the time the FMUs
themselves need, so the difference to it is what a master adds.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import jinja2
from fmpy import read_model_description
from fmpy.fmi3 import FMU3Slave

from build_fmus.compile import find_toolchain, host
from cosim import System
from cosim.experiments.gpc.runs import CONTROLLERS, PLANT, SPEED, Case, road_file, wire
from cosim.study import FmuSet

STEPS = 20_000


@dataclass
class Wired:
    """One component of the system as flat lists: what every loop needs."""

    name: str
    fmu: Path
    inputs: list[int]  # value references
    sources: list[int]  # positions in the vector of all outputs
    outputs: list[int]  # value references
    first: int  # position of the first output


def flatten(system: System, paths: dict[str, Path]) -> list[Wired]:
    """Components in execution order with the variables that are exchanged."""
    position: dict[str, int] = {}
    result = []
    for member in system.schedule().members:
        used = dict.fromkeys(c.source_name for c in system.connections.values() if c.source is member)
        first = len(position)
        position.update((n, first + i) for i, n in enumerate(used))
        outputs = [member.description.outputs[n.split(".", 1)[1]].reference for n in used]
        result.append(Wired(member.name, paths[member.name], [], [], outputs, first))
    for wired in result:
        for c in system.connections.values():
            if c.target.name == wired.name:
                wired.inputs.append(c.input.reference)
                wired.sources.append(position[c.source_name])
    return result


def time_master(system: System, steps: int, *, allow_nan: bool = False) -> float:
    """Seconds for ``steps`` steps by our master, recording one variable at 10 Hz."""
    run = system.run(
        steps * 1e-3, record=["car.x"], record_interval="100 ms", allow_nan=allow_nan, allow_unconnected=True
    )
    return run.wall_time


def time_fmpy(components: list[Wired], steps: int) -> float:
    """Seconds for the same loop with FMPy's slave objects."""
    slaves, folders = [], []
    for w in components:
        description = read_model_description(w.fmu)
        folders.append(tempfile.TemporaryDirectory())
        unzipped = fmpy.extract(w.fmu, folders[-1].name)
        slave = FMU3Slave(
            guid=description.guid, unzipDirectory=unzipped, modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=w.name,
        )  # fmt: skip
        slave.instantiate()
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slaves.append(slave)
    values: dict[int, float] = {}
    for w, slave in zip(components, slaves, strict=True):
        values.update(zip(range(w.first, w.first + len(w.outputs)), slave.getFloat64(w.outputs), strict=True))
    begin = time.perf_counter()
    for k in range(steps):
        for w, slave in zip(components, slaves, strict=True):
            if w.inputs:
                slave.setFloat64(w.inputs, [values[s] for s in w.sources])
            slave.doStep(k * 1e-3, 1e-3)
            for i, value in enumerate(slave.getFloat64(w.outputs), w.first):
                values[i] = value
    seconds = time.perf_counter() - begin
    for slave in slaves:
        slave.terminate()
        slave.freeInstance()
    return seconds


def bare_program(components: list[Wired], steps: int, folder: Path) -> Path:
    """A program in ``folder`` that runs the same loop in C and prints the seconds it took, compiled with the host toolchain."""
    template = jinja2.Template((Path(__file__).parent / "bare_loop.c.j2").read_text())
    items: list[dict[str, Any]] = []
    for i, w in enumerate(components):
        description = read_model_description(w.fmu)
        unpacked = folder / str(i)
        fmpy.extract(w.fmu, unpacked)
        library = next((unpacked / "binaries" / host()).iterdir())
        items.append({**vars(w), "library": library, "token": description.guid})
    size = max(w.first + len(w.outputs) + len(w.inputs) for w in components) + 1
    source, program = folder / "loop.c", folder / "loop"
    source.write_text(template.render(components=items, steps=steps, size=size))
    headers = Path(fmpy.__file__).parent / "c-code"
    command = [*find_toolchain(host()).command, "-O2", "-std=gnu99", f"-I{headers}", source, "-o", program, "-ldl"]
    subprocess.run(list(map(str, command)), check=True)
    return program


def seconds(program: Path) -> float:
    """What the program of :func:`bare_program` prints."""
    return float(subprocess.run([program], check=True, capture_output=True, text=True).stdout)


def time_bare(components: list[Wired], steps: int) -> float:
    """Seconds for the same loop in C."""
    with tempfile.TemporaryDirectory() as tmp:
        return seconds(bare_program(components, steps, Path(tmp)))


def measure(controller: str = "preview", steps: int = STEPS, repeats: int = 3) -> dict[str, float]:
    """Best of ``repeats`` for each loop, as microseconds per FMU step and ratios."""
    fmus = FmuSet()
    paths = {"speed": fmus.path(SPEED), "road": road_file(fmus, "sine"), "car": fmus.path(PLANT)}
    if name := CONTROLLERS[controller]:
        paths["controller"] = fmus.path(name)
    with wire(fmus, Case("sine", controller=controller)) as system:
        components = flatten(system, paths)
        bare = min(time_bare(components, steps) for _ in range(repeats))
        runs = [(time_master(system, steps), time_master(system, steps, allow_nan=True)) for _ in range(repeats)]
        ours, unchecked = map(min, zip(*runs, strict=True))
    peer = min(time_fmpy(components, steps) for _ in range(repeats))
    n = steps * len(components)
    return {
        "fmus": len(components),
        "bare C loop [us per FMU step]": bare / n * 1e6,
        "this master [us per FMU step]": ours / n * 1e6,
        "FMPy wrapper calls [us per FMU step]": peer / n * 1e6,
        "this master / bare loop": ours / bare,
        "looking for NaN / not looking": ours / unchecked,
        "FMPy / this master": peer / ours,
        "FMPy overhead / this master's overhead": (peer - bare) / (ours - bare),
        "simulated time / wall time": steps * 1e-3 / ours,
    }
