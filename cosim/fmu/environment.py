"""The floating-point environment, put back after calls into FMUs of others that run in this process.

An FMU that leaves another rounding mode behind, or flushes subnormal numbers to zero (libraries compiled with -ffast-math do so when
they are loaded), changes the results of all others. `environment.h` says what is looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import cffi

from build_fmus.compile import CompileError, ObjectCache, find_toolchain, host

HEADER = Path(__file__).with_name("environment.h")
_SOURCE = Path(__file__).with_name("environment.c")
_KINDS = ("the rounding mode", "the treatment of subnormal numbers", "the traps")  # bit by bit


@lru_cache
def restorer() -> Callable[[], int]:
    """A function that puts the environment back to what it was when this was called first, and returns what had changed (`what_changed`).

    Where nothing can be compiled the C library does it, and then nobody knows what had changed.
    """
    ffi = cffi.FFI()
    try:
        ffi.cdef("uint32_t cosim_environment_bits(void); uint32_t cosim_environment_restore(uint32_t before);")
        path = ObjectCache.of_user("engine").library(find_toolchain(host()), [_SOURCE], [HEADER.parent], "environment")
        own = ffi.dlopen(str(path))
        before = own.cosim_environment_bits()
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


def what_changed(bits: int) -> str:
    """In words."""
    return " and ".join(text for i, text in enumerate(_KINDS) if bits & 1 << i) + " of floating-point arithmetic"
