"""A half-round as a rolling wheel meets it: the half cylinder across the road of mobility tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True)
class RolledHalfRound:
    """Path of a disc of `wheel` [m] radius over a half-round: an arc about its axis.

    The half cylinder has a radius of `height` [m] and lies at `place` [m].
    """

    height: Any
    wheel: Any
    place: Any
    behind: Any

    @property
    def end(self) -> Any:
        """[m]."""
        return self.place + self.behind

    def at(self, x: Any, _side: str) -> tuple[Any, Any]:
        """Height [m] and slope at a column of positions [m]; both sides are the same."""
        s, together = x - self.place, self.height + self.wheel
        over = s**2 < together**2 - self.wheel**2
        root = ca.sqrt(ca.if_else(over, together**2 - s**2, together**2))
        return ca.if_else(over, root - self.wheel, 0), ca.if_else(over, -s / root, 0)
