"""Runs go to an executor in chunks, and come back in the order in which they end, whatever happens to the workers.

Chunks last about `CHUNK` s, those of a cluster `CLUSTER` s, so what a chunk costs is shared by its runs; long runs go
alone. What is lost with a worker is run again, run by run, and where a worker may hold several (Dask's do) in the end
one at a time, so that only the culprit is lost. It is tried `TRIES` times at least and then recorded as failed, with
the reason.
"""

from __future__ import annotations

import hashlib
import queue
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from cosim.core.errors import CosimError
from cosim.study.lanes import LANES_PAY, TOGETHER
from cosim.study.processes import NoWorkerError, WorkerDiedError
from cosim.study.store import pack
from cosim.study.work import JobContext, Reply, TaskSpec, work

CHUNK = 0.2  # s
CLUSTER = 1.0  # s, of executors whose tasks cost client and scheduler about 7 ms (Dask)
LARGEST = 500  # runs of a chunk
TRIES = 2
HEAD = 32 + 1 + 64 + 1  # of a line: name and hash
FEWEST, PROBE = 8, 2  # runs of a chunk in lanes, and of one that shows whether there are any
MAX_START_FAILURES = 8  # chunks that nobody could begin, and none that anybody could
DIED = "its worker process ended without a message, for example because an FMU crashed"
LOST = (
    "the executor's workers, or their scheduler, ended; finished runs are stored, and the same study continues from"
    " there"
)
Results = Generator[tuple[int, bytes], None, None]
Making = Callable[[], AbstractContextManager[Executor]]


class ExecutorLostError(CosimError, RuntimeError):
    """The executor can do no more, or nothing of what it is given."""


