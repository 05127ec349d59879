"""Run an SSP in Ecos or libcosim.

Reads a job as JSON from standard input, prints the outputs after each step as JSON.
"""

import ctypes
import json
import sys
import zipfile
from importlib import metadata

job = json.load(sys.stdin)
rows = []


def ecos() -> None:
    tbb = next(f for f in metadata.files("tbb") or () if f.name.startswith("libtbb.so.12"))
    ctypes.CDLL(str(tbb.locate()), ctypes.RTLD_GLOBAL)
    from ecospy import EcosLib, EcosSimulation

    EcosLib.set_log_level("warn")
    with EcosSimulation(ssp_path=job["ssp"], step_size=1e-3) as simulation:
        simulation.init(parameter_set="initialValues")
        for _ in range(job["steps"]):
            simulation.step(1)
            rows.append([simulation.get_real(n.replace(".", "::", 1)) for n in job["outputs"]])
        simulation.terminate()


def libcosim() -> None:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    with zipfile.ZipFile(job["ssp"]) as archive:  # it takes the folder of an unpacked one
        archive.extractall(job["folder"])
    execution = CosimExecution.from_ssp_file(ssp_path=job["folder"])
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    slaves = {s.name.decode(): s.index for s in execution.slave_infos()}
    places = []
    for name in job["outputs"]:
        slave, _, variable = name.partition(".")
        found = (v.reference for v in execution.slave_variables(slaves[slave]) if v.name.decode() == variable)
        places.append((slaves[slave], next(found)))
    for _ in range(job["steps"]):
        execution.step()
        rows.append([observer.last_real_values(slave, [reference])[0] for slave, reference in places])


{"ecos": ecos, "libcosim": libcosim}[job["reader"]]()
print()
print(json.dumps(rows))
