"""Fixture of the tests of isolated FMUs."""

from __future__ import annotations

from pathlib import Path

import pytest
from foreign import hostile


@pytest.fixture(scope="package")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where hostile FMUs are made."""
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="package")
def harmless(folder: Path) -> Path:
    """A small FMU that does nothing wrong."""
    return hostile.build(2, folder, "step", "nothing")
