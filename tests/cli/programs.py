"""Run the command lines as a user does, in a folder of the test's own.

Each runs in a process of its own, forked from one that has imported what they need: half a second of each of a hundred
runs. What a process as it is installed does differently, other tests see: those of pages, of interruptions, of
encodings and of the wheel.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
from multiprocessing.context import BaseContext
from pathlib import Path

from built import ROOT

BIN = Path(sys.executable).parent
ENVIRONMENT = {**os.environ, "COLUMNS": "200"}
TIMEOUT = 120  # s
ENTRIES = {"cosim": "cosim_command", "build-fmus": "build_command"}  # of suspension_fmus
IMPORTED = [
    "suspension_fmus",
    "cosim.cli",
    "cosim.experiments.gpc",
    "cosim.experiments.hmmwv",
    "cosim.experiments.trench",
    "fmu_sources.cli",
    "fmu_sources.catalog",
    "fmu_sources.controllers.lq.preview_weights",
    "build_fmus.package",
]


def _ready() -> BaseContext | None:
    """Where processes come from; None where they cannot be forked."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return None
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(IMPORTED)
    return context


_CONTEXT = _ready()


def _enter(folder: Path, program: str, arguments: tuple[str, ...], outputs: tuple[Path, Path]) -> None:
    """In the process: what the installed script does, with its own folder, outputs and environment."""
    os.chdir(folder)
    os.environ.update(ENVIRONMENT)
    for stream, (number, path) in zip(("stdout", "stderr"), enumerate(outputs, start=1), strict=True):
        with path.open("w") as file:
            os.dup2(file.fileno(), number)
        setattr(sys, stream, os.fdopen(number, "w", closefd=False))
    sys.path[:] = [p for p in sys.path if p and not Path(p).is_relative_to(ROOT / "tests")]
    sys.argv = [str(BIN / program), *arguments]
    import suspension_fmus

    sys.exit(getattr(suspension_fmus, ENTRIES[program])())


def run(folder: Path, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The finished program with its output as text."""
    command = [str(BIN / program), *arguments]
    if _CONTEXT is None:
        return subprocess.run(
            command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False, timeout=TIMEOUT
        )
    with tempfile.TemporaryDirectory() as shown:
        outputs = Path(shown) / "stdout", Path(shown) / "stderr"
        process = _CONTEXT.Process(target=_enter, args=(folder, program, arguments, outputs))  # type: ignore[attr-defined]
        process.start()
        process.join(TIMEOUT)
        if process.exitcode is None:
            process.kill()
            raise subprocess.TimeoutExpired(command, TIMEOUT)
        return subprocess.CompletedProcess(command, process.exitcode, *(path.read_text() for path in outputs))


def refused(folder: Path, program: str, *arguments: str) -> str:
    """The message with which the program refuses what it was asked: not a traceback, and not a success."""
    done = run(folder, program, *arguments)
    text = done.stderr + done.stdout
    assert done.returncode in (1, 2), text
    assert "Traceback" not in text
    return " ".join(text.replace("│", " ").split())
