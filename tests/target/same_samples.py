"""Samples of an FMU, and inputs for them, to compare those of a library with."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave

from build_fmus.component import Component, Model, Variable
from fmu_sources.catalog import Context, default_catalog


def declared(name: str, fmus: Path) -> Component:
    return default_catalog()[name].make(Context(fmus, fmus / ".cache"))


def metrics_of(folder: Path) -> dict[str, Any]:
    """What was measured of a library."""
    found: dict[str, Any] = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    return found


def size_of(v: Variable) -> float:
    """Usual size of a signal, by its unit."""
    return {"m": 0.05, "N": 3e3, "m/s": 0.5, "m/s2": 3.0, "rad": 0.05, "rad/s": 0.2}.get(v.unit or "", 1.0)


def inputs_of(model: Model, n: int, seed: int = 1) -> np.ndarray:
    """Rows of inputs: slow and fast parts of the size of the signals, and jumps beyond their limits."""
    rng = np.random.default_rng(seed)
    columns = []
    for e in model.elements("input"):
        v = e.variable
        if v.type == "Boolean":
            columns.append(rng.integers(0, 2, n).astype(float))
        elif v.type == "Int32":
            columns.append(rng.integers(int(v.min or 0), int(v.max or 1) + 1, n).astype(float))
        elif v.must_equal is not None:
            columns.append(np.full(n, v.must_equal))
        else:
            x = size_of(v) * (np.sin(0.01 * np.arange(n) + rng.uniform(0, 6)) + 0.5 * rng.normal(size=n))
            x[rng.random(n) < 0.01] *= 100.0
            columns.append(x)
    return np.array(columns).T.reshape(n, -1)


@cache
def unpacked(path: Path) -> tuple[Any, str]:
    """The description of an FMU, and the folder with its files."""
    return read_model_description(path), extract(path)


def fmu_samples(path: Path, u: np.ndarray, inputs: list[str], outputs: list[str], step: float) -> np.ndarray:
    """Outputs of each sample of an FMU (FMI 3.0)."""
    description, folder = unpacked(path)
    variables = {v.name: v for v in description.modelVariables}
    fmu = FMU3Slave(
        guid=description.guid,
        modelIdentifier=description.coSimulation.modelIdentifier,
        unzipDirectory=folder,
        instanceName="one",
    )
    fmu.instantiate()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()

    def by_kind(names: list[str]) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {}
        for i, n in enumerate(names):
            found.setdefault(variables[n].type, []).append(i)
        return found

    of_inputs, of_outputs = by_kind(inputs), by_kind(outputs)
    refs_in = {k: [variables[inputs[i]].valueReference for i in c] for k, c in of_inputs.items()}
    refs_out = {k: [variables[outputs[i]].valueReference for i in c] for k, c in of_outputs.items()}
    y = np.zeros((len(u), len(outputs)))
    for k, row in enumerate(u):
        for kind, columns in of_inputs.items():
            values = row[columns]
            getattr(fmu, f"set{kind}")(refs_in[kind], [x if kind == "Float64" else int(x) for x in values])
        fmu.doStep(currentCommunicationPoint=k * step, communicationStepSize=step)
        for kind, columns in of_outputs.items():
            y[k, columns] = [float(x) for x in getattr(fmu, f"get{kind}")(refs_out[kind])]
    fmu.terminate()
    fmu.freeInstance()
    return y
