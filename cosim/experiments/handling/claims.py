"""What theory leads one to expect of control laws for the suspension when the car is steered: `claims.toml`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cosim.experiments.handling.published import PROFILES, controlled
from cosim.experiments.handling.runs import Case
from cosim.study import ClaimList
from cosim.study.judges import View, compare, names

Place = tuple[str, int]  # manoeuvre, profile


class SuspensionView(View):
    """Places are manoeuvres and their roads, subjects are controllers of the controlled car with ideal actuators."""

    def places(self, at: Any, road: str) -> Sequence[Place]:  # noqa: ARG002
        """The manoeuvres that are named; straight, on every profile of the course."""
        return [(m, seed) for m in names(at) for seed in (PROFILES if m == "straight" else PROFILES[:1])]

    def case(self, subject: str, place: Place) -> Case:
        """The run of a controller in a manoeuvre."""
        manoeuvre, seed = place
        return controlled(subject, manoeuvre, seed=seed)

    def label(self, place: Place) -> str:
        """A place in words."""
        manoeuvre, seed = place
        return f"{manoeuvre}, profile {seed}" if manoeuvre == "straight" else manoeuvre


CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), {"compare": compare}, SuspensionView)
