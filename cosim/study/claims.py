"""Published statements, and how a study judges them.

In Python a statement is the function that judges it:

    CLAIMS = ClaimList()

    @CLAIMS.claim("force-limit", "The MPC keeps the force within 8 N", published="within 8 N", source="Figure 9")
    def force_limit(study):
        worst = max(abs(row["force.max"]) for row in study.values())
        return Finding(f"at most {worst:.6g} N", worst <= 8, "the force exceeds its bound", criterion="in every run")

In a file, `ClaimList.read("claims.toml", judges)`, each statement names its judge, a function of the study and of the
values that stand there; all sentences stand in the file, with the judge's numbers in braces:

    [texts]
    weights = "weights of Table 1.1 read with the force in N"

    [[claim]]                          # [[check]] with `expected` instead of `published`: an additional check
    id = "force-limit"
    claim = "The MPC keeps the force within {limit:g} N"
    published = "within 8 N"
    source = "Figure 9"
    judge = "bound"                    # judges["bound"](study, limit=8.0)
    limit = 8.0
    result = "at most {value:.6g} N"
    criterion = "in every run"
    reason = "the force exceeds its bound"
    fitted = ["weights"]               # names of [texts]
    band = { around = 8.0 }            # or { low, high, reason }: where the value counts as the published one; a judge
                                       # that has a parameter `band` is given it
    calibrated = true                  # a parameter was fitted to this very claim

    [[claim]]
    id = "rate-limit"
    like = "force-limit"               # has its own keys, and the others of that entry

Verdicts follow from findings as `cosim.report.claims.verdict_of` says.
"""

from __future__ import annotations

