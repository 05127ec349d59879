"""What users of `cosim` can do wrong: each message names the thing and says what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from awkward import archive, description
from built import FMUS, BuiltFmus
from programs import refused, run

from cosim import Recording


@pytest.fixture
def folder(built_fmus: BuiltFmus, tmp_path: Path) -> Path:  # noqa: ARG001
    """A folder with FMUs, and with a file that is none."""
    (tmp_path / "fmus").symlink_to(FMUS, target_is_directory=True)
    (tmp_path / "file").write_text("[not an FMU]\n")
    return tmp_path


@pytest.mark.parametrize(
    "arguments",
    [
        ["--road", "sien"],
        ["--controller", "previw"],
        ["--speed", "0"],
        ["--speed", "500"],
        ["--weight", "-1"],
        ["--hold"],
        ["--fmus", "nowhere"],
        ["--vehicle", "none.toml"],
        ["--out", "file/results"],
    ],
    ids=" ".join,
)
def test_mistakes_in_a_run(arguments: list[str], folder: Path, sentence) -> None:
    sentence(refused(folder, "cosim", "run", "gpc", *arguments))


@pytest.mark.parametrize(
    "arguments",
    [
        ["study", "gpc", "--out", "file/results"],
        ["study", "gcp"],
        ["run", "ride", "--course", "junk.toml"],
        ["runn"],
        ["identify", "gpc", "--excitation", "nan"],
        ["identify", "gpc", "--weight", "0"],
        ["identify", "gpc", "--out", "file/results"],
        ["identify", "gpc", "--order", "0"],
        ["run", "hmmwv", "--road", "trak"],
        ["run", "hmmwv", "--controller", "passive", "--actuators", "ideal"],
        ["run", "hmmwv", "--preview", "sensed"],
        ["run", "bench", "--controller", "mcp"],
        ["run", "bench", "--duration", "0"],
        ["run", "bench", "--real-time", "0"],
        ["run", "bench", "--tolerance", "2"],
        ["run", "bench", "--real-time", "--controller", "mcp"],  # its factor may be left out
    ],
    ids=" ".join,
)
def test_mistakes_elsewhere(arguments: list[str], folder: Path, sentence) -> None:
    sentence(refused(folder, "cosim", *arguments))


@pytest.mark.parametrize(
    ("command", "option", "value"),
    [
        ("run gpc", "--speed", "fast"),
        ("run gpc", "--fmi", "4"),
        ("study gpc", "--processes", "0"),
        ("run bench", "--real-time", "fast"),
    ],
)
def test_values_that_the_parser_refuses(command: str, option: str, value: str, folder: Path) -> None:
    assert f"'{option}'" in refused(folder, "cosim", *command.split(), option, value)


def test_a_run_that_keeps_pace_says_how_well(folder: Path) -> None:
    said = run(folder, "cosim", "run", "bench", "--controller", "passive", "--real-time", "100").stderr
    assert "100 times real time: " in said
    assert " overruns, the latest " in said


def test_steps_that_follow_a_tolerance_are_told_and_change_a_coupled_system_by_no_more(folder: Path) -> None:
    peaks = {}
    for tolerance in ((), ("--tolerance", "1e-3")):
        arguments = ["--road", "bump", "--controller", "passive"]
        said = run(folder, "cosim", "run", "hmmwv", *arguments, *tolerance).stderr
        assert ("tolerance 0.001: " in said) == bool(tolerance)
        (file,) = (folder / "results" / "hmmwv").glob("*.csv")
        peaks[tolerance] = np.abs(Recording.read(file)["car.body.az"]).max()
    fixed, adaptive = peaks.values()
    assert 0 < abs(adaptive / fixed - 1) < 0.02


def test_fmus_of_a_vehicle_that_were_not_built(folder: Path, sentence) -> None:
    (folder / "truck.toml").write_text('base = "hmmwv_modified"\nname = "truck"\ndescription = "a truck"\n')
    sentence(refused(folder, "cosim", "run", "gpc", "--vehicle", "truck.toml"))


def test_files_that_are_no_fmus(folder: Path, sentence) -> None:
    whole = (FMUS / "fmi3" / "RoadSine.fmu").read_bytes()
    (folder / "cut.fmu").write_bytes(whole[: len(whole) // 2])
    sentence(refused(folder, "cosim", "fmu", "cut.fmu"))
    sentence(refused(folder, "cosim", "fmu", "file"))
    sentence(refused(folder, "cosim", "fmu", "."))
    sentence(refused(folder, "cosim", "fmu", "fmus/fmi3/GpcPreveiw.fmu"))


def test_fmus_that_deviate_from_the_standard(folder: Path, sentence) -> None:
    """They are shown with what deviates; --strict refuses them, and a limit that is too low for one can be raised."""
    xml = description(2, '<ScalarVariable name="wheel" valueReference="0"><Real min="2" max="1"/></ScalarVariable>')
    archive(folder / "odd.fmu", xml)
    done = run(folder, "cosim", "fmu", "odd.fmu")
    assert done.returncode == 0
    assert "deviations from FMI 2.0 (1)" in done.stdout
    assert "variable 'wheel': min is 2 and max is 1" in done.stdout
    assert "warning" not in done.stderr
    assert "line 2: variable 'wheel': min" in refused(folder, "cosim", "fmu", "odd.fmu", "--strict")
    few = ("cosim", "fmu", "odd.fmu", "--limit", "xml_nodes=10", "--limit")
    sentence(refused(folder, *few, "files=7"))
    sentence(refused(folder, *few, "variable=7"))
    assert run(folder, *few, "xml_nodes=1000").returncode == 0


def test_brackets_in_a_name_survive(folder: Path, sentence) -> None:
    sentence(refused(folder, "cosim", "fmu", "[red].fmu"))


def test_list_and_units_are_shown_in_full(folder: Path) -> None:
    listed = run(folder, "cosim", "list").stdout
    assert "passive|implicit|explicit|preview" in listed
    done = run(folder, "cosim", "run", "gpc", "--controller", "passive", "--speed", "100")
    assert done.returncode == 0, done.stderr
    assert "rms vertical acceleration [m/s2]" in done.stdout
    assert (folder / "results" / "gpc" / "sine-100kmh-passive.csv").is_file()
