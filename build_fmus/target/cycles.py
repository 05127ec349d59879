"""Cycles that instructions take: a range, from the data of the core in cores.toml."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Core:
    """A core, and the clock [MHz] that it is judged at; `lowest`, `highest`: cycles per instruction."""

    clock_mhz: float
    lowest: float
    highest: float
    source: str

    def cycles(self, instructions: int) -> tuple[float, float]:
        """Fewest and most cycles of so many instructions."""
        return self.lowest * instructions, self.highest * instructions

    def available(self, sample_time: float) -> float:
        """Cycles in a sample time [s]."""
        return 1e6 * self.clock_mhz * sample_time

    def verdict(self, instructions: int, sample_time: float) -> str:
        """Whether the instructions fit into the sample time [s]: "fits" only if the most cycles do."""
        fewest, most = self.cycles(instructions)
        available = self.available(sample_time)
        return "fits" if most <= available else "may fit" if fewest <= available else "does not fit"

    def estimate(self, sample_time: float) -> dict[str, Any]:
        """What metrics.json has: the range, and up to how many instructions a sample [s] fits or may fit."""
        available = self.available(sample_time)
        limits = (int(available / self.highest), int(available / self.lowest))
        return asdict(self) | dict(zip(("instructions_that_fit", "instructions_that_may_fit"), limits, strict=True))


@cache
def core_of(target: str) -> Core | None:
    """The core of a target; None if its cycles are not known."""
    found = tomllib.loads(Path(__file__).with_name("cores.toml").read_text(encoding="utf-8")).get(target)
    return None if found is None else Core(**found)
