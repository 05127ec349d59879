"""What the commands tell: help with units and choices, versions, and lists that other programs can read."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Collection
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from built import FMUS, BuiltFmus
from click.testing import CliRunner
from programs import BIN, ENVIRONMENT, run

import cosim.cli
import fmu_sources.cli
from build_fmus.base import terminal
from build_fmus.compile import PLATFORMS
from cosim.experiments.bench import runs as bench
from cosim.experiments.gpc import runs as gpc
from cosim.experiments.handling import runs as handling
from cosim.experiments.hmmwv import runs as hmmwv
from cosim.experiments.preview_lq import runs as preview_lq
from cosim.experiments.ride import runs as ride
from cosim.experiments.semi_active import runs as semi_active
from cosim.experiments.three_axle import runs as three_axle
from cosim.experiments.trench import runs as trench
from fmu_sources.catalog import default_catalog


def commands(group: Any, path: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    """All commands below a group, by the words that call them."""
    found = {}
    for name in getattr(group, "list_commands", lambda _: ())(None):
        command = group.get_command(None, name)
        found |= commands(command, (*path, name)) or {(*path, name): command}
    return found


COSIM = commands(cosim.cli.app)


def help_of(*words: str, app: Any = cosim.cli.app) -> str:
    """A command's help, on one line."""
    result = CliRunner().invoke(app, [*words, "--help"])
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())


@pytest.mark.parametrize("words", COSIM, ids=" ".join)
def test_help_texts_are_shown_as_they_are_written(words: tuple[str, ...]) -> None:
    shown = help_of(*words).replace(" ", "")  # lines are broken at hyphens too
    texts = [COSIM[words].help, *(p.help for p in COSIM[words].params)]
    for text in filter(None, texts):
        assert "".join(text.split()) in shown


def test_units_are_in_the_help() -> None:
    assert "speed [km/h]" in help_of("run", "gpc")
    assert "control weight R [1/N2]" in help_of("run", "gpc")
    assert "sample time of the controller of --weights [s]" in help_of(app=fmu_sources.cli.app)


GPC: dict[str, Collection[str]] = {
    "--road": [*gpc.ROADS, "FILE.fmu"],
    "--controller": gpc.CONTROLLERS,
    "--disturbance": gpc.DISTURBANCES,
    "--actuator": ("wheel", "spring"),
}
HMMWV: dict[str, Collection[str]] = {
    "--road": hmmwv.ROADS,
    "--controller": hmmwv.CONTROLLERS,
    "--actuators": hmmwv.ACTUATORS,
    "--states": hmmwv.STATES,
    "--preview": hmmwv.PREVIEWS,
    "--terrain": hmmwv.CLASSES,
}
TRENCH: dict[str, Collection[str]] = {"--controller": trench.CONTROLLERS, "--spin": ("body", "road")}
CHOICES = {
    "bench": {"--controller": bench.CONTROLLERS, "--road": bench.ROADS},
    "gpc": GPC,
    "gpc-readings": GPC,
    "handling": {
        "--car": handling.CARS,
        "--manoeuvre": handling.MANOEUVRES,
        "--road": handling.ROADS,
        "--terrain": hmmwv.CLASSES,
        "--controller": handling.CONTROLLERS,
        "--design": handling.DESIGNS,
        "--actuators": hmmwv.ACTUATORS,
    },
    "hmmwv": HMMWV,
    "hmmwv-readings": HMMWV,
    "preview-lq": {
        "--input": preview_lq.INPUTS,
        "--weights": [*preview_lq.WEIGHTED_CONTROLLERS, "FILE.toml"],
        "--controller": preview_lq.CONTROLLERS,
        "--shape": preview_lq.SHAPES,
    },
    "ride": {
        "--car": ride.CARS,
        "--controller": ride.CONTROLLERS,
        "--actuators": hmmwv.ACTUATORS,
        "--course": [*ride.NUMBER, "FILE.crg"],
        "--sides": ride.SIDES,
    },
    "semi-active": {
        "--controller": semi_active.CONTROLLERS,
        "--actuators": semi_active.ACTUATORS,
        "--road": semi_active.ROADS,
        "--terrain": hmmwv.CLASSES,
    },
    "three-axle": {"--controller": three_axle.CONTROLLERS, "--estimator": three_axle.ESTIMATORS},
    "trench": TRENCH,
    "trench-readings": TRENCH,
}


@pytest.mark.parametrize("experiment", CHOICES)
def test_choices_are_listed_and_a_wrong_one_names_them(experiment: str, tmp_path: Path) -> None:
    """Every option of text is one of these, and takes nothing else."""
    shown = help_of("run", experiment)
    choices = CHOICES[experiment]
    for option, names in choices.items():
        assert re.search(
            rf"{option}(, --\S+)* {re.escape('|'.join(names))} ", shown
        )  # earlier names of the option beside it
        refused = CliRunner().invoke(cosim.cli.app, ["run", experiment, option, "xyzzy", "--out", str(tmp_path)])
        known = ", ".join(n for n in names if not n.startswith("FILE"))
        files = "".join(f"; or a file {n.replace('FILE', 'NAME')}" for n in names if n.startswith("FILE"))
        assert str(refused.exception).endswith(f"'xyzzy' (there are: {known}){files}")
    free = {p.opts[0] for p in COSIM["run", experiment].params if isinstance(p.default, str)}
    assert free == choices.keys()


def test_choices_of_build_fmus() -> None:
    shown = help_of(app=fmu_sources.cli.app)
    assert "--fmi 2|3|both " in shown
    assert "--qp daqp|osqp " in shown
    assert f"--platform host|all|{'|'.join(PLATFORMS)} " in shown


