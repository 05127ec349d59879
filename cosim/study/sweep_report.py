"""Page of a sweep: distributions, quantiles with confidence, scatter, parallel coordinates, sensitivity, worst runs."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any, Literal

import numpy as np

from build_fmus.base.checks import Array, unknown
from cosim import Execution
from cosim.core.content_checks import Scalar, label_of
from cosim.recording.peaks import keep_peaks
from cosim.recording.recording import Recording
from cosim.report import Figure, Panel, Report, Section, Series, Table
from cosim.study.design import METHODS, DesignError
from cosim.study.experiment import Metric, undeclared
from cosim.study.fmus import FmuSet
from cosim.study.pages import provenance
from cosim.study.runner import Runner
from cosim.study.slopes import LocalSlopes
from cosim.study.sweep import Sweep, SweepTable
from cosim.study.sweep_statistics import (
    CONFIDENCE,
    morris_effects,
    numeric,
    quantile_interval,
    rank_correlations,
    sobol_indices,
    values_of,
)
from cosim.study.swept import swept

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
MOST_METRICS = 6  # that are drawn
POINTS = 2000  # of a scatter plot
LINES = 100  # of parallel coordinates
# methods whose points are random samples, independent or spread more evenly
SAMPLED = ("random", "lhs", "sobol", "halton")
WORST = 3  # runs whose time histories are shown
SAMPLES = 2000  # of a time history that is drawn


@dataclass(frozen=True)
class Worst:
    """Definition of the worst runs: largest values of a metric, smallest values, or those furthest from 0."""

    metric: str
    how: Literal["largest", "smallest", "furthest from 0"] = "largest"

    @classmethod
    def of(cls, text: str) -> Worst:
        """`METRIC`, or `METRIC:min` for the smallest values."""
        name, colon, end = text.rpartition(":")
        return cls(name, "smallest") if colon and end == "min" else cls(text)

    def ranked(self, table: SweepTable) -> list[int]:
        """Numbers of the runs that have the metric, the worst one first."""
        values = table.metrics[self.metric]
        badness = {"largest": values, "smallest": -values, "furthest from 0": np.abs(values)}[self.how]
        order = np.argsort(-np.nan_to_num(badness, nan=-np.inf), kind="stable")
        return [i for i in order.tolist() if math.isfinite(values[i])]


def sweep_report(
    table: SweepTable,
    fmus: FmuSet,
    *,
    worst: Worst | None = None,
    folder: Path | None = None,
    execution: Execution | None = None,
    local: LocalSlopes | None = None,
) -> Report:
    """The page.

    Args:
        table: results of the sweep.
        fmus: FMUs of the experiment, for the worst runs.
        worst: by default the first metric, furthest from 0.
        folder: of the table, in which the histories of the runs lie, if they were kept.
        execution: of the worst runs, if they are made again.
        local: derivatives at the medians, beside the sensitivities.

    Raises:
        DesignError: no run has such a metric.
    """
    sweep, experiment = table.sweep, table.sweep.experiment
    found = _shown(table)
    metrics = {k: m for k, m in found.items() if np.isfinite(table.metrics[k]).any()}
    without = "".join(f" No run has a finite value of {m.text}." for k, m in found.items() if k not in metrics)
    n, lost = len(sweep), len(table.failures)
    method = METHODS.get(sweep.design.method, "points that were given")
    sections: list[Section] = []
    if metrics:
        drawn = dict(list(metrics.items())[:MOST_METRICS])
        worst = worst or Worst(next(iter(metrics)), "furthest from 0")
        if worst.metric not in table.metrics:
            raise DesignError(unknown("metric", worst.metric, table.metrics))
        sections += [
            _distributions(table, metrics, drawn),
            _scatter(table, drawn, worst),
            _sensitivity(table, drawn, local),
        ]
        sections.append(_worst(table, fmus, worst, metrics, folder, execution))
    if lost:
        rows: list[list[Scalar]] = [[i, *_cells(sweep, i), m] for i, m in list(table.failures.items())[:100]]
        text = f"{lost} of {n} runs failed; --retry-failed runs them again." + " The first hundred:" * (lost > 100)
        sections.append(
            Section(
                "Failed runs",
                [text],
                tables=[Table("failed-runs", "Runs that failed", ["run", *_headings(sweep), "message"], rows)],
            )
        )
    axes: list[list[Scalar]] = [[a.name, sweep.units[a.name] or "-", str(a)] for a in sweep.design.axes]
    sections.append(
        Section(
            "Design",
            [f"{method}, seed {sweep.design.seed}."],
            tables=[Table("design", "Parameters that vary", ["parameter", "unit", "values"], axes)],
        )
    )
    return Report(
        experiment=f"{experiment.name} sweep",
        title=f"{experiment.title or experiment.name}: sweep",
        lead=f"{n} runs over {', '.join(a.name for a in sweep.design.axes)}; {lost} failed.{without}",
        sections=sections,
        provenance=provenance(experiment, fmus),
    )


def _shown(table: SweepTable) -> dict[str, Metric]:
    said = {k: m for k, m in table.sweep.experiment.measures.metrics.items() if k in table.metrics}
    return said or {k: undeclared(k) for k in table.metrics}


def _headings(sweep: Sweep) -> list[str]:
    return [f"{a.name} [{sweep.units[a.name]}]" if sweep.units[a.name] else a.name for a in sweep.design.axes]


def _cells(sweep: Sweep, i: int) -> list[Scalar]:
    return list(sweep.point(i))


def _label(metric: Metric) -> str:
    return label_of(metric.text, metric.unit)


# -------------------------------------------------------------------------------------------------------- distributions


def _about_bounds(method: str) -> str:
    if method not in SAMPLED:
        name = METHODS.get(method, "a list of points")
        return (
            "The quantiles are those of these runs. They have no confidence bounds, because the points of this"
            f" design ({name}) are no random sample of the parameters' distributions; --method random gives quantiles"
            " with bounds."
        )
    text = "Bounds are order statistics that hold for any distribution"
    return text + (
        "."
        if method == "random"
        else "; they assume independent runs, and are usually too wide for a design that fills space evenly."
    )


def _distributions(table: SweepTable, metrics: Mapping[str, Metric], drawn: Mapping[str, Metric]) -> Section:
    method = table.sweep.design.method
    bounded = method in SAMPLED
    rows: list[list[Scalar]] = []
    for key, metric in metrics.items():
        values = values_of(table, key, metric)
        values = values[np.isfinite(values)]
        if len(values):
            for q in QUANTILES:
                found, *bounds = quantile_interval(values, q)
                shown = [x if math.isfinite(x) else None for x in bounds] if bounded else []
                rows.append([metric.heading, q, found, *shown, len(values)])
    panels = []
    for key, metric in drawn.items():
        values = np.sort(values_of(table, key, metric))
        values = values[np.isfinite(values)]
        if len(values):
            share = (np.arange(len(values)) + 0.5) / len(values)
            panels.append(
                Panel(
                    metric.text,
                    _label(metric),
                    "share of the runs below [-]",
                    [Series("distribution", *keep_peaks(values, share, POINTS))],
                )
            )
    limits = [f"at least ({CONFIDENCE:.0%})", f"at most ({CONFIDENCE:.0%})"] if bounded else []
    columns = ["metric", "quantile", "value", *limits, "runs"]
    text = [_about_bounds(method)]
    if len(drawn) < len(metrics):
        text.append(
            f"Figures show the first {len(drawn)} of {len(metrics)} metrics. Quantiles of all of them are in the table"
            " below, their values in table.parquet. METRICS in the file of the experiment says which metrics are"
            " shown, with words and units."
        )
    figures = (
        [Figure("distributions", "Distributions", "Empirical distribution of each metric.", panels, columns=2)]
        if panels
        else []
    )
    return Section("Distributions", text, figures=figures, tables=[Table("quantiles", "Quantiles", columns, rows)])


def _thinned(values: Array) -> Any:
    """Numbers of about POINTS of the runs, those with the smallest and the largest value among them."""
    chosen = np.arange(0, len(values), max(1, len(values) // POINTS))
    fine = np.flatnonzero(np.isfinite(values))
    return np.union1d(chosen, fine[[values[fine].argmin(), values[fine].argmax()]]) if len(fine) else chosen


# -------------------------------------------------------------------------------------------------------------- scatter


def _scatter(table: SweepTable, drawn: Mapping[str, Metric], worst: Worst) -> Section:
    axes, units = numeric(table), table.sweep.units
    panels = [
        Panel(
            "",
            label_of(name, units[name]),
            _label(m),
            [Series("runs", x[i], values_of(table, k, m)[i], mode="markers")],
        )
        for k, m in drawn.items()
        for i in [_thinned(values_of(table, k, m))]
        for name, x in axes.items()
    ]
    figures = [
        Figure(
            "scatter",
            "Metrics over parameters",
            f"One point for each run; of more than {POINTS} runs a selection with the extremes is shown.",
            panels,
            columns=min(3, max(1, len(axes))),
        )
    ]
    ranked = worst.ranked(table)
    return Section("Scatter", [], figures=[*figures, *([_parallel(table, axes, drawn, ranked)] if ranked else [])])


def _parallel(
    table: SweepTable, axes: Mapping[str, Array], drawn: Mapping[str, Metric], ranked: Sequence[int]
) -> Figure:
    """Parallel coordinates: every run is a line over all columns, with the worst tenth highlighted.

    Each column is scaled from its smallest to its largest value.
    """
    columns = [*axes.values(), *(values_of(table, k, m) for k, m in drawn.items())]
    scaled = np.column_stack([_scaled(c) for c in columns])
    chosen = ranked[:: max(1, len(ranked) // LINES)]
    tenth = set(ranked[: max(1, len(ranked) // 10)])
    series = []
    for name, rows in (
        ("other runs", [i for i in chosen if i not in tenth]),
        ("worst tenth", [i for i in chosen if i in tenth]),
    ):
        if rows:
            x = np.tile([*range(len(columns)), math.nan], len(rows))
            y = np.concatenate([[*scaled[i], math.nan] for i in rows])
            series.append(Series(name, x, y))
    return Figure(
        "parallel",
        "Parallel coordinates",
        "A line for each run.",
        [Panel("", "quantity [?]", "from smallest to largest [-]", series, x_names=_axis_names(axes, drawn))],
    )


def _axis_names(axes: Mapping[str, Array], drawn: Mapping[str, Metric]) -> list[str]:
    """Names of the parallel axes; those that are alike are numbered."""
    names: list[str] = []
    for text in [*axes, *(m.text for m in drawn.values())]:
        names.append(next(n for n in chain([text], (f"{text} ({k})" for k in count(2))) if n not in names))
    return names


def _scaled(values: Array) -> Array:
    low, high = np.nanmin(values, initial=np.inf), np.nanmax(values, initial=-np.inf)
    return (values - low) / (high - low) if high > low else np.where(np.isfinite(values), 0.5, np.nan)


# ---------------------------------------------------------------------------------------------------------- sensitivity


def _sensitivity(table: SweepTable, drawn: Mapping[str, Metric], local: LocalSlopes | None = None) -> Section:
    rows: list[list[Scalar]] = []
    whole = not table.failures and all(np.isfinite(table.metrics[k]).all() for k in drawn)
    method = table.sweep.design.method
    paragraphs = []
    if method in ("saltelli", "morris") and not whole:
        paragraphs = ["Indices need every run of the design, and some have failed: rank correlations instead."]
        method = ""
    if method == "saltelli":
        columns = ["metric", "parameter", "first-order index", "±", "total index", "± of the total index"]
        rows = [[m.text, *found] for k, m in drawn.items() for found in sobol_indices(table, k)]
        paragraphs = [
            "Sobol indices: the share of the variance that a parameter explains alone, and with all its interactions;"
            " with 95 % confidence."
        ]
    elif method == "morris":
        columns = ["metric", "parameter", "mean magnitude of the effect", "standard deviation of the effect"]
        rows = [
            [m.text, n, mean * m.factor, s * m.factor]
            for k, m in drawn.items()
            for n, mean, s in morris_effects(table, k)
        ]
        paragraphs = [
            "Elementary effects (Morris), over the whole range of a parameter: a deviation as large as the mean"
            " indicates interactions or curvature."
        ]
    else:
        columns = ["metric", "parameter", "rank correlation"]
        rows = [
            [m.text, n, r if math.isfinite(r) else None]
            for k, m in drawn.items()
            for n, r in rank_correlations(table, k)
        ]
        paragraphs += [
            "Spearman's rank correlation. --method saltelli gives Sobol indices, --method morris elementary effects."
        ]
    tables = [Table("sensitivity", "Sensitivity", columns, rows)]
    if local is not None:
        tables = _with_local(columns, rows, table, drawn, local)
        paragraphs.append(
            "Derivatives are those of the run with the medians of all parameters: the change of the metric in per cent"
            " by a change of the parameter of 1 %. The deviation by tolerance is the standard deviation that follows"
            f" from that of the parameter ({', '.join(f'{n} {d:.3g}' for n, d in local.deviations.items())}) to first"
            " order; that of all is for independent parameters."
        )
    return Section("Sensitivity", paragraphs, tables=tables)


def _with_local(
    columns: list[str], rows: list[list[Scalar]], table: SweepTable, drawn: Mapping[str, Metric], local: LocalSlopes
) -> list[Table]:
    """The sensitivities with columns of local derivatives, and correlations of metrics."""
    row, slopes = local.slopes.row, local.slopes.slopes
    keys = [k for k in drawn if math.isfinite(row.get(k, math.nan)) and np.isfinite(slopes[k]).all()]
    places = [(k, m, a.name) for k, m in drawn.items() for a in table.sweep.design.axes]
    found: list[list[Scalar]] = []
    empty: list[Scalar] = [None] * (len(columns) - 2)
    for line, (k, m, axis) in zip(rows, places, strict=True):
        spread = local.spread(k, axis) if k in keys else None
        more: list[Scalar] = [
            local.relative(k, axis) if k in keys else None,
            None if spread is None else spread * m.factor,
        ]
        found.append([*line, *more])
        if k in keys and axis == table.sweep.design.axes[-1].name:
            found.append([m.text, "all", *empty, None, float(np.sqrt(local.covariance([k])[0, 0])) * m.factor])
    covariance = local.covariance(keys)
    size = np.sqrt(np.diag(covariance))
    correlated: list[list[Scalar]] = [
        [drawn[a].text, *(float(c / (s * t)) if s * t else None for c, t in zip(line, size, strict=True))]
        for a, line, s in zip(keys, covariance, size, strict=True)
    ]
    headings = ["metric", *(drawn[k].text for k in keys)]
    return [
        Table("sensitivity", "Sensitivity", [*columns, "derivative [%/%]", "deviation by tolerance"], found),
        Table("correlations", "Correlations of metrics by tolerance, to first order", headings, correlated),
    ]


# ---------------------------------------------------------------------------------------------------------- worst cases


def _worst(
    table: SweepTable,
    fmus: FmuSet,
    worst: Worst,
    metrics: Mapping[str, Metric],
    folder: Path | None,
    execution: Execution | None,
) -> Section:
    """The worst runs with their time histories: those that were kept, else the runs are made once more."""
    sweep = table.sweep
    runs = worst.ranked(table)[:WORST]
    said = metrics.get(worst.metric, undeclared(worst.metric)).text
    shown = {k: m for k, m in metrics.items() if k == worst.metric or k in list(metrics)[:MOST_METRICS]}
    rows: list[list[Scalar]] = [
        [i, *_cells(sweep, i), *(float(values_of(table, k, m)[i]) for k, m in shown.items())] for i in runs
    ]
    rows = [[None if isinstance(c, float) and not math.isfinite(c) else c for c in row] for row in rows]
    columns = list(dict.fromkeys(["run", *_headings(sweep), *(m.heading for m in shown.values())]))
    tables = (
        [Table("worst", f"Runs whose {said} is {worst.how}", columns, rows)]
        if rows and len(columns) == len(rows[0])
        else []
    )
    histories: dict[str, list[Series]] = {}
    labels: dict[str, str] = {}
    kept = {
        i: folder / table.histories[i] for i in runs if folder is not None and table.histories and table.histories[i]
    }
    with Runner(swept(sweep.experiment, sweep.parameters), fmus, execution=execution) as runner:
        for i in runs:
            recording: Any = (
                Recording.read(kept[i]) if i in kept else runner.record(runner.experiment.case(**_given(sweep, i)))
            )
            for name in list(recording.names)[:MOST_METRICS]:
                histories.setdefault(name, []).append(
                    Series(f"run {i}", *keep_peaks(recording.time, recording[name], SAMPLES))
                )
                labels[name] = label_of(name, recording.units.get(name, ""))
    recorded = len(recording.names) if runs else 0
    panels = [Panel(name, "time [s]", labels[name], series) for name, series in histories.items()]
    text = (
        f"To repeat a run and save its time histories, add --run {runs[0]} to the sweep command."
        if runs
        else "No run has this metric."
    )
    if len(shown) < len(metrics):
        text += f" The table has {len(shown)} of {len(metrics)} metrics; table.parquet has all."
    figures = (
        [
            Figure(
                "worst-runs",
                "Time histories of the worst runs",
                _origin(runs, kept) + _left_out(recorded),
                panels,
                columns=2,
            )
        ]
        if panels
        else []
    )
    return Section("Worst cases", [text], figures=figures, tables=tables)


def _origin(runs: Sequence[int], kept: Collection[int]) -> str:
    again = [f"{i}" for i in runs if i not in kept]
    if not kept:
        return "Repeated for this page."
    return (
        f"As stored with the table; repeated for this page: {', '.join(again)}."
        if again
        else "As stored with the table."
    )


def _left_out(recorded: int) -> str:
    if recorded <= MOST_METRICS:
        return ""
    return f" The first {MOST_METRICS} of {recorded} recorded variables; --run NUMBER writes all of a run."


def _given(sweep: Sweep, i: int) -> dict[str, Any]:
    return {**sweep.base, **dict(zip(sweep.attributes, sweep.point(i), strict=True))}
