"""Cost of keeping an FMU in another process.

One small FMU, in this process and isolated, beside a bare exchange of one number.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from build_fmus.compile import find_toolchain, host
from cosim import Record, System
from tests.foreign import followers

BATCHES, STEPS = 400, 500
STEP = Fraction(1, 10000)  # s; the FMU then does next to nothing
_SOURCE = Path(__file__).with_name("ping_pong.c")


def measure() -> dict[str, float]:
    """Microseconds per step, the median over batches, and ratios."""
    with tempfile.TemporaryDirectory() as tmp:
        program = Path(tmp) / "ping_pong"
        find_toolchain(host())._run(["-std=c11", "-O2", str(_SOURCE), "-o", str(program)])
        fmu = followers.build(2, Path(tmp), units=False)
        bare, within, shared, socket = [], [], [], []
        for _ in range(3):  # in turn: whatever else the machine does meets all of them
            bare.append(float(subprocess.run([program], check=True, capture_output=True, text=True).stdout) / 1e3)
            within.append(_per_step(fmu))
            shared.append(_per_step(fmu, shared_memory=True))
            socket.append(_per_step(fmu, shared_memory=False))
    cost = {"in this process": within, "isolated": shared, "isolated, through a socket": socket}
    result = {"bare exchange in shared memory [us]": min(bare)}
    result |= {f"{name} [us per step]": min(found) for name, found in cost.items()}
    result["isolation / bare exchange"] = (min(shared) - min(within)) / min(bare)
    return result


def _per_step(fmu: Path, **how: Any) -> float:
    """Median over batches of the wall time of one step: inputs, doStep, outputs [us]."""
    with System() as system:
        system.add("source", fmu, step=STEP, parameters={"rate": 50.0})
        system.add("one", fmu, step=STEP, parameters={"rate": 50.0}, isolated=bool(how))
        system.connect("source.y", "one.u")
        if how:
            component: Any = system["one"].implementation
            component.isolation = replace(component.isolation, **how)
        system.allow_unconnected = True
        simulation = system.initialize(record=Record(["one.y"], STEPS * STEP))
        found = []
        for i in range(BATCHES):
            begin = time.perf_counter()
            simulation.advance((i + 1) * STEPS * STEP)
            found.append((time.perf_counter() - begin) / STEPS * 1e6)
    return float(np.median(found))
