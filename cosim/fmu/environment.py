"""The floating-point environment, put back after calls into third-party FMUs that run in this process.

An FMU that leaves another rounding mode behind, or flushes subnormal numbers to zero (libraries compiled with
-ffast-math do so when they are loaded), changes the results of all others. `environment.h` says what is looked at.

The same library guards the process against an FMU that calls `exit`: Python would end with exit code 0 and without a
word. `_exit` cannot be noticed in the process that it ends.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import cffi

from build_fmus.base import surface
from build_fmus.compile import CompileError, ObjectCache, find_toolchain, host

HEADER = Path(__file__).with_name("environment.h")
_SOURCE = Path(__file__).with_name("environment.c")
_KINDS = ("the rounding mode", "the treatment of subnormal numbers", "the traps")  # bit by bit
_KEPT: list[Any] = []
_EXITED = (
    "\ncosim: an FMU has ended this process by a call of exit(); its results are incomplete. With {} the message"
    " names the FMU; cosim recover FILE.csv recovers the recorded rows.\n"
)


@lru_cache
def restorer() -> Callable[[], int]:
    """A function that restores the environment of the first call and returns the changes (`what_changed`).

    Without a compiler the C library does it, and the changes are not known.
    """
    ffi = cffi.FFI()
    try:
        ffi.cdef("uint32_t cosim_environment_bits(void); uint32_t cosim_environment_restore(uint32_t before);")
        ffi.cdef("void cosim_guard_exit(const char *text);")
        path = ObjectCache.of_user().library(find_toolchain(host()), [_SOURCE], [HEADER.parent], "environment")
        own = ffi.dlopen(str(path))
        before = own.cosim_environment_bits()
        _guard_exit(ffi, own)
        return lambda: int(own.cosim_environment_restore(before))
    except (CompileError, OSError):
        ffi = cffi.FFI()
        ffi.cdef("int fegetenv(void *to); int fesetenv(const void *from);")
        try:
            library = ffi.dlopen(None)
            kept = ffi.new("char[256]")
            library.fegetenv(kept)
        except (OSError, AttributeError):
            return lambda: 0
        return lambda: int(library.fesetenv(kept)) * 0


def _guard_exit(ffi: cffi.FFI, own: Any) -> None:
    text = ffi.new("char[]", _EXITED.format(surface.hint("isolated=True", "--isolate '*'") or "isolation").encode())
    _KEPT.append((own, text))  # the handler of the library must stay where it is
    own.cosim_guard_exit(text)
    atexit.register(own.cosim_guard_exit, ffi.NULL)


def what_changed(bits: int) -> str:
    """In words."""
    return " and ".join(text for i, text in enumerate(_KINDS) if bits & 1 << i) + " of floating-point arithmetic"
