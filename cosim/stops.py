"""Conditions that end a run before its stop time."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cosim.errors import WiringError

if TYPE_CHECKING:
    from cosim.master import Simulation

COMPARE = {">=": operator.ge, ">": operator.gt, "<=": operator.le, "<": operator.lt}


@dataclass(frozen=True)
class StopWhen:
    """Stop at the first instant whose sample fulfils `name` `relation` `value`, e.g. StopWhen("car.x", ">=", 155.0)."""

    name: str
    relation: str
    value: float

    def __post_init__(self) -> None:
        if self.relation not in COMPARE:
            raise WiringError(f"stop condition on '{self.name}': relation is one of {' '.join(COMPARE)}")

    def __str__(self) -> str:
        return f"{self.name} {self.relation} {self.value:g}"


class View:
    """What a stop condition of one's own sees: `view.time` [s] and `view["car.x"]` of recorded or watched variables."""

    def __init__(self, simulation: Simulation):
        self._simulation = simulation
        self.time = 0.0

    def __getitem__(self, name: str) -> float:
        return self._simulation[name]


StopCondition = StopWhen | Callable[[View], bool]


def watched_names(conditions: Iterable[StopCondition]) -> list[str]:
    """The variables stop conditions need."""
    return [c.name for c in conditions if isinstance(c, StopWhen)]


class Stop(Exception):  # noqa: N818
    """A stop condition is fulfilled; the argument is its text."""
