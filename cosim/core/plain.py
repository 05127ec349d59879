"""Plain data as text and back: what components in Python remember, without anything that could be executed.

Numbers, text, Booleans, None, NumPy arrays and scalars of numbers, and lists, tuples and dicts of these. Every float
comes back with its bits, every array with its dtype and the order of its elements in memory; nothing else is accepted,
in either direction.
"""

from __future__ import annotations

import base64
import binascii
import copy
import json
import math
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

DEEPEST = 50  # lists within lists
LONGEST_INTEGER = 1024  # hexadecimal digits
_DTYPES = {
    name: np.dtype(name).newbyteorder("<")
    for name in (
        "bool",
        "int8",
        "int16",
        "int32",
        "int64",
        "uint8",
        "uint16",
        "uint32",
        "uint64",
        "float16",
        "float32",
        "float64",
        "complex64",
        "complex128",
    )
}


class NotPlain(ValueError):  # noqa: N818
    """A value that is no plain data, or a text that does not represent plain data; the argument says what."""


def encode(values: Mapping[str, Any]) -> bytes:
    """Encode named values as ASCII text.

    Raises NotPlain naming a value of an unsupported type, or one that shares memory with another: a copy would have two
    arrays in place of one.
    """
    shared = sharing(values)
    if shared:
        raise NotPlain(f"{shared[0]} and {shared[1]} share memory, which copies would not")
    pairs = []
    for name, value in values.items():
        try:
            pairs.append([name, _packed(value, 0)])
        except NotPlain as error:
            raise NotPlain(f"{name} {error}") from None
    return json.dumps(pairs, separators=(",", ":"), allow_nan=False).encode("ascii")


def decode(data: bytes) -> dict[str, Any]:
    """What `encode` was given. Raises NotPlain for anything else."""
    try:
        pairs = json.loads(data)
        if type(pairs) is not list:
            raise NotPlain("is no list of names and values")
        values: dict[str, Any] = {}
        for name, value in pairs:
            if type(name) is not str or name in values:
                raise NotPlain(f"has a name {str(name)[:40]!r} that is no text, or comes twice")
            values[name] = _unpacked(value, 0)
        return values
    except NotPlain:
        raise
    except (ValueError, TypeError, KeyError, IndexError, OverflowError, RecursionError, struct.error) as error:
        raise NotPlain(f"cannot be read ({type(error).__name__})") from None


