"""Rows on disk while a system runs: a process that is killed has lost a tenth of a second."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from probes import Integrator

from cosim import CosimError, Recording, System
from cosim.cli import app
from cosim.recording.spool import Spool, read_spool, recover, spool_of

ENDLESS = """
import sys, time
sys.path.insert(0, {here!r})
from probes import Integrator
from cosim import System
class Slow(Integrator):
    def step(self, t, h, u, y):
        super().step(t, h, u, y)
        time.sleep(0.001)
system = System()
system.add("slow", Slow(), step="1 ms", start={{"u": 2.0}})
system.run(1000, output={csv!r})
"""


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """The CSV that a run would have made which is killed while it runs."""
    csv = tmp_path / "out.csv"
    code = ENDLESS.format(here=str(Path(__file__).parent), csv=str(csv))
    process = subprocess.Popen([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": os.getcwd()})
    part = spool_of(csv)
    end = time.monotonic() + 300
    while not (part.is_file() and part.stat().st_size > 16 * 300) and time.monotonic() < end:
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    return csv


def test_a_run_that_was_killed_is_recovered(killed, raises):
    assert killed.stat().st_size == 0
    result = CliRunner().invoke(app, ["recover", str(killed)], env={"COLUMNS": "300"})
    assert result.exit_code == 0, result.output
    recording = Recording.read(killed)
    assert f"{len(recording)} samples of 1 variables" in result.output.replace("\n", " ")
    assert len(recording) > 200
    with System() as system:
        system.add("slow", Integrator(), step="1 ms", start={"u": 2.0})
        whole = system.run(recording.time[-1])
    np.testing.assert_array_equal(recording.time, whole.time)
    np.testing.assert_array_equal(recording["slow.y"], whole["slow.y"])
    assert not spool_of(killed).exists()
    with raises(CosimError):
        recover(killed)


def test_what_is_there_is_not_overwritten(killed, raises):
    killed.write_text("precious\n")
    with raises(CosimError):
        recover(spool_of(killed))
    path, recording = recover(spool_of(killed), killed.with_name("other.csv"))
    assert killed.read_text() == "precious\n"
    assert len(Recording.read(path)) == len(recording)


def test_a_last_row_that_is_not_whole_and_files_of_others(tmp_path, raises):
    spool = Spool(tmp_path / "a.csv.part", ["x", "y"], {"x": "m"})
    spool.add(np.array([0.0, 0.1]), np.array([[1.0, 2.0], [3.0, 4.0]]))
    spool.cut(1)
    spool.add(np.array([0.2]), np.array([[5.0, -0.0]]))
    spool.close(keep=True)
    spool.path.write_bytes(spool.path.read_bytes() + b"\0" * 23)
    recording = read_spool(spool.path)
    np.testing.assert_array_equal(recording.time, [0.0, 0.2])
    np.testing.assert_array_equal(recording.data, [[1.0, 2.0], [5.0, 0.0]])
    assert (recording.names, recording.units) == (["x", "y"], {"x": "m"})
    whole = spool.path.read_bytes()
    for damaged in (
        b"",
        b"time [s],x\n0,1\n",
        whole[:20],
        whole.replace(b"names", b"nomes"),
        whole.replace(b"{", b"[", 1),
    ):
        spool.path.write_bytes(damaged)
        with raises(CosimError):
            read_spool(spool.path)


def test_the_rows_are_the_recording_whatever_is_rolled_back(tmp_path, monkeypatch):
    """Written at every chance here; restored states forget rows, also on disk."""
    monkeypatch.setattr(Spool, "EVERY", 0.0)
    with System() as system:
        system.add("a", Integrator(), step="1 ms", start={"u": 1.0})
        with system.initialize() as simulation:
            spool = Spool(tmp_path / "a.csv.part", simulation.recording.names, simulation.recording.units)
            simulation.spool(spool)
            simulation.advance(0.02)
            state = simulation.save()
            simulation.advance(0.05)
            simulation.restore(state)
            system["a"].implementation.x += 1.0
            simulation.advance(0.04)
            recording = simulation.recording
    written = read_spool(spool.path)
    n = len(written)
    assert n >= len(recording) - 1
    np.testing.assert_array_equal(written.data, recording.data[:n])


def test_nothing_is_left_beside_the_csv(tmp_path):
    with System() as system:
        system.add("a", Integrator(), step="1 ms", start={"u": 1.0})
        system.run(0.1, output=tmp_path / "a.csv")
        assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]
        assert len(Recording.read(tmp_path / "a.csv")) == 101


def test_the_command_says_what_to_do_about_a_wrong_file(tmp_path):
    (tmp_path / "x.csv.part").write_text("no")
    result = CliRunner().invoke(app, ["recover", str(tmp_path / "x.csv")])
    assert result.exit_code != 0
    assert isinstance(result.exception, CosimError | SystemExit)
