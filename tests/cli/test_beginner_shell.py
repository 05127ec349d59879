"""A beginner's mistakes in the shell: each message speaks of options, names the thing and says what to do."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from built import FMUS, BuiltFmus
from programs import refused, run

CONTROLLED = """
from cosim import PythonComponent, System

STOP_TIME = 0.01

class Pid(PythonComponent):
    inputs = ("z [m]",)
    outputs = ("force [N]",)
    default_step = "1 ms"

    def step(self, t, h, u, y):
        y[0] = -self.gain * u[0] if self.gain < 9 else float("nan")

    def __init__(self, gain):
        super().__init__()
        self.gain = gain

def system(gain: float = 1.0):
    made = System()
    made.add("car", "QuarterCarBench")
    made.add("pid", Pid(gain))
    made.connect("car.body.z", "pid.z")
    made.connect("pid.force", "car.force")
    return made
"""
PYTHON = re.compile(r"\w+=(True|False|None|\[|'|\()")  # what an argument looks like


@pytest.fixture
def folder(built_fmus: BuiltFmus, tmp_path: Path) -> Path:  # noqa: ARG001
    """A folder with FMUs and an experiment with a controller in Python."""
    (tmp_path / "fmus").symlink_to(FMUS, target_is_directory=True)
    (tmp_path / "controlled.py").write_text(CONTROLLED)
    (tmp_path / "no_kind.toml").write_text('name = "mine"\ndescription = "mine"\n')
    return tmp_path


@pytest.mark.parametrize(
    "line",
    [
        "cosim run gpc --speed fast",
        "cosim run gpc --seed many",
        "cosim run gpc --speed 500",
        "cosim run controlled.py --gain 2,5",
        "cosim run hmmwv --preview sensed",
        "cosim run hmmwv --controller passive --actuators ideal",
        "cosim run controled.py",
        "cosim run gcp",
        "cosim sweep controlled.py --vary car.body.mass=2000-3500",
        "cosim sweep gpc --vary speed=30-60",
        "cosim optimise gpc --vary speed=30-60 --minimise J",
        "cosim sweep gpc",
        "cosim export controlled.py --fmu a.fmu",
        "cosim export bench --web a.html --fmi 2",
        "cosim fmu QuarterCarBnch",
        "cosim check QuarterCarBnch",
        "build-fmus --vehicle no_kind.toml",
        "build-fmus Skyhok",
    ],
)
def test_mistakes(line: str, folder: Path, sentence) -> None:
    said = refused(folder, *line.split())
    sentence(said)
    assert not PYTHON.search(said)


def test_a_name_with_nothing_close_lists_the_fmus(folder: Path) -> None:
    said = refused(folder, "cosim", "fmu", "xyzzy")
    assert "QuarterCarBench" in said
    assert "NAME.fmu" in said


def test_a_hint_names_no_option_that_the_command_does_not_have(folder: Path, sentence) -> None:
    said = refused(folder, "cosim", "optimise", "gpc", "--minimise", "J")
    sentence(said)
    assert "--design" not in said


def test_a_web_page_is_no_fmu(folder: Path, sentence) -> None:
    """Who exports a page has made no FMU, and cannot leave components out of one."""
    said = refused(folder, "cosim", "export", "controlled.py", "--web", "a.html")
    sentence(said)
    assert "an FMU" not in said
    assert "--without" not in said


@pytest.mark.parametrize("command", ["run", "study"])
def test_values_that_are_not_finite(command: str, folder: Path) -> None:
    """`allow_nan` is an argument, for which no command has an option; `study` runs in another process."""
    done = run(folder, "cosim", command, "controlled.py", "--gain", "9")
    said = done.stdout + done.stderr
    assert done.returncode == 1
    assert "pid.force" in said or "force is nan" in said
    assert "allow_nan" not in said


def test_unconnected_inputs(folder: Path) -> None:
    done = run(folder, "cosim", "run", "controlled.py")
    assert done.returncode == 0
    assert "unconnected inputs keep their start values: car.road.height" in done.stderr
    assert not PYTHON.search(done.stderr)


def test_names_of_fmus_in_commands(folder: Path) -> None:
    shown = run(folder, "cosim", "fmu", "QuarterCarBench").stdout
    assert "QuarterCarBench  (FMI 3.0" in shown
    assert "fmus/fmi3/QuarterCarBench.fmu" in shown
