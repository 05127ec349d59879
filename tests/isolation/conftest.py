from __future__ import annotations

from pathlib import Path

import pytest
from foreign import followers, hostile


@pytest.fixture(scope="package")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where hostile FMUs are made."""
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="package")
def follower(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The FMU `follower.c` by FMI version."""
    made = tmp_path_factory.mktemp("follower")
    return {version: followers.build(version, made) for version in (2, 3)}


@pytest.fixture(scope="package")
def harmless(folder: Path) -> Path:
    """A small FMU that does nothing wrong."""
    return hostile.build(2, folder, "step", "nothing")
