"""The command `cosim optimise`: a search over parameters of any experiment, by what its metrics say."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from build_fmus.base.terminal import Command, console
from cosim import Execution
from cosim.study.commands import make_folder, on, progress_bar, tell_lanes
from cosim.study.design import Axis, Design, DesignError, axis
from cosim.study.experiment import Experiment, Row
from cosim.study.fmus import FmuSet
from cosim.study.lanes import LANES_PAY
from cosim.study.options import (
    EXECUTION,
    MANY_RUNS,
    OUT,
    case_options,
    case_values,
    command,
    execution,
    fmu_options,
    fmu_set,
)
from cosim.study.processes import local_processes
from cosim.study.slopes import PointSlopes
from cosim.study.store import Store
from cosim.study.sweep import Sweep, prepare, run_sweep

if TYPE_CHECKING:  # needs the extra [optimisation]
    from cosim.study.optimise import Limits, Outcome

TRIALS, RUNS = "trials.log", ".runs"  # of a search, in its folder

SEARCH = (
    click.Option(
        ["--vary"],
        multiple=True,
        metavar="NAME=LOW:HIGH",
        help="vary an option of the cases, or COMPONENT.PARAMETER of the system, in a range, or over a list of texts"
        " NAME=A,B,C (repeatable)",
    ),
    click.Option(
        ["--log"], multiple=True, metavar="NAME", help="vary this parameter on a logarithmic scale (repeatable)"
    ),
    click.Option(
        ["--minimise", "--minimize"], multiple=True, metavar="METRIC", help="minimize this metric (repeatable)"
    ),
    click.Option(
        ["--maximise", "--maximize"], multiple=True, metavar="METRIC", help="maximize this metric (repeatable)"
    ),
    click.Option(
        ["--trials"],
        type=click.IntRange(min=1),
        default=40,
        help="number of trials in total, including those of earlier runs of the same command",
    ),
    click.Option(["--random-seed"], type=click.IntRange(min=0), default=0, help="seed of the search"),
    click.Option(
        ["--gradient"],
        is_flag=True,
        help="follow derivatives of the run (L-BFGS-B, or SLSQP with bounds) from the present values of the parameters;"
        " trials of earlier commands are not used",
    ),
    *(
        click.Option(
            [name],
            multiple=True,
            metavar="METRIC=VALUE",
            help=f"with --gradient: {which} bound of a metric (repeatable)",
        )
        for name, which in (("--at-most", "upper"), ("--at-least", "lower"))
    ),
)


@dataclass(frozen=True)
class PointRuns:
    """Points of a sweep as trials of `cosim.study.optimise.optimise`: values of its axes; numbers are its metrics.

    Args:
        sweep: any of this experiment and these axes.
        store: folder of finished runs.
        executor: that makes them, any of `concurrent.futures`.
        trials: how many points there will be; where they take long, they run in lanes.
    """

    sweep: Sweep
    fmus: FmuSet
    store: Path
    executor: Any = None
    execution: Execution = field(default_factory=Execution)
    trials: int = 0
    in_lanes: list[int] = field(default_factory=list)
    _seconds: list[float] = field(default_factory=list)

    def check(self, names: Sequence[str]) -> None:
        """All were checked when the sweep was prepared; here that they are the same."""
        assert set(names) == {a.name for a in self.sweep.design.axes}

    def identity(self) -> str:
        """Of code, FMUs and the options that do not vary."""
        return f"{dict(sorted(self.sweep.base.items()))!r}|{self.sweep.salt(self.fmus)}"

    def evaluate_batch(self, tried: Sequence[Mapping[str, Any]]) -> list[Row]:
        """Rows of several points; `{"failed": message}` where one has none."""
        columns = [[values[a.name] for values in tried] for a in self.sweep.design.axes]
        pay = self.execution.lanes is None and sum(self._seconds[:1]) * self.trials > LANES_PAY
        since = time.perf_counter()
        table = run_sweep(
            replace(self.sweep, _columns=columns),
            self.fmus,
            self.store,
            executor=self.executor,
            execution=replace(self.execution, lanes="auto") if pay else self.execution,
        )
        self._seconds.append((time.perf_counter() - since) / len(tried))
        self.in_lanes.append(table.in_lanes)
        rows: list[Row] = [{n: float(v[i]) for n, v in table.metrics.items()} for i in range(len(tried))]
        return [{"failed": table.failures[i]} if i in table.failures else row for i, row in enumerate(rows)]


def optimise_command(experiment: Experiment) -> Command:
    """The command that searches."""

    def optimise(**given: Any) -> None:
        for name in ("minimise", "maximise"):
            _once(f"--{name}", given[name])
        objectives = {**dict.fromkeys(given["minimise"], "min"), **dict.fromkeys(given["maximise"], "max")}
        if both := sorted(set(given["minimise"]) & set(given["maximise"])):
            raise DesignError(
                f"{both[0]} cannot be both minimized and maximized: give it to --minimise or to --maximise"
            )
        if not objectives:
            raise DesignError("a search needs an objective: give --minimise METRIC or --maximise METRIC")
        fmus = fmu_set(experiment, given)
        axes = tuple(axis(text) for text in given["vary"])
        prepared = prepare(experiment, fmus, Design(axes, samples=1), case_values(given))
        folder = make_folder(fmus.results(given["out"], experiment.name) / "optimise")
        if given["force"]:
            (folder / TRIALS).unlink(missing_ok=True)
            Store(folder / RUNS).discard()
        space = limits(prepared.design.axes, given["log"])
        if given["gradient"]:
            found = _descend(prepared, fmus, space, objectives, given)
        elif given["at_most"] or given["at_least"]:
            raise DesignError("--at-most and --at-least bound a search along derivatives: add --gradient")
        else:
            found = _search(prepared, fmus, space, objectives, folder, given)
        _write(experiment, found, folder)

    return command(
        experiment,
        optimise,
        "Searches for parameters that minimize or maximize metrics; writes"
        f" results/{experiment.name}/optimise/report.html.",
        {
            "Case": case_options(experiment, beside=SEARCH),
            "Search": SEARCH,
            "FMUs": fmu_options(experiment),
            "How it runs": [*EXECUTION, *MANY_RUNS],
            "Inputs and results": [OUT],
        },
    )


def limits(axes: Sequence[Axis], logarithmic: Sequence[str]) -> dict[str, Limits]:
    """Axes as a space to search.

    Raises:
        DesignError: an axis that is neither a range nor a list of texts, a scale of nothing.
    """
    if unknown := set(logarithmic) - {a.name for a in axes}:
        raise DesignError(f"--log {sorted(unknown)[0]}: this parameter does not vary; add it to --vary")
    found: dict[str, Limits] = {}
    for a in axes:
        if a.kind == "values" and all(isinstance(v, str) for v in a.values):
            found[a.name] = list(a.values)
        elif a.kind == "uniform":
            low, high = (int(x) if a.whole else float(x) for x in a.ends)
            found[a.name] = (low, high, "log") if a.name in logarithmic else (low, high)
        else:
            raise DesignError(f"{a.name}: a search takes a range LOW:HIGH or texts A,B,C, not {a}")
    return found


def _search(
    sweep: Sweep,
    fmus: FmuSet,
    space: Mapping[str, Limits],
    objectives: Mapping[str, str],
    folder: Path,
    given: Mapping[str, Any],
) -> Outcome:
    from cosim.report import write_report  # noqa: F401 - fails where [reports] is missing: before the work, not after
    from cosim.study.optimise import optimise

    count = given["processes"]
    with on(given["dask"], count) as cluster, progress_bar(f"optimise {sweep.experiment.name}") as progress:

        def search(executor: Any) -> Outcome:
            runs = PointRuns(sweep, fmus, folder / RUNS, executor, execution(given), given["trials"])
            found = optimise(
                runs,
                space,
                objectives,
                trials=given["trials"],
                storage=folder / TRIALS,
                seed=given["random_seed"],
                progress=progress,
            )
            tell_lanes(sum(runs.in_lanes))
            return found

        if cluster is not None:
            return search(cluster)
        with local_processes(count or 1) as executor:
            return search(executor)


def _once(option: str, names: Sequence[str]) -> None:
    """Refuse an option that names the same metric twice."""
    if twice := sorted({n for n in names if names.count(n) > 1}):
        raise DesignError(f"{option} {twice[0]} is given twice")


def _bounds(option: str, given: Sequence[str]) -> dict[str, float]:
    """METRIC=VALUE as numbers by name."""
    found: list[tuple[str, float]] = []
    for text in given:
        name, equals, value = text.rpartition("=")
        try:
            bound = float(value) if equals else math.nan
        except ValueError:
            bound = math.nan
        found.append((name, bound))
        if not math.isfinite(bound):
            raise DesignError(f"{text}: a bound is METRIC=VALUE with a number, such as 'car.body.az rms=1.2'")
    _once(option, [name for name, _ in found])
    return dict(found)


def _descend(
    sweep: Sweep, fmus: FmuSet, space: Mapping[str, Limits], objectives: Mapping[str, str], given: Mapping[str, Any]
) -> Outcome:
    from cosim.report import write_report  # noqa: F401 - as in _search
    from cosim.study.descent import descend

    bounds = _bounds("--at-most", given["at_most"]), _bounds("--at-least", given["at_least"])
    if given["dask"]:
        raise DesignError("a search along derivatives makes one run after the other: leave out --dask")
    with (
        PointSlopes(sweep, fmus, execution(given), given["processes"]) as evaluate,
        progress_bar(f"optimise {sweep.experiment.name}") as progress,
    ):
        first = evaluate.present()
        inside = all(float(limits[0]) <= first[n] <= float(limits[1]) for n, limits in space.items())
        found = descend(
            evaluate,
            space,
            objectives,
            trials=given["trials"],
            first=first if inside else None,
            at_most=bounds[0],
            at_least=bounds[1],
            progress=progress,
        )
    console.print(
        f"{evaluate.points} runs with derivatives took the processor time of {evaluate.run_equivalents:.3g} runs"
        f" without ({1e3 * evaluate.run_time:.3g} ms each)"
    )
    for remark in evaluate.remarks:
        console.print(remark)
    return found


def _unit(experiment: Experiment, metric: str) -> str:
    """As the experiment declares it; empty where it does not."""
    declared = experiment.measures.metrics.get(metric)
    return declared.unit if declared is not None and declared.unit and declared.factor == 1 else ""


def _write(experiment: Experiment, found: Outcome, folder: Path) -> None:
    """The page, and what is best on the screen."""
    from cosim.core.content_checks import label_of
    from cosim.report import Report, write_report
    from cosim.report.fronts import front_section
    from cosim.report.model import Section, Table

    failed = [t for t in found.trials if t.failed]
    for trial in failed[:5]:
        console.print(f"failed: trial {trial.number}: {trial.failed}")
    done, names = found.done, list(found.objectives)
    best = found.front  # refuses a search without numbers
    parameters = list(best[0].values)
    rows = [[*(t.row[n] for n in names), *t.values.values()] for t in best]
    sections = []
    if len(names) > 1:
        sections.append(
            front_section(
                "Front",
                {n: label_of(n, _unit(experiment, n)) for n in names},
                found.objectives,
                [t.row for t in done],
                [t.values for t in done],
            )
        )
    every = [[t.number, *(t.row[n] for n in names), *t.values.values()] for t in done]
    text = f"{len(done)} of {len(found.trials)} trials gave numbers; {len(best)} of these " + (
        "are Pareto-optimal." if len(names) > 1 else "is the best."
    )
    sections.append(
        Section("Trials", [text], tables=[Table("trials", "All trials", ["trial", *names, *parameters], every)])
    )
    aims = " and ".join(f"{n} ({'large' if d == 'max' else 'small'})" for n, d in found.objectives.items())
    report = Report(
        f"{experiment.name}-optimise",
        f"Search: {experiment.title or experiment.name}",
        f"Objectives: {aims}.",
        sections=sections,
    )
    for row in rows[:5]:
        said = ", ".join(
            f"{n} {v:.4g}" if isinstance(v, float) else f"{n} {v}"
            for n, v in zip([*names, *parameters], row, strict=True)
        )
        console.print(f"{'front' if len(names) > 1 else 'best'}: {said}")
    if len(rows) > 5:
        console.print(f"and {len(rows) - 5} more Pareto-optimal trials")
    if (log := folder / TRIALS).is_file():
        console.print(f"trials: {log}")
    console.print(f"report: {write_report(report, folder)}")
