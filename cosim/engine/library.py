"""The engine as a shared library: part of a published wheel, else compiled once per machine."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cffi
import numpy as np

from build_fmus.compile import PLATFORMS, CompileError, ObjectCache, find_toolchain, host
from cosim.core.c_headers import declarations
from cosim.core.component import Transfer
from cosim.core.errors import CosimError

HEADER = Path(__file__).with_name("engine.h")
ADAPTIVE = Path(__file__).with_name("adaptive.h")
TABLE = Path(__file__).with_name("table.h")
INTEGRATOR = Path(__file__).with_name("integrator.h")
EVENT_STEPS = Path(__file__).with_name("event_steps.h")
CLOCKED_STEPS = Path(__file__).with_name("clocked_steps.h")
EXACT_VALUES = Path(__file__).with_name("exact_values.h")
INTERMEDIATE = Path(__file__).with_name("intermediate.h")
ENVIRONMENT = Path(__file__).parents[1] / "fmu" / "environment.h"
SOURCES = tuple(
    Path(__file__).with_name(f"{name}.c")
    for name in (
        "engine",
        "algebraic_loop",
        "adaptive",
        "table",
        "integrator",
        "event_steps",
        "clocked_steps",
        "exact_values",
        "intermediate",
        "library",
    )
)
_STRUCTS = (
    "Engine",
    "EngineComponent",
    "EngineLoop",
    "EngineDerivative",
    "EngineAdaptive",
    "Table",
    "Integrator",
    "EventSteps",
    "EventInputs",
    "ClockedFmu",
    "ClockedSetup",
    "ClockedGroup",
    "ClockSetup",
    "ClockWire",
    "ExactValues",
    "ExactItem",
    "IntermediateStep",
)

_TYPES = {
    np.dtype(np.float64): "ENGINE_DOUBLE",
    np.dtype(np.float32): "ENGINE_FLOAT",
    np.dtype(np.int8): "ENGINE_INT8",
    np.dtype(np.uint8): "ENGINE_UINT8",
    np.dtype(np.int16): "ENGINE_INT16",
    np.dtype(np.uint16): "ENGINE_UINT16",
    np.dtype(np.int32): "ENGINE_INT32",
    np.dtype(np.uint32): "ENGINE_UINT32",
    np.dtype(np.int64): "ENGINE_INT64",
    np.dtype(np.uint64): "ENGINE_UINT64",
    np.dtype(np.bool_): "ENGINE_BOOL",
}

_EXPORTED = """
int cosim_engine_run(Engine *e, EngineAdaptive *a, int64_t end);
int cosim_engine_instant(Engine *e, EngineAdaptive *a, double t, bool resumed, bool arrives, bool samples,
    bool advances);
int cosim_engine_cut(Engine *e, EngineAdaptive *a, int64_t tick);
void cosim_engine_publish(Engine *e);
int cosim_engine_follow_events(Engine *e, double *before);
int cosim_engine_settle(Engine *e, const bool *settles, double *before, size_t n_values, bool late);
int32_t cosim_engine_save(const EngineStates *fmus, int32_t n, void **states, uint32_t *status);
int32_t cosim_engine_restore(const EngineStates *fmus, int32_t n, void **states, uint32_t *status);
void cosim_engine_free(const EngineStates *fmus, int32_t n, void **states);
size_t cosim_engine_loop_work(int32_t n);
size_t cosim_engine_size(void);
uint32_t cosim_table_step(void *table, double t, double h, int no_set_prior);
const char *cosim_integrator_function(uint32_t version, uint32_t number);
void cosim_integrator_why(const IntegratorSetup *setup, const IntegratorReport *report, const char *state, char *text,
    size_t size);
bool cosim_integrator_needs(const IntegratorSetup *setup, uint32_t number);
size_t cosim_integrator_size(const IntegratorSetup *setup);
Integrator *cosim_integrator_make(void *memory, const IntegratorSetup *setup, const uint32_t *references,
    void *instance, void *const *calls);
