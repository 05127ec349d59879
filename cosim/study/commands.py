"""Commands of an experiment: `run` with options of its cases, `study` with those of its plan."""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from build_fmus.base import safe_files
from build_fmus.base.checks import did_you_mean, glob
from build_fmus.base.terminal import PATH, Command, console, show
from cosim import Execution, Record
from cosim.core.errors import ComponentError, CosimError, Interrupted
from cosim.recording.formats import FORMATS, format_of
from cosim.recording.recording import Recording
from cosim.study.case import CaseError, fields, file_name, grid
from cosim.study.curve import bars as drawn_bars
from cosim.study.curve import drawn
from cosim.study.driver import Progressed, run_study
from cosim.study.executors import dask
from cosim.study.experiment import Experiment, Metric, Row, resolved, undeclared
from cosim.study.fmus import FmuSet
from cosim.study.options import (
    EXECUTION,
    MANY_RUNS,
    OUT,
    RETRY,
    case_of,
    case_options,
    case_values,
    command,
    execution,
    fmu_options,
    fmu_set,
)
from cosim.study.pages import report_of
from cosim.study.runner import Runner

REAL_TIME = click.Option(
    ["--real-time"],
    type=float,
    is_flag=False,
    flag_value=1.0,
    metavar="[FACTOR]",
    help="run in real time, FACTOR times as fast as the clock (1 if left out), and report the timing",
)
TOLERANCE = click.Option(
    ["--tolerance"],
    type=float,
    metavar="RELATIVE",
    help="let the communication steps of continuous components follow the error of the exchange, to keep it below this"
    " part of the largest magnitude of each value, and report the steps (default: fixed steps)",
)
NOTHING = 1e-20  # of a metric: below it there is nothing to compare


# -------------------------------------------------------------------------------------------------------------- one run


def run_command(experiment: Experiment) -> Command:
    """The command that runs one case beside its baseline."""

    def run(**given: Any) -> None:
        run_case(
            experiment,
            case_of(experiment, given),
            fmu_set(experiment, given),
            given["out"],
            replace(execution(given), tolerance=given.get("tolerance")),
            inputs=given["signals"],
            hold_inputs=given["hold_input"],
            output=given["recording"],
            display_units=given["display_units"],
            real_time=given["real_time"],
            curves=given["curves"],
            bars=given["bars"],
        )

    case = case_options(experiment)
    return command(
        experiment,
        run,
        "Run one case: print its metrics and write its time histories to a file.",
        {
            "Case": case,
            "FMUs": fmu_options(experiment),
            "How it runs": [*EXECUTION, REAL_TIME, *_tolerance(case)],
            "Inputs and results": _results(case),
        },
    )


def _tolerance(beside: Sequence[click.Option]) -> list[click.Option]:
    """The option of the tolerance, if none of those beside it has its name."""
    return [] if "--tolerance" in _names(beside) else [TOLERANCE]


def _names(options: Sequence[click.Option]) -> set[str]:
    return {name for option in options for name in option.opts}


def _results(case: Sequence[click.Option]) -> list[click.Option]:
    """Options of the inputs and results of one run. Names that the options of its case have are theirs."""
    own = _names(case)
    return [
        OUT,
        click.Option(
            [*(n for n in ("--signals", "--input") if n not in own), "signals"],
            type=PATH,
            multiple=True,
            metavar="FILE",
            help="drive inputs by the columns of a CSV or Parquet file, 'time [s]' and 'COMPONENT.INPUT [unit]'"
            " (repeatable)",
        ),
        click.Option(
            ["--hold-input"], is_flag=True, help="hold the last values of a signal file that is shorter than the run"
        ),
        click.Option(
            [*(n for n in ("--recording", "--output") if n not in own), "recording"],
            type=PATH,
            metavar="FILE",
            help=f"write time histories to this file, whose suffix sets the format: {', '.join(FORMATS)} (default: a"
            " CSV in --out)",
        ),
        click.Option(
            ["--display-units"],
            is_flag=True,
            help="write time histories in the display units of the FMUs (deg, km/h) instead of SI units",
        ),
        click.Option(
            ["--plot", "curves"],
            multiple=True,
            metavar="NAME",
            help="plot this recorded variable, such as car.body.az, or a pattern, in the terminal (repeatable)",
        ),
        click.Option(
            ["--bars"], is_flag=True, help="draw the metrics as bars in the terminal, next to those of the baseline"
        ),
    ]


