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
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from cosim.experiments.gpc.published import WEIGHTS
from cosim.experiments.gpc.results import Results, Study
from cosim.experiments.gpc.runs import R_PUBLISHED
from cosim.study import Band, ClaimList, Distribution, Evidence, Finding, RunFailed
from fmu_sources.controllers.gpc.component import FORCE_LIMIT
from fmu_sources.controllers.gpc.identification import IdentificationSettings

CONVERGED = 0.005  # relative, the tolerance to which responses are matched
COMPARED, HELD = 1 / 2, 3 / 4  # of all speeds, and of those that can be compared

Side = Callable[[float], bool]
Values = Callable[[float], Distribution | None]  # of a quantity over the seeds, by speed [km/h]; None: no seed has one


def number(weight: float) -> str:
    """A control weight [1/N2] as text, "1e-7"."""
    return f"{weight:g}".replace("e-0", "e-")


R_TEXT = f"R = {number(R_PUBLISHED)}"


class Judge:
    """What the claims are judged on: results, and what of the vehicle was chosen with the paper's figures in view."""

    def __init__(self, study: Study, fitted: str = "") -> None:
        self.results = Results(study)
        self.words = {
            "vehicle": fitted,
            "excitation": IdentificationSettings().excitation / 1e3,
            "limit": FORCE_LIMIT / 1e3,
            "converged": 100 * CONVERGED,
        }
        self.speeds = study.speeds

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

    def decides(self, values: Distribution, holds: Side) -> bool:
        """Whether the seeds decide for the claimed side; a single one always does."""
        return values.everywhere(holds) if len(self.results.seeds) == 1 else values.is_significant(holds)

    def unsettled(self, value: float, band: Band | None, unit: str) -> str:
        """Why halved steps might change on which side of the band's edge a value lies; empty if they do not."""
        low, high = sorted((value * (1 - self.move), value * (1 + self.move)))
        if band is None or not math.isfinite(self.move) or (low in band) == (high in band):
            return ""
        return (
            f"halving steps moves metrics by up to {100 * self.move:.2g} %: {low:.4g} to {high:.4g} {unit} (edge of the"
            " band)"
        )


# ------------------------------------------------------------------------------------------------ comparisons by speed


@dataclass
class Tally:
    """Quantities of a claim by speed: where they can be compared, and where all are on the claimed side."""

    judge: Judge
    speeds: Sequence[float]
    strict: bool = False
    seen: Evidence = field(default_factory=Evidence)
    compared: list[float] = field(default_factory=list)
    on_side: list[float] = field(default_factory=list)

    def look(self, quantities: Mapping[str, tuple[Values, Side, str]]) -> Tally:
        """Look at quantities, by name: values, claimed side and unit."""
        for v in self.speeds:
            found = {name: (at(v), holds, unit) for name, (at, holds, unit) in quantities.items()}
            for name, (values, holds, unit) in found.items():
                self.seen.is_significant(f"{name}, {v:g} km/h", values, holds, unit)
            if any(values is None or not self._comparable(values) for values, *_ in found.values()):
                continue
            self.compared.append(v)
            if all(values is not None and self._decides(values, holds) for values, holds, _ in found.values()):
                self.on_side.append(v)
        return self

    def _comparable(self, values: Distribution) -> bool:
        return 2 * len(values.values) >= len(self.judge.results.seeds)

    def _decides(self, values: Distribution, holds: Side) -> bool:
        return self.judge.decides(values, holds) if self.strict else holds(values.median)

    @property
    def holds(self) -> bool:
        """Whether the claim holds over the speeds."""
        if self.strict:
            return self.on_side == list(self.speeds)
        return (
            len(self.compared) >= COMPARED * len(self.speeds)
            and len(self.on_side) >= HELD * len(self.compared)
            and bool(self.compared)
        )

    @property
    def text(self) -> str:
        """The speeds in words, "as claimed at 2 of 7 speeds that can be compared, of 8 in all (50, 60 km/h)"."""
        if len(self.speeds) == 1:
            return "" if self.compared else "no weight matches the response in half of the seeds"
        named = f" ({', '.join(f'{v:g}' for v in self.on_side)} km/h)" * (0 < len(self.on_side) < len(self.speeds))
        few = "" if len(self.compared) == len(self.speeds) else f", of {len(self.speeds)} in all"
        return f"as claimed at {len(self.on_side)} of {len(self.compared)} speeds that can be compared{few}{named}"


