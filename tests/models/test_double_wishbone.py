"""Kinematics of double wishbones: the published figures, closed joints, splines, and what is refused."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from fmu_sources.models.double_wishbone import DoubleWishbone, HardpointError, Spline, rotation_vector
from fmu_sources.vehicles import load_wishbone_car

AXLES = ("front", "rear")


@pytest.fixture(scope="module")
def suspension():
    return load_wishbone_car("hmmwv_public").suspension


def ratio(mechanism, what, travel=0.0, by=1e-4):
    return -(getattr(mechanism.at(travel + by), what) - getattr(mechanism.at(travel - by), what)) / (2 * by)


@pytest.mark.parametrize(
    ("axle", "travel", "spring", "damper", "digits"),
    [
        ("front", 0.0, 0.45171, 0.45391, 5e-6),
        ("rear", 0.0, 0.43908, 0.44398, 5e-6),
        ("front", -0.1066, 0.496, 0.493, 1e-3),
        ("rear", -0.1111, 0.478, 0.483, 2e-3),
    ],  # rolling at rest
)
def test_motion_ratios_are_the_published_ones(suspension, axle, travel, spring, damper, digits):
    mechanism = getattr(suspension, axle).mechanism
    assert ratio(mechanism, "spring", travel) == pytest.approx(spring, abs=digits)
    assert ratio(mechanism, "damper", travel) == pytest.approx(damper, abs=digits)


def test_lengths_camber_toe_and_track_are_the_published_ones(suspension):
    front, rear = suspension.front.mechanism, suspension.rear.mechanism
    assert [m.at(0.0).spring for m in (front, rear)] == pytest.approx([0.246463, 0.306016], abs=1e-6)
    assert [m.at(0.0).damper for m in (front, rear)] == pytest.approx([0.372586, 0.364516], abs=1e-6)
    low = front.at(-0.155)
    # The published signs: top inwards and wheel outwards are positive; ours are those of ISO 8855.
    assert np.degrees([-low.camber, low.toe]) == pytest.approx([0.644, -3.172], abs=1e-3)
    assert low.wheel[1] == pytest.approx(0.83926, abs=1e-5)


@pytest.mark.parametrize("axle", AXLES)
@pytest.mark.parametrize("travel", [-0.15, -0.05, 0.02, 0.12])
def test_joints_stay_closed(suspension, axle, travel):
    """All six rods have the lengths that they have at design, with the joints where the position says."""
    mechanism = getattr(suspension, axle).mechanism
    p, now = mechanism.points, mechanism.at(travel)

    def moved(name):
        return now.wheel + now.turn @ (p[name] - p["wheel_centre"])

    assert now.wheel[2] - p["wheel_centre"][2] == pytest.approx(travel, abs=1e-12)
    assert now.turn @ now.turn.T == pytest.approx(np.eye(3), abs=1e-12)
    for fixed, moving in (
        ("upper_front", "upper_ball"),
        ("upper_rear", "upper_ball"),
        ("lower_front", "lower_ball"),
        ("lower_rear", "lower_ball"),
        ("tierod_inner", "tierod_outer"),
    ):
        assert np.linalg.norm(moved(moving) - p[fixed]) == pytest.approx(
            np.linalg.norm(p[moving] - p[fixed]), abs=1e-11
        )
    for arm in ("upper", "lower"):
        turned = p[f"{arm}_front"] + getattr(now, f"{arm}_turn") @ (p[f"{arm}_ball"] - p[f"{arm}_front"])
        assert turned == pytest.approx(getattr(now, f"{arm}_ball"), abs=1e-11)


def test_position_is_that_of_another_solver(suspension):
    """The same rods by least squares over wheel center and rotation vector, from the design position."""
    mechanism = suspension.front.mechanism
    p, travel = mechanism.points, -0.08
    rods = [
        ("upper_front", "upper_ball"),
        ("upper_rear", "upper_ball"),
        ("lower_front", "lower_ball"),
        ("lower_rear", "lower_ball"),
        ("tierod_inner", "tierod_outer"),
    ]

    def turned(vector, arm):
        angle = np.linalg.norm(vector)
        if angle == 0:
            return arm
        axis = vector / angle
        return arm * np.cos(angle) + np.cross(axis, arm) * np.sin(angle) + axis * (axis @ arm) * (1 - np.cos(angle))

    def errors(unknown):
        wheel = p["wheel_centre"] + unknown[:3]
        rest = [unknown[2] - travel]
        for fixed, moving in rods:
            now = wheel + turned(unknown[3:], p[moving] - p["wheel_centre"])
            rest.append(np.linalg.norm(now - p[fixed]) - np.linalg.norm(p[moving] - p[fixed]))
        return rest

    found = least_squares(errors, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    now = mechanism.at(travel)
    assert now.wheel - p["wheel_centre"] == pytest.approx(found[:3], abs=1e-9)
    assert rotation_vector(now.turn) == pytest.approx(found[3:], abs=1e-9)


@pytest.mark.parametrize("axle", AXLES)
def test_splines_hold_the_motion_of_the_mechanism(suspension, axle):
    part = getattr(suspension, axle)
    motion, mechanism = part.motion, part.mechanism
    assert motion.error < 1e-4
    for travel in np.linspace(part.travel.least.value, part.travel.most.value, 23):
        now = mechanism.at(travel)
        weights = motion.spline.matrix(np.array([travel]))[0]
        assert weights @ motion.spring == pytest.approx(now.spring, abs=1e-4)
        assert weights @ motion.outward == pytest.approx(now.wheel[1] - mechanism.points["wheel_centre"][1], abs=1e-4)
        assert weights @ motion.yaw == pytest.approx(now.rotation[2], abs=1e-4)


def test_basis_is_a_twice_differentiable_partition_of_one():
    spline = Spline(-1.0, 0.5, 9)
    low, high = spline.range
    at = np.linspace(low, high, 401)
    assert spline.matrix(at).sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert spline.matrix(at) @ spline.knots == pytest.approx(at, abs=1e-14)
    bend = np.diff(spline.matrix(at)[:, 4], 2) / (at[1] - at[0]) ** 2
    assert (
        np.abs(np.diff(bend)).max() < 0.2
    )  # no jump of a second derivative that reaches 8: it is linear between knots


def test_lumps_move_as_the_arm_does(suspension):
    arm = suspension.front.mechanism.arm("lower")
    mass, inertia = 23.965, 0.4
    at_ball, at_com, at_axis = arm.lumps(mass, inertia)
    part = arm.from_axis(arm.com) @ arm.from_axis(arm.ball) / arm.reach**2
    assert at_ball + at_com + at_axis == pytest.approx(mass, rel=1e-14)
    assert at_ball + at_com * part == pytest.approx(mass * part, rel=1e-14)
    about_axis = inertia + mass * np.sum(arm.from_axis(arm.com) ** 2)
    assert (at_ball + at_com * part**2) * arm.reach**2 == pytest.approx(about_axis, rel=1e-14)


def points(suspension, **changes):
    return {**suspension.front.mechanism.points, **{n: np.array(v) for n, v in changes.items()}}


def test_hardpoints_that_make_no_suspension_are_named(suspension, refused):
    good = points(suspension)
    refused(
        HardpointError,
        lambda: DoubleWishbone(points(suspension, upper_rear=good["upper_front"])),
        lambda: DoubleWishbone(points(suspension, lower_ball=(good["lower_front"] + good["lower_rear"]) / 2)),
        lambda: DoubleWishbone({n: v for n, v in good.items() if n not in ("spring_top", "tierod_outer")}),
    )


def test_travel_beyond_the_mechanism_does_not_close(suspension, raises):
    with raises(HardpointError):
        suspension.front.mechanism.at(-0.25)
