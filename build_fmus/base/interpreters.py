"""Python processes of this project import nothing from the working folder, whatever files lie there.

A file `signal.py` or `numpy.py` in it would otherwise be executed by every process that Python starts with `-c`
or `-m`, those of `multiprocessing` among them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PYTHON = (sys.executable, "-P")
"""Beginning of the command of a Python process."""
_ROOT = str(Path(__file__).parents[2])


def environment() -> dict[str, str]:
    """Variables of a process that imports this project from where it is."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [_ROOT, os.environ.get("PYTHONPATH")]))}


_VARIABLE, _OURS = "PYTHONSAFEPATH", "set by suspension-fmus"


@contextmanager
def safe_path() -> Iterator[None]:
    """In the block `multiprocessing` starts processes that begin as with `-P`.

    They get the import path of this one afterwards, with the folder of its script.
    """
    previous = os.environ.setdefault(_VARIABLE, _OURS)
    try:
        yield
    finally:
        if previous == _OURS:
            forget_safe_path()


def forget_safe_path() -> None:
    """In such a process: programs that a user's code starts there find their own folder."""
    if os.environ.get(_VARIABLE) == _OURS:
        del os.environ[_VARIABLE]
