"""The linear ride car of a nonlinear one: that car's own linear model, its small motions, rest, balance of powers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cosim import Record, System
from fmu_sources.models.hmmwv_states import relative_model
from fmu_sources.plants import linear_ride_car, wishbone_car
from fmu_sources.plants.linear_car import CORNERS, POSITIONS, WITHOUT_SLIP, at_rest, linear_values, ride_motion
from fmu_sources.vehicles import load_full_car, load_wishbone_car

INPUTS = [f"{what}.{k}" + ".height" * (what == "road") for what in ("road", "force") for k in CORNERS]
# not body.roll_acceleration: that of the nonlinear car is about its body axis, which is pitched by 3 mrad at rest
SEEN = [
    *POSITIONS,
    "body.az",
    "body.pitch_acceleration",
    "seat.az",
    "seat.ax",
    *(
        f"{a}.{k}.{b}"
        for k in CORNERS
        for a, b in (
            ("wheel", "az"),
            ("suspension", "deflection"),
            ("suspension", "velocity"),
            ("tire", "force"),
            ("tire", "deflection"),
        )
    ),
]


@pytest.fixture(scope="module")
def vehicle():
    return load_wishbone_car("hmmwv_public")


@pytest.fixture(scope="module")
def nonlinear(vehicle):
    return wishbone_car(vehicle, "FullCarTest").model()


@pytest.fixture(scope="module")
def linear(vehicle):
    return linear_ride_car(vehicle, "RideCarTest").model()


def number(car, name):
    return car.vector("parameter")[[e.name for e in car.elements("parameter")].index(name)]


def response(lin, outputs, inputs, frequency):
    """Outputs per input (n, m) at a frequency [Hz]."""
    rows, columns = [lin.outputs.index(n) for n in outputs], [lin.inputs.index(n) for n in inputs]
    s = 2j * np.pi * frequency
    inner = np.linalg.solve(s * np.eye(len(lin.A)) - lin.A, lin.B[:, columns])
    return lin.C[rows] @ inner + lin.D[np.ix_(rows, columns)]


@pytest.mark.parametrize("frequency", [0.3, 1.5, 2.6, 9.0, 25.0])
def test_it_answers_as_the_linear_model_of_the_nonlinear_car(linear, nonlinear, vehicle, frequency):
    """With its 29 states, of which only those of the ride matter, tires without slip."""
    whole = at_rest(nonlinear, linear_values(vehicle))
    expected, found = (response(lin, SEEN, INPUTS, frequency) for lin in (whole, linear.linearize()))
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert (np.abs(found - expected) / scale).max() < 1e-9


def test_the_rate_of_a_road_acts_as_wheels_do_that_move_the_other_way(linear, nonlinear, vehicle):
    """A tire's damper feels the difference of both; and at speed, a slope is the rate over the speed."""
    lin = linear.linearize()
    wheels, rates = (
        [names.index(n.format(k)) for k in CORNERS]
        for names, n in ((lin.states, "wheel.{}.vz"), (lin.inputs, "road.{}.rate"))
    )
    for k, wheel, rate in zip(CORNERS, wheels, rates, strict=True):
        force = lin.outputs.index(f"tire.{k}.force")
        assert lin.C[force, wheel] == pytest.approx(-lin.D[force, rate], rel=1e-9)
        assert lin.D[force, rate] == pytest.approx(3931.7, rel=1e-9)  # of the vehicle file
    v = 10.0
    standing, rolling = (at_rest(nonlinear, linear_values(vehicle), speed) for speed in (0.0, v))
    slopes = [f"road.{k}.slope" for k in CORNERS]
    forces = [f"tire.{k}.force" for k in CORNERS]
    by_slope = [
        lin.D[np.ix_([lin.outputs.index(n) for n in forces], [lin.inputs.index(n) for n in slopes])]
        for lin in (standing, rolling)
    ]
    assert by_slope[1] - by_slope[0] == pytest.approx(
        v * lin.D[np.ix_([lin.outputs.index(n) for n in forces], rates)], rel=1e-9
    )


def test_a_road_that_rises_as_the_car_does_changes_nothing(linear):
    lin = linear.linearize()
    column = {n: lin.B[:, i] for i, n in enumerate(lin.inputs)}
    state = {n: lin.A[:, i] for i, n in enumerate(lin.states)}
    lifted = state["body.z"] + sum(state[f"wheel.{k}.z"] + column[f"road.{k}.height"] for k in CORNERS)
    assert np.abs(lifted).max() < 1e-7  # of accelerations up to 4600 m/s2 per m
    rising = state["body.vz"] + sum(state[f"wheel.{k}.vz"] + column[f"road.{k}.rate"] for k in CORNERS)
    rising[: len(POSITIONS)] -= 1.0 * np.array(
        [n == "body.z" or n.startswith("wheel") for n in POSITIONS]
    )  # heights, which do rise
    assert np.abs(rising).max() < 1e-8


