"""What a study found: a row for every task, those that failed among them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from cosim.study.case import values
from cosim.study.experiment import Row, Search, Task


class RunFailed(LookupError):  # noqa: N818
    """Somebody needs a run that failed; claims and pages that do are left open, with this message."""


class Results(Mapping[Any, Row]):
    """Metrics by case, in the order of the plan; reading those of a failed run raises :class:`RunFailed`.

    Args:
        tasks: of the study.
        entries: of each task, as workers gave them: ``{"metrics": ...}``, ``{"found": ...}`` or ``{"failed": message}``.
    """

    def __init__(self, tasks: Iterable[Task | Search], entries: Iterable[Row]) -> None:
        self.tasks = list(tasks)
        self._entries = list(entries)
        self._labels = {t.case if isinstance(t, Task) else t: t.label for t in self.tasks}
        self._runs: dict[Any, Row] = {}
        self._found: dict[Any, Row] = {}
        for task, entry in zip(self.tasks, self._entries, strict=True):
            if isinstance(task, Task):
                known = self._runs.get(task.case)
                self._runs[task.case] = entry if known is None else {**known, **entry}
            else:
                self._found[task] = entry

    def __getitem__(self, case: Any) -> Row:
        found: Row = self._part(self._runs, case, "metrics")
        return found

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
        return [case for case, entry in self._runs.items() if "failed" not in entry]

    @property
    def failures(self) -> dict[str, str]:
        """Message of every failed task by its label."""
        return {self._labels[k]: e["failed"] for k, e in {**self._runs, **self._found}.items() if "failed" in e}

    def of(self, part: str = "") -> Results:
        """The results of one part of the experiment; without a name, of what belongs to none."""
        chosen = [i for i, t in enumerate(self.tasks) if getattr(t, "part", "") == part]
        return Results([self.tasks[i] for i in chosen], [self._entries[i] for i in chosen])

    def rows(self) -> list[Row]:
        """Every run as a flat row, for tables and files: the fields of its case, then its metrics or ``failed``."""
        return [
            {**values(case), **({"failed": e["failed"]} if "failed" in e else e["metrics"])}
            for case, e in self._runs.items()
        ]

    def _part(self, entries: Mapping[Any, Row], key: Any, part: str) -> Any:
        entry = entries.get(key)
        if entry is None:
            raise KeyError(f"the study has no run {getattr(key, 'label', key)}")
        if "failed" in entry:
            raise RunFailed(f"the run {self._labels[key]} failed: {entry['failed']}")
        if part not in entry:
            raise KeyError(f"the study kept no {part} of the run {self._labels[key]}")
        return entry[part]
