"""Worker processes on this machine: started afresh, ended with whoever started them, nothing left behind."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import wait as wait_for
from pathlib import Path

from build_fmus import safe_files
from build_fmus.one_thread import one_thread


@contextmanager
def local_processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """An executor of ``count`` processes; when the block ends by an error or Ctrl-C, they end at once.

    Workers are started afresh, not forked: a fork copies locks that a thread of this process (the progress bar's) may hold.
    So a script that comes here needs ``if __name__ == "__main__":``.

    Workers put their temporary files, the FMUs they unpack among them, into one folder that is removed when all have ended,
    in whatever way: they leave by ``_exit`` or by a signal, where nobody cleans up. When this process dies instead, each
    worker ends at once and removes that folder.
    """
    one_thread()
    afresh = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(afresh)
    scratch = tempfile.mkdtemp(prefix="cosim-workers-")
    executor = ProcessPoolExecutor(count, context, initializer=_start_worker, initargs=(scratch,))
    try:
        yield executor
    except BaseException:
        for process in list((executor._processes or {}).values()):
            process.terminate()
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
        shutil.rmtree(scratch, ignore_errors=True)


def _start_worker(scratch: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the parent, which ends the workers
    safe_files.plain_warnings()
    threading.Thread(target=_end_with_parent, args=(scratch,), daemon=True).start()
    tempfile.tempdir = scratch


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