def run_case(
    experiment: Experiment,
    case: Any,
    fmus: FmuSet,
    out: Path,
    execution: Execution | None = None,
    *,
    inputs: Sequence[Path] = (),
    hold_inputs: bool = False,
    output: Path | None = None,
    display_units: bool = False,
    real_time: float | None = None,
    curves: Sequence[str] = (),
    bars: bool = False,
    folder: Path | None = None,
) -> None:
    """Run one case beside its baseline: a table on the screen, time histories and metrics as files.

    `output`, `display_units` and `real_time` of the case: see `cosim.System.run`; `inputs` and `hold_inputs` of both:
    see `Runner`; `curves`: names and patterns of the curves of the case in the terminal; `bars`: whether its metrics
    are drawn as shares of the baseline's; `folder`: of the files, by default that of the experiment and the user's
    vehicles in `out`.

    Raises:
        ComponentError: a component failed; the file holds what was recorded.
    """
    folder = make_folder(folder or fmus.results(out, experiment.name))
    name = file_name(case)
    path = output or folder / f"{name}.csv"
    format_of(path)  # refused before FMUs are loaded
    baseline = experiment.baseline.beside(case, fmus)
    with Runner(experiment, fmus, execution=execution, inputs=inputs, hold_inputs=hold_inputs) as runner:
        runner.execution.prepare(system := runner.system(case))
        recorded = [f"{m.name}.{v.name}" for m, v in system.select(experiment.run.recorded(case))]
        for curve in curves:
            if not any(map(glob(system.canonical(curve)), recorded)):
                raise CaseError(f"--plot {curve}: this variable is not recorded{did_you_mean(curve, recorded)}")
        with kept_recording(path):
            record = Record(display_units=display_units)
            run = runner.run(case, output=path, record=record, progress=True, real_time=real_time)
        name_of = experiment.baseline.name_of
        runs, measured = {name_of(case): run}, {name_of(case): experiment.measured(run)}
        remarks = experiment.measures.remarks(run) if experiment.measures.remarks else ()
        if baseline is not None and baseline != case:
            beside = runner.run(baseline)
            runs = {name_of(baseline): beside, **runs}
            own, other = measured[name_of(case)], experiment.measured(beside)
            more = experiment.baseline.compared(own, other) if experiment.baseline.compared else {}
            measured = {name_of(baseline): other, name_of(case): {**own, **more}}
        metrics = experiment.measures.metrics or _plain(measured)
        show(metric_table(measured, metrics, relative=experiment.baseline.relative))
        if len(measured) > 1:
            console.print(experiment.baseline.sentence(baseline, case), markup=False)
        if bars:
            show_bars(measured, metrics)
        show_curves(run.recording, curves)
        for remark in remarks:
            console.print(f"note: {remark}")
        if (page := resolved(experiment.page)) is not None:
            console.print(f"page: {page(runs, fmus, folder / name)}")
    for told in (run.recording.real_time, run.recording.steps, *run.recording.loops):
        if told is not None:
            console.print(str(told))
    summary = folder / f"{name}.json"
    write_summary(summary, measured)
    console.print(f"{path} and {summary if output else summary.name}; {run.recording.real_time_factor:.0f}x real time")


def _plain(measured: Mapping[str, Row]) -> dict[str, Metric]:
    return {k: undeclared(k) for row in measured.values() for k, v in row.items() if isinstance(v, int | float | str)}


def metric_table(measured: dict[str, Row], metrics: Mapping[str, Metric], *, relative: bool = False) -> Table:
    """Metrics of several runs side by side; one that a run does not have is a dash.

    `relative`: the last run's also as per cent of the first one's; a dash where that is nothing but rounding.
    """
    first, last = next(iter(measured)), next(reversed(measured))
    relative = relative and first != last
    table = Table("metric", *measured, *[f"{last}, per cent of {first}"] * relative, box=None)
    for key, metric in metrics.items():
        cells = [metric.shown(row.get(key)) for row in measured.values()]
        if relative:
            base, value = (measured[n].get(key) for n in (first, last))
            share = None
            if isinstance(base, int | float) and isinstance(value, int | float) and abs(base) > NOTHING:
                share = 100 * value / base
            cells.append("-" if share is None else f"{share:.1f}")
        table.add_row(Text(metric.heading), *cells)
    return table


def show_bars(measured: dict[str, Row], metrics: Mapping[str, Metric]) -> None:
    """Metrics of the last run as bars on the screen, as shares of those of the first one."""
    first, last = next(iter(measured)), next(reversed(measured))
    if first == last:
        console.print("no bars: they are shares of a baseline, and this run is the baseline or has none")
        return
    shares = {}
    for key, metric in metrics.items():
        base, value = (measured[n].get(key) for n in (first, last))
        if isinstance(base, int | float) and isinstance(value, int | float) and abs(base) > NOTHING:
            share = value / base
            if math.isfinite(share) and share >= 0:
                shares[metric.text] = share
    if shares:
        lines = drawn_bars(shares, Console().width, plain=_plain_terminal())
        show(Text(f"\n{last}, per cent of {first}:\n{lines}"), as_is=True)


def show_curves(recording: Recording, names: Sequence[str]) -> None:
    """Curves of a recording on the screen; ValueError for names that are not in it."""
    for name in recording.select(*names) if names else ():
        unit = recording.units.get(name, "")
        title = f"\n{name} [{unit}]" if unit else f"\n{name}"
        show(Text(drawn(title, recording.time, recording[name], Console().width, plain=_plain_terminal())), as_is=True)


