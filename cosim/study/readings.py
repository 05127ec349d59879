"""Readings of a paper: a study once more with what the paper leaves open taken otherwise, to see which claims turn.

A reading maps each case on which the claims of the main study rest to the case that is run in its place. The claims are
then judged on these runs as if they were the main study's. See `cosim/experiments/hmmwv_readings.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import click

from cosim.study.claims import ClaimList
from cosim.study.experiment import Experiment, Row, Search, Task, resolved
from cosim.study.results import Results, RunFailed

AS_READ = "as read"
"""Name of the reading that changes nothing: the main study's."""


@dataclass(frozen=True)
class Change:
    """Fields of the cases of one class set otherwise, in those that have all values of `where`, or one of a tuple."""

    case: type[Any]
    fields: Mapping[str, Any]
    where: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, case: Any) -> Any:
        """The case with the change.

        Raises:
            CaseError: there is no such run.
        """
        if not isinstance(case, self.case):
            return case
        for name, value in self.where.items():
            if getattr(case, name) not in (value if isinstance(value, tuple) else (value,)):
                return case
        return replace(case, **self.fields)


Reading = Sequence[Callable[[Any], Any]]
"""Changes of cases, or of searches, one after the other; most are a `Change`."""


def read_as(reading: Reading, case: Any) -> Any:
    """The case, or search, that a reading runs in the place of one of the main study."""
    for change in reading:
        case = change(case)
    return case


def seen(results: Results, reading: Reading, tasks: Sequence[Task | Search]) -> Results:
    """The runs of a reading as if they were those of these tasks of the main study."""
    entries: list[Row] = []
    for task in tasks:
        try:
            if isinstance(task, Task):
                entries.append({"metrics": results[read_as(reading, task.case)]})
            else:
                entries.append({"found": results.found(read_as(reading, task))})
        except RunFailed as error:
            entries.append({"failed": str(error)})
    return _Seen(tasks, entries)


@dataclass(frozen=True)
class ReadingsStudy:
    """The claims of an experiment, judged under several readings.

    Attributes:
        main: the experiment whose cases are run.
        needs: cases of the main study on which the claims rest.
        claims: lists of them, each a `ClaimList` or "module:NAME" of one.
        readings: by their names, in words; the first is the main study's.
        full: what the full study does besides, as help of its option.
        more: readings of the full study only.
        short: what the short study changes in every reading, such as to leave out runs with finer steps.
        notes: what the readings leave out, for the report.
    """

    main: Experiment
    needs: Callable[[], Iterable[Any]]
    claims: Sequence[Any]
    readings: Mapping[str, Reading]
    full: str
    more: Mapping[str, Reading] = field(default_factory=dict)
    short: Reading = ()
    notes: Sequence[str] = ()

    def chosen(self, full: bool) -> dict[str, Reading]:
        """The readings of the short or of the full study."""
        if full:
            return {**self.readings, **self.more}
        return {name: (*self.short, *reading) for name, reading in self.readings.items()}

    def cases(self, full: bool) -> list[Any]:
        """What is run: each case once, whichever readings share it."""
        needed = list(self.needs())
        return list(dict.fromkeys(read_as(r, case) for r in self.chosen(full).values() for case in needed))

    def experiment(self, name: str, title: str, module: str) -> Experiment:
        """The experiment of this study; its parts are those of the main one, without runs of their own."""

        @click.option("--full/--no-full", default=False, help=self.full)
        def plan(full: bool = False) -> list[Any]:
            return self.cases(full)

        def report(*given: Any) -> Any:
            return resolved("cosim.study.readings_report:report_readings")(self, made, *given)  # runs need no pages

        parts = [replace(e, study=replace(e.study, plan=None)) for e in self.main.every[1:]]
        study = replace(self.main.study, plan=plan, parts=parts, claims=None, report=report)
        made = replace(self.main, name=name, title=title, study=study, page=None, web=None, module=module)
        return made

    def published(self) -> ClaimList:
        """The published claims of all lists."""
        found = ClaimList()
        for claims in map(resolved, self.claims):
            found.statements.update({s.id: s for s in claims if not s.own})
        return found

    def seen(self, results: Results, reading: Reading) -> Results:
        """The runs of a reading as if they were those of the main study."""
        return seen(results, reading, self.main.placed(self.needs()))


class _Seen(Results):
    """The runs that claims need; others count as failed, so a claim that rests on one is open."""

    def __getitem__(self, case: Any) -> Row:
        if case not in self:
            raise RunFailed(f"this study leaves out the run {getattr(case, 'label', case)}")
        return super().__getitem__(case)
