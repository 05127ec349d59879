"""Over which FMUs a test is run: those that it is about, so that none passes because there was nothing to do.

What an FMU is and has stands in its model description. So the FMUs are built when tests are collected, by one process
while the others wait; all of them then find the same tests.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
from api import Model
from built import ALL_ARE_ASKED, NAMES, build_all


@cache
def model(name: str) -> Model:
    """What the model description of an FMU says; of FMI 3.0, as both versions are of one declaration."""
    return Model(build_all().path(name, 3))


def applies_to(*traits: Callable[[Model], Any]) -> pytest.MarkDecorator:
    """Run a test over the FMUs for which all of `traits` give something: true, or what the test then loops over."""
    names = [n for n in NAMES if all(trait(model(n)) for trait in traits)]
    if ALL_ARE_ASKED and not names:
        raise ValueError(f"no FMU has the traits {', '.join(t.__name__ for t in traits)}: the test would never be run")
    return pytest.mark.parametrize("name", names)


def continuous(fmu: Model) -> bool:
    """Whether it has derivatives, Model Exchange and a solver."""
    return fmu.is_continuous


def discrete(fmu: Model) -> bool:
    """Whether it is sampled."""
    return not fmu.is_continuous


def inputs(fmu: Model) -> list[str]:
    """Its inputs."""
    return fmu.inputs
