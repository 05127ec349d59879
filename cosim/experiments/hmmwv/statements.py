"""Statements of paper 001 on the controlled car, from `claims.toml`: a figure over the places of a bump, and its rule.

A published sentence is judged under both conditions of the pump, and on each of its parts, by the judge `statement`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from cosim.experiments.hmmwv.averages import Averages
from cosim.experiments.hmmwv.published import (
    CONDITIONS,
    NULL_OPENINGS_MM,
    PUMP,
    PUMPED,
    PUMPS_L_MIN,
    VARIANTS,
    WITHOUT_LIMIT,
    Condition,
)
from cosim.experiments.hmmwv.runs import Case
from cosim.study import Band, Distribution, Finding, RunFailed
from cosim.study.claims import all_of, under_conditions
from cosim.study.judges import SIDES
from fmu_sources.models.comfort import ABSORBED_POWER_LIMIT

NAMES = {
    "passive": "passive",
    "zero": "zero force",
    "skyhook": "skyhook",
    "lqr": "LQR",
    "lqr-kilonewton": "LQR, force in kN",
    "mpc": "MPC",
    "mpc-preview": "MPC with preview",
}
ROAD_NAMES = {"track": "test track", "bump": "one 76 mm bump", "off-road": "off road"}


@dataclass(frozen=True)
class Statement:
    """A part of a published sentence, about one controller: a figure, and the side on which every value has to be.

    `figure`: absorbed power [W] ("watts"), that of the passive car over it ("times"), the reduction of a `quantity`
    from the lowest of the others `to` [%] ("gain"), or by how much the furthest of them is apart from it [%] ("apart").
    `band` is for the median, a bound for every value. `chosen`: what was chosen with published figures in view,
    "opening" of the spools or "terrain"; `reading`: the controller whose printed numbers are read otherwise. `nothing`:
    what a figure of 0 over 0 means, where there may be one.
    """

    road: str
    figure: str
    of: str
    shortfall: str
    text: str
    published: str = ""
    to: tuple[str, ...] = ()
    quantity: str = "absorbed_power"
    above: float | None = None
    below: float | None = None
    within: tuple[float, float] | None = None
    band: Band | None = None
    chosen: str = ""
    reading: str = ""
    nothing: str = ""

    @property
    def claim(self) -> str:
        """What it says."""
        return self.text.format_map(self.words)

    @property
    def words(self) -> dict[str, str]:
        """For its sentences."""
        return {"name": NAMES[self.of], "side": "below" if self.above is None else "above"}

    @property
    def unit(self) -> str:
        """Unit of the figure."""
        return {"watts": "W", "times": "times"}.get(self.figure, "%")

    @property
    def form(self) -> str:
        """How the figure is printed."""
        small = self.quantity == "travel_rms"
        return {"watts": "{:.1f}", "times": "{:.2f}"}.get(self.figure, "{:.1f}" if small else "{:.0f}")

    def side(self, value: float) -> bool:
        """Whether a value is on the claimed side."""
        return all(SIDES[k](e)(value) for k in ("above", "below", "within") if (e := getattr(self, k)) is not None)

    def figures(self, study: Averages, at: Condition) -> Distribution:
        """The figure over the places."""
        own = at(Case(self.road, self.of))
        if self.figure == "watts":
            return study.distribution("absorbed_power", own)
        if self.figure == "times":
            return study.ratio(Case(self.road, "passive"), own)
        others = [at(Case(self.road, c)) for c in self.to]
        if self.figure == "gain":
            return study.gain(own, others, self.quantity)
        each = [study.ratio(other, own).values for other in others]
        furthest = (max((100 * (r - 1) for r in rs), key=abs) for rs in zip(*each, strict=True))
        return Distribution(furthest, of=VARIANTS[self.road])

    def incomparable(self, found: Distribution) -> str:
        """Where a figure is 0 over 0, in words; empty where it is nowhere."""
        count = sum(map(math.isnan, found.values))
        return f"{self.nothing} at {count} of {len(found.values)} {found.of}" if count else ""

    def holds(self, study: Averages, at: Condition) -> bool:
        """Whether the statement holds in full under this condition."""
        found, band = self.figures(study, at), self.band
        sized = band is None or (found.everywhere(band.__contains__) if band.open else found.median in band)
        return sized and found.everywhere(self.side)

    def decided_by_opening(self, ratios: Iterable[float]) -> bool:
        """Whether one of `over_openings` is in the band and another one out of it."""
        return self.band is not None and len({r in self.band for r in ratios}) > 1

    def over_openings(self, study: Averages, at: Condition) -> list[float]:
        """The ratio to the passive car with each plausible opening of its spools; empty if none was chosen for it."""
        if self.chosen != "opening":
            return []
        power = study.power(at(Case(self.road, self.of)))
        return [study.power(Case(self.road, "passive", null_opening_mm=mm)) / power for mm in NULL_OPENINGS_MM]

    def fitted(self, study: Averages, at: Condition) -> str:
        """What was chosen, in words."""
        texts, reading = [], self.reading or (self.of if self.chosen else "")
        if ratios := self.over_openings(study, at):
            edge = ", in and out of the band" if self.decided_by_opening(ratios) else ""
            texts.append(
                f"null opening of the unpowered spool, which damps the passive car: {study.null_opening_mm:g} mm,"
                f" assumed with the passive figure in view; {min(NULL_OPENINGS_MM):g} to {max(NULL_OPENINGS_MM):g} mm"
                f" are plausible and give {min(ratios):.2f} to {max(ratios):.2f} times{edge}"
            )
        if self.chosen == "terrain":
            texts.append(_terrain(study, at))
            texts += ["so is the null opening of the unpowered spool"] * (self.of == "passive")
        if reading == "lqr":
            texts.append("weights of Table 1.1 read with the force in N, not kN")
        elif reading.startswith("mpc"):
            texts.append("force rate of Table 1.3 read as per period of 30 ms, not per second")
        return "; ".join(texts)


def roughness_range(study: Averages, at: Condition = WITHOUT_LIMIT) -> tuple[float, float]:
    """Spectra, as shares of the assumed one, between which MPC alone stays below the driver's limit on every stretch.

    Absorbed power is taken as proportional to the spectrum; empty (first above second) where there are none.
    """
    power = {c: study.distribution("absorbed_power", at(Case("off-road", c))) for c in ("skyhook", "lqr", "mpc")}
    return ABSORBED_POWER_LIMIT / min(power["skyhook"].low, power["lqr"].low), ABSORBED_POWER_LIMIT / power["mpc"].high


def _terrain(study: Averages, at: Condition) -> str:
    low, high = roughness_range(study, at)
    only = (
        f"MPC alone stays below {ABSORBED_POWER_LIMIT:g} W for spectra of about {low:.2f} to {high:.2f} times that"
        " one (power taken as proportional)"
        if low < high
        else f"on no spectrum does MPC alone stay below {ABSORBED_POWER_LIMIT:g} W (power taken as proportional)"
    )
    return f"the terrain is not in the paper: class E of ISO 8608 is assumed; {only}"


# -------------------------------------------------------------------------------------------- what pump it takes


@dataclass(frozen=True)
class Need:
    """What a statement takes: whether it holds with each pump that was tried, from the smallest on."""

    statement: Statement
    holds: Mapping[Condition, bool]

    @property
    def smallest(self) -> Condition | None:
        """The smallest pump with which the statement holds; None: it holds with none."""
        return next((at for at, holds in self.holds.items() if holds), None)

    def words(self, study: Averages) -> str:
        """The result in words, "90 l/min at each actuator, not with 75 l/min"."""
        if self.smallest is None:
            return "no pump that was tried"
        words, tried = self.smallest.words(study), list(self.holds)
        if first := tried.index(self.smallest):
            words += f", not with {tried[first - 1].l_min(study):g} l/min"
        if any(a and not b for a, b in pairwise(self.holds.values())):
            words += f"; no longer beyond {[at for at, holds in self.holds.items() if holds][-1].words(study)}"
        return words


def conditions(study: Averages, road: str) -> list[Condition]:
    """Pumps that were tried on a road with all controllers of `PUMPED`, from the smallest on."""
    larger = (Condition(limited=True, pump_l_min=x) for x in PUMPS_L_MIN[road])
    return sorted((PUMP, *larger, WITHOUT_LIMIT), key=lambda c: c.l_min(study))


def need(study: Averages, s: Statement) -> Need | None:
    """Pump with which a statement holds, of those tried whose runs did not fail; None if no larger pumps were tried."""
    if not {*s.to, s.of} <= set(PUMPED[s.road]):
        return None
    holds = {}
    for at in conditions(study, s.road):
        try:
            holds[at] = s.holds(study, at)
        except RunFailed:
            continue
    return Need(s, holds)


# --------------------------------------------------------------------------------------------------- the judge


def parts(
    *, parts: Sequence[Mapping[str, Any]] = ({},), band: Band | None = None, **common: Any
) -> tuple[Statement, ...]:
    """The statements of an entry of the file, one for each of its `parts`."""
    return tuple(Statement(**{**common, "band": band, **part}) for part in parts)


def statement(study: Averages, *, band: Band | None = None, **common: Any) -> Finding:
    """Judge a sentence: under each condition of the pump, each of its parts."""
    found = {}
    every = parts(band=band, **common)
    for at in CONDITIONS:
        each = {NAMES[s.of]: finding(s, study, at) for s in every}
        found[at.words(study)] = all_of(each) if len(each) > 1 else next(iter(each.values()))
    return under_conditions(found)


def finding(s: Statement, study: Averages, at: Condition) -> Finding:
    """What a study says of a statement under a condition of the pump; open if half the steps change the verdict."""
    try:
        coarse, fine = (_judged(s, results, at) for results in (study, study.finer))
    except RunFailed as error:
        return Finding("a run failed", False, str(error), unit=s.unit, undecided=str(error), words=s.words)
    if coarse.verdict == fine.verdict:
        return coarse
    both = f"as run {coarse.result}: {coarse.verdict}; with half the steps {fine.result}: {fine.verdict}"
    return replace(coarse, undecided=both)


def _judged(s: Statement, study: Averages, at: Condition) -> Finding:
    found = s.figures(study, at)
    powers = {c: study.power(at(Case(s.road, c))) for c in dict.fromkeys(("passive", *s.to, s.of))}
    absorbed = f"absorbed power {', '.join(f'{NAMES[c]} {p:.2f}' for c, p in powers.items())} W"
    needed = need(study, s) if at.limited else None
    holds = "" if needed is None else f"; holds with: {needed.words(study)}"
    nothing, some = s.incomparable(found), [v for v in found.values if not math.isnan(v)]
    calibrated = s.decided_by_opening(s.over_openings(study, at))
    judged = Finding(fitted=s.fitted(study, at), calibrated=calibrated, words=s.words)
    if nothing and all(map(s.side, some)):
        why = f"{nothing}, so there is nothing to compare{holds}"
        return replace(judged, result=f"{nothing}; {absorbed}", reason=why, undecided=why, calibrated=False)
    found = Distribution(some, found.of)
    side, reason = found.everywhere(s.side), s.shortfall.format_map(s.words)
    if not side:
        reason += f" (on the claimed side in {found.count(s.side)} of {len(found.values)})"
    judged = replace(judged, holds=side, reason=reason + holds, unit=s.unit)
    if len(found.values) == 1:  # nothing is sampled in it, so the place of the bump does not matter
        figure = f"{s.form.format(found.median)} {s.unit}"
        return replace(judged, result=f"{figure}; {absorbed}", value=found.median, band=s.band)
    return replace(judged, result=f"{found.text(s.form, s.unit, s.side)}; {absorbed}", over=found, band=s.band)
