"""Names that the terminal or the locale has no characters for: shown escaped, or refused with the remedy."""

import os
import shutil
import subprocess
from pathlib import Path

import awkward
import pytest
from programs import BIN

ASCII_TERMINAL = {"PYTHONIOENCODING": "ascii"}
C_LOCALE = {"LC_ALL": "C"}
ASCII_EVERYWHERE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


def run(folder: Path, locale: dict[str, str], *command: str | Path) -> tuple[int, str]:
    """Exit code, and what the program says."""
    done = subprocess.run(
        [BIN / command[0], *command[1:]],
        cwd=folder,
        env={**os.environ, "COLUMNS": "200", **locale},
        capture_output=True,
        check=False,
        timeout=300,
    )
    text = (done.stdout + done.stderr).decode("utf-8", "surrogateescape")
    assert "Traceback" not in text
    return done.returncode, text


def foreign(folder: Path) -> Path:
    """An FMU with other letters in its name, its variables and its library."""
    variables = '<ScalarVariable name="größe" valueReference="1" causality="output"><Real/></ScalarVariable>'
    xml = awkward.description(2, variables, name="Straße", identifier="Öl")
    library = {f"binaries/{awkward.platform_folder('2')[0]}/Öl.so": awkward.library(2, folder)}
    return awkward.archive(folder / "Straße.fmu", xml, **library)


@pytest.mark.parametrize("locale", [ASCII_TERMINAL, C_LOCALE, ASCII_EVERYWHERE])
def test_an_fmu_is_shown(tmp_path, locale):
    path = foreign(tmp_path)
    code, text = run(tmp_path, locale, "cosim", "fmu", path.name)
    assert code == 0, text
    pasted = text.split("ready to paste:\n")[1]
    record = next(line for line in pasted.splitlines() if line.startswith("recording"))
    recording = record.split("record=")[1]
    assert eval(recording[:-1]) == ["straße.größe"]


def test_a_message_names_what_the_terminal_cannot_show(tmp_path):
    code, text = run(tmp_path, ASCII_TERMINAL, "cosim", "fmu", "Größe.fmu")
    assert code == 1
    assert r"no such FMU: Gr\xf6\xdfe.fmu" in text


def test_names_that_the_locale_has_no_characters_for(tmp_path):
    """Files inside an FMU, and a road file that its FMU would name."""
    foreign(tmp_path)
    shutil.copy(tmp_path / "Straße.fmu", tmp_path / "a.fmu")
    program = "import cosim\nwith cosim.System() as s:\n    s.add('a', 'a.fmu', step=1)\n    s.run(1)\n"
    (tmp_path / "run.py").write_text(f"try:\n    exec({program!r})\nexcept Exception as e:\n    print(ascii(str(e)))\n")
    assert "has no characters for" in run(tmp_path, ASCII_EVERYWHERE, "python", "run.py")[1]
    assert run(tmp_path, C_LOCALE, "python", "-W", "ignore", "run.py") == (0, "")
    (tmp_path / "Straße.csv").write_text("distance [m],left [m],right [m]\n0,0,0\n1,0,0\n", encoding="utf-8")
    code, text = run(tmp_path, ASCII_EVERYWHERE, "build-fmus", "--road", "Straße.csv", "--fmi", "2")
    assert code == 1
    assert "no characters for" in text
    assert "PYTHONUTF8=1" in text
