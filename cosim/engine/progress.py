"""The progress bar of a run."""

from __future__ import annotations

import time
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress as Bar


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
