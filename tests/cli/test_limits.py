"""What the system refuses a command ends in a sentence: closed streams, threads and processes."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from built import ROOT
from programs import BIN, TIMEOUT

pytestmark = pytest.mark.skipif(os.name == "nt", reason="closes descriptors, as shells of Unix do")
LIMIT = (
    "cannot start another thread or process: end other processes, or raise the limit of this user or container (ulimit"
    " -u)\n"
)


@pytest.mark.parametrize("line", ["cosim list", "cosim --help", "cosim completion bash", "build-fmus --list"])
def test_output_that_is_closed(line, tmp_path):
    done = subprocess.run(
        ["sh", "-c", f"exec '{BIN}'/{line} >&-"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=TIMEOUT,
    )
    assert (done.returncode, done.stderr) == (1, f"{line.split()[0]}: standard output is closed\n")


def test_messages_that_are_closed_are_lost_and_no_file_gets_their_descriptor(tmp_path):
    """It would get what is said to people."""
    run = (
        "import sys, os; from build_fmus.base.terminal import open_closed_streams as o; o(); print(open('file',"
        " 'w').fileno() > 2, file=open('told', 'w')); sys.stderr.write('lost')"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["sh", "-c", f'exec "{sys.executable}" -c "{run}" <&- >&- 2>&-'],
        cwd=tmp_path,
        env=environment,
        check=False,
        timeout=TIMEOUT,
    )
    assert done.returncode == 0
    assert ((tmp_path / "told").read_text(), (tmp_path / "file").read_text()) == ("True\n", "")


NO_THREADS = """
import threading
def refuse(*_, **__):
    raise RuntimeError("can't start new thread")
threading._start_new_thread = refuse
"""
NO_PROCESSES = """
import errno, os, subprocess
import _posixsubprocess
def refuse(*_, **__):
    raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
os.fork = _posixsubprocess.fork_exec = subprocess._fork_exec = refuse
"""
FALL = """
from cosim import PythonComponent, System
STOP_TIME = 0.02

class Mass(PythonComponent):
    outputs = ("z [m]",)

    def step(self, t, h, u, y):
        y[0] = t

def system(rate: float = 1.0):
    made = System()
    made.add("mass", Mass(), step="1 ms")
    return made
"""
SWEEP = ("cosim", "sweep", "fall.py", "--vary", "rate=1:2", "--samples", "3", "--processes", "2")
BUILD = ("build-fmus", "RoadSine", "RoadCurb", "--fmi", "3", "--force", "--out", "out")


@pytest.mark.parametrize(
    ("prelude", "arguments", "said"),
    [
        (NO_THREADS, SWEEP, f"cosim: {LIMIT}"),
        (
            NO_PROCESSES,
            SWEEP,
            "cosim: a worker process cannot be started (BlockingIOError); end other processes, or raise the limit"
            " (ulimit -u)\n",
        ),
        (NO_THREADS, BUILD, f"build-fmus: {LIMIT}"),
        (NO_PROCESSES, BUILD, f"build-fmus: {LIMIT}"),
    ],
)
def test_no_further_thread_or_process(prelude, arguments, said, tmp_path):
    (tmp_path / "fall.py").write_text(FALL)
    entry = {"cosim": "cosim_command", "build-fmus": "build_command"}[arguments[0]]
    (tmp_path / "run.py").write_text(
        f"{prelude}\nimport sys, suspension_fmus\nsys.argv = sys.argv[1:]\nsuspension_fmus.{entry}()\n"
    )
    done = subprocess.run(
        [sys.executable, "run.py", *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT,
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert done.stderr.endswith(said)
