"""Completion in shells, from the declaration of the options.

The completions of what is typed, and the scripts in the shells themselves.
"""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest
import typer
from programs import BIN, run

import cosim.cli
from build_fmus.base.completion import SCRIPTS, fitting
from cosim.experiments import EXPERIMENTS
from cosim.experiments.gpc.runs import Case
from cosim.study.case import fields

ROOT = typer.main.get_command(cosim.cli.app)
ROADS = next(list(map(str, f.option.choices)) for f in fields(Case) if f.name == "road")


@pytest.mark.parametrize(
    ("typed", "found"),
    [
        (["run", "g"], ["gpc"]),
        (["run", ""], sorted(EXPERIMENTS)),
        (["run", "gpc", "--road", ""], ROADS),
        (["run", "gpc", "--real"], ["--real-time"]),
        (["run", "gpc", "-"], None),
        (["completion", "bash", ""], []),
        (["run", "gpc", "--fmus", ""], []),  # a folder: the shell's own business
        (["run", "my.toml", "--o"], []),
        (["nothing", ""], []),
        (["identify", ""], ["gpc"]),
        (["lis"], ["list"]),
        ([], None),
    ],
)
def test_what_fits(typed, found):
    answer = fitting(ROOT, typed)
    assert len(answer) > 5 if found is None else answer == found


def test_all_commands_fit_at_the_start_and_all_options_behind_one():
    assert set(fitting(ROOT, [""])) >= {"run", "study", "list", "fmu", "check", "completion"}
    options = fitting(ROOT, ["run", "gpc", "--"])
    assert {f"--{f.name}" for f in fields(Case)} <= set(options)
    assert {"--plot", "--verbose", "--quiet", "--help"} <= set(options)


@pytest.mark.parametrize("shell", SCRIPTS)
def test_the_script_is_one_of_its_shell(shell, tmp_path):
    script = run(tmp_path, "cosim", "completion", shell).stdout
    assert script == SCRIPTS[shell]
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True)


def test_bash_completes(tmp_path):
    """As bash calls it: the words typed, the place of the last one."""
    text = 'eval "$(cosim completion bash)"; COMP_WORDS=(cosim run gp); COMP_CWORD=2; _cosim; echo "${COMPREPLY[@]}"'
    done = subprocess.run(
        ["bash", "-c", text],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}"},
    )
    assert done.stdout.split() == ["gpc"]


def test_a_shell_that_is_none(tmp_path, sentence):
    done = run(tmp_path, "cosim", "completion", "bsh")
    assert done.returncode == 1
    sentence(" ".join(done.stderr.split()))
