"""A hundred runs from one settled state: how much of a step of its desired force does the actuator reach?

    python docs/examples/warm_starts.py

The corner of hmmwv_corner.py drives until oil and car have settled. That state is written to a file. The processes of a
pool start every run from this state, so the runs do not affect each other.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path

from hmmwv_corner import corner

from cosim import System, SystemState

SETTLED, FORCES = Path("settled.state"), [20.0 * i for i in range(1, 101)]  # N


def settle(path: Path) -> None:
    """Half a second with the desired force at zero, up to shortly before the first bump."""
    with corner() as system, system.initialize(record=[]) as simulation:
        simulation.advance(0.5)
        simulation.save().write(path)


@cache
def begin(path: Path) -> tuple[System, SystemState]:
    """Once per process: the same system, and the state."""
    return corner(), SystemState.read(path)


def reached(path: Path, force: float) -> float:
    """Largest force in 0.1 s after a step to `force` [N], as part of it."""
    system, state = begin(path)
    simulation = system.initialize(record=["actuator.force"], state=state)
    rest = simulation.recording["actuator.force"][0]
    simulation.set("tracking.force.desired", force)
    simulation.advance(0.6)
    return float(max(simulation.recording["actuator.force"]) - rest) / force


def main() -> None:
    settle(SETTLED)
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(partial(reached, SETTLED), FORCES, chunksize=10))
    print(f"{len(found)} runs from {SETTLED}: {100 * min(found):.0f} to {100 * max(found):.0f} % of the step")


if __name__ == "__main__":
    main()
