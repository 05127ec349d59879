"""The engine as a shared library: part of a published wheel, else compiled once per machine."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import cffi

from build_fmus.compile import PLATFORMS, CompileError, ObjectCache, find_toolchain, host
from cosim.core.errors import CosimError
from cosim.fmu.environment import HEADER as ENVIRONMENT

HEADER = Path(__file__).with_name("engine.h")
TABLE = Path(__file__).with_name("table.h")
SOURCES = tuple(Path(__file__).with_name(name) for name in ("engine.c", "table.c", "library.c"))

_EXPORTED = """
int cosim_engine_run(Engine *e, int64_t end);
int cosim_engine_instant(Engine *e, double t, bool resumed, bool arrives, bool samples, bool advances);
void cosim_engine_publish(Engine *e);
int cosim_engine_settle(Engine *e, const bool *settles, double *before, size_t n_values);
int32_t cosim_engine_save(const EngineStates *fmus, int32_t n, void **states, uint32_t *status);
int32_t cosim_engine_restore(const EngineStates *fmus, int32_t n, void **states, uint32_t *status);
void cosim_engine_free(const EngineStates *fmus, int32_t n, void **states);
size_t cosim_engine_size(void);
uint32_t cosim_table_step(void *table, double t, double h, int no_set_prior);
"""


class NoEngine(CosimError):  # noqa: N818
    """There is no engine for this machine; the argument says why, and what to install."""

    def __init__(self, reason: str):
        super().__init__(f"the engine, which runs systems, is not available: {reason}")


@lru_cache
def interface() -> cffi.FFI:
    """The types of `engine.h` and `table.h`."""
    ffi = cffi.FFI()
    declarations = re.sub(r"(?m)^#.*$", "", HEADER.read_text() + TABLE.read_text())
    ffi.cdef(f"{declarations}\n{_EXPORTED}")
    return ffi


def compiled(platform_name: str) -> Path:
    """The engine as a shared library for a platform.

    Raises:
        CompileError: there is no compiler for it, or it failed.
    """
    include = [HEADER.parent, ENVIRONMENT.parent]
    return ObjectCache.of_user("engine").library(find_toolchain(platform_name), SOURCES, include, "engine")


def prebuilt_name(platform_name: str) -> str:
    """Name of the engine for a platform in the folder `prebuilt` of a published wheel."""
    return platform_name + PLATFORMS[platform_name].suffix


@lru_cache
def library() -> Any:
    """The engine, ready to be called: the one that came with the wheel, else, or if it cannot be loaded, compiled here.

    Raises:
        NoEngine: there is none.
    """
    ffi = interface()
    path = HEADER.parent / "prebuilt" / prebuilt_name(host())
    try:
        try:
            loaded: Any = ffi.dlopen(str(path))
        except OSError:  # a source installation has none, and not every machine can load it
            path = compiled(host())
            loaded = ffi.dlopen(str(path))
    except (CompileError, OSError) as error:
        raise NoEngine(str(error).splitlines()[0]) from error
    if loaded.cosim_engine_size() != ffi.sizeof("Engine") + ffi.sizeof("EngineComponent") + ffi.sizeof("Table"):
        raise NoEngine(f"{path} lays out its data in another way than this Python")
    return loaded
