"""Kalman filters of the HMMWV against independent Riccati recursions, and on simulated noise."""

import math

import numpy as np
import pytest
import scipy.linalg

from fmu_sources.estimators import kalman_hmmwv, kalman_hmmwv_printed
from fmu_sources.estimators.kalman_design import kalman_filter, sampled_model
from fmu_sources.models.corners import CORNERS
from fmu_sources.models.hmmwv_states import (
    BODY_SPEED,
    FORCES,
    RELATIVE_STATES,
    ROAD_HEIGHTS,
    ROAD_RATES,
    SUSPENSION,
    TIRE,
    relative_model,
)
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car, load_sensors

PERIOD = 5e-3
FRONT, REAR, HALF_TRACK = 1.651, -1.651, 0.91
MEASURED = (
    *(f"lvdt.{k}" for k in CORNERS),
    *(f"hub.{k}.az" for k in CORNERS),
    "chassis.front.az",
    "chassis.rear.az",
    "gyro.pitch_rate",
    "gyro.roll_rate",
)
SIGMA = np.array([0.5e-3] * 4 + [0.5] * 4 + [0.1] * 2 + [5e-3] * 2)
LOAD_CELL = 50.0
ROAD, KNOWN_ROAD = 7e-3, 1e-3
VERTICAL = np.array([n.endswith(".vz") for n in RELATIVE_STATES])


@pytest.fixture(scope="module")
def car():
    return ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")


@pytest.fixture(scope="module")
def relative(car):
    return kalman_hmmwv(car, load_sensors("sensors_hmmwv")).model()


@pytest.fixture(scope="module")
def printed(car):
    return kalman_hmmwv_printed(car, load_sensors("sensors_hmmwv")).model()


class Run:
    """A filter in Python: set inputs by name, tick, read outputs by name."""

    def __init__(self, component, **parameters):
        self.c = component
        self.p, self.u = component.vector("parameter"), component.vector("input")
        self.at = {e.name: e.slot for e in component.elements("parameter", "input")}
        self.out = {e.name: e.slot for e in component.output_elements()}
        for name, value in parameters.items():
            self.p[self.at[name.replace("__", ".")]] = value
        self.x, self.k = None, 0

    def start(self):
        return np.asarray(self.c.functions["start"](self.c.vector("state"), self.u, self.p)).ravel()

    def set(self, **inputs):
        for name, value in inputs.items():
            self.u[self.at[name]] = value

    def tick(self, commit=True):
        x = self.start() if self.x is None else self.x
        nxt, y = self.c.functions["tick"](self.k * PERIOD, x, self.u, self.p)
        if commit:
            self.x, self.k = np.asarray(nxt).ravel(), self.k + 1
        return np.asarray(y).ravel()

    def estimates(self, y, prefix=""):
        return np.array([y[self.out[prefix + n]] for n in RELATIVE_STATES])


def noisy_model(car, road):
    """A, C, Q, R, S put together from the car's linear model by hand.

    Last the R of a sample whose road is not known yet.
    """
    lin, m = car.linearize(), relative_model(car)
    rows = []
    for name in MEASURED:
        kind, _, place = name.partition(".")
        if kind == "lvdt":
            rows.append([(1.0, f"suspension.{place}.deflection")])
        elif kind == "hub":
            rows.append([(1.0, f"wheel.{place[:2]}.az")])
        elif kind == "chassis":
            x, y = (FRONT, HALF_TRACK) if place == "front.az" else (REAR, -HALF_TRACK)
            rows.append([(1.0, "body.az"), (-x, "body.pitch_acceleration"), (y, "body.roll_acceleration")])
        else:
            rows.append([(1.0, f"body.{place}")])
    at = [np.array([sum(f * (n == o) for f, n in row) for o in lin.outputs]) for row in rows]
    select = np.array(at)
    u, w = ([lin.inputs.index(n) for n in group] for group in (FORCES, ROAD_RATES))
    h = [lin.inputs.index(n) for n in ROAD_HEIGHTS]
    # C of the relative states from that of the absolute ones, for motions that the relative states see
    C = np.hstack([select @ lin.C, select @ lin.D[:, h]]) @ np.linalg.pinv(np.hstack([m.T, m.R]))
    D, F = select @ lin.D[:, u], select @ lin.D[:, w]
    n = 15
    block = np.zeros((n + 8, n + 8))
    block[:n] = np.hstack([m.A, m.B, m.E])
    block = scipy.linalg.expm(block * PERIOD)
    A, B, E = block[:n, :n], block[:n, n : n + 4], block[:n, n + 4 :]
    noise = scipy.linalg.block_diag(LOAD_CELL**2 * np.eye(4), road / PERIOD * np.eye(4))
    G, H = np.hstack([B, E]), np.hstack([D, F])
    R, ahead = H @ noise @ H.T + np.diag(SIGMA**2), (ROAD - road) / PERIOD * F @ F.T
    return A, C, G @ noise @ G.T, R, G @ noise @ H.T, R + ahead


