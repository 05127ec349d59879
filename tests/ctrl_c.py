"""Ctrl-C for a run in this process.

It is pressed when a run listens for it, not after some time that a busy machine may need for something else.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LIMIT = 60.0  # s: only ends a test that has failed


@contextmanager
def ctrl_c(ready: Callable[[], bool] = lambda: True, after: float = 0.0) -> Iterator[None]:
    """Inside the block Ctrl-C comes once: `after` seconds after a run holds back interrupts and it is `ready`."""

    def press() -> None:
        end = time.monotonic() + LIMIT
        while time.monotonic() < end and (signal.getsignal(signal.SIGINT) is signal.default_int_handler or not ready()):
            time.sleep(0.005)
        time.sleep(after)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=press)
    thread.start()
    try:
        yield
    finally:
        thread.join()
