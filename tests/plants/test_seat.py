"""Acceleration of the driver's seat, compared with second derivatives of where rotations of scipy put it."""

import numpy as np
import pytest
from named import Named
from scipy.spatial.transform import Rotation

from fmu_sources.plants import full_car, ride_car, three_axle_trench
from fmu_sources.vehicles import load_full_car, load_ride_car, load_three_axle, load_three_axle_trench, load_vehicle

STEP = 1e-4  # s, of the central differences: they agree with the outputs to some 1e-7 of the acceleration


def rotated(q, arm):
    """Coordinates x and z [m] of a point of a body with these angles: yaw, then pitch, then roll."""
    turn = Rotation.from_euler("ZYX", [q.get("body.yaw", 0.0), q["body.pitch"], q["body.roll"]])
    at = turn.apply(arm)
    return np.array([q["x"] + at[0], q["body.z"] + at[2]])


def small_angles(q, arm):
    """Coordinates x and z [m] to first order in the angles."""
    x, y, z = arm
    return np.array([z * q["body.pitch"], q["body.z"] + y * q["body.roll"] - x * q["body.pitch"]])


CARS = {
    "sedan": (lambda: ride_car(load_ride_car("sedan")), small_angles),
    "hmmwv": (lambda: ride_car(load_ride_car("ride_car_hmmwv")), small_angles),
    "6x6": (lambda: ride_car(load_three_axle("three_axle")), small_angles),
    "full car": (lambda: full_car(load_full_car("hmmwv_modified")), rotated),
    "trench": (lambda: three_axle_trench(load_three_axle_trench("three_axle_trench")), rotated),
}


class Moving:
    """A car in some motion, off its equilibrium in every state."""

    def __init__(self, component, rng, **parameters):
        self.model = component.model()
        self.names = [e.name for e in self.model.elements("state")]
        self.run = Named(self.model)
        self.run.p = self.model.vector("parameter", parameters)
        self.p = dict(zip([e.name for e in self.model.elements("parameter")], self.run.p, strict=True))
        x = np.asarray(self.model.functions["start"](self.model.vector("state"), self.run.u, self.run.p)).ravel()
        off = {
            ".z": 0.02,
            ".vz": 0.5,
            "roll": 0.15,
            "pitch": 0.1,
            "yaw": 0.05,
            "_rate": 0.6,
            ".velocity": 0.3,
            "deflection": 0.01,
        }
        size = [next((s for end, s in off.items() if n.endswith(end)), 0.0) for n in self.names]
        self.x = x + np.array(size) * rng.uniform(0.5, 1.0, len(size)) * rng.choice([-1, 1], len(size))

    def slope(self, x):
        return np.asarray(self.model.functions["rhs"](0.0, x, self.run.u, self.run.p)).ravel()

    def outputs(self):
        self.run.x = self.x
        return self.run.shown()

    def position(self, x, place, arm):
        return place(
            {
                n: x[self.names.index(n)]
                for n in ("x", "body.z", "body.roll", "body.pitch", "body.yaw")
                if n in self.names
            },
            arm,
        )

    def acceleration(self, place, arm):
        """Along the flow: two Runge-Kutta steps ahead and two back, and the second difference of fourth order."""
        ahead, back = self._flow(STEP), self._flow(-STEP)
        p = [self.position(x, place, arm) for x in (*back[::-1], self.x, *ahead)]
        return (-p[0] + 16 * p[1] - 30 * p[2] + 16 * p[3] - p[4]) / (12 * STEP**2)

    def _flow(self, h):
        found, x = [], self.x
        for _ in range(2):
            a = self.slope(x)
            b = self.slope(x + h / 2 * a)
            c = self.slope(x + h / 2 * b)
            d = self.slope(x + h * c)
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
            found.append(x)
        return found


@pytest.mark.parametrize("car", CARS)
@pytest.mark.parametrize("seed", range(3))
def test_is_the_second_derivative_of_the_seats_position(car, seed):
    make, place = CARS[car]
    rng = np.random.default_rng(seed)
    where = {"seat.x": 0.83, "seat.y": 0.71, "seat.z": 0.92}
    moving = Moving(make(), rng, **where)
    found = moving.outputs()
    expected = moving.acceleration(place, np.array(list(where.values())))
    assert np.hypot(found["seat.az"] - found["body.az"], found["seat.ax"]) > 0.5  # it is not that of the CG
    np.testing.assert_allclose([found["seat.ax"], found["seat.az"]], expected, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("car", CARS)
def test_at_the_cg_it_is_the_acceleration_of_the_cg(car):
    moving = Moving(CARS[car][0](), np.random.default_rng(5), **{"seat.x": 0.0, "seat.y": 0.0, "seat.z": 0.0})
    found = moving.outputs()
    assert found["seat.az"] == pytest.approx(found["body.az"], rel=1e-12)
    if "body.ax" in found:
        assert found["seat.ax"] == pytest.approx(found["body.ax"], rel=1e-12)


def test_moves_with_the_cg_of_a_loaded_6x6():
    """The parameter cg_offset moves the CG and leaves the seat where it is above the wheels.

    In the linear car of the file as well.
    """
    make = CARS["trench"][0]
    by_offset = Moving(make(), np.random.default_rng(2), **{"body.cg_offset": 0.25, "seat.x": 2.0})
    found = by_offset.outputs()
    arm = np.array([2.0 - 0.25, by_offset.p["seat.y"], by_offset.p["seat.z"]])
    np.testing.assert_allclose(
        [found["seat.ax"], found["seat.az"]], by_offset.acceleration(rotated, arm), rtol=1e-5, atol=1e-4
    )
    loaded = load_three_axle_trench("three_axle_trench")
    offset = loaded.body.cg_offset.model_copy(update={"value": 0.25})
    moved = loaded.model_copy(update={"body": loaded.body.model_copy(update={"cg_offset": offset})})
    assert moved.linear().seat.x.value == pytest.approx(loaded.seat.x.value - 0.25)


def test_a_file_without_a_seat_has_it_at_the_cg_and_says_so(tmp_path):
    text = (load_ride_car.__globals__["_HERE"] / "sedan.toml").read_text()
    begin, end = text.index("[seat]"), text.index("[wheel.front]")
    (tmp_path / "own.toml").write_text(text[:begin] + text[end:])
    seat = load_vehicle(tmp_path / "own.toml").seat
    assert (seat.x.value, seat.y.value, seat.z.value) == (0.0, 0.0, 0.0)
    assert "no [seat]" in seat.x.source


def test_hmmwvs_have_their_seat_at_the_same_place_above_the_wheels():
    full, linear = load_full_car("hmmwv"), load_ride_car("ride_car_hmmwv")
    behind = [
        full.body.cg_position.value * full.body.wheelbase.value - full.seat.x.value,
        linear.wheel.front.x.value - linear.seat.x.value,
    ]
    assert behind == pytest.approx([0.779, 0.779], abs=5e-3)
    assert full.body.cg_height.value + full.seat.z.value == pytest.approx(1.64)
