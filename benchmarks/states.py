"""Cost of saving, carrying and continuing a state, and of stepping by hand and pacing.

The system is the corner of the HMMWV, six FMUs.

Costs are processor times as parts of what it takes to simulate a millisecond of the same system. How late paced
instants begin depends on what else the machine does; the numbers are those of one run.
"""

from __future__ import annotations

import runpy
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks import spent
from cosim import Execution, Record, System, SystemState

CORNER = Path(__file__).parents[1] / "docs" / "examples" / "hmmwv_corner.py"
RECORD = ["car.body.az"]
INPUT = "tracking.force.desired"
LONG = 3.0  # s of simulated time


def seconds(work: Callable[[], object], repeats: int, rounds: int = 5) -> float:
    """Processor time of one call, the best of some rounds."""

    def repeated() -> None:
        for _ in range(repeats):
            work()

    return min(spent(repeated) / repeats for _ in range(rounds))


def call_by_call(system: System) -> Callable[[], None]:
    """fmi3GetFMUState of all six FMUs, each into the block of its first state, as calls of C."""
    calls = []
    for component in system.components.values():
        implementation: Any = component.implementation
        saved = implementation.save().saved
        call = partial(implementation._function("GetFMUState"), implementation._instance, saved.pointers)
        calls.append((call, saved))  # which is held as long as `work` is

    def work() -> None:
        for call, _ in calls:
            call()

    return work


def initialize(system: System, state: SystemState | None = None) -> object:
    system.allow_unconnected = True
    return system.initialize(record=Record(RECORD, "1 ms"), state=state)


def measure() -> dict[str, float]:
    """Costs of states, as parts of a simulated millisecond, and of one corner by hand and in real time."""
    with runpy.run_path(str(CORNER))["corner"]() as system:
        system.allow_unconnected = True
        with system.initialize(record=Record(RECORD, "1 ms")) as simulation:
            millisecond = spent(simulation.advance, LONG) / (LONG * 1e3)
            state = simulation.save()
            data = state.to_bytes()
            kept = call_by_call(system)
            took = {
                "GetFMUState of the six FMUs": seconds(kept, 200),
                "save": seconds(simulation.save, 200),
                "restore": seconds(lambda: simulation.restore(state), 200),
                "to_bytes": seconds(state.to_bytes, 200),
                "from_bytes": seconds(lambda: SystemState.from_bytes(data), 200),
            }
        traveled = SystemState.from_bytes(data)
        took["initialize"] = seconds(lambda: initialize(system), 20)
        took["initialize with the state of another process"] = seconds(lambda: initialize(system, traveled), 20)
    return {
        "a simulated millisecond [us]": millisecond * 1e6,
        "bytes of the state": len(data),
        **{f"{name} / simulated millisecond": t / millisecond for name, t in took.items()},
        **_by_hand(),
    }


def _by_hand() -> dict[str, float]:
    """Processor time of stepping by hand at 1 kHz, and what a paced run adds, as parts of the clock's millisecond.

    Also the lateness of the paced run.
    """
    with runpy.run_path(str(CORNER))["corner"]() as system:
        system.allow_unconnected = True
        with system.initialize(record=Record(RECORD, "1 ms")) as simulation:
            count = 0

            def step() -> None:
                nonlocal count
                count += 1
                simulation.advance(count / 1000)

            took = {
                "advance by 1 ms": seconds(step, 400),
                "set an input": seconds(lambda: simulation.set(INPUT, 1.0), 1000),
                "read a variable": seconds(lambda: simulation[RECORD[0]], 1000),
            }
        system.allow_unconnected = True
        paced = system.run(LONG, record=Record(RECORD, "1 ms"), execution=Execution(real_time=1.0)).real_time
    assert paced is not None
    return {
        **{f"{name}, per cent of 1 ms": t * 1e5 for name, t in took.items()},
        "paced instants per second": paced.instants / LONG,
        "begun within 10 us [%]": 100 * paced.within(1e-5),
        "begun within 100 us [%]": 100 * paced.within(1e-4),
        "overruns [%]": 100 * paced.overruns / paced.instants,
        "the latest [ms]": 1e3 * paced.worst,
    }
