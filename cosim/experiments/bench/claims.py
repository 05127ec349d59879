"""What the claims of paper 002 in `claims.toml` name: places, controllers and quantities of the runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from cosim.experiments.bench.published import JUDGED, LONG, SCENARIOS, SHORT, at, over_stretches
from cosim.experiments.bench.runs import BUMP_HEIGHT_MM, Case
from cosim.study import ClaimList, Distribution, Results, Row
from cosim.study.judges import Comparison, Quantities, View, compare

NAMES = {
    "passive": "passive",
    "lqr": "LQR",
    "lqr-clipped": "LQR, clipped to 8 N",
    "mpc": "MPC, weight on the force",
    "mpc-moves": "MPC, weight on the moves",
}
NOTHING = 1e-6  # to which no ratio is taken


def peak_force(row: Row) -> float:
    """Largest force either way [N]."""
    return float(max(row["force.max"], -row["force.min"]))


def ratio(study: Results, scenario: str, metric: str, controller: str, base: str) -> float:
    """A metric of one controller over that of another."""
    return float(study[at(scenario, controller)][metric] / study[at(scenario, base)][metric])


def over_passive(study: Results, metric: str) -> Distribution:
    """A metric under the MPC over that of the passive bench, stretch by stretch of the random road."""
    passive, mpc = (over_stretches(c) for c in JUDGED)
    return Distribution(
        (study[a][metric] / study[b][metric] for a, b in zip(mpc, passive, strict=True)), of="stretches"
    )


class BenchView(View):
    """Scenarios, or single runs; the samples of the random road are its stretches."""

    quantities: ClassVar[Quantities] = {
        "peak force": lambda view, c, place: peak_force(view.study[view.case(c, place)]),
        "unsolved": lambda view, _, run: float(view.study[run]["solver.status"] > 0),
    }
    words: Mapping[str, float] = {"height": BUMP_HEIGHT_MM}

    def places(self, at: str, road: str) -> list[Any]:  # noqa: ARG002
        """Scenarios, or all runs under an MPC: with exact and measured states, with finer steps."""
        if at == "every run under an MPC":
            return [c for c in self.study if c.controller.startswith("mpc")]
        return {"bumps": [LONG, SHORT], "stretches": ["stretches"]}.get(at, list(SCENARIOS))

    def case(self, subject: str, place: str | Case) -> Case:
        """The run of a controller in a scenario."""
        return place if isinstance(place, Case) else at(place, subject)

    def values(self, c: Comparison, place: Any) -> Distribution | None:
        """A comparison at a place; over the stretches that of the MPC to the passive bench, to nothing none."""
        if place == "stretches":
            return over_passive(self.study, c.quantity)
        if c.to == "lqr" and self.study[at(place, "lqr")][c.quantity] <= NOTHING:
            return None
        return super().values(c, place)


CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), {"compare": compare}, BenchView)
