"""Runs the tasks of a study on whatever executor it is given; nothing that was finished is ever run again.

Each task's result is stored as it comes. A task that fails is a row with its message and does not end the study; one whose
process dies (an FMU can take it along) is tried once more by itself, so that only the culprit is lost.
"""

from __future__ import annotations

import dataclasses
import os
import shutil
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from pathlib import Path
from typing import Any

from cosim.study import key
from cosim.study.case import values
from cosim.study.experiment import Experiment, Row, Search, Task
from cosim.study.fmus import FmuSet
from cosim.study.loading import load
from cosim.study.processes import local_processes
from cosim.study.results import Results
from cosim.study.runner import Execution, Runner, entry_key
from cosim.study.store import NotStored, RunStore

DIED = "the process that ran it ended without a word, which an FMU that crashes does to it"
Progressed = Callable[[int, int], None]


def run_study(
    experiment: Experiment,
    fmus: FmuSet,
    store: Path,
    *,
    tasks: Iterable[Any] | None = None,
    options: Mapping[str, Any] | None = None,
    executor: Executor | None = None,
    processes: int | None = None,
    retry_failed: bool = False,
    force: bool = False,
    execution: Execution | None = None,
    progress: Progressed = lambda done, total: None,
) -> Results:
    """Run a study; what is in ``store`` already is taken from there.

    Args:
        experiment: what is run.
        fmus: the FMU files.
        store: folder of finished runs.
        tasks: other tasks (or cases) than those of the experiment's plan.
        options: of the plan.
        executor: where tasks run; None: processes on this machine. Its workers see the same files.
        processes: how many, on this machine; None: one per core.
        retry_failed: run again what failed earlier.
        force: discard what is stored and run everything.
        execution: how systems are executed; no part of the key, since the numbers are the same.
        progress: called with (done, total).

    Raises:
        FileNotFoundError: an FMU is missing; nothing was run.
        KeyboardInterrupt: by Ctrl-C; what was finished is stored.
    """
    todo = experiment.tasks(**(options or {})) if tasks is None else experiment.placed(tasks)
    by_part: dict[str, list[Any]] = {}
    for task in todo:
        by_part.setdefault(_part(task), []).append(task)
    for name in by_part:
        fmus.paths(experiment.part(name).fmus)
    if force and store.exists():
        shutil.rmtree(store)
    salts = {name: _salt(experiment.part(name), name, fmus, own) for name, own in by_part.items()}
    kept = {name: RunStore(store, salt) for name, salt in salts.items()}
    entries: dict[int, Row] = {}
    for i, task in enumerate(todo):
        try:
            entry = kept[_part(task)].get(task_key(task))
        except NotStored:
            continue
        if not (retry_failed and "failed" in entry):
            entries[i] = entry
    progress(len(entries), len(todo))
    order = sorted((i for i in range(len(todo)) if i not in entries), key=lambda i: -getattr(todo[i], "cost", 1.0))
    ship = (experiment.module or experiment, fmus, store, salts, execution)
    if order:
        for i, entry in _finished(ship, todo, order, executor, processes):
            entries[i] = kept[_part(todo[i])].put(task_key(todo[i]), entry)
            progress(len(entries), len(todo))
    return Results(todo, (entries[i] for i in range(len(todo))))


def task_key(task: Task | Search) -> Any:
    """Key of a task's entry in a store."""
    if isinstance(task, Task):
        return entry_key(task.case, signals=task.signals)
    return ["search", type(task).__name__, dataclasses.asdict(task)]  # type: ignore[call-overload]


def _part(task: Any) -> str:
    return getattr(task, "part", "")


def _salt(experiment: Experiment, part: str, fmus: FmuSet, tasks: list[Any]) -> str:
    """What all runs of an experiment depend on, or of its part of this name; two parts may be alike in everything else."""
    searches = [t for t in tasks if not isinstance(t, Task)]
    found = key.salt(experiment, fmus, _files(experiment, fmus, tasks), searches)
    return f"{part}|{found}" if part else found


