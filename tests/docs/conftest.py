"""The third-party FMU of the pages."""

from __future__ import annotations

from pathlib import Path

import pytest
from pages import ROOT
from pythonfmu import builder


@pytest.fixture
def seat(workplace: Path) -> Path:
    """The FMU in `path/to/` of the page on third-party FMUs, made by PythonFMU from its source in `docs/examples`."""
    folder = workplace / "path" / "to"
    folder.mkdir(parents=True)
    return Path(builder.FmuBuilder.build_FMU(ROOT / "docs" / "examples" / "seat.py", dest=folder))
