"""Central differences that derivatives are compared with: of smooth functions, and where there are none."""

from __future__ import annotations

import math

import pytest

from cosim.check.derivatives import difference


@pytest.mark.parametrize("at", [-0.7, 0.0, 1.3])
def test_of_a_smooth_function(at: float) -> None:
    found = difference(lambda x: [math.sin(x), 100.0 * x, math.exp(3 * x), 5.0], at, 1.0)
    assert found == pytest.approx([math.cos(at), 100.0, 3 * math.exp(3 * at), 0.0], rel=1e-4)


def test_none_at_a_kink_or_a_jump() -> None:
    """At the point itself both differences are the mean of the slopes, and agree; beside it the slope is there."""
    assert difference(lambda x: [max(x, 0.0)], 0.0, 1.0) is None
    assert difference(lambda x: [float(x >= 0)], 0.0, 1.0) is None
    assert difference(lambda x: [max(x, 0.0)], 0.3, 1.0) == pytest.approx([1.0])
