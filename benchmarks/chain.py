"""Cost of a chain of three trivial FMUs in the engine, in other masters and in a container.

The FMUs are made from the standard's headers alone and compute next to nothing, so this is the least that an exchange
can cost. FMU Manipulation Toolbox puts the chain into one FMU, which a C program steps by 0.1 s, 100 inner steps at a
time; Ecos runs it by itself.
"""

from __future__ import annotations

import itertools
import json
import logging
import shutil
import sys
import tempfile
from pathlib import Path

from fmpy import read_model_description

from benchmarks.master_cost import Wired, bare_program, compare, flatten
from cosim import System
from tests.foreign import followers

STEPS = 100_000  # of 1 ms
REPEATS = 5
INNER = 100  # steps of the toolbox's container in one step of its own
NAMES = ("a", "b", "c")

_ECOS = """
import ctypes, json, sys, time
from importlib import metadata
tbb = next(f for f in metadata.files("tbb") or () if f.name.startswith("libtbb.so.12"))
ctypes.CDLL(str(tbb.locate()), ctypes.RTLD_GLOBAL)
from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure
fmu, steps, names = json.loads(sys.argv[1])
EcosLib.set_log_level("warn")
structure = EcosSimulationStructure()
for name in names:
    structure.add_model(name, fmu)
for source, target in zip(names, names[1:]):
    structure.make_real_connection(f"{source}::y", f"{target}::u")
with EcosSimulation(structure=structure, step_size=1e-3) as simulation:
    simulation.init()
    begin = time.process_time()
    simulation.step(steps)
    print(time.process_time() - begin)
    simulation.terminate()
"""


def measure() -> dict[str, dict[str, float]]:
    """Results by FMI version."""
    return {f"FMI {version}": of_version(version) for version in (2, 3)}


def of_version(version: int) -> dict[str, float]:
    """Microseconds of the processor per FMU step, and ratios, for FMUs of an FMI version."""
    with tempfile.TemporaryDirectory() as tmp, System() as system:
        fmu = followers.build(version, Path(tmp), units=False)
        for name in NAMES:
            system.add(name, fmu, step="1 ms", parameters={"rate": 50.0})
        for source, target in itertools.pairwise(NAMES):
            system.connect(f"{source}.y", f"{target}.u")
        components = flatten(system)
        results = compare(
            system,
            components,
            "c.y",
            STEPS,
            REPEATS,
            {
                "FMU Manipulation Toolbox": _toolbox(fmu, Path(tmp)),
                "Ecos": [sys.executable, "-c", _ECOS, json.dumps([str(fmu), STEPS, NAMES])],
            },
        )
        engine, toolbox = (results[f"{name} / bare C loop"] for name in ("engine", "FMU Manipulation Toolbox"))
        results["engine / FMU Manipulation Toolbox"] = engine / toolbox
        return results


def _toolbox(fmu: Path, folder: Path) -> list[str]:
    """A program that steps the container of the chain."""
    logging.disable(logging.CRITICAL)
    from fmu_manipulation_toolbox.assembly import AssemblyNode

    node = AssemblyNode("chain.fmu", step_size=1e-3)
    for name in NAMES:
        shutil.copy(fmu, folder / f"{name}.fmu")
        node.add_fmu(f"{name}.fmu")
    for source, target in itertools.pairwise(NAMES):
        node.add_link(f"{source}.fmu", "y", f"{target}.fmu", "u")
    node.add_input("u", "a.fmu", "u")
    node.add_output("c.fmu", "y", "y")
    node.make_fmu(folder, fmi_version=2)
    logging.disable(logging.NOTSET)
    about = read_model_description(folder / "chain.fmu", validate=False)
    references = {v.name: v.valueReference for v in about.modelVariables}
    container = Wired("chain", folder / "chain.fmu", 2, [references["u"]], [0], [references["y"]], 0)
    (folder / "toolbox").mkdir()
    return [str(bare_program([container], STEPS // INNER, folder / "toolbox", INNER * 1e-3))]