import inspect
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cosim.report.claims import (
    Band,
    Claim,
    Claims,
    Condition,
    Distribution,
    Verdict,
    rounded,
    verdict_of,
    verdict_under,
)
from cosim.report.claims import Evidence as Row
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
    `conditions`: findings under several conditions instead, by name (`under_conditions`); `together`: parts of one
    sentence, all of which have to hold (`all_of`). `words`: numbers for the sentences of a file.
    """

    result: str = ""
    holds: bool = False
    reason: str = ""
    value: float | None = None
    unit: str = ""
    band: Band | None = None
    over: Distribution | None = None
    criterion: str = ""
    fitted: str = ""
    undecided: str = ""
    evidence: Evidence = field(default_factory=Evidence)
    calibrated: bool = False
    conditions: Mapping[str, Finding] = field(default_factory=dict)
    together: bool = False
    words: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.over is not None and self.value is not None:
            raise ValueError("a finding has a value and a distribution; the value is the distribution's median")
        if self.band is not None and self.figure is None and not self.conditions:
            raise ValueError("a finding has a band but no value to lie in it")

    @property
    def figure(self) -> float | None:
        """The value, or the median of the distribution that it is of."""
        return self.value if self.over is None else self.over.median

    @property
    def verdict(self) -> Verdict:
        """The verdict on a published statement that this leads to."""
        if self.conditions:
            return verdict_under([part.verdict for part in self.conditions.values()], self.together)
        return verdict_of(self.holds, self.value, self.band, self.over, self.undecided, self.calibrated)

    @property
    def rule(self) -> str:
        """The criterion, with that of the band."""
        parts = [self.criterion] if self.criterion else []
        if self.band is not None:
            share = (
                f" in a significant majority of the {self.over.of}" if self.over is not None and self.band.open else ""
            )
            why = f" ({self.band.reason})" if self.band.reason else ""
            parts.append(f"magnitude {self.band.text(self.unit)}{share}{why}")
        return "; ".join(parts)

    def claim(self, statement: Statement, share: str = "") -> Claim:
        """The claim of a report that a statement becomes."""
        held: Verdict = "holds" if self.holds else "does not hold"
        verdict = held if statement.own else self.verdict
        number = rounded(self.figure)
        parts = tuple(
            Condition(n, f.result, f.verdict, rounded(f.figure), f.unit, _missing(f.verdict, f))
            for n, f in self.conditions.items()
        )
        return Claim(
            statement.id,
            statement.text,
            statement.published,
            self.result,
            verdict,
            _missing(verdict, self),
            statement.source,
            number,
            "" if number is None else self.unit,
            self.rule,
            self.fitted,
            parts,
            share,
        )


def _missing(verdict: Verdict, finding: Finding) -> str:
    """Why a verdict is not the best one; empty where it is."""
    return "" if verdict in ("reproduced", "calibrated", "holds") else finding.undecided or finding.reason


def under_conditions(parts: Mapping[str, Finding]) -> Finding:
    """A claim that was judged under several conditions, by name: one row with a part for each."""
    held = sum(part.verdict in ("reproduced", "calibrated") for part in parts.values())
    return replace(_joined(parts), result=f"holds in full under {held} of {len(parts)} conditions")


def all_of(parts: Mapping[str, Finding]) -> Finding:
    """A sentence about several subjects, such as controllers, by name: it holds if it holds for all of them."""
    return replace(
        _joined(parts), result="; ".join(f"{name} {part.result}" for name, part in parts.items()), together=True
    )


def _joined(parts: Mapping[str, Finding]) -> Finding:
    rules, fitted = ({name: getattr(part, what) for name, part in parts.items()} for what in ("rule", "fitted"))
    why = {name: _missing(part.verdict, part) for name, part in parts.items()}
    holds = all(part.holds for part in parts.values())
    return Finding("", holds, _each(why), criterion=_each(rules), fitted=_each(fitted), conditions=parts)


def _each(texts: Mapping[str, str]) -> str:
    """What is said of several, once where it is the same."""
    if len(set(texts.values())) == 1:
        return next(iter(texts.values()))
    return "; ".join(f"{name}: {text}" for name, text in texts.items() if text)


@dataclass(frozen=True)
class Statement:
    """A statement and the function that judges it; `own`: an additional check, which no paper states.

    `values`: what the judge is given, if the statement is from a file.
    """

    id: str
    text: str
    published: str
    source: str
    judge: Callable[[Any], Finding]
    own: bool = False
    values: Mapping[str, Any] = field(default_factory=dict)


Judging = Callable[[Callable[[Any], Finding]], Callable[[Any], Finding]]


class ClaimList:
    """Statements in the order of the report."""

    def __init__(self) -> None:
        self.statements: dict[str, Statement] = {}

    def __iter__(self) -> Iterator[Statement]:
        return iter(self.statements.values())

    def __len__(self) -> int:
        return len(self.statements)

    @classmethod
    def read(
        cls,
        path: str | Path,
        judges: Mapping[str, Callable[..., Finding]],
        view: Callable[[Any], Any] = lambda study: study,
    ) -> ClaimList:
        """The statements of a TOML file, each judged by the function of `judges` that it names.

        Args:
            path: the file.
            judges: by name; they take what `view` makes of the study, and the values of an entry.
            view: such as a `cosim.study.judges.View`.

        Raises:
            ValueError: the file is no TOML, an entry lacks a key, names a judge or a text that does not exist, gives a
                judge a value that it does not take, or two entries have the same id; the message names file and entry.
        """
        found = cls()
        text = Path(path).read_text(encoding="utf-8")
        try:
            tables = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{path}: {error}") from error
        texts = tables.pop("texts", {})
        known: dict[str, dict[str, Any]] = {}
        entries = {key: iter(tables.pop(key, [])) for key in ("claim", "check")}
        for key in re.findall(r"^\s*\[\[\s*(claim|check)\s*\]\]", text, re.MULTILINE):  # TOML has no order of tables
            entry = next(entries[key])
            try:
                known[entry["id"]] = full = _like(known, entry)
                found._put(_Sentences(full, texts, judges, view).statement(own=key == "check"))
            except (KeyError, TypeError, ValueError) as error:
                what = f"{error} is missing" if isinstance(error, KeyError) else error
                raise ValueError(f"{path}: {key} '{entry.get('id', '?')}': {what}") from error
        if any(next(rest, None) for rest in entries.values()):
            raise ValueError(f"{path}: write each entry as a table, [[claim]] or [[check]]")
        if tables:
            raise ValueError(
                f"{path}: unknown table [{next(iter(tables))}]; there are [texts], [[claim]] and [[check]]"
            )
        return found

    def include(self, others: ClaimList) -> None:
        """Add the statements of another list in this place.

        Raises:
            ValueError: there is a statement of one of their ids already.
        """
        for s in others:
            self._put(s)

    def claim(self, id: str, text: str, *, published: str, source: str) -> Judging:
        """Decorator of the function that judges a published statement.

        Raises:
            ValueError: there is a statement of this id already.
        """
        return self._add(id, text, published, source, own=False)

    def check(self, id: str, text: str, *, expected: str, source: str = "own") -> Judging:
        """Decorator of the function that judges an additional check."""
        return self._add(id, text, expected, source, own=True)

    def _add(self, id: str, text: str, published: str, source: str, *, own: bool) -> Judging:
        self._check_new(id)

        def keep(function: Callable[[Any], Finding]) -> Callable[[Any], Finding]:
            self._put(Statement(id, text, published, source, function, own))
            return function

        return keep

    def _check_new(self, id: str) -> None:
        if id in self.statements:
            raise ValueError(f"there is a statement '{id}' already")

    def _put(self, statement: Statement) -> None:
        self._check_new(statement.id)
        self.statements[statement.id] = statement

    def judge(self, study: Any, samples: Sequence[Any] = (), of: str = "samples") -> Claims:
        """Judge every statement on a study.

        A statement that needs a failed run is open; an additional check that needs one does not hold.

        Args:
            study: what the judges take.
            samples: the study as seen by each sample of its random design alone, such as one identification seed. A
                published claim then says with how many of them it holds in full.
            of: what a sample is, in the plural.
        """
        found = Claims()
        for s in self:
            finding = _judged(s, study)
            each = [_judged(s, sample).claim(s).passed for sample in samples] if not s.own else []
            share = f"holds in full with {sum(each)} of {len(each)} {of} alone" if each else ""
            found.append(finding.claim(s, share))
            found.passed.append(each)
            found.evidence += [
                Row(s.id, quantity, unit, values, values.count(holds))
                for quantity, values, holds, unit in finding.evidence.seen
            ]
        return found


def _judged(s: Statement, study: Any) -> Finding:
    try:
        return s.judge(study)
    except RunFailed as error:
        return Finding("a run failed", False, str(error), undecided=str(error))


def _like(known: Mapping[str, Mapping[str, Any]], entry: Mapping[str, Any]) -> dict[str, Any]:
    """An entry with what it does not say itself from the one that it is `like`."""
    if "like" not in entry:
        return dict(entry)
    if entry["like"] not in known:
        raise ValueError(f"there is no '{entry['like']}' before it")
    base, own = known[entry["like"]], {k: v for k, v in entry.items() if k != "like"}
    return {**base, **{k: {**base.get(k, {}), **v} if isinstance(v, dict) else v for k, v in own.items()}}


class _Sentences:
    """An entry of a file of claims."""

    def __init__(
        self,
        entry: Mapping[str, Any],
        texts: Mapping[str, str],
        judges: Mapping[str, Callable[..., Finding]],
        view: Callable[[Any], Any],
    ) -> None:
        values = dict(entry)
        self.id, self.text, self.source = values.pop("id"), values.pop("claim"), values.pop("source", "own")
        self.expected = {own: values.pop(key, None) for own, key in ((False, "published"), (True, "expected"))}
        self.said = {k: values.pop(k) for k in ("result", "criterion", "reason") if k in values}
        self.fitted = [texts[name] for name in values.pop("fitted", [])]
        self.band, self.unit = _band(values.pop("band", None)), values.pop("unit", "")
        self.calibrated, name = values.pop("calibrated", False), values.pop("judge")
        if name not in judges:
            raise ValueError(f"unknown judge '{name}'; there are {', '.join(sorted(judges))}")
        self.judge, self.values, self.view = judges[name], values, view
        takes = inspect.signature(self.judge)
        if "band" in takes.parameters:
            values["band"] = self.band
        takes.bind(None, **values)

    def statement(self, *, own: bool) -> Statement:
        """The statement of this entry."""
        if (expected := self.expected[own]) is None or self.expected[not own] is not None:
            raise ValueError("a claim has 'published', a check has 'expected'")
        return Statement(self.id, self.text.format_map(self.values), expected, self.source, self, own, self.values)

    def __call__(self, study: Any) -> Finding:
        """The judge's finding, in the words of the entry."""
        return self._in_words(self.judge(self.view(study), **self.values))

    def _in_words(self, found: Finding) -> Finding:
        if not found.conditions:
            return self._worded(found)
        parts = {name: self._in_words(part) for name, part in found.conditions.items()}
        return all_of(parts) if found.together else under_conditions(parts)

    def _worded(self, found: Finding) -> Finding:
        """The finding with band and sentences of the entry."""
        value = math.nan if found.figure is None and self.band is not None else found.value
        found = replace(found, value=value, unit=self.unit or found.unit, band=self.band)
        found = replace(found, calibrated=self.calibrated or found.calibrated)
        words = {**self.values, "value": found.figure, "unit": found.unit, **found.words}
        try:
            fitted = [*(text.format_map(words) for text in self.fitted), found.fitted]
            said = {"result": found.result, "criterion": found.criterion, "reason": found.reason} | {
                k: text.format_map(words) for k, text in self.said.items()
            }
        except KeyError as word:
            raise ValueError(f"claim '{self.id}': its judge has no {word}; there are {', '.join(words)}") from word
        return replace(
            found,
            result=said["result"],
            criterion=said["criterion"],
            reason=said["reason"],
            fitted="; ".join(filter(None, fitted)),
        )


def _band(given: Mapping[str, Any] | None) -> Band | None:
    if given is None:
        return None
    if "around" in given:
        return Band.around(given["around"], **{k: v for k, v in given.items() if k != "around"})
    return Band(given.get("low", -math.inf), given.get("high", math.inf), given.get("reason", ""))