def riccati(A, C, Q, R, S, P, steps):
    """Covariance of the prediction after steps of the textbook recursion with cross-covariance."""
    for _ in range(steps):
        Re = C @ P @ C.T + R
        K = np.linalg.solve(Re, (A @ P @ C.T + S).T).T
        P = A @ P @ A.T + Q - K @ Re @ K.T
        P = (P + P.T) / 2
    return P


def gain_for(P, C, R):
    """Gain of a measurement."""
    return np.linalg.solve(C @ P @ C.T + R, C @ P).T


def gain_of(run):
    """Gain of an FMU: what its estimates do when one measurement changes (it is linear in them)."""
    base = run.estimates(run.tick(commit=False))
    columns = []
    for name in MEASURED:
        value = run.u[run.at[name]]
        run.set(**{name: value + 1.0})
        columns.append(run.estimates(run.tick(commit=False)) - base)
        run.set(**{name: value})
    return np.array(columns).T


# ---------------------------------------------------------------------------------------------------------------- gains


@pytest.mark.parametrize(("use_road", "road"), [(0, ROAD), (1, KNOWN_ROAD)])
def test_steady_state_gain_is_the_riccati_solution(car, relative, use_road, road):
    A, C, Q, R, S, ahead = noisy_model(car, road)
    P = scipy.linalg.solve_discrete_are(A.T, C.T, Q, R, s=S)
    expected = gain_for(P, C, ahead)
    gain = gain_of(Run(relative, use_road=use_road))
    assert np.abs(gain - expected).max() <= 1e-9 * np.abs(expected).max()
    P = riccati(A, C, Q, R, S, P, 50)  # a fixed point of the recursion, not only of the solver
    assert np.abs(gain - gain_for(P, C, ahead)).max() <= 1e-9 * np.abs(expected).max()


def test_the_filter_is_stable(car, relative):
    A, C, _, R, S, _ = noisy_model(car, ROAD)
    L = gain_of(Run(relative))
    Y = np.linalg.solve(R, S.T).T
    poles = np.linalg.eigvals((A - Y @ C) @ (np.eye(15) - L @ C))
    assert np.abs(poles).max() < 1.0


@pytest.mark.parametrize("use_road", [0, 1])
def test_time_varying_gain_follows_the_riccati_recursion(car, relative, use_road):
    A, C, Q, R, S, ahead = noisy_model(car, (ROAD, KNOWN_ROAD)[use_road])
    run = Run(relative, time_varying=1, use_road=use_road)
    sigma = {"deflection": 0.03, "vz": 0.5, "rate": 0.3}
    P = np.diag([sigma[n.replace("_", ".").rsplit(".", 1)[-1]] ** 2 for n in RELATIVE_STATES])
    for _ in range(4):
        expected = gain_for(P, C, ahead)
        gain, sigmas = gain_of(run), run.estimates(run.tick(commit=False), "sigma.")
        assert np.abs(gain - expected).max() <= 1e-9 * np.abs(expected).max()
        posterior = P - expected @ C @ P
        assert sigmas == pytest.approx(np.sqrt(np.diag(posterior)), rel=1e-7)
        run.tick()
        P = riccati(A, C, Q, R, S, P, 1)


def test_time_varying_converges_to_the_steady_state(relative):
    """Quickly but for the vertical velocity of the whole car, which only the mean of the road's rate shows."""
    run, steady = Run(relative, time_varying=1), Run(relative)
    settled = steady.estimates(steady.tick(), "sigma.")
    for _ in range(200):
        y = run.tick()
    assert run.estimates(y, "sigma.")[~VERTICAL] == pytest.approx(settled[~VERTICAL], rel=0.01)
    for _ in range(6000):
        y = run.tick()
    assert run.estimates(y, "sigma.")[~VERTICAL] == pytest.approx(settled[~VERTICAL], rel=1e-6)
    assert run.estimates(y, "sigma.")[VERTICAL] == pytest.approx(settled[VERTICAL], rel=0.03)
    assert np.abs(gain_of(run) - gain_of(steady)).max() < 1e-3 * np.abs(gain_of(steady)).max()


