"""The contact plant of paper 003 alone: simulated time per processor time of one core."""

from __future__ import annotations

import time

from cosim import StopWhen, System
from cosim.study import FmuSet

LENGTH, SPEED = 1.5, 3.0 / 3.6  # m, m/s: a passive crossing with impacts of both bumpers


def factor(step: str) -> float:
    """One crossing with everything that the metrics need recorded at each exchange."""
    with System() as system:
        parameters = {"trench.length": LENGTH}
        system.add(
            "car", FmuSet().path("ThreeAxleTrench"), step=step, parameters=parameters, start={"target.speed": SPEED}
        )
        begin = time.process_time()
        stop = StopWhen("car.x", ">=", 11.0)
        record = ["car.x", "car.body.*", "car.hub.*.fx", "car.*.force"]
        system.allow_unconnected = True
        run = system.run(30.0, record=record, stop_when=[stop])
        spent = time.process_time() - begin
    return float(run.time[-1]) / spent


def measure() -> dict[str, float]:
    """Simulated time per processor time by communication step."""
    return {f"times real time, exchange every {step}": factor(step) for step in ("1 ms", "0.5 ms")}
