"""Calls that move 64-bit integers, Strings and Binaries between an FMU and the master's doubles (`exact_values.c`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.core.component import Transfer
from cosim.core.signals import Array
from cosim.engine.library import interface, library
from cosim.fmu.transfers import Arrangement, slots

_KINDS = {"Int64": "EXACT_INT64", "UInt64": "EXACT_UINT64", "String": "EXACT_STRING", "Binary": "EXACT_BINARY"}


class ExactCall:
    """One call, with the memory that it needs."""

    def __init__(self, how: Arrangement, buffer: Array, direction: str, version: int):
        """It reads the places of `buffer` that `how` says ("Set"), or writes them ("Get")."""
        self._ffi, self._library, self._direction, self._version = interface(), library(), direction, version
        ffi, kind = self._ffi, _KINDS[how.fmi_type]
        widths = [slots(size) for size in how.sizes]
        begins = np.cumsum([0, *widths])
        place = np.concatenate([p + np.arange(w) for p, w in zip(how.place, widths, strict=True)])
        self._names = {int(e): v.name for e, v in zip(how.element, self._ordered(how), strict=True)}
        self._in_place = bool(np.array_equal(place, place[0] + np.arange(len(place))))
        self._place, self._buffer = place, buffer
        self._slots = buffer[place[0] : place[0] + len(place)] if self._in_place else np.zeros(len(place))
        self.values = np.zeros(how.total, dtype=np.int64 if kind == "EXACT_INT64" else np.uint64)
        self._sizes = np.zeros(how.total, dtype=np.uintp)
        text_at = np.cumsum([0, *(size + 1 for size in how.sizes)])
        self._texts = np.zeros(int(text_at[-1]), dtype=np.uint8)
        if direction == "Set" and kind in ("EXACT_STRING", "EXACT_BINARY"):
            self.values[how.element] = self._texts.ctypes.data + text_at[:-1].astype(np.uint64)
        self._references = np.array(list(how.arrays), dtype=np.uint32)
        self._items = ffi.new(
            "ExactItem[]",
            [
                {"element": int(e), "at": int(at), "size": size, "text": int(text)}
                for e, at, size, text in zip(how.element, begins, how.sizes, text_at, strict=False)
            ],
        )
        self._struct = x = ffi.new("ExactValues*")
        x.kind, x.version, x.too_long = getattr(self._library, kind), version, -1
        x.references, x.n_references = ffi.cast("uint32_t*", self._references.ctypes.data), len(self._references)
        x.values, x.n_values = ffi.cast("void*", self.values.ctypes.data), how.total
        x.sizes, x.texts = (
            ffi.cast(t, a.ctypes.data) for t, a in (("size_t*", self._sizes), ("unsigned char*", self._texts))
        )
        x.items, x.n_items = self._items, len(self._items)

    @staticmethod
    def _ordered(how: Arrangement) -> list[Any]:
        """The variables in the order of `how.element`."""
        at, places = 0, {}
        for elements in how.arrays.values():
            places.update({at + v.index: v for v in elements})
            at += elements[0].size
        return [places[int(e)] for e in how.element]

    def bound(self, call: int, instance: int) -> Callable[[], int]:
        """What makes the call, of the function at this address, and returns its status."""
        ffi, slots_, buffer, place = self._ffi, self._slots, self._buffer, self._place
        self._struct.call = ffi.cast("void*", call)
        function = getattr(self._library, f"cosim_exact_{self._direction.lower()}{self._version}")
        arguments = [
            ffi.cast("void*", instance),
            ffi.cast("uint32_t*", self._struct),
            0,
            ffi.cast("void*", slots_.ctypes.data),
            *([len(slots_)] if self._version == 3 else []),
        ]
        sets, in_place = self._direction == "Set", self._in_place

        def move() -> int:
            if sets and not in_place:
                slots_[:] = buffer[place]
            status = int(function(*arguments))
            if not sets and not in_place:
                buffer[place] = slots_
            return status

        return move

    def transfer(self, function: str) -> Transfer:
        """The same for the engine."""
        name = f"cosim_exact_{self._direction.lower()}{self._version}"
        address = self._ffi.cast("uintptr_t", self._ffi.addressof(self._library, name))
        where = () if self._in_place else (np.arange(len(self._place)), self._place)
        return Transfer(function, int(address), int(self._ffi.cast("uintptr_t", self._struct)), 0, self._slots, *where)

    def complaint(self) -> str:
        """What is too long, if the last failure was that; empty otherwise."""
        at = int(self._struct.too_long)
        if at < 0:
            return ""
        self._struct.too_long = -1
        item, length = self._items[at], int(self._struct.length)
        said = f"at least {length}" if self._struct.kind == self._library.EXACT_STRING else str(length)
        return (
            f"{self._names[item.element]} has {said} bytes, and its connection holds {item.size}: give"
            " connect(..., max_size=...) a larger number"
        )
