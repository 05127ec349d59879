"""Ctrl-C held back until the master stands between two instants, and the progress bar."""

from __future__ import annotations

import signal
import threading
import time
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress as Bar


class HeldInterrupt:
    """Inside the block the first Ctrl-C only sets `pending`; a second one interrupts at once. Does nothing outside the
    main thread, or where the program has a handler of its own."""

    def __init__(self) -> None:
        self.pending = False
        self._old: Any = None

    def __enter__(self) -> HeldInterrupt:
        mine = threading.current_thread() is threading.main_thread()
        if mine and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            self._old = signal.signal(signal.SIGINT, self._hold)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._old is not None:
            signal.signal(signal.SIGINT, self._old)

    def _hold(self, number: int, frame: FrameType | None) -> None:
        if self.pending:
            signal.default_int_handler(number, frame)
        self.pending = True


class ProgressBar:
    """A bar from `begin` to `end` [s], shown once the run has taken longer than `PATIENCE` s of wall time."""

    PATIENCE = 2.0

    def __init__(self, shown: bool, begin: float, end: float):
        self._shown, self._begin, self._end = shown, begin, end
        self._since = time.perf_counter()
        self._bar: Bar | None = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.stop()

    def at(self, now: float) -> None:
        """Move to simulated time `now` [s]."""
        if not self._shown:
            return
        if self._bar is None:
            if time.perf_counter() - self._since < self.PATIENCE:
                return
            from rich.progress import Progress as Bar

            self._bar = Bar(transient=True)
            self._task = self._bar.add_task("simulated time", total=self._end - self._begin)
            self._bar.start()
        text = f"{now:.3g} of {self._end:.3g} s"
        self._bar.update(self._task, completed=now - self._begin, description=text)
