"""What users of `cosim` can do wrong: each message names the thing and says what to do."""

from __future__ import annotations

from pathlib import Path

import pytest
from awkward import archive, description
from built import FMUS, BuiltFmus
from programs import refused, run


@pytest.fixture
def folder(built_fmus: BuiltFmus, tmp_path: Path) -> Path:  # noqa: ARG001
    """A folder with FMUs, and with a file that is none."""
    (tmp_path / "fmus").symlink_to(FMUS, target_is_directory=True)
    (tmp_path / "file").write_text("[not an FMU]\n")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--road", "sien"], "no road 'sien'; did you mean 'sine'? (there are: sine, curb, perryman3)"),
        (["--controller", "previw"], "no controller 'previw'; did you mean 'preview'?"),
        (["--speed", "0"], "--speed is 0 km/h; give a number from 2 to 200 km/h"),
        (["--speed", "500"], "speed is 500 km/h; give a number from 2 to 200 km/h"),
        (["--speed", "fast"], "Invalid value for '--speed'"),
        (["--weight", "-1"], "weight is -1 1/N2; give a number from 1e-30 to 1e+30 1/N2"),
        (["--hold"], "--hold is for the explicit controller only"),
        (["--fmi", "4"], "Invalid value for '--fmi'"),
        (["--fmus", "nowhere"], "run `build-fmus --out nowhere` first"),
        (["--vehicle", "none.toml"], "--vehicle none.toml: no such file"),
        (["--out", "file/results"], "cannot write to file/results/gpc (Not a directory); choose another directory"),
    ],
)
def test_mistakes_in_a_run(arguments: list[str], message: str, folder: Path) -> None:
    assert message in refused(folder, "cosim", "run", "gpc", *arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["study", "gpc", "--processes", "0"], "Invalid value for '--processes'"),
        (["study", "gpc", "--out", "file/results"], "cannot write to file/results/gpc"),
        (
            ["study", "gcp"],
            (
                "no experiment 'gcp'; did you mean 'gpc'? (there are: bench, gpc, hmmwv, preview-lq, ride, three-axle,"
                " trench); or a file of yours"
            ),
        ),
        (
            ["run", "ride", "--course", "junk.toml"],
            "no course 'junk.toml' (there are: 1in, 2in, 4in, half-round); or a file NAME.crg",
        ),
        (["runn"], "no command 'runn'; did you mean 'run'?"),
        (["identify", "gpc", "--excitation", "nan"], "--excitation is nan; give a finite number above 0"),
        (["identify", "gpc", "--weight", "0"], "--weight is 0; give a finite number above 0"),
        (["identify", "gpc", "--out", "file/results"], "cannot write to file/results/gpc/laws"),
        (["identify", "gpc", "--order", "0"], "order is 0; give a whole number of at least 1"),
        (["run", "hmmwv", "--road", "trak"], "no road 'trak'; did you mean 'track'?"),
        (["run", "hmmwv", "--controller", "passive", "--actuators", "ideal"], "--controller zero --actuators ideal"),
        (["run", "hmmwv", "--preview", "sensed"], "give --states estimated"),
        (["run", "bench", "--controller", "mcp"], "no controller 'mcp'; did you mean 'mpc'?"),
        (["run", "bench", "--duration", "0"], "duration is 0 s; give a number from 0.01 to 3 s"),
        (["run", "bench", "--real-time", "0"], "--real-time is 0.0; give a positive number"),
        (["run", "bench", "--real-time", "fast"], "Invalid value for '--real-time'"),
        (["run", "bench", "--real-time", "--controller", "mcp"], "no controller 'mcp'"),  # its factor may be left out
    ],
)
def test_mistakes_elsewhere(arguments: list[str], message: str, folder: Path) -> None:
    assert message in refused(folder, "cosim", *arguments)


def test_a_run_that_keeps_pace_says_how_well(folder: Path) -> None:
    said = run(folder, "cosim", "run", "bench", "--controller", "passive", "--real-time", "100").stderr
    assert "100 times real time: " in said
    assert " overruns, the latest " in said


def test_fmus_of_a_vehicle_that_were_not_built(folder: Path) -> None:
    (folder / "truck.toml").write_text('base = "hmmwv_modified"\nname = "truck"\ndescription = "a truck"\n')
    text = refused(folder, "cosim", "run", "gpc", "--vehicle", "truck.toml")
    assert "run `build-fmus --vehicle truck.toml --out fmus` first" in text


def test_files_that_are_no_fmus(folder: Path) -> None:
    whole = (FMUS / "fmi3" / "RoadSine.fmu").read_bytes()
    (folder / "cut.fmu").write_bytes(whole[: len(whole) // 2])
    assert "cut.fmu is not an FMU or is incomplete" in refused(folder, "cosim", "fmu", "cut.fmu")
    assert "file is not an FMU or is incomplete" in refused(folder, "cosim", "fmu", "file")
    assert ". is not an FMU: it holds no modelDescription.xml" in refused(folder, "cosim", "fmu", ".")
    text = refused(folder, "cosim", "fmu", "fmus/fmi3/GpcPreveiw.fmu")
    assert "no such FMU: fmus/fmi3/GpcPreveiw.fmu; did you mean 'GpcPreview.fmu'" in text


def test_fmus_that_deviate_from_the_standard(folder: Path) -> None:
    """They are shown with what deviates; --strict refuses them, and a limit that is too low for one can be raised."""
    xml = description(2, '<ScalarVariable name="wheel" valueReference="0"><Real min="2" max="1"/></ScalarVariable>')
    archive(folder / "odd.fmu", xml)
    done = run(folder, "cosim", "fmu", "odd.fmu")
    assert done.returncode == 0
    assert "deviations from FMI 2.0 (1)" in done.stdout
    assert "variable 'wheel': min is 2 and max is 1" in done.stdout
    assert "warning" not in done.stderr
    assert "strict refuses: line 2: variable 'wheel': min" in refused(folder, "cosim", "fmu", "odd.fmu", "--strict")
    few = ("cosim", "fmu", "odd.fmu", "--limit", "xml_nodes=10", "--limit")
    assert "at most 10 are taken unless --limit xml_nodes=" in refused(folder, *few, "files=7")
    assert "no limit 'variable'; did you mean 'variables'" in refused(folder, *few, "variable=7")
    assert run(folder, *few, "xml_nodes=1000").returncode == 0


def test_brackets_in_a_name_survive(folder: Path) -> None:
    assert "no such FMU: [red].fmu" in refused(folder, "cosim", "fmu", "[red].fmu")


def test_list_and_units_are_shown_in_full(folder: Path) -> None:
    listed = run(folder, "cosim", "list").stdout
    assert "passive|implicit|explicit|preview" in listed
    done = run(folder, "cosim", "run", "gpc", "--controller", "passive", "--speed", "100")
    assert done.returncode == 0, done.stderr
    assert "rms vertical acceleration [m/s2]" in done.stdout
    assert (folder / "results" / "gpc" / "sine-100kmh-passive.csv").is_file()
