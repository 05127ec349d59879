"""The command `cosim sweep`, made of what an experiment declares."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from build_fmus.base.terminal import PATH, Command, Names, console
from cosim.study.commands import make_folder, on, refuse_none, run_case, tell_lanes
from cosim.study.design import MANY, METHODS, Design, DesignError, axis, from_file
from cosim.study.experiment import Baseline, Experiment
from cosim.study.options import (
    EXECUTION,
    MANY_RUNS,
    OUT,
    RETRY,
    case_options,
    case_values,
    command,
    execution,
    fmu_options,
    fmu_set,
)
from cosim.study.slopes import local_slopes
from cosim.study.sweep import HISTORIES, RunningStats, Sweep, Watch, prepare, run_sweep
from cosim.study.swept import swept

REFRESH = 2.0  # 1/s, of the table on the screen
MOST = 12  # metrics in it

_FILE = "or as in the design file"
DESIGN = (
    click.Option(
        ["--vary"],
        multiple=True,
        metavar="NAME=LOW:HIGH",
        help="vary an option of the cases, or COMPONENT.PARAMETER of the system: a range, a list NAME=A,B,C or a"
        " distribution NAME=normal(MEAN,DEVIATION) (repeatable)",
    ),
    click.Option(
        ["--samples"],
        type=click.IntRange(min=1),
        help=f"number of points of the design (default: {Design.samples}, {_FILE})",
    ),
    click.Option(
        ["--method"], type=Names(METHODS), help=f"choose the sampling method (default: {Design.method}, {_FILE})"
    ),
    click.Option(
        ["--random-seed"], type=click.IntRange(min=0), help=f"seed of the design (default: {Design.seed}, {_FILE})"
    ),
    click.Option(
        ["--design"], type=PATH, metavar="FILE", help="read the design from a .toml file, or from DESIGN in a .py file"
    ),
    click.Option(
        ["--worst"],
        metavar="METRIC",
        help="rank the worst runs by the largest values of this metric; METRIC:min: by the smallest (default: the first"
        " metric, furthest from 0)",
    ),
    click.Option(
        ["--run"],
        type=click.IntRange(min=0),
        metavar="NUMBER",
        help="repeat one run of the sweep and save its time histories",
    ),
    click.Option(
        ["--histories"],
        is_flag=True,
        help="also save the time histories of every run, as Parquet files next to the table",
    ),
    click.Option(
        ["--gradient"],
        is_flag=True,
        help="also list derivatives at the medians of the parameters, by one run with derivatives, and the standard"
        " deviations of metrics that follow from the parameters' distributions",
    ),
    click.Option(["--yes"], is_flag=True, help=f"do not ask before more than {MANY} runs"),
)


def sweep_command(experiment: Experiment) -> Command:
    """The command that runs an experiment over a design."""

    def sweep(**given: Any) -> None:
        design = _design(given)
        _ask(design, given["yes"])
        fmus = fmu_set(experiment, given)
        prepared = prepare(experiment, fmus, design, case_values(given))
        if given["run"] is not None:
            _one(prepared, given["run"], fmus, given)
            return
        write_sweep(
            prepared,
            fmus,
            given["out"],
            worst=given["worst"],
            cluster=given["dask"],
            processes=given["processes"],
            retry_failed=given["retry_failed"],
            force=given["force"],
            execution=execution(given),
            histories=given["histories"],
            gradient=given["gradient"],
        )

    return command(
        experiment,
        sweep,
        f"Runs over a design of its parameters; writes results/{experiment.name}/sweep/report.html.",
        {
            "Case": case_options(experiment, beside=DESIGN),
            "Design": DESIGN,
            "FMUs": fmu_options(experiment),
            "How it runs": [*EXECUTION, *MANY_RUNS, RETRY],
            "Inputs and results": [OUT],
        },
    )


def write_sweep(
    sweep: Sweep,
    fmus: Any,
    out: Path,
    *,
    worst: str | None = None,
    cluster: str | None = None,
    gradient: bool = False,
    **options: Any,
) -> Path:
    """Run a sweep under a progress bar, and write its table and page; `options` as for `cosim.study.run_sweep`.

    `gradient`: the page also lists local derivatives, see `cosim.study.slopes.local_slopes`.

    Raises:
        CosimError: every run failed; table and page are there.
    """
    from cosim.report import write_report  # fails where [reports] is missing: before the work, not after
    from cosim.study.sweep_report import Worst, sweep_report

    ranking = None if worst is None else Worst.of(worst)
    folder = make_folder(fmus.results(out, sweep.experiment.name) / "sweep")
    local = local_slopes(sweep, fmus, options.get("execution")) if gradient else None
    with on(cluster, options.get("processes")) as executor, _shown(sweep) as (progress, running_stats):
        try:
            table = run_sweep(
                sweep,
                fmus,
                folder / ".runs",
                executor=executor,
                progress=progress,
                running_stats=running_stats,
                needed=ranking.metric if ranking else "",
                **options,
            )
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                "interrupted; finished runs are stored, and the same command continues from there"
            ) from None
    tell_lanes(table.in_lanes)
    for number, message in list(table.failures.items())[:5]:
        console.print(f"failed: run {number}: {message}")
    if table.failures:
        console.print(f"{len(table.failures)} of {len(sweep)} runs failed; --retry-failed runs them again")
    if missing := sum(not h for i, h in enumerate(table.histories) if i not in table.failures):
        console.print(f"{missing} histories are missing in {folder / HISTORIES}: can all workers write to this folder?")
    path = table.write(folder / "table.parquet")
    page = write_report(
        sweep_report(table, fmus, worst=ranking, folder=folder, execution=options.get("execution"), local=local), folder
    )
    console.print(f"table: {path}")
    console.print(f"report: {page}")
    refuse_none(len(sweep) - len(table.failures), table.failures.values())
    return page


@contextmanager
def _shown(sweep: Sweep) -> Iterator[tuple[Watch, RunningStats | None]]:
    """A progress bar; on a terminal with a table below it, of the metrics as they stand."""
    columns = [
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[failed]} failed", markup=False),
    ]
    bar = Progress(*columns, console=console)
    task = bar.add_task(f"sweep {sweep.experiment.name}", total=len(sweep), failed=0)

    def progress(done: int, total: int, lost: int) -> None:
        bar.update(task, completed=done, total=total, failed=lost)

    if not console.is_terminal:
        with bar:
            yield progress, None
        return
    running_stats = RunningStats()
    with Live(
        get_renderable=lambda: Group(bar, running_table(running_stats)), console=console, refresh_per_second=REFRESH
    ):
        yield progress, running_stats


def running_table(running_stats: RunningStats) -> Table:
    """The metrics of the runs so far, as a table for the screen."""
    table = Table("metric", "runs", "mean", "deviation", "smallest", "largest", box=None)
    for name, *numbers in running_stats.rows()[:MOST]:
        table.add_row(Text(name), *(f"{x:.4g}" for x in numbers))
    if (more := len(running_stats.rows()) - MOST) > 0:
        table.add_row(Text(f"and {more} more"))
    return table


def _design(given: Mapping[str, Any]) -> Design:
    options = (("samples", "samples"), ("method", "method"), ("random_seed", "seed"))
    changes = {attribute: given[option] for option, attribute in options if given[option] is not None}
    if given["design"] is None:
        return Design(tuple(axis(text) for text in given["vary"]), **changes)
    found = from_file(given["design"])
    if changes and found.method == "list":
        raise DesignError(
            f"{given['design']} lists its points (cases): leave out --samples, --method and --random-seed"
        )
    found = dataclasses.replace(found, **changes)
    if given["vary"]:
        more = tuple(axis(text) for text in given["vary"])
        names = {a.name for a in more}
        if found.method == "list":
            raise DesignError(f"{given['design']} lists its points (cases): leave out --vary")
        found = dataclasses.replace(found, axes=(*(a for a in found.axes if a.name not in names), *more))
    return found


def _ask(design: Design, yes: bool) -> None:
    """Whether so many runs are meant.

    Raises:
        DesignError: they are not, or nobody is there to say so.
    """
    if design.runs <= MANY or yes:
        return
    hours = design.runs * 0.1 / 3600
    often = (
        f"{hours:.0f} hours"
        if hours < 48
        else f"{hours / 24:.0f} days"
        if hours < 24 * 730
        else f"{hours / 24 / 365:.0f} years"
    )
    text = f"{design.runs:.6g} runs: at 0.1 s each about {often} on one core"
    if not (console.is_terminal and click.confirm(f"{text}. Run them?", default=False)):
        raise DesignError(f"{text}; nothing was run. Take fewer --samples, or give --yes")


def _one(sweep: Sweep, number: int, fmus: Any, given: Mapping[str, Any]) -> None:
    if number >= len(sweep):
        raise DesignError(f"--run {number}: the design has runs 0 to {len(sweep) - 1}")
    made = swept(sweep.experiment, sweep.parameters)
    kind = type("Run", (made.case,), {"label": f"run-{number}"})  # which names its files
    case = kind(**{**sweep.base, **dict(zip(sweep.attributes, sweep.point(number), strict=True))})
    alone = dataclasses.replace(made, baseline=Baseline())
    run_case(alone, case, fmus, given["out"], execution(given), folder=fmus.results(given["out"], made.name) / "sweep")
