"""Completion in shells, from the declaration of the options.

The completions of what is typed, and the scripts in the shells themselves.
"""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest
from click.shell_completion import ShellComplete
from programs import BIN, run

import cosim.cli
from cosim.experiments import EXPERIMENTS
from cosim.experiments.gpc.runs import Case
from cosim.study.case import fields

ROADS = next(list(map(str, f.option.choices)) for f in fields(Case) if f.name == "road")
FILES = None


def fitting(words: list[str]) -> list[str] | None:
    """What the last word may become; FILES where it may be a file."""
    found = ShellComplete(cosim.cli.app, {}, "cosim", "_COSIM_COMPLETE").get_completions(words[:-1], words[-1])
    return FILES if any(item.type != "plain" for item in found) else [item.value for item in found]


@pytest.mark.parametrize(
    ("typed", "found"),
    [
        (["run", "g"], ["gpc", "gpc-readings"]),
        (["run", ""], sorted(EXPERIMENTS)),
        (["run", "my_"], FILES),
        (["run", "gpc", "--road", ""], ROADS),
        (["run", "gpc", "--road", "my_"], FILES),
        (["run", "gpc", "--real"], ["--real-time"]),
        (["completion", "bash", ""], []),
        (["fmu", "My"], FILES),
        (["run", "gpc", "--fmus", ""], FILES),
        (["run", "my.toml", "--o"], []),
        (["identify", ""], ["gpc"]),
        (["lis"], ["list"]),
    ],
)
def test_what_fits(typed, found):
    assert fitting(typed) == found


def test_all_commands_fit_at_the_start_and_all_options_behind_one():
    assert set(fitting([""])) >= {"run", "study", "list", "fmu", "check", "completion"}
    options = fitting(["run", "gpc", "--"])
    assert {f"--{f.name}" for f in fields(Case)} <= set(options)
    assert {"--plot", "--verbose", "--quiet", "--help"} <= set(options)


@pytest.mark.parametrize("shell", cosim.cli.SHELLS)
def test_the_script_is_one_of_its_shell(shell, tmp_path):
    script = run(tmp_path, "cosim", "completion", shell).stdout
    for program in cosim.cli.PROGRAMS:
        assert f"_{program.replace('-', '_').upper()}_COMPLETE={shell}_complete" in script
    if shutil.which(shell):
        subprocess.run([shell, "-n"], input=script, text=True, check=True)


@pytest.mark.parametrize("program", cosim.cli.PROGRAMS)
def test_bash_completes(program, tmp_path):
    """As bash calls it: the words typed, the place of the last one."""
    function = f"_{program.replace('-', '_')}_completion {program}"
    text = (
        f'eval "$({program} completion bash)"; COMP_WORDS=({program} run gp); COMP_CWORD=2; {function}; '
        'echo "${COMPREPLY[@]}"'
    )
    done = subprocess.run(
        ["bash", "-c", text],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}"},
    )
    assert done.stdout.split() == ["gpc", "gpc-readings"]


def test_a_shell_that_is_none(tmp_path, sentence):
    done = run(tmp_path, "cosim", "completion", "bsh")
    assert done.returncode == 1
    sentence(" ".join(done.stderr.split()))
