"""Checks that the design modules share; each message names the argument."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import finite

Array = npt.NDArray[np.float64]


def finite_array(name: str, value: npt.ArrayLike, ndim: int | None = None) -> Array:
    """A read-only copy of `value`; ValueError for a value that is not finite, or another number of dimensions."""
    array = np.array(value, dtype=float)  # a copy, made read-only: a model or control law never changes once it exists
    array.setflags(write=False)
    if ndim is not None and array.ndim != ndim:
        raise ValueError(f"{name} has {array.ndim} dimensions, shape {array.shape}; expected {ndim}")
    finite(name, array)
    return array


def signal(name: str, value: npt.ArrayLike | None, width: int | None = None) -> Array:
    """A recorded signal, one row per sample."""
    if value is None:
        raise ValueError(f"{name} is missing: the model has {width} of them")
    array = np.array(value, dtype=float)
    if array.ndim != 2 or (width is not None and array.shape[1] != width):
        columns = "columns" if width is None else f"{width} columns"
        raise ValueError(f"{name} has shape {array.shape}; expected one row per sample and {columns}")
    finite(name, array, sampled=True)
    return array


def rows(name: str, value: npt.ArrayLike | None, rows: int, width: int) -> Array:
    """A history or future with one row per instant, given as such, flattened, or None for zeros."""
    if value is None:
        return np.zeros((rows, width))
    array = np.asarray(value, dtype=float)
    if array.shape not in ((rows, width), (rows * width,)):
        raise ValueError(f"{name} has shape {array.shape}; expected ({rows}, {width}) or ({rows * width},)")
    return array.reshape(rows, width)