def _files(experiment: Experiment, fmus: FmuSet, tasks: list[Any]) -> list[Path]:
    """FMU files of an experiment that does not name them: those of the systems that it wires."""
    if experiment.fmus:
        return []
    found: set[Path] = set()
    seen = set()
    for case in (t.case for t in tasks if isinstance(t, Task)):
        structure = experiment.structure(case) if experiment.structure else None if experiment.configure else case
        if structure not in seen:
            seen.add(structure)
            with experiment.wire(fmus, case) as system:
                found |= set(system.fmu_files)
    return sorted(found)


def _finished(
    ship: tuple[Any, ...], todo: list[Any], order: list[int], executor: Executor | None, processes: int | None
) -> Iterator[tuple[int, Row]]:
    """(index, entry) of every task as it ends."""
    waiting = deque(order)
    if executor is not None:
        yield from _collect(executor, ship, todo, waiting, at_once=len(order))
        return
    while waiting:
        count = min(processes or os.cpu_count() or 1, len(waiting))
        suspects: list[int] = []
        with local_processes(count) as pool:
            try:
                yield from _collect(pool, ship, todo, waiting, at_once=count + 1)  # one more, so that no worker waits
            except _BrokenError as broken:
                suspects = broken.begun
        for i in suspects:  # each in a process of its own: whose dies is the culprit
            with local_processes(1) as pool:
                try:
                    yield from _collect(pool, ship, todo, deque([i]), at_once=1)
                except _BrokenError:
                    yield i, {"failed": DIED}


class _BrokenError(RuntimeError):
    """Workers died; ``begun`` are the tasks that they had been given and that have no result."""

    def __init__(self, begun: list[int]) -> None:
        super().__init__(
            "the executor's workers died; what was finished is stored, and the same study continues from there"
        )
        self.begun = begun


def _collect(
    pool: Executor, ship: tuple[Any, ...], todo: list[Any], waiting: deque[int], *, at_once: int
) -> Iterator[tuple[int, Row]]:
    """(index, entry) of every task as it ends; takes the next of those waiting when fewer than ``at_once`` are with the workers."""
    begun: dict[Future[Row], int] = {}
    try:
        while waiting or begun:
            while waiting and len(begun) < at_once:
                i = waiting[0]
                begun[pool.submit(work, ship, _shipped(todo[i]))] = i
                waiting.popleft()
            for future in wait(begun, return_when=FIRST_COMPLETED).done:
                entry = future.result()
                yield begun.pop(future), entry
    except BrokenExecutor:
        raise _BrokenError(list(begun.values())) from None
    finally:
        for future in begun:
            future.cancel()


def _shipped(task: Task | Search) -> Any:
    """A task as it goes to another process, where a class of cases made at run time is another one."""
    return (task.part, values(task.case), task.signals) if isinstance(task, Task) else task


_workers = threading.local()  # runners, per thread those of one study: a system runs one simulation at a time


def work(ship: tuple[str | Experiment, FmuSet, Path, Mapping[str, str], Execution | None], task: Any) -> Row:
    """Do one task in a worker, which gets the experiment, FMUs, folder of the store, its salt by part and the execution with it; a
    failure is an entry that says so."""
    place, fmus, store, salts, execution = ship
    try:
        experiment = load(place) if isinstance(place, str) else place
        if isinstance(task, tuple):
            part, given, signals = task
            runner = _runner(experiment, part, fmus, store, salts, execution)
            return runner.entry(runner.experiment.case(**given), signals=signals)
        return {"found": task(_runner(experiment, _part(task), fmus, store, salts, execution))}
    except Exception as error:
        return {"failed": f"{type(error).__name__}: {error}"}


def _runner(
    experiment: Experiment, part: str, fmus: FmuSet, store: Path, salts: Mapping[str, str], execution: Execution | None
) -> Runner:
    study = (experiment.name, experiment.module, fmus, str(store), salts, execution)
    if getattr(_workers, "study", None) != study:
        for runner in getattr(_workers, "runners", {}).values():
            runner.close()
        _workers.study, _workers.runners = study, {}
    runners: dict[str, Runner] = _workers.runners
    if part not in runners:
        runners[part] = Runner(experiment.part(part), fmus, RunStore(store, salts[part]), execution)
    return runners[part]
