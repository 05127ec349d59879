"""Statements of paper 001 on the whole vehicle: for each, a figure computed from runs, and the rule that judges it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cosim.experiments.hmmwv.averages import Averages
from cosim.experiments.hmmwv.published import NULL_OPENINGS_MM, VARIANTS, WITHOUT_LIMIT, WITHOUT_PREVIEW, Condition
from cosim.experiments.hmmwv.runs import Case
from cosim.study import Band, Distribution
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

TWOFOLD = Band(2.0, math.inf, "better than twofold")
THREEFOLD = Band(2.5, 3.5, "near threefold")
SLIGHTLY = Band(2.0, 15.0, "slightly better")
HANDILY = Band(SLIGHTLY.high, math.inf, 'handily: more than the "slightly" of the test track')
PREVIEW_GAIN = Band(10.0, 20.0, "one drive over one bump, printed to the nearest 5 %")
ALIKE = (
    SLIGHTLY.high
)  # %, by which controllers that the paper calls comparable may differ from MPC, which is "slightly better"


@dataclass(frozen=True)
class Statement:
    """One published statement on the controlled car.

    `subject` is the controller that it is about, where a sentence is about several; `figure` gives the figure over the
    places, `side` says of one value whether it is on the claimed side, `band`
    is for the median, a bound for every value. `controllers`: whose runs it needs (and the passive car's).
    `fitted`: what was chosen, from study and condition. `calibrated`: whether the statement would not hold with another
    plausible value of what was chosen with the published figure in view. `nothing`: what a figure of 0 over 0 means,
    where there may be one.
    """

    id: str
    subject: str
    claim: str
    published: str
    source: str
    road: str
    controllers: tuple[str, ...]
    figure: Callable[[Averages, Condition], Distribution]
    side: Callable[[float], bool]
    criterion: str
    shortfall: str
    unit: str = "%"
    form: str = "{:.0f}"
    band: Band | None = None
    fitted: Callable[[Averages, Condition], str] = lambda study, at: ""
    calibrated: Callable[[Averages, Condition], bool] = lambda study, at: False
    nothing: str = ""

    def incomparable(self, found: Distribution) -> str:
        """Where a figure is 0 over 0, in words; empty where it is nowhere."""
        count = sum(map(math.isnan, found.values))
        return f"{self.nothing} at {count} of {len(found.values)} {found.of}" if count else ""

    def holds(self, study: Averages, at: Condition) -> bool:
        """Whether the statement holds in full under this condition."""
        found, band = self.figure(study, at), self.band
        if band is not None and not (found.everywhere(band.__contains__) if band.open else found.median in band):
            return False
        return found.everywhere(self.side)


@dataclass(frozen=True)
class Published:
    """A published sentence: the statements whose whole it is, one for each of its subjects."""

    id: str
    claim: str
    parts: tuple[Statement, ...]

    @property
    def road(self) -> str:
        """Where it is about."""
        return self.parts[0].road

    @property
    def published(self) -> str:
        """Its figure or wording."""
        return next(s.published for s in self.parts if s.published)

    @property
    def source(self) -> str:
        """Where it is printed."""
        return self.parts[0].source


def times_better(road: str, controller: str) -> Callable[[Averages, Condition], Distribution]:
    """Absorbed power of the passive car over that under a controller."""
    return lambda study, at: study.ratio(Case(road, "passive"), at(Case(road, controller)))


def gain(
    road: str, controller: str, others: Sequence[str], key: str = "absorbed_power"
) -> Callable[[Averages, Condition], Distribution]:
    """Reduction [%] of a controller's metric from the lowest of the others, place by place; 0 over 0 is NaN."""

    def found(study: Averages, at: Condition) -> Distribution:
        each = [study.ratio(at(Case(road, controller)), at(Case(road, o)), key).values for o in others]
        return Distribution((100 * (1 - max(r)) for r in zip(*each, strict=True)), of=VARIANTS[road])

    return found


def apart(road: str, controllers: Sequence[str], reference: str) -> Callable[[Averages, Condition], Distribution]:
    """By how much [%] the absorbed power of that controller which is furthest from the reference's differs from it."""

    def found(study: Averages, at: Condition) -> Distribution:
        each = [study.ratio(at(Case(road, c)), at(Case(road, reference))).values for c in controllers]
        return Distribution(
            (max((100 * (r - 1) for r in rs), key=abs) for rs in zip(*each, strict=True)), of=VARIANTS[road]
        )

    return found


def watts(road: str, controller: str) -> Callable[[Averages, Condition], Distribution]:
    """Absorbed power [W]."""
    return lambda study, at: study.distribution("absorbed_power", at(Case(road, controller)))


# ------------------------------------------------------------------------------------------------- what was chosen


def _reading(controller: str) -> str:
    """How the paper's numbers of a controller are read, where the print cannot be meant."""
    if controller == "lqr":
        return "weights of Table 1.1 read with the force in N, not kN"
    return "force rate of Table 1.3 read as per period of 30 ms, not per second" if controller.startswith("mpc") else ""


@dataclass(frozen=True)
class _Opening:
    """What the opening of the passive car's spools does to a ratio to it."""

    road: str
    controller: str
    band: Band

    def ratios(self, study: Averages, at: Condition) -> list[float]:
        """With each plausible opening."""
        power = study.power(at(Case(self.road, self.controller)))
        return [study.power(Case(self.road, "passive", null_opening_mm=mm)) / power for mm in NULL_OPENINGS_MM]

    def decides(self, study: Averages, at: Condition) -> bool:
        """Whether the ratio is in the band with one opening and out of it with another."""
        return len({r in self.band for r in self.ratios(study, at)}) > 1

    def text(self, study: Averages, at: Condition) -> str:
        """In words."""
        ratios = self.ratios(study, at)
        opening = (
            f"null opening of the unpowered spool, which damps the passive car: {study.null_opening_mm:g} mm, assumed"
            f" with the passive figure in view; {min(NULL_OPENINGS_MM):g} to {max(NULL_OPENINGS_MM):g} mm are plausible"
            f" and give {min(ratios):.2f} to {max(ratios):.2f} times"
            + (", in and out of the band" if self.decides(study, at) else "")
        )
        return "; ".join(filter(None, (opening, _reading(self.controller))))


def roughness_range(study: Averages, at: Condition = WITHOUT_LIMIT) -> tuple[float, float]:
    """Spectra, as shares of the assumed one, between which MPC alone stays below the driver's limit on every stretch.

    Absorbed power is taken as proportional to the spectrum; empty (first above second) where there are none.
    """
    others = min(watts("off-road", c)(study, at).low for c in ("skyhook", "lqr"))
    return ABSORBED_POWER_LIMIT / others, ABSORBED_POWER_LIMIT / watts("off-road", "mpc")(study, at).high


def _terrain(controller: str) -> Callable[[Averages, Condition], str]:
    def text(study: Averages, at: Condition) -> str:
        low, high = roughness_range(study, at)
        only = (
            f"MPC alone stays below {ABSORBED_POWER_LIMIT:g} W for spectra of about {low:.2f} to {high:.2f} times that"
            " one (power taken as proportional)"
            if low < high
            else f"on no spectrum does MPC alone stay below {ABSORBED_POWER_LIMIT:g} W (power taken as proportional)"
        )
        chosen = f"the terrain is not in the paper: class E of ISO 8608 is assumed; {only}"
        spool = "so is the null opening of the unpowered spool" if controller == "passive" else ""
        return "; ".join(t for t in (chosen, spool, _reading(controller)) if t)

    return text


# --------------------------------------------------------------------------------------------------- statements


def _twofold(controller: str) -> Statement:
    opening = _Opening("track", controller, TWOFOLD)
    return Statement(
        f"track-twofold-{controller}",
        NAMES[controller],
        f"{NAMES[controller]} at least halves the absorbed power of the passive car",
        "better than twofold",
        "Figure 1.9, section 1.6",
        "track",
        (controller,),
        times_better("track", controller),
        lambda x: x > 1,
        "less power than the passive car absorbs at every place of the bumps",
        "less than twofold",
        "times",
        "{:.2f}",
        TWOFOLD,
        opening.text,
        opening.decides,
    )


def _driver(controller: str) -> Statement:
    below = controller == "mpc"
    side = "below" if below else "above"
    return Statement(
        f"off-road-driver-{controller}",
        NAMES[controller],
        f"at 20 mph {NAMES[controller]} is {side} the {ABSORBED_POWER_LIMIT:g} W that a driver bears",
        f"only MPC below {ABSORBED_POWER_LIMIT:g} W" if below else "",
        "Figure 1.10, section 1.6",
        "off-road",
        (controller,),
        watts("off-road", controller),
        (lambda x: x < ABSORBED_POWER_LIMIT) if below else (lambda x: x > ABSORBED_POWER_LIMIT),
        f"{side} {ABSORBED_POWER_LIMIT:g} W on every stretch",
        f"not {side} it on every stretch",
        "W",
        "{:.1f}",
        None,
        _terrain(controller),
    )


_THREEFOLD_OPENING = _Opening("bump", "mpc-preview", THREEFOLD)


def _alone(statement: Statement) -> Published:
    return Published(statement.id, statement.claim, (statement,))


PUBLISHED_SENTENCES = (
    Published(
        "track-twofold",
        "every controller at least halves the absorbed power of the passive car",
        tuple(map(_twofold, ("skyhook", "lqr", "mpc"))),
    ),
    _alone(
        Statement(
            "track-alike",
            "",
            "skyhook and LQR are comparable to MPC",
            "comparable to the MPC performance",
            "section 1.6",
            "track",
            ("skyhook", "lqr", "mpc"),
            apart("track", ("skyhook", "lqr"), "mpc"),
            lambda x: abs(x) <= ALIKE,
            f'both within {ALIKE:g} % of MPC at every place of the bumps: no more than the paper\'s "slightly better"'
            " permits",
            "MPC goes further than the others",
            fitted=lambda study, at: _reading("lqr"),
        )
    ),
    _alone(
        Statement(
            "track-mpc-best",
            "",
            "MPC is slightly better than the others without preview",
            "slightly better",
            "section 1.6",
            "track",
            (*WITHOUT_PREVIEW, "mpc"),
            gain("track", "mpc", WITHOUT_PREVIEW),
            lambda x: x > 0,
            "below the best of skyhook, LQR and zero force at every place of the bumps; the median is judged for size",
            "the difference has another size",
            band=SLIGHTLY,
            fitted=lambda study, at: _reading("mpc"),
        )
    ),
    Published(
        "off-road-driver",
        f"at 20 mph only MPC is below the {ABSORBED_POWER_LIMIT:g} W that a driver bears",
        tuple(map(_driver, ("passive", "skyhook", "lqr", "mpc"))),
    ),
    _alone(
        Statement(
            "off-road-mpc-best",
            "",
            "MPC beats the other controllers handily",
            "handily",
            "section 1.6",
            "off-road",
            (*WITHOUT_PREVIEW, "mpc"),
            gain("off-road", "mpc", WITHOUT_PREVIEW),
            lambda x: x > 0,
            "below the best of skyhook, LQR and zero force on every stretch",
            "the difference is smaller",
            band=HANDILY,
            fitted=lambda study, at: _reading("lqr"),
        )
    ),
    _alone(
        Statement(
            "off-road-travel",
            "",
            "MPC moves the suspension less than skyhook and LQR",
            "reduced suspension travel",
            "Figure 1.10",
            "off-road",
            ("skyhook", "lqr", "mpc"),
            gain("off-road", "mpc", ("skyhook", "lqr"), "travel_rms"),
            lambda x: x > 0,
            "rms travel below that under skyhook and under LQR on every stretch; the paper gives no size",
            "not on every stretch, compared with both",
            form="{:.1f}",
            fitted=lambda study, at: _reading("lqr"),
        )
    ),
    _alone(
        Statement(
            "bump-preview",
            "",
            "preview improves MPC",
            "15 %",
            "Figure 1.11",
            "bump",
            ("mpc", "mpc-preview"),
            gain("bump", "mpc-preview", ("mpc",)),
            lambda x: x > 0,
            "less power than without preview at every place of the bump; the median is judged for size",
            "the improvement has another size",
            band=PREVIEW_GAIN,
            fitted=lambda study, at: (
                "the preview is exact; the paper's is synchronized to the road by sensors, with an error that it does"
                " not give"
            ),
        )
    ),
    _alone(
        Statement(
            "bump-threefold",
            "",
            "MPC with preview divides the absorbed power of the passive car by nearly three",
            "near threefold",
            "Figures 1.9, 1.11",
            "bump",
            ("mpc-preview",),
            times_better("bump", "mpc-preview"),
            lambda x: x > 1,
            "less power than the passive car absorbs at every place of the bump; the median is judged for size",
            "the improvement has another size",
            "times",
            "{:.2f}",
            THREEFOLD,
            _THREEFOLD_OPENING.text,
            _THREEFOLD_OPENING.decides,
        )
    ),
    _alone(
        Statement(
            "bump-saturation",
            "",
            "with preview the valves saturate less",
            "reduced, in theory",
            "section 1.6",
            "bump",
            ("mpc", "mpc-preview"),
            gain("bump", "mpc-preview", ("mpc",), "saturation"),
            lambda x: x > 0,
            "less of the time in saturation than without preview at every place of the bump; the paper gives no size",
            "not at every place of the bump",
            nothing="neither with preview nor without does a valve saturate",
        )
    ),
)
"""What the paper says of the car, one entry for each sentence, in its order."""

STATEMENTS = tuple(s for sentence in PUBLISHED_SENTENCES for s in sentence.parts)
