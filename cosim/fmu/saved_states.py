"""Saved states of FMUs: who holds them, when the FMUs free them, and what becomes of them when an instance ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import cffi

from cosim.core.errors import CosimError


class Stateful(Protocol):
    """An instance of an FMU that offers its states."""

    keepers: list[StateKeeper]  # of states that it saved in this run

    def pack_pointer(self, pointer: Any) -> bytes:
        """A state as the FMU serializes it. Raises CosimError where it does not."""

    def free_pointer(self, pointer: Any) -> None:
        """Free the state that a `void**` points to."""


class SavedStates:
    """States of one or more FMUs that were saved together. The FMUs may free them when nobody holds this object."""

    __slots__ = ("keeper", "packed", "pointers")

    def __init__(self, keeper: StateKeeper, pointers: Any, packed: dict[int, bytes | CosimError]):
        self.keeper = keeper
        self.pointers = pointers  # void*[], of each FMU; NULL when its instance has ended
        self.packed = packed  # bytes by number of the FMU, of those whose instances have ended

    def by_name(self) -> dict[str, FmuState]:
        """The states by name of the FMU."""
        return {name: FmuState(self, number) for number, name in enumerate(self.keeper.names)}

    def __del__(self) -> None:  # a finalizer of weakref costs more than the state itself
        self.keeper.drop(id(self))


class FmuState:
    """The saved state of one FMU: number `number` of `saved`. `events`: of its clocks."""

    __slots__ = ("events", "number", "saved")

    def __init__(self, saved: SavedStates, number: int = 0, events: Any = None):
        self.saved, self.number, self.events = saved, number, events

    @property
    def pointer(self) -> Any:
        """The `void*` that the FMU gave; NULL when its instance has ended."""
        return self.saved.pointers[self.number]

    def belongs_to(self, fmu: Stateful) -> bool:
        """Whether it is a state of this FMU, though its instance may be another by now."""
        return self.saved.keeper.fmus[self.number] is fmu

    def pack(self) -> bytes:
        """The state as bytes. Raises CosimError saying why the FMU does not give them."""
        if self.pointer:
            return self.saved.keeper.fmus[self.number].pack_pointer(self.pointer)
        packed = self.saved.packed.get(self.number)
        if packed is None:
            raise CosimError("this saved state was freed, or lost when its FMU failed")
        if isinstance(packed, CosimError):
            raise packed
        return packed


class StateKeeper:
    """Saves states of `fmus` together, and frees them at the next chance after nobody holds them.

    `save` and `free` do that for all FMUs, for an array of pointers; `free` skips those that are NULL. States may be
    let go at any time and in any thread, so no FMU is called then.
    """

    def __init__(
        self,
        fmus: Mapping[str, Stateful],
        ffi: cffi.FFI,
        save: Callable[[Any], None],
        free: Callable[[Any], None],
    ):
        self.names, self.fmus = list(fmus), list(fmus.values())
        self._ffi, self._save, self._free = ffi, save, free
        self._held: dict[int, tuple[Any, dict[int, bytes | CosimError]]] = {}  # pointers and bytes by id of SavedStates
        self._dropped: list[Any] = []
        for fmu in self.fmus:
            fmu.keepers.append(self)

    @property
    def in_use(self) -> bool:
        """Whether somebody holds a state."""
        return bool(self._held)

    def holds(self) -> bool:
        """Free what nobody holds any more; whether somebody holds a state."""
        while self._dropped:
            self._free(self._dropped.pop())
        return self.in_use

    def save(self) -> SavedStates:
        """Save the present states. Raises what the calls raise."""
        self.holds()
        pointers = self._ffi.new("void*[]", len(self.fmus))
        try:
            self._save(pointers)
        except BaseException:
            self._dropped.append(pointers)
            raise
        packed: dict[int, bytes | CosimError] = {}
        saved = SavedStates(self, pointers, packed)
        self._held[id(saved)] = pointers, packed
        return saved

    def forget(self, saved: SavedStates) -> None:
        """Free states that may still be held: they cannot be restored any more."""
        if id(saved) in self._held:
            self.drop(id(saved))
            saved.pointers = self._ffi.new("void*[]", len(self.fmus))
            self.holds()

    def release(self, fmu: Stateful, *, dead: bool) -> None:
        """The instance of an FMU is about to be freed: its states that are held become bytes.

        Those of a `dead` one are lost: it may not be called any more.
        """
        number = next(i for i, known in enumerate(self.fmus) if known is fmu)
        held = list(self._held.values())
        for pointers, packed in held:
            if pointers[number] and not dead:
                try:
                    packed[number] = fmu.pack_pointer(pointers[number])
                except CosimError as error:
                    packed[number] = error
        for pointers in [*(p for p, _ in held), *self._dropped]:
            if pointers[number] and not dead:
                fmu.free_pointer(pointers + number)
            pointers[number] = self._ffi.NULL

    def drop(self, key: int) -> None:
        """Nobody holds these states any more. Called at any time, so no FMU is."""
        content = self._held.pop(key, None)
        if content is not None:
            self._dropped.append(content[0])
