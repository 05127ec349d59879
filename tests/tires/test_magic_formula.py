"""Forces of Magic Formula tires by group of coefficients: each property follows from the published form alone."""

from dataclasses import replace
from math import atan, cos, exp, pi, sin, tan

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from fmu_sources.tires import magic_formula
from fmu_sources.tires.magic_formula import MagicFormula
from fmu_sources.tires.tir_file import read_tire
from fmu_sources.vehicles import loader

FOLDER = loader._HERE.parent / "tires"
TIRES = {name: read_tire(FOLDER / f"{name}.tir") for name in ("hmmwv", "sedan", "truck")}
SHIFTS = (
    *("PHX1", "PHX2", "PVX1", "PVX2", "PHY1", "PHY2", "PHY3", "PVY1", "PVY2", "PVY3", "PVY4", "RHX1", "RHY1", "RHY2"),
    *("RVY1", "RVY2", "RVY3", "PEX4", "PEY3", "PEY4", "RBY3", "QHZ1", "QHZ2", "QHZ3", "QHZ4", "QDZ6", "QDZ7", "QSX1"),
    *("QEZ4", "SSZ1"),
)


def with_(tire, **values):
    return replace(tire, values={**tire.values, **values})


def centered(tire):
    """The tire without what makes it asymmetric."""
    return with_(tire, **dict.fromkeys(SHIFTS, 0.0))


def forces(tire, load=None, slip=0.0, angle=0.0, inclination=0.0, speed=30.0, side=1):
    """As numbers; the slip angle in radians."""
    load = tire.values["FNOMIN"] if load is None else load
    found = MagicFormula(tire).forces(load, slip, tan(angle), inclination, speed, side)
    return {name: float(value) for name, value in vars(found).items()}


@pytest.fixture(params=TIRES)
def tire(request):
    return TIRES[request.param]


def slope(tire, what, by, **at):
    step = 1e-6
    return (forces(tire, **{**at, by: step})[what] - forces(tire, **{**at, by: -step})[what]) / (2 * step)


LOADS = (0.3, 0.7, 1.0, 1.6)  # by the nominal load


# ------------------------ longitudinal: PCX..PVX


@pytest.mark.parametrize("part", LOADS)
def test_slip_stiffness_is_the_slope_without_slip(tire, part):
    v, load = tire.values, part * tire.values["FNOMIN"]
    expected = load * (v["PKX1"] + v["PKX2"] * (part - 1)) * exp(v["PKX3"] * (part - 1))
    assert slope(centered(tire), "fx", "slip", load=load) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("part", LOADS)
@pytest.mark.parametrize("inclination", [0.0, 0.1])
def test_largest_longitudinal_force_is_friction_times_load(tire, part, inclination):
    v, load = tire.values, part * tire.values["FNOMIN"]
    lean = inclination if tire.version == 5 else sin(inclination)
    friction = (v["PDX1"] + v["PDX2"] * (part - 1)) * (1 - v["PDX3"] * lean**2)
    found = minimize_scalar(
        lambda k: -forces(centered(tire), load, slip=k, inclination=inclination)["fx"],
        bounds=(0.01, 0.9), method="bounded", options={"xatol": 1e-12},
    )  # fmt: skip
    assert -found.fun == pytest.approx(friction * load, rel=1e-9)


def test_shape_decides_the_force_far_beyond_the_peak(tire):
    v = tire.values
    wide = with_(centered(tire), KPUMAX=1e9, PEX1=0.0, PEX2=0.0, PEX3=0.0)
    assert forces(wide, slip=1e8)["fx"] == pytest.approx(v["PDX1"] * v["FNOMIN"] * sin(v["PCX1"] * pi / 2), rel=1e-6)


def test_curvature_moves_the_peak(tire):
    v = tire.values
    found = minimize_scalar(
        lambda k: -forces(centered(tire), slip=k)["fx"], bounds=(0.01, 0.9), method="bounded", options={"xatol": 1e-12}
    )
    stiffness = v["PKX1"] / v["PCX1"] / v["PDX1"]  # B
    bx = brentq(lambda x: v["PCX1"] * atan(x - v["PEX1"] * (x - atan(x))) - pi / 2, 0, 100)
    assert found.x == pytest.approx(bx / stiffness, rel=1e-5)


