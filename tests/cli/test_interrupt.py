"""Ctrl-C: a message, exit code 130, nothing left running, what was computed kept."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from built import FMUS, BuiltFmus
from programs import BIN, ENVIRONMENT

pytestmark = pytest.mark.skipif(os.name == "nt", reason="sends SIGINT to a process group")

STARTER = (
    "import signal, os, sys; signal.signal(signal.SIGINT, signal.default_int_handler); os.execv(sys.argv[1],"
    " sys.argv[1:])"
)


def interrupt(folder: Path, ready: Path, program: str, *arguments: str, delay: float = 0.0) -> str:
    """Start a program, press Ctrl-C `delay` seconds after something fits `ready`, and return what it printed."""
    process = subprocess.Popen(
        [sys.executable, "-c", STARTER, str(BIN / program), *arguments],
        cwd=folder,
        env=ENVIRONMENT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    end = time.monotonic() + 100
    while process.poll() is None and not list(folder.glob(str(ready))) and time.monotonic() < end:
        time.sleep(0.02)
    assert list(folder.glob(str(ready)))
    time.sleep(delay)
    assert process.poll() is None, process.communicate()[0]
    os.killpg(process.pid, signal.SIGINT)
    text, _ = process.communicate(timeout=300)
    assert process.returncode == 130, text
    assert "Traceback" not in text
    assert gone(process.pid, within=60.0)  # no worker is left; a compiler it had started may finish
    return " ".join(text.split())


def gone(group: int, within: float) -> bool:
    """Whether a process group is empty after at most `within` seconds."""
    end = time.monotonic() + within
    while time.monotonic() < end:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_a_study_keeps_its_finished_runs(built_fmus: BuiltFmus, tmp_path: Path) -> None:  # noqa: ARG001
    text = interrupt(
        tmp_path, Path("results/gpc/.runs/*.lines"), "cosim", "study", "gpc", "--fmus", str(FMUS), "--processes", "2"
    )
    assert "interrupted; finished runs are stored, and the same command continues from there" in text
    assert list((tmp_path / "results" / "gpc" / ".runs").glob("*.lines"))
    assert not (tmp_path / "results" / "gpc" / "report.html").exists()


def test_a_run_keeps_its_recording(built_fmus: BuiltFmus, tmp_path: Path) -> None:  # noqa: ARG001
    text = interrupt(
        tmp_path,
        Path("results/gpc/*.csv"),
        "cosim",
        "run",
        "gpc",
        "--speed",
        "2",
        "--controller",
        "passive",
        "--fmus",
        str(FMUS),
        "--real-time",
        "1",
        delay=0.7,
    )  # without a pace it would be through by then
    assert "interrupted at t =" in text
    if "t = 0 s" not in text:  # a busy machine may have come no further than the initialization
        assert "sine-2kmh-passive.csv contains the run up to" in text
        lines = (tmp_path / "results" / "gpc" / "sine-2kmh-passive.csv").read_text().splitlines()
        assert lines[0].startswith("time [s],car.x [m]")


def test_a_build_keeps_its_finished_fmus(tmp_path: Path) -> None:
    finished, slow = Path("fmus/fmi3/SpeedProfile.fmu"), ("ThreeAxleTrench", "TrenchCrossing")
    text = interrupt(tmp_path, finished, "build-fmus", finished.stem, *slow)
    assert (tmp_path / finished).is_file()
    assert not [p for name in slow for p in tmp_path.rglob(f"{name}.fmu")]
    assert "interrupted; finished FMUs are kept" in text
    assert not list((tmp_path / "fmus").glob("fmi*/*.tmp"))
