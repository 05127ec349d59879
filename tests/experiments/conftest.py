"""What the tests of all experiments share."""

from __future__ import annotations

import pytest
from built import FMUS, BuiltFmus

from cosim.study import FmuSet


@pytest.fixture(scope="session")
def fmus(built_fmus: BuiltFmus) -> FmuSet:  # noqa: ARG001
    """The built FMUs as an experiment takes them."""
    return FmuSet(FMUS)
