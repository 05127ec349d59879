"""What a study found: a row for every task, those that failed among them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

from cosim.core.errors import CosimError
from cosim.study.case import values
from cosim.study.experiment import Row, Search, Task


class RunFailed(CosimError, LookupError):  # noqa: N818
    """Somebody needs a run that failed; claims and pages that do are left open, with this message."""


class Results(Mapping[Any, Row]):
    """Metrics by case, in the order of the plan; reading those of a failed run raises `RunFailed`.

    Args:
        tasks: of the study.
        entries: of each task, as workers gave them: `{"metrics": ...}`, `{"found": ...}` or `{"failed":
            message}`.
        in_lanes: how many of the runs that were made now were copies in lanes.
    """

    def __init__(self, tasks: Iterable[Task | Search], entries: Iterable[Row], in_lanes: int = 0) -> None:
        self.in_lanes = in_lanes
        self.tasks = list(tasks)
        self._entries = entries if isinstance(entries, Sequence) else list(entries)
        if len(self._entries) != len(self.tasks):
            raise ValueError(f"{len(self.tasks)} tasks have {len(self._entries)} entries")
        self._runs: dict[Any, tuple[int, ...]] = {}  # numbers of the tasks of a case: its signals may be another task
        self._found: dict[Any, tuple[int, ...]] = {}
        for i, task in enumerate(self.tasks):
            if isinstance(task, Task):
                self._runs[task.case] = (*self._runs.get(task.case, ()), i)
            else:
                self._found[task] = (i,)

    def __getitem__(self, case: Any) -> Row:
        found: Row = self._part(self._runs, case, "metrics")
        return found

    def __contains__(self, case: object) -> bool:
        return case in self._runs  # whether its run failed or not

    def __iter__(self) -> Iterator[Any]:
        return iter(self._runs)

    def __len__(self) -> int:
        return len(self._runs)

    def signals(self, case: Any) -> Row:
        """Signals over time of a case whose task requested them."""
        found: Row = self._part(self._runs, case, "signals")
        return found

    def found(self, search: Search) -> Any:
        """What a search found."""
        return self._part(self._found, search, "found")

    @property
    def ran(self) -> list[Any]:
        """Cases whose runs did not fail."""
        return [case for case, places in self._runs.items() if "failed" not in self._entry(places)]

    @cached_property
    def failures(self) -> dict[str, str]:
        """Message of every failed task by its label; tasks that have the same label are numbered."""
        found: dict[str, str] = {}
        for places in (*self._runs.values(), *self._found.values()):
            if "failed" in (entry := self._entry(places)):
                label = self.tasks[places[0]].label
                names = itertools.chain([label], (f"{label} ({n})" for n in itertools.count(2)))
                found[next(n for n in names if n not in found)] = entry["failed"]
        return found

    def failure(self, case: Any) -> str:
        """The message of a case whose run failed."""
        return str(self._entry(self._runs[case])["failed"])

    def of(self, part: str = "") -> Results:
        """The results of one part of the experiment; without a name, of what belongs to none."""
        chosen = [i for i, t in enumerate(self.tasks) if getattr(t, "part", "") == part]
        return Results([self.tasks[i] for i in chosen], _Chosen(self._entries, chosen))

    def rows(self) -> list[Row]:
        """Every run as a flat row, for tables and files: the fields of its case, then its metrics or `failed`."""
        found = ((case, self._entry(places)) for case, places in self._runs.items())
        return [{**values(c), **({"failed": e["failed"]} if "failed" in e else e["metrics"])} for c, e in found]

    def _entry(self, places: tuple[int, ...]) -> Row:
        if len(places) == 1:
            return self._entries[places[0]]
        return {k: v for i in places for k, v in self._entries[i].items()}

    def _part(self, entries: Mapping[Any, tuple[int, ...]], key: Any, part: str) -> Any:
        places = entries.get(key)
        if places is None:
            raise KeyError(f"the study has no run {getattr(key, 'label', key)}")
        entry = self._entry(places)
        task = self.tasks[places[0]]
        if "failed" in entry:
            raise RunFailed(f"the run {task.label} failed: {entry['failed']}")
        if part not in entry:
            raise KeyError(f"the study did not store the {part} of the run {task.label}")
        return entry[part]


class _Chosen(Sequence[Row]):
    """Some of a sequence of entries, which are read when they are asked for."""

    def __init__(self, entries: Sequence[Row], chosen: Sequence[int]) -> None:
        self._entries = entries
        self._chosen = chosen

    def __len__(self) -> int:
        return len(self._chosen)

    def __getitem__(self, i: Any) -> Any:
        return self._entries[self._chosen[i]]
