"""Saved states of FMUs: which are in use, when the FMUs free them, and their bytes after the end of an instance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import cffi

from cosim.core.errors import CosimError


class Stateful(Protocol):
    """An instance of an FMU that offers its states."""

    state_pools: list[StatePool]  # of the states that it saved in this run

    def pack_pointer(self, pointer: Any) -> bytes:
        """A state as the FMU serializes it. Raises CosimError where it does not."""

    def free_pointer(self, pointer: Any) -> None:
        """Free the state that a `void**` points to."""


class SavedStates:
    """States of one or more FMUs, saved at one time. The FMUs may free them after this object is deleted."""

    __slots__ = ("packed", "pointers", "pool")

    def __init__(self, pool: StatePool, pointers: Any, packed: dict[int, bytes | CosimError]):
        self.pool = pool
        self.pointers = pointers  # void*[], of each FMU; NULL when its instance has ended
        self.packed = packed  # bytes by number of the FMU, of those whose instances have ended

    def by_name(self) -> dict[str, FmuState]:
        """The states by name of the FMU."""
        return {name: FmuState(self, number) for number, name in enumerate(self.pool.names)}

    def __del__(self) -> None:  # a finalizer of weakref costs more than the state itself
        self.pool.mark_unused(id(self))


_LENGTH = 8  # bytes of the length of what is saved beside the FMU's own state


def split(data: bytes) -> tuple[bytes, bytes]:
    """The state of the FMU and what was saved beside it, from what `FmuState.pack` made of both."""
    end = max(0, len(data) - _LENGTH)
    begin = max(0, end - int.from_bytes(data[end:], "little"))
    return data[:begin], data[begin:end]


class FmuState:
    """The saved state of one FMU: number `number` of `saved`. `events`: of its clocks, events or integrator."""

    __slots__ = ("events", "number", "saved")

    def __init__(self, saved: SavedStates, number: int = 0, events: bytes | None = None):
        self.saved, self.number, self.events = saved, number, events

    @property
    def pointer(self) -> Any:
        """The `void*` that the FMU gave; NULL when its instance has ended."""
        return self.saved.pointers[self.number]

    def belongs_to(self, fmu: Stateful) -> bool:
        """Whether it is a state of this FMU, though its instance may be another by now."""
        return self.saved.pool.fmus[self.number] is fmu

    def pack(self) -> bytes:
        """The state as bytes, see `split`. Raises CosimError saying why the FMU does not give them."""
        more = b"" if self.events is None else self.events + len(self.events).to_bytes(_LENGTH, "little")
        if self.pointer:
            return self.saved.pool.fmus[self.number].pack_pointer(self.pointer) + more
        packed = self.saved.packed.get(self.number)
        if packed is None:
            raise CosimError("this saved state was freed, or lost when its FMU failed")
        if isinstance(packed, CosimError):
            raise packed
        return packed + more


class StatePool:
    """Saves the states of `fmus` at one time, and frees unused ones when the next states are saved.

    `save` and `free` call all FMUs with an array of pointers; `free` skips those that are NULL. A state can become
    unused at any time and in any thread, so no FMU is called then.
    """

    def __init__(
        self, fmus: Mapping[str, Stateful], ffi: cffi.FFI, save: Callable[[Any], None], free: Callable[[Any], None]
    ):
        self.names, self.fmus = list(fmus), list(fmus.values())
        self._ffi, self._save, self._free = ffi, save, free
        self._used: dict[int, tuple[Any, dict[int, bytes | CosimError]]] = {}  # pointers and bytes by id of SavedStates
        self._unused: list[Any] = []
        for fmu in self.fmus:
            fmu.state_pools.append(self)

    @property
    def in_use(self) -> bool:
        """Whether one of its states is in use."""
        return bool(self._used)

    def free_unused(self) -> None:
        """Free the states that are no longer in use."""
        while self._unused:
            self._free(self._unused.pop())

    def save(self) -> SavedStates:
        """Save the present states. Raises what the calls raise."""
        self.free_unused()
        pointers = self._ffi.new("void*[]", len(self.fmus))
        try:
            self._save(pointers)
        except BaseException:
            self._unused.append(pointers)
            raise
        packed: dict[int, bytes | CosimError] = {}
        saved = SavedStates(self, pointers, packed)
        self._used[id(saved)] = pointers, packed
        return saved

    def forget(self, saved: SavedStates) -> None:
        """Free states that may still be in use: they cannot be restored any more."""
        if id(saved) in self._used:
            self.mark_unused(id(saved))
            saved.pointers = self._ffi.new("void*[]", len(self.fmus))
            self.free_unused()

    def end_instance(self, fmu: Stateful, *, failed: bool) -> None:
        """Serialize and free the states of an FMU whose instance is about to be freed.

        The states of a `failed` one are lost: its functions must not be called.
        """
        number = next(i for i, known in enumerate(self.fmus) if known is fmu)
        used = list(self._used.values())
        for pointers, packed in used:
            if pointers[number] and not failed:
                try:
                    packed[number] = fmu.pack_pointer(pointers[number])
                except CosimError as error:
                    packed[number] = error
        for pointers in [*(p for p, _ in used), *self._unused]:
            if pointers[number] and not failed:
                fmu.free_pointer(pointers + number)
            pointers[number] = self._ffi.NULL

    def mark_unused(self, key: int) -> None:
        """The states with this id are no longer in use. Calls no FMU."""
        content = self._used.pop(key, None)
        if content is not None:
            self._unused.append(content[0])
