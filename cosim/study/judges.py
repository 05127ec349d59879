"""The judge that claims of all experiments share: quantities compared with a bound, place by place.

    [[claim]]
    id = "bump-mpc"
    judge = "compare"
    at = "bumps"                          # places, as the experiment's `View` names them
    compare = [
      { ratio = ["acceleration", "overshoot"], of = "mpc", to = "passive", most = 0.5 },
      { name = "after", value = "acceleration", of = "mpc" },
    ]
    result = "rms acceleration {after[0]:.2f} m/s2"

A line of `compare` has one form: `value` (or `percent`, 100 times it), `ratio`, `percent`, `reduction` [%], `rise` [%]
or `same` (the difference in either direction [%]) of a quantity of `of` to that of `to`, another subject or a number.
Lists stand for each of their entries; `of`, `to` and `at` of the entry hold for lines without their own. A line with a
side (`above`, `below`, `least`, `most`, `within`) is judged, if it is not only `shown`; the order of several subjects
is ratios above or below 1. A claim holds if all judged lines do, at every place (or as many as the view says). `sized`
gives the claim its value: "low", "high" or "median" of the line, or in how many places it "held". Sentences have the
figures of a line by its `name` (`Figures`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

import numpy as np

from cosim.report.claims import Band, Distribution
from cosim.study.claims import Evidence, Finding

Place = Any
Side = Callable[[float], bool]
Quantities = Mapping[str, Callable[[Any, str, Any], float | None]]  # of view, subject and place
Values = Callable[[Place], Distribution | None]  # of a quantity over its samples, by place; None: there are none


def quotient(above: float, below: float) -> float:
    """A quotient; from nothing, such as the roll of a symmetric car on one profile, everything is infinitely more."""
    return above / below if below else math.inf if above else math.nan


_FORMS: dict[str, Callable[[float, float], float]] = {
    "value": lambda own, _: own,
    "ratio": quotient,
    "percent": lambda own, other: 100 * quotient(own, other),
    "reduction": lambda own, other: 100 * (1 - quotient(own, other)),
    "rise": lambda own, other: 100 * (quotient(own, other) - 1),
    "same": lambda own, other: 100 * abs(quotient(own, other) - 1),
}
_UNITS = {"value": "", "ratio": "times"}  # of the forms that are not in per cent
SIDES: dict[str, Callable[[Any], Side]] = {
    "above": lambda edge: lambda x: x > edge,
    "below": lambda edge: lambda x: x < edge,
    "least": lambda edge: lambda x: x >= edge,
    "most": lambda edge: lambda x: x <= edge,
    "within": lambda edges: lambda x: edges[0] <= x <= edges[1],
}
_SIZES: dict[str, Callable[[Sequence[float]], Any]] = {"low": min, "high": max, "median": np.median}


def names(given: Any) -> tuple[Any, ...]:
    """One entry or several, as several."""
    return tuple(given) if isinstance(given, list | tuple) else (given,)


@dataclass(frozen=True)
class Comparison:
    """One comparison: a quantity of a subject to another subject's or to a number, and the claimed side."""

    quantity: str
    of: str
    to: str | float
    form: str
    side: Side | None
    unit: str

    def number(self, own: float, other: float | None = None) -> float:
        """What the form makes of the quantity of both."""
        return _FORMS[self.form](own, float(self.to or 1) if other is None else other)

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

    def text(self, medians: Sequence[float]) -> str:
        """Medians over the places in words, "force of preview 0.34 to 1.02 times explicit's"."""
        if not medians:
            return f"{self.what} of {self.of} cannot be compared"
        changes = sorted(-x if self.form == "reduction" else x for x in medians)
        span = _span((changes[0], changes[-1]), {"ratio": ".2f", "value": ".3g"}.get(self.form, "+.0f"))
        unit = f" {self.unit}" if self.unit else ""
        base = f" {self.to}'s" if self.form == "ratio" else "" if self.to in ("", "passive") else f" from {self.to}'s"
        return f"{self.what} of {self.of} {span}{unit}{base}"


_WORDS = {"rms_az": "acceleration", "rms_pitch": "pitch", "rms_roll": "roll", "peak_pitch": "peak of pitch"}


def _span(values: Sequence[float], form: str) -> str:
    """Range of values, "0.563 to 150", or one value if both ends print alike."""
    return " to ".join(dict.fromkeys(format(v, form) for v in (min(values), max(values))))


