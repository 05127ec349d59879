"""Cost of the engine per FMU step, in one run.

Beside FMPy's wrapper calls and a bare C loop over the same FMUs.

All exchange the same variables of the same FMUs in the same order; the bare loop is the time the FMUs themselves need,
so the difference to it is what a master adds. All times are of the processor, so that other work on the machine hardly
counts.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import fmpy
import jinja2
from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from benchmarks import spent
from build_fmus.compile import find_toolchain, host
from cosim import Execution, Record, System
from cosim.experiments.gpc.runs import Case, wire
from cosim.fmu.calls import platform_folder
from cosim.study import FmuSet

STEPS = 20_000  # of 1 ms


@dataclass
class Wired:
    """One component of the system as flat lists: what every loop needs."""

    name: str
    fmu: Path
    version: int  # FMI
    inputs: list[int]  # value references
    sources: list[int]  # positions in the vector of all outputs
    outputs: list[int]  # value references
    first: int  # position of the first output


def flatten(system: System) -> list[Wired]:
    """Components in execution order with the variables that are exchanged."""
    position: dict[str, int] = {}
    result = []
    for component in system.schedule().components:
        used = dict.fromkeys(c.source_name for c in system.connections.values() if c.source is component)
        first = len(position)
        position.update((n, first + i) for i, n in enumerate(used))
        outputs = [component.description.outputs[n.split(".", 1)[1]].reference for n in used]
        version = int(component.description.fmi_version[0])
        path: Path = component.implementation.fmu.path  # type: ignore[attr-defined]
        result.append(Wired(component.name, path, version, [], [], outputs, first))
    for wired in result:
        for c in system.connections.values():
            if c.target.name == wired.name:
                wired.inputs.append(c.input.reference)
                wired.sources.append(position[c.source_name])
    return result


def time_master(
    system: System, steps: int, record: str, interval: str = "100 ms", execution: Execution | None = None
) -> float:
    """Seconds for `steps` steps of 1 ms by our master, recording `record`."""
    system.allow_unconnected = True
    with system.initialize(record=Record(record, interval), execution=execution) as simulation:
        return spent(simulation.advance, steps * 1e-3)


def fmpy_slave(w: Wired, folder: str) -> tuple[Any, dict[str, int]]:
    """An instance of a component by FMPy, unpacked into a folder; value references by name."""
    description = read_model_description(w.fmu)
    slave = (FMU2Slave if w.version == 2 else FMU3Slave)(
        guid=description.guid,
        unzipDirectory=fmpy.extract(w.fmu, folder),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName=w.name,
    )
    slave.instantiate()
    return slave, {v.name: v.valueReference for v in description.modelVariables}


def time_fmpy(components: list[Wired], steps: int) -> float:
    """Seconds for the same loop with FMPy's slave objects."""
    slaves, folders = [], []

    def get(slave: Any, w: Wired) -> Any:
        return slave.getReal(w.outputs) if w.version == 2 else slave.getFloat64(w.outputs)

    def put(slave: Any, w: Wired, numbers: list[float]) -> None:
        (slave.setReal if w.version == 2 else slave.setFloat64)(w.inputs, numbers)

    for w in components:
        folders.append(tempfile.TemporaryDirectory())
        slave, _ = fmpy_slave(w, folders[-1].name)
        if w.version == 2:
            slave.setupExperiment()
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slaves.append(slave)
    values: dict[int, float] = {}
    for w, slave in zip(components, slaves, strict=True):
        values.update(zip(range(w.first, w.first + len(w.outputs)), get(slave, w), strict=True))
    begin = time.process_time()
    for k in range(steps):
        for w, slave in zip(components, slaves, strict=True):
            if w.inputs:
                put(slave, w, [values[s] for s in w.sources])
            slave.doStep(k * 1e-3, 1e-3)
            for i, value in enumerate(get(slave, w), w.first):
                values[i] = value
    seconds = time.process_time() - begin
    for slave in slaves:
        slave.terminate()
        slave.freeInstance()
    return seconds


def bare_program(components: list[Wired], steps: int, folder: Path, length: float = 1e-3) -> Path:
    """A C program in `folder` that runs the same loop with steps of `length` [s] and prints its seconds.

    It is compiled with the host toolchain.
    """
    template = jinja2.Template((Path(__file__).parent / "bare_loop.c.j2").read_text())
    items: list[dict[str, Any]] = []
    for i, w in enumerate(components):
        description = read_model_description(w.fmu, validate=False)  # not everybody's is valid
        unpacked = folder / str(i)
        fmpy.extract(w.fmu, unpacked)
        place, suffix = platform_folder(str(w.version))
        library = unpacked / "binaries" / place / f"{description.coSimulation.modelIdentifier}{suffix}"
        resources = (unpacked / "resources").as_uri() if w.version == 2 else f"{unpacked / 'resources'}/"
        items.append({**vars(w), "library": library, "token": description.guid, "resources": resources})
    size = max(w.first + len(w.outputs) + len(w.inputs) for w in components) + 1
    source, program = folder / "loop.c", folder / "loop"
    source.write_text(template.render(components=items, steps=steps, size=size, length=length))
    headers = Path(fmpy.__file__).parent / "c-code"
    command = [*find_toolchain(host()).command, "-O2", "-std=gnu99", f"-I{headers}", source, "-o", program, "-ldl"]
    subprocess.run(list(map(str, command)), check=True)
    return program


def seconds(command: Sequence[str | Path]) -> float:
    """What a program prints last, such as that of `bare_program`."""
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])


def measure() -> dict[str, dict[str, float]]:
    """Best of five for each loop over the passive and the preview system, as microseconds per FMU step and ratios."""
    found = {}
    for controller in ("passive", "preview"):
        with wire(FmuSet(), Case("sine", controller=controller)) as system:
            found[f"{controller} system"] = compare(system, flatten(system), "car.x", STEPS, 5)
    return found


def compare(
    system: System,
    components: list[Wired],
    record: str,
    steps: int,
    repeats: int,
    more: Mapping[str, Sequence[str]] | None = None,
) -> dict[str, float]:
    """Best of `repeats` of every loop over one system, all in turn.

    `more`: programs that run it too and print their seconds.
    """
    loops: dict[str, Callable[[], float]] = {
        "engine": lambda: time_master(system, steps, record),
        "engine, recording every step": lambda: time_master(system, steps, record, "1 ms"),
        "engine, not looking for NaN": lambda: time_master(system, steps, record, execution=Execution(allow_nan=True)),
        "FMPy wrapper calls": lambda: time_fmpy(components, steps // 4) * 4,
    }
    with tempfile.TemporaryDirectory() as tmp:
        program = bare_program(components, steps, Path(tmp))
        loops = {"bare C loop": lambda: seconds([program]), **loops}
        loops |= {name: partial(seconds, command) for name, command in (more or {}).items()}
        took = {name: min(times) for name, times in _in_turn(loops, repeats).items()}
    n = steps * len(components)
    bare, ours = took["bare C loop"], took["engine"]
    return {
        "fmus": len(components),
        **{f"{name} [us per FMU step]": t / n * 1e6 for name, t in took.items()},
        **{f"{name} / bare C loop": t / bare for name, t in took.items() if t is not bare},
        "simulated time / wall time": steps * 1e-3 / ours,
    }


def _in_turn(loops: dict[str, Callable[[], float]], repeats: int) -> dict[str, list[float]]:
    """Times of all loops, one after the other and that `repeats` times, so that a slow moment meets them all."""
    rounds = [{name: loop() for name, loop in loops.items()} for _ in range(repeats)]
    return {name: [r[name] for r in rounds] for name in loops}
