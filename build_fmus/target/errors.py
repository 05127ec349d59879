"""Errors of a library in single precision, measured with libraries for this machine."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np

from build_fmus.component import Model
from build_fmus.reference import sampled_inputs
from build_fmus.target.assemble import Library, rename_externals
from build_fmus.target.toolchain import TARGETS, find_tools


def single_errors(
    component: Model, double: Library, single: Library, folder: Path, steps: int = 1000
) -> dict[str, Any]:
    """Errors of a library against the one in double precision over the reference inputs of the component.

    Returns the number of samples, and of each output the largest error and its ratio to the largest magnitude of the
    output. There are no outputs if a library has refused a sample.

    Args:
        component: what the libraries are of.
        double: the library in double precision.
        single: the one in single precision.
        folder: that is written to.
        steps: samples, one after the other.
    """
    names = [e.name for e in component.elements("output")]
    inputs = sampled_inputs(component, component.sample_time or 0.0, steps)
    exact, n = run_library(double, inputs, len(names), folder)
    rounded, m = run_library(single, inputs, len(names), folder)
    if min(n, m) < steps:
        return {"samples": min(n, m), "outputs": {}}
    errors = np.abs(rounded - exact).max(axis=0)
    sizes = np.abs(exact).max(axis=0)
    found = {
        name: {"absolute": float(e), "relative": float(e / s) if s > 0.0 else (0.0 if e == 0.0 else None)}
        for name, e, s in zip(names, errors, sizes, strict=True)
    }
    return {"samples": steps, "outputs": found}


_RUN = """#include "NAME.h"
static NAME self;
int run(const NUMBER *inputs, NUMBER *outputs, int n_inputs, int n_outputs, int steps) {
    NAME_init(&self);
    for (int k = 0; k < steps; k++) {
        const void *u = inputs + k * n_inputs;
        void *y = outputs + k * n_outputs;
        if (NAME_step(&self, (const NAME_inputs *)u, (NAME_outputs *)y) != NAME_OK) return k;
    }
    return steps;
}
"""


def run_library(library: Library, inputs: np.ndarray, n_outputs: int, folder: Path) -> tuple[np.ndarray, int]:
    """Outputs of each sample (steps, `n_outputs`) of a library for this machine, and how many samples it has taken.

    Args:
        library: sources, in either precision.
        inputs: of each sample (steps, inputs).
        n_outputs: number of outputs.
        folder: that is written to.
    """
    kind = np.dtype(np.float32 if library.precision == "single" else np.float64)
    tools, name, number = find_tools(TARGETS["host-static"]), library.name, {4: "float", 8: "double"}[kind.itemsize]
    place = folder / f"{name}-{number}"
    place.mkdir()
    (place / f"{name}.h").write_text(library.header)
    (place / f"{name}.c").write_text(rename_externals(library, ()))
    (place / "run.c").write_text(_RUN.replace("NAME", name).replace("NUMBER", number))
    tools.compile(f"{name}.c", "all.o", place)
    tools.compile("run.c", "run.o", place, "-fvisibility=default")
    tools.link(["-shared", "all.o", "run.o"], "run.so", place)
    run = ctypes.CDLL(str(place / "run.so")).run
    run.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int] * 3
    u, y = np.ascontiguousarray(inputs, dtype=kind), np.zeros((len(inputs), n_outputs), dtype=kind)
    done = run(u.ctypes.data, y.ctypes.data, inputs.shape[1], n_outputs, len(inputs))
    return y.astype(float), done