class View:
    """A study as its claims name it: quantities of subjects, such as controllers, at places, such as roads.

    Experiments say what their places, subjects and quantities are; a quantity is a metric, "one/another", or a function
    of `quantities` of view, subject and place, which gives None where there is nothing to look at.
    """

    held: ClassVar[float] = 1.0  # share of the places that can be compared, at which a claim has to hold
    compared: ClassVar[float] = 0.0  # share of all places that have to be such
    made: ClassVar[Any] = None  # makes the case of a place that is a tuple, such as road and speed, and a subject
    named: ClassVar[str] = ""  # format of the name of a place that is a tuple
    quantities: ClassVar[Quantities] = {}
    words: Mapping[str, Any] = {}  # for the sentences of all claims
    left_out: ClassVar[str] = "no run of the study decides this"  # why a claim whose places are none is open

    def __init__(self, study: Any) -> None:
        self.study = study

    def places(self, at: Any, road: str) -> Sequence[Place]:
        """The places that an entry names, all of them for "everywhere"."""
        raise NotImplementedError

    def case(self, subject: str, place: Place) -> Any:
        """The run of a subject at a place; a place that is no tuple is a run itself."""
        return self.made(*place, subject) if self.made and isinstance(place, tuple) else place

    def label(self, place: Place) -> str:
        """A place in words."""
        if self.named and isinstance(place, tuple):
            return self.named.format(*place)
        return str(getattr(place, "label", place))

    def missing(self, places: Sequence[Place], every: Sequence[Place]) -> str:  # noqa: ARG002
        """Text for the places at which a line does not hold, of every one."""
        return ", ".join(map(self.label, places))

    def quantity(self, name: str, subject: str, place: Place) -> float | None:
        """A quantity of a subject at a place; None if the study has no run of it."""
        if name in self.quantities:
            return self.quantities[name](self, subject, place)
        row, (above, _, below) = self.study[self.case(subject, place)], name.partition("/")
        return quotient(row[above], row[below]) if below else float(row[above])

    def values(self, c: Comparison, place: Place) -> Distribution | None:
        """A comparison at a place, over its samples."""
        found = [self.quantity(c.quantity, s, place) for s in (c.of, c.to) if isinstance(s, str) and (s or s is c.of)]
        known = [x for x in found if x is not None]
        return Distribution([c.number(*known)]) if len(known) == len(found) else None

    def is_comparable(self, found: Sequence[Distribution | None]) -> bool:
        """Whether there is enough at a place to compare; by default one of the quantities."""
        return any(values is not None for values in found)

    def decides(self, values: Distribution, holds: Side, strict: bool) -> bool:
        """Whether the samples of a place are on the claimed side: all, or if `strict` significantly many."""
        return values.is_significant(holds) if strict else values.everywhere(holds)

    def unsettled(self, value: float, band: Band | None, unit: str) -> str:  # noqa: ARG002
        """Why a value does not decide on which side of the band's edge it is; empty if it does."""
        return ""

    def text(self, tally: Tally) -> str:
        """The places at which a claim holds in words."""
        return f"as claimed at {len(tally.on_side)} of {len(tally.places)}"


@dataclass
class Tally:
    """Quantities of a claim by place: where they can be compared, and where all are on the claimed side."""

    view: Any
    places: Sequence[Place]
    strict: bool = False
    seen: Evidence = field(default_factory=Evidence)
    compared: list[Place] = field(default_factory=list)
    on_side: list[Place] = field(default_factory=list)

    def look(self, *quantities: tuple[str, Values, Side, str]) -> Tally:
        """Look at quantities: name, values, claimed side and unit."""
        for place in self.places:
            found = [(name, at(place), holds, unit) for name, at, holds, unit in quantities]
            for name, values, holds, unit in found:
                self.seen.is_significant(f"{name}, {self.view.label(place)}", values, holds, unit)
            if not self.view.is_comparable([values for _, values, *_ in found]):
                continue
            self.compared.append(place)
            if all(self.view.decides(d, holds, self.strict) for _, d, holds, _ in found if d is not None):
                self.on_side.append(place)
        return self

    @property
    def holds(self) -> bool:
        """Whether the claim holds over the places."""
        if self.strict:
            return self.on_side == list(self.places)
        return (
            len(self.compared) >= self.view.compared * len(self.places)
            and len(self.on_side) >= self.view.held * len(self.compared)
            and bool(self.compared)
        )

    @property
    def text(self) -> str:
        """The places in words."""
        return str(self.view.text(self))


class Words:
    """Text that is made where a sentence has it, from its format specification."""

    def __init__(self, form: Callable[[str], str]) -> None:
        self._form = form

    def __format__(self, form: str) -> str:
        return self._form(form)


class Figures(Sequence[float]):
    """The numbers of a line for the sentences of a claim: `{name:.2f}` is their range, `{name[0]:.2f}` the first.

    `low`, `high`, `sum`; `at_low` and `at_high` are where; `held` is at how many of its `places` the line
    holds, `missing` text for the others, `spread` the samples of the first place.
    """

    def __init__(self, line: _Line, tally: Tally) -> None:
        found = [(p, d) for c in line.parts for p in tally.places if (d := line.view.values(c, p)) is not None]
        self._line, self._found, self._numbers = line, found, [d.median for _, d in found]
        self.held, self.places = len(tally.on_side), len(tally.places)
        self.missing = line.view.missing([p for p in tally.places if p not in tally.on_side], tally.places)
        self.sum = sum(self._numbers)

    def __getitem__(self, i: Any) -> Any:
        return self._numbers[i]

    def __len__(self) -> int:
        return len(self._numbers)

    def __iter__(self) -> Iterator[float]:
        return iter(self._numbers)

    def __format__(self, form: str) -> str:
        return _span(self._numbers, form) if self._numbers else ""

    @property
    def low(self) -> float:
        """The smallest number; NaN without numbers."""
        return min(self._numbers, default=math.nan)

    @property
    def high(self) -> float:
        """The largest number; NaN without numbers."""
        return max(self._numbers, default=math.nan)

    @property
    def at_low(self) -> str:
        """Where the smallest is."""
        return str(self._line.view.label(self._found[self._numbers.index(self.low)][0]))

    @property
    def at_high(self) -> str:
        """Where the largest is."""
        return str(self._line.view.label(self._found[self._numbers.index(self.high)][0]))

    @property
    def spread(self) -> Words:
        """The first place's distribution over its samples in words."""
        return Words(lambda form: self._found[0][1].text(f"{{:{form}}}", holds=self._line.parts[0].side))