@pytest.mark.parametrize("part", LOADS)
def test_longitudinal_shifts(tire, part):
    v, load = tire.values, part * tire.values["FNOMIN"]
    at = -(v["PHX1"] + v["PHX2"] * (part - 1))
    lift = load * (v["PVX1"] + v["PVX2"] * (part - 1))
    assert forces(tire, load, slip=at)["fx"] == pytest.approx(lift, abs=1e-9 * load)


# ------------------------ lateral: PCY to PVY


@pytest.mark.parametrize("part", LOADS)
@pytest.mark.parametrize("inclination", [0.0, 0.1])
def test_cornering_stiffness_is_the_slope_without_slip(tire, part, inclination):
    v, load = tire.values, part * tire.values["FNOMIN"]
    lean = inclination if tire.version == 5 else sin(inclination)
    top = v["PKY2"] + v["PKY5"] * lean**2
    expected = v["PKY1"] * v["FNOMIN"] * sin(v["PKY4"] * atan(part / top)) * (1 - v["PKY3"] * abs(lean))
    without = with_(centered(tire), PKY6=0.0, PKY7=0.0)  # camber moves the curve
    assert slope(without, "fy", "angle", load=load, inclination=inclination) == pytest.approx(expected, rel=1e-7)
    assert expected < 0  # the force opposes the slip


@pytest.mark.parametrize("part", LOADS)
def test_largest_side_force_is_friction_times_load(tire, part):
    v, load = tire.values, part * tire.values["FNOMIN"]
    found = minimize_scalar(
        lambda a: forces(centered(tire), load, angle=a)["fy"], bounds=(0.01, 0.65), method="bounded",
        options={"xatol": 1e-12},
    )  # fmt: skip
    assert -found.fun == pytest.approx((v["PDY1"] + v["PDY2"] * (part - 1)) * load, rel=1e-9)


@pytest.mark.parametrize("part", LOADS)
def test_camber_gives_a_force_without_slip(part):
    """Of 6.1: PKY6, PKY7 are the slope of the force by the inclination."""
    tire = TIRES["hmmwv"]
    v, load = tire.values, part * tire.values["FNOMIN"]
    still = with_(tire, **{n: 0.0 for n in SHIFTS if n not in ("PVY3", "PVY4")})
    expected = load * (v["PKY6"] + v["PKY7"] * (part - 1))
    assert slope(still, "fy", "inclination", load=load) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("name", ["sedan", "truck"])
def test_camber_shifts_the_curve_of_version_5(name):
    tire, lean = TIRES[name], 0.05
    v = tire.values
    at = -(v["PHY1"] + v["PHY3"] * lean)
    lift = v["FNOMIN"] * (v["PVY1"] + v["PVY3"] * lean)
    without = with_(tire, RVY1=0.0, RVY2=0.0, RVY3=0.0)
    assert forces(without, angle=at, inclination=lean)["fy"] == pytest.approx(lift, abs=1e-9 * v["FNOMIN"])


def test_the_larger_of_two_slips_has_the_same_sides(tire):
    """Without shifts a tire is symmetric."""
    flat = centered(tire)
    for angle, slip in ((0.05, 0.0), (0.2, -0.1), (0.6, 0.4)):
        left, right = forces(flat, angle=angle, slip=slip), forces(flat, angle=-angle, slip=slip)
        for name in ("fy", "mz"):
            assert left[name] == pytest.approx(-right[name], rel=1e-12, abs=1e-9)
        assert left["fx"] == right["fx"]


def test_on_the_other_side_forces_are_mirrored_to_the_last_bit(tire):
    for angle, slip, lean in ((0.05, 0.01, 0.02), (-0.2, -0.1, -0.05), (0.6, 0.4, 0.0)):
        here = forces(tire, angle=angle, slip=slip, inclination=lean, side=1)
        there = forces(tire, angle=-angle, slip=slip, inclination=-lean, side=-1)
        for name, sign in (("fx", 1), ("fy", -1), ("mx", -1), ("my", 1), ("mz", -1), ("relaxation_y", 1)):
            assert here[name] == sign * there[name]