@pytest.mark.parametrize("program", ["cosim", "build-fmus"])
def test_version(program: str, tmp_path: Path) -> None:
    done = run(tmp_path, program, "--version")
    assert (done.returncode, done.stdout) == (0, f"suspension-fmus {metadata.version('suspension-fmus')}\n")


def piped(folder: Path, *command: str) -> list[str]:
    """Lines that a program prints into a pipe, as called in a narrow terminal."""
    done = subprocess.run(
        [BIN / command[0], *command[1:]],
        cwd=folder,
        env={**ENVIRONMENT, "COLUMNS": "30"},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_lists_in_pipes_are_neither_wrapped_nor_cut(built_fmus: BuiltFmus, tmp_path: Path) -> None:  # noqa: ARG001
    catalog = default_catalog()
    lines = piped(tmp_path, "build-fmus", "--list")
    assert [line.split()[0] for line in lines[1:]] == list(catalog)
    assert all(e.summary in line for e, line in zip(catalog.values(), lines[1:], strict=True))
    lines = piped(tmp_path, "cosim", "list")
    assert [line.split()[0] for line in lines[1:]] == list(CHOICES)
    for experiment, line in zip(CHOICES, lines[1:], strict=True):
        for option, names in CHOICES[experiment].items():
            assert f"{option} {'|'.join(names)}" in line
    lines = piped(tmp_path, "cosim", "fmu", str(FMUS / "fmi3" / "RoadSine.fmu"))
    assert [line for line in lines if line.startswith("system.add(") and line.endswith(")")]
    (row,) = (line for line in lines if line.strip().startswith("road.fl.height"))
    assert row.rstrip().endswith("road height under the fl wheel")


def test_what_is_listed_of_an_experiment() -> None:
    """Derived from its command: units for numbers, names for choices, bare flags; not what all experiments have."""
    line = cosim.cli._options(COSIM["run", "gpc"])
    assert re.search(r"--speed KM/H  --controller passive\|.*--hold  ", line)
    assert "--out" not in line


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("command", [("cosim", "list"), ("build-fmus", "--list")], ids=" ".join)
def test_a_full_disk_under_a_list(command: tuple[str, ...], tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [BIN / command[0], *command[1:]],
            cwd=tmp_path,
            env=ENVIRONMENT,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=300,
        )
    assert done.returncode == 1
    assert (
        done.stderr
        == f"{command[0]}: standard output: No space left on device; free disk space there, or write to another"
        " directory\n"
    )


def test_the_terminal_is_as_wide_as_it_is(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    """On a terminal long cells are folded into its width."""
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    terminal.show("word " * 20)
    assert len(capsys.readouterr().out.splitlines()) == 3


# ---------------------------------------------------------------------------------------------------- the first screens


def test_the_first_screen_has_every_command_in_a_sentence_and_examples_that_work() -> None:
    shown = help_of()
    group = cosim.cli.app
    listed = [n for n in group.list_commands(None) if not group.get_command(None, n).hidden]  # type: ignore[attr-defined, arg-type]
    for name in listed:
        first = re.split(r"\.(?:\s|$)", group.get_command(None, name).help)[0]  # type: ignore[attr-defined, arg-type, union-attr]
        assert f" {name} {' '.join(first.split())}" in shown
    assert " complete " not in shown  # what scripts of shells call
    examples = [line.split("   ")[0].split() for line in cosim.cli.EXAMPLES.splitlines() if line.startswith("  cosim ")]
    assert len(examples) > 4
    for _, *words in examples:
        depth = next(i for i in (2, 1) if tuple(words[:i]) in COSIM)
        COSIM[tuple(words[:depth])].make_context("x", words[depth:])  # raises where an option is not known


@pytest.mark.parametrize("command", ["run", "study", "sweep", "optimise", "export", "error", "wiring"])
def test_experiments_are_listed_with_what_they_are(command: str) -> None:
    shown = help_of(command)
    assert " trench A 6x6 crosses trenches with preview MPC (paper 003)" in shown
    assert "..." not in shown.partition("Commands:")[2]


HEADINGS = {
    "run": ["Case", "FMUs", "How it runs", "Inputs and results", "Other options"],
    "study": ["Study", "FMUs", "How it runs", "Inputs and results", "Other options"],
    "sweep": ["Case", "Design", "FMUs", "How it runs", "Inputs and results", "Other options"],
    "optimise": ["Case", "Search", "FMUs", "How it runs", "Inputs and results", "Other options"],
    "export": ["Case", "Export", "FMUs", "Other options"],
    "error": ["Case", "Error", "FMUs", "How it runs", "Other options"],
    "wiring": ["Case", "Picture", "FMUs", "Other options"],
}


@pytest.mark.parametrize("command", HEADINGS)
def test_options_are_grouped(command: str) -> None:
    """Each stands in one group; what every command has comes last."""
    output = CliRunner().invoke(cosim.cli.app, [command, "trench", "--help"]).output
    assert re.findall(r"(?m)^([A-Z].*):$", output) == HEADINGS[command]
    groups = dict(zip(HEADINGS[command], re.split(r"(?m)^[A-Z].*:$", output)[1:], strict=True))
    others = re.findall(r"(?m)^  (?:-\w, )?(--[\w-]+)", groups["Other options"])
    assert others == ["--verbose", "--quiet", "--help"]
    shown = re.findall(r"(?m)^  (?:-\w, )?(--[\w-]+)", output)
    assert sorted(shown) == sorted({*(p.opts[0] for p in COSIM[command, "trench"].params), "--help"})
    if "Case" in groups:
        assert re.findall(r"(?m)^  (--[\w-]+)", groups["Case"])[:3] == ["--length", "--speed", "--controller"]
