"""Environments that are closed in the end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from point import SETTINGS
from point import point as system_of_a_point

from cosim.gym import SystemEnv


@pytest.fixture
def make(request: pytest.FixtureRequest) -> Callable[..., SystemEnv]:
    """Makes environments of the point, with other settings where some are given; they are closed in the end."""

    def make(system: Any = system_of_a_point, **changes: Any) -> SystemEnv:
        env = SystemEnv(system, **{**SETTINGS, **changes})
        request.addfinalizer(env.close)
        return env

    return make
