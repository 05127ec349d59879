"""Sampled signals as metrics take them: finite, and of the expected shape. Errors name the signal and the sample."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def finite_series(name: str, values: npt.ArrayLike) -> Array:
    """One channel, (n,)."""
    series = np.asarray(values, dtype=float)
    if series.ndim != 1 or not len(series):
        raise ValueError(f"{name} has shape {series.shape}; expected one value per sample")
    bad = np.flatnonzero(~np.isfinite(series))
    if len(bad):
        raise ValueError(f"{name} is {series[bad[0]]} at sample {bad[0]}")
    return series


def finite_channels(name: str, values: npt.ArrayLike) -> Array:
    """Several channels, (n, k)."""
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or 0 in array.shape:
        raise ValueError(f"{name} has shape {array.shape}; expected one row per sample, one column per channel")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        sample, channel = (int(k) for k in bad[0])
        raise ValueError(f"{name}[{channel}] is {array[sample, channel]} at sample {sample}")
    return array
