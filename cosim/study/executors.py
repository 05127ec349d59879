"""Executors by name: `--dask local`, `--dask tcp://host:8786`; and how many workers any executor has.

Any `concurrent.futures.Executor` will do: loky's, `mpi4py.futures.MPIPoolExecutor`, that of a Dask client whose cluster dask-jobqueue started.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from build_fmus import extras
from build_fmus.one_thread import one_thread
from cosim.errors import CosimError

LOCAL = "local"
ANSWER = 10.0  # s, in which a scheduler answers
WORKERS = 60.0  # s, in which it has a worker
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
            f"the scheduler {client.scheduler.address if client.scheduler else ''} does not answer any more ({error}); what was "
            "finished is stored, and the same study continues from there, with any executor"
        ) from None


@contextmanager
def dask(address: str, processes: int | None = None) -> Iterator[Executor]:
    """The executor of a Dask cluster.

    Args:
        address: of its scheduler, ``tcp://host:8786``; or ``local``: a cluster of processes on this machine, which ends with the block.
        processes: how many workers a local one has.

    Raises:
        MissingExtraError: without the extra [cluster].
        ClusterError: the scheduler does not answer, or has no workers.
    """
    with extras.needed("cluster", "a Dask cluster"):
        from distributed import Client, LocalCluster

    import dask as settings

    one_thread()
    with settings.config.set({
        "distributed.scheduler.allowed-failures": 0,  # of our own cluster: who tries again, and how often, is the study's
        "distributed.worker.daemon": False,  # isolated FMUs are processes of the workers
        "distributed.comm.timeouts.connect": f"{ANSWER:g}s",
        "distributed.admin.low-level-log-length": 100,
        "distributed.admin.tick.interval": "500ms",  # of a scheduler in this process, which has better things to do
        "distributed.worker.profile.enabled": False,
    }):  # fmt: skip
        cluster = None
        try:
            if address == LOCAL:
                cluster = LocalCluster(
                    n_workers=processes, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
                )
            try:
                client = Client(cluster or address, timeout=ANSWER, set_as_default=False)
            except (OSError, TimeoutError, ValueError) as error:
                raise ClusterError(
                    f"no Dask scheduler answers at {address} ({error}); `dask scheduler` starts one and prints its address"
                ) from None
            with client:
                try:
                    client.wait_for_workers(1, timeout=WORKERS)
                except TimeoutError:
                    raise ClusterError(
                        f"the Dask scheduler at {address} has no workers; `dask worker {address}` starts one"
                    ) from None
                with client.get_executor(pure=False, retries=0) as executor:
                    yield executor
        finally:
            if cluster is not None:
                cluster.close()