def _plain_terminal() -> bool:
    return not (sys.stdout.encoding or "").lower().startswith("utf")


@contextmanager
def kept_recording(path: Path) -> Iterator[None]:
    """Around a run that writes a file: when it fails or is interrupted, say what the file holds."""
    try:
        yield
    except (ComponentError, Interrupted) as error:
        if error.recording is not None and len(error.recording):
            console.print(f"{path} contains the run up to t = {error.time:g} s")
        raise


def write_summary(path: Path, measured: Mapping[str, Row]) -> None:
    """Metrics of runs by name as a JSON file."""
    safe_files.write(path, json.dumps(measured, indent=1) + "\n")


# ------------------------------------------------------------------------------------------------------------ many runs


def study_command(experiment: Experiment) -> Command:
    """The command that runs a study and writes its report."""
    own_plan = experiment.study.plan is not None
    options = (
        getattr(experiment.study.plan, "__click_params__", [])
        if own_plan
        else case_options(experiment, repeatable=True)
    )

    def study(**given: Any) -> None:
        chosen = {option.name: given[option.name] for option in options} if own_plan else case_values(given)
        write_study(
            experiment,
            fmu_set(experiment, given),
            given["out"],
            tasks=None if own_plan else _grid(experiment, chosen),
            options=chosen if own_plan else {},
            processes=given["processes"],
            cluster=given["dask"],
            retry_failed=given["retry_failed"],
            force=given["force"],
            execution=replace(execution(given), tolerance=given.get("tolerance")),
        )

    what = "The whole study" if own_plan else "All combinations of the values given for each option"
    return command(
        experiment,
        study,
        f"{what}; writes results/{experiment.name}/report.html.",
        {
            "Study" if own_plan else "Case": options,
            "FMUs": fmu_options(experiment),
            "How it runs": [*EXECUTION, *_tolerance(options), *MANY_RUNS, RETRY],
            "Inputs and results": [OUT],
        },
    )


def _grid(experiment: Experiment, given: Mapping[str, Sequence[Any]]) -> list[Any]:
    axes = {name: values for name, values in given.items() if values}
    if not axes:
        first = fields(experiment.case)[0].name if fields(experiment.case) else "OPTION"
        raise CaseError(f"{experiment.name} has no plan: give the values to run over, such as --{first} A --{first} B")
    return grid(experiment.case, **axes)


def write_study(experiment: Experiment, fmus: FmuSet, out: Path, *, cluster: str | None = None, **options: Any) -> Path:
    """Run a study under a progress bar and write its page.

    `cluster`: Dask cluster that it runs on, see `cosim.study.dask`; `options` as for `cosim.study.run_study`.

    Raises:
        CosimError: every run failed; the page is there.
    """
    from cosim.report import write_report  # fails where [reports] is missing: before the work, not after

    folder = make_folder(fmus.results(out, experiment.name))
    for part in experiment.every:
        fmus.paths(part.wiring.fmus)
    with on(cluster, options.get("processes")) as executor, progress_bar(f"study {experiment.name}") as progress:
        results = run_study(experiment, fmus, folder / ".runs", executor=executor, progress=progress, **options)
    tell_lanes(results.in_lanes)
    failures = results.failures
    for name, message in list(failures.items())[:5]:
        console.print(f"failed: {name}: {message}")
    if failures:
        console.print(f"{len(failures)} of {len(results.tasks)} runs failed; --retry-failed runs them again")
    page = write_report(report_of(experiment, results, fmus, options.get("execution")), folder)
    console.print(f"report: {page}")
    refuse_none(len(results.ran), failures.values())
    return page


def tell_lanes(count: int) -> None:
    """Say how many of the runs of a command were copies in lanes, if any."""
    if count:
        console.print(f"{count} runs were computed in vector lanes, several at a time")


def refuse_none(done: int, failures: Collection[str]) -> None:
    """End a command none of whose runs came to its end, so that scripts see it.

    Raises:
        CosimError: it is so.
    """
    if failures and not done:
        raise CosimError(f"all {len(failures)} runs failed; the first: {next(iter(failures))}")


@contextmanager
def on(cluster: str | None, processes: int | None) -> Iterator[Executor | None]:
    """The executor of a Dask cluster, or None for processes of this machine."""
    if cluster is None:
        yield None
    else:
        with dask(cluster, processes) as executor:
            yield executor


@contextmanager
def progress_bar(title: str) -> Iterator[Progressed]:
    """A bar on the terminal; the function that it gives is called with (done, total)."""
    columns = [
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=None)
        try:
            yield lambda done, total: bar.update(task, completed=done, total=total)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                "interrupted; finished runs are stored, and the same command continues from there"
            ) from None


# ----------------------------------------------------------------------------------------------------------------- both


def make_folder(path: Path) -> Path:
    """The folder, made and tried out before any work is done; OSError that says what to do."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError as error:
        raise OSError(f"cannot write to {path} ({error.strerror}); choose another directory with --out") from None
    return path
