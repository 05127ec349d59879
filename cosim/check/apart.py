"""Runs a check in a process of its own, for FMUs that can be instantiated only once per process.

That is FMI 2.0, 4.3.1, and FMI 3.0, 2.3.1. The process of the check never loads such a library; each instance gets a
fork of it, which ends when the instance is freed. Answers of a fork are trusted as little as those of the process of
the check: both run code of the FMU.
"""

from __future__ import annotations

import io
import os
import pickle
import signal
import traceback
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from cosim.check.calls import Ended, Refused
from cosim.check.model import Var
from cosim.check.rules import NotApplicable, require

T = TypeVar("T")


def run_apart(work: Callable[[], T], variables: Sequence[Var]) -> T:
    """The result of `work` in a fork, or the exception that it raised. Ends as the fork does where that is lost."""
    require(hasattr(os, "fork"), "it can be instantiated only once per process, and processes cannot be forked here")
    readable, writable = os.pipe()
    pid = os.fork()
    if pid == 0:
        code = 70
        try:
            os.close(readable)
            answer = _answer(work)
            with os.fdopen(writable, "wb") as stream:
                _Pickler(stream, variables).dump(answer)
            code = 0
        finally:
            os._exit(code)
    os.close(writable)
    with os.fdopen(readable, "rb") as stream:
        data = stream.read()
    _, status = os.waitpid(pid, 0)
    code = os.waitstatus_to_exitcode(status)
    if code or not data:
        _end_alike(code)
    result, error = _Unpickler(io.BytesIO(data), variables).load()
    if error is not None:
        raise error
    return result  # type: ignore[no-any-return]


def _answer(work: Callable[[], Any]) -> tuple[Any, Exception | None]:
    try:
        return work(), None
    except (Refused, Ended, NotApplicable, OSError) as error:
        return None, error
    except Exception:  # a mistake of a check keeps its traceback
        return None, RuntimeError(traceback.format_exc())


def _end_alike(code: int) -> None:
    """End this process as a fork ended, so that the other end of its pipe hears of it."""
    if code < 0:
        signal.signal(-code, signal.SIG_DFL) if -code not in (signal.SIGKILL, signal.SIGSTOP) else None
        os.kill(os.getpid(), -code)
    os._exit(max(code, 0))


class _Pickler(pickle.Pickler):
    """Variables by their position: they are compared by identity."""

    def __init__(self, stream: Any, variables: Sequence[Var]):
        super().__init__(stream)
        self._positions = {id(v): i for i, v in enumerate(variables)}

    def persistent_id(self, thing: Any) -> int | None:
        return self._positions[id(thing)] if isinstance(thing, Var) else None


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream: Any, variables: Sequence[Var]):
        super().__init__(stream)
        self._variables = variables

    def persistent_load(self, position: int) -> Var:
        return self._variables[position]
