"""Executors by name: `--dask local`, `--dask tcp://host:8786`; and how many workers any executor has.

Any `concurrent.futures.Executor` will do: loky's, `mpi4py.futures.MPIPoolExecutor`, that of a Dask client whose cluster
dask-jobqueue started.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import re
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from typing import Any

from build_fmus.base import extras, safe_files
from build_fmus.base.interpreters import safe_path
from build_fmus.base.one_thread import one_thread
from cosim.core.errors import CosimError

LOCAL = "local"
ANSWER = 10.0  # s, in which a scheduler answers
PATIENCE = 20.0  # s, that a cluster on this machine may take to end
WORKERS = 60.0  # s, in which it has a worker
_ADDRESS = re.compile(r"((tcp|tls|ws|wss|ucx)://)?(\[[0-9a-fA-F:]+\]|[^\s:/\[\]]+):\d{1,5}")
UNKNOWN = 8  # workers of an executor that does not say


class ClusterError(CosimError, RuntimeError):
    """There is no cluster, or it does not work; the message says where it was looked for and what to do."""


def width(executor: Executor) -> int:
    """How many workers an executor has, now."""
    client: Any = getattr(executor, "_client", None)
    if client is not None:
        with _asked(client):
            return max(1, sum(client.nthreads().values()))
    return int(getattr(executor, "_max_workers", None) or UNKNOWN)


@contextmanager
def _asked(client: Any) -> Iterator[None]:
    try:
        yield
    except (OSError, RuntimeError, TimeoutError) as error:
        raise ClusterError(
            f"the scheduler {client.scheduler.address if client.scheduler else ''} does not answer any more"
            f" ({error}); finished runs are stored, and the same study continues from there, with any executor"
        ) from None


@contextmanager
def _own_cluster(settings: dict[str, Any], security: Any, processes: int | None) -> Iterator[str]:
    """The address of a cluster on this machine that ends with the block, or with this process.

    Its scheduler has a process of its own, so its work for every task does not delay this one.
    """
    from cosim.study.local_cluster import run_cluster

    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    folder = tempfile.mkdtemp(dir=safe_files.scratch())
    process = context.Process(target=run_cluster, args=(theirs, settings, security, processes, folder))
    with safe_path():
        process.start()
    theirs.close()
    try:
        try:
            good, found = ours.recv()
        except EOFError:
            good, found = False, "its process ended"
        if not good:
            raise ClusterError(f"cannot start a Dask cluster on this machine: {found}")
        yield found
    finally:
        ours.close()
        process.join(PATIENCE)
        if process.is_alive():
            process.terminate()
            process.join()
        shutil.rmtree(folder, ignore_errors=True)


def _connected(connect: Callable[[], Any], address: str) -> Any:
    """Return a connected client.

    A thread of its own connects: if a server accepts and then stays silent, the connection would block forever.
    """
    found: list[Any] = []

    def attempt() -> None:
        try:
            found.append(connect())
        except (OSError, TimeoutError, ValueError) as error:
            found.append(error)

    thread = threading.Thread(target=attempt, name="dask client", daemon=True)
    thread.start()
    thread.join(ANSWER + 2)
    answer = found[0] if found else TimeoutError(f"no answer for {ANSWER:g} s")
    if isinstance(answer, Exception):
        raise ClusterError(
            f"no Dask scheduler answers at {address} ({answer}); `dask scheduler` starts one and prints its address"
        ) from None
    return answer


def _tells_something(record: logging.LogRecord) -> bool:
    """Whether a log record of Dask is useful.

    Dask logs the abandoned attempt to reach a lost scheduler as an error with its stack; we have a message for it.
    """
    return not (record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError))


@contextmanager
def dask(address: str, processes: int | None = None) -> Iterator[Executor]:
    """The executor of a Dask cluster.

    Args:
        address: of its scheduler, `tcp://host:8786`; or `local`: a cluster of processes on this machine, which ends
            with the block.
        processes: how many workers a local one has.

    Raises:
        MissingExtraError: without the extra [cluster].
        ClusterError: the address is invalid, the scheduler does not answer, or has no workers.
    """
    if address != LOCAL and not _ADDRESS.fullmatch(address):
        raise ClusterError(
            f"{address!r} is not an address of a Dask scheduler: write tcp://HOST:PORT, as `dask scheduler` prints it,"
            f" or {LOCAL}"
        )
    with extras.needed("cluster", "a Dask cluster"):
        from distributed import Client
        from distributed.security import Security

        if address == LOCAL:
            import cryptography  # noqa: F401 (makes its certificate)

    import dask as configuration

    logging.getLogger("distributed.client").addFilter(_tells_something)
    settings = {
        # of our own cluster: who tries again, and how often, is the study's
        "distributed.scheduler.allowed-failures": 0,
        "distributed.worker.daemon": False,  # isolated FMUs are processes of the workers
        "distributed.comm.timeouts.connect": f"{ANSWER:g}s",
        "distributed.admin.low-level-log-length": 100,
        "distributed.admin.tick.interval": "500ms",
        "distributed.worker.profile.enabled": False,
    }
    one_thread()
    with configuration.config.set(settings), ExitStack() as stack:
        security = None  # that of the user's configuration of Dask
        if address == LOCAL:
            security = Security.temporary()
            address = stack.enter_context(_own_cluster(settings, security, processes))
        with _connected(
            lambda: Client(address, timeout=ANSWER, set_as_default=False, security=security), address
        ) as client:
            try:
                client.wait_for_workers(1, timeout=WORKERS)
            except TimeoutError:
                raise ClusterError(
                    f"the Dask scheduler at {address} has no workers; `dask worker {address}` starts one"
                ) from None
            with client.get_executor(pure=False, retries=0) as executor:
                yield executor
