"""What a check is, what it finds, and the list of all of them.

A check is a function that yields findings. What it needs to be listed, chosen and explained stands in its decorator:
what it is about, for which FMI versions and interfaces, in which section of the standard, and what to do about a
finding. The same checks are run by the command `cosim check` and by the conformance suite of our own FMUs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")
"""By weight. An error is one by the text of the standard; a warning is what the standard advises against, or what
importers stumble over; a note is worth knowing.
"""

GROUPS = (
    "archive",
    "description",
    "binary",
    "states",
    "values",
    "runs",
    "saved",
    "derivatives",
    "exchange",
    "references",
)
"""What checks are about, in the order in which they are run: what an FMU says, before it runs; then right calls, before
wrong ones.
"""

MOST = 10  # findings of a check that are listed; the others are counted


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong. `line` of modelDescription.xml, where it is there."""

    text: str
    severity: Severity
    line: int = 0

    def __str__(self) -> str:
        return f"line {self.line}: {self.text}" if self.line else self.text


Found = Iterator["str | tuple[int, str] | Finding"]
"""What the function of a check yields: texts of its worst severity, with lines, or findings."""


class NotApplicable(Exception):  # noqa: N818
    """A check has nothing to look at; the argument says why."""


def require(needed: object, reason: str) -> None:
    """Raise NotApplicable without what a check needs."""
    if not needed:
        raise NotApplicable(reason)


@dataclass(frozen=True)
class Check:
    """One check.

    Attributes:
        id: `group.name`.
        title: what is looked at, in a sentence.
        section: where the standard says so, by FMI version ("2", "3").
        advice: what to do about a finding.
        versions, kinds: FMI versions and interfaces ("cs", "me") that it is about; no kinds: of the file, nothing is
            run.
        worst: the gravest severity of its findings, which is also that of an FMU that crashes or hangs in it.
        run: yields findings; of an instance's checks for one interface.
    """

    id: str
    title: str
    section: dict[str, str]
    advice: str
    versions: tuple[str, ...]
    kinds: tuple[str, ...]
    worst: Severity
    run: Callable[..., Iterable[Finding]] = field(repr=False)

    @property
    def group(self) -> str:
        """Group of the check, the first part of its id."""
        return self.id.partition(".")[0]

    def __reduce__(self) -> tuple[Any, ...]:  # by name: its function lives in every process
        return _by_id, (self.id,)


CHECKS: dict[str, Check] = {}
"""All checks by id."""


def _by_id(id_: str) -> Check:
    return CHECKS[id_]


def check(
    id_: str,
    title: str,
    *,
    fmi2: str = "",
    fmi3: str = "",
    advice: str,
    kinds: tuple[str, ...] = ("cs", "me"),
    worst: Severity = "error",
) -> Callable[[Callable[..., Iterator[Any]]], Callable[..., Iterator[Any]]]:
    """Register the decorated function as a check of instances, for the FMI versions whose section is given.

    The function yields texts, (line, text), or findings.
    """

    def register(function: Callable[..., Iterator[Any]]) -> Callable[..., Iterator[Any]]:
        section = {version: s for version, s in (("2", fmi2), ("3", fmi3)) if s}
        assert section, id_
        assert id_.partition(".")[0] in GROUPS, id_
        assert id_ not in CHECKS, id_

        def run(*arguments: Any) -> Iterator[Finding]:
            for found in function(*arguments):
                if isinstance(found, Finding):
                    yield found
                elif isinstance(found, tuple):
                    yield Finding(found[1], worst, found[0])
                else:
                    yield Finding(found, worst)

        CHECKS[id_] = Check(id_, title, section, advice, tuple(section), kinds, worst, run)
        return function

    return register


file_check = partial(check, kinds=())
"""Register the decorated function as a check of the file; nothing is run."""


def warning(text: str, line: int = 0) -> Finding:
    """A finding of severity "warning"; `line` of modelDescription.xml, 0 for none."""
    return Finding(text, "warning", line)


def note(text: str, line: int = 0) -> Finding:
    """A finding of severity "note"; `line` of modelDescription.xml, 0 for none."""
    return Finding(text, "note", line)


def names(found: Iterable[str], most: int = 3) -> str:
    """Some names in a sentence: `'a', 'b' and 12 more`."""
    quoted = [repr(n) for n in found]
    more = len(quoted) - most
    return ", ".join(quoted[:most]) + (f" and {more} more" if more > 0 else "")
