"""What theory leads one to expect of passive, semi-active and active suspensions: the checks of `claims.toml`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from cosim.experiments.semi_active.published import FAMILIES, at, family, without_hysteresis
from cosim.experiments.semi_active.runs import STRETCHES, Case, invariant
from cosim.study import ClaimList, Results
from cosim.study.judges import Quantities, View, compare

COMFORT, ROAD_HOLDING = "body_rms", "tire_rms"


def best(study: Results, kind: str, metric: str, other: str) -> float:
    """The least value of a metric over the runs of a kind of suspension whose `other` is no worse than the HMMWV's.

    Infinite if none is.
    """
    limit = study[at("passive")][other]
    rows = (study[c] for c in family(kind))
    return min((float(row[metric]) for row in rows if row[other] <= limit), default=math.inf)


class DamperView(View):
    """Places are roads, with the stretches of the random one; subjects are systems, or kinds of suspension."""

    quantities: ClassVar[Quantities] = {
        "best comfort": lambda view, kind, _: best(view.study, kind, COMFORT, ROAD_HOLDING),
        "best road holding": lambda view, kind, _: best(view.study, kind, ROAD_HOLDING, COMFORT),
        "error at the invariant frequency": lambda view, subject, place: abs(
            float(view.study[view.case(subject, place)]["acceleration_invariant"]) / invariant()[1] - 1
        ),
    }

    def places(self, at: Any, road: str) -> Sequence[Any]:  # noqa: ARG002
        """`rig`, `random` (all its stretches), or the runs without hysteresis of every semi-active control law."""
        if at == "semi-active":
            return [without_hysteresis(s) for s in FAMILIES["semi-active"]]
        return [at] if at != "random" else [("random", i) for i in range(STRETCHES)]

    def case(self, subject: str, place: Any) -> Case:
        """The run of a system at a place."""
        if isinstance(place, Case):
            return place
        road, stretch = place if isinstance(place, tuple) else (place, 0)
        return at(subject, road, stretch)

    def label(self, place: Any) -> str:
        """A place in words."""
        return f"{place[0]}, stretch {place[1]}" if isinstance(place, tuple) else super().label(place)


CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), {"compare": compare}, DamperView)