def test_design_says_when_there_is_no_filter():
    """A mode that grows and that nothing measures."""
    zero = np.zeros((1, 1))
    model = sampled_model(
        np.diag([1.0, -1.0]),
        np.zeros((2, 1)),
        np.ones((2, 1)),
        np.array([[0.0, 1.0]]),
        zero,
        zero,
        measured=np.ones(1),
        force=0.0,
        road=1.0,
        period=0.1,
    )
    with pytest.raises(ValueError, match="Kalman filter"):
        kalman_filter(model)


# ------------------------------------------------------------------------------------------------------ simulated noise


class Truth:
    """The car with road heights and forces of its own: true states and noisy measurements at 200 Hz.

    Forces and road rates are held over a sample; the motion in between is exact.
    """

    def __init__(self, car, steps, road=ROAD, seed=1, heights=None):
        lin = car.linearize()
        rng = np.random.default_rng(seed)
        n = len(lin.states)
        force, height, rate = ([lin.inputs.index(x) for x in group] for group in (FORCES, ROAD_HEIGHTS, ROAD_RATES))
        # states and heights; forces and rates
        block = np.zeros((n + 12, n + 12))
        block[:n] = np.hstack([lin.A, lin.B[:, height], lin.B[:, force], lin.B[:, rate]])
        block[n : n + 4, n + 8 :] = np.eye(4)
        block = scipy.linalg.expm(block * PERIOD)
        A, B = block[: n + 4, : n + 4], block[: n + 4, n + 4 :]
        C, D = np.hstack([lin.C, lin.D[:, height]]), lin.D[:, force + rate]
        x = np.zeros(n + 4)
        rows = []
        self.forces, self.heights = [], []
        for k in range(steps):
            forces = 400.0 * np.sin(2 * np.pi * 1.5 * k * PERIOD + np.arange(4))
            if heights is None:
                rates = rng.standard_normal(4) * math.sqrt(road / PERIOD)
            else:
                rates = (heights((k + 1) * PERIOD) - heights(k * PERIOD)) / PERIOD
            u = np.concatenate([forces, rates])
            rows.append(C @ x + D @ u)
            self.forces.append(forces + LOAD_CELL * rng.standard_normal(4))
            self.heights.append(x[n:].copy())
            x = A @ x + B @ u
        y = dict(zip(lin.outputs, np.array(rows).T, strict=True))
        self.states = np.column_stack([y[s] for s in RELATIVE_STATES])
        self.pose = np.column_stack([y[s] for s in ("body.z", "body.roll", "body.pitch")])
        chassis = [
            y["body.az"] - a * y["body.pitch_acceleration"] + b * y["body.roll_acceleration"]
            for a, b in ((FRONT, HALF_TRACK), (REAR, -HALF_TRACK))
        ]
        exact = [*(y[s] for s in SUSPENSION), *(y[f"wheel.{k}.az"] for k in CORNERS), *chassis]
        exact = np.column_stack([*exact, y["body.pitch_rate"], y["body.roll_rate"]])
        self.measured = exact + SIGMA * rng.standard_normal(exact.shape)

    def drive(self, component, with_road=False, **parameters):
        """Estimates, their sigmas and the poses over the run.

        The car of this truth is linear: its tires take tension.
        """
        if component.name == "KalmanHmmwv":
            parameters = {"tires__lift_off": 0, **parameters}
        run = Run(component, **parameters)
        rows = []
        for measured, forces, heights in zip(self.measured, self.forces, self.heights, strict=True):
            run.set(**dict(zip(MEASURED, measured, strict=True)))
            run.set(**dict(zip((f"loadcell.{k}" for k in CORNERS), forces, strict=True)))
            if with_road:
                run.set(**dict(zip(ROAD_HEIGHTS, heights, strict=True)))
            rows.append(run.tick())
        y = np.array(rows)
        columns = [[run.out[p + n] for n in RELATIVE_STATES] for p in ("", "sigma.")]
        pose = y[:, [run.out[n] for n in ("body.z", "body.roll", "body.pitch")]]
        return y[:, columns[0]], y[:, columns[1]], pose


@pytest.fixture(scope="module")
def truth(car):
    return Truth(car, 4000)


