"""Ride car against equations written by hand, mirror images, energy, and the modes of its papers."""

import numpy as np
import positive
import pytest
from hypothesis import given, settings
from named import Named

from build_fmus.reference import simulate
from build_fmus.stability import check_solver
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car

VEHICLES = {"RideCarSedan": "sedan", "RideCarHmmwv": "ride_car_hmmwv"}
CORNERS = ("fl", "fr", "rl", "rr")
POSITIONS = ["body.z", "body.roll", "body.pitch", *(f"wheel.{k}.z" for k in CORNERS)]
RATES = ["body.vz", "body.roll_rate", "body.pitch_rate", *(f"wheel.{k}.vz" for k in CORNERS)]
INPUTS = [f"{a}.{k}{b}" for a, b in (("road", ".height"), ("road", ".rate"), ("force", "")) for k in CORNERS]


@pytest.fixture(scope="module", params=VEHICLES)
def car(request):
    return ride_car(load_ride_car(VEHICLES[request.param]), name=request.param).model()


@pytest.fixture(scope="module")
def hmmwv():
    return ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv").model()


def uneven(car, seed=0):
    """Every parameter changed by a factor of its own: nothing is symmetric any more, and all tires have damping."""
    rng = np.random.default_rng(seed)
    values = {e.name: e.start * rng.uniform(0.7, 1.4) for e in car.elements("parameter") if e.name != "solver.step"}
    return values | {f"tire.{k}.damping": rng.uniform(50, 500) for k in CORNERS}


def outputs_by_name(car, x, u, p):
    y = np.asarray(car.functions["out"](0.0, x, u, p)).ravel()
    return {e.name: x[e.slot] if e.variable.role == "state" else y[e.slot] for e in car.output_elements()}


# -------------------------------------------------------------------------------------------- equations by hand


def by_hand(p):
    """A, B and outputs (C, D) from Newton's equations, 004 (7) and (12) and their like, corner by corner."""
    state = {n: i for i, n in enumerate(POSITIONS + RATES)}
    column = {n: i for i, n in enumerate(INPUTS)}
    side = {"fl": 1, "fr": -1, "rl": 1, "rr": -1}

    def length(kind, k, names):
        """Row of coefficients of a deflection in the states: 004 equation (12)."""
        row, (z, roll, pitch, wheel) = np.zeros(14), names
        row[state[wheel.format(k)]] = -1.0 if kind == "suspension" else 1.0
        if kind == "suspension":
            row[state[z]] = 1.0
            row[state[roll]] = side[k] * p[f"wheel.{k}.half_track"]
            row[state[pitch]] = -p[f"wheel.{k}.x"]
        return row

    at, moving = (
        ("body.z", "body.roll", "body.pitch", "wheel.{}.z"),
        ("body.vz", "body.roll_rate", "body.pitch_rate", "wheel.{}.vz"),
    )
    A, B = np.zeros((14, 14)), np.zeros((14, 12))
    for a, b in zip(POSITIONS, RATES, strict=True):
        A[state[a], state[b]] = 1.0
    C, D = {}, {}
    for k in CORNERS:
        s, ds = length("suspension", k, at), length("suspension", k, moving)
        t, dt = length("tire", k, at), length("tire", k, moving)
        r, dr, f = np.zeros(12), np.zeros(12), np.zeros(12)
        r[column[f"road.{k}.height"]] = dr[column[f"road.{k}.rate"]] = f[column[f"force.{k}"]] = 1.0
        C[f"suspension.{k}.deflection"], D[f"suspension.{k}.deflection"] = s, 0 * f
        C[f"suspension.{k}.velocity"], D[f"suspension.{k}.velocity"] = ds, 0 * f
        C[f"tire.{k}.deflection"], D[f"tire.{k}.deflection"] = t, -r
        # Upward forces: of the strut on the body, of the tire on the wheel.
        strut_x, strut_u = -p[f"suspension.{k}.stiffness"] * s - p[f"suspension.{k}.damping"] * ds, f
        kt, ct = p[f"tire.{k}.stiffness"], p[f"tire.{k}.damping"]
        tire_x, tire_u = -kt * t - ct * dt, kt * r + ct * dr
        C[f"tire.{k}.force"], D[f"tire.{k}.force"] = tire_x, tire_u  # and its constant static load
        for row, arm, mass in (
            ("body.vz", 1.0, "body.mass"),
            ("body.roll_rate", side[k] * p[f"wheel.{k}.half_track"], "body.roll_inertia"),
            ("body.pitch_rate", -p[f"wheel.{k}.x"], "body.pitch_inertia"),
        ):
            A[state[row]] += arm * strut_x / p[mass]
            B[state[row]] += arm * strut_u / p[mass]
        A[state[f"wheel.{k}.vz"]] = (tire_x - strut_x) / p[f"wheel.{k}.mass"]
        B[state[f"wheel.{k}.vz"]] = (tire_u - strut_u) / p[f"wheel.{k}.mass"]
    accelerations = (
        "body.az",
        "body.roll_acceleration",
        "body.pitch_acceleration",
        *(f"wheel.{k}.az" for k in CORNERS),
    )
    for name, rate in zip(accelerations, RATES, strict=True):
        C[name], D[name] = A[state[rate]], B[state[rate]]
    for matrix in (C, D):  # the seat rises with y roll - x pitch, and moves ahead with z pitch
        roll, pitch = (matrix[f"body.{angle}_acceleration"] for angle in ("roll", "pitch"))
        matrix["seat.az"] = matrix["body.az"] + p["seat.y"] * roll - p["seat.x"] * pitch
        matrix["seat.ax"] = p["seat.z"] * pitch
    for name, i in state.items():
        C[name], D[name] = np.eye(14)[i], np.zeros(12)
    return A, B, C, D


