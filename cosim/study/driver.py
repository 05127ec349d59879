"""Runs the tasks of a study on whatever executor it is given; nothing that was finished is ever run again.

Each task's result is stored as it comes. A task that fails is a row with its message and does not end the study.
"""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from pathlib import Path
from typing import Any

from cosim import CosimError, Execution
from cosim.study import key
from cosim.study.dispatch import Dispatch, Making
from cosim.study.executors import width
from cosim.study.experiment import Experiment, Search, Task, beside
from cosim.study.fmus import FmuSet
from cosim.study.processes import local_processes
from cosim.study.results import Results
from cosim.study.runner import entry_key
from cosim.study.store import NotStored, RunStore, Store, Stored
from cosim.study.swept import Parameters
from cosim.study.work import JobContext, hashes, task_spec

Arriving = Generator[tuple[int, bytes], None, None]
Progressed = Callable[[int, int], None]


def run_study(
    experiment: Experiment,
    fmus: FmuSet,
    store: Path,
    *,
    tasks: Iterable[Any] | None = None,
    options: Mapping[str, Any] | None = None,
    executor: Executor | Making | None = None,
    processes: int | None = None,
    retry_failed: bool = False,
    force: bool = False,
    execution: Execution | None = None,
    progress: Progressed = lambda done, total: None,
) -> Results:
    """Run a study; what is in `store` already is taken from there.

    Args:
        experiment: what is run.
        fmus: the FMU files.
        store: folder of finished runs.
        tasks: other tasks (or cases) than those of the experiment's plan.
        options: of the plan.
        executor: where tasks run, or a function that gives a context with one, which makes another when it
            breaks; None: processes on this machine. Its workers have this project and the user's file; FMUs go there by
            themselves.
        processes: how many, on this machine; None: one per core.
        retry_failed: run again what failed earlier.
        force: discard what is stored and run everything.
        execution: how systems are executed; of it only the tolerance is part of the key, as it alone changes numbers.
        progress: called with (done, total).

    Raises:
        FileNotFoundError: an FMU is missing; nothing was run.
        ExecutorLostError: the executor can do no more; what was finished is stored.
        OSError: results cannot be written, if the disk is full, for instance; what was finished is stored.
        KeyboardInterrupt: by Ctrl-C; what was finished is stored.
    """
    todo = experiment.tasks(**(options or {})) if tasks is None else experiment.placed(tasks)
    by_part: dict[str, list[Any]] = {}
    for task in todo:
        by_part.setdefault(_part(task), []).append(task)
    for name in by_part:
        fmus.paths(experiment.part(name).wiring.fmus)
    kept = Store(store)
    if force:
        kept.discard()
    tolerance = execution.tolerance if execution else None
    steps = "" if tolerance is None else f"|tolerance {tolerance!r}"
    salts = {name: salt_of(experiment.part(name), name, fmus, own) + steps for name, own in by_part.items()}
    runs = {name: RunStore(kept, salt) for name, salt in salts.items()}
    names = [runs[_part(task)].name(task_key(task)) for task in todo]
    order = [i for i, name in enumerate(names) if not usable(kept, name, failed=not retry_failed)]
    order.sort(key=lambda i: (-getattr(todo[i], "cost", 1.0), beside(todo[i])))
    done = len(todo) - len(order)
    progress(done, len(todo))
    searches = any(not isinstance(todo[i], Task) for i in order)  # alone ask for runs, which others may have made
    job = job_context(experiment, fmus, by_part, salts, execution, store if searches else None)
    dispatch = Dispatch(
        job,
        lambda i: task_spec(names[i], todo[i]),
        lambda i: getattr(todo[i], "cost", 1.0),
        width,
        lambda i: beside(todo[i]),
    )
    for _ in stored(dispatch, kept, order, executor, processes):
        progress(done := done + 1, len(todo))
    return Results(todo, Stored(kept, names), dispatch.in_lanes)


def job_context(
    experiment: Experiment,
    fmus: FmuSet,
    parts: Iterable[str],
    salts: Mapping[str, str],
    execution: Execution | None,
    store: Path | None = None,
    parameters: Parameters = (),
) -> JobContext:
    """What workers need for runs of an experiment and of some of its parts."""
    files = [*(p for name in parts for p in fmus.paths(experiment.part(name).wiring.fmus)), *fmus.own_paths]
    group = f"of{os.getpid()}x{time.time_ns():x}"
    return JobContext(experiment.module or experiment, fmus, hashes(files), store, group, salts, execution, parameters)


def refuse_tolerance(execution: Execution | None) -> None:
    """Raise CosimError if an execution has a tolerance, where runs are stored under keys without it."""
    if execution is not None and execution.tolerance is not None:
        raise CosimError("sweeps and searches run with fixed steps: leave the tolerance out")


def stored(
    dispatch: Dispatch, kept: Store, order: Sequence[int], executor: Executor | Making | None, processes: int | None
) -> Arriving:
    """Do tasks, and yield each with its line as it is stored.

    Without an executor, processes on this machine do them.

    Raises:
        OSError: a result could not be stored; those before are.
    """
    if not order:
        return
    if executor is None:
        found = dispatch.run_with_restarts(
            lambda: local_processes(min(processes or os.cpu_count() or 1, len(order))), order, len(order)
        )
    elif isinstance(executor, Executor):
        found = dispatch.through(executor, order, len(order))
    else:
        found = dispatch.run_with_restarts(executor, order, len(order))
    with closing(found):
        try:
            for i, line in found:
                kept.append([line])
                yield i, line
        except BaseException:
            kept.close()
            raise
    kept.flush()
    if executor is None:
        kept.absorb(dispatch.job.group)


def usable(kept: Store, name: str, *, failed: bool) -> bool:
    """Whether a result is stored, as it was written, and one of a failed run is enough."""
    try:
        text = kept.text(name)
    except NotStored:
        return False
    return failed or not text.startswith('{"failed"')


def task_key(task: Task | Search) -> Any:
    """Key of a task's entry in a store."""
    if isinstance(task, Task):
        return entry_key(task.case, signals=task.signals)
    return ["search", type(task).__name__, dataclasses.asdict(task)]  # type: ignore[call-overload]


def _part(task: Any) -> str:
    return getattr(task, "part", "")


def salt_of(experiment: Experiment, part: str, fmus: FmuSet, tasks: list[Any]) -> str:
    """Data that all runs of an experiment, or of its part of this name, depend on; two parts may agree in all else."""
    searches = [t for t in tasks if not isinstance(t, Task)]
    found = key.salt(experiment, fmus, _files(experiment, fmus, tasks), searches)
    return f"{part}|{found}" if part else found


def _files(experiment: Experiment, fmus: FmuSet, tasks: list[Any]) -> list[Path]:
    """FMU files of an experiment that does not name them: those of the systems that it wires."""
    if experiment.wiring.fmus:
        return []
    found: set[Path] = set()
    seen = set()
    for case in (t.case for t in tasks if isinstance(t, Task)):
        structure = experiment.wiring.shared(case)
        if structure not in seen:
            seen.add(structure)
            with experiment.wiring.wire(fmus, case) as system:
                found |= set(system.fmu_files)
    return sorted(found)