def sharing(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """Two of the names whose values share memory that can be changed: a list, a dict, or (a part of) an array."""
    owners: dict[int, str] = {}
    for name, value in values.items():
        for held in _mutable(value, 0):
            if id(held) in owners:
                return owners[id(held)], name
            owners[id(held)] = name
    return None


def copied(values: Mapping[str, Any], onto: Sequence[tuple[Any, Any]] = ()) -> dict[str, Any]:
    """A deep copy in which arrays that share memory still do.

    `onto`: pairs of an array that owns memory and its replacement.
    """
    memo: dict[int, Any] = {id(old): new for old, new in onto}
    arrays = {id(a): a for value in values.values() for a in _arrays(value, 0)}
    owners = {i: _owner(a) for i, a in arrays.items()}
    counts = Counter(id(owner) for owner in owners.values())
    for i, array in arrays.items():
        owner = owners[i]
        if i not in memo and (counts[id(owner)] > 1 or id(owner) in memo) and not owner.dtype.hasobject:
            new = memo.setdefault(id(owner), owner.copy(order="K"))
            if array is not owner and new.strides == owner.strides:
                memo[i] = _view(array, owner, new)
    return copy.deepcopy(dict(values), memo)


def _view(array: Any, owner: Any, new: Any) -> Any:
    """The part of `new` that `array` is of `owner`, which lies in memory in the same way."""
    offset = array.__array_interface__["data"][0] - owner.__array_interface__["data"][0]
    flat = new.transpose(sorted(range(new.ndim), key=lambda i: -new.strides[i])).reshape(-1)
    return np.ndarray(array.shape, array.dtype, buffer=flat.view(np.uint8), offset=offset, strides=array.strides)


def _owner(array: Any) -> Any:
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array


def _arrays(value: Any, depth: int) -> Iterator[Any]:
    if type(value) is np.ndarray:
        yield value
    elif isinstance(value, list | tuple | dict) and depth < DEEPEST:
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _arrays(inner, depth + 1)


def _mutable(value: Any, depth: int) -> Iterator[Any]:
    """Lists, dicts and owners of arrays' memory in a value."""
    if depth > DEEPEST:
        return
    if isinstance(value, np.ndarray):
        yield _owner(value)
    elif isinstance(value, list | tuple | dict):
        if not isinstance(value, tuple):
            yield value
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _mutable(inner, depth + 1)


def _packed(value: Any, depth: int) -> list[Any]:
    if depth > DEEPEST:
        raise NotPlain(f"is nested more than {DEEPEST} deep")
    kind = type(value)
    if value is None:
        return ["none"]
    if kind is bool:
        return ["bool", value]
    if kind is int:
        text = f"{value:x}"
        if len(text) > LONGEST_INTEGER:
            raise NotPlain(f"is an integer of more than {LONGEST_INTEGER} hexadecimal digits")
        return ["int", text]
    if kind is float:
        return ["float", struct.pack("<d", value).hex()]
    if kind is str:
        return ["text", value]
    if kind in (list, tuple):
        return [kind.__name__, [_packed(v, depth + 1) for v in value]]
    if kind is dict:
        return ["dict", [[_packed(k, depth + 1), _packed(v, depth + 1)] for k, v in value.items()]]
    if kind is np.ndarray or isinstance(value, np.generic):
        name = value.dtype.name
        if name not in _DTYPES or (kind is not np.ndarray and kind is not np.dtype(name).type):
            raise NotPlain(f"is of type {kind.__name__} with dtype {value.dtype}; arrays of numbers travel")
        if kind is not np.ndarray:
            return ["scalar", name, _text(np.asarray(value))]
        axes = sorted(range(value.ndim), key=lambda i: -abs(value.strides[i]))  # slowest first, as it lies in memory
        return ["array", name, axes, list(value.shape), _text(value.transpose(axes))]
    raise NotPlain(
        f"is of type {kind.__name__}; what travels are numbers, text, Booleans, None, arrays, and lists, tuples and"
        " dicts of these"
    )


def _text(array: Any) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype=_DTYPES[array.dtype.name]).tobytes()).decode("ascii")


def _unpacked(packed: Any, depth: int) -> Any:
    if depth > DEEPEST or type(packed) is not list or not packed:
        raise NotPlain("holds something that is no value")
    kind, *parts = packed
    if kind == "none" and not parts:
        return None
    if kind == "bool" and type(parts[0]) is bool:
        return parts[0]
    if kind == "int" and type(parts[0]) is str and len(parts[0]) <= LONGEST_INTEGER + 1:
        return int(parts[0], 16)
    if kind == "float" and len(parts[0]) == 16:
        return struct.unpack("<d", bytes.fromhex(parts[0]))[0]
    if kind == "text" and type(parts[0]) is str:
        return parts[0]
    if kind in ("list", "tuple") and type(parts[0]) is list:
        inner = [_unpacked(p, depth + 1) for p in parts[0]]
        return inner if kind == "list" else tuple(inner)
    if kind == "dict":
        pairs = [(_unpacked(k, depth + 1), _unpacked(v, depth + 1)) for k, v in parts[0]]
        found = dict(pairs)
        if len(found) != len(pairs):
            raise NotPlain("has a dict with a key that comes twice")
        return found
    if kind == "scalar":
        return _array(parts[0], [], [], parts[1])[()]
    if kind == "array":
        return _array(*parts)
    raise NotPlain(f"holds something that is no value ({str(kind)[:40]!r})")


def _array(name: str, axes: list[int], shape: list[int], text: str) -> Any:
    dtype = _DTYPES[name]
    sizes = type(shape) is list and len(shape) <= 32 and all(type(n) is int and n >= 0 for n in shape)
    if not sizes or sorted(axes) != list(range(len(shape))):
        raise NotPlain("has an array with an invalid shape")
    try:
        data = base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        raise NotPlain("has an array that cannot be read") from None
    if math.prod(shape) * dtype.itemsize != len(data):
        raise NotPlain(f"has an array of shape {tuple(shape)} with {len(data)} bytes")
    if name == "bool" and not set(data) <= {0, 1}:
        raise NotPlain("has a Boolean that is neither true nor false")
    lying = np.frombuffer(data, dtype=dtype).astype(np.dtype(name)).reshape([shape[i] for i in axes])
    return lying.transpose(np.argsort(axes)) if axes else lying.reshape(shape)
