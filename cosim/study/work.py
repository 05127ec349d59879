"""A worker: it receives runs in chunks, by the values of their cases, and returns results as lines of the store.

Experiment, FMUs and systems stay with a worker from one chunk to the next: a system is wired once and reset for each
run. An FMU that is not there, or not the same, is requested by the hash of its content (`Reply.missing`); it comes with
the chunk that is then given again, and stays in the cache of that machine.
"""

from __future__ import annotations

import hashlib
import os
import platform
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, count, takewhile
from pathlib import Path
from typing import Any

from build_fmus.base import safe_files
from cosim import Execution
from cosim.study.case import values
from cosim.study.experiment import Experiment, Row, Search, Task, beside
from cosim.study.fmus import FmuSet
from cosim.study.lanes import LaneRun, SearchRuns
from cosim.study.loading import load
from cosim.study.runner import HistoryError, Runner
from cosim.study.store import RunStore, Store, pack
from cosim.study.swept import Parameters, load_swept, swept


@dataclass(frozen=True)
class JobContext:
    """What goes with every chunk.

    Attributes:
        experiment: itself, or where it can be imported from.
        fmus: the FMU files, as the study names them.
        hashes: SHA-256 of each by its path.
        store: folder in which a worker looks for runs that others have made, and keeps its own; None: nowhere.
        group: part of the names of its files there.
        salts: of the keys, by part.
        execution: how systems are executed.
        parameters: of the system, that the cases have besides their own fields.
        histories: folder in which a worker writes the recording of each run, by the name of its key; None: nowhere.
    """

    experiment: str | Experiment
    fmus: FmuSet
    hashes: Mapping[str, str]
    store: Path | None
    group: str
    salts: Mapping[str, str]
    execution: Execution | None
    parameters: Parameters = ()
    histories: Path | None = None


@dataclass(frozen=True)
class Reply:
    """What comes back: a line for each run, or hashes of the FMUs without which none could be made.

    `seconds`: wall time of the chunk. `problem`: why the study cannot go on, with the lines of the runs before.
    `in_lanes`: how many of the runs were copies in lanes.
    """

    lines: Sequence[bytes] = ()
    missing: Sequence[str] = ()
    seconds: float = 0.0
    problem: str = ""
    in_lanes: int = 0


TaskSpec = tuple[str, Any]
"""A task as it goes to another process, where a class of cases made at run time is another one: name of its key, and
(part, values of the case, whether signals are kept) or a search.
"""


def history_name(name: str) -> str:
    """File of the recording of a run, by the name of its key."""
    return f"{name}.parquet"


def task_spec(name: str, task: Task | Search) -> TaskSpec:
    """A task as it travels."""
    return name, (task.part, values(task.case), task.signals) if isinstance(task, Task) else task


def work(
    job: JobContext, chunk: Sequence[TaskSpec], contents: Mapping[str, bytes] | None = None, vectors: str = "off"
) -> Reply:
    """Do tasks; a failure is an entry that says so.

    `contents` are FMUs by hash. `vectors`: those in whose lanes runs are made where that is possible; "off": in none.
    """
    since = time.perf_counter()
    try:
        places, missing = _places(job.hashes, contents or {})
    except OSError as error:  # no space for them here
        return Reply(problem=_full(error))
    if missing:
        return Reply(missing=missing)
    fmus = replace(job.fmus, at=places) if places else job.fmus
    try:
        experiment = _experiment(job)
    except Exception as error:
        return Reply([pack(name, _failure(error)) for name, _ in chunk], seconds=time.perf_counter() - since)
    lines: dict[int, bytes] = {}
    searches = _search_runs(job, experiment, fmus, chunk, vectors)
    for runs, numbered in searches:
        lines |= {i: pack(chunk[i][0], {"found": found}) for i, found in runs.results(numbered)}
    in_lanes = sum(runs.in_lanes for runs, _ in searches)
    every: dict[int, LaneRun | None] = dict.fromkeys(range(len(chunk)))
    ahead: Iterator[Mapping[int, LaneRun | None]] = _in_lanes(job, experiment, fmus, chunk, vectors)
    for made in chain(ahead, [every]):
        for i in sorted(made.keys() - lines.keys()):
            name, task = chunk[i]
            try:
                lines[i] = pack(name, _entry(job, experiment, fmus, name, task, made[i]))
            except Exception as error:
                if isinstance(error, HistoryError) or safe_files.is_full(error):
                    problem = str(error) if isinstance(error, HistoryError) else _full(error)
                    return Reply([lines[k] for k in takewhile(lines.__contains__, count())], problem=problem)
                lines[i] = pack(name, _failure(error))
            in_lanes += made[i] is not None
    return Reply([lines[i] for i in range(len(chunk))], seconds=time.perf_counter() - since, in_lanes=in_lanes)


