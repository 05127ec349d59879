"""What steps an FMU instead of its own `DoStep`: a function of the engine's library with a struct of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from cosim.engine.library import interface, library


class Driver(ABC):
    """The step function of one instance, for Python and for the engine."""

    def __init__(self) -> None:
        self._ffi, self._library = interface(), library()

    @property
    @abstractmethod
    def step(self) -> tuple[Any, Any]:
        """The step function and its first argument."""

    @property
    def addresses(self) -> tuple[int, int]:
        """The same as addresses."""
        function, first = self.step
        return self._address(function), self._address(first)

    def _address(self, pointer: Any) -> int:
        return int(self._ffi.cast("uintptr_t", pointer))

    def _pointer(self, address: int) -> Any:
        return self._ffi.cast("void*", address)
