"""Work for the tests of `local_processes`: run as a program, it says in a file who works and where."""

from __future__ import annotations

import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

from cosim import System
from cosim.study.processes import local_processes

KEPT: list[System] = []


def work(task: tuple[str, str, str]) -> int:
    """Run an FMU, as studies do keep it loaded, and leave a note of the process; "stay" works on without an end."""
    fmu, notes, then = task
    warnings.simplefilter("ignore")
    system = System()
    system.add("plant", fmu)
    system.run(0.2)
    KEPT.append(system)
    note = Path(notes) / str(os.getpid())
    written = note.parent.with_name(f"note-{note.name}")
    written.write_text(tempfile.gettempdir())
    written.replace(note)  # whole or not there: a worker is killed at any moment, and notes are read at any moment
    while then == "stay":
        time.sleep(0.05)
    if then == "fail":
        raise ValueError("the work failed")
    return os.getpid()


def study(fmu: str, notes: str, then: str) -> list[int]:
    with local_processes(2) as executor:
        return [f.result() for f in [executor.submit(work, (fmu, notes, then)) for _ in range(4)]]


if __name__ == "__main__":
    study(*sys.argv[1:])
