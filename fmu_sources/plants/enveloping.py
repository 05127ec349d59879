"""Contact of a tire with a road that is uneven within the length of the contact.

A wheel that touches a half-round does not follow the profile below its center: it rests on whatever its circumference
reaches. The rule is that of the published open multibody models: the area of the tire's disc below the profile is
turned into the depth at which the same disc has that area below a flat road, and this depth bears the load. The profile
is known at equal steps along the disc, so areas are sums of strips, on the road as on the flat road that they are
compared with: on a flat road the depth is exact whatever the steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

CONTACT_STEP, CONTACT_COUNT = 0.03, 31
"""Distance [m] between the heights below a disc and their number, an odd one: 0.45 m to either side of the wheel
center.
"""
SLOPE_BASE = 0.05
"""Length [m] ahead of the wheel center over which the direction of the road's normal is taken, as in the public model.
"""


@dataclass(frozen=True)
class Disc:
    """A disc of a radius (symbol [m]) over heights `step` (symbol [m]) apart."""

    radius: Any
    step: Any
    count: int

    @property
    def _offsets(self) -> np.ndarray:
        """Of the heights from the middle one, in steps."""
        return np.arange(self.count) - self.count // 2

    def _rise(self, offset: int) -> Any:
        """How much higher than its lowest point the disc's edge is at an offset [m]."""
        return self.radius - ca.sqrt(ca.fmax(0, self.radius**2 - (int(offset) * self.step) ** 2))

    def area(self, height: Any, profile: Any) -> Any:
        """Area [m2] of the disc below a profile.

        `height` of the disc's center [m] is above the middle of the profile, whose heights count from there.
        """
        lowest = height - self.radius
        return self.step * sum(ca.fmax(0, profile[i] - lowest - self._rise(n)) for i, n in enumerate(self._offsets))

    def depth(self, area: Any) -> Any:
        """Depth [m] of the disc below a flat road at which it has that area [m2] below it."""
        rises = [self._rise(n) for n in range(self.count // 2 + 1)]
        total: Any = 0
        start: Any = 0  # area at which the next strips dip in
        for n, rise in enumerate(rises):
            width = (2 * n + 1) * self.step
            reached = ca.fmax(0, area - start)
            if n < len(rises) - 1:
                gain = (rises[n + 1] - rise) * width
                reached = ca.fmin(gain, reached)
                start += gain
            total += reached / width
        return total
