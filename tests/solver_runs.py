"""States of a component at the end of a run with its inputs held, in Python and by the compiled FMU."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from built import OBJECTS
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from build_fmus.reference import Evaluator


def in_python(c: Component, h: float, end: float) -> np.ndarray:
    """States at `end` with communication steps of `h` [s]."""
    run = Evaluator(c.model())
    for _ in range(round(end / h)):
        run.step(h)
    return run.x


def in_c(c: Component, h: float, end: float, directory: Path, log: list[str] | None = None) -> np.ndarray:
    """The same by the compiled FMU; messages go to `log`.

    Raises:
        FMICallException: initialization or a step failed.
    """
    path = directory / f"{c.name}.fmu"
    path.write_bytes(build_fmu(c, 3, resolve_platforms("host"), OBJECTS))
    return run_fmu(path, [e.name for e in c.model().elements("state")], h, end, log)


def run_fmu(
    path: Path,
    names: list[str],
    h: float,
    end: float,
    log: list[str] | None = None,
    start: dict[str, float] | None = None,
) -> np.ndarray:
    """Values of `names` at `end` of a compiled FMI 3.0 FMU."""
    folder = extract(str(path), str(path.with_suffix("")))
    description = read_model_description(folder)
    fmu = FMU3Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=path.stem,
        instanceName="run",
    )
    said = log if log is not None else []
    fmu.instantiate(
        logMessage=lambda _environment, _status, _category, message: said.append(message.decode()), loggingOn=True
    )
    references = {v.name: v.valueReference for v in description.modelVariables}
    try:
        for name, value in (start or {}).items():
            fmu.setFloat64([references[name]], [value])
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        for k in range(round(end / h)):
            fmu.doStep(currentCommunicationPoint=k * h, communicationStepSize=h)
        return np.array(fmu.getFloat64([references[n] for n in names]))
    finally:
        fmu.freeInstance()
