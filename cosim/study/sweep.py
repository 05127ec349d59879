"""A sweep: many runs of one experiment over a design.

Its table is read from the store, so a hundred thousand runs need no more memory than a hundred.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.base.checks import Array, unknown
from build_fmus.base.sources import code_hash
from cosim import Execution
from cosim.core.errors import WiringError
from cosim.recording.formats import parquet_table, whole_parquet
from cosim.recording.recording import Recording
from cosim.study import swept as sweeping
from cosim.study.case import Field, fields
from cosim.study.design import Design, DesignError, check_no_range, whole
from cosim.study.dispatch import HEAD, Dispatch, Making, failed
from cosim.study.driver import job_context, refuse_tolerance, salt_of, stored, usable
from cosim.study.executors import width
from cosim.study.experiment import Experiment, Task
from cosim.study.fmus import FmuSet
from cosim.study.runner import Runner, entry_key
from cosim.study.store import NotStored, RunStore, Store, write_table
from cosim.study.swept import KINDS, Parameters, attribute, set_parameters, swept
from cosim.study.work import history_name, task_spec

Watch = Callable[[int, int, int], None]
HISTORIES = "histories"  # folder beside the table


@dataclass(frozen=True)
class Sweep:
    """An experiment and a design that fit together: made by `prepare`.

    Attributes:
        experiment: as it was given.
        design: with whole numbers where parameters are such.
        parameters: of the system, among those that vary.
        units: of the axes, by name.
        base: fields of the cases that do not vary.
        case: class of the cases, with the parameters.
        attributes: field of each axis.
    """

    experiment: Experiment
    design: Design
    parameters: Parameters
    units: Mapping[str, str]
    base: Mapping[str, Any]
    case: type
    attributes: tuple[str, ...] = ()
    _columns: list[list[Any]] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._columns[0])

    def point(self, i: int) -> tuple[Any, ...]:
        """Values of the axes of run number i."""
        return tuple(column[i] for column in self._columns)

    def of(self, i: int) -> Any:
        """The case of run number i."""
        return self.case(**{**self.base, **dict(zip(self.attributes, self.point(i), strict=True))})

    def salt(self, fmus: FmuSet) -> str:
        """Data that all runs depend on besides their values.

        The FMUs are those of every system that options of texts, truth values and up to `FEW` whole numbers choose; a
        system that another number chooses is not known.
        """
        own = {f.attribute for f in fields(self.experiment.case)}
        choosing = [k for k, a in enumerate(self.attributes) if a in own and _may_choose(self._columns[k])]
        chosen = dict.fromkeys(zip(*(self._columns[k] for k in choosing), strict=True)) if choosing else {(): None}
        cases = [
            self.experiment.case(**{**self.base, **dict(zip((self.attributes[k] for k in choosing), c, strict=True))})
            for c in chosen
        ]
        code = ["sweep", code_hash([sweeping.__file__]), repr(self.parameters)]
        return "|".join([*code, salt_of(self.experiment, "", fmus, [Task(c) for c in cases])])


FEW = 16  # different whole numbers of an option, up to which they are taken for a choice


def _may_choose(column: Sequence[Any]) -> bool:
    """Whether values of an option may decide which FMUs a system has."""
    types = set(map(type, column))
    return len(set(column)) <= FEW if types == {int} else not types <= {int, float}


def prepare(experiment: Experiment, fmus: FmuSet, design: Design, base: Mapping[str, Any] | None = None) -> Sweep:
    """Check a design against an experiment, before anything runs.

    Args:
        experiment: that is run at every point.
        fmus: its FMUs.
        design: the points.
        base: fields of the cases that do not vary, by attribute.

    Raises:
        DesignError, CaseError, WiringError: a parameter does not exist, or cannot have a value that the design gives
            it.
        FileNotFoundError: an FMU is missing.
    """
    fmus.paths(experiment.wiring.fmus)
    own = {f.name: f for f in fields(experiment.case)} | {f.attribute: f for f in fields(experiment.case)}
    base = dict(base or {})
    for name, value in design.fixed.items():
        if name not in own:
            raise DesignError(unknown("option", name, sorted({f.name for f in own.values()})))
        base[own[name].attribute] = value
    case = experiment.case(**base)
    variables = {}
    with Runner(experiment, fmus) as runner:
        inner = [a for a in design.axes if a.name not in own]
        system = runner.system(case) if inner or not experiment.wiring.fmus else None
        for a in inner:
            variables[a.name] = _variable(system, a.name, own)
        wholes = [n for n, v in variables.items() if v.type == "integer"]
        wholes += [a.name for a in design.axes if a.name in own and own[a.name].type is int]
        design = whole(design, wholes)
        for a in design.axes:
            number = own[a.name].type in (int, float) if a.name in own else variables[a.name].type != "string"
            for value in a.values if a.kind == "values" else a.ends:  # where it has ends
                if number:
                    check_no_range(a.name, value)
                if a.name in own:
                    experiment.case(**{**base, own[a.name].attribute: _fitting(own[a.name], value)})
                else:
                    set_parameters(system, {a.name: value})
    parameters = tuple((n, v.type) for n, v in variables.items())
    made = swept(experiment, parameters)
    attributes = tuple(
        own[a.name].attribute if a.name in own else attribute(list(variables).index(a.name)) for a in design.axes
    )
    units = {a.name: own[a.name].option.unit if a.name in own else variables[a.name].unit_name for a in design.axes}
    columns = design.columns()
    for k, a in enumerate(design.axes):
        if a.name in own and own[a.name].type is float:
            columns[k] = [float(v) if isinstance(v, int) else v for v in columns[k]]
    return Sweep(experiment, design, parameters, units, base, made.case, attributes, columns)


def _fitting(f: Field, value: Any) -> Any:
    return float(value) if f.type is float and isinstance(value, int) and not isinstance(value, bool) else value


def _variable(system: Any, name: str, own: Mapping[str, Field]) -> Any:
    component, dot, variable = name.partition(".")
    if not dot or component not in system.components:
        options = sorted({f.name for f in own.values()})
        what = unknown("component", component, system.components) if dot else unknown("option", name, options)
        raise DesignError(
            f"{name}: {what}; vary an option of the cases, or a parameter of a component as COMPONENT.NAME"
        )
    found = system[component].description.find(variable, component)
    if found.type not in KINDS:
        raise WiringError(f"{name} is of type {found.fmi_type}; numbers, truth values and texts can vary")
    return found


# ------------------------------------------------------------------------------------------------------------- running


@dataclass(frozen=True)
class SweepTable:
    """What a sweep found, by columns.

    Attributes:
        sweep: what was run.
        axes: values by name.
        metrics: numbers (runs,) by name; NaN where a run failed or has none.
        failures: message by number of the run.
        histories: for each run the file of its recording, relative to the table; "" where there is none. Empty where
            none were kept.
        in_lanes: how many of the runs that were made now were copies in lanes.
    """

    sweep: Sweep
    axes: Mapping[str, list[Any]]
    metrics: Mapping[str, Array]
    failures: Mapping[int, str]
    histories: Sequence[str] = ()
    in_lanes: int = 0

    def write(self, path: Path) -> Path:
        """Write a Parquet file: `run`, the axes, the metrics, `failed`, and `history` if these were kept.

        The same results give the same bytes.
        """
        n = len(self.sweep)
        failures = [self.failures.get(i, "") for i in range(n)]
        more = {"history": list(self.histories)} if self.histories else {}
        write_table(path, {"run": np.arange(n), **self.axes, **self.metrics, "failed": failures, **more})
        return path


def history(table: str | Path, run: int) -> Recording:
    """Time histories of a run of a sweep that was made with `--histories`, or `run_sweep(..., histories=True)`.

    Args:
        table: `table.parquet` of the sweep, or the folder that it lies in.
        run: number of the run, its row in the table.

    Returns:
        What the run has recorded.

    Raises:
        DesignError: there is no such run, or nothing was kept of it.
        OSError, ArrowInvalid: there is no such table.
    """
    path = Path(table)
    path = path / "table.parquet" if path.is_dir() else path
    with extras.needed("reports", "reading tables of sweeps"):
        found = parquet_table(path)
    if not 0 <= run < found.num_rows:
        raise DesignError(f"{path} has runs 0 to {found.num_rows - 1}, not {run}")
    name = found["history"][run].as_py() if "history" in found.column_names else ""
    if not name:
        raise DesignError(
            f"{path}: no time histories of run {run} are stored; cosim sweep ... --histories stores them, --run"
            f" {run} repeats the run"
        )
    return Recording.read(path.parent / name)


class RunningStats:
    """Statistics of the metrics of runs as they arrive, without keeping these (Welford 1962).

    Attributes:
        failed: how many have failed.
    """

    def __init__(self) -> None:
        self.failed = 0
        self._found: dict[str, list[float]] = {}  # count, mean, sum of squared deviations, smallest, largest

    def add(self, text: str | bytes) -> None:
        """A stored result."""
        entry = json.loads(text)
        if "failed" in entry:
            self.failed += 1
            return
        for name, value in entry["metrics"].items():
            if not isinstance(value, int | float) or not math.isfinite(value):
                continue
            s = self._found.setdefault(name, [0, 0.0, 0.0, math.inf, -math.inf])
            s[0] += 1
            deviation = value - s[1]
            s[1] += deviation / s[0]
            s[2] += deviation * (value - s[1])
            s[3], s[4] = min(s[3], value), max(s[4], value)

    def rows(self) -> list[tuple[str, int, float, float, float, float]]:
        """For each metric: name, runs, mean, standard deviation (NaN of one run), smallest, largest."""
        return [
            (name, int(n), mean, math.sqrt(m2 / (n - 1)) if n > 1 else math.nan, low, high)
            for name, (n, mean, m2, low, high) in list(self._found.items())
        ]


def run_sweep(
    sweep: Sweep,
    fmus: FmuSet,
    store: Path,
    *,
    executor: Executor | Making | None = None,
    processes: int | None = None,
    retry_failed: bool = False,
    force: bool = False,
    execution: Execution | None = None,
    progress: Watch = lambda done, total, lost: None,
    running_stats: RunningStats | None = None,
    histories: bool = False,
    needed: str = "",
) -> SweepTable:
    """Run a sweep; results that are in `store` already are taken from there.

    Other options and errors are those of `cosim.study.run_study`. Of `progress`, the arguments are (done, total,
    failed). `running_stats` gets each result as it arrives. `histories`: whether each run's recording is kept, as a
    Parquet file in `histories` beside `store`. Workers write it, so on a cluster that folder must be one that they all
    reach. A stored run without one is made again. See `history`. `needed`: a metric; if the first run has none of this
    name, the sweep ends.

    Raises:
        DesignError: a metric has the name of a column, or the one that is needed is not there.
    """
    refuse_tolerance(execution)
    kept = Store(store)
    if force:
        kept.discard()
    salt = sweep.salt(fmus)
    runs = RunStore(kept, salt)
    total = len(sweep)

    def name(i: int) -> str:
        return runs.name(entry_key(sweep.of(i)))

    folder = store.resolve().parent / HISTORIES if histories else None
    if force and folder is not None:
        shutil.rmtree(folder, ignore_errors=True)

    def kept_history(key: str) -> bool:
        return folder is None or whole_parquet(folder / history_name(key))

    seen: set[bytes] = set()  # two points of a design may be the same
    order, lost = [], 0
    for i in range(total):
        key = name(i)
        if (short := bytes.fromhex(key)) in seen:
            continue
        seen.add(short)
        if not usable(kept, key, failed=not retry_failed):
            order.append(i)
            continue
        text = kept.text(key)
        if text.startswith('{"failed"'):
            lost += 1
        elif not kept_history(key):
            order.append(i)
            continue
        if running_stats is not None:
            running_stats.add(text)
    del seen
    done, named = total - len(order), False
    progress(done, total, lost)
    job = replace(
        job_context(sweep.experiment, fmus, [""], {"": salt}, execution, parameters=sweep.parameters), histories=folder
    )
    dispatch = Dispatch(job, lambda i: task_spec(name(i), Task(sweep.of(i))), lambda _: 1.0, width)
    with closing(stored(dispatch, kept, order, executor, processes)) as found:
        for i, line in found:
            if failed(line):
                lost += 1
            elif not named:
                metrics = json.loads(line[HEAD:])["metrics"]
                _check_names(metrics, sweep, i)
                if needed and needed not in metrics:
                    raise DesignError(unknown("metric", needed, metrics))
                named = True
            if running_stats is not None:
                running_stats.add(line[HEAD:])
            progress(done := done + 1, total, lost)
    table = replace(_table(sweep, kept, name), in_lanes=dispatch.in_lanes)
    if folder is None:
        return table
    names = (name(i) for i in range(total))
    return replace(table, histories=[f"{folder.name}/{history_name(n)}" if kept_history(n) else "" for n in names])


def _check_names(metrics: Mapping[str, Any], sweep: Sweep, i: int) -> None:
    """Reject metrics of run number i that have the name of a column of the table.

    A metric may repeat a parameter that varies.

    Raises:
        DesignError: there is one.
    """
    wrong = [n for n in ("run", "failed", "history") if n in metrics]
    numbers = {n: v for n, v in metrics.items() if isinstance(v, int | float) and math.isfinite(v)}
    wrong += [
        a.name
        for a, value in zip(sweep.design.axes, sweep.point(i), strict=True)
        if numbers.get(a.name, value) != value
    ]
    if wrong:
        raise DesignError(
            f"the metric {wrong[0]!r} has the name of a column of the table, but other values; give it another name in"
            " `measure`"
        )


def _table(sweep: Sweep, kept: Store, name: Callable[[int], str]) -> SweepTable:
    total = len(sweep)
    metrics: dict[str, Array] = {}
    failures = {}
    for i in range(total):
        try:
            entry = json.loads(kept.text(name(i)))
        except NotStored:
            entry = {"failed": "its stored result is damaged; run it again"}
        if "failed" in entry:
            failures[i] = entry["failed"]
            continue
        _check_names(entry["metrics"], sweep, i)
        for key, value in entry["metrics"].items():
            if isinstance(value, int | float):
                if key not in metrics:
                    metrics[key] = np.full(total, math.nan)
                metrics[key][i] = value
    axes = {a.name: column for a, column in zip(sweep.design.axes, sweep._columns, strict=True)}
    return SweepTable(sweep, axes, metrics, failures)
