"""Common parts of the reports of all studies.

These are provenance, parameters of the FMUs that ran, sections that survive a failed run, and the report of a study
that has none of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

from build_fmus.base.terminal import PACKAGE
from cosim import Execution
from cosim.core.content_checks import Scalar, label_of
from cosim.fmu.file import FmuFile
from cosim.report import Figure, Map, Panel, Parameter, Report, Section, Series, Table
from cosim.study import key
from cosim.study.case import Field, differing
from cosim.study.experiment import DefaultExchangeError, Experiment, Metric, Row, resolved, undeclared
from cosim.study.fmus import FmuSet
from cosim.study.results import Results, RunFailed

MOST_METRICS = 12  # that are drawn where an experiment does not say how its metrics are shown


def provenance(experiment: Experiment, fmus: FmuSet, files: Iterable[Path] = ()) -> dict[str, Any]:
    """Versions, papers and hashes of the FMU files for a report.

    `files`: FMU files besides those that the experiment and its parts name.
    """
    used = key.libraries(m for e in experiment.every for m in key.entry_modules(e))
    found: dict[str, Any] = {"versions": {PACKAGE: metadata.version(PACKAGE), **key.versions(used)}}
    if experiment.study.papers:
        found["papers"] = dict(resolved(experiment.study.papers))
    paths = dict.fromkeys([*fmus.paths(n for e in experiment.every for n in e.wiring.fmus), *files])
    return {**found, "FMI version": f"{fmus.fmi}.0", "FMUs (SHA-256)": {p.stem: key.content_hash([p]) for p in paths}}


def parameters(
    file: Path, names: Sequence[str] | None = None, *, prefix: str = "", set_to: Mapping[str, Any] | None = None
) -> list[Parameter]:
    """Parameters of an FMU as it is on disk, with their units and sources.

    Args:
        file: the FMU.
        names: which ones; None for all that are numbers or truth values.
        prefix: put ahead of each name.
        set_to: values that a study sets them to.
    """
    about = FmuFile(file).description
    chosen = about.parameters if names is None else {n: about.find(n, file.stem) for n in names}
    given = set_to or {}
    return [
        Parameter(
            f"{prefix}{name}",
            given.get(name, v.start),
            v.unit_name or "-",
            "set by the study" if name in given else getattr(v, "source", None) or "the FMU does not say",
        )
        for name, v in chosen.items()
        if v.type != "string"
    ]


def sections(study: Any, makers: Iterable[Callable[[Any], Section | list[Section]]]) -> list[Section]:
    """Sections of a report in order; one that needs a run which failed says so in its place."""
    made: list[Section] = []
    for maker in makers:
        try:
            found = maker(study)
            made += found if isinstance(found, list) else [found]
        except RunFailed as error:
            title = (maker.__doc__ or maker.__name__.strip("_").replace("_", " ")).partition("\n")[0].rstrip(".")
            made.append(Section(title[:1].upper() + title[1:], [f"Left out: {error}"]))
    return made


def make_lead(study: Any, maker: Callable[[Any], tuple[str, Figure | Map | None]]) -> tuple[str, Figure | Map | None]:
    """The lead sentence of a report and its figure; where they need a run which failed, the sentence says so."""
    try:
        return maker(study)
    except RunFailed as error:
        return f"The main result is left out: {error}", None


def compared(value: float, base: float) -> str:
    """A value compared with another one, in words: "25 % lower"."""
    change = 100 * (value / base - 1)
    return f"{abs(change):.0f} % {'lower' if change < 0 else 'higher'}"


def failed_section(results: Results) -> list[Section]:
    """A table of the runs that failed; nothing where none did."""
    failures = results.failures
    if not failures:
        return []
    table = Table("failed-runs", "Runs that failed", ["run", "message"], [[k, v] for k, v in failures.items()])
    text = (
        f"{len(failures)} of {len(results.tasks)} runs failed. Claims that need them are open; --retry-failed runs them"
        " again."
    )
    return [Section("Failed runs", [text], tables=[table])]


def exchange_section(experiment: Experiment, results: Results) -> list[Section]:
    """The error of the exchange in the default run, where the study has estimated it."""
    search = DefaultExchangeError(tuple(experiment.study.exchange_error))
    if search not in results.tasks:
        return []

    def error_of_the_exchange(_: Any) -> Section:
        chosen = ", ".join(search.variables)
        text = (
            f"In the run with default options, of {chosen}: {results.found(search)} The command `error` tells it for"
            " every case and variable."
        )
        return Section("Error of the exchange", [text])

    return sections(None, [error_of_the_exchange])


def report_of(experiment: Experiment, results: Results, fmus: FmuSet, execution: Execution | None = None) -> Report:
    """The page of a study: that of the experiment, or the one by default; at its end the runs that failed.

    With a tolerance, its lead says so.
    """
    made: Report = (resolved(experiment.study.report) or partial(default_report, experiment))(results, fmus)
    if execution is not None and execution.tolerance is not None:
        steps = f"Communication steps follow the error of the exchange, with a tolerance of {execution.tolerance:g}."
        made = replace(made, lead=f"{made.lead} {steps}")
    return replace(made, sections=[*made.sections, *exchange_section(experiment, results), *failed_section(results)])


# ------------------------------------------------------------------------------------------------- a report by default


def default_report(experiment: Experiment, results: Results, fmus: FmuSet) -> Report:
    """Report with a table of all runs, and every metric over each number that differs between the runs.

    Runs of parts are listed by themselves.
    """
    claims = resolved(experiment.study.claims)
    own = results.of()
    axes = ", ".join(f.name.replace("-", " ") for f in differing(own))
    parts = [s for part in experiment.every[1:] for s in _runs(part, results.of(part.name), f"{part.name}-")]
    return Report(
        experiment=experiment.name,
        title=experiment.title or experiment.name,
        lead=f"{len(results)} runs" + (f" over {axes}." if axes else "."),
        claims=claims.judge(results) if claims is not None else (),
        sections=[*_runs(experiment, own), *parts],
        provenance=provenance(experiment, fmus),
    )


def _runs(experiment: Experiment, results: Results, prefix: str = "") -> list[Section]:
    """Sections on the runs of an experiment, or of a part, whose tables and figures are named with a prefix."""
    axes = differing(results)
    metrics = shown_metrics(experiment, results)
    ran = results.ran
    rows: list[list[Scalar]] = [
        [*(getattr(c, f.attribute) for f in axes), *(_number(m, results[c].get(k)) for k, m in metrics.items())]
        for c in ran
    ]
    columns = [*(f.text for f in axes), *(m.heading for m in metrics.values())]
    about = f" of {experiment.name}" if prefix else ""
    table = Table(f"{prefix}runs", f"All runs{about}", columns or ["run"], rows if columns else [[experiment.name]])
    curves = metrics if experiment.measures.metrics else dict(list(metrics.items())[:MOST_METRICS])
    left_out = (
        f"Figures show the first {len(curves)} of {len(metrics)} metrics. The table has all of them and scrolls"
        " sideways; its CSV file has them too. METRICS in the file of the experiment says which metrics are shown,"
        " with words and units."
    )
    found = [Section(f"Runs{about}", [left_out] if len(curves) < len(metrics) else [], tables=[table])]
    drawn = [
        figure for f in axes if f.type in (int, float) for figure in _figures(f, axes, curves, results, ran, prefix)
    ]
    if drawn:
        found.append(Section(f"Dependence of the metrics{about}", [], figures=drawn))
    return found


def cells(metrics: Mapping[str, Metric], row: Row, names: Iterable[str] | None = None) -> dict[str, str]:
    """Metrics of a run as people read them, by heading; `names`: which ones, None for all."""
    return {metrics[k].heading: metrics[k].shown(row.get(k)) for k in names or metrics}


def shown_metrics(experiment: Experiment, results: Results) -> dict[str, Metric]:
    """Metrics and how they are shown: as the experiment says, else every number that was measured, by its own name."""
    if experiment.measures.metrics:
        return dict(experiment.measures.metrics)
    names = dict.fromkeys(
        k for c in results.ran for k, v in results[c].items() if isinstance(v, int | float) and not isinstance(v, bool)
    )
    return {n: undeclared(n) for n in names}


def _number(metric: Metric, value: Any) -> Scalar:
    return metric.factor * value if isinstance(value, int | float) and not isinstance(value, bool) else value


def _figures(
    axis: Field, axes: list[Field], metrics: Mapping[str, Metric], results: Results, ran: list[Any], prefix: str
) -> list[Figure]:
    """Every metric over one number, in one figure; a curve for each combination of the other values.

    None if nothing was measured.
    """
    others = [f for f in axes if f is not axis]
    curves: dict[str, list[Any]] = {}
    for case in ran:
        name = ", ".join(f"{f.name.replace('-', ' ')} {getattr(case, f.attribute)}" for f in others) or "runs"
        curves.setdefault(name, []).append(case)
    panels = []
    for k, m in metrics.items():
        series = []
        for name, cases in curves.items():
            points = sorted(
                (getattr(c, axis.attribute), _number(m, results[c].get(k))) for c in cases if k in results[c]
            )
            if points:
                x, y = zip(*points, strict=True)
                series.append(Series(name, x, y, mode="line+markers"))
        if series:
            panels.append(Panel(m.text, _axis(axis), label_of(m.text, m.unit), series))
    title = f"Metrics over {axis.name.replace('-', ' ')}"
    return [Figure(f"{prefix}over-{axis.name}", title, "", panels, columns=2)] if panels else []


def _axis(f: Field) -> str:
    return label_of(f.name.replace("-", " "), f.option.unit)
