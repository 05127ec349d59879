"""Takes samples while a system runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.recording.recording import Array, Recording


class Recorder:
    """Takes samples from the master's value vector into rows that grow by chunks.

    `index` (variables,) picks the values; `scale` and `offset` are applied to whole columns when the recording is
    made. `count` may be set back, which forgets later samples.
    """

    CHUNK = 4096

    def __init__(self, values: Array, index: Sequence[int], scale: Array, offset: Array):
        self.count = 0
        self._index = np.array(index, dtype=np.intp)
        self._scale, self._offset = scale, offset
        self._converted = (scale != 1.0) | (offset != 0.0)
        self._converts = bool(self._converted.any())
        self._take = values.take
        self._times: list[Array] = []
        self._rows: list[Array] = []

    def sample(self, t: float) -> None:
        """Append one sample."""
        times, rows, row = self.room()
        times[row] = t
        self._take(self._index, 0, rows[row], "clip")
        self.count += 1

    def room(self) -> tuple[Array, Array, int]:
        """Where the next sample goes: the times and the rows of a chunk, and the place among them."""
        chunk, row = divmod(self.count, self.CHUNK)
        if chunk == len(self._times):
            self._times.append(np.empty(self.CHUNK))
            self._rows.append(np.empty((self.CHUNK, len(self._index))))
        return self._times[chunk], self._rows[chunk], row

    def recording(self, names: list[str], units: dict[str, str]) -> Recording:
        """A copy of everything sampled so far."""
        time, data = self.since(0)
        return Recording(time, names, np.asfortranarray(data), units)

    def since(self, begin: int) -> tuple[Array, Array]:
        """A copy of the samples from number `begin` on: times, and rows with their values converted."""
        if begin >= self.count:
            return np.empty(0), np.empty((0, len(self._index)))
        first, last = begin // self.CHUNK, (self.count - 1) // self.CHUNK
        piece = slice(begin - first * self.CHUNK, self.count - first * self.CHUNK)
        if first == last:
            time, data = self._times[first][piece].copy(), self._rows[first][piece].copy()
        else:
            time, data = np.concatenate(self._times[first:])[piece], np.concatenate(self._rows[first:])[piece]
        if self._converts:
            converted = self._converted
            data[:, converted] = data[:, converted] * self._scale[converted] + self._offset[converted]
        return time, data
