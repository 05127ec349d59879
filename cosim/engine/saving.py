"""Saves and restores the states of a simulation's FMUs by one call of the engine's library each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from cosim.core.component import FmiCalls
from cosim.engine.library import interface, library
from cosim.fmu.saved_states import SavedStates, StatePool
from cosim.system.components import SystemComponent


class EngineStatePool(StatePool):
    """States of FMUs that C may call: each function is called for all of them in one loop."""

    def __init__(self, fmus: Mapping[SystemComponent, FmiCalls]):
        """The `states` of all `fmus` are not None."""
        self._library, self._calls, ffi = library(), list(fmus.values()), interface()
        self._status, types = ffi.new("uint32_t*"), {"instance": "void*", "set": "EngineStateSet"}
        structs = []
        for calls in self._calls:
            assert calls.states is not None
            addresses = {"instance": calls.instance, **calls.states}
            structs.append({n: ffi.cast(types.get(n, "EngineState"), a) for n, a in addresses.items()})
        self.structs = ffi.new("EngineStates[]", structs)
        super().__init__({m.name: m.implementation for m in fmus}, ffi, self._save_all, self._free_all)  # type: ignore[misc]

    def restore(self, saved: SavedStates) -> None:
        """Restore all. Raises what the calls raise."""
        self._call("SetFMUState", self._library.cosim_engine_restore, saved.pointers)

    def _save_all(self, pointers: Any) -> None:
        self._call("GetFMUState", self._library.cosim_engine_save, pointers)

    def _free_all(self, pointers: Any) -> None:
        self._library.cosim_engine_free(self.structs, len(self._calls), pointers)

    def _call(self, name: str, call: Callable[..., int], pointers: Any) -> None:
        done = call(self.structs, len(self._calls), pointers, self._status)
        if done < len(self._calls):
            self._calls[done].call_failed(name, self._status[0])
