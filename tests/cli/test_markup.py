"""Names, units and paths of others hold brackets and colons: they are shown as they are, and nothing ends at them."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import pytest
from foreign.making import redescribed
from programs import BIN

ROOT = Path(__file__).parents[2]
UNIT = "U[red]x[/red]"
SCRIPT = """
from cosim import System

STOP_TIME = 0.01

def system(gain: float = 1.0):
    system = System()
    system.add("a[/b]:warning:", "F.fmu", step="1 ms", parameters={"rate": gain}, start={"u": 1.0})
    return system
"""


@pytest.fixture(scope="module")
def folder(follower: dict[int, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A script whose FMU has units of markup."""
    made = tmp_path_factory.mktemp("markup")
    redescribed(follower[2], made / "F.fmu", (b'"rad"', f'"{UNIT}"'.encode()))
    (made / "mine.py").write_text(SCRIPT)
    return made


def told(folder: Path, *words: str) -> str:
    done = subprocess.run([BIN / "cosim", *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_a_sweep_ends_with_its_report(folder: Path) -> None:
    text = told(
        folder, "sweep", "mine.py", "--vary", "gain=1:2", "--samples", "2", "--processes", "1", "--out", "[/red]"
    )
    assert "report: [/red]/mine/sweep/report.html" in text
    assert any(UNIT in path.read_text() for path in (folder / "[/red]" / "mine" / "sweep").rglob("*.csv"))


def test_a_run_and_an_fmu_show_names_as_they_are(folder: Path) -> None:
    assert "a[/b]:warning:.y last" in told(folder, "run", "mine.py", "--out", "[/red]")
    assert UNIT in told(folder, "fmu", "F.fmu")


def test_no_other_console_reads_markup() -> None:
    """What is printed goes through `build_fmus.base.terminal`, which reads no markup.

    Columns of progress bars have a switch of their own.
    """
    for path in (p for package in ("build_fmus", "cosim", "fmu_sources") for p in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            assert name not in ("from_markup", "render_markup"), path
            if name == "TextColumn":
                assert any(k.arg == "markup" for k in node.keywords), f"{path}: line {node.lineno}"
            if name == "Console" and path.name != "terminal.py":  # of which only the width is used
                assert "Console().width" in path.read_text(encoding="utf-8").splitlines()[node.lineno - 1], (
                    f"{path}: line {node.lineno}"
                )
