"""Car on double wishbones: rest, symmetry, weights, tables, what is refused; and the contact of its tires."""

import casadi as ca
import numpy as np
import pytest
from named import Named

from cosim import Record, System
from cosim.core.errors import CosimError
from fmu_sources.plants import wishbone_car
from fmu_sources.plants.enveloping import CONTACT_COUNT, CONTACT_STEP, Disc
from fmu_sources.roads import RoadLayout, road_half_round
from fmu_sources.vehicles import load_wishbone_car

CORNERS = ("fl", "fr", "rl", "rr")
G = 9.81
INCH = 0.0254


@pytest.fixture(scope="module")
def vehicle():
    return load_wishbone_car("hmmwv_public")


class Car:
    """The component with its numbers by name."""

    def __init__(self, vehicle):
        self.c = wishbone_car(vehicle, "FullCarTest").model()
        self.names = {role: [e.name for e in self.c.elements(role)] for role in ("state", "input", "parameter")}

    def vector(self, role, **values):
        vector = self.c.vector(role)
        for name, value in values.items():
            vector[self.names[role].index(name.replace("__", "."))] = value
        return vector

    def start(self, u, p):
        return np.asarray(self.c.functions["start"](self.c.vector("state"), u, p)).ravel()

    def rates(self, x, u, p):
        dx = np.asarray(self.c.functions["rhs"](0, x, u, p)).ravel()
        return dict(zip(self.names["state"], dx, strict=True))

    def shows(self, x, u, p):
        run = Named(self.c)
        run.p, run.u, run.x = p, u, x
        return run.shown()


@pytest.fixture(scope="module")
def car(vehicle):
    return Car(vehicle)


MOVING = ("body.vz", "body.roll_rate", "body.pitch_rate", *(f"wheel.{k}.travel_rate" for k in CORNERS))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"body__mass": 2600.0},
        {"wheel__mass": 60.0, "tire__damping": 0.0},
        {"suspension__front__spring__free_length": 0.35},
    ],
)
def test_stands_at_rest_whatever_its_masses_and_springs(car, changes):
    u, p = car.vector("input", target__speed=0.0), car.vector("parameter", **changes)
    x = car.start(u, p)
    rates, shown = car.rates(x, u, p), car.shows(x, u, p)
    assert [rates[n] for n in MOVING] == pytest.approx([0.0] * len(MOVING), abs=1e-8)
    weight = G * (sum(p[car.names["parameter"].index(n)] for n in ("body.mass", "fixed.mass")) + corner_masses(car, p))
    assert sum(shown[f"tire.{k}.force"] for k in CORNERS) == pytest.approx(weight, rel=1e-10)
    if not changes:
        assert [shown["body.z"], *(shown[f"wheel.{k}.z"] for k in CORNERS)] == pytest.approx([0.0] * 5, abs=1e-12)
    else:
        assert abs(shown["body.z"]) > 1e-4


def corner_masses(car, p):
    """Moving masses of all wheels [kg]."""
    value = dict(zip(car.names["parameter"], p, strict=True))
    arms = [
        f"suspension.{a}.{w}_arm.{m}_mass"
        for a in ("front", "rear")
        for w in ("upper", "lower")
        for m in ("ball", "com")
    ]
    return 4 * (value["wheel.mass"] + value["upright.mass"]) + 2 * sum(value[n] for n in arms)


def test_total_mass_is_that_of_the_file(car):
    p = car.vector("parameter")
    value = dict(zip(car.names["parameter"], p, strict=True))
    assert value["body.mass"] + value["fixed.mass"] + corner_masses(car, p) == pytest.approx(2573.138, abs=1e-3)


def test_parked_as_the_published_model_is(car):
    """Its parked state, as far as its tires do not hold the track.

    Loads and wheels are those, springs within what that changes.
    """
    u, p = car.vector("input", target__speed=0.0), car.vector("parameter")
    shown = car.shows(car.start(u, p), u, p)
    value = dict(zip(car.names["parameter"], p, strict=True))
    assert [shown[f"tire.{k}.force"] for k in ("fl", "rl")] == pytest.approx([6494, 6127], abs=1)
    assert [-1e3 * shown[f"tire.{k}.deflection"] for k in ("fl", "rl")] == pytest.approx([15.80, 14.90], abs=0.01)
    assert [value[f"rest.{a}.wheel_height"] for a in ("front", "rear")] == pytest.approx([0.4541, 0.4549], abs=1.1e-4)
    assert value["rest.height"] == pytest.approx(0.7998, abs=1e-3)
    assert [shown[f"spring.{k}.length"] for k in ("fl", "rl")] == pytest.approx([0.29424, 0.35600], abs=5e-4)


