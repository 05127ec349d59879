"""What theory leads one to expect of control laws for the suspension when the car is steered: `claims.toml`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cosim.experiments.handling.published import controlled
from cosim.experiments.handling.runs import Case
from cosim.study import ClaimList
from cosim.study.judges import View, compare, names


class SuspensionView(View):
    """Places are manoeuvres, subjects are controllers of the controlled car with ideal actuators."""

    def places(self, at: Any, road: str) -> Sequence[str]:  # noqa: ARG002
        """The manoeuvres that are named."""
        return names(at)

    def case(self, subject: str, place: str) -> Case:
        """The run of a controller in a manoeuvre."""
        return controlled(subject, place)


CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), {"compare": compare}, SuspensionView)
