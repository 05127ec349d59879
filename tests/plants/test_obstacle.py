"""Obstacle outlines: discs, points and corners against the geometry worked out by hand."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fmu_sources.plants.obstacle import Outline

RADIUS = 0.62
LENGTH, DEPTH = 1.4, 0.8
TRENCH = [0.0, 0.0, LENGTH, LENGTH], [0.0, -DEPTH, -DEPTH, 0.0]


def pushes(outline: tuple[list[float], list[float]], x: float, z: float) -> np.ndarray:
    """Depth times normal of each contact (n, 2), shares taken into account."""
    touches = Outline(*outline).disc(ca.SX(x), ca.SX(z), RADIUS)
    rows = [[float(ca.evalf(v)) for v in (t.depth, t.nx, t.nz, t.share)] for t in touches]
    return np.array([[max(0.0, d) * s * nx, max(0.0, d) * s * nz] for d, nx, nz, s in rows])


def by_solids(x: float, z: float) -> np.ndarray:
    """The same for a trench: closest point on left quarter-plane, right quarter-plane and floor, forces add up."""
    total = np.zeros(2)
    for cx, cz in ((min(x, 0.0), min(z, 0.0)), (max(x, LENGTH), min(z, 0.0)), (x, min(z, -DEPTH))):
        offset = np.array([x - cx, z - cz])
        distance = np.hypot(*offset)
        total += max(0.0, RADIUS - distance) * offset / distance
    return total


@settings(max_examples=150, deadline=None)
@given(x=st.floats(-2.0, 3.5), z=st.floats(-DEPTH + 0.05, 1.0))
def test_a_disc_against_a_trench(x: float, z: float) -> None:
    assume(z >= 0.02 or 0.02 < x < LENGTH - 0.02)  # otherwise the center is inside the ground
    np.testing.assert_allclose(pushes(TRENCH, x, z).sum(axis=0), by_solids(x, z), atol=1e-7)


@pytest.mark.parametrize("bend", [1e-7, 0.01, -0.01])
def test_a_nearly_straight_road_pushes_once(bend: float) -> None:
    """A slight valley or crest, or points along a straight line, change the force a little, not by a factor."""
    outline = [-1.0, 0.0, 1.0, 2.0], [bend, 0.0, bend, 0.0]
    for x in (-0.02, -0.001, 0.0, 0.001, 0.02):
        push = pushes(outline, x, RADIUS - 0.04).sum(axis=0)
        assert push[1] == pytest.approx(0.04, rel=0.03)
        assert abs(push[0]) < 0.02 * push[1]


@pytest.mark.parametrize("slope", [0.2, 0.7, 1.5, 4.0])
def test_pushes_in_a_corner_have_a_potential(slope: float) -> None:
    """At a concave corner the force is the gradient of an energy: its curl vanishes."""
    outline = [-3.0, 0.0, 1.0, 3.0], [3.0 * slope, 0.0, 0.0, 0.0]
    rise = np.hypot(1.0, slope)
    corner = ((RADIUS - 0.03) * (rise - 1) / slope, RADIUS - 0.03)  # touches both sides
    rng, h = np.random.default_rng(1), 1e-6
    both = 0
    for x, z in corner + rng.uniform(-0.02, 0.02, (20, 2)):
        near = pushes(outline, x, z)
        both += (np.hypot(*near.T) > 1e-6).sum() > 1
        dz_dx = (pushes(outline, x + h, z) - pushes(outline, x - h, z)).sum(axis=0)[1]
        dx_dz = (pushes(outline, x, z + h) - pushes(outline, x, z - h)).sum(axis=0)[0]
        assert dz_dx == pytest.approx(dx_dz, abs=2 * h)
    assert both > 3


def test_points_below_the_ground() -> None:
    trench = Outline(*TRENCH)
    for (x, z), depth, way in (
        ((-0.5, -0.02), 0.02, (0, 1)),
        ((-0.03, -0.4), 0.03, (1, 0)),
        ((LENGTH + 0.05, -0.3), 0.05, (-1, 0)),
        ((0.5, -DEPTH - 0.1), 0.1, (0, 1)),
        ((0.5, -0.1), 0.0, None),
        ((-0.5, 0.1), 0.0, None),
    ):
        found, nx, nz = (float(ca.evalf(v)) for v in trench.point(ca.SX(x), ca.SX(z)))
        assert found == pytest.approx(depth, abs=1e-9)
        if way is not None:
            assert (nx, nz) == pytest.approx(way, abs=1e-9)


def test_heights() -> None:
    outline = Outline([0.0, 1.0, 1.0, 3.0], [0.0, 0.5, -1.0, 0.2])
    for x, height in ((-5.0, 0.0), (0.5, 0.25), (0.999, 0.4995), (1.001, -0.9994), (2.0, -0.4), (9.0, 0.2)):
        assert float(ca.evalf(outline.height(ca.SX(x)))) == pytest.approx(height, abs=1e-9)


def test_corners() -> None:
    outline = Outline([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 0.0, -1.0, -1.0, 0.0])
    assert [bool(ca.evalf(ca.SX(c))) for c in outline.convex] == [False, True, False, False, True]
    assert [bool(ca.evalf(ca.SX(c))) for c in outline.concave] == [False, False, True, True, False]
