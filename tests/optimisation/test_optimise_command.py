"""`cosim optimise`: a search whose answer is known, interrupted and continued, and what users do wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from cosim.cli import app

SYSTEM = """
from cosim import PythonComponent, System

STOP_TIME = 0.02
RECORD = ["bowl.a"]


class Bowl(PythonComponent):
    outputs = ("a",)
    parameters = {"x": 0.0, "y": 0.0}

    def start(self, u, y):
        y[0] = 0.0

    def step(self, t, h, u, y):
        if self.x > 1.9:
            raise ValueError("over the edge")
        y[0] = (self.x - 1.0) ** 2 + self.y**2


def system(name: str = "round"):
    made = System()
    made.add("bowl", Bowl(), step="10 ms")
    return made


def measure(run):
    a = float(run.recording["bowl.a"][-1])
    return {"depth": a, "height": -a, "width": a + (0.0 if run.case.name == "round" else 5.0)}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bowl.py").write_text(SYSTEM)
    return tmp_path


def run(*arguments: str, good: bool = True) -> str:
    done = CliRunner().invoke(app, ["optimise", "bowl.py", "--processes", "1", *arguments])
    failed = done.exception is not None and not isinstance(done.exception, SystemExit)
    text = " ".join((str(done.exception) if failed else done.output).split())
    assert (done.exit_code == 0) == good, text
    return text


VARY = ("--vary", "bowl.x=-2:2", "--vary", "bowl.y=-1:1")


def test_a_search_continues_and_finds_the_bottom(folder: Path) -> None:
    search = ("--vary", "bowl.x=-2:2", "--minimise", "depth")
    run(*search, "--trials", "8")
    trials = folder / "results" / "bowl" / "optimise" / "trials.log"
    before = trials.read_text()
    text = run(*search, "--trials", "24")
    assert trials.read_text().startswith(before)
    assert "best: depth" in text
    page = json.loads((folder / "results" / "bowl" / "optimise" / "summary.json").read_text())
    assert page["experiment"] == "bowl-optimise"
    found = float(text.split("best: depth ")[1].split(",")[0])
    assert 0 <= found < 0.05


def test_several_objectives(folder: Path) -> None:
    """`height` is minus `depth`, so every trial that gives numbers is on the front."""
    text = run(*VARY, "--minimise", "depth", "--minimise", "height", "--trials", "8")
    assert "and 3 more Pareto-optimal trials" in text
    assert (folder / "results" / "bowl" / "optimise" / "report.html").is_file()


def test_texts_are_chosen_among(folder: Path) -> None:  # noqa: ARG001
    text = run("--vary", "name=round,square", "--minimise", "width", "--trials", "8")
    assert "best: width 1, name round" in text


@pytest.mark.parametrize(
    "arguments",
    [
        VARY,
        ("--minimise", "depth"),
        (*VARY, "--minimise", "depth", "--log", "bowl.z"),
        (*VARY, "--minimise", "depth", "--log", "bowl.x"),
        ("--vary", "bowl.x=normal(0,1)", "--minimise", "depth"),
        ("--vary", "bowl.z=0:1", "--minimise", "depth"),
        (*VARY, "--minimise", "dept", "--trials", "2"),
        (*VARY, "--minimise", "depth", "--maximise", "depth"),
        (*VARY, "--minimise", "depth", "--minimise", "depth"),
        (*VARY, "--maximise", "depth", "--maximise", "depth"),
    ],
    ids=" ".join,
)
def test_what_users_do_wrong(arguments: tuple[str, ...], sentence) -> None:
    sentence(run(*arguments, good=False))


def test_trials_of_another_model_are_not_continued(folder: Path, sentence) -> None:  # noqa: ARG001
    """A fixed option was changed in between; code and FMUs count in the same way."""
    search = (*VARY, "--minimise", "width", "--trials", "4")
    run(*search)
    sentence(run(*search, "--name", "square", good=False))
    first = run(*search)
    anew = run(*search, "--name", "square", "--force")
    width, other = (float(text.split("best: width ")[1].split(",")[0]) for text in (first, anew))
    assert width < 5.0 < other


def test_another_search_is_not_continued(folder: Path, sentence) -> None:  # noqa: ARG001
    """The message names options of the command that help."""
    run(*VARY, "--minimise", "depth", "--trials", "2")
    sentence(run(*VARY, "--minimise", "width", "--trials", "2", good=False))
    run(*VARY, "--minimise", "width", "--trials", "2", "--out", "other")
    run(*VARY, "--minimise", "width", "--trials", "2", "--force")


def test_a_name_that_was_wrong_can_be_mended(folder: Path, sentence) -> None:  # noqa: ARG001
    sentence(run(*VARY, "--minimise", "dept", "--trials", "40", good=False))
    run(*VARY, "--minimise", "depth", "--trials", "4")
