"""The engine as a shared library, compiled once per machine and version of its sources, stored with a verified hash."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import cffi

from build_fmus.base import extras
from build_fmus.compile import CompileError, ObjectCache, find_toolchain, host
from cosim.core.errors import CosimError
from cosim.fmu.environment import HEADER as ENVIRONMENT

HEADER = Path(__file__).with_name("engine.h")
TABLE = Path(__file__).with_name("table.h")
SOURCES = tuple(Path(__file__).with_name(name) for name in ("engine.c", "table.c", "library.c"))

_EXPORTED = """
int cosim_engine_run(Engine *e, int64_t end);
int cosim_engine_instant(Engine *e, double t, bool resumed, bool arrives, bool samples, bool advances);
void cosim_engine_gather(Engine *e, int32_t component, double t);
size_t cosim_engine_size(void);
uint32_t cosim_table_step(void *table, double t, double h, int no_set_prior);
"""


class NoEngine(CosimError):  # noqa: N818
    """The engine could not be compiled; the argument says why, and what to install."""

    def __init__(self, reason: str):
        super().__init__(
            f"systems are run by an engine in C, which could not be compiled: {reason}; install a C compiler, or"
            f" {extras.named('zig')}"
        )


@lru_cache
def interface() -> cffi.FFI:
    """The types of `engine.h` and `table.h`."""
    ffi = cffi.FFI()
    declarations = re.sub(r"(?m)^#.*$", "", HEADER.read_text() + TABLE.read_text())
    ffi.cdef(f"{declarations}\n{_EXPORTED}")
    return ffi


@lru_cache
def library() -> Any:
    """The engine, ready to be called. Raises NoEngine with the reason."""
    ffi = interface()
    try:
        toolchain = find_toolchain(host())
        path = ObjectCache.of_user("engine").library(toolchain, SOURCES, [HEADER.parent, ENVIRONMENT.parent], "engine")
        loaded: Any = ffi.dlopen(str(path))
    except (CompileError, OSError) as error:
        raise NoEngine(str(error).splitlines()[0]) from error
    if loaded.cosim_engine_size() != ffi.sizeof("Engine") + ffi.sizeof("EngineComponent") + ffi.sizeof("Table"):
        raise NoEngine(f"{path} lays out its data in another way than this Python")
    return loaded
