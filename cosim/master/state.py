"""Saved states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cosim.component import Array
from cosim.master.exchange import Exchange, Phase


@dataclass
class SystemState:
    """A saved state of a simulation at `time` [s]. Give it to `Simulation.restore` of the same simulation, or to
    `System.initialize(state=...)` of the same system after changing its wiring; any number of times."""

    tick: int
    phase: Phase
    values: Array
    inputs: dict[str, Array]
    components: dict[str, Any]
    samples: int
    owner: Exchange
    ending: tuple[int, str] | None = None

    @property
    def time(self) -> float:
        return self.owner.base.seconds(self.tick)