def test_it_only_takes_energy_and_answers_alike_both_ways(linear):
    """Power that actuators give at any frequency is not negative in the mean, and the response is reciprocal.

    What a force here does to the strut there, the same force there does here (Maxwell), but for what loads do that act
    below leaning wheels. Neither is in the construction.
    """
    lin = linear.linearize()
    assert np.linalg.eigvals(lin.A).real.max() < -1.0
    rates, travels = ([f"suspension.{k}.{what}" for k in CORNERS] for what in ("velocity", "deflection"))
    forces = [f"force.{k}" for k in CORNERS]
    for frequency in (0.2, 1.0, 2.5, 6.0, 10.0, 30.0):
        power = response(lin, rates, forces, frequency)
        assert np.linalg.eigvalsh((power + power.conj().T) / 2).min() > 0
        both_ways = response(lin, travels, forces, frequency)
        assert np.abs(both_ways - both_ways.T).max() < 4e-3 * np.abs(both_ways).max()


def pulse(t, at, width):
    return np.sin(np.pi * (t - at) / width) ** 2 if at <= t < at + width else 0.0


def drive(size):
    """By input, something that is smooth and different at each corner."""
    signals = {
        f"road.{k}.height": lambda t, at=0.02 + 0.03 * i: size * pulse(t, at, 0.12) for i, k in enumerate(CORNERS[:3])
    }
    return {**signals, "force.rr": lambda t: 2e5 * size * pulse(t, 0.05, 0.1)}


def motion(car, size, values=None):
    """Positions (times, 7) of a car that is driven by signals of a size [m]."""
    p, u0 = car.vector("parameter", values or {}), car.vector("input", {"target.speed": 0.0} if values else {})
    names = [e.name for e in car.elements("input")]
    x0 = np.asarray(car.functions["start"](car.vector("state"), u0, p)).ravel()
    signals = drive(size)

    def u(t):
        given = u0.copy()
        for n, f in signals.items():
            given[names.index(n)] = f(t)
        return given

    times = np.linspace(0.0, 0.4, 41)
    rhs, out = car.functions["rhs"], car.functions["out"]
    found = solve_ivp(
        lambda t, x: np.asarray(rhs(t, x, u(t), p)).ravel(),
        (0.0, 0.4),
        x0,
        t_eval=times,
        rtol=1e-10,
        atol=1e-13,
        max_step=5e-3,
    )
    elements = {e.name: e for e in car.output_elements()}
    rows = []
    for t, x in zip(found.t, found.y.T, strict=True):
        y = np.asarray(out(t, x, u(t), p)).ravel()
        rows.append([(x if elements[n].variable.role == "state" else y)[elements[n].slot] for n in POSITIONS])
    return np.array(rows) - rows[0]


def test_small_motions_of_the_nonlinear_car_are_its_own(linear, nonlinear, vehicle):
    """The difference falls as the square of the size.

    With the dampers of the file, which have no derivative at rest, it falls as the size does.
    """
    values = linear_values(vehicle)
    own = motion(linear, 1.0)
    differences, scale = [], np.abs(own).max()
    for size in (8e-4, 4e-4, 2e-4):
        differences.append(np.abs(motion(nonlinear, size, values) - size * own).max() / (size * scale))
    assert differences[0] < 0.01
    for before, after in itertools.pairwise(differences):
        assert after == pytest.approx(before / 2, rel=0.1)
    by_direction = [np.abs(motion(nonlinear, s, WITHOUT_SLIP) / s / scale - own / scale).max() for s in (4e-4, 2e-4)]
    assert by_direction[1] == pytest.approx(by_direction[0], rel=0.05)
    assert by_direction[1] > 0.05


def test_the_mean_rate_takes_the_same_from_up_and_down(nonlinear, vehicle):
    """Of every travel at rest.

    The dampers' force at a rate less that at minus this rate, by the accelerations that it gives.
    """
    rhs = nonlinear.functions["rhs"]
    u = nonlinear.vector("input", {"target.speed": 0.0})
    names = [e.name for e in nonlinear.elements("state")]
    for k in CORNERS:
        found = []
        for values in (linear_values(vehicle), WITHOUT_SLIP):
            p = nonlinear.vector("parameter", values)
            x = np.asarray(nonlinear.functions["start"](nonlinear.vector("state"), u, p)).ravel()
            rates = []
            for v in (1e-3, -1e-3):
                x[names.index(f"wheel.{k}.travel_rate")] = v
                rates.append(np.asarray(rhs(0.0, x, u, p)).ravel())
            found.append(rates[0] - rates[1])
        assert found[0] == pytest.approx(found[1], abs=1e-6)