@dataclass(frozen=True)
class Comparison:
    """One comparison of a claim, from its entry: a quantity of `of` to one of `to`, and the claimed side.

    `form`: "ratio" to `to`; "reduction" or "rise" from it [%]; "value", the quantity itself [`unit`].
    """

    quantity: str
    of: str
    to: str
    form: str
    side: Side
    unit: str
    sized: bool

    @property
    def what(self) -> str:
        """The quantity in words."""
        return " / ".join(_WORDS.get(q, q.replace("_", " ")) for q in self.quantity.split("/"))

    @property
    def name(self) -> str:
        """The comparison in words."""
        if self.form == "value":
            return f"{self.what} of {self.of}"
        change = "" if self.form == "ratio" else f"{self.form} of "
        return f"{change}{self.what}, {self.of} / {self.to}"

    def values(self, results: Results, road: str, v: float) -> Distribution | None:
        """Over the seeds that could be matched to explicit's response."""
        rows = (self.of,) if self.to in ("", "passive") else (self.of, self.to)
        base = results.passive(road, v) if self.to == "passive" else None

        def value(row: Mapping[str, Any], other: Mapping[str, Any] | None = base) -> float:
            if "/" in self.quantity:
                above, below = self.quantity.split("/")
                return float(row[above] / row[below])
            if other is None:
                return float(row[self.quantity])
            ratio = _over(row[self.quantity], other[self.quantity])
            return float(
                ratio if self.form == "ratio" else 100 * (1 - ratio if self.form == "reduction" else ratio - 1)
            )

        if self.of == "explicit" and self.to == "passive" and self.quantity == "response":
            return results.improvements(road, v, "explicit")  # also where it does not lower the response
        return results.at_equal_response(road, v, rows, value)

    def text(self, medians: Sequence[float]) -> str:
        """Medians of the seeds over the speeds in words, "force of preview 0.34 to 1.02 times explicit's"."""
        if not medians:
            return f"{self.what} of {self.of} cannot be compared"
        changes = sorted(-x if self.form == "reduction" else x for x in medians)
        form = {"ratio": "{:.2f}", "value": "{:.3g}"}.get(self.form, "{:+.0f}")
        span = " to ".join(dict.fromkeys(form.format(x) for x in (changes[0], changes[-1])))
        unit = f" {self.unit}" if self.unit else ""
        base = f" {self.to}'s" if self.form == "ratio" else "" if self.to in ("", "passive") else f" from {self.to}'s"
        return f"{self.what} of {self.of} {span}{unit}{base}"


def _over(above: float, below: float) -> float:
    """A quotient; from nothing, such as the roll of a symmetric car on one profile, everything is infinitely more."""
    return above / below if below else math.inf if above else math.nan


_WORDS = {
    "rms_az": "acceleration",
    "rms_pitch": "pitch",
    "rms_roll": "roll",
    "peak_pitch": "peak of pitch",
}
_FORMS = ("ratio", "reduction", "rise", "value")
_SIDES: dict[str, Callable[[Any], Side]] = {
    "above": lambda edge: lambda x: x > edge,
    "below": lambda edge: lambda x: x < edge,
    "least": lambda edge: lambda x: x >= edge,
    "within": lambda edges: lambda x: edges[0] <= x <= edges[1],
}


