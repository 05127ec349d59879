"""Readings of a paper: a study once more with what the paper leaves open taken otherwise, to see which claims turn.

    READINGS = {
        AS_READ: (),
        "dry friction": (Change(Ride, {"friction": True}),),
        "MPC with the printed limits": (Change(Ride, {"limits": "printed"}, where={"controller": "mpc"}),),
    }
    STUDY = ReadingsStudy(ride.EXPERIMENT, needs, ("ride.claims:CLAIMS",), READINGS)
    EXPERIMENT = STUDY.experiment("ride-readings", "Ride: other readings (paper 001)", __name__)

`needs` gives the cases on which the claims rest, as the main study has them. A reading maps each of them to the case
that is run in its place, and the claims are judged on these runs as if they were the main study's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import click

from cosim.study.claims import ClaimList
from cosim.study.experiment import Experiment, Row, Task, resolved
from cosim.study.results import Results, RunFailed

AS_READ = "as read"
"""Name of the reading that changes nothing: the main study's."""


@dataclass(frozen=True)
class Change:
    """Fields of the cases of one class set otherwise, in those that have all values of `where`.

    A tuple in `where` stands for any of its values.
    """

    case: type
    fields: Mapping[str, Any]
    where: Mapping[str, Any] = field(default_factory=dict)

    def __call__(self, case: Any) -> Any:
        """The case with the change.

        Raises:
            CaseError: there is no such run.
        """
        if type(case) is not self.case:
            return case
        for name, value in self.where.items():
            if getattr(case, name) not in (value if isinstance(value, tuple) else (value,)):
                return case
        return replace(case, **self.fields)


Reading = Sequence[Change]


def read_as(reading: Reading, case: Any) -> Any:
    """The case that a reading runs in the place of one of the main study."""
    for change in reading:
        case = change(case)
    return case


@dataclass(frozen=True)
class ReadingsStudy:
    """The claims of an experiment, judged under several readings.

    Attributes:
        main: the experiment whose cases are run.
        needs: cases of the main study on which the claims rest.
        claims: lists of them, each a `ClaimList` or "module:NAME" of one.
        readings: by their names, in words; the first is the main study's.
        full: what the full study does besides, as help of its option.
        more: others, of the full study.
        short: what the short study changes in every reading, such as to leave out runs with finer steps.
    """

    main: Experiment
    needs: Callable[[], Iterable[Any]]
    claims: Sequence[Any]
    readings: Mapping[str, Reading]
    full: str
    more: Mapping[str, Reading] = field(default_factory=dict)
    short: Reading = ()

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
        return replace(
            self.main,
            name=name,
            title=title,
            study=replace(
                self.main.study,
                plan=self.plan(),
                parts=[replace(e, study=replace(e.study, plan=None)) for e in self.main.every[1:]],
                claims=None,
                report=f"{module}:report",
            ),
            page=None,
            web=None,
            module=module,
        )

    def plan(self) -> Callable[..., list[Task]]:
        """The plan, with its option."""

        @click.option("--full/--no-full", default=False, help=self.full)
        def plan(full: bool = False) -> list[Task]:
            return [Task(case) for case in self.cases(full)]

        return plan

    def published(self) -> ClaimList:
        """The published claims of all lists."""
        found = ClaimList()
        for claims in map(resolved, self.claims):
            found.statements.update({s.id: s for s in claims if not s.own})
        return found

    def is_full(self, results: Results) -> bool:
        """Whether these are results of the full study."""
        return all(case in results for case in self.cases(True))

    def seen(self, results: Results, reading: Reading) -> Results:
        """The runs of a reading as if they were those of the main study."""
        tasks = self.main.placed(self.needs())
        entries = []
        for task in tasks:
            try:
                entries.append({"metrics": results[read_as(reading, task.case)]})  # type: ignore[union-attr]
            except RunFailed as error:
                entries.append({"failed": str(error)})
        return _Seen(tasks, entries)


class _Seen(Results):
    """The runs that claims need; others count as failed, so a claim that rests on one is open."""

    def __getitem__(self, case: Any) -> Row:
        if case not in self:
            raise RunFailed(f"this study leaves out the run {getattr(case, 'label', case)}")
        return super().__getitem__(case)
