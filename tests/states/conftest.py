"""FMUs of others, small and in C, with states that they serialize (followers), and without (awkward)."""

from __future__ import annotations

from pathlib import Path

import awkward
import pytest
from foreign import followers


@pytest.fixture(scope="session")
def follower(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """`follower.c` as FMU by FMI version."""
    folder = tmp_path_factory.mktemp("followers")
    return {version: followers.build(version, folder) for version in (2, 3)}


@pytest.fixture(scope="session")
def awkward_fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """`awkward.c` as FMU by FMI version."""
    folder = tmp_path_factory.mktemp("awkward")
    return {
        v: awkward.archive(folder / f"awkward{v}.fmu", awkward.description(v), binary=awkward.library(v, folder))
        for v in (2, 3)
    }