uint32_t cosim_integrator_begin(void *integrator, double t);
uint32_t cosim_integrator_step2(void *integrator, double t, double h, int no_set_prior);
uint32_t cosim_integrator_step3(void *integrator, double t, double h, bool no_set_prior, bool *event, bool *terminate,
    bool *early, double *last);
uint32_t cosim_event_steps_set(void *instance, const uint32_t *inputs, size_t n, void *data, size_t n_data);
uint32_t cosim_event_steps_begin(EventSteps *s, double t);
uint32_t cosim_event_steps_enter(EventSteps *s, double t);
uint32_t cosim_event_steps_leave(EventSteps *s, double t);
const char *cosim_event_steps_why(const EventReport *report);
uint32_t cosim_event_steps_step(void *steps, double t, double h, bool no_set_prior, bool *event, bool *terminate,
    bool *early, double *last);
const ClockedCalls *cosim_clocked_calls(void);
void cosim_intermediate_update(void *environment, double t, bool asks, bool allows, bool finished, bool can_return,
    bool *returns, double *return_time);
uint32_t cosim_intermediate_step(void *steps, double t, double h, bool no_set_prior, bool *event, bool *terminate,
    bool *early, double *last);
uint32_t cosim_exact_set2(void *instance, const uint32_t *exact, size_t n, void *slots);
uint32_t cosim_exact_set3(void *instance, const uint32_t *exact, size_t n, void *slots, size_t n_slots);
uint32_t cosim_exact_get2(void *instance, const uint32_t *exact, size_t n, void *slots);
uint32_t cosim_exact_get3(void *instance, const uint32_t *exact, size_t n, void *slots, size_t n_slots);
"""


class NoEngine(CosimError):  # noqa: N818
    """There is no engine for this machine; the argument says why, and what to install."""

    def __init__(self, reason: str):
        super().__init__(f"the engine, which runs systems, is not available: {reason}")


@lru_cache
def interface() -> cffi.FFI:
    """The types of the headers of the engine."""
    ffi = cffi.FFI()
    headers = (HEADER, ADAPTIVE, TABLE, INTEGRATOR, EVENT_STEPS, CLOCKED_STEPS, EXACT_VALUES, INTERMEDIATE)
    ffi.cdef(declarations(*headers) + _EXPORTED)
    return ffi


def compiled(platform_name: str) -> Path:
    """The engine as a shared library for a platform.

    Raises:
        CompileError: there is no compiler for it, or it failed.
    """
    include = [HEADER.parent, ENVIRONMENT.parent]
    return ObjectCache.of_user().library(find_toolchain(platform_name), SOURCES, include, "engine")


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
    if loaded.cosim_engine_size() != sum(map(ffi.sizeof, _STRUCTS)):
        raise NoEngine(f"{path} lays out its data in another way than this Python")
    return loaded


def engine_transfers(version: int, transfers: Sequence[Transfer], keep: list[Any]) -> Any:
    """`EngineTransfer` of calls of FMUs of this version; `keep` gets what they point to."""
    ffi = interface()
    if not transfers:
        return ffi.NULL

    def pointer(of: str, array: Any) -> Any:
        keep.append(array)
        return ffi.cast(of, array.ctypes.data)

    structs = ffi.new("EngineTransfer[]", len(transfers))
    keep.append(structs)
    for s, transfer in zip(structs, transfers, strict=True):
        setattr(s, f"call{version}", ffi.cast(f"EngineValues{version}", transfer.call))
        s.references, s.n_references = ffi.cast("uint32_t*", transfer.references), transfer.n_references
        s.data, s.n_data = pointer("void*", transfer.data), len(transfer.data)
        s.type = getattr(library(), _TYPES[transfer.data.dtype])
        if transfer.widths is not None:
            s.widths = pointer("uint32_t*", transfer.widths)
        if transfer.element is not None and transfer.place is not None:
            s.n = len(transfer.place)
            s.element, s.place = (
                pointer("uint32_t*", at.astype(np.uint32)) for at in (transfer.element, transfer.place)
            )
    return structs
