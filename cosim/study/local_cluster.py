"""A Dask cluster on this machine that only the process which started it can use.

Whoever can send a scheduler a task runs code as its owner, and every user of a machine reaches its loopback addresses.
So all connections are encrypted and both ends show the certificate that was made for this cluster; its private key
stays in the memory of its processes. There are no HTTP servers, which would listen without any such proof, and files
lie in a private folder.
"""

from __future__ import annotations

import signal
from contextlib import suppress
from typing import Any

from build_fmus.base import extras
from build_fmus.base.interpreters import forget_safe_path
from build_fmus.base.one_thread import one_thread

with extras.needed("cluster", "a Dask cluster"):
    import dask
    from distributed import Nanny, Scheduler, SpecCluster, Worker

_QUIET = 50  # log level: the command has sentences of its own


class PrivateScheduler(Scheduler):
    """A scheduler without HTTP server."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """None, whatever the dashboard's settings say."""


class PrivateWorker(Worker):
    """A worker without HTTP server."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """None, whatever the dashboard's settings say."""


def run_cluster(theirs: Any, settings: dict[str, Any], security: Any, processes: int | None, folder: str) -> None:
    """The main program of a process with a scheduler and its workers.

    They live until the other end of the pipe is closed, in whichever way. Ctrl-C goes to the process that asked for
    them.
    """
    forget_safe_path()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    one_thread()
    count = processes or dask.system.CPU_COUNT
    reached = {
        "host": "127.0.0.1",
        "protocol": "tls://",
        "security": security,
        "dashboard": False,
        "dashboard_address": None,
    }
    worker = {
        "cls": Nanny,
        "options": {
            **reached,
            "nthreads": 1,
            "memory_limit": 1.0 / count,
            "worker_class": PrivateWorker,
            "silence_logs": _QUIET,
            "env": {"TMPDIR": folder, "TEMP": folder, "TMP": folder},
        },
    }
    try:
        with (
            dask.config.set({**settings, "temporary-directory": folder}),
            SpecCluster(
                workers=dict.fromkeys(range(count), worker),
                scheduler={"cls": PrivateScheduler, "options": {**reached, "port": 0}},
                security=security,
                silence_logs=_QUIET,
            ) as cluster,
        ):
            theirs.send((True, cluster.scheduler_address))
            with suppress(EOFError, OSError):
                theirs.recv()
    except Exception as error:
        with suppress(OSError):
            theirs.send((False, f"{type(error).__name__}: {error}"))