# ------------------------ combined slip: RBX..RVY


def test_without_slip_of_the_other_direction_nothing_is_taken_away(tire):
    pure = with_(tire, RBX1=0.0, RBX3=0.0, RBY1=0.0, RBY4=0.0)
    assert forces(tire, slip=0.07)["fx"] == pytest.approx(forces(pure, slip=0.07)["fx"], rel=1e-14)
    still = with_(tire, RVY1=0.0, RVY2=0.0, RVY3=0.0)
    assert forces(still, angle=0.07)["fy"] == pytest.approx(forces(pure, angle=0.07)["fy"], rel=1e-14)


def test_combined_forces_are_weighted_by_their_cosines(tire):
    v, flat, slip, angle = tire.values, centered(tire), 0.05, 0.08
    x = tan(angle) if tire.version == 6 else angle

    def weight(slope, shape, curvature, at):
        return cos(shape * atan(slope * at - curvature * (slope * at - atan(slope * at))))

    by_angle = weight(v["RBX1"] * cos(atan(v["RBX2"] * slip)), v["RCX1"], v["REX1"], x)
    by_slip = weight(v["RBY1"] * cos(atan(v["RBY2"] * x)), v["RCY1"], v["REY1"], slip)
    both = forces(flat, slip=slip, angle=angle)
    assert both["fx"] == pytest.approx(by_angle * forces(flat, slip=slip)["fx"], rel=1e-12)
    assert both["fy"] == pytest.approx(by_slip * forces(flat, angle=angle)["fy"], rel=1e-12)


def test_combined_forces_stay_within_friction(tire):
    """The weights are fits, not a circle; within 12 % of the ellipse of the pure peaks they stay on it or inside."""
    v, flat = tire.values, centered(tire)
    for slip in np.linspace(-0.5, 0.5, 21):
        for angle in np.linspace(-0.5, 0.5, 21):
            both = forces(flat, slip=slip, angle=angle)
            ellipse = (both["fx"] / v["PDX1"]) ** 2 + (both["fy"] / v["PDY1"]) ** 2
            assert ellipse <= (1.12 * v["FNOMIN"]) ** 2


def test_slip_induces_a_side_force():
    v = TIRES["sedan"].values
    only = with_(centered(TIRES["sedan"]), RVY1=v["RVY1"])
    slip = 0.06
    expected = v["PDY1"] * v["FNOMIN"] * v["RVY1"] * sin(v["RVY5"] * atan(v["RVY6"] * slip))
    assert forces(only, slip=slip)["fy"] == pytest.approx(expected, rel=1e-12)


# ------------------------ moments: QBZ to QSY


@pytest.mark.parametrize("part", LOADS)
def test_pneumatic_trail_is_the_lever_of_small_side_forces(tire, part):
    v, load = tire.values, part * tire.values["FNOMIN"]
    trail = part * v["UNLOADED_RADIUS"] * (v["QDZ1"] + v["QDZ2"] * (part - 1))
    flat = with_(centered(tire), QDZ8=0.0, QDZ9=0.0)
    small = 1e-5
    assert -forces(flat, load, angle=small)["mz"] / forces(flat, load, angle=small)["fy"] == pytest.approx(
        trail, rel=1e-6
    )


def test_trail_over_the_slip_angle(tire):
    """Slope, shape, shift and curvature of the trail, written out, at no residual moment."""
    v, angle = tire.values, 0.06
    own = with_(centered(tire), QHZ1=0.004, QEZ1=-1.4, QEZ4=0.3, QDZ8=0.0, QDZ9=0.0)
    x = (tan(angle) if tire.version == 6 else angle) + 0.004
    curvature = -1.4 * (1 + 0.3 * 2 / pi * atan(v["QBZ1"] * v["QCZ1"] * x))
    bx = v["QBZ1"] * x
    trail = v["UNLOADED_RADIUS"] * v["QDZ1"] * cos(v["QCZ1"] * atan(bx - curvature * (bx - atan(bx)))) * cos(angle)
    found = forces(own, angle=angle)
    assert found["mz"] == pytest.approx(-trail * found["fy"], rel=1e-12)


