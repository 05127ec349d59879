"""Every test of this folder runs over every FMU that it applies to, in both FMI versions.

These are FMUs of the catalog and of the tests.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
from api import Library
from built import NAMES, BuiltFmus


@pytest.fixture(scope="session")
def load(built_fmus: BuiltFmus) -> Callable[[str, int], Library]:
    """Loaded FMUs by name and FMI version, each loaded once."""
    loaded: dict[tuple[str, int], Library] = {}

    def get(name: str, fmi: int) -> Library:
        if (name, fmi) not in loaded:
            loaded[name, fmi] = Library(built_fmus.path(name, fmi))
        return loaded[name, fmi]

    return get


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    """Name of an FMU."""
    return request.param


@pytest.fixture(params=(2, 3), ids=("fmi2", "fmi3"))
def fmu(name: str, request: pytest.FixtureRequest, load: Callable[[str, int], Library]) -> Library:
    """An FMU in one FMI version."""
    return load(name, request.param)


@pytest.fixture
def pair(name: str, load: Callable[[str, int], Library]) -> tuple[Library, Library]:
    """An FMU in FMI 2.0 and in FMI 3.0."""
    return load(name, 2), load(name, 3)
