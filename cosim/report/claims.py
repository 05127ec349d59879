"""Published statements, and how our runs judge them.

A claim is one published sentence. It is judged on two things: whether what it says holds (the order of two controllers,
the sign of a change), and, where the paper gives a number, whether our result lies in a band around it. A claim that
holds because a parameter was fitted to it is calibrated, not reproduced. Where the runs do not decide, it is open.
Conditions and seeds never make further claims. Additional checks, which no paper states, are counted separately.
"""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np

from cosim.core.content_checks import assign, check_choice, check_id, check_text, plain_value

Verdict = Literal[
    "reproduced",
    "calibrated",
    "trend reproduced, magnitude differs",
    "open",
    "not reproduced",
    "holds",
    "does not hold",
]
OUTCOMES: tuple[Verdict, ...] = get_args(Verdict)[:5]
"""Verdicts on published claims, from the best to the worst; the two others belong to additional checks."""

_SHARE = 0.10  # of a single published figure: how far our result may lie from it
_LEVEL = 0.05  # of the sign test: chance of so many seeds on one side if both sides were equally likely


@dataclass(frozen=True)
class Condition:
    """What came out under one condition of a claim that the paper states for several readings, such as two pumps."""

    name: str
    result: str
    verdict: Verdict
    value: float | None = None
    unit: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Claim:
    """One published statement (or, if `own`, an additional check) beside what came out here.

    `result` may be left empty when `value` (in `unit`) says it all. `criterion` is the rule that the verdict follows
    from, `fitted` what was chosen with published figures in view. A claim that was not reproduced in full needs a
    reason. `conditions` are its parts where it was judged under several, `share` says how many samples of a random
    design agree with the claim.
    """

    id: str
    claim: str
    published: str
    result: str
    verdict: Verdict
    reason: str = ""
    source: str = ""
    value: float | None = None
    unit: str = ""
    criterion: str = ""
    fitted: str = ""
    conditions: tuple[Condition, ...] = ()
    share: str = ""

    def __post_init__(self) -> None:
        where = f"claim '{self.id}'"
        check_id(where, self.id)
        check_choice(where, "verdict", self.verdict, Verdict)
        check_text(where, claim=self.claim, published=self.published)
        assign(self, "value", plain_value(where, self.value))
        if self.value is not None and (isinstance(self.value, bool) or not isinstance(self.value, int | float)):
            raise ValueError(f"{where}: value {self.value!r} is not a number; put text in 'result'")
        if not self.result.strip() and self.value is None:
            raise ValueError(f"{where} says nothing about our result; give 'result' or 'value'")
        if not self.passed and not self.reason.strip():
            raise ValueError(f"{where} has verdict '{self.verdict}'; say why in 'reason'")

    @property
    def own(self) -> bool:
        """An additional check, which no paper states."""
        return self.verdict in ("holds", "does not hold")

    @property
    def passed(self) -> bool:
        """Reproduced or calibrated in full; for a check, that it holds."""
        return self.verdict in ("reproduced", "calibrated", "holds")

    @property
    def reproduced(self) -> bool:
        """Whether the verdict is "reproduced"."""
        return self.verdict == "reproduced"


@dataclass(frozen=True)
class Band:
    """Where our figure counts as the published one: from `low` to `high`, both included.

    `reason` says why, where the band is not the usual one around a single published figure.
    """

    low: float
    high: float
    reason: str = ""

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(f"a band from {self.low!r} to {self.high!r} holds nothing")

    @classmethod
    def around(cls, published: float, share: float = _SHARE, reason: str = "") -> Band:
        """Within `share` of a single published figure; another share than 10 % needs its reason."""
        if share != _SHARE and not reason.strip():
            raise ValueError(f"a band of {100 * share:g} % around {published:g} needs its reason; 10 % is the rule")
        low, high = sorted((published * (1 - share), published * (1 + share)))
        return cls(low, high, reason)

    @property
    def open(self) -> bool:
        """A bound: at least, or at most."""
        return math.isinf(self.low) or math.isinf(self.high)

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high

    def text(self, unit: str = "") -> str:
        """The band in words, "between 2 and 15 %", "at least 2"."""
        suffix = f" {unit}" if unit and unit != "-" else ""
        if math.isinf(self.high):
            return f"at least {self.low:.3g}{suffix}"
        if math.isinf(self.low):
            return f"at most {self.high:.3g}{suffix}"
        if self.low == self.high:
            return f"{self.low:.3g}{suffix}"
        return f"between {self.low:.3g} and {self.high:.3g}{suffix}"


