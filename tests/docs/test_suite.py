"""`make test` runs all tests that there are, snapshots of sentences hold, and the lines of all pages are short."""

from __future__ import annotations

import re
import warnings
from fnmatch import fnmatch
from pathlib import Path

import pytest
from pages import PAGES, ROOT

from benchmarks.lines import THIRD_PARTY

LONGEST_LINE = 120  # as of code, see pyproject.toml
NO_TEXT = re.compile(r"\]\([^)]*\)")  # a link's target cannot be broken


def test_no_folder_of_tests_is_passed_over(pytestconfig: pytest.Config) -> None:
    """By default pytest skips folders of some names, such as `build`."""
    passed_over = pytestconfig.getini("norecursedirs")
    assert passed_over
    for file in (ROOT / "tests").rglob("test_*.py"):
        for folder in file.relative_to(ROOT).parts[:-1]:
            assert not [p for p in passed_over if fnmatch(folder, p)], file


@pytest.mark.parametrize("snapshot", ["<folder>/a.fmu is too large"])
def test_a_sentence_that_differs_from_its_snapshot_fails(tmp_path: Path, sentence, raises, warns) -> None:
    """Here the snapshot is a text, so nothing renews it."""
    said = f"{tmp_path}/a.fmu is too large"
    sentence(said)
    with raises(ValueError):
        raise ValueError(said)
    with warns(UserWarning):
        warnings.warn(said, stacklevel=1)
    for other in (f"{tmp_path}/a.fmu is too small", "/a.fmu is too large", f"{said}.", ""):
        with pytest.raises(AssertionError):
            sentence(other)
        with pytest.raises(AssertionError), raises(ValueError):
            raise ValueError(other)
        with pytest.raises(AssertionError), warns(UserWarning):
            warnings.warn(other, stacklevel=1)
    with pytest.raises(ValueError, match="large"), raises(TypeError):
        raise ValueError(said)
    with pytest.raises(pytest.fail.Exception), raises(ValueError):
        pass


@pytest.mark.parametrize("page", [*PAGES, ROOT / "benchmarks" / "README.md"], ids=lambda p: f"{p.parent.name}/{p.name}")
def test_lines_of_markdown_are_short(page: Path) -> None:
    """Rows of tables have no limit: Markdown has no way to break them."""
    lines = enumerate(page.read_text(encoding="utf-8").splitlines(), start=1)
    assert [n for n, line in lines if line[:1] != "|" and len(NO_TEXT.sub("]()", line)) > LONGEST_LINE] == []


def test_lines_of_code_other_than_python_are_short() -> None:
    """Lines of Python are checked by ruff."""
    folders = ("build_fmus", "cosim", "fmu_sources", "benchmarks", "docs", "tests")
    files = [f for d in folders for e in ("c", "h", "js", "mjs", "css") for f in (ROOT / d).rglob(f"*.{e}")]
    own = [f for f in files if THIRD_PARTY not in f.parts]
    assert len(own) > 50
    assert [
        f"{f.relative_to(ROOT)}:{n}"
        for f in own
        for n, line in enumerate(f.read_text(encoding="utf-8").splitlines(), start=1)
        if len(line) > LONGEST_LINE
    ] == []
