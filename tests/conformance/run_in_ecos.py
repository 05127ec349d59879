"""Run FMUs in Ecos.

Reads jobs as JSON from standard input, a line each, and answers with a line: outputs before and after each step.
"""

import ctypes
import json
import sys
from importlib import metadata

tbb = next(f for f in metadata.files("tbb") or () if f.name.startswith("libtbb.so.12"))
ctypes.CDLL(str(tbb.locate()), ctypes.RTLD_GLOBAL)

from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure  # noqa: E402

EcosLib.set_log_level("warn")
SUFFIX = {"real": "real", "integer": "integer", "boolean": "bool"}
CAST = {"real": float, "integer": int, "boolean": bool}
for job in map(json.loads, sys.stdin):
    results = []
    for fmu in job["fmus"]:
        structure = EcosSimulationStructure()
        structure.add_model("model", fmu)
        with EcosSimulation(structure=structure, step_size=job["step"]) as simulation:
            simulation.init()
            for name, value in job["inputs"].items():
                kind = job["kinds"][name]
                getattr(simulation, f"set_{SUFFIX[kind]}")(f"model::{name}", CAST[kind](value))
            get = [(getattr(simulation, f"get_{SUFFIX[job['kinds'][n]]}"), f"model::{n}") for n in job["outputs"]]
            rows = [[read(name) for read, name in get]]
            for _ in range(job["steps"]):
                simulation.step(1)
                rows.append([read(name) for read, name in get])
            simulation.terminate()
        results.append(rows)
    print(json.dumps(results), flush=True)