class Dispatch:
    """Tasks of one study on their way.

    Args:
        job: what goes with every chunk.
        task_spec: a task by its number, as it travels.
        cost: its rough relative time.
        width: how many workers an executor has.
        beside: the group of a task, "" for none; a chunk holds tasks of one group, if runs are made in lanes.
    """

    def __init__(
        self,
        job: JobContext,
        task_spec: Callable[[int], TaskSpec],
        cost: Callable[[int], float],
        width: Callable[[Executor], int],
        beside: Callable[[int], str] = lambda _: "",
    ) -> None:
        self.job, self.task_spec, self.cost, self.width, self.beside = job, task_spec, cost, width, beside
        self.in_lanes = 0
        """How many runs so far were copies in lanes."""
        self._vectors = (job.execution and job.execution.lanes) or ""  # "": not decided
        self._fewest = 1 if self._vectors in ("", "off") else FEWEST
        self._pace: float | None = None  # s per cost
        self._chunk = CHUNK
        self._tries: dict[int, int] = {}
        self._began = False  # whether any worker has given anything back
        self._unbegun = 0

    def through(self, executor: Executor, order: Iterable[int], left: int) -> Results:
        """(number, line) of every task as it ends; `left`: how many there are.

        Raises:
            ExecutorLostError: it is broken.
        """
        lost = yield from self._run(executor, TaskQueue(order, left), careful=False)
        if lost is not None:
            raise ExecutorLostError(LOST)

    def run_with_restarts(self, make: Making, order: Iterable[int], left: int) -> Results:
        """The same with executors that are made again when one breaks."""
        waiting = TaskQueue(order, left)
        lost: list[int] | None = []
        while lost is not None:
            with make() as executor:
                if lost:  # one at a time: the one that breaks the executor is the culprit
                    suspects = TaskQueue(lost, len(lost))
                    again = yield from self._run(executor, suspects, careful=True)
                    if again is not None:
                        lost = [*again, *suspects]
                        continue
                lost = yield from self._run(executor, waiting, careful=False)

    def _run(self, executor: Executor, waiting: TaskQueue, *, careful: bool) -> Any:
        """Generator of results; its value is what was lost when the executor broke, or None."""
        done: queue.SimpleQueue[Future[Reply]] = queue.SimpleQueue()
        held: dict[Future[Reply], list[int]] = {}
        alone: deque[int] = deque()
        suspects: deque[int] = deque()  # lost alone, but perhaps with a worker that others had brought down
        exact = careful or getattr(executor, "loses_only_its_own", False)
        self._chunk = CHUNK if getattr(executor, "loses_only_its_own", False) else CLUSTER
        workers, looked = 1 if careful else self.width(executor), time.monotonic()
        most = 1 if careful else 2 * workers

        def submit(chunk: list[int], contents: dict[str, bytes] | None = None) -> None:
            try:
                future = executor.submit(
                    work, self.job, [self.task_spec(i) for i in chunk], contents, self._vectors or "off"
                )
            except BaseException:
                alone.extendleft(reversed(chunk))
                raise
            held[future] = chunk
            future.add_done_callback(done.put)

        try:
            while True:
                while len(held) < most and (chunk := self._next(alone, waiting, workers, single=careful)):
                    submit(chunk)
                apart = not held and bool(suspects)  # nothing else is on its way
                if apart:
                    submit([suspects.popleft()])
                if not held:
                    return None
                future = _wait(done)
                chunk = held.pop(future)
                try:
                    reply = future.result()
                except (BrokenExecutor, CancelledError):
                    held[future] = chunk
                    raise
                except NoWorkerError as error:
                    raise ExecutorLostError(str(error)) from None
                except Exception as error:
                    yield from self._lost(chunk, error, alone, None if exact or apart else suspects)
                    continue
                self._began = True
                if reply.missing:
                    submit(chunk, self._contents(reply.missing))
                    continue
                if reply.problem:
                    yield from zip(chunk, reply.lines, strict=False)
                    raise OSError(reply.problem)
                self._measure(chunk, reply, waiting.left)
                yield from zip(chunk, reply.lines, strict=True)
                if not careful and time.monotonic() - looked > 1:  # clusters grow and shrink
                    workers, looked = self.width(executor), time.monotonic()
                    most = 2 * workers
        except (BrokenExecutor, CancelledError) as error:
            lost = [i for chunk in held.values() for i in chunk]
            held.clear()
            if careful and lost:
                yield from self._lost(lost, error, alone, None)
            return [*alone, *suspects, *([] if careful else lost)]
        finally:
            for future in held:
                future.cancel()

    def _next(self, alone: deque[int], waiting: TaskQueue, workers: int, *, single: bool) -> list[int]:
        """Numbers of the next chunk; none when there is nothing to do."""
        if alone:
            return [alone.popleft()]
        chunk: list[int] = []
        first = waiting.peek()
        if first is not None and (alike := self.beside(first)) and self._vectors not in ("", "off") and not single:
            while len(chunk) < TOGETHER and (i := waiting.peek()) is not None and self.beside(i) == alike:
                chunk.append(waiting.take())
            return chunk
        most = 1 if self._pace is None or single else min(LARGEST, max(1, waiting.left // (3 * workers)))
        fewest = 1 if single else min(self._fewest, -(-waiting.left // workers))
        cost = 0.0
        while len(chunk) < max(most, fewest) and (i := waiting.peek()) is not None:
            cost += self.cost(i)
            if len(chunk) >= fewest and cost * (self._pace or 0.0) > self._chunk:
                break
            chunk.append(waiting.take())
        return chunk

    def _measure(self, chunk: list[int], reply: Reply, left: int) -> None:
        pace = reply.seconds / max(sum(map(self.cost, chunk)), 1e-9)
        self._pace = pace if self._pace is None else 0.5 * (self._pace + pace)
        self.in_lanes += reply.in_lanes
        if not self._vectors and reply.seconds / len(chunk) * left > LANES_PAY:
            self._vectors, self._fewest = "auto", PROBE
        elif len(chunk) > 1 and self._fewest > 1:  # chunks of long runs are long
            self._fewest = FEWEST if reply.in_lanes else 1

    def _lost(
        self, chunk: list[int], error: BaseException, alone: deque[int], suspects: deque[int] | None
    ) -> Iterator[tuple[int, bytes]]:
        """Decide about a chunk that has no result: run its tasks again, or record them as failed.

        `suspects`: queue for tasks whose worker may have died for another reason; None if there can be none.
        """
        died = isinstance(error, WorkerDiedError | BrokenExecutor) or type(error).__name__ == "KilledWorker"  # of Dask
        if not died:
            self._unbegun += 1
            if not self._began and self._unbegun >= MAX_START_FAILURES:
                raise ExecutorLostError(
                    f"no worker could run a task: {type(error).__name__}: {error}; is this project installed there?"
                )
        for i in chunk:
            self._tries[i] = self._tries.get(i, 0) + 1
            if len(chunk) == 1 and suspects is not None:
                suspects.append(i)
            elif len(chunk) == 1 and self._tries[i] >= TRIES:
                reason = DIED if died else f"its worker gave no result: {type(error).__name__}: {error}"
                yield i, pack(self.task_spec(i)[0], {"failed": reason})
            else:
                alone.append(i)

    def _contents(self, missing: Iterable[str]) -> dict[str, bytes]:
        """FMUs by hash, for a worker that has none of them."""
        paths = {digest: path for path, digest in self.job.hashes.items()}
        found = {}
        for digest in missing:
            data = Path(paths[digest]).read_bytes()
            if hashlib.sha256(data).hexdigest() != digest:
                raise CosimError(f"{paths[digest]} changed during the study: start the study again")
            found[digest] = data
        return found


def failed(line: bytes) -> bool:
    """Whether a line is that of a run that failed."""
    return line.startswith(b'{"failed"', HEAD)


class TaskQueue:
    """Numbers of tasks in the order in which they are begun, one of which can be looked at."""

    def __init__(self, numbers: Iterable[int], left: int) -> None:
        self._numbers = iter(numbers)
        self._next: int | None = None
        self.left = left

    def peek(self) -> int | None:
        """Number of the next task, without taking it; None if the queue is empty."""
        if self._next is None:
            self._next = next(self._numbers, None)
        return self._next

    def take(self) -> int:
        """Take the next task and return its number."""
        found = self.peek()
        assert found is not None
        self._next = None
        self.left -= 1
        return found

    def __iter__(self) -> Iterator[int]:
        while self.peek() is not None:
            yield self.take()


def _wait(done: queue.SimpleQueue[Future[Reply]]) -> Future[Reply]:
    """The next future that ends; Ctrl-C gets through on every system."""
    while True:
        try:
            return done.get(timeout=0.5)
        except queue.Empty:
            continue