def _in_lanes(
    job: JobContext, experiment: Experiment, fmus: FmuSet, chunk: Sequence[TaskSpec], vectors: str
) -> Iterator[dict[int, LaneRun]]:
    """Those runs of a chunk that are made in lanes, by their number."""
    parts: dict[str, dict[int, Any]] = {}
    for i, (_, task) in enumerate(chunk):
        if vectors != "off" and isinstance(task, tuple):
            part, values, signals = task
            with suppress(Exception):  # the run alone says what is wrong with its case
                case = experiment.part(part).case(**values)
                if _runner(experiment, part, job, fmus).stored(case, signals=signals) is None:
                    parts.setdefault(part, {})[i] = case
    for part, cases in parts.items():
        yield from _runner(experiment, part, job, fmus).in_lanes(cases, vectors)


def _search_runs(
    job: JobContext, experiment: Experiment, fmus: FmuSet, chunk: Sequence[TaskSpec], vectors: str
) -> list[tuple[SearchRuns, dict[int, Search]]]:
    """The searches of a chunk that may be done together, by their number, with their runner."""
    parts: dict[str, dict[int, Search]] = {}
    for i, (_, task) in enumerate(chunk):
        if vectors != "off" and not isinstance(task, tuple) and beside(task):
            parts.setdefault(getattr(task, "part", ""), {})[i] = task
    return [(SearchRuns(_runner(experiment, p, job, fmus), vectors), s) for p, s in parts.items() if len(s) > 1]


def _experiment(job: JobContext) -> Experiment:
    if isinstance(job.experiment, str):
        return load_swept(job.experiment, job.parameters) if job.parameters else load(job.experiment)
    return swept(job.experiment, job.parameters) if job.parameters else job.experiment


def _full(error: Exception) -> str:
    """What ends a study where a worker has no disk space for its files; the run is not the cause."""
    return (
        f"a worker on {platform.node()} cannot write ({type(error).__name__}: {error}); free space in"
        f" {tempfile.gettempdir()} and {safe_files.cache_directory()}"
    )


def _failure(error: Exception) -> Row:
    return {"failed": f"{type(error).__name__}: {error}"}


def _entry(job: JobContext, experiment: Experiment, fmus: FmuSet, name: str, task: Any, made: LaneRun | None) -> Row:
    if isinstance(task, tuple):
        part, case, signals = task
        runner = _runner(experiment, part, job, fmus)
        history = None if job.histories is None else job.histories / history_name(name)
        known = runner.experiment.case(**case) if made is None else made.case
        return runner.entry(known, signals=signals, history=history, made=made)
    return {"found": task(_runner(experiment, getattr(task, "part", ""), job, fmus))}


# ---------------------------------------------------------------------------------------------- FMUs that have traveled


def _places(hashes: Mapping[str, str], contents: Mapping[str, bytes]) -> tuple[dict[str, str], list[str]]:
    """Where the FMUs lie that are not under their own path, and hashes of those that are nowhere."""
    places, missing = {}, []
    for path, digest in hashes.items():
        if _hash(Path(path)) == digest:
            continue
        kept = safe_files.cache_directory() / "fmus" / digest / Path(path).name
        if digest in contents:
            safe_files.write(kept, contents[digest])
        if _hash(kept) == digest:
            places[path] = str(kept)
        else:
            missing.append(digest)
    return places, missing


def _hash(path: Path) -> str:
    """SHA-256 of a file, computed again only when it has changed; "" of one that is not there."""
    try:
        about = path.stat()
        return _hash_of(path, about.st_mtime_ns, about.st_size)
    except OSError:
        return ""


@cache
def _hash_of(path: Path, _changed: int, _size: int) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def hashes(paths: Sequence[Path]) -> dict[str, str]:
    """SHA-256 of FMU files by their path."""
    return {str(p): _hash(p) for p in paths}


# ------------------------------------------------------------------------------------------------------ what stays here

_here = threading.local()  # per thread, since a system runs one simulation at a time


def _runner(experiment: Experiment, part: str, job: JobContext, fmus: FmuSet) -> Runner:
    study = (
        experiment.name,
        experiment.module,
        fmus,
        job.hashes,
        job.salts,
        job.execution,
        job.parameters,
        os.getpid(),
    )
    if getattr(_here, "study", None) != study:
        for runner in getattr(_here, "runners", {}).values():
            runner.close()
        _here.study, _here.runners = study, {}
    runners: dict[str, Runner] = _here.runners
    if part not in runners:
        runners[part] = Runner(experiment.part(part), fmus, execution=job.execution)
    runners[part].store = None if job.store is None else RunStore(_store(job.store, job.group), job.salts[part])
    return runners[part]


def _store(directory: Path, group: str) -> Store:
    """The store of a worker, one for each study."""
    known: Store | None = getattr(_here, "store", None)
    if known is None or known.group != group:
        if known is not None:
            known.close()
        known = _here.store = Store(directory, group)
    return known
