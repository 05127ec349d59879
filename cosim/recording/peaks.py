"""Thin a curve for drawing without losing its peaks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cosim.core.signals import Array


def keep_peaks(x: npt.ArrayLike, y: npt.ArrayLike, points: int = 2000) -> tuple[Array, Array]:
    """At most `points` samples of a curve, the lowest and the highest of every stretch among them, in their order.

    A curve that is thinned to every n-th sample loses impacts that fall in between; this one shows the extremes of its
    table.

    Args:
        x: abscissae (n,).
        y: samples (n,); one that is not a number is a gap and counts as no extreme.
        points: maximum number of samples of the result, at least 4.

    Raises:
        ValueError: `x` and `y` differ in length, or there are too few points.
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError(f"a curve has two equally long columns; these have shapes {x.shape} and {y.shape}")
    if points < 4:
        raise ValueError(f"{points} points cannot hold the ends and the extremes of a curve; give 4 at least")
    index = peak_index([y], points)
    return x[index], y[index]


def peak_index(signals: Sequence[npt.ArrayLike], points: int = 2000) -> npt.NDArray[np.intp]:
    """Samples to draw of signals on one time grid: in every stretch the lowest and the highest value of each signal.

    Args:
        signals: samples (n,) of each; values that are not a number are gaps and count as no extreme.
        points: most samples of the result, at least 2 more than twice the number of signals.

    Returns:
        Indices of the samples, rising, the first and the last among them; all if there are at most `points`.

    Raises:
        ValueError: the signals differ in length, or there are too few points.
    """
    columns = [np.asarray(s, dtype=float) for s in signals]
    n = len(columns[0])
    if any(c.shape != (n,) for c in columns):
        raise ValueError(f"signals of one grid have one length; these have shapes {[c.shape for c in columns]}")
    stretches = (points - 2) // (2 * len(columns))
    if stretches < 1:
        raise ValueError(f"{points} points cannot hold the ends and the extremes of {len(columns)} signals")
    if n <= points:
        return np.arange(n)
    kept = {0, n - 1}
    for start, end in pairwise(np.linspace(0, n, stretches + 1).astype(int)):
        for column in columns:
            part = column[start:end]
            if np.isnan(part).all():
                kept.add(int(start))
            else:
                kept |= {int(start + np.nanargmin(part)), int(start + np.nanargmax(part))}
    return np.array(sorted(kept))