def test_aligning_moment_turns_the_wheel_into_its_velocity(tire):
    """The contact slides to the left, the wheel turns to the left."""
    assert forces(centered(tire), angle=0.02)["mz"] > 0


@pytest.mark.parametrize("part", LOADS)
def test_residual_moment_where_there_is_no_side_force(part):
    tire = TIRES["hmmwv"]
    v, load = tire.values, part * tire.values["FNOMIN"]
    flat = with_(centered(tire), QDZ6=v["QDZ6"], QDZ7=v["QDZ7"])
    expected = load * v["UNLOADED_RADIUS"] * (v["QDZ6"] + v["QDZ7"] * (part - 1))
    assert forces(flat, load)["mz"] == pytest.approx(expected, rel=1e-9)


def test_longitudinal_force_has_a_lever():
    tire = TIRES["sedan"]
    v = tire.values
    flat = with_(centered(tire), SSZ1=v["SSZ1"])
    found = forces(flat, slip=0.05)
    assert found["mz"] == pytest.approx(v["UNLOADED_RADIUS"] * v["SSZ1"] * found["fx"], rel=1e-12)


def test_overturning_moment(tire):
    v = tire.values
    found, lean = forces(tire, angle=0.05, inclination=0.04), 0.04 if tire.version == 5 else sin(0.04)
    by_lean = v["QSX1"] - v["QSX2"] * lean + v["QSX3"] * found["fy"] / v["FNOMIN"]
    assert found["mx"] == pytest.approx(v["UNLOADED_RADIUS"] * v["FNOMIN"] * by_lean, rel=1e-12)
    curved = with_(TIRES["hmmwv"], QSX4=0.02, QSX5=1.5, QSX6=0.8, QSX7=0.5, QSX8=0.6, QSX9=1.2, QSX10=0.1, QSX11=2.0)
    more = (
        forces(curved, angle=0.05, inclination=0.04)["mx"] - forces(TIRES["hmmwv"], angle=0.05, inclination=0.04)["mx"]
    )
    v = curved.values
    side = forces(curved, angle=0.05, inclination=0.04)["fy"] / v["FNOMIN"]
    expected = 0.02 * cos(1.5 * atan(0.8) ** 2) * sin(0.5 * sin(0.04) + 0.6 * atan(1.2 * side)) + 0.1 * atan(2) * sin(
        0.04
    )
    assert more == pytest.approx(v["UNLOADED_RADIUS"] * v["FNOMIN"] * expected, rel=1e-9)


def test_rolling_resistance(tire):
    v, speed = tire.values, 25.0
    found = forces(tire, slip=0.01, speed=speed)
    by_speed = v["QSY3"] * speed / v["LONGVL"] + v["QSY4"] * (speed / v["LONGVL"]) ** 4
    whole = v["QSY1"] + v["QSY2"] * found["fx"] / v["FNOMIN"] + by_speed
    assert found["my"] == pytest.approx(-v["UNLOADED_RADIUS"] * v["FNOMIN"] * whole, rel=1e-12)
    assert forces(tire, slip=0.01, speed=-speed)["my"] == pytest.approx(-found["my"], rel=1e-12)
    assert forces(tire, speed=0.0)["my"] == 0


# ------------------------ loads, pressure, relaxation


@pytest.mark.parametrize(("group", "what", "at", "expected"), [
    ({"PPX1": -0.3, "PPX2": 0.2}, "fx", {"by": "slip"}, 1 - 0.3 * 0.1 + 0.2 * 0.01),
    ({"PPY1": 0.3, "PPY2": 0.0}, "fy", {"by": "angle"}, 1 + 0.3 * 0.1),
])  # fmt: skip
def test_pressure_changes_stiffness(tire, group, what, at, expected):
    zero = {f"PP{axis}{i}": 0.0 for axis in "XY" for i in range(1, 6) if f"PP{axis}{i}" in tire.values}
    nominal = with_(centered(tire), **{**zero, **group, "INFLPRES": 2e5, "NOMPRES": 2e5})
    harder = with_(nominal, INFLPRES=2.2e5)
    assert slope(harder, what, **at) == pytest.approx(expected * slope(nominal, what, **at), rel=1e-7)