def test_rest_and_loads(linear, built_fmus):
    lin = linear.linearize()
    assert not np.asarray(
        linear.functions["rhs"](0, linear.vector("state"), linear.vector("input"), linear.vector("parameter"))
    ).any()
    loads = [number(linear, f"tire.{k}.load") for k in CORNERS]
    assert sum(loads) == pytest.approx(2573.138 * 9.81, rel=1e-4)  # the whole car
    assert loads == pytest.approx([6494, 6494, 6127, 6127], abs=2)  # parked, as published
    stiffness = [-lin.C[lin.outputs.index(f"tire.{k}.force"), lin.states.index(f"wheel.{k}.z")] for k in CORNERS]
    assert stiffness == pytest.approx([411121.0] * 4, rel=1e-9)
    with System() as system:
        system.add("car", built_fmus.path("RideCarHmmwvPublic", 3), step="1 ms")
        system.allow_unconnected = True
        r = system.run(0.5, record=Record(["car.*"], "10 ms"))
        moving = [n for n in r.names if "tire" not in n and n != "time"]
        assert max(np.abs(r[n]).max() for n in moving) == 0.0


def test_halving_the_step_changes_little(built_fmus):
    found = []
    for step in (5e-4, 2.5e-4):
        with System() as system:
            system.add("car", built_fmus.path("RideCarHmmwvPublic", 3), step="1 ms", parameters={"solver.step": step})
            system["car"].set({"force.fl": 1000.0, "road.rr.height": 0.02})
            system.allow_unconnected = True
            found.append(system.run(1.0, record=Record(["car.body.z", "car.wheel.rr.z"], "1 ms")))
    for n in ("car.body.z", "car.wheel.rr.z"):
        assert np.abs(found[0][n] - found[1][n]).max() < 1e-6 * np.abs(found[1][n]).max()


def test_what_the_ride_does_not_decide_is_refused_by_name(nonlinear, vehicle):
    values = linear_values(vehicle)
    with pytest.raises(ValueError, match=r"FullCarTest: .* body\.\w+"):
        ride_motion(nonlinear, {n: v for n, v in values.items() if n not in WITHOUT_SLIP})
    with pytest.raises(ValueError, match="FullCarTest: speed"):
        ride_motion(nonlinear, values, ["speed"])


def test_weight_that_leans_out_of_the_plane_of_the_road():
    """On a level road it is the car as it is; deflections and velocities determine all of it on any other."""
    vehicle, driven = load_full_car("hmmwv_modified"), {"wheel.rigid_body": 1.0}
    upright, over = (linear_ride_car(vehicle, "RideCarTest", driven, plane=plane) for plane in (False, True))
    with pytest.raises(ValueError, match=r"body\.roll_rate, body\.pitch_rate depends on absolute heights"):
        relative_model(upright)
    assert relative_model(over).A.shape == (15, 15)
    one, other = upright.linearize(), over.linearize()
    assert (one.A == other.A).all()
    heights = [other.inputs.index(f"road.{k}.height") for k in CORNERS]
    others = [i for i in range(len(other.inputs)) if i not in heights]
    assert (one.B[:, others] == other.B[:, others]).all()
    # Car and road, leaning together by 1 rad, have no acceleration.
    half = vehicle.body.track.value / 2
    roll = np.array([half, -half, half, -half])
    x = np.zeros(14)
    x[[other.states.index("body.roll"), *(other.states.index(f"wheel.{k}.z") for k in CORNERS)]] = [1.0, *roll]
    leaning, still = (np.abs(lin.A @ x + lin.B[:, heights] @ roll).max() for lin in (one, other))
    assert leaning > 15.0
    assert still < 1e-9


def test_a_vehicle_of_a_user_has_its_own(tmp_path, linear):
    """Twice the body's mass: slower, on stiffer parts of its tables."""
    file = tmp_path / "heavy.toml"
    file.write_text(
        'base = "hmmwv_public"\nname = "heavy"\n\n[body]\nmass = { value = 3000.0, unit = "kg", source = "test" }\n'
    )
    heavy = linear_ride_car(load_wishbone_car(file), "RideCarHeavy").model()
    loads = [sum(number(m, f"tire.{k}.load") for k in CORNERS) for m in (linear, heavy)]
    assert loads[1] - loads[0] == pytest.approx((3000.0 - 2086.52) * 9.81, rel=1e-6)
    slowest = [np.abs(np.linalg.eigvals(m.linearize().A)).min() for m in (linear, heavy)]
    assert slowest[1] < slowest[0]