@pytest.mark.parametrize("time_varying", [0, 1])
def test_errors_stay_within_three_sigma(relative, truth, time_varying):
    estimate, sigma, _ = truth.drive(relative, time_varying=time_varying)
    error = estimate - truth.states
    inside = (np.abs(error) <= 3 * sigma).mean(axis=0)
    assert inside.min() >= 0.95, dict(zip(RELATIVE_STATES, inside, strict=True))
    ratio = error[400:].std(axis=0) / sigma[-1]
    assert np.all((ratio[~VERTICAL] > 0.9) & (ratio[~VERTICAL] < 1.1)), "sigma is neither boastful nor timid"
    assert np.all((ratio[VERTICAL] > 0.2) & (ratio[VERTICAL] < 2.0))  # their errors last for seconds: few samples


def test_known_road_helps(relative, truth):
    """The differences of the road's height leave less to guess; sigma knows it."""
    without, sigma_without, _ = truth.drive(relative)
    known, sigma_known, _ = truth.drive(relative, with_road=True, use_road=1)
    assert np.all(sigma_known[-1] <= sigma_without[-1] * (1 + 1e-9))
    errors = [np.sqrt(((e - truth.states)[400:] ** 2).mean(axis=0)) for e in (known, without)]
    assert np.all(errors[0] < 1.001 * errors[1])
    assert np.all(errors[0][VERTICAL] < 0.95 * errors[1][VERTICAL])
    assert ((np.abs(known - truth.states) <= 3 * sigma_known).mean(axis=0)).min() >= 0.95


def bump(t):
    """A bump of 76 mm, 0.5 m long, at 20 mph; the rear wheels follow."""
    s = np.array([1.651, 1.651, -1.651, -1.651]) + 8.94 * t - 5.0
    return np.where((s > 0) & (s < 0.5), 0.076 * np.sin(np.pi * s / 0.5) ** 2, 0.0)


@pytest.fixture(scope="module")
def over_a_bump(car):
    return Truth(car, 300, heights=bump)


def test_the_printed_filter_assumes_a_flat_road(relative, printed, over_a_bump):
    """Tire deflections: 15 states follow them, 14 absolute ones miss most of them.

    Known road heights would mend that.
    """
    tire = [RELATIVE_STATES.index(n) for n in TIRE]
    true = over_a_bump.states[:, tire]

    def miss(component, **options):
        return (over_a_bump.drive(component, **options)[0][:, tire] - true).std() / true.std()

    assert miss(relative) < 0.15
    assert miss(printed) > 0.5
    assert miss(printed, with_road=True, use_road=1) < 0.15


def test_the_printed_filter_is_right_on_a_flat_road(car, printed):
    flat = Truth(car, 600, heights=lambda _: np.zeros(4))
    estimate, sigma, _ = flat.drive(printed)
    assert np.mean(np.abs(estimate - flat.states) <= 3 * sigma) > 0.9
    assert np.abs((estimate - flat.states)[:, [RELATIVE_STATES.index(n) for n in SUSPENSION]]).max() < 2e-3


def test_tires_that_lift_off(car, relative):
    """The car itself over a bump of 76 mm on a known road.

    A filter whose tires take no tension either is closer to it.
    """
    lin, model = car.linearize(), car.model()
    at = {n: i for i, n in enumerate(lin.inputs)}
    outputs = {e.name: i for i, e in enumerate(model.output_elements())}
    rhs, out = model.functions["rhs"], model.functions["out"]
    x, u, p = np.zeros(14), model.vector("input"), model.vector("parameter")
    slots = {e.name: e.slot for e in model.elements("output")}
    runs = {off: Run(relative, use_road=1, tires__lift_off=off) for off in (0, 1)}
    h, errors, tires = 5e-4, {0: [], 1: []}, []
    assert set(outputs) >= set(RELATIVE_STATES)
    for k in range(2400):
        heights, after = bump(k * h), bump((k + 1) * h)
        u[[at[n] for n in ROAD_HEIGHTS]] = heights
        u[[at[n] for n in ROAD_RATES]] = (after - heights) / h
        if k % 10 == 0:
            y = np.asarray(out(0.0, x, u, p)).ravel()
            y = {n: y[slots[n]] if n in slots else x[lin.states.index(n)] for n in outputs}
            chassis = [
                y["body.az"] - a * y["body.pitch_acceleration"] + b * y["body.roll_acceleration"]
                for a, b in ((FRONT, HALF_TRACK), (REAR, -HALF_TRACK))
            ]
            exact = [*(y[n] for n in SUSPENSION), *(y[f"wheel.{c}.az"] for c in CORNERS), *chassis]
            exact += [y["body.pitch_rate"], y["body.roll_rate"]]
            true = np.array([y[n] for n in RELATIVE_STATES])
            tires.append(max(true[4:8]))
            for off, run in runs.items():
                run.set(**dict(zip(MEASURED, exact, strict=True)), **dict(zip(ROAD_HEIGHTS, heights, strict=True)))
                errors[off].append((run.estimates(run.tick()) - true)[4:8])
        k1 = np.asarray(rhs(0.0, x, u, p)).ravel()
        x = x + h * np.asarray(rhs(0.0, x + h / 2 * k1, u, p)).ravel()
    assert max(tires) > 0.020, "the wheels leave the ground, 16 mm above rest"
    linear, lifting = (np.sqrt(np.mean(np.square(errors[off]))) for off in (0, 1))
    assert lifting < 0.5 * linear


