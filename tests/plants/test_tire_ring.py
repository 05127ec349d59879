"""The direction in which a road bears a tire over an obstacle: three rules beside an elastic ring."""

import numpy as np
import pytest
from oracles.tire_contact import RULES, AreaContact, Ring, half_round, pushed_share, turned_from

from fmu_sources.vehicles import load_wishbone_car

INCH = 0.0254
TIRE = load_wishbone_car("hmmwv_public").tire
RADIUS = TIRE.radius.value
STIFFNESS = TIRE.force.value[1] / TIRE.deflection.value[1]  # N/m
AT_REST = 0.0158  # m, deflection of a front tire
STIFF = 1e6  # bending of a belt that keeps its shape


def ring(bending):
    return Ring(RADIUS, STIFFNESS * AT_REST, AT_REST, bending)


@pytest.mark.parametrize("depth", [0.02, 0.05, 0.1])
def test_ring_without_bending_is_a_row_of_radial_springs(depth):
    springs = ring(0.0)
    z = RADIUS - depth
    half = np.arccos(z / RADIUS)
    exact = springs.stiffness * RADIUS * 2 * (RADIUS * np.sin(half) - z * half)
    back, up = springs.force(0.0, z, 0.0)
    assert up == pytest.approx(exact, rel=0.02)
    assert back == pytest.approx(0.0, abs=1e-9 * up)


def test_stiff_ring_touches_a_half_round_where_a_disc_does():
    """At one point, so the force is along the line from the middle of the half-round to the wheel center."""
    height, x = 8 * INCH, -0.3
    z = float(np.sqrt((RADIUS + height) ** 2 - x**2)) - 1e-3
    back, up = ring(STIFF).force(x, z, height)
    assert np.degrees(np.arctan2(back, up)) == pytest.approx(np.degrees(np.arctan2(x, z)), abs=1.5)


@pytest.mark.parametrize("bending", [0.01, 1.0])
def test_loads_of_a_bending_ring_are_as_linear_as_the_table_of_the_tire(bending):
    """And those of radial springs are not: the table excludes them."""

    def relative(ring):
        depths = np.array([0.005, 0.0316, 0.05])
        return np.array([ring.force(0.0, RADIUS - d, 0.0)[1] for d in depths]) / (STIFFNESS * depths)

    assert relative(ring(bending)) == pytest.approx(1.0, abs=0.01)
    assert np.abs(relative(ring(0.0)) - 1).min() > 0.15


@pytest.mark.parametrize("inches", [4, 8, 10])
def test_road_neither_gives_nor_takes_energy_from_a_ring(inches):
    height, tire = inches * INCH, ring(0.01)
    share = pushed_share(lambda x, z: tire.force(x, z, height), RADIUS, STIFFNESS * AT_REST, height)
    assert share == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("bending", [0.01, 1.0])
@pytest.mark.parametrize("pressed", [AT_REST, 0.05])
@pytest.mark.parametrize("inches", [4, 8, 10])
def test_ring_bears_the_wheel_along_the_gradient_of_the_swept_area(inches, pressed, bending):
    tire = ring(bending)
    off = {r: np.sqrt(np.mean(turned_from(tire, r, inches * INCH, pressed)[0] ** 2)) for r in RULES}
    assert off["swept area"] < 9
    assert off["road normal"] > 20
    assert off["point behind"] > 20


def test_point_behind_lifts_a_wheel_without_slowing_it_down():
    height = 10 * INCH
    share = {
        rule: pushed_share(
            AreaContact(RADIUS, rule).force(half_round(height, -height), STIFFNESS),
            RADIUS,
            STIFFNESS * AT_REST,
            height,
        )
        for rule in RULES
    }
    assert share["swept area"] == pytest.approx(1.0, abs=0.05)
    assert share["point behind"] < 0.5


def test_rules_agree_on_a_flat_road():
    for rule in RULES:
        touch = AreaContact(RADIUS, rule).at(np.zeros_like, 0.0, RADIUS - 0.05)
        assert touch.depth == pytest.approx(0.05, rel=0.01)
        assert touch.normal == pytest.approx([0, 0, 1], abs=1e-12)


def test_rule_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="rule = 'normal' is not one of road normal, point behind, swept area"):
        AreaContact(RADIUS, "normal")
