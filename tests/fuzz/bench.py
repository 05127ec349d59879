"""One case: it must end in a sentence or in a working result, within a time and 300 MB."""

from __future__ import annotations

import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, ModuleType

LONGEST = 5.0  # s of processor time of a case, on the machine of who searches
HANGS = 60.0  # s, what fails a test: how fast a case ends is the machine's
MOST = 300.0  # MB, of the whole process
WORDIEST = 2500  # characters of a line of a message


class TooLongError(BaseException):
    """The time is over; nothing that a target catches."""


def seeded(target: str, seed: int, number: int) -> random.Random:
    """The source of the choices of one case; the same on every machine."""
    return random.Random(f"{target} {seed} {number}")


def failure(module: ModuleType, case: bytes, longest: float = LONGEST) -> str | None:
    """What is wrong with how a case ends, or None; it may take `longest` seconds of processor time."""
    begin = time.process_time()
    try:
        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, warnings.catch_warnings(), _alarm(longest):
            warnings.simplefilter("ignore")
            module.run(case, Path(folder))
    except module.ALLOWED as error:
        if problem := _no_sentence(str(error)):
            return f"{type(error).__name__}: {problem}: {str(error)[:300]!r}"
    except (Exception, TooLongError):
        return traceback.format_exc()
    took = time.process_time() - begin
    if took > longest:
        return f"it took {took:.1f} s; {longest:g} s are allowed"
    if memory() > MOST:
        return f"{memory():.0f} MB of memory were used; {MOST:g} MB are allowed"
    return None


def memory() -> float:
    """The most memory that this program has had [MB].

    What `getrusage` tells goes on counting from the process that started it, which may be large: the tests' own.
    """
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    return int(status.split("VmHWM:")[1].split()[0]) / 2**10


def _no_sentence(text: str) -> str:
    """What is wrong with a message; an empty text if nothing is."""
    lines = text.split("\n")
    if not text.strip():
        return "a message without words"
    if not all(line.isprintable() for line in lines):
        return "a message with signs that steer a terminal"
    if max(map(len, lines)) > WORDIEST:
        return f"a message of {len(text)} characters"
    return ""


@contextmanager
def _alarm(longest: float) -> Iterator[None]:
    """TooLongError in the block when the time is over; what runs in C is only stopped when it returns."""

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise TooLongError(f"more than {longest:g} s")

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, longest + 0.5)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
