"""Ctrl-C: held back until the master stands between two instants, and the end of what does not come back.

Python looks for signals between its own instructions: while an FMU is at work, or hangs, no handler of Python runs. So
a thread waits for them too. After a second Ctrl-C it gives those of `CANCELLERS` a chance, who let go of what they wait
for, and ends the process when the first one was a second ago and the FMU still has not come back: what was recorded is
in the spool.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

PATIENCE = 1.0  # s from the second Ctrl-C to the end of a process that does not come back
CANCELLERS: list[Callable[[bool], None]] = []  # called with True after a second Ctrl-C, with False when all is over


class HeldInterrupt:
    """Inside the block the first Ctrl-C only sets `pending`.

    A second one interrupts at once, and ends the process if that does not help. Does nothing outside the main thread,
    or if the program has a handler of its own.
    """

    def __init__(self) -> None:
        self.pending = False
        self._old: Any = None
        self._watched = False

    def __enter__(self) -> HeldInterrupt:
        mine = threading.current_thread() is threading.main_thread()
        if mine and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            self._old = signal.signal(signal.SIGINT, self._hold)
            self._watched = _Watcher.of_this_process().begin()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._old is not None:
            signal.signal(signal.SIGINT, self._old)
        if self._watched:
            _Watcher.of_this_process().end()

    def _hold(self, number: int, frame: FrameType | None) -> None:
        if self.pending:
            signal.default_int_handler(number, frame)
        self.pending = True


@contextmanager
def held() -> Iterator[None]:
    """Delay KeyboardInterrupt until the block is done, for code that cannot stop in between.

    Otherwise as `HeldInterrupt`. Within a `HeldInterrupt` the outer one decides.
    """
    with HeldInterrupt() as interrupt:
        yield
    if interrupt.pending:
        raise KeyboardInterrupt


class _Watcher:
    """The thread that hears signals while an FMU is at work; one per process."""

    _one: _Watcher | None = None

    def __init__(self) -> None:
        self._process = os.getpid()
        self._hears, self._told = socket.socketpair()
        self._told.setblocking(False)
        self._round = 0  # which run it is; odd: one is going on
        self._cancelled = False
        threading.Thread(target=self._listen, name="Ctrl-C", daemon=True).start()

    @classmethod
    def of_this_process(cls) -> _Watcher:
        if cls._one is None or cls._one._process != os.getpid():  # a thread does not survive a fork
            cls._one = cls()
        return cls._one

    def begin(self) -> bool:
        """A run begins; whether signals can be heard: another part of the program may have asked for them."""
        before = signal.set_wakeup_fd(self._told.fileno(), warn_on_full_buffer=False)
        if before != -1:
            signal.set_wakeup_fd(before, warn_on_full_buffer=False)
            return False
        self._round += 1
        return True

    def end(self) -> None:
        self._round += 1
        signal.set_wakeup_fd(-1)
        if self._cancelled:
            self._cancelled = False
            _tell(False)

    def _listen(self) -> None:
        heard = (0, 0)  # the run, and how often during it
        while numbers := self._hears.recv(64):
            now = self._round
            count = numbers.count(signal.SIGINT) + (heard[1] if heard[0] == now else 0)
            heard = (now, count)
            if count >= 2 and now % 2 and not self._cancelled:
                self._cancelled = True
                _tell(True)
                threading.Thread(target=self._insist, args=(now,), daemon=True).start()

    def _insist(self, now: int) -> None:
        time.sleep(PATIENCE)
        if self._round == now:
            sys.stderr.write(
                "\na component does not come back; the process ends. `cosim recover FILE.csv.part` makes a CSV of what"
                " was recorded\n"
            )
            sys.stderr.flush()
            os._exit(128 + signal.SIGINT)


def _tell(cancelled: bool) -> None:
    for tell in CANCELLERS:
        tell(cancelled)