def test_light_and_heavy_loads_keep_the_proportion(tire):
    v = tire.values
    for bound, factors in ((max(v["FZMIN"], magic_formula.LEAST_LOAD * v["FNOMIN"]), (0.0, 0.5)), (v["FZMAX"], (1.5,))):
        at = forces(tire, bound, slip=0.03, angle=0.04)
        for factor in factors:
            found = forces(tire, factor * bound, slip=0.03, angle=0.04)
            for name in ("fx", "fy", "mx", "my", "mz"):
                assert found[name] == pytest.approx(factor * at[name], rel=1e-12, abs=1e-12)


def test_beyond_the_slips_of_the_file_forces_stay(tire):
    v = tire.values
    assert forces(tire, slip=5.0)["fx"] == forces(tire, slip=v["KPUMAX"])["fx"]
    assert forces(tire, angle=1.2)["fy"] == pytest.approx(forces(tire, angle=v["ALPMAX"])["fy"], rel=1e-12)


def test_relaxation_lengths():
    v = TIRES["sedan"].values
    part, load = 1.3, 1.3 * v["FNOMIN"]
    found = forces(TIRES["sedan"], load)
    assert found["relaxation_x"] == pytest.approx(
        part * (v["PTX1"] + v["PTX2"] * 0.3) * exp(v["PTX3"] * 0.3) * v["UNLOADED_RADIUS"], rel=1e-12
    )
    assert found["relaxation_y"] == pytest.approx(
        v["PTY1"] * sin(2 * atan(part / v["PTY2"])) * v["UNLOADED_RADIUS"], rel=1e-12
    )
    v = TIRES["hmmwv"].values
    found = forces(TIRES["hmmwv"])
    assert found["relaxation_x"] == pytest.approx(v["PKX1"] * v["FNOMIN"] / v["LONGITUDINAL_STIFFNESS"], rel=1e-12)
    stiffness = -slope(centered(TIRES["hmmwv"]), "fy", "angle")
    assert found["relaxation_y"] == pytest.approx(stiffness / v["LATERAL_STIFFNESS"], rel=1e-6)


SCALES = [
    (("LMUX", "LKX"), "fx", {"slip": 0.3}),  # friction and stiffness together: the whole curve
    (("LMUY", "LKY"), "fy", {"angle": 0.3}),
    (("LKX",), "fx", {"slip": 1e-9}),
    (("LKY",), "fy", {"angle": 1e-9}),
    (("LMY",), "my", {}),
    (("LMX",), "mx", {"angle": 0.3}),
    (("LTR",), "mz", {"angle": 0.01}),
]


@pytest.mark.parametrize(("scales", "what", "at"), SCALES)
def test_scales(tire, scales, what, at):
    flat = with_(centered(tire), QDZ8=0.0, QDZ9=0.0)
    scaled = with_(flat, **dict.fromkeys(scales, 0.8))
    assert forces(scaled, **at)[what] == pytest.approx(0.8 * forces(flat, **at)[what], rel=1e-9)


def test_derivatives_exist_everywhere(tire):
    """At no slip and no load too, where roots and quotients have none of their own."""
    x = ca.SX.sym("x", 5)
    found = MagicFormula(tire).forces(x[0], x[1], x[2], x[3], x[4])
    jacobian = ca.Function("j", [x], [ca.jacobian(ca.vertcat(found.fx, found.fy, found.mx, found.my, found.mz), x)])
    for load in (0.0, 100.0, tire.values["FNOMIN"], 2e5):
        for rest in ((0, 0, 0, 0), (0, 0, 0, 30), (0.1, 0, 0, 30), (0, 0.1, 0.05, 30), (5, -9, 1, -3)):
            assert np.isfinite(np.asarray(jacobian([load, *rest]))).all()
