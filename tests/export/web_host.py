"""A host for the modules of web pages: what the page's script does with them, in wasmtime."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import wasmtime

TYPES = {"Float64": 0, "Int32": 1, "Boolean": 2}


class WebHost:
    """One model of a module, instantiated."""

    def __init__(self, content: bytes, watched: Sequence[tuple[int, str]], model: int = 0):
        """`watched`: value references and types of what is shown, sorted by type."""
        engine = wasmtime.Engine()
        self.store = wasmtime.Store(engine)
        module = wasmtime.Module(engine, content)
        assert [i.name for i in module.imports] == []  # it asks its host for nothing
        self.exports = wasmtime.Instance(self.store, module, []).exports(self.store)
        memory = self.exports["memory"]
        assert isinstance(memory, wasmtime.Memory)
        self.memory = memory
        self.call("_initialize")
        counts = [sum(kind == t for _, kind in watched) for t in TYPES]
        references = self.place(np.array([r for r, _ in watched], dtype=np.uint32))
        self.width = len(watched)
        self.handle = self.call("web_open", model, references, *counts)

    def call(self, name: str, *arguments: float) -> int:
        function = self.exports[name]
        assert isinstance(function, wasmtime.Func)
        result: int = function(self.store, *arguments)
        return result

    @property
    def message(self) -> str:
        at = self.call("web_message")
        return bytes(self.memory.read(self.store, at, at + 1024)).split(b"\0")[0].decode()

    def place(self, values: np.ndarray) -> int:
        at = self.call("web_memory", max(8, values.nbytes))
        self.memory.write(self.store, values.tobytes(), at)
        return at

    def set(self, reference: int, kind: str, values: Sequence[float]) -> int:
        references = self.place(np.array([reference], dtype=np.uint32))
        data = np.array(values, dtype=float)
        return self.call("web_set", self.handle, TYPES[kind], references, 1, self.place(data), len(data))

    def start(self, step: float, time: float = 0.0) -> int:
        return self.call("web_start", self.handle, time, step)

    def look(self) -> np.ndarray:
        room = self.place(np.zeros(self.width))
        assert self.call("web_look", self.handle, room) <= 1, self.message
        return self._read(room, 1)[0]

    def run(self, n: int) -> np.ndarray:
        """The rows of up to n steps, as many as there were."""
        room = self.place(np.zeros(n * self.width))
        done = self.call("web_run", self.handle, n, self.width, room)
        return self._read(room, done)

    def _read(self, at: int, rows: int) -> np.ndarray:
        data = self.memory.read(self.store, at, at + 8 * rows * self.width)
        return np.frombuffer(bytes(data)).reshape(rows, self.width)
