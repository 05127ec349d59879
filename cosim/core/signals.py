"""Checks sampled signals for metrics: finite values and shape, with errors that name the signal and the sample.

It also has what every study uses: RMS and peak, and the signals of several corners as one array.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import finite

Array = npt.NDArray[np.float64]


def finite_series(name: str, values: npt.ArrayLike) -> Array:
    """One channel, (n,)."""
    series = np.asarray(values, dtype=float)
    if series.ndim != 1 or not len(series):
        raise ValueError(f"{name} has shape {series.shape}; expected one value per sample")
    finite(name, series, sampled=True)
    return series


def finite_channels(name: str, values: npt.ArrayLike) -> Array:
    """Several channels, (n, k)."""
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or 0 in array.shape:
        raise ValueError(f"{name} has shape {array.shape}; expected one row per sample, one column per channel")
    finite(name, array, sampled=True)
    return array


def rms(values: npt.ArrayLike) -> float:
    """Root mean square over all samples and channels."""
    return float(np.sqrt(np.mean(np.square(values))))


def peak(values: npt.ArrayLike, *, name: str = "signal") -> float:
    """Largest magnitude over the run, of a signal (n,) or of all channels of one (n, k), which must be finite."""
    array = np.asarray(values, dtype=float)
    return float(np.max(np.abs(finite_series(name, array) if array.ndim == 1 else finite_channels(name, array))))


def columns(recording: Any, pattern: str, names: Iterable[str], *, optional: bool = False) -> Array:
    """Recorded signals (samples, k), such as those of "car.tire.{}.force" at all corners.

    `optional`: zeros if they were not recorded, such as forces without a controller.
    """
    found = [pattern.format(name) for name in names]
    if optional and found[0] not in recording:
        return np.zeros((len(recording), len(found)))
    return np.column_stack([recording[name] for name in found])
