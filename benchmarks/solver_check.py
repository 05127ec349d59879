"""What it costs an FMU to check its solver step for parameters that were set: time of the end of initialization."""

from __future__ import annotations

import time

from cosim import Fmu
from cosim.fmu.component import FmuComponent
from cosim.study import FmuSet

NAMES = (
    "QuarterCarHmmwv",
    "HydraulicActuator",
    "RideCarSedan",
    "ThreeAxleRide",
    "FullCarHmmwv",
    "FullCarHmmwvModified",
    "ThreeAxleTrench",
)


def seconds(fmu: Fmu, *, checked: bool, repeats: int = 200) -> float:
    """Least time [s] of `ExitInitialization` with all start values, or with one parameter that differs."""
    step = fmu.description.variables["solver.step"]
    times = []
    for _ in range(repeats):
        one = FmuComponent(fmu)
        one.instantiate("one")
        if checked:
            one.set({step: float(step.start) * (1 - 1e-9)})
        one.enter_initialization(0.0, None)
        begin = time.perf_counter()
        one.exit_initialization()
        times.append(time.perf_counter() - begin)
        one.terminate()
        one.close()
    return min(times)


def measure() -> dict[str, float]:
    """For each FMU the time of the check [ms], and for comparison that of the end of initialization without it [ms]."""
    results = {}
    for name in NAMES:
        fmu = Fmu(FmuSet().path(name))
        plain = seconds(fmu, checked=False)
        results[f"{name}: end of initialization, nothing set [ms]"] = plain * 1e3
        results[f"{name}: check of the solver step [ms]"] = (seconds(fmu, checked=True) - plain) * 1e3
    return results