def test_rolls_at_the_height_of_the_published_model(car):
    """Toe-in of a rolling wheel presses it inwards, which lifts the car; the start takes that into account."""
    u, p = car.vector("input", target__speed=5.0), car.vector("parameter")
    shown = car.shows(car.start(u, p), u, p)
    value = dict(zip(car.names["parameter"], p, strict=True))
    assert value["rest.height"] + shown["body.z"] == pytest.approx(0.8019, abs=3e-4)
    assert [shown[f"spring.{k}.length"] for k in ("fl", "rl")] == pytest.approx([0.2965, 0.3558], abs=5e-4)
    assert [shown[f"damper.{k}.length"] for k in ("fl", "rl")] == pytest.approx([0.4226, 0.4149], abs=5e-4)
    assert [shown[f"tire.{k}.force"] for k in ("fl", "rl")] == pytest.approx([6494, 6132], rel=2e-3)


def test_left_and_right_are_mirror_images(car):
    random = np.random.default_rng(3)
    u, p = car.vector("input", target__speed=8.0), car.vector("parameter")
    x = car.start(u, p)
    x = x + random.normal(size=len(x)) * 0.02
    u[: len(u)] += random.normal(size=len(u)) * 0.01
    swapped = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
    odd = {"y", "body.roll", "body.yaw", "body.vy", "body.roll_rate", "body.yaw_rate", "target.y", "steering.wheel"}

    def mirrored(vector, names):
        def other(name):
            parts = name.split(".")
            return ".".join(
                [
                    swapped.get(q.split("[")[0], q.split("[")[0]) + (("[" + q.split("[")[1]) if "[" in q else "")
                    for q in parts
                ]
            )

        return np.array([(-1 if n in odd else 1) * vector[names.index(other(n))] for n in names])

    there = np.array(list(car.rates(mirrored(x, car.names["state"]), mirrored(u, car.names["input"]), p).values()))
    here = np.array(list(car.rates(x, u, p).values()))
    assert there == pytest.approx(mirrored(here, car.names["state"]), rel=1e-9, abs=1e-9)


def test_in_the_air_only_gravity_and_dampers_change_what_is_conserved(car):
    """No force from outside but weight.

    Apart from the angular momentum that the wheels' spin carries, a car without spin, strut forces or motion falls
    freely with all its parts.
    """
    changes = {
        f"suspension__{a}__spring__force[{i}]".replace("__", "."): 0.0 for a in ("front", "rear") for i in range(1, 12)
    }
    changes |= {f"suspension.stop.force[{i}]": 0.0 for i in range(1, 12)}
    p = car.c.vector("parameter")
    for name, value in changes.items():
        p[car.names["parameter"].index(name)] = value
    u = car.vector("input", target__speed=0.0)
    x = np.zeros(len(car.names["state"]))
    x[car.names["state"].index("body.z")] = 1.0
    for k, q in zip(CORNERS, (-0.1, -0.05, 0.02, 0.05), strict=True):
        x[car.names["state"].index(f"wheel.{k}.travel")] = q
    rates = car.rates(x, u, p)
    assert rates["body.vz"] == pytest.approx(-G, rel=1e-12)
    others = [rates[n] for n in MOVING[1:]]
    assert others == pytest.approx([0.0] * len(others), abs=1e-11)


# ------------------------------------------------------------------------------------------------------------- contact


def disc(radius=0.4699, step=CONTACT_STEP, count=CONTACT_COUNT):
    height, profile = ca.SX.sym("height"), ca.SX.sym("profile", count)
    rule = Disc(ca.SX(radius), ca.SX(step), count)
    return ca.Function("depth", [height, profile], [rule.depth(rule.area(height, profile))])


@pytest.mark.parametrize("depth", [-0.01, 0.0, 1e-4, 0.0158, 0.08, 0.2])
def test_depth_on_a_flat_road_is_exact(depth):
    found = float(disc()(0.4699 - depth, np.zeros(CONTACT_COUNT)))
    assert found == pytest.approx(max(0.0, depth), abs=1e-12)