@pytest.mark.parametrize("changed", [False, True])
def test_matrices_are_those_of_the_equations_by_hand(car, changed):
    values = uneven(car) if changed else {e.name: e.start for e in car.elements("parameter")}
    model = car.linearize(p=car.vector("parameter", values))
    A, B, C, D = by_hand(values)
    assert model.states == POSITIONS + RATES
    assert model.inputs == INPUTS
    assert sorted(model.outputs) == sorted(C)

    def close(given, expected):
        np.testing.assert_allclose(given, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())

    close(model.A, A)
    close(model.B, B)
    for i, name in enumerate(model.outputs):
        close(model.C[i], C[name])
        close(model.D[i], D[name])


def test_roll_equation_7_as_printed():
    """Numbers of 004 Table 1 put into its equation (7); x_1 ... x_4 are LF, LR, RF, RR."""
    car = ride_car(load_ride_car("sedan")).model()
    model = car.linearize()
    tf, tr, inertia, ks, cs = 1.522, 1.510, 460.0, (19960.0, 17500.0), (1290.0, 1620.0)
    row = dict(zip(model.states, model.A[model.states.index("body.roll_rate")], strict=True))
    assert row["body.roll_rate"] == pytest.approx(-0.25 * 2 * (tf**2 * cs[0] + tr**2 * cs[1]) / inertia)
    assert row["body.roll"] == pytest.approx(-0.25 * 2 * (tf**2 * ks[0] + tr**2 * ks[1]) / inertia)
    for k, sign, t, axle in (("fl", 1, tf, 0), ("rl", 1, tr, 1), ("fr", -1, tf, 0), ("rr", -1, tr, 1)):
        assert row[f"wheel.{k}.vz"] == pytest.approx(sign * 0.5 * t * cs[axle] / inertia)
        assert row[f"wheel.{k}.z"] == pytest.approx(sign * 0.5 * t * ks[axle] / inertia)
    force = dict(zip(model.inputs, model.B[model.states.index("body.roll_rate")], strict=True))
    assert [force[f"force.{k}"] * inertia for k in CORNERS] == pytest.approx([0.761, -0.761, 0.755, -0.755])


def test_sedan_has_no_tire_damping_and_the_hmmwv_has():
    for vehicle, damped in (("sedan", False), ("ride_car_hmmwv", True)):
        model = ride_car(load_ride_car(vehicle)).linearize()
        assert bool(np.any(model.B[:, 4:8])) == damped


