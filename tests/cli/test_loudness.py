"""-v and -q of every command, and curves on the screen."""

from __future__ import annotations

import logging
from collections import deque
from pathlib import Path

import pytest
from built import FMUS
from programs import run
from test_help import COSIM

from cosim import Recording
from cosim.fmu.component import _logger

RUN = ("run", "gpc", "--controller", "passive", "--speed", "100", "--fmus", str(FMUS))


@pytest.mark.parametrize("words", COSIM, ids=" ".join)
def test_every_command_can_be_loud_and_quiet(words) -> None:
    assert {"-v", "-q"} <= {name for option in COSIM[words].params for name in option.opts}


@pytest.mark.usefixtures("built_fmus")
def test_quiet_leaves_results_and_errors(tmp_path: Path) -> None:
    loud, quiet = (run(tmp_path, "cosim", *RUN, *more) for more in ((), ("-q",)))
    assert loud.returncode == 0, loud.stderr
    assert loud.stdout == quiet.stdout
    assert "real time" in loud.stderr
    assert (quiet.returncode, quiet.stderr) == (0, "")
    failed = run(tmp_path, "cosim", "run", "bench", "-q", "--fmus", "nowhere")
    assert failed.returncode == 1
    assert "nowhere" in failed.stderr


@pytest.mark.usefixtures("built_fmus")
def test_bars_on_the_screen_are_those_of_the_metrics(tmp_path: Path) -> None:
    """Per cent of the baseline, as the table above them says."""
    controlled = [a for a in RUN if a not in ("--controller", "passive")]
    done = run(tmp_path, "cosim", *controlled, "--bars")
    assert done.returncode == 0, done.stderr
    shown = {
        line.split("█")[0].strip(): int(line.rstrip(" %").split()[-1])
        for line in done.stdout.splitlines()
        if "█" in line
    }
    assert set(shown) >= {"rms pitch", "rms vertical acceleration"}
    (heading,) = (line for line in done.stdout.splitlines() if "per cent of" in line)
    rows = {line.split("  ")[0].strip(): line.split() for line in done.stdout.splitlines() if "[rad]" in line}
    base, value = map(float, rows["rms pitch [rad]"][-2:])
    assert shown["rms pitch"] == pytest.approx(100 * value / base, abs=0.6)
    assert heading.endswith("per cent of passive:")
    assert "no bars: they are shares of a baseline" in run(tmp_path, "cosim", *RUN, "--bars").stderr


@pytest.mark.usefixtures("built_fmus")
def test_a_curve_on_the_screen_is_that_of_the_file(tmp_path: Path) -> None:
    done = run(tmp_path, "cosim", *RUN, "--plot", "car.body.az")
    assert done.returncode == 0, done.stderr
    assert "car.body.az [m/s2]" in done.stdout
    recording = Recording.read(next(tmp_path.glob("results/gpc/*.csv")))
    labels = [line.split()[0] for line in done.stdout.splitlines() if "│" in line and line.split("│")[0].strip()]
    assert labels == [f"{v:.4g}" for v in (recording["car.body.az"].max(), recording["car.body.az"].min())]
    missing = run(tmp_path, "cosim", *RUN, "--plot", "car.body.ay2")
    assert "--plot car.body.ay2: this variable is not recorded; did you mean 'car.body.az'?" in missing.stderr
    assert "response objective" not in missing.stdout
    assert "\x1b" not in done.stdout  # no colors into a pipe


def test_what_fmus_log_goes_to_the_logger_of_python(caplog) -> None:
    """Under the component's name; the five states of FMI by how bad they are."""
    log = _logger("car", deque(), deque())
    with caplog.at_level(logging.DEBUG, "cosim.fmu"):
        for status in range(5):
            log(status, "logStatus", "text ")
    assert [r.levelno for r in caplog.records] == [logging.DEBUG, logging.WARNING, *[logging.ERROR] * 3]
    assert caplog.records[1].getMessage() == "car: [Warning] logStatus: text"
