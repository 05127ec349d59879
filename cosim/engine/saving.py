"""Saves the states of a simulation's FMUs by one call of the engine's library."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cosim.core.component import FmiCalls
from cosim.engine.library import interface, library
from cosim.fmu.saved_states import StateKeeper
from cosim.system.components import SystemComponent


def keeper_of(fmus: Mapping[SystemComponent, FmiCalls]) -> StateKeeper:
    """Saves the states of these FMUs together; their `get_state` and `free_state` are not 0."""
    ffi, called = interface(), list(fmus.values())
    structs = ffi.new(
        "EngineStates[]",
        [
            {
                "instance": ffi.cast("void*", calls.instance),
                "get": ffi.cast("EngineState", calls.get_state),
                "free": ffi.cast("EngineState", calls.free_state),
            }
            for calls in called
        ],
    )
    status, save_all, free_all = ffi.new("uint32_t*"), library().cosim_engine_save, library().cosim_engine_free

    def save(pointers: Any) -> None:
        done = save_all(structs, len(called), pointers, status)
        if done < len(called):
            failed = called[done]
            failed.call_failed("GetFMUState" if failed.version == 3 else "GetFMUstate", status[0])

    def free(pointers: Any) -> None:
        free_all(structs, len(called), pointers)

    stateful: dict[str, Any] = {m.name: m.implementation for m in fmus}
    return StateKeeper(stateful, ffi, save, free)
