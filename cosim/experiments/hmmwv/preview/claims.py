"""What the claims of paper 001 on its preview in `claims.toml` name: chains, places and quantities of the runs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

from cosim.experiments.hmmwv.preview.published import (
    COMPENSATED,
    FED,
    HEIGHTS_MM,
    LONG,
    PRINTED,
    PRINTED_FED,
    SPEEDOMETER_ERRORS,
    generated,
    long,
    on_track,
    over,
)
from cosim.experiments.hmmwv.preview.runs import WINDOW, Case
from cosim.study import ClaimList, Results
from cosim.study.judges import Quantities, View, Words, compare, quotient
from fmu_sources.roads.bumps import BUMP_LENGTH

SMALL, BIG = HEIGHTS_MM
_CHAINS = {"printed": PRINTED, "compensated": COMPENSATED, "printed, fed back": PRINTED_FED, "fed back": FED}


def extremes(study: Results, chain: Case, height_mm: float) -> tuple[float, float]:
    """Lowest and highest sensed height [mm] on the flat road after a bump."""
    row = study[over(chain, height_mm)]
    return 1e3 * row["lowest"], 1e3 * row["highest"]


class PreviewView(View):
    """Bumps of two heights [mm]; of the known track both bumps."""

    quantities: ClassVar[Quantities] = {
        "lowest": lambda view, c, mm: extremes(view.study, _CHAINS[c], mm)[0],  # mm
        "dip": lambda view, c, mm: -extremes(view.study, _CHAINS[c], mm)[0],  # mm
        "highest": lambda view, c, mm: extremes(view.study, _CHAINS[c], mm)[1],  # mm
        "left": lambda view, c, mm: max(view.quantity("dip", c, mm), view.quantity("highest", c, mm)),  # mm
        "dip / resolution": lambda view, c, mm: quotient(view.quantity("dip", c, mm), view.resolution),
        "left / resolution": lambda view, c, mm: quotient(view.quantity("left", c, mm), view.resolution),
        "first spread": lambda view, c, _: 1e3 * view.spread(c)[0],  # mm
        "last spread": lambda view, c, _: view.spread(c)[-1],  # m
        "growth": lambda view, c, _: view.spread(c)[-1] / view.spread(c)[0],
        "grows": lambda view, c, _: all(b > a for a, b in pairwise(view.spread(c))),
        "largest spread": lambda view, c, _: 1e3 * max(view.spread(c)),  # mm
        "largest spread / height": lambda view, c, mm: view.quantity("largest spread", c, mm) / mm,
        "error of the rate": lambda view, c, _: view.study[on_track(_CHAINS[c])]["rate_error"],  # m/s
        "offset": lambda view, _, bump: 1e3 * view.study[generated(0.0)]["offsets"][bump],  # mm
        "distance": lambda view, _, bump: abs(view.quantity("offset", "", bump)),  # mm
        "drift": lambda view, _, bump: 1e3 * view.drift(bump),  # mm
        "size": lambda view, _, bump: abs(view.quantity("drift", "", bump)),  # mm
        "distance / half a bump": lambda view, _, bump: view.quantity("distance", "", bump) / (500 * BUMP_LENGTH),
        "size / half a bump": lambda view, _, bump: view.quantity("size", "", bump) / (500 * BUMP_LENGTH),
        "second / first": lambda view, *_: quotient(abs(view.drift(1)), abs(view.drift(0))),
    }

    def __init__(self, study: Results) -> None:
        super().__init__(study)
        self.words = {
            "small": SMALL,
            "big": BIG,
            "long": LONG,
            "window": WINDOW,
            "error": SPEEDOMETER_ERRORS[-1],
            "seen": Words(lambda form: format(self.resolution, form)),
        }

    @property
    def resolution(self) -> float:
        """What the range sensor resolves [mm]."""
        return 1e3 * float(self.study[on_track(FED)]["resolution"])

    def spread(self, chain: str) -> Sequence[float]:
        """Standard deviation [m] of the buffered road's error in each window, with noise for long."""
        found: Sequence[float] = self.study[long(_CHAINS[chain])]["spread"]
        return found

    def drift(self, bump: int) -> float:
        """By how much [m] the speedometer's error moves the prediction at a bump of the track."""
        exact, off = (self.study[generated(e)]["offsets"][bump] for e in (0.0, SPEEDOMETER_ERRORS[-1]))
        return float(off - exact)

    def places(self, at: str, road: str) -> list[Any]:  # noqa: ARG002
        """After the small or the big bump; on the track the second bump, or both."""
        named: dict[str, list[Any]] = {"small": [SMALL], "second": [1], "both": [0, 1]}
        return named.get(at, [BIG])


CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), {"compare": compare}, PreviewView)
