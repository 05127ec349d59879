"""Published statements as functions: each carries what the paper says, and looks at a study for what came out.

    CLAIMS = ClaimList()

    @CLAIMS.claim("force-limit", "The MPC keeps the force within 8 N", published="within 8 N", source="Figure 9")
    def force_limit(study):
        worst = max(abs(row["force.max"]) for row in study.values())
        return Finding(f"at most {worst:.6g} N", worst <= 8, "the force exceeds its bound", criterion="in every run")

Verdicts follow from findings as `cosim.report.Claims` says.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from cosim.report.claims import Band, Claims, Distribution, Verdict, verdict_of
from cosim.study.results import RunFailed


@dataclass
class Evidence:
    """Distributions that a finding rests on, kept for the report's table of them."""

    seen: list[tuple[str, Distribution, Callable[[float], bool], str]] = field(default_factory=list)

    def is_significant(
        self, quantity: str, values: Distribution | None, holds: Callable[[float], bool], unit: str = "-"
    ) -> bool:
        """Whether `values` are on the claimed side (`Distribution.is_significant`); None is not."""
        if values is None:
            return False
        self.seen.append((quantity, values, holds, unit))
        return values.is_significant(holds)


@dataclass(frozen=True)
class Finding:
    """What a study says of a statement.

    `result`: what came out, in words. `holds`: whether what is claimed holds, leaving the published number aside.
    `reason`: why it does not, or not in that size. `value` [`unit`], or `over`, the distribution that it is the
    median of: our figure, which counts as the published one inside of `band`. `criterion`: the rule of `holds` in
    words. `fitted`: what was chosen with published figures in view. `undecided`: why the runs do not decide.
    """

    result: str
    holds: bool
    reason: str
    value: float | None = None
    unit: str = ""
    band: Band | None = None
    over: Distribution | None = None
    criterion: str = ""
    fitted: str = ""
    undecided: str = ""
    evidence: Evidence = field(default_factory=Evidence)

    @property
    def verdict(self) -> Verdict:
        """The verdict on a published statement that this leads to."""
        return verdict_of(self.holds, self.value, self.band, self.over, self.undecided)


@dataclass(frozen=True)
class Statement:
    """A statement and the function that judges it; `own`: an additional check, which no paper states.

    `text` is a function of the study where it names something that the FMUs which ran say; it finds words also if no
    run did.
    """

    id: str
    text: Text
    published: str
    source: str
    judge: Callable[[Any], Finding]
    own: bool = False


Text = str | Callable[[Any], str]
Judging = Callable[[Callable[[Any], Finding]], Callable[[Any], Finding]]


class ClaimList:
    """Statements in the order of the report."""

    def __init__(self) -> None:
        self.statements: dict[str, Statement] = {}

    def __iter__(self) -> Iterator[Statement]:
        return iter(self.statements.values())

    def __len__(self) -> int:
        return len(self.statements)

    def include(self, others: ClaimList) -> None:
        """Add the statements of another list in this place.

        Raises:
            ValueError: there is a statement of one of their ids already.
        """
        for s in others:
            self._add(s.id, s.text, s.published, s.source, own=s.own)(s.judge)

    def claim(self, id: str, text: Text, *, published: str, source: str) -> Judging:
        """Decorator of the function that judges a published statement.

        Raises:
            ValueError: there is a statement of this id already.
        """
        return self._add(id, text, published, source, own=False)

    def check(self, id: str, text: Text, *, expected: str, source: str = "own") -> Judging:
        """Decorator of the function that judges an additional check."""
        return self._add(id, text, expected, source, own=True)

    def _add(self, id: str, text: Text, published: str, source: str, *, own: bool) -> Judging:
        if id in self.statements:
            raise ValueError(f"there is a statement '{id}' already")

        def keep(function: Callable[[Any], Finding]) -> Callable[[Any], Finding]:
            self.statements[id] = Statement(id, text, published, source, function, own)
            return function

        return keep

    def judge(self, study: Any) -> Claims:
        """Judge every statement on a study.

        A statement that needs a failed run is open; an additional check that needs one does not hold.
        """
        found = Claims()
        for s in self:
            try:
                f = s.judge(study)
            except RunFailed as error:
                f = Finding("a run failed", False, str(error), undecided=str(error))
            text = s.text(study) if callable(s.text) else s.text
            for quantity, values, holds, unit in f.evidence.seen:
                found.is_significant(s.id, quantity, values, holds, unit)
            if s.own:
                found.check(
                    s.id,
                    text,
                    s.published,
                    f.result,
                    f.holds,
                    f.reason,
                    s.source,
                    f.value,
                    f.unit,
                    criterion=f.criterion,
                    fitted=f.fitted,
                )
            else:
                found.judge(
                    s.id,
                    text,
                    s.published,
                    f.result,
                    f.holds,
                    f.reason,
                    s.source,
                    f.value,
                    f.unit,
                    band=f.band,
                    over=f.over,
                    criterion=f.criterion,
                    fitted=f.fitted,
                    undecided=f.undecided,
                )
        return found
