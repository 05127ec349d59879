"""Files in the working folder that have names of modules are imported by no process that is started there."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest
from awkward import archive, description, library
from built import ROOT
from programs import BIN, TIMEOUT

NAMES = ("signal", "numpy", "random", "struct", "socket", "pickle", "logging", "rich", "distributed")
HOSTILE = 'with open({seen!r}, "a") as file:\n    file.write(__file__ + "\\n")\nraise SystemExit("executed")\n'
FALL = """
from cosim import PythonComponent, System
STOP_TIME = 0.02

class Mass(PythonComponent):
    outputs = ("z [m]",)
    parameters = {"rate": 1.0}

    def step(self, t, h, u, y):
        y[0] = self.rate * t

def system(rate: float = 1.0):
    made = System()
    made.add("mass", Mass(), step="1 ms", parameters={"rate": rate})
    return made
"""
POOL = """
import multiprocessing
from build_fmus.builder import _Pool

def task(name, options, versions):
    import numpy

if __name__ == "__main__":
    multiprocessing.set_start_method("spawn")
    with _Pool() as pool:
        print(sorted(pool.run(task, {"a": (2,), "b": (3,)}, None)))
"""


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A working folder with such files, one with what is run there, and where the files say that they were executed."""
    working, files = tmp_path_factory.mktemp("working"), tmp_path_factory.mktemp("files")
    seen = files / "seen"
    for name in NAMES:
        (working / f"{name}.py").write_text(HOSTILE.format(seen=str(seen)))
    (files / "fall.py").write_text(FALL)
    (files / "pool.py").write_text(POOL)
    archive(files / "a.fmu", description(2), binary=library(2, files))
    return working, files, seen


FALLING = ("sweep", "fall.py", "--vary", "rate=1:2", "--samples", "3")
COMMANDS = {
    "check": ("cosim", "check", "a.fmu", "--only", "states.life"),
    "sweep": ("cosim", *FALLING, "--processes", "2", "--out", "one.out"),
    "dask": ("cosim", *FALLING, "--processes", "1", "--dask", "local", "--out", "two.out"),
    "pool": ("python", "pool.py"),
    "module": ("python", "-m", "cosim", *FALLING, "--processes", "2", "--out", "three.out"),
    "build": ("python", "-m", "build_fmus", "--list"),
    "suspension": ("python", "-m", "suspension_fmus", "list"),
}


@pytest.mark.parametrize("command", COMMANDS)
def test_nothing_is_imported_from_the_working_folder(folders, command):
    working, files, seen = folders
    program, *arguments = COMMANDS[command]
    (working / "cosim.py").unlink(missing_ok=True)
    if "-m" not in arguments:  # which would run it
        (working / "cosim.py").write_text(HOSTILE.format(seen=str(seen)))
    arguments = [str(files / a) if a.endswith((".py", ".fmu", ".out")) else a for a in arguments]
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    done = subprocess.run(
        [BIN / program, *arguments],
        cwd=working,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT,
    )
    assert not seen.exists(), seen.read_text()
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_python_process_is_started_in_one_way():
    """As `build_fmus.base.interpreters` says: no other file names Python's program or starts processes without it."""
    starts, safe = set(), set()
    for path in sorted(p for package in ("build_fmus", "cosim", "fmu_sources") for p in (ROOT / package).rglob("*.py")):
        names = {
            ast.unparse(n) for n in ast.walk(ast.parse(path.read_bytes())) if isinstance(n, ast.Attribute | ast.Name)
        }
        file = path.relative_to(ROOT).as_posix()
        if names & {
            "multiprocessing.get_context",
            "ProcessPoolExecutor",
            "multiprocessing.Process",
            "multiprocessing.Pool",
        }:
            starts.add(file)
        if "safe_path" in names:
            safe.add(file)
        assert "sys.executable" not in names or file in (
            "build_fmus/base/interpreters.py",
            "build_fmus/base/run_as_module.py",  # only for a message
        )
    assert (
        starts
        == safe - {"build_fmus/base/interpreters.py"}
        == {"build_fmus/builder.py", "cosim/study/executors.py", "cosim/study/processes.py"}
    )


def test_programs_of_a_worker_find_their_own_folder(tmp_path):
    """What a user's code starts in a worker is started as ever."""
    (tmp_path / "neighbour.py").write_text("")
    (tmp_path / "helper.py").write_text("import neighbour\n")
    (tmp_path / "script.py").write_text(
        "import subprocess, sys\nfrom cosim.study.processes import local_processes\nif __name__ == '__main__':\n   "
        " with local_processes(1) as pool:\n        print(pool.submit(subprocess.call, [sys.executable,"
        f" {str(tmp_path / 'helper.py')!r}]).result())\n"
    )
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"} | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(tmp_path / "script.py")]
    done = subprocess.run(
        command, cwd=Path(ROOT), env=environment, capture_output=True, text=True, check=False, timeout=TIMEOUT
    )
    assert done.stdout == "0\n", done.stderr
