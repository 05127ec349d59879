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
    ("line", "words"),
    [
        ("cosim run gpc --speed fast", ["'--speed'", "'fast'", "give a number"]),
        ("cosim run gpc --seed many", ["'--seed'", "'many'", "give a whole number"]),
        ("cosim run gpc --speed 500", ["--speed is 500 km/h; give a number from 2 to 200 km/h"]),
        ("cosim run controlled.py --gain 2,5", ["'--gain'", "'2,5'"]),
        ("cosim run hmmwv --preview sensed", ["give --states estimated"]),
        ("cosim run hmmwv --controller passive --actuators ideal", ["--controller zero --actuators ideal"]),
        ("cosim run controled.py", ["controled.py does not exist; did you mean 'controlled.py'?"]),
        ("cosim run gcp", ["no experiment 'gcp'; did you mean 'gpc'?", "a file of yours, as my_experiment.py"]),
        (
            "cosim sweep controlled.py --vary car.body.mass=2000-3500",
            ["car.body.mass: a range is written LOW:HIGH, for example 2000:3500"],
        ),
        ("cosim sweep gpc --vary speed=30-60", ["speed: a range is written LOW:HIGH, for example 30:60"]),
        (
            "cosim optimise gpc --vary speed=30-60 --minimise J",
            ["speed: a range is written LOW:HIGH, for example 30:60"],
        ),
        ("cosim sweep gpc", ["nothing varies: give --vary NAME=LOW:HIGH, or a file with --design"]),
        ("cosim export controlled.py --fmu a.fmu", ["'pid' is written in Python", "leave it out (--without pid)"]),
        ("cosim export bench --web a.html --fmi 2", ["--web", "leave --fmi out"]),
        ("cosim fmu QuarterCarBnch", ["no FMU 'QuarterCarBnch'; did you mean 'QuarterCarBench'?"]),
        ("cosim fmu xyzzy", ["no FMU 'xyzzy' (", "QuarterCarBench", "or give the path of a file, NAME.fmu"]),
        ("cosim check QuarterCarBnch", ["did you mean 'QuarterCarBench'?"]),
        (
            "build-fmus --vehicle no_kind.toml",
            ['no_kind.toml: kind is missing: give `kind = "..."` or `base = "..."`', "quarter_car", "sedan"],
        ),
        ("build-fmus Skyhok", ["no FMU named 'Skyhok'; did you mean 'Skyhook'?"]),
    ],
)
def test_mistakes(line: str, words: list[str], folder: Path) -> None:
    said = refused(folder, *line.split())
    for text in words:
        assert text in said
    assert not PYTHON.search(said)


def test_a_hint_names_no_option_that_the_command_does_not_have(folder: Path) -> None:
    said = refused(folder, "cosim", "optimise", "gpc", "--minimise", "J")
    assert "nothing varies: give --vary NAME=LOW:HIGH" in said
    assert "--design" not in said


def test_a_web_page_is_no_fmu(folder: Path) -> None:
    """Who exports a page has made no FMU, and cannot leave components out of one."""
    said = refused(folder, "cosim", "export", "controlled.py", "--web", "a.html")
    assert "'pid' is written in Python" in said
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