@pytest.mark.parametrize("ahead", [-0.35, -0.2, 0.0, 0.11, 0.3])
@pytest.mark.parametrize("height", [0.40, 0.45, 0.52])
def test_depth_on_a_half_round_is_that_of_the_exact_area(ahead, height):
    """The area below a half-round of 4 in by fine quadrature.

    And the depth with that area on a flat road, by bisection.
    """
    radius, bump = 0.4699, 4 * INCH
    at = (np.arange(CONTACT_COUNT) - CONTACT_COUNT // 2) * CONTACT_STEP

    def profile(s):
        return np.sqrt(np.maximum(0.0, bump**2 - (s - ahead) ** 2))

    fine = np.linspace(-radius, radius, 200_001)
    area = np.trapezoid(np.maximum(0.0, profile(fine) - height + np.sqrt(radius**2 - fine**2)), fine)
    low, high = 0.0, radius
    for _ in range(60):
        middle = (low + high) / 2
        angle = np.arccos(1 - middle / radius)
        low, high = (middle, high) if radius**2 * (angle - np.sin(2 * angle) / 2) < area else (low, middle)
    assert float(disc()(height, profile(at))) == pytest.approx(low, abs=3e-3)


def test_road_shows_what_tires_touch(vehicle):
    road = road_half_round(RoadLayout.of(vehicle)).model()
    place, _ = vehicle.wheel_place("front")
    run = Named(road).put(x=30.0 - place - 0.1)  # the middle of the half-round 0.1 m ahead of the front wheels
    shown = run.shown()
    bump = 8 * INCH
    under = np.sqrt(bump**2 - 0.1**2)
    assert shown["road.fl.height"] == pytest.approx(under, abs=1e-12)
    assert shown["road.fl.slope"] == pytest.approx((np.sqrt(bump**2 - 0.05**2) - under) / 0.05, abs=1e-9)
    at = (np.arange(CONTACT_COUNT) - CONTACT_COUNT // 2) * CONTACT_STEP
    expected = np.sqrt(np.maximum(0.0, bump**2 - (at - 0.1) ** 2)) - under
    for k in ("fl", "fr"):
        assert [shown[f"contact.{k}[{i + 1}]"] for i in range(CONTACT_COUNT)] == pytest.approx(expected, abs=1e-12)
    assert [shown[f"contact.rl[{i + 1}]"] for i in range(CONTACT_COUNT)] == [0.0] * CONTACT_COUNT
    assert shown["contact.step"] == CONTACT_STEP


def drive(built_fmus, road, duration=1.6, **parameters):
    with System() as system:
        system.add(
            "road", built_fmus.path(road, 3), parameters={"position": 12.0} if "HalfRound" in road else {"flat": 1e3}
        )
        start = {"target.speed": 5.0, "target.y": 0.0, **{f"force.{k}": 0.0 for k in CORNERS}}
        system.add("car", built_fmus.path("FullCarHmmwvPublic", 3), step="1 ms", start=start, parameters=parameters)
        system.connect("car.x", "road.x")
        system.connect("car.speed", "road.speed")
        system.connect_matching("road", "car", "*")
        return system.run(duration, record=Record(["car.body.az", "car.body.z", "car.tire.fl.force", "car.x"], "1 ms"))


def test_tires_envelop_the_half_round_before_their_center_is_there(built_fmus):
    result = drive(built_fmus, "RoadHalfRoundHmmwvPublic")
    place = load_wishbone_car("hmmwv_public").wheel_place("front")[0]
    force, ahead = np.array(result["car.tire.fl.force"]), 12.0 - 8 * INCH - np.array(result["car.x"]) - place
    first = ahead[np.argmax(np.abs(force - force[0]) > 500)]
    geometric = np.sqrt((0.4541 + 8 * INCH) ** 2 - 0.4541**2) - 8 * INCH  # where a disc touches the half cylinder
    assert first == pytest.approx(geometric, abs=0.03)
    assert np.max(force) > 25e3


def test_rolls_on_roads_of_other_cars_too(built_fmus):
    """Without contact.* its tires follow the height below their centers: on a level road that is the same."""
    level = drive(built_fmus, "RoadSine", 0.5)
    assert np.abs(np.array(level["car.body.az"])).max() < 0.05


# -------------------------------------------------------------------------------------------------------- wrong input


def test_table_that_does_not_increase_is_refused_by_the_fmu(built_fmus, raises):
    with raises(CosimError):
        drive(built_fmus, "RoadHalfRoundHmmwvPublic", 0.01, **{"tire.deflection[2]": 0.0})
