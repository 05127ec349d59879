"""Studies with other numbers than runs gave, to see what verdicts and tables make of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cosim.study import Results, Task


def altered(study: Results, changes: Mapping[Any, Mapping[str, Any]]) -> Results:
    """The study with some results changed: case -> metric -> value, or search -> part of what it found -> value."""
    return _with(study, {key: lambda entry, c=change: _updated(entry, c) for key, change in changes.items()})


def failed(study: Results, case: Any, message: str = "ComponentError: it broke") -> Results:
    """The study with one run, or one search, that failed."""
    return _with(study, {case: lambda _: {"failed": message}})


def _updated(entry: dict[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    part = "metrics" if "metrics" in entry else "found"
    return {**entry, part: {**entry[part], **change}}


def _with(study: Results, changes: Mapping[Any, Any]) -> Results:
    entries = []
    for task in study.tasks:
        key: Any = task.case if isinstance(task, Task) else task
        entry = {"metrics": study[key]} if isinstance(task, Task) else {"found": study.found(task)}
        if isinstance(task, Task) and task.signals:
            entry["signals"] = study.signals(key)
        entries.append(changes[key](entry) if key in changes else entry)
    return Results(study.tasks, entries)
