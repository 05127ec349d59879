"""Worker processes on this machine: started afresh, ended with whoever started them, nothing left behind."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import queue
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from typing import Any

from build_fmus.base import safe_files, surface
from build_fmus.base.interpreters import forget_safe_path, safe_path
from build_fmus.base.one_thread import one_thread

PATIENCE = 5.0  # s, that a worker which was told to end may take
GUARD = 'a script must run its study below `if __name__ == "__main__":`, because worker processes import the script'


class WorkerDiedError(RuntimeError):
    """The process that had a task has ended; others are not concerned."""


class NoWorkerError(RuntimeError):
    """A process cannot be started, or ends before it could take a task: the task is not the cause."""


@contextmanager
def local_processes(count: int) -> Iterator[Executor]:
    """An executor of `count` processes; when the block ends by an error or Ctrl-C, they end at once.

    A process that dies costs the task that it had, whose future raises `WorkerDiedError`, and is replaced. Where
    none can be started the future raises `NoWorkerError`.

    Workers are started afresh, not forked: a fork copies locks that a thread of this process (the progress bar's) may
    hold. So a script that comes here needs `if __name__ == "__main__":`. Where the system has it they come from a
    server process without threads that has loaded what they need, so that one that is replaced is back in no time.

    Workers put their temporary files, the FMUs they unpack among them, into one folder that is removed when all have
    ended, in whatever way: they leave by `_exit` or by a signal, where nobody cleans up. When this process dies
    instead, each worker ends at once and removes all temporary files of this process.
    """
    one_thread()
    afresh = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(afresh)
    # the first makes `cosim` ours, beside another one
    context.set_forkserver_preload(["suspension_fmus", "cosim.study.work"])
    scratch = tempfile.mkdtemp(dir=safe_files.scratch())
    executor = _Processes(count, context, scratch)
    try:
        yield executor
    except BaseException:
        executor.terminate()
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
        shutil.rmtree(scratch, ignore_errors=True)


class _Processes(Executor):
    """Worker processes, each served by a thread of this process.

    The thread gives its worker tasks, one at a time, and waits for the result.
    """

    loses_only_its_own = True  # with a worker, the task that it had

    def __init__(self, count: int, context: Any, scratch: str) -> None:
        self._max_workers = count
        self._context, self._scratch = context, scratch
        self._tasks: queue.SimpleQueue[tuple[Future[Any], bytes] | None] = queue.SimpleQueue()
        self._processes: dict[int, Any] = {}
        self._starting = threading.Lock()
        self._ended = False
        self._threads = [threading.Thread(target=self._serve, args=(i,), daemon=True) for i in range(count)]
        for thread in self._threads:
            thread.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        if self._ended:
            raise RuntimeError("these workers have ended")
        future: Future[Any] = Future()
        try:
            self._tasks.put((future, pickle.dumps((fn, args, kwargs))))
        except Exception as error:  # of the pickling: as other executors do
            future.set_exception(error)
        return future

    def _serve(self, number: int) -> None:
        ours: Any = None
        while (task := self._tasks.get()) is not None:
            future, data = task
            if not future.set_running_or_notify_cancel():
                continue
            try:
                ours = ours or self._start(number)
                ours.send_bytes(data)
                sentinel = self._processes[number].sentinel
                while ours not in (ready := wait_for([ours, sentinel])):
                    if sentinel in ready and not ours.poll():
                        raise EOFError
                good, found = pickle.loads(ours.recv_bytes())
            except (EOFError, OSError):
                future.set_exception(WorkerDiedError("a worker has ended"))
                self._end(number)
                ours = None
            except BaseException as error:
                future.set_exception(error)
            else:
                (future.set_result if good else future.set_exception)(found)
        if ours is not None:
            ours.close()
            self._end(number)

    def _start(self, number: int) -> Any:
        with self._starting:
            if self._ended:
                raise EOFError
            ours, theirs = self._context.Pipe()
            process = self._context.Process(target=_work, args=(theirs, self._scratch, surface.command_options()))
            try:
                with safe_path():
                    process.start()
            except Exception as error:
                ours.close()
                theirs.close()
                remedy = (
                    "end other processes, or raise the limit (ulimit -u)"
                    if isinstance(error, BlockingIOError)
                    else GUARD
                )
                raise NoWorkerError(f"a worker process cannot be started ({type(error).__name__}); {remedy}") from error
            theirs.close()
            self._processes[number] = process
        try:
            ours.recv_bytes()
        except (EOFError, OSError):
            ours.close()
            self._end(number)
            if self._ended:
                raise EOFError from None
            raise NoWorkerError(f"a worker process ended during its start; {GUARD}") from None
        return ours

    def _end(self, number: int) -> None:
        process = self._processes.pop(number, None)
        if process is not None:
            process.join(PATIENCE)
            if process.is_alive():
                process.kill()
                process.join()

    def terminate(self) -> None:
        """End all workers in the middle of what they do."""
        with self._starting:
            self._ended = True
        for process in list(self._processes.values()):
            process.terminate()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._ended = True
        if cancel_futures:
            with suppress(queue.Empty):
                while (task := self._tasks.get_nowait()) is not None:
                    task[0].cancel()
        for _ in self._threads:
            self._tasks.put(None)
        if wait:
            for thread in self._threads:
                thread.join()


def _work(theirs: Any, scratch: str, options: Collection[str] | None) -> None:
    """A worker's main program: tasks until the other end is closed. `options`: of the command that started it."""
    _start_worker(scratch)
    surface.set_command_options(options)
    theirs.send_bytes(b"ready")
    while True:
        try:
            data = theirs.recv_bytes()
        except (EOFError, OSError):
            return
        try:
            fn, args, kwargs = pickle.loads(data)
            found: tuple[bool, Any] = True, fn(*args, **kwargs)
        except Exception as error:
            found = False, error
        try:
            data = pickle.dumps(found)
        except Exception as error:
            data = pickle.dumps(
                (False, RuntimeError(f"the result cannot be sent to the main process: {error}; it is {found[1]!r}"))
            )
        theirs.send_bytes(data)


def _start_worker(scratch: str) -> None:
    forget_safe_path()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the parent, which ends the workers
    safe_files.plain_warnings()
    threading.Thread(target=_end_with_parent, args=(scratch,), daemon=True).start()
    tempfile.tempdir = scratch


def _end_with_parent(scratch: str) -> None:
    """Wait until the parent has ended in any way: the system closes its end of a pipe (Windows: signals its handle)."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait_for([parent.sentinel])
    _remove(Path(scratch).parent)
    os._exit(1)


def _remove(scratch: Path) -> None:
    """Several workers do this at once, and one that is still unpacking may put files back: so until all is gone."""
    for _ in range(100):
        shutil.rmtree(scratch, ignore_errors=True)
        if not scratch.exists():
            return
