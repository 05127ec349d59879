"""Conditions that end a run before its stop time."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from cosim.core.errors import WiringError

Timed = Callable[[float], None]  # called with the time [s]
Reader = Callable[[str], float]  # present value of a recorded or watched variable, by its full name
COMPARE = {">=": operator.ge, ">": operator.gt, "<=": operator.le, "<": operator.lt}


@dataclass(frozen=True)
class StopWhen:
    """Stop at the first instant whose sample satisfies `name` `relation` `value`, as StopWhen("car.x", ">=", 155.0)."""

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

    def __init__(self, read: Reader):
        self._read = read
        self.time = 0.0

    def __getitem__(self, name: str) -> float:
        return self._read(name)


StopCondition = StopWhen | Callable[[View], bool]


def watched_names(conditions: Iterable[StopCondition]) -> list[str]:
    """The variables stop conditions need."""
    return [c.name for c in conditions if isinstance(c, StopWhen)]


class Stop(Exception):  # noqa: N818
    """A stop condition is fulfilled; the argument is its text."""


def stop_check(conditions: Sequence[StopCondition], read: Reader) -> Timed | None:
    """What looks at the conditions after a sample at a time [s] and raises Stop; None when there are no conditions."""
    if not conditions:
        return None
    view = View(read)

    def check(t: float) -> None:
        view.time = t
        for condition in conditions:
            if isinstance(condition, StopWhen):
                if COMPARE[condition.relation](read(condition.name), condition.value):
                    raise Stop(str(condition))
            elif condition(view):
                raise Stop(getattr(condition, "__name__", repr(condition)))

    return check
