"""What all tests share: the FMUs of the catalog and of the tests, built once and only when something changed."""

from __future__ import annotations

import pytest
from built import BuiltFmus, build_all


@pytest.fixture(scope="session")
def built_fmus() -> BuiltFmus:
    """All FMUs under test, for this machine, up to date."""
    return build_all()