def test_the_model_is_linear(car):
    """With tires that take tension: the same matrices at any point, and nothing but them.

    Those of the car at rest in any case.
    """
    rng = np.random.default_rng(1)
    x, u, p = rng.standard_normal(14), rng.standard_normal(12), car.vector("parameter", {"tires.lift_off": False})
    model, there = car.linearize(), car.linearize(x, u, p)
    np.testing.assert_array_equal(model.A, there.A)
    np.testing.assert_array_equal(model.B, there.B)
    slope = np.asarray(car.functions["rhs"](0.0, x, u, p)).ravel()
    np.testing.assert_allclose(slope, model.A @ x + model.B @ u, rtol=1e-9, atol=1e-9)


# -------------------------------------------------------------------------------------------------------- mirror


def mirrored(name):
    """Name of the same thing on the other side."""
    return ".".join({"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}.get(part, part) for part in name.split("."))


def mirror_sign(name):
    return -1.0 if "roll" in name and "inertia" not in name else 1.0


def test_mirror_image(car):
    """Exchanging left and right in parameters, inputs and start permutes all outputs over a whole run."""
    values = uneven(car)
    rng = np.random.default_rng(2)
    start = dict(zip(POSITIONS + RATES, 0.02 * rng.standard_normal(14), strict=True))
    runs = []
    for turn in (lambda n: n, mirrored):
        seat = values["seat.y"] * (-1.0 if turn is mirrored else 1.0)
        run = Named(car, {turn(n): v for n, v in values.items()} | {"seat.y": seat})
        sign = (lambda n: 1.0) if turn is not mirrored else mirror_sign
        run.x = [start[turn(n)] * sign(n) for n in POSITIONS + RATES]
        rows, inputs = [], np.random.default_rng(3)
        for _ in range(400):
            given = dict(zip(INPUTS, inputs.standard_normal(12) * np.repeat([0.05, 1.0, 500.0], 4), strict=True))
            run.u[:] = [given[turn(n)] for n in INPUTS]
            run.step(1e-3)
            rows.append(run.shown())
        runs.append(rows)
    original, image = runs
    for name in original[0]:
        a = np.array([row[name] for row in original])
        b = mirror_sign(name) * np.array([row[mirrored(name)] for row in image])
        np.testing.assert_allclose(b, a, rtol=0, atol=1e-9 * max(1.0, np.abs(a).max()))


# -------------------------------------------------------------------------------------------- statics and energy


def test_lifting_the_road_lifts_everything(car):
    """A raised, tilted road plane carries the whole car: no deflection, no acceleration."""
    p = car.vector("parameter", uneven(car))
    v = {e.name: p[e.slot] for e in car.elements("parameter")}
    lift, roll, pitch = 0.3, 0.02, -0.01
    side = {"fl": 1, "fr": -1, "rl": 1, "rr": -1}
    heights = [lift + roll * side[k] * v[f"wheel.{k}.half_track"] - pitch * v[f"wheel.{k}.x"] for k in CORNERS]
    x = np.array([lift, roll, pitch, *heights, *np.zeros(7)])
    u = np.array([*heights, *np.zeros(8)])
    for name, value in outputs_by_name(car, x, u, p).items():
        if "deflection" in name or "acceleration" in name or name.endswith(("az", "velocity")):
            assert value == pytest.approx(0.0, abs=1e-9), name


def test_static_response_to_forces(car):
    """Equal forces at the corners of one axle lift the body there by F/ks; the tires feel nothing."""
    model = car.linearize()
    dc = model.D - model.C @ np.linalg.solve(model.A, model.B)
    u = np.zeros(12)
    u[8:10] = 1000.0
    y = dict(zip(model.outputs, dc @ u, strict=True))
    stiffness = {e.name: e.start for e in car.elements("parameter")}["suspension.fl.stiffness"]
    assert [y[f"suspension.{k}.deflection"] for k in CORNERS] == pytest.approx(
        [1000 / stiffness, 1000 / stiffness, 0, 0], abs=1e-12
    )
    assert [y[f"tire.{k}.deflection"] for k in CORNERS] == pytest.approx([0, 0, 0, 0], abs=1e-12)
    assert y["body.pitch"] < 0  # nose up


def energy(car, x, u, p):
    """Kinetic and elastic energy [J], from outputs alone."""
    v = {e.name: p[e.slot] for e in car.elements("parameter")}
    y = outputs_by_name(car, x, u, p)
    total = v["body.mass"] * y["body.vz"] ** 2
    total += v["body.roll_inertia"] * y["body.roll_rate"] ** 2 + v["body.pitch_inertia"] * y["body.pitch_rate"] ** 2
    for k in CORNERS:
        total += v[f"wheel.{k}.mass"] * y[f"wheel.{k}.vz"] ** 2
        total += v[f"suspension.{k}.stiffness"] * y[f"suspension.{k}.deflection"] ** 2
        total += v[f"tire.{k}.stiffness"] * y[f"tire.{k}.deflection"] ** 2
    return total / 2


def test_energy_balance(car):
    """What actuators and road put in is stored or lost in dampers and tires, over a run, to the solver's accuracy."""
    run = Named(car, uneven(car))
    v = {e.name: run.p[e.slot] for e in car.elements("parameter")}
    h, steps = 4e-4, 1250
    rows, stored = [], []

    def inputs(t):
        w = 2 * np.pi * np.array([2.0, 3.1, 1.3, 4.0])
        return np.concatenate([0.02 * np.sin(w * t), 0.02 * w * np.cos(w * t), 300.0 * np.cos(w * t)])

    def power(x, u):
        y = outputs_by_name(car, x, u, run.p)
        total = 0.0
        for i, k in enumerate(CORNERS):
            rate, tire_rate = y[f"suspension.{k}.velocity"], y[f"wheel.{k}.vz"] - u[4 + i]
            tire = v[f"tire.{k}.stiffness"] * y[f"tire.{k}.deflection"] + v[f"tire.{k}.damping"] * tire_rate
            total += u[8 + i] * rate - v[f"suspension.{k}.damping"] * rate**2
            total -= tire * u[4 + i] + v[f"tire.{k}.damping"] * tire_rate**2  # the road's hold on the tire
        return total

    x = np.zeros(14)
    for i in range(steps + 1):  # classical Runge-Kutta with moving inputs
        t = i * h
        rows.append(power(x, inputs(t)))
        stored.append(energy(car, x, inputs(t), run.p))

        def slope(t, x):
            return np.asarray(car.functions["rhs"](t, x, inputs(t), run.p)).ravel()

        k1 = slope(t, x)
        k2 = slope(t + h / 2, x + h / 2 * k1)
        k3 = slope(t + h / 2, x + h / 2 * k2)
        k4 = slope(t + h, x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    rows, stored = np.array(rows), np.array(stored)
    simpson = h / 3 * (rows[0] + rows[-1] + 4 * rows[1:-1:2].sum() + 2 * rows[2:-2:2].sum())
    assert stored[-1] - stored[0] == pytest.approx(simpson, abs=1e-6 * stored.max())


def test_energy_is_kept_without_dampers(car):
    still = {f"{part}.{k}.damping": 0.0 for part in ("suspension", "tire") for k in CORNERS}
    model = car.linearize(p=car.vector("parameter", uneven(car) | still))
    eigenvalues = np.linalg.eigvals(model.A)
    assert np.abs(eigenvalues.real).max() < 1e-9 * np.abs(eigenvalues).max()


# ------------------------------------------------------------------------------------------- lift-off and friction


def test_static_loads(hmmwv):
    """835 kg on each wheel of the HMMWV: its tires lift off at -8191 N; elsewhere the law of the lever holds."""
    at_rest = Named(hmmwv)
    loads = at_rest.shown()
    assert [loads[f"tire.{k}.force"] for k in CORNERS] == pytest.approx([8191.35] * 4, rel=1e-6)
    behind = {f"wheel.{k}.x": 1.0 if k[0] == "f" else -2.0 for k in CORNERS}
    run = Named(hmmwv, behind)
    loads = run.shown()
    for k in CORNERS:
        share = (2 if k[0] == "f" else 1) / 6
        assert loads[f"tire.{k}.force"] == pytest.approx(9.81 * (135.0 + 2800.0 * share), rel=1e-6)


def test_static_loads_balance_the_weight_of_any_car(hmmwv):
    """Sum and moments about the CG, with four different corners and other masses."""
    values = uneven(hmmwv, seed=4)
    run = Named(hmmwv, values)
    loads = run.shown()
    on_body = np.array([loads[f"tire.{k}.force"] - 9.81 * values[f"wheel.{k}.mass"] for k in CORNERS])
    side = np.array([1 if k[1] == "l" else -1 for k in CORNERS])
    assert on_body.sum() == pytest.approx(9.81 * values["body.mass"], rel=1e-6)
    for arm in (side * [values[f"wheel.{k}.half_track"] for k in CORNERS], [values[f"wheel.{k}.x"] for k in CORNERS]):
        assert on_body @ arm == pytest.approx(0.0, abs=1e-5 * np.abs(on_body).max())


def test_a_wheel_in_the_air_falls_under_its_weight(hmmwv):
    """Road far below: no tire force, wheel and body in free fall; with tires that take tension they are drawn down."""
    for lift_off, expected in ((True, -9.81), (False, -9.81 * 0.5 * 500e3 / 8191.35)):
        run = Named(hmmwv, {"tires.lift_off": lift_off})
        run.u[:4] = -0.5
        y = run.shown()
        force = y["tire.fl.force"]
        assert force == pytest.approx(0.0 if lift_off else 8191.35 - 0.5 * 500e3)
        assert y["wheel.fl.az"] == pytest.approx((force - 8191.35) / 135.0)
        assert y["body.az"] == 0.0
        total = sum(135.0 * y[f"wheel.{k}.az"] for k in CORNERS) / 3340.0
        assert total == pytest.approx(expected, rel=1e-4)


def test_tires_never_pull(hmmwv):
    """Any motion and road: the force is that of the linear tire, and never below zero."""
    rng = np.random.default_rng(5)
    p, linear = (hmmwv.vector("parameter", {"tires.lift_off": on}) for on in (True, False))
    below = 0
    for _ in range(200):
        x, u = 0.05 * rng.standard_normal(14), 0.05 * rng.standard_normal(12)
        limited, free = (outputs_by_name(hmmwv, x, u, q) for q in (p, linear))
        for k in CORNERS:
            assert limited[f"tire.{k}.force"] == pytest.approx(max(0.0, free[f"tire.{k}.force"]), abs=1e-6)
            below += free[f"tire.{k}.force"] < 0
    assert below > 50


def test_friction_only_dissipates(hmmwv):
    """Friction takes F |v| from each suspension, to within its smoothing; off, the car is the same without it."""
    rng = np.random.default_rng(6)
    p, without = (hmmwv.vector("parameter", {"friction.acting": on}) for on in (True, False))
    mass = np.array([2800.0, 1450.0, 7632.0, *[135.0] * 4])
    for _ in range(50):
        x, u = 0.1 * rng.standard_normal(14), np.zeros(12)
        rates = [np.asarray(hmmwv.functions["rhs"](0.0, x, u, q)).ravel() for q in (p, without)]
        power = float(mass * x[7:] @ (rates[0] - rates[1])[7:])
        travel = [outputs_by_name(hmmwv, x, u, p)[f"suspension.{k}.velocity"] for k in CORNERS]
        assert power == pytest.approx(-sum(120.0 * v * v / np.hypot(v, 0.01) for v in travel), rel=1e-9)
        assert power < 0


def test_controllers_are_designed_on_the_car_without_friction(hmmwv):
    """It is off at the start, so `linearize` has none; switched on it would be a damper of F / v_s about rest."""
    assert hmmwv.variable("friction.acting").start == (0.0,)
    with_friction = hmmwv.linearize(p=hmmwv.vector("parameter", {"friction.acting": True}))
    damped = hmmwv.linearize(p=hmmwv.vector("parameter", {f"suspension.{k}.damping": 18e3 for k in CORNERS}))
    np.testing.assert_allclose(with_friction.A, damped.A, rtol=1e-12, atol=1e-9)


def test_the_sedan_has_no_friction():
    names = [e.name for e in ride_car(load_ride_car("sedan")).model().elements("parameter")]
    assert not [n for n in names if "friction" in n]


# --------------------------------------------------------------------------------------------------------- modes


def frequencies(car, p=None):
    eigenvalues = np.linalg.eigvals(car.linearize(p=p).A)
    return np.sort(np.abs(eigenvalues[eigenvalues.imag > 0])) / (2 * np.pi)


def test_modes_of_the_hmmwv(hmmwv):
    """Body modes near the 2 Hz and hop near the 10 Hz of paper 001."""
    heave, pitch, roll, *hop = frequencies(hmmwv)
    assert [heave, pitch, roll] == pytest.approx([1.92, 1.92, 2.48], abs=0.005)
    assert [hop[0], hop[-1]] == pytest.approx([10.28, 10.79], abs=0.01)


def test_heave_roll_and_pitch_are_what_their_names_say(hmmwv):
    """The mode of each body coordinate: with a symmetric car heave, roll and pitch do not mix."""
    model = hmmwv.linearize()
    values, vectors = np.linalg.eig(model.A)
    body = {n: model.states.index(n) for n in POSITIONS[:3]}
    for name, frequency in (("body.z", 1.92), ("body.pitch", 1.92), ("body.roll", 2.48)):
        moves = np.abs(vectors[body[name]]) > 1e-6 * np.abs(vectors).max(axis=0)
        low = np.abs(values) / (2 * np.pi) < 5
        assert np.abs(values[moves & low]) / (2 * np.pi) == pytest.approx(frequency, abs=0.005)


@given(positive.parameters({k: (0.3, 5.0) if k[0] == "f" else (-5.0, -0.3) for k in CORNERS}))
@settings(deadline=None, max_examples=100)
def test_positive_parameters_are_always_stable(hmmwv, values):
    positive.check_stable(hmmwv, values)


def test_reference_run_is_finite_and_solver_stable(car):
    check_solver(car)
    assert np.isfinite(simulate(car).outputs).all()


# ------------------------------------------------------------------------------------------------- vehicle files


def test_values_of_the_sedan():
    car = load_ride_car("sedan")
    assert car.body.mass.value == 1460.0
    assert "1400" in car.body.mass.source
    assert car.wheel.front.x.value - car.wheel.rear.x.value == pytest.approx(2.814)
    variable = ride_car(car).variable("suspension.rr.damping")
    assert variable.start == (1620.0,)
    assert variable.source.startswith("004 Table 1")


def test_one_wheel_may_differ(hmmwv):
    run = Named(hmmwv, {"suspension.rl.damping": 0.0})
    run.u[4:8] = 1.0
    run.x = np.array([0.0] * 7 + [1.0] + [0.0] * 6)
    y = run.shown()
    assert y["body.az"] == pytest.approx(-3 * 6000 / 2800)


def test_friction_and_lift_off_of_a_file(tmp_path):
    """Any ride car may have both."""
    path = tmp_path / "mine.toml"
    head = 'base = "sedan"\ntires_lift_off = true\n[suspension.rear.friction]\n'
    force = 'force = { value = 0.2, unit = "kN", source = "me" }\n'
    path.write_text(head + force + 'speed = { value = 0.02, unit = "m/s", source = "me" }\n')
    car = ride_car(load_ride_car(path)).model()
    assert car.variable("tires.lift_off").start == (1.0,)
    assert car.variable("suspension.rl.friction.force").start == (200.0,)
    assert not [e for e in car.elements("parameter") if "fl.friction" in e.name]
    run = Named(car, {"friction.acting": True})
    run.x = [0.0] * 7 + [1.0] + [0.0] * 6
    sliding, smooth = (Named(car, {"friction.acting": on}).rhs(0.0, run.x)[7] for on in (True, False))
    assert (sliding - smooth) * 1460.0 == pytest.approx(-2 * 200.0, rel=1e-3)
