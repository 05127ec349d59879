"""Thin a curve for drawing without losing its peaks."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cosim.signals import Array


def keep_peaks(x: npt.ArrayLike, y: npt.ArrayLike, points: int = 2000) -> tuple[Array, Array]:
    """At most ``points`` samples of a curve, the lowest and the highest of every stretch among them, in their order.

    A curve that is thinned to every n-th sample loses impacts that fall in between; this one shows the extremes of its
    table.

    Args:
        x, y: samples (n,); a ``y`` that is not a number is a gap and counts as no extreme.
        points: most samples of the result, at least 4.

    Raises:
        ValueError: ``x`` and ``y`` differ in length, or there are too few points.
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if x.shape != y.shape or x.ndim != 1:
        raise ValueError(f"a curve has two equally long columns; these have shapes {x.shape} and {y.shape}")
    if points < 4:
        raise ValueError(f"{points} points cannot hold the ends and the extremes of a curve; give 4 at least")
    n = len(y)
    if n <= points:
        return x, y
    edges = np.linspace(0, n, (points - 2) // 2 + 1).astype(int)
    kept = {0, n - 1}
    for start, end in pairwise(edges):
        part = y[start:end]
        if np.isnan(part).all():
            kept.add(int(start))
        else:
            kept |= {int(start + np.nanargmin(part)), int(start + np.nanargmax(part))}
    index = np.array(sorted(kept))
    return x[index], y[index]