def _names(given: str | Sequence[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)


def _comparisons(entry: Mapping[str, Any]) -> list[Comparison]:
    """The comparisons of one line of an entry: each of its quantities, of each controller, to each of the others.

    Raises:
        ValueError: it has no form or no side, or a key that is neither.
    """
    forms, sides = [f for f in _FORMS if f in entry], [s for s in _SIDES if s in entry]
    unknown = set(entry) - {*_FORMS, *_SIDES, "of", "to", "sized", "unit"}
    if len(forms) != 1 or len(sides) != 1 or unknown:
        raise ValueError(f"a comparison has one of {', '.join(_FORMS)}, one of {', '.join(_SIDES)} and 'of', 'to'")
    side = _SIDES[sides[0]](entry[sides[0]])
    unit = entry.get("unit", {"ratio": "times", "value": ""}.get(forms[0], "%"))
    return [
        Comparison(q, of, to, forms[0], side, unit, entry.get("sized", False))
        for q in _names(entry[forms[0]])
        for of in _names(entry["of"])
        for to in _names(entry.get("to", ""))
    ]


def _speeds(j: Judge, road: str, at: float | str) -> list[float]:
    """Speeds [km/h] that an entry names: one, "all", "highest response", or those above one ("above 50")."""
    if isinstance(at, int | float):
        return [float(at)]
    if at == "highest response":
        return [j.results.worst_speed(road)]
    least = float(at.removeprefix("above ")) if at.startswith("above ") else -math.inf
    return [v for v in j.speeds if v > least]


def compare(
    j: Judge,
    *,
    road: str,
    compare: Sequence[Mapping[str, Any]],
    at: float | str = "all",
    size_at: float | None = None,
    band: Band | None = None,
    strict: bool = False,
) -> Finding:
    """Judge comparisons over the speeds, as the module says.

    The value is the median over the speeds (that at `size_at`, if given) of the comparison marked `sized`; of several,
    the one that lies worst in the band.
    """
    tally = Tally(j, _speeds(j, road, at), strict)
    parts = [c for entry in compare for c in _comparisons(entry)]
    at_speed: dict[Comparison, Values] = {c: partial(c.values, j.results, road) for c in parts}
    tally.look({c.name: (at_speed[c], c.side, c.unit) for c in parts})

    def medians(c: Comparison, speeds: Sequence[float]) -> list[float]:
        return [d.median for v in speeds if (d := at_speed[c](v)) is not None]

    sized = {c: medians(c, tally.compared if size_at is None else [size_at]) for c in parts if c.sized}
    values = [float(np.median(found)) for found in sized.values() if found]
    unit = next((c.unit for c in sized), "")
    value = None if band is None else min(values, key=partial(_inside, band), default=math.nan)
    return Finding(
        "; ".join(filter(None, [*(c.text(medians(c, tally.speeds)) for c in parts), tally.text])),
        tally.holds,
        value=value,
        unit=unit,
        undecided="" if value is None else j.unsettled(value, band, unit),
        evidence=tally.seen,
        words=j.words,
    )


def _inside(band: Band, value: float) -> float:
    """How far a value lies inside of a band; negative outside."""
    return min(value - band.low, band.high - value)


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
    (v,) = _speeds(j, road, at)
    gains = j.results.improvements(road, v, controller)
    return Finding(
        f"{gains.text('{:.0f}', '%')}, at {v:g} km/h",
        least <= gains.median <= most,
        value=gains.median,
        unit="%",
        words=j.words,
    )


def weight_power(j: Judge) -> Finding:
    """Whether the effectiveness per power of preview on the sine road falls with every smaller weight."""

    def steps(v: float) -> Distribution:
        """Smallest rise of the effectiveness per power from one weight to the next larger one [1/kW]."""
        return Distribution(np.diff(j.results.over_weights(v, "per_power", s)).min() for s in j.results.seeds)

    tally = Tally(j, j.speeds).look({"smallest step of effectiveness per power": (steps, lambda x: x > 0, "1/kW")})
    words = {**j.words, "count": len(WEIGHTS)}
    return Finding(f"falls from weight to weight {tally.text}", tally.holds, evidence=tally.seen, words=words)


def weight_force(j: Judge, *, coalesce: float) -> Finding:
    """Whether the effectiveness per force is the same at all weights but the smallest, where the control law helps."""

    def spread(v: float) -> Distribution | None:
        curves = [np.array(j.results.over_weights(v, "per_force", s)[1:]) for s in j.results.seeds]
        helps = [c for c in curves if c.min() > 0]
        return Distribution(c.max() / c.min() for c in helps) if helps else None

    name = "largest / smallest effectiveness per force"
    tally = Tally(j, j.speeds).look({name: (spread, lambda x: x <= coalesce, "times")})
    medians = [d.median for v in tally.compared if (d := spread(v)) is not None]
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
    diverged, rows = j.results.diverged(), j.results.study.rows
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
