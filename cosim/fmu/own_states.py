"""Hidden states of this project's sampled FMUs, read from a serialized state and written back into one.

A sampled component shows inputs and outputs; what it remembers between samples is in its saved state only. That of our
FMUs is plain (`build_fmus/runtime/saved_state.h`, which this module reads): a header with a checksum, times and
flags, then doubles: parameters, inputs, states, derivatives (unused when sampled), outputs. How many of them are
parameters and inputs is in the model description, where the outputs lie is asked of the FMU itself, and what is left is
twice the states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cffi
import numpy as np

from build_fmus import compile as building
from cosim.core.c_headers import declarations
from cosim.core.errors import CosimError
from cosim.core.signals import Array

MORE_THAN_STATES = (
    "it has memory beyond its states, such as the last solution of a quadratic program, so it has no linear model"
)

_ffi = cffi.FFI()
_ffi.cdef(declarations(Path(building.__file__).with_name("runtime") / "saved_state.h"))
_FORMAT = _ffi.typeof("enum SnapshotFormat").relements
_HEAD = _ffi.sizeof("struct FmuSnapshot")
VALUES_AT = _HEAD + _ffi.offsetof("State", "v")
"""Bytes of a serialized state before the doubles."""
_FNV_START, _FNV_FACTOR, _FNV_MASK = 14695981039346656037, 1099511628211, 2**64 - 1


@dataclass
class StateLayout:
    """Where the `count` states lie: from double number `begin` on."""

    begin: int
    count: int
    recomputed: bool = False  # with other states, outputs and derivatives are computed: the FMU is continuous
    _prefix: tuple[bytes, int] = field(default=(b"", _FNV_START), repr=False)  # what was hashed last, up to the states

    def read(self, data: bytes) -> Array:
        """The states in a serialized state, in the order of their declaration."""
        return _doubles(data)[self.begin : self.begin + self.count].copy()

    def write(self, data: bytes, x: Array) -> bytes:
        """The same serialized state with other states."""
        doubles = _doubles(data).copy()
        doubles[self.begin : self.begin + self.count] = x
        head = bytearray(data[_HEAD:VALUES_AT])
        if self.recomputed:
            flags = _ffi.from_buffer("State *", head)
            flags.outputs_valid = flags.derivatives_valid = 0
        return self._signed(data, bytes(head) + doubles.tobytes())

    def _signed(self, data: bytes, block: bytes) -> bytes:
        """With header and checksum; up to the states it seldom changes, and need not be hashed again."""
        border = VALUES_AT - _HEAD + 8 * self.begin
        if block[:border] != self._prefix[0]:
            self._prefix = block[:border], fnv1a(block[:border])
        return _with_checksum(data, block, fnv1a(block[border:], self._prefix[1]))


def find_states(
    data: bytes, parameters: int, inputs: int, outputs: int, shown: Callable[[bytes], Sequence[float]]
) -> StateLayout:
    """Layout of a serialized state with this number of `parameters`, `inputs` and `outputs`.

    `shown` returns the outputs of the FMU in another state. Raises CosimError if the layout is not one that this module
    knows.
    """
    header = _ffi.from_buffer("struct FmuSnapshot *", data) if len(data) >= VALUES_AT else None
    if header is None or [header.magic, header.version] != [_FORMAT["SNAPSHOT_MAGIC"], _FORMAT["SNAPSHOT_VERSION"]]:
        raise CosimError("its FMU is not from build-fmus, so the position of its states in a saved state is unknown")
    begin = parameters + inputs
    rest = len(_doubles(data)) - begin
    places = np.zeros(outputs, dtype=int)  # of each output in the rest, in binary: one bit is requested at a time
    for bit in range(rest.bit_length()):
        places += np.asarray(shown(_marked(data, begin, bit)), dtype=float).astype(bool).astype(int) << bit
    places -= 1
    last = rest  # outputs end the block; states that are outputs lie further ahead
    while last - 1 in places:
        last -= 1
    if rest < 0 or (outputs and last == rest) or last % 2:
        raise CosimError(MORE_THAN_STATES)
    return StateLayout(begin, last // 2)


def _marked(data: bytes, begin: int, bit: int) -> bytes:
    """The state whose doubles from `begin` on are bit number `bit` of 1, 2, 3, ..., outputs taken as computed."""
    doubles = _doubles(data).copy()
    doubles[begin:] = (np.arange(1, len(doubles) - begin + 1) >> bit) & 1
    head = bytearray(data[_HEAD:VALUES_AT])
    _ffi.from_buffer("State *", head).outputs_valid = 1
    block = bytes(head) + doubles.tobytes()
    return _with_checksum(data, block, fnv1a(block))


def saved_values(data: bytes, count: int) -> tuple[Array, Array]:
    """Time, start time, number of the next sample and whether there was one; then the first `count` doubles."""
    head = _ffi.from_buffer("State *", data[_HEAD:VALUES_AT])
    return np.array([head.time, head.start_time, head.sample, head.started]), _doubles(data)[:count]


def _doubles(data: bytes) -> Array:
    return np.frombuffer(data, dtype=float, offset=VALUES_AT)


def _with_checksum(data: bytes, block: bytes, checksum: int) -> bytes:
    head = bytearray(data[:_HEAD])
    _ffi.from_buffer("struct FmuSnapshot *", head).checksum = checksum
    return bytes(head) + block


def fnv1a(data: bytes, value: int = _FNV_START) -> int:
    """Checksum of words of 8 bytes, then of the bytes left, as `fmu_base.c` has it."""
    words = np.frombuffer(data, dtype=np.uint64, count=len(data) // 8)
    words = words ^ (words >> np.uint64(32))
    done = 0
    for at in np.flatnonzero(words).tolist():  # most of a state is zeros
        value = (value * pow(_FNV_FACTOR, at - done, _FNV_MASK + 1)) & _FNV_MASK
        value = ((value ^ int(words[at])) * _FNV_FACTOR) & _FNV_MASK
        done = at + 1
    value = (value * pow(_FNV_FACTOR, len(words) - done, _FNV_MASK + 1)) & _FNV_MASK
    for byte in data[8 * len(words) :]:
        value = ((value ^ byte) * _FNV_FACTOR) & _FNV_MASK
    return value