class _Line:
    """A line of an entry: each of its quantities, of each subject, to each of the others.

    Raises:
        ValueError: it has no form, several forms or sides, or a key that is neither.
    """

    def __init__(self, view: Any, entry: Mapping[str, Any], road: str) -> None:
        forms, sides = [f for f in _FORMS if f in entry], [s for s in SIDES if s in entry]
        unknown = set(entry) - {*_FORMS, *SIDES, "of", "to", "at", "name", "sized", "shown", "unit"}
        self.name, self.shown, sized = entry.get("name", ""), entry.get("shown", False), entry.get("sized", "")
        self.sized = "median" if sized is True else sized
        if len(forms) != 1 or len(sides) > 1 or unknown or not (sides or self.name):
            raise ValueError(
                f"a comparison has one of {', '.join(_FORMS)}, one of {', '.join(SIDES)} or a name, and 'of', 'to'"
            )
        form, side = forms[0], SIDES[sides[0]](entry[sides[0]]) if sides else None
        self.view, self.places = view, view.places(entry.get("at", "everywhere"), road)
        self.judged = side is not None and not self.shown
        unit = entry.get("unit", _UNITS.get(form, "%"))
        self.parts = [
            Comparison(q, of, to, form, side, unit)
            for q in names(entry[form])
            for of in names(entry.get("of", ""))
            for to in names("" if form == "value" else entry.get("to", ""))
        ]

    def medians(self, c: Comparison, places: Sequence[Place]) -> list[float]:
        """The median of the samples at each place."""
        return [d.median for p in places if (d := self.view.values(c, p)) is not None]


def _tally(view: Any, lines: Sequence[_Line], strict: bool) -> Tally:
    """Look at lines together, at the places of the first."""
    look = ((c.name, partial(view.values, c), c.side, c.unit) for line in lines for c in line.parts if c.side)
    return Tally(view, lines[0].places, strict).look(*look)


def compare(
    view: Any,
    *,
    compare: Sequence[Mapping[str, Any]],
    at: Any = "everywhere",
    of: str = "",
    to: str = "",
    road: str = "",
    size_at: Any = None,
    band: Band | None = None,
    strict: bool = False,
) -> Finding:
    """Judge comparisons over places, as the module says.

    The value is the median over the places (that at `size_at`, if given), or another size, of the line marked `sized`;
    of several, the one that lies worst in the band.
    """
    given = {"at": at, "of": of, "to": to}
    lines = [_Line(view, {**given, **entry}, road) for entry in compare]
    judged = [line for line in lines if line.judged]
    at_places: dict[tuple[Place, ...], list[_Line]] = {}
    for line in judged:
        at_places.setdefault(tuple(line.places), []).append(line)
    tallies = [_tally(view, group, strict) for group in at_places.values()]
    own = {id(line): _tally(view, [line], strict) for line in lines if line.name or line.sized == "held"}
    compared = {place for tally in tallies for place in tally.compared}
    values: list[float] = []
    for line in lines:
        if line.sized == "held":
            values.append(len(own[id(line)].on_side))
        for c in line.parts if line.sized not in ("", "held") else ():
            where = (
                [p for p in line.places if line.shown or p in compared]
                if size_at is None
                else view.places(size_at, road)
            )
            if found := line.medians(c, where):
                values.append(float(_SIZES[line.sized](found)))
    sized = [line for line in lines if line.sized]
    unit = sized[0].parts[0].unit if sized else ""
    low, high = (band.low, band.high) if band is not None else (-math.inf, math.inf)
    value = min(values, key=lambda v: min(v - low, high - v), default=math.nan) if sized else None
    nothing = view.left_out if not all(tally.places for tally in tallies) else ""
    seen = Evidence([item for tally in tallies for item in tally.seen.seen])
    words = {line.name: Figures(line, own[id(line)]) for line in lines if line.name}
    automatic = [c.text(line.medians(c, line.places)) for line in judged for c in line.parts]
    return Finding(
        "; ".join(filter(None, [*automatic, *(tally.text for tally in tallies)])),
        all(tally.holds for tally in tallies),
        value=value,
        unit=unit,
        undecided=nothing or ("" if value is None else view.unsettled(value, band, unit)),
        evidence=seen,
        words={**view.words, **words},
    )
