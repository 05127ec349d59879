"""Linear algebra has one thread where commands and studies run, unless the user says otherwise."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from build_fmus.base.one_thread import VARIABLES, one_thread
from cosim.study.processes import local_processes

PROGRAM = """
import os, sys
import suspension_fmus
sys.argv = ["cosim", "--version"]
try:
    suspension_fmus.cosim_command()
except SystemExit:
    pass
print(*(os.environ[name] for name in sys.stdin.read().split()))
"""


@pytest.mark.parametrize(("own", "found"), [({}, ["1", "1", "1"]), ({"OPENBLAS_NUM_THREADS": "3"}, ["3", "1", "1"])])
def test_a_command_has_one_thread(own: dict[str, str], found: list[str]) -> None:
    environment = {k: v for k, v in os.environ.items() if k not in VARIABLES}
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**environment, **own},
        input=" ".join(VARIABLES),
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.split()[-3:] == found


def test_workers_have_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    with local_processes(1) as pool:
        assert [pool.submit(os.getenv, name).result() for name in VARIABLES] == ["1"] * len(VARIABLES)


def test_in_this_process_until_numpy_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLES[0], "7")
    monkeypatch.delenv(VARIABLES[1], raising=False)
    one_thread()
    assert [os.environ[name] for name in VARIABLES[:2]] == ["7", "1"]
