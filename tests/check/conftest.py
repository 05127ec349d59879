"""FMUs with one fault each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from foreign.faulty import build


@pytest.fixture(scope="session")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int, str], Path]:
    """The FMU of a version with a fault."""
    folder = tmp_path_factory.mktemp("faulty")
    return lambda version, fault="": build(version, folder, fault)
