"""A folder as the reader of the pages has it: the FMUs in ``fmus/``, a foreign FMU in ``path/to/``."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest
from built import FMUS, BuiltFmus
from pages import ROOT
from pythonfmu import builder


@pytest.fixture
def workplace(built_fmus: BuiltFmus, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:  # noqa: ARG001
    """The current folder while a page's code runs."""
    (tmp_path / "fmus").symlink_to(FMUS, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        yield tmp_path


@pytest.fixture
def seat(workplace: Path) -> Path:
    """The foreign FMU of the README, made by PythonFMU from its source in ``docs/examples``."""
    folder = workplace / "path" / "to"
    folder.mkdir(parents=True)
    return Path(builder.FmuBuilder.build_FMU(ROOT / "docs" / "examples" / "seat.py", dest=folder))
