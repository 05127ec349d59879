"""Runs and studies made by hand, to compare what is measured, tabled, drawn and said with known answers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim import Recording
from cosim.report import Claim, Figure, Report, Series, Table
from cosim.study import Experiment, Results, Run, Task
from cosim.study.web import Live


@dataclass(frozen=True)
class MadeUpRun(Run):
    """A run whose start values are given instead of read from FMUs: `system` is a dictionary of them."""

    def start(self, name: str) -> Any:
        return self.system[name]


def run(
    case: Any,
    time: np.ndarray,
    signals: Mapping[str, Any],
    starts: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
) -> MadeUpRun:
    """A run with these signals, arrays or numbers that do not change; one that is not given is not there."""
    data = np.column_stack([np.broadcast_to(np.asarray(s, dtype=float), time.shape) for s in signals.values()])
    return MadeUpRun(case, Recording(time, list(signals), data, dict(units or {})), dict(starts))


def study(
    experiment: Experiment,
    metrics: Callable[[Any], Mapping[str, Any]],
    signals: Callable[[Any], Mapping[str, Any]] = lambda _: {},
    found: Callable[[Any], Any] | None = None,
    **options: Any,
) -> Results:
    """A whole study: its plan with the results that functions of the case, and of each search, give.

    Without searches where no function is given for them.
    """
    tasks = [t for t in experiment.tasks(**options) if isinstance(t, Task) or found is not None]
    entries: list[dict[str, Any]] = []
    for t in tasks:
        if isinstance(t, Task):
            kept = {"signals": dict(signals(t.case))} if t.signals else {}
            entries.append({"metrics": dict(metrics(t.case)), **kept})
        elif found is not None:
            entries.append({"found": found(t)})
    return Results(tasks, entries)


def table(report: Report, id_: str) -> list[dict[str, Any]]:
    """Rows of a table, by heading."""
    found: Table = next(t for s in report.sections for t in s.tables if t.id == id_)
    return [dict(zip(found.columns, row, strict=True)) for row in found.rows]


def series(report: Report, id_: str, panel: str, name: str) -> Series:
    """A curve of a figure, by the panel's title and its own name."""
    found: Figure = next(f for f in report.figures if isinstance(f, Figure) and f.id == id_)
    return next(s for p in found.panels if p.title == panel for s in p.series if s.name == name)


def bars(report: Report) -> dict[str, dict[str, float]]:
    """Heights of the bars of the figure that the report begins with, by series and by the name of their position."""
    assert isinstance(report.figure, Figure)
    (panel,) = report.figure.panels
    shown = [s for s in panel.series if s.mode == "bar"]
    return {
        s.name: dict(zip((panel.x_names[int(i)] for i in s.x_values), np.asarray(s.y, dtype=float), strict=True))
        for s in shown
    }


def axes(report: Report, id_: str) -> dict[str, tuple[str, str]]:
    """Labels of the axes of a figure's panels, by the panel's title."""
    found: Figure = next(f for f in report.figures if isinstance(f, Figure) and f.id == id_)
    return {p.title: (p.x_label, p.y_label) for p in found.panels}


def columns(report: Report) -> dict[str, int]:
    """How many panels stand side by side, of each figure that has several."""
    return {f.id: f.columns for f in report.figures if isinstance(f, Figure) and len(f.panels) > 1}


def words(report: Report, *titles: str) -> str:
    """Everything that a report says, numbers of tables and curves aside; with titles: of these sections alone."""
    lines = [] if titles else [report.lead, *(f"{r.name}: {r.value} {r.unit}" for r in report.results)]
    lines += _figure(report.figure) if isinstance(report.figure, Figure) and not titles else []
    for s in report.sections:
        if not titles or s.title in titles:
            lines += [f"# {s.title}", *s.paragraphs]
            lines += [line for f in s.figures if isinstance(f, Figure) for line in _figure(f)]
            lines += [f"table {t.id}: {t.title}\n  {' | '.join(t.columns)}\n  {t.caption}" for t in s.tables]
    if not titles:
        lines += [f"{p.name} = {p.value} {p.unit} ({p.source})" for p in report.parameters]
        lines += [said(report.claims)]
    return "\n".join(lines)


def _figure(figure: Figure) -> list[str]:
    panels = [
        f"  {p.title}: {p.y_label} over {p.x_label}: "
        + ", ".join(f"{s.name} ({s.color}, {s.dash}, {s.mode})" for s in p.series)
        for p in figure.panels
    ]
    return [f"figure {figure.id} ({figure.columns}): {figure.title}", f"  {figure.caption}", *panels]


def said(claims: Iterable[Claim], *ids: str) -> str:
    """What is said of claims: all of them, or those of these ids."""
    return "\n".join(
        f"{c.id}: {c.claim} ({c.published}, {c.source})"
        + "".join(f"\n  {_found(p)}" for p in c.conditions or [c])
        + "".join(f"\n  {text}" for text in (c.criterion, c.fitted, c.share) if text)
        for c in claims
        if not ids or c.id in ids
    )


def _found(claim: Any) -> str:
    value = "" if claim.value is None else f" = {claim.value:.4g} {claim.unit}"
    return f"{claim.verdict}{value}; {claim.result}; {claim.reason}"


def live_words(live: Live) -> str:
    """What a live page shows: its systems, controls, charts and measures."""
    cases = [f"{c.group}: {c.title}: {c.case.label}" for c in live.cases]
    parts = [*live.page.controls, *live.page.measures, live.page.plots, live.page.finish, live.page.pace]
    return "\n".join([live.page.title, live.page.text, *cases, *map(str, parts)])
