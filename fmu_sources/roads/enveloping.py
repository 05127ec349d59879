"""What the center of a rolling wheel follows: the path of a rigid disc over a profile, less its radius.

A point follower would meet the wall of a short obstacle as a step, which no tire does: a half-round of 8 inches is
shorter than its contact. A disc rolls onto it instead, and bridges waves shorter than itself. Tires also give way at an
edge, so obstacles are a little milder than this (a rule of the contact's area is in models with their own contact).
"""

from __future__ import annotations

import numpy as np

from build_fmus.base.checks import number


def rolled(heights: np.ndarray, step: float, radius: float) -> np.ndarray:
    """Heights (n,) [m] of the lowest point of a disc of `radius` [m] that rolls over heights (n,) [m].

    Heights are `step` [m] apart, and held outside. The highest of all points under the disc decides: `max over |s| <
    radius of z(x + s) - (radius - sqrt(radius^2 - s^2))`. With radius 0 the heights themselves.
    """
    number("radius of the wheel", radius, "m", least=0)
    reach = int(radius / step)
    offsets = np.arange(-reach, reach + 1)
    drop = radius - np.sqrt(np.maximum(radius**2 - (offsets * step) ** 2, 0.0))
    padded = np.pad(np.asarray(heights, dtype=float), reach, mode="edge")
    return np.max(
        [padded[reach + o : reach + o + len(heights)] - d for o, d in zip(offsets, drop, strict=True)], axis=0
    )
