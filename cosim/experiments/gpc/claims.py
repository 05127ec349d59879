"""How the claims of paper 000 in `claims.toml` are judged.

The paper shows curves of one identification, which is random. So a claim that is read off a figure is judged on the
median of the identification seeds, speed by speed: it holds if it holds at three quarters of the speeds at which the
controllers can be compared, and if at least half of the speeds can be. At a speed they can be compared if half of the
seeds could be matched to explicit's response, as the paper matches them. Beside the verdict stands with how many
identifications the claim holds alone. A `strict` claim holds only if the seeds decide significantly (a sign test at
5 %, 7 of 8) at every speed.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cosim.experiments.gpc.published import WEIGHTS
from cosim.experiments.gpc.results import Results
from cosim.experiments.gpc.runs import R_PUBLISHED
from cosim.study import Band, ClaimList, Distribution, Finding, RunFailed
from cosim.study.judges import Comparison, Side, Tally, View, compare, quotient
from fmu_sources.controllers.gpc.component import FORCE_LIMIT
from fmu_sources.controllers.gpc.identification import IdentificationSettings

CONVERGED = 0.005  # relative, the tolerance to which responses are matched

Place = tuple[str, float]  # road, speed [km/h]


def number(weight: float) -> str:
    """A control weight [1/N2] as text, "1e-7"."""
    return f"{weight:g}".replace("e-0", "e-")


R_TEXT = f"R = {number(R_PUBLISHED)}"


class Judge(View):
    """What the claims are judged on: results, and what of the vehicle was chosen with the paper's figures in view.

    Places are road and speed [km/h], samples the identification seeds.
    """

    held, compared, named = 3 / 4, 1 / 2, "{1:g} km/h"

    def __init__(self, results: Results, fitted: str = "") -> None:
        self.results = results
        self.words = {
            "vehicle": fitted,
            "excitation": IdentificationSettings().excitation / 1e3,
            "limit": FORCE_LIMIT / 1e3,
            "converged": 100 * CONVERGED,
        }
        self.speeds = results.speeds

    @cached_property
    def move(self) -> float:
        """Largest relative change of a metric by halved steps."""
        return self.results.largest_move()

    def singles(self) -> list[Judge]:
        """The study as each identification seed alone shows it."""
        return [self._of(seed) for seed in self.results.seeds]

    def _of(self, seed: int) -> Judge:
        single = copy.copy(self)
        single.results = copy.copy(self.results)
        single.results.seeds = (seed,)
        return single

    def places(self, at: float | str, road: str) -> list[Place]:
        """One speed, all of them ("everywhere"), that of the "highest response", or those "above 50"."""
        if isinstance(at, int | float):
            return [(road, float(at))]
        if at == "highest response":
            return [(road, self.results.worst_speed(road))]
        least = float(at.removeprefix("above ")) if at.startswith("above ") else -math.inf
        return [(road, v) for v in self.speeds if v > least]

    def values(self, c: Comparison, place: Place) -> Distribution | None:
        """Over the seeds that could be matched to explicit's response."""
        base = self.results.passive(*place) if c.to == "passive" else None
        above, _, below = c.quantity.partition("/")

        def value(row: Mapping[str, Any], other: Mapping[str, Any] | None = base) -> float:
            own = quotient(row[above], row[below]) if below else row[above]
            return float(c.number(own, None if other is None else other[c.quantity]))

        if c.of == "explicit" and c.to == "passive" and c.quantity == "response":
            return self.results.improvements(*place, "explicit")  # also where it does not lower the response
        return self.results.at_equal_response(*place, (c.of,) if c.to in ("", "passive") else (c.of, str(c.to)), value)

    def is_comparable(self, found: Sequence[Distribution | None]) -> bool:
        """Whether half of the seeds could be matched in all quantities."""
        return all(d is not None and 2 * len(d.values) >= len(self.results.seeds) for d in found)

    def decides(self, values: Distribution, holds: Side, strict: bool) -> bool:
        """Whether the median is on the claimed side; if `strict`, significantly many seeds, or the only one."""
        if not strict:
            return holds(values.median)
        return super().decides(values, holds, strict=len(self.results.seeds) > 1)

    def unsettled(self, value: float, band: Band | None, unit: str) -> str:
        """Why halved steps might change on which side of the band's edge a value lies; empty if they do not."""
        low, high = sorted((value * (1 - self.move), value * (1 + self.move)))
        if band is None or not math.isfinite(self.move) or (low in band) == (high in band):
            return ""
        return (
            f"halving steps moves metrics by up to {100 * self.move:.2g} %: {low:.4g} to {high:.4g} {unit} (edge of the"
            " band)"
        )

    def text(self, tally: Tally) -> str:
        """The speeds in words, "as claimed at 2 of 7 speeds that can be compared, of 8 in all (50, 60 km/h)"."""
        every, compared, held = (len(p) for p in (tally.places, tally.compared, tally.on_side))
        if every == 1:
            return "" if compared else "no weight matches the response in half of the seeds"
        named = f" ({', '.join(f'{v:g}' for _, v in tally.on_side)} km/h)" * (0 < held < every)
        few = "" if compared == every else f", of {every} in all"
        return f"as claimed at {held} of {compared} speeds that can be compared{few}{named}"