# ----------------------------------------------------------------------------------------------------------------- pose


def test_pose_over_a_bump(relative, printed, over_a_bump):
    """Integrated rates follow heave and pitch over a bump; believing in a flat road does not."""
    errors = [np.abs(over_a_bump.drive(c)[2] - over_a_bump.pose)[:, (0, 2)] for c in (relative, printed)]
    ahead = [e[:, 0] + 3.7 * e[:, 1] for e in errors]  # at the spot of the range sensors
    assert ahead[0].max() < 0.02
    assert ahead[1].max() > 0.025


def test_pose_without_road_leaks(relative):
    """A lasting pitch rate of the gyros tilts the pose to a finite angle; the pose then fades."""
    run = Run(relative, pose__leak=0.5)
    run.set(**{"gyro.pitch_rate": 0.02})
    tilted = [run.tick()[run.out["body.pitch"]] for _ in range(2000)][-1]
    assert 0 < tilted < 0.02
    run.set(**{"gyro.pitch_rate": 0.0})
    faded = [run.tick()[run.out["body.pitch"]] for _ in range(1000)]
    assert abs(faded[-1]) < 0.02 * tilted


def test_pose_on_a_known_road(relative):
    """At rest on a road tilted to all sides the pose goes to what road and springs give, less what leaks."""
    heights = {"fl": 0.05, "fr": 0.03, "rl": 0.01, "rr": -0.01}  # a plane
    run = Run(relative, use_road=1, pose__correction=0.5, pose__leak=1e4)
    run.set(**{f"road.{k}.height": v for k, v in heights.items()})
    for _ in range(2000):
        y = run.tick()
    assert y[run.out["body.z"]] == pytest.approx(0.02, rel=1e-3)
    assert y[run.out["body.roll"]] == pytest.approx(0.02 / 1.82, rel=1e-3)
    assert y[run.out["body.pitch"]] == pytest.approx(-0.04 / 3.302, rel=1e-3)


def test_losing_the_road_changes_nothing_at_once(relative):
    """road.valid may come and go: the pose continues from where it is, and a jump of held heights drives nothing."""
    run = Run(relative, use_road=1)
    for k in range(400):
        height = 0.02 * math.sin(0.05 * k) if k < 200 else 0.5
        run.set(**{f"road.{c}.height": height for c in CORNERS}, **{"road.valid": k < 200})
        y = run.tick()
        assert y[run.out["road.used"]] == (k < 200)
        if k == 199:
            before = y
        if k == 200:
            pose = [run.out[n] for n in ("body.z", "body.roll", "body.pitch")]
            assert y[pose] == pytest.approx(before[pose], abs=2e-3)
            assert run.estimates(y) == pytest.approx(run.estimates(before), abs=0.05)
    run.set(**{f"road.{c}.height": 0.5 for c in CORNERS}, **{"road.valid": True})
    first = run.tick()
    assert np.abs(run.estimates(first) - run.estimates(y)).max() < 0.01, "the first known height has no rate"


def test_names_and_units_are_those_of_the_car(car, relative, printed):
    for c in (relative, printed):
        for name in (*RELATIVE_STATES, "body.z", "body.roll", "body.pitch", "body.az"):
            assert c.variable(name).unit == car.variable(name).unit
            assert c.variable(name).output
        assert {f"sigma.{n}" for n in RELATIVE_STATES} <= {e.name for e in c.output_elements()}
        assert set(BODY_SPEED) <= set(RELATIVE_STATES)
        reached = set(c.dependencies["body.vz"])
        assert set(MEASURED) <= reached
