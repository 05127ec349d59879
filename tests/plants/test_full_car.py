"""Full car: equilibrium, modes, symmetry, energy, contact, and the response that paper 000 publishes."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from named import Named
from oracles.eigenvalues import eigenvalues_by_point

from build_fmus.reference import simulate
from build_fmus.stability import check_solver
from cosim.experiments.metrics.response import response_objective
from fmu_sources.plants import full_car
from fmu_sources.roads import RoadLayout, road_sine
from fmu_sources.vehicles import load_full_car

CORNERS = ("fl", "fr", "rl", "rr")
G = 9.81


class Car:
    """A component with its numbers by name."""

    def __init__(self, vehicle):
        self.vehicle = load_full_car(vehicle)
        self.c = full_car(self.vehicle, "FullCarTest").model()
        self.f = self.c.functions
        self.states = [e.name for e in self.c.elements("state")]
        self.inputs = [e.name for e in self.c.elements("input")]
        self.parameters = [e.name for e in self.c.elements("parameter")]
        self.outputs = [e.name for e in self.c.output_elements()]

    def u(self, **values):
        return self._fill(self.c.vector("input"), self.inputs, values)

    def p(self, **values):
        return self._fill(self.c.vector("parameter"), self.parameters, values)

    def start(self, u=None, p=None):
        u, p = self.u() if u is None else u, self.p() if p is None else p
        return np.asarray(self.f["start"](self.c.vector("state"), u, p)).ravel()

    def rhs(self, x, u=None, p=None):
        u, p = self.u() if u is None else u, self.p() if p is None else p
        return np.asarray(self.f["rhs"](0, x, u, p)).ravel()

    def y(self, x, u=None, p=None):
        u, p = self.u() if u is None else u, self.p() if p is None else p
        run = Named(self.c)
        run.p, run.u, run.x = p, u, x
        return run.shown()

    @staticmethod
    def _fill(vector, names, values):
        for name, value in values.items():
            vector[names.index(name.replace("__", "."))] = value
        return vector


@pytest.fixture(scope="module")
def car():
    return Car("hmmwv_modified")


@pytest.fixture(scope="module")
def basic():
    return Car("hmmwv")


# --------------------------------------------------------------------------------------------------------- equilibrium


@pytest.mark.parametrize("speed", [0.0, 5.0, 50 / 3.6, 60.0])
@pytest.mark.parametrize("changes", [{}, {"body__mass": 3123.4, "wheel__mass": 55.0, "tire__stiffness": 5e5}])
def test_starts_in_static_equilibrium_at_the_target_speed(car, basic, speed, changes):
    for model in (car, basic):
        u, p = model.u(target__speed=speed), model.p(**changes)
        x = model.start(u, p)
        dx = model.rhs(x, u, p)
        assert dx[model.states.index("x")] == speed
        dx[model.states.index("x")] = 0.0
        assert np.abs(dx).max() < 1e-9
        y = model.y(x, u, p)
        assert y["x"] == 5.0
        assert y["speed"] == speed
        weight = (p[model.parameters.index("body.mass")] + 4 * p[model.parameters.index("wheel.mass")]) * G
        assert sum(y[f"tire.{k}.force"] for k in CORNERS) == pytest.approx(weight, rel=1e-12)
        assert y["tire.rl.force"] / y["tire.fl.force"] > 1  # CG behind the middle


def test_rests_on_whatever_road_it_starts_on(car):
    level = car.u(**{f"road__{k}__height": 0.37 for k in CORNERS}, target__speed=0.0)
    assert np.abs(car.rhs(car.start(level), level)).max() < 1e-9
    assert car.start(level)[car.states.index("body.z")] == pytest.approx(0.37, abs=1e-15)

    warped = car.u(
        road__fl__height=0.05, road__fr__height=-0.01, road__rl__height=0.01, road__rr__height=0.02, target__speed=0.0
    )
    run = Named(car.c)
    run.u = warped
    before = run.x.copy()
    y = car.y(before, warped)
    assert y["body.roll"] > 0  # left side higher
    assert y["body.pitch"] < 0  # front higher
    for _ in range(3000):
        run.step(1e-3)
    assert np.abs(run.x - before)[car.states.index("body.z")] < 2e-4
    assert np.abs(run.x - before)[car.states.index("body.pitch")] < 2e-4
    assert np.abs(run.x - before)[car.states.index("body.roll")] < 2e-4


def test_stands_still_at_speed_0(car):
    run = Named(car.c)
    run.u = car.u(target__speed=0.0)
    before = run.x.copy()
    for _ in range(500):
        run.step(1e-3)
    assert np.abs(run.x - before).max() < 1e-12


# --------------------------------------------------------------------------------------------------------------- modes


def frequencies(A):
    """|lambda| / 2 pi of the oscillating modes [Hz]."""
    eigenvalues = np.linalg.eigvals(A)
    return np.abs(eigenvalues[eigenvalues.imag > 1e-6]) / (2 * np.pi)


def sub_model(car, speed, p=None):
    """State matrix of the symmetric vertical motion: heave, pitch, wheels."""
    model = car.c.linearize(None, car.u(target__speed=speed), p)
    names = ["body.z", "body.pitch", "body.vz", "body.pitch_rate"]
    names += [f"wheel.{k}.{s}" for k in CORNERS for s in ("z", "vz")]
    at = [model.states.index(n) for n in names]
    return model.A[np.ix_(at, at)]


@pytest.mark.parametrize("speed", [0.0, 50 / 3.6])
def test_heave_and_pitch_frequencies(car, speed):
    for found in (frequencies(sub_model(car, speed)), frequencies(car.c.linearize(None, car.u(target__speed=speed)).A)):
        assert np.abs(found - 1.16).min() < 0.03
        assert np.abs(found - 1.43).min() < 0.03


def test_undamped_frequencies(car):
    p = car.p(suspension__front__damper=0.0, suspension__rear__damper=0.0, tire__damping=0.0)
    found = np.sort(frequencies(sub_model(car, 0.0, p)))
    assert found[:2] == pytest.approx([1.135, 1.395], abs=0.001)


def test_solver_is_stable_and_the_course_too(car, basic):
    for model in (car, basic):
        check_solver(model.c)
        for name, eigenvalues in eigenvalues_by_point(model.c).items():
            assert eigenvalues.real.max() < 1e-6, name


# ------------------------------------------------------------------------------------------------------------ symmetry


def mirrored(names, values):
    """The same situation seen in a mirror along the road."""
    swap = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
    odd = (
        "y",
        "body.roll",
        "body.yaw",
        "body.vy",
        "body.ay",
        "body.roll_rate",
        "body.yaw_rate",
        "target.y",
        "steering.wheel",
    )
    out = np.empty_like(values)
    for name, value in zip(names, values, strict=True):
        parts = [swap.get(part, part) for part in name.split(".")]
        sign = -1 if name in odd or name.endswith(("slip_angle", "roll_acceleration", "yaw_acceleration")) else 1
        out[names.index(".".join(parts))] = sign * value
    return out


def random_state(car, rng, size=1.0):
    x = car.start() + size * 0.1 * rng.standard_normal(len(car.states))
    u = car.u()
    for i, name in enumerate(car.inputs):
        if name != "target.speed":
            u[i] = size * rng.standard_normal() * (1e4 if name.startswith("force") else 0.05)
    return x, u


@pytest.mark.parametrize("seed", range(5))
def test_mirror_symmetry(car, seed):
    x, u = random_state(car, np.random.default_rng(seed))
    xm, um = mirrored(car.states, x), mirrored(car.inputs, u)
    dx = car.rhs(x, u)
    assert car.rhs(xm, um) == pytest.approx(mirrored(car.states, dx), rel=1e-9, abs=1e-9)
    y, ym = car.y(x, u), car.y(xm, um, car.p(seat__y=-car.vehicle.seat.y.value))
    assert np.array(list(ym.values())) == pytest.approx(
        mirrored(car.outputs, np.array(list(y.values()))), rel=1e-9, abs=1e-9
    )


# -------------------------------------------------------------------------------------------------------------- energy

CONSERVATIVE = {
    "suspension__front__damper": 0.0,
    "suspension__rear__damper": 0.0,
    "suspension__stop__travel": 1.0,
    "tire__damping": 0.0,
    "tire__slip_stiffness": 0.0,
    "tire__cornering_stiffness": 0.0,
    "speed_control__gain": 0.0,
    "speed_control__integral_gain": 0.0,
}


def turned(roll, pitch, yaw):
    """From body axes to road axes (3, 3)."""
    about = [ca.SX.eye(3) for _ in range(3)]
    for turn, angle, (i, j) in zip(about, (roll, pitch, yaw), ((1, 2), (2, 0), (0, 1)), strict=True):
        turn[i, i] = turn[j, j] = ca.cos(angle)
        turn[j, i] = ca.sin(angle)
        turn[i, j] = -ca.sin(angle)
    return about[2] @ about[1] @ about[0]


def energy(car, road, rigid=False):
    """Total energy as a CasADi function of the state [J], with all tires on a road of the given heights.

    `rigid`: the wheels move with the hubs along the axes x and y of the body, not with its CG. Their motion about the
    center of mass of all counts along these axes, and that of this center along those of the road.
    """
    v, x = car.vehicle, ca.SX.sym("x", len(car.states))
    s = dict(zip(car.states, ca.vertsplit(x), strict=True))
    ms, mu = v.body.mass.value, v.wheel.mass.value
    base, half = v.body.wheelbase.value, v.body.track.value / 2
    front = v.body.cg_position.value * base
    places = {"fl": (front, half), "fr": (front, -half), "rl": (front - base, half), "rr": (front - base, -half)}
    yaw_inertia = v.body.yaw_inertia.value + sum(mu * (a**2 + b**2) for a, b in places.values())
    total = ms + 4 * mu
    rates = ca.vertcat(*(s[f"body.{n}_rate"] for n in ("roll", "pitch", "yaw")))
    e = 0.5 * ms * s["body.vz"] ** 2 + ms * G * s["body.z"]
    e += 0.5 * v.body.roll_inertia.value * rates[0] ** 2
    e += 0.5 * v.body.pitch_inertia.value * rates[1] ** 2 + 0.5 * v.body.yaw_inertia.value * rates[2] ** 2
    across = ca.vertcat(s["body.vx"], s["body.vy"])
    if rigid:
        turn = turned(s["body.roll"], s["body.pitch"], s["body.yaw"])
        drop = v.wheel.hub_height.value - v.body.cg_height.value
        moved = [ca.cross(rates, ca.vertcat(a, b, drop)) for a, b in places.values()]
        center = sum(mu * m for m in moved) / total
        e += 0.5 * total * ca.sumsqr(across + (turn @ center)[:2]) - 0.5 * total * ca.sumsqr(center[:2])
        e += sum(0.5 * mu * ca.sumsqr(m[:2]) for m in moved)
    else:
        e += 0.5 * total * ca.sumsqr(across) + 0.5 * (yaw_inertia - v.body.yaw_inertia.value) * rates[2] ** 2
    for k, (a, b) in places.items():
        axle = v.suspension.front if k[0] == "f" else v.suspension.rear
        preload = ms * G * (base - abs(a)) / base / 2
        rate = v.suspension.motion_ratio.value**2 * axle.spring.value
        height = s["body.z"] - ca.sin(s["body.pitch"]) * a + ca.cos(s["body.pitch"]) * ca.sin(s["body.roll"]) * b
        travel = height - s[f"wheel.{k}.z"]
        compression = road[k] - s[f"wheel.{k}.z"]
        e += 0.5 * rate * travel**2 - preload * travel
        e += 0.5 * v.tire.stiffness.value * compression**2 + (preload + mu * G) * compression
        e += 0.5 * mu * s[f"wheel.{k}.vz"] ** 2 + mu * G * s[f"wheel.{k}.z"]
        e += 0.5 * v.wheel.spin_inertia.value * s[f"wheel.{k}.spin"] ** 2
    return ca.Function("energy", [x], [e, ca.jacobian(e, x)])


@pytest.mark.parametrize("seed", range(5))
def test_power_balance_in_any_state(car, seed):
    """Nothing but actuators and the push of the slope changes the energy of the conservative car, whatever it does."""
    rng = np.random.default_rng(seed)
    x, u = random_state(car, rng, 0.1)
    p = car.p(**CONSERVATIVE)
    road = {k: u[car.inputs.index(f"road.{k}.height")] for k in CORNERS}
    for k in CORNERS:
        u[car.inputs.index(f"road.{k}.slope")] = 0.0
    _, gradient = energy(car, road)(x)
    terms = np.asarray(gradient).ravel() * car.rhs(x, u, p)
    y = car.y(x, u, p)
    assert all(y[f"tire.{k}.force"] > 0 for k in CORNERS)
    power = sum(y[f"actuator.{k}.power"] for k in CORNERS)
    assert terms.sum() == pytest.approx(power, abs=1e-10 * np.abs(terms).sum())


@pytest.mark.parametrize("seed", range(3))
def test_dampers_and_slip_only_take_energy(car, seed):
    rng = np.random.default_rng(seed)
    x, u = random_state(car, rng, 0.1)
    u[:] = car.u()
    conservative = {k: v for k, v in CONSERVATIVE.items() if "control" in k or "stop" in k}
    p = car.p(**conservative, steering__max_angle=0.0)
    for k in CORNERS:  # settled slips: force against the sliding
        x[car.states.index(f"tire.{k}.slip")] = 0.0
        x[car.states.index(f"tire.{k}.slip_angle")] = 0.0
        at = [car.states.index(f"tire.{k}.{n}") for n in ("slip", "slip_angle")]
        x[at] += 0.1 * car.rhs(x, u, p)[at]
    _, gradient = energy(car, dict.fromkeys(CORNERS, 0.0))(x)
    assert float(np.asarray(gradient).ravel() @ car.rhs(x, u, p)) < 0


def test_energy_is_kept_to_integrator_order(car):
    """Free rocking of the conservative car: the drift falls with the order of the solver (2)."""
    of = energy(car, dict.fromkeys(CORNERS, 0.0))
    drift = []
    for step in (1e-3, 5e-4, 2.5e-4):
        run = Named(car.c, {k.replace("__", "."): v for k, v in CONSERVATIVE.items()})
        run.p[0] = step
        x = run.x.copy()
        for name, value in {"body.z": 0.03, "body.roll": 0.02, "body.pitch": -0.02, "body.yaw_rate": 0.1}.items():
            x[car.states.index(name)] += value
        run.x = x
        e0 = float(of(x)[0])
        for _ in range(10):
            run.step(0.1)
        drift.append(abs(float(of(run.x)[0]) - e0))
    motion = 0.5 * 5000 * 0.03**2 * (2 * np.pi * 1.16) ** 2  # J, scale of the rocking
    assert drift[1] < 0.02 * motion
    assert drift[0] / drift[1] > 3.5
    assert drift[1] / drift[2] > 3.5


# ------------------------------------------------------------------------------------------------- contact, stops, grip


def test_tire_lifts_off_and_never_pulls(car):
    run = Named(car.c)
    run.u = car.u(target__speed=10.0)
    run.x = run.x
    run.u[:4] = -0.5  # the ground drops away
    forces, travels = [], []
    for _ in range(600):
        run.step(1e-3)
        y = run.shown()
        forces.append([y[f"tire.{k}.force"] for k in CORNERS])
        travels.append([y[f"suspension.{k}.deflection"] for k in CORNERS])
        if len(forces) == 100:  # in the air
            assert y["tire.fl.force"] == 0.0
            assert y["body.az"] < 0
    forces = np.array(forces)
    assert forces.min() == 0.0
    assert forces[-1].min() > 0
    assert np.max(travels) > 0.12  # the wheels hung in their stops
    assert np.isfinite(run.x).all()


def test_falls_freely_with_wheels_off_the_ground_and_struts_cut(car):
    """Without springs, dampers and preload reaction the pair of body and wheels accelerates at g together."""
    u = car.u(**{f"road__{k}__height": 0.0 for k in CORNERS}, target__speed=0.0)
    x = car.start(u)
    for k in CORNERS:
        x[car.states.index(f"wheel.{k}.z")] += 0.5
    x[car.states.index("body.z")] += 0.5
    y = car.y(x, u)
    total = car.vehicle.body.mass.value * y["body.az"] + 110.0 * sum(y[f"wheel.{k}.az"] for k in CORNERS)
    assert total == pytest.approx(-(5000 + 440) * G, rel=1e-12)


def test_stops_are_closed_beyond_their_travel_only(car):
    def force(travel):
        x = car.start()
        x[car.states.index("body.z")] += travel
        soft = car.p(suspension__front__spring=0.0, suspension__rear__spring=0.0)
        return car.rhs(x, None, soft)[car.states.index("body.vz")] * 5000 / 4

    assert force(0.119) == pytest.approx(0.0, abs=1e-6)
    assert force(-0.119) == pytest.approx(0.0, abs=1e-6)
    expected = 200e3 * 0.03 + 3e7 * 0.03**3
    assert force(-0.15) == pytest.approx(expected)
    assert force(0.15) == pytest.approx(-expected)


def test_tire_forces_stay_inside_the_friction_ellipse(car):
    x, u = car.start(), car.u()
    for k in CORNERS:
        x[car.states.index(f"tire.{k}.slip")] = 5.0
        x[car.states.index(f"tire.{k}.slip_angle")] = 5.0
    dx = car.rhs(x, u)
    force = 5440 * np.hypot(dx[car.states.index("body.vx")], dx[car.states.index("body.vy")])
    assert 0.95 * 0.8 < force / (5440 * G) <= 0.8


def test_actuator_pushes_body_up_and_wheel_down(car):
    before, after = car.y(car.start()), car.y(car.start(), car.u(force__fl=1000.0))
    assert after["body.az"] - before["body.az"] == pytest.approx(1000 / 5000)
    assert after["wheel.fl.az"] - before["wheel.fl.az"] == pytest.approx(-1000 / 110)
    assert after["body.roll_acceleration"] > 0
    assert after["body.pitch_acceleration"] < 0


def test_brakes_and_drive_pitch_the_car_about_the_cg_height(car):
    """In steady acceleration the load moves from front to rear by M a h / wheelbase."""
    run = Named(car.c, {"speed_control.integral_gain": 0.0})
    run.u = car.u(target__speed=10.0)
    run.x = run.x
    for _ in range(3000):
        run.u[car.inputs.index("target.speed")] += 1e-3  # ends in 1 m/s2
        run.step(1e-3)
    y = run.shown()
    moved = sum(y[f"tire.{k}.force"] for k in ("rl", "rr")) - 2 * (110 * G + 5000 * G * 0.6 / 2)
    a = car.rhs(run.x, run.u, run.p)[car.states.index("body.vx")]
    assert a == pytest.approx(1.0, abs=0.02)
    assert moved == pytest.approx(5440 * a * 0.85 / 3.302, rel=0.03)


def test_driver_changes_lane_and_speed(car):
    run = Named(car.c)
    run.u = car.u(target__speed=15.0)
    run.x = run.x
    run.u = car.u(target__speed=17.0, target__y=1.0)
    for _ in range(8000):
        run.step(1e-3)
    y = run.shown()
    assert y["y"] == pytest.approx(1.0, abs=0.02)
    assert y["speed"] == pytest.approx(17.0, abs=0.02)


@pytest.mark.parametrize(("vehicle", "start", "target"), [("car", 0.0, 25.0), ("basic", 25.0, 0.0)])
def test_hardest_drive_and_brake_neither_spin_nor_lock_the_wheels(request, vehicle, start, target):
    model = request.getfixturevalue(vehicle)
    run = Named(model.c)
    run.u = model.u(target__speed=start)
    run.x = run.x
    run.u = model.u(target__speed=target)
    speeds = []
    for _ in range(5500):
        run.step(1e-3)
        y = run.shown()
        speeds.append(y["speed"])
        if y["speed"] > 3:
            assert abs(y["wheel.fl.spin"] * 0.45 / y["speed"] - 1) < 0.5
    assert speeds[-1] == pytest.approx(target, abs=0.6)
    between = np.count_nonzero((np.array(speeds) > 5) & (np.array(speeds) < 15)) * 1e-3  # s
    assert 0.8 * 0.8 * G < 10 / between < 0.8 * G


# ------------------------------------------------------------------------------------------------------- never a NaN


@settings(max_examples=60, deadline=None)
@given(
    state=arrays(float, 33, elements=st.sampled_from([-1.0, -0.5, 0.0, 1e-9, 0.3, 1.0])),
    inputs=arrays(float, 17, elements=st.sampled_from([-1.0, 0.0, 0.5, 1.0])),
    speed=st.sampled_from([0.0, 1e-12, 14.0, 60.0]),
    mode=st.sampled_from([0, 1]),
)
def test_no_nan_anywhere(car, state, inputs, speed, mode):
    scale = np.array([{"f": 1e5}.get(n[0], 1.0) for n in car.inputs])
    u, p = inputs * scale, car.p(driver__mode=mode)
    u[car.inputs.index("target.speed")] = speed
    start = car.start(u, p)
    x = start + state * np.where(np.char.find(car.states, "spin") >= 0, 100.0, 1.0)
    ones = [np.ones(n) for n in (len(x), len(u), len(p))]
    for values in (
        start,
        car.rhs(x, u, p),
        car.f["out"](0, x, u, p),
        *car.f["fwd"](0, x, u, p, *ones),
        car.f["fwd_start"](x, u, p, *ones),
    ):
        assert np.isfinite(np.asarray(values)).all()
    assert np.isfinite(car.c.linearize(x, u, p).A).all()


def test_reference_run_is_finite(car):
    result = simulate(car.c)
    assert np.isfinite(result.outputs).all()
    assert np.ptp(result.outputs[:, result.output_names.index("body.az")]) > 0.1


# --------------------------------------------------------------------------------------------------- published response


def open_loop_response(car, kmh, step=5e-4):
    """J of paper 000 (22a) on the sine road, from x = 5 m on over 150 m."""
    road = road_sine(RoadLayout.of(car.vehicle)).model()
    x, p, heights = ca.SX.sym("x", len(car.states)), car.p(), road.vector("parameter")
    u0 = ca.SX(car.u(target__speed=kmh / 3.6))
    slots = {e.name: e.slot for e in car.c.elements("output")}
    speed = car.f["out"](0, x, u0, p)[slots["speed"]]
    seen = road.functions["out"](0, ca.SX(0, 1), ca.vertcat(x[car.states.index("x")], speed), heights)
    u = ca.vertcat(seen[:8], u0[8:])
    after, before = x, None
    for _ in range(round(1e-3 / step)):
        now = car.f["rhs"](0, after, u, p)
        guess = after + step * (now if before is None else 1.5 * now - 0.5 * before)
        after = after + step / 2 * (now + car.f["rhs"](0, guess, u, p))
        before = now
    y = ca.vertcat(
        car.f["out"](0, x, u, p)[slots["body.az"]], *(x[car.states.index(n)] for n in ("body.pitch", "body.roll", "x"))
    )
    run = ca.Function("step", [x], [after, y]).mapaccum("run", 500)
    at, records = car.start(car.u(target__speed=kmh / 3.6)), []
    while not records or records[-1][3, -1] < 155.0:
        states, record = run(at)
        at = states[:, -1]
        records.append(np.asarray(record))
    y = np.hstack(records)
    y = y[:, y[3] < 155.0][:, ::10]
    return response_objective(y[0], y[1], y[2], 100.0)


def test_open_loop_response_peaks_at_50_kmh_on_the_sine_road(car):
    found = {v: open_loop_response(car, v) for v in (10, 20, 30, 40, 45, 50, 55, 60, 70, 80)}
    peak = max(found, key=found.get)
    assert abs(peak - 50) <= 5, found
    assert found[50] > 1.3 * found[40]
    assert found[50] > 1.3 * found[60]


def test_halving_the_solver_step_does_not_change_the_response(car):
    assert open_loop_response(car, 50, 2.5e-4) == pytest.approx(open_loop_response(car, 50), rel=5e-3)
