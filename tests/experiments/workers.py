"""A study for the tests of `run_tasks`: run as a program, it says in a file who works and where."""

from __future__ import annotations

import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

from cosim import System
from cosim.experiments.parallel import run_tasks

KEPT: list[System] = []


def work(task: tuple[str, str, str]) -> int:
    """Run an FMU, as studies do keep it loaded, and leave a note of the process; "stay" works on without an end."""
    fmu, notes, then = task
    warnings.simplefilter("ignore")
    system = System()
    system.add("plant", fmu)
    system.run(0.2)
    KEPT.append(system)
    (Path(notes) / str(os.getpid())).write_text(tempfile.gettempdir())
    while then == "stay":
        time.sleep(0.05)
    if then == "fail":
        raise ValueError("the work failed")
    return os.getpid()


def study(fmu: str, notes: str, then: str) -> list[int]:
    return run_tasks(work, [(fmu, notes, then)] * 4, processes=2)


if __name__ == "__main__":
    study(*sys.argv[1:])
