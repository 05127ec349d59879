"""Run independent tasks on all cores; Ctrl-C keeps what is finished, and nothing is left behind."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from typing import Any

from build_fmus import safe_files


def run_tasks(
    work: Callable[[Any], Any],
    tasks: Iterable[Any],
    *,
    initializer: Callable[..., None] | None = None,
    initargs: tuple[Any, ...] = (),
    processes: int | None = None,
    done: Callable[[Any, Any], None] = lambda task, result: None,
) -> list[Any]:
    """``[work(task) for task in tasks]`` in worker processes, long tasks first if the caller sorts them so.

    ``done(task, result)`` is called in this process as each task finishes. On Ctrl-C the running tasks are abandoned
    and KeyboardInterrupt is raised after every finished result was handed to ``done``.

    Workers are started afresh, not forked: a fork copies locks that a thread of this process (the progress bar's) may hold.
    So a script that comes here needs ``if __name__ == "__main__":``.

    Workers put their temporary files, the FMUs they unpack among them, into one folder that is removed when all have ended,
    in whatever way: they leave by ``_exit`` or by a signal, where nobody cleans up. When this process dies instead, each
    worker ends at once and removes that folder.
    """
    tasks = list(tasks)
    results: list[Any] = [None] * len(tasks)
    count = min(processes or os.cpu_count() or 1, max(len(tasks), 1))
    afresh = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(afresh)
    scratch = tempfile.mkdtemp(prefix="cosim-workers-")
    executor = ProcessPoolExecutor(count, context, initializer=_start_worker, initargs=(scratch, initializer, initargs))
    futures: dict[Future[Any], int] = {}
    try:
        futures = {executor.submit(work, t): i for i, t in enumerate(tasks)}
        pending = set(futures)
        while pending:
            finished, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in finished:
                i = futures[future]
                results[i] = future.result()
                done(tasks[i], results[i])
    except BaseException:
        for future in futures:
            future.cancel()
        for process in list((executor._processes or {}).values()):
            process.terminate()
        executor.shutdown(wait=True, cancel_futures=True)
        raise
    finally:
        executor.shutdown()
        shutil.rmtree(scratch, ignore_errors=True)
    return results


def _start_worker(scratch: str, initializer: Callable[..., None] | None, initargs: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the parent, which ends the workers
    safe_files.plain_warnings()
    threading.Thread(target=_end_with_parent, args=(scratch,), daemon=True).start()
    tempfile.tempdir = scratch
    if initializer is not None:
        initializer(*initargs)


def _end_with_parent(scratch: str) -> None:
    """Wait until the parent has gone, however it went: the system closes its end of a pipe (Windows: signals its handle)."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait_for([parent.sentinel])
    _remove(Path(scratch))
    os._exit(1)


def _remove(scratch: Path) -> None:
    """Several workers do this at once, and one that is still unpacking may put files back: so until all is gone."""
    for _ in range(100):
        shutil.rmtree(scratch, ignore_errors=True)
        if not scratch.exists():
            return