@dataclass(frozen=True)
class Distribution:
    """What a quantity came to over a random design (identification seeds, stretches of road) or over the speeds.

    A run that diverged counts as infinitely bad or as `nan`; a `nan` is on no side.
    """

    values: tuple[float, ...]
    of: str = "seeds"

    def __init__(self, values: Iterable[float], of: str = "seeds") -> None:
        assign(self, "values", tuple(float(v) for v in values))
        assign(self, "of", of)
        if not self.values:
            raise ValueError(f"a distribution over no {of}")

    @property
    def median(self) -> float:
        """Median; `nan` if a value is `nan`."""
        return math.nan if any(map(math.isnan, self.values)) else statistics.median(self.values)

    @property
    def low(self) -> float:
        """Smallest value."""
        return float(np.min(self.values))

    @property
    def high(self) -> float:
        """Largest value."""
        return float(np.max(self.values))

    def quantile(self, q: float) -> float:
        """The least value that at least a share q does not exceed: one that occurred; `nan` if a value is `nan`."""
        return float(np.quantile(self.values, q, method="inverted_cdf"))

    def count(self, holds: Callable[[float], bool]) -> int:
        """How many values are on the claimed side."""
        return sum(bool(holds(v)) for v in self.values)

    def is_significant(self, holds: Callable[[float], bool]) -> bool:
        """Whether a random design decides for the claimed side: one-sided sign test at 5 % (7 of 8, 5 of 5)."""
        n = len(self.values)
        chance = sum(math.comb(n, k) for k in range(self.count(holds), n + 1)) / 2**n  # of at least so many
        return chance <= _LEVEL

    def everywhere(self, holds: Callable[[float], bool]) -> bool:
        """Whether all values are on the claimed side, as a claim over all speeds needs it."""
        return self.count(holds) == len(self.values)

    def text(self, form: str = "{:.3g}", unit: str = "", holds: Callable[[float], bool] | None = None) -> str:
        """The distribution in words, "median 0.31 (0.21 to 0.42 over 8 seeds; on the claimed side in 7)"."""
        suffix = f" {unit}" if unit and unit != "-" else ""
        span = f"{form.format(self.low)} to {form.format(self.high)}{suffix} over {len(self.values)} {self.of}"
        side = "" if holds is None else f"; holds in {self.count(holds)} of {len(self.values)}"
        return f"median {form.format(self.median)}{suffix} ({span}{side})"


@dataclass(frozen=True)
class Evidence:
    """One distribution that a claim was judged on, and how many of its values are on the claimed side."""

    COLUMNS: ClassVar[tuple[str, ...]] = (
        "claim",
        "quantity",
        "unit",
        "median",
        "lowest",
        "lower quartile",
        "upper quartile",
        "highest",
        "on the claimed side",
        "of",
    )

    claim: str
    quantity: str
    unit: str
    distribution: Distribution
    on_side: int

    def row(self) -> list[str | float | int]:
        """Cells of a table with `COLUMNS`; numbers to four significant digits."""
        d = self.distribution
        spread = [float(f"{x:.4g}") for x in (d.median, d.low, d.quantile(0.25), d.quantile(0.75), d.high)]
        return [self.claim, self.quantity, self.unit, *spread, self.on_side, len(d.values)]


@dataclass(frozen=True)
class Counts:
    """How often each verdict occurs, published claims and additional checks separately."""

    verdicts: dict[Verdict, int]
    checks_held: int
    checks: int

    @classmethod
    def of(cls, claims: Sequence[Claim]) -> Counts:
        """Count the verdicts of these claims and checks."""
        found = Counter(c.verdict for c in claims)
        held, failed = found["holds"], found["does not hold"]
        return cls({v: found[v] for v in OUTCOMES}, held, held + failed)

    @property
    def published(self) -> int:
        """Number of published claims."""
        return sum(self.verdicts.values())

    @property
    def reproduced(self) -> int:
        """Number of published claims that are reproduced."""
        return self.verdicts["reproduced"]


def verdict_of(
    holds: bool,
    value: float | None = None,
    band: Band | None = None,
    over: Distribution | None = None,
    undecided: str = "",
    calibrated: bool = False,
) -> Verdict:
    """Verdict on a published claim.

    Args:
        holds: whether the claim holds, leaving the published number aside.
        value: our figure; not a number counts as none.
        band: where the value counts as the published one.
        over: distribution that the value is the median of. A band that is open on one side is a bound, which then has
            to hold significantly (`Distribution.is_significant`), not in the median alone.
        undecided: why the runs do not decide.
        calibrated: whether a parameter was fitted to this very claim.
    """
    if undecided:
        return "open"
    if not holds:
        return "not reproduced"
    number = rounded(value if over is None else over.median)
    magnitude = band is None or (number is not None and number in band)
    if band is not None and band.open and over is not None:
        magnitude = magnitude and over.is_significant(band.__contains__)
    if not magnitude:
        return "trend reproduced, magnitude differs"
    return "calibrated" if calibrated else "reproduced"


def verdict_under(conditions: Sequence[Verdict], together: bool = False) -> Verdict:
    """Verdict on a claim from those on its parts.

    If all have to hold `together` it is the worst. Under several conditions, of which none is the paper's, it is open
    where the claim holds under one and not under another.
    """
    if not together and len(set(conditions)) > 1 and {"open", "not reproduced"} & set(conditions):
        return "open"
    return max(conditions, key=OUTCOMES.index)


def rounded(value: float | None) -> float | None:
    """A figure as claims keep it, to five significant digits; none where there is no number."""
    return None if value is None or np.isnan(value) else float(f"{value:.5g}")


class Claims(list[Claim]):
    """Claims of a report in their order.

    `evidence` holds the distributions that they were judged on. `passed` says of each claim with which samples of the
    random design it holds in full, if each of them was judged alone.
    """

    def __init__(self, claims: Iterable[Claim] = ()) -> None:
        super().__init__(claims)
        self.evidence: list[Evidence] = []
        self.passed: list[list[bool]] = []

    @property
    def published(self) -> int:
        """Number of published claims."""
        return sum(not c.own for c in self)

    @property
    def by_sample(self) -> list[int]:
        """Number of published claims that hold in full with each sample alone."""
        return [sum(each) for each in zip(*(p for p in self.passed if p), strict=True)]
