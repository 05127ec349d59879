"""How the claims of paper 000 are judged: on seeds, on speeds, at equal response, within bands.

The excitation that the controllers are identified with is random, so a claim about a controller is judged on all
identification seeds ("significantly": a sign test over them at 5 %, 7 of 8 seeds), and a claim about a road on all
speeds of the study. Implicit and preview are compared at the weights at which their response equals explicit's, as in
the paper; what they do at R = 1e-7 is said beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property

from cosim.experiments.gpc.results import Results, Study
from cosim.experiments.gpc.runs import R_PUBLISHED
from cosim.study import Band, Distribution, Evidence, Finding
from fmu_sources.controllers.gpc.identification import IdentificationSettings

SAME = Band(0.9, 1.1, "the same, or almost: within 10 %")
MORE = Band(1.2, math.inf, "significantly more: by a fifth at least")
MUCH_MORE = Band(1.5, math.inf, "much more: by half at least")
ALMOST_TWICE = Band(1.7, 2.05, "almost twice: up to 15 % below, and what a figure can be read to above")
SLIGHTLY = Band(2.0, 15.0, "slightly")
COALESCE = 1.15  # largest over smallest effectiveness per force over the weights, of curves that lie on one another
VISIBLE_ROLL = 0.05  # of the run's pitch: less adds about 0.1 % to the response (22a), sqrt(pitch^2 + roll^2)
CONVERGED = 0.005  # relative, the tolerance to which responses are matched

EXCITATION = (
    f"the level of the excitation, {IdentificationSettings().excitation / 1e3:g} kN per actuator, which the paper does"
    " not give, was chosen with the published behavior in view"
)
MATCHING = "the weights of implicit and preview are matched to explicit's response, seed by seed"
STAND_IN = {"perryman3": "the measured course is not public: the road is synthetic, with the published character"}
"""What a road stands in for, by name; no entry for those that the paper describes in full."""


def chosen(*what: str | None) -> str:
    """What was chosen by us, in one phrase; nothing where there is nothing to say."""
    return "; ".join(filter(None, what))


def number(weight: float) -> str:
    """A control weight [1/N2] as text, "1e-7"."""
    return f"{weight:g}".replace("e-0", "e-")


R_TEXT = f"R = {number(R_PUBLISHED)}"
Above = Callable[[float], bool]


class Judge:
    """What the claims are judged on: results, and what of the vehicle was chosen with the paper's figures in view."""

    def __init__(self, study: Study, fitted: str = "") -> None:
        self.results = Results(study)
        self.fitted = fitted
        self.speeds = study.speeds

    @cached_property
    def move(self) -> float:
        """Largest relative change of a metric by halved steps."""
        return self.results.largest_move()

    def where(
        self, seen: Evidence, quantity: str, at: Callable[[float], Distribution | None], holds: Above, unit: str = "-"
    ) -> list[float]:
        """Speeds at which the seeds decide significantly for the claimed side; `seen` keeps the evidence."""
        return [v for v in self.speeds if seen.is_significant(f"{quantity}, {v:g} km/h", at(v), holds, unit)]

    def open(self, value: float, band: Band, unit: str) -> str:
        """Why halved steps might change on which side of the band's edge a value lies; empty if they do not."""
        low, high = sorted((value * (1 - self.move), value * (1 + self.move)))
        if not math.isfinite(self.move) or (low in band) == (high in band):
            return ""
        return (
            f"halving steps moves metrics by up to {100 * self.move:.2g} %: {low:.4g} to {high:.4g} {unit} (edge of the"
            " band)"
        )

    def ratio_by_speed(
        self, road: str, quantity: str, controller: str, to: str
    ) -> Callable[[float], Distribution | None]:
        """A function of the speed [km/h]: ratios of a quantity of one controller to that of another, over the seeds."""
        return lambda v: self.results.ratios(road, v, quantity, controller, to)


def most(count: int, seeds: Sequence[int]) -> bool:
    """Whether so many seeds are significantly more than half of them."""
    return Distribution([1.0] * count + [0.0] * (len(seeds) - count)).is_significant(lambda x: x > 0)


def same(j: Judge, road: str) -> Finding:
    """Preview and explicit need the same force and power for the same response."""
    seen, quantities = Evidence(), ("force", "power")
    ratio = {q: j.ratio_by_speed(road, q, "preview", "explicit") for q in quantities}
    where = {q: j.where(seen, f"{q}, preview / explicit", ratio[q], SAME.__contains__) for q in quantities}
    both = [v for v in j.speeds if all(v in where[q] for q in quantities)]
    return Finding(
        "; ".join(f"{q} {span(j, ratio[q], 'explicit')}" for q in quantities)
        + f"; both alike {at_speeds(both, j.speeds)}",
        both == list(j.speeds),
        f"at the other speeds force or power is not {SAME.text('times')} explicit's, or the seeds do not decide:"
        " explicit takes the road ahead to be at height 0, as printed, and pays for that where it is not",
        criterion=(
            f"force and power {SAME.text('times')} explicit's ({SAME.reason}), significantly over the seeds, at"
            " every speed"
        ),
        fitted=chosen(MATCHING, STAND_IN.get(road)),
        evidence=seen,
    )


def implicit_needs_more(j: Judge, road: str, quantities: Sequence[str]) -> Finding:
    """Implicit needs more than explicit for the same response at every speed; value: the first quantity's."""
    seen = Evidence()
    ratio = {q: j.ratio_by_speed(road, q, "implicit", "explicit") for q in quantities}
    where = {q: j.where(seen, f"{q}, implicit / explicit", ratio[q], lambda x: x > 1) for q in quantities}
    both = [v for v in j.speeds if all(v in where[q] for q in quantities)]
    first = quantities[0]
    medians = [d.median for v in j.speeds if (d := ratio[first](v)) is not None]
    over = Distribution(medians, "speeds") if medians else None
    return Finding(
        "; ".join(f"{q} {span(j, ratio[q], 'explicit')}, more {at_speeds(where[q], j.speeds)}" for q in quantities),
        both == list(j.speeds),
        "at the other speeds implicit needs about as much or less, or the seeds do not decide: explicit pays for its "
        "assumption of height 0 ahead, and where no controller helps there is nothing to match",
        None if over else math.nan,
        "times",
        MORE,
        over,
        criterion=(
            "more force and more power than explicit, significantly over the seeds, at every speed; value: median"
            " over the "
            f"speeds of {first}"
        ),
        fitted=chosen(MATCHING, EXCITATION, STAND_IN.get(road)),
        evidence=seen,
    )


def at_speeds(where: Sequence[float], speeds: Sequence[float]) -> str:
    """Speeds in words, "at 2 of 8 speeds (10, 20 km/h)"."""
    named = f" ({', '.join(f'{v:g}' for v in where)} km/h)" if 0 < len(where) < len(speeds) else ""
    return f"at {len(where)} of {len(speeds)} speeds{named}"


def span(j: Judge, at: Callable[[float], Distribution | None], to: str) -> str:
    """A ratio to another controller in words, "0.34 to 1.02 times explicit's": medians of the seeds over the speeds."""
    medians = [d.median for v in j.speeds if (d := at(v)) is not None]
    return (
        f"{min(medians):.2f} to {max(medians):.2f} times {to}'s"
        if medians
        else f"not comparable with {to}'s at any speed"
    )


def median_text(values: Distribution | None, form: str) -> str:
    """The median as `form` has it, with what follows it."""
    return "not matched" if values is None else form.format(values.median)
