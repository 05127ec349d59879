"""FMUs of others, small and in C, and exported systems of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from foreign import followers


@pytest.fixture(scope="session")
def follower(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """`follower.c` as FMU by FMI version."""
    folder = tmp_path_factory.mktemp("followers")
    return {version: followers.build(version, folder) for version in (2, 3)}
