"""The FMU of an exported system, in a run that restores a saved state."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cosim import System


def run_exported(path: Path, step: str, saved: float, left: float, end: float) -> dict[str, np.ndarray]:
    """What the FMU shows, by the names of the variables in the system.

    The state at `saved` is restored at `left`; the run is then continued to `end` [s].
    """
    with System(allow_unconnected=True) as system:
        system.add("s", path, step=step)
        with system.initialize(record=["s.*"]) as simulation:
            simulation.advance(saved)
            state = simulation.save()
            simulation.advance(left)
            simulation.restore(state)
            simulation.advance(end)
            found = simulation.recording
    return {n.removeprefix("s."): found[n] for n in found.names}