def open_loop_peak(j: Judge, *, band: Band) -> Finding:
    """Whether the passive response on the sine road has its peak inside of the range of speeds, and where [km/h]."""
    peak = j.results.open_loop_peak()
    undecided = j.unsettled(peak, band, "km/h") if peak in j.speeds else ""
    return Finding(
        holds=min(j.speeds) < peak < max(j.speeds), value=peak, unit="km/h", undecided=undecided, words=j.words
    )


def unmatched(
    j: Judge, *, road: str, at: float | str, controller: str, least: float, most: float = math.inf
) -> Finding:
    """Whether a controller at R = 1e-7 reduces the response by so much [%], in the median of the seeds."""
    (place,) = j.places(at, road)
    gains = j.results.improvements(*place, controller)
    return Finding(
        f"{gains.text('{:.0f}', '%')}, at {j.label(place)}",
        least <= gains.median <= most,
        value=gains.median,
        unit="%",
        words=j.words,
    )


def weight_power(j: Judge) -> Finding:
    """Whether the effectiveness per power of preview on the sine road falls with every smaller weight."""

    def steps(place: Place) -> Distribution:
        """Smallest rise of the effectiveness per power from one weight to the next larger one [1/kW]."""
        return Distribution(np.diff(j.results.over_weights(place[1], "per_power", s)).min() for s in j.results.seeds)

    name = "smallest step of effectiveness per power"
    tally = Tally(j, j.places("everywhere", "sine")).look((name, steps, lambda x: x > 0, "1/kW"))
    words = {**j.words, "count": len(WEIGHTS)}
    return Finding(f"falls from weight to weight {tally.text}", tally.holds, evidence=tally.seen, words=words)


def weight_force(j: Judge, *, coalesce: float) -> Finding:
    """Whether the effectiveness per force is the same at all weights but the smallest, where the control law helps."""

    def spread(place: Place) -> Distribution | None:
        curves = [np.array(j.results.over_weights(place[1], "per_force", s)[1:]) for s in j.results.seeds]
        helps = [c for c in curves if c.min() > 0]
        return Distribution(c.max() / c.min() for c in helps) if helps else None

    name = "largest / smallest effectiveness per force"
    tally = Tally(j, j.places("everywhere", "sine")).look((name, spread, lambda x: x <= coalesce, "times"))
    medians = [d.median for place in tally.compared if (d := spread(place)) is not None]
    return Finding(
        f"largest over smallest of R = {', '.join(map(number, WEIGHTS[1:]))}: "
        + (f"{min(medians):.2f} to {max(medians):.2f} times, {tally.text}" if medians else "no weight helps"),
        tally.holds,
        evidence=tally.seen,
        words=j.words,
    )


def force_limit(j: Judge) -> Finding:
    """Whether the largest force of any run is the limit of the actuators; the value is its share of the limit."""
    share = j.results.largest_force() / FORCE_LIMIT
    return Finding(holds=share >= 0.99, value=share, words={**j.words, "percent": 100 * share})


def no_divergence(j: Judge) -> Finding:
    """Whether every run with a published weight or a larger one comes to its end."""
    diverged, rows = j.results.diverged(), j.results.rows
    if not rows:
        raise RunFailed("no run came to an end")
    first = next(iter(diverged), {})
    where = "GPC {controller} on {road} at {speed_kmh:g} km/h, seed {seed}".format(**first) if first else ""
    words = {"where": where, "why": first.get("reason", "it did not arrive"), "runs": len(rows)}
    return Finding(holds=not diverged, value=len(diverged), unit="runs", words=words)


def converged(j: Judge) -> Finding:
    """Whether halved steps change no metric visibly; the value is the largest change [%]."""
    return Finding(holds=j.move <= CONVERGED, value=100 * j.move, unit="%", words=j.words)


JUDGES: dict[str, Callable[..., Finding]] = {
    f.__name__: f
    for f in (compare, open_loop_peak, unmatched, weight_power, weight_force, force_limit, no_divergence, converged)
}

CLAIMS = ClaimList.read(Path(__file__).with_name("claims.toml"), JUDGES)
"""Every published claim with the published figure, and additional checks; judged with a `Judge`."""
