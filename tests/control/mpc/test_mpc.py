"""The MPC library: exact models, the program against an independent solver, cases, observers, bad input."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from named import Named
from oracles.mpc import MpcReference
from scipy import integrate

from build_fmus.component import Component, DeclarationError, Model
from build_fmus.qp import Daqp, Osqp
from fmu_sources.controllers.mpc import (
    Case,
    Disturbance,
    Filter,
    Horizon,
    Input,
    Mpc,
    MpcError,
    MpcModel,
    Observer,
    Output,
    Preview,
    add_mpc,
    filter_inputs,
    filter_output,
    mpc_component,
    previous_command,
)
from fmu_sources.controllers.mpc.qp import CondensedQp
from fmu_sources.plants import quarter_car
from fmu_sources.vehicles import load_quarter_car

PERIOD = 0.010
STATES = ("body.z", "body.vz", "wheel.z", "wheel.vz")
OUTPUTS = ("body.az", "suspension.deflection", "tire.deflection", "body.z")
ROAD = (Disturbance("road", "road.height", "road.rate"),)


@pytest.fixture(scope="module")
def car() -> Component:
    return quarter_car(load_quarter_car("quarter_car_hmmwv"))


@pytest.fixture(scope="module")
def model(car: Component) -> MpcModel:
    return MpcModel.sampled(car.linearize(), PERIOD, inputs=["force"], outputs=OUTPUTS, disturbances=ROAD)


def settings(model: MpcModel, **changes) -> Mpc:
    """Everything at once: soft and hard bounds, rates, a reference, blocks, two cases."""
    mpc = Mpc(
        model,
        inputs=(
            Input("force", scale=1e4, weight=0.1, rate_weight=0.1, min=-4e3, max=4e3, rate_min=-1e3, rate_max=1.5e3),
        ),
        outputs=(
            Output("body.az", weight=1.0),
            Output("suspension.deflection", scale=0.1, weight=1.0, min=-0.01, max=0.012, ecr=0.5),
            Output("body.z", scale=0.1, weight=2.0, reference="reference.height"),
        ),
        horizon=Horizon(20, blocks=(1, 1, 2, 4)),
        cases=(
            Case("nominal"),
            Case(
                "lifted",
                {
                    "force": {"min": 500.0, "weight": 0.3},
                    "body.az": {"weight": 0.2},
                    "suspension.deflection": {"max": 0.005},
                },
            ),
        ),
    )
    return replace(mpc, **changes)


# ---------------------------------------------------------------------------------------------------------- the models


@pytest.mark.parametrize("hold", ["foh", "zoh"])
def test_sampled_model_is_the_solution_of_the_differential_equations(car, hold) -> None:
    m = MpcModel.sampled(car.linearize(), PERIOD, inputs=["force"], outputs=OUTPUTS, disturbances=ROAD, hold=hold)
    lin = car.linearize()
    x0, u, w0, w1 = np.array([0.02, -0.3, 0.01, 0.5]), 700.0, 0.013, -0.008
    slope = (w1 - w0) / PERIOD

    def rhs(t: float, x: np.ndarray) -> np.ndarray:
        height = w0 + slope * t if hold == "foh" else w0
        inputs = {"road.height": height, "road.rate": slope, "force": u}
        return lin.A @ x + lin.B @ np.array([inputs[n] for n in lin.inputs])

    exact = integrate.solve_ivp(rhs, (0, PERIOD), x0, rtol=1e-11, atol=1e-13).y[:, -1]
    got = m.A @ x0 + m.B[:, 0] * u + m.E0[:, 0] * w0 + m.E1[:, 0] * w1
    np.testing.assert_allclose(got, exact, rtol=0, atol=1e-9)


def test_filters_in_series_have_the_product_of_the_responses(car) -> None:
    lin = car.linearize()
    one, two = Filter.second_order(30.0, 0.4), Filter.second_order(50.0, 0.7, gain=3.0, rate=True)
    both = filter_output(filter_inputs(lin, ["force"], one.then(one)), "body.az", two, "felt")
    s = 17.0j

    def at(lin_, output, input_):
        i, j = lin_.outputs.index(output), lin_.inputs.index(input_)
        return (lin_.C[i] @ np.linalg.solve(s * np.eye(len(lin_.A)) - lin_.A, lin_.B[:, j])) + lin_.D[i, j]

    H1 = 900.0 / (s * s + 24.0 * s + 900.0)
    H2 = 3.0 * s / (s * s + 70.0 * s + 2500.0)
    assert at(both, "felt", "force") == pytest.approx(at(lin, "body.az", "force") * H1**2 * H2)
    assert at(both, "body.az", "force") == pytest.approx(at(lin, "body.az", "force") * H1**2)
    assert at(both, "felt", "road.height") == pytest.approx(at(lin, "body.az", "road.height") * H2)


# --------------------------------------------------------------------------------------------------------- the program


def law(mpc: Mpc, car: Component, backend=None, observer=None) -> Model:
    return mpc_component(
        mpc,
        car,
        name="Law",
        description="test",
        source="test",
        backend=backend,
        observer=observer,
        preview=Preview({"road": "preview"}, 21, PERIOD),
    ).model()


def test_component_solves_the_problem_of_the_reference(car, model) -> None:
    """All kinds of bounds, references, preview and both cases, at random states, in and out of the bounds."""
    mpc = settings(model)
    c, reference = law(mpc, car), MpcReference(mpc)
    ev = Named(c)
    slot = {e.name: e.slot for e in c.elements("input")}
    random = np.random.default_rng(0)
    previous, active, slack = np.zeros(1), 0, 0.0
    for k in range(150):
        x = random.normal(size=4) * [0.03, 0.3, 0.03, 0.5]
        road, requested, case = random.normal(size=21) * 0.02, random.normal(size=20) * 0.05, k // 7 % 2
        for n, v in zip(STATES, x, strict=True):
            ev.u[slot[n]] = v
        ev.u[slot["case"]], ev.u[slot["use_preview"]] = case, k % 3 > 0
        for i in range(21):
            ev.u[slot[f"preview[{i + 1}]"]] = road[i]
        for i in range(20):
            ev.u[slot[f"reference.height[{i + 1}]"]] = requested[i]
        ev.step(PERIOD)
        got = ev.shown()
        w = np.append(road, road[-1])[None, :] * (k % 3 > 0)
        r = np.vstack([np.zeros((2, 20)), np.append(requested[1:], requested[-1])])
        step = reference.step(x, previous, w, r, case)
        assert got["solver.status"] == 0
        assert got["solver.residual"] <= 1e-6
        assert got["force"] == pytest.approx(step.command[0], abs=1e-3 * 4e3)
        assert got["slack"] == pytest.approx(step.slack, abs=1e-5)
        change = got["force"] - previous[0]
        assert -1e3 - 1e-9 <= change <= 1.5e3 + 1e-9
        active += min(abs(change + 1e3), abs(change - 1.5e3)) < 1e-6
        slack = max(slack, got["slack"])
        previous = np.array([got["force"]])
    assert active > 20  # the bounds matter
    assert slack > 0.1


def test_predicted_outputs_are_measured_before_the_command_of_their_sample(car, model) -> None:
    """As a controller reads its plant: the acceleration at k + 1 still feels u(k)."""
    reference = MpcReference(settings(model))
    lin, names = car.linearize(), ["body.az", "suspension.deflection", "body.z"]
    x, previous, moves = (
        np.array([0.02, -0.3, 0.01, 0.5]),
        np.array([200.0]),
        np.array([[400.0], [-900.0], [0.0], [50.0]]),
    )
    predicted = reference.predict(x, previous, moves, np.zeros((1, 22)))
    rows = [lin.outputs.index(n) for n in names]
    u = previous[0] + np.cumsum(moves[:3, 0])  # blocks of 1, 1 and 2 periods
    for k in range(3):
        forces = np.array([u[k] if n == "force" else 0.0 for n in lin.inputs])
        solution = integrate.solve_ivp(
            lambda t, x, f=forces: lin.A @ x + lin.B @ f, (0, PERIOD), x, rtol=1e-11, atol=1e-13
        )
        x = solution.y[:, -1]
        np.testing.assert_allclose(predicted[k], (lin.C @ x + lin.D @ forces)[rows], rtol=1e-6, atol=1e-9)


def test_reference_minimises_the_index(model) -> None:
    """The independent solver against the index itself: no feasible step downhill from its solution."""
    mpc = settings(model)
    reference = MpcReference(mpc)
    random = np.random.default_rng(1)
    x, previous, w = np.array([0.03, 0.2, 0.01, -0.4]), np.array([300.0]), random.normal(size=(1, 22)) * 0.02
    best = reference.step(x, previous, w)

    def index(moves: np.ndarray, slack: float) -> float:
        y, h = reference.predict(x, previous, moves, w), mpc.horizon
        plan, u = [], previous[0]
        for i in range(h.prediction + 1):
            u += moves[h.moves.index(i), 0] if i in h.moves else 0.0
            plan.append(u)
        plan, travel = np.array(plan), y[:, 1]
        if np.any(np.abs(plan) > 4e3 + 1e-6) or slack < 0:
            return np.inf
        if np.any(moves < -1e3 - 1e-6) or np.any(moves > 1.5e3 + 1e-6):
            return np.inf
        if np.any(travel > 0.012 + 0.05 * slack + 1e-9) or np.any(travel < -0.01 - 0.05 * slack - 1e-9):
            return np.inf
        cost = np.sum(y[:, 0] ** 2) + np.sum((y[:, 1] / 0.1) ** 2) + np.sum((2 * y[:, 2] / 0.1) ** 2)
        return cost + 0.01 * np.sum((plan / 1e4) ** 2) + 0.01 * np.sum((moves / 1e4) ** 2) + 1e3 * slack**2

    lowest = index(best.moves, best.slack)
    assert np.isfinite(lowest)
    for _ in range(300):
        there = index(best.moves + random.normal(size=(4, 1)) * 20.0, best.slack + random.normal() * 1e-3)
        assert there >= lowest * (1 - 1e-9)


def test_input_that_leaves_its_bounds_with_the_case_comes_back_at_its_rate(car, model) -> None:
    mpc = settings(model, horizon=Horizon(20, 3))
    c = law(mpc, car)
    ev = Named(c)
    slot = {e.name: e.slot for e in c.elements("input")}
    ev.u[slot["body.z"]] = -0.05  # the spring lifts: the force is to pull down
    forces = []
    for k in range(8):
        ev.u[slot["case"]] = k >= 4
        ev.step(PERIOD)
        got = ev.shown()
        assert got["solver.status"] == 0
        forces.append(got["force"])
    assert forces[3] < -1500.0
    assert forces[4] - forces[3] == pytest.approx(1500.0)
    assert min(forces[5:]) >= 500.0 - 1e-9


@pytest.mark.parametrize("why", ["infeasible", "infeasible to both", "limit", "limit of both"])
def test_last_command_is_kept_when_there_is_no_solution(car, model, why) -> None:
    """Hard travel bounds that no force can meet, or a solver without time.

    The command stays, within the bounds of now.
    """
    short = Daqp(max_iterations=2)
    infeasible = why.startswith("infeasible")
    backend = {
        "limit": short,
        "limit of both": Osqp(max_iterations=10, fallback=short),
        "infeasible to both": Osqp(fallback=Daqp()),
    }.get(why)
    hard = Output("suspension.deflection", scale=0.1, weight=1.0, min=-0.01, max=0.012, ecr=0.0)
    mpc = settings(model)
    if infeasible:
        mpc = replace(mpc, outputs=(mpc.outputs[0], hard, mpc.outputs[2]))
    c = law(mpc, car, backend)
    ev = Named(c)
    slot = {e.name: e.slot for e in c.elements("input")}
    ev.u[slot["body.vz"]] = 0.05 if infeasible else 0.0
    ev.step(PERIOD)
    first = ev.shown()
    assert not first["command.held"]
    ev.u[slot["body.z"]] = 0.5
    ev.step(PERIOD)
    got = ev.shown()
    assert got["command.held"]
    assert got["solver.status"] == (2 if infeasible else 1)
    assert got["force"] == first["force"]
    ev.u[slot["case"]] = 1  # now at least 500 N are asked for: held, but within the bounds
    ev.step(PERIOD)
    assert ev.shown()["force"] == pytest.approx(500.0)
    assert first["force"] < 500.0


def test_condensed_matrices(model) -> None:
    qp = CondensedQp(settings(model))
    assert qp.size == 5
    np.testing.assert_allclose(np.linalg.norm(qp.constraint, axis=1), 1.0)
    for H in qp.hessians:
        assert 0.1 < np.diag(H).min() <= np.diag(H).max() < 10.0


def test_example_of_the_docs_sees_a_bump_coming() -> None:
    path = Path(__file__).parents[3] / "docs" / "examples" / "quarter_car_mpc.py"
    ev = Named(runpy.run_path(str(path))["make"]().model())
    slot = {e.name: e.slot for e in ev.component.elements("input")}
    forces = {}
    for case in (0, 1):
        ev = Named(ev.component)
        ev.u[slot["case"]] = case
        for i in range(11, 32):
            ev.u[slot[f"preview[{i}]"]] = 0.02
        for _ in range(2):
            ev.step(PERIOD)
            got = ev.shown()
            assert got["solver.status"] == 0
        forces[case] = got["force"]
    assert forces[0] != 0.0
    assert forces[0] != forces[1]
    assert all(abs(f) <= 4.0 + 1e-9 for f in forces.values())  # two moves of at most 2 N


# -------------------------------------------------------------------------------------------------------- the observers


def test_observer_follows_an_unknown_road(model) -> None:
    """A plateau that nobody announces: wandering heights find it, offsets leave no error in the measured outputs."""
    measured = {"body.az": 0.05, "suspension.deflection": 1e-4, "body.z": 1e-4}
    walks = Observer.kalman(model, measured, input_noise=1.0, walks=1e-2)
    offsets = Observer.kalman(
        model, measured, input_noise=50.0, offsets={"suspension.deflection": 1e-3, "body.z": 1e-3}
    )
    rows = [model.outputs.index(n) for n in measured]
    for observer in (walks, offsets):
        x, guess = np.zeros(4), np.zeros(len(observer.model.states))
        none, height = np.zeros(1), np.array([0.03])
        for _ in range(2500):
            y = (model.C @ x + model.F0 @ height + model.F1 @ height)[rows]
            estimate = observer.correct(guess, y, none, none, none)
            guess = observer.predict(estimate, none, none, none)
            x = model.A @ x + (model.E0 + model.E1) @ height
        m = observer.model
        np.testing.assert_allclose((m.C @ estimate)[rows], y, atol=1e-5)
        if observer is walks:
            assert estimate[m.states.index("walk.road")] == pytest.approx(0.03, abs=1e-5)


def test_kalman_gain_is_the_fixed_point_of_the_recursion(model) -> None:
    observer = Observer.kalman(model, {"suspension.deflection": 1e-3, "body.z": 1e-3}, input_noise=30.0, walks=1e-3)
    m, rows = observer.model, [model.outputs.index(n) for n in observer.measured]
    C, P = m.C[rows], np.eye(5)
    Q, R = 900.0 * m.B @ m.B.T, np.diag([1e-6, 1e-6])
    Q[4, 4] += 1e-6
    for _ in range(20000):
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        P = m.A @ (P - K @ C @ P) @ m.A.T + Q
    np.testing.assert_allclose(observer.gain, K, rtol=1e-6, atol=1e-9 * np.abs(K).max())


@pytest.mark.parametrize("vector", [np.array, ca.DM], ids=["numpy", "casadi"])
def test_one_step_of_an_observer(vector) -> None:
    """Each matrix with a factor of its own, so that every product and sign can be told in the sum."""
    one = lambda *values: np.array([values])  # noqa: E731
    m = MpcModel(
        A=one(0.5),
        B=one(2.0),
        E0=one(0.1),
        E1=one(0.01),
        C=np.array([[9.0], [3.0]]),
        D=np.array([[9.0], [4.0]]),
        F0=np.array([[9.0], [0.2]]),
        F1=np.array([[9.0], [0.02]]),
        states=("x",),
        inputs=("u",),
        disturbances=("w",),
        outputs=("other", "y"),
        period=0.01,
    )
    observer = Observer(m, ("y",), gain=one(0.25), covariance=one(1.0))
    x, u, now, then = (vector([v]) for v in (7.0, 5.0, 30.0, 200.0))
    assert float(observer.predict(x, u, now, then)[0]) == pytest.approx(0.5 * 7 + 2 * 5 + 0.1 * 30 + 0.01 * 200)
    expected = 3 * 7 + 4 * 5 + 0.2 * 30 + 0.02 * 200
    assert float(observer.correct(x, vector([expected]), u, now, then)[0]) == pytest.approx(7.0)
    assert float(observer.correct(x, vector([expected + 4]), u, now, then)[0]) == pytest.approx(8.0)


def test_what_an_observer_was_made_for_is_told(model) -> None:
    measured = {"suspension.deflection": 1e-3, "body.az": 3e-2, "body.z": 2e-3}
    observer = Observer.kalman(model, measured, input_noise=30.0, offsets={"body.az": 1e-4}, walks=5e-3)
    assert observer.measured == tuple(measured)
    assert observer.noise == {"measured": measured, "input": [30.0], "offsets": {"body.az": 1e-4}, "walks": 5e-3}
    assert Observer.kalman(model, {"body.z": 1e-3}, input_noise=1.0).noise["walks"] is None


def test_what_wanders_too_little_is_never_found(model, raises) -> None:
    """An offset that hardly wanders against the noise of its output is corrected very little.

    The correction is so small that the filter forgets nothing.
    """
    slow = Observer.kalman(model, {"body.z": 1.0}, input_noise=1e-9, offsets={"body.z": 1.5e-9})
    C = slow.model.C[[slow.model.outputs.index("body.z")]]
    left = np.abs(np.linalg.eigvals(slow.model.A - slow.model.A @ slow.gain @ C)).max()
    assert 1 - left == pytest.approx(1.5e-9, rel=1e-3)
    with raises(MpcError):
        Observer.kalman(model, {"body.z": 1.0}, input_noise=1e-9, offsets={"body.z": 5e-10})


def test_component_with_observer_has_the_measured_outputs_as_inputs(car, model) -> None:
    observer = Observer.kalman(model, {"body.az": 0.05, "body.z": 1e-4}, input_noise=1.0, walks=1e-3)
    mpc = settings(observer.model)
    c = law(mpc, car, observer=observer)
    assert {e.name for e in c.elements("input")} >= {"body.az", "body.z", "case", "use_preview"}
    assert "wheel.vz" not in {e.name for e in c.elements("input")}


# ------------------------------------------------------------------------------------------------------------ bad input


@pytest.mark.parametrize(
    "change",
    [
        lambda m: Input("force", min=10.0, max=-10.0),
        lambda m: Input("force", rate_min=5.0, rate_max=9.0),
        lambda m: Input("force", weight=[1.0, 2.0]),
        lambda m: Input("force", scale=0.0),
        lambda m: Output("body.az", weight=float("nan")),
        lambda m: Output("body.az", min=1.0, max=0.0),
        lambda m: Horizon(5, 6),
        lambda m: Horizon(5, 2, blocks=(1, 1, 1)),
        lambda m: Horizon(10, 0),
        lambda m: settings(m, outputs=(Output("body.ay", weight=1.0),)),
        lambda m: settings(m, inputs=()),
        lambda m: settings(m, cases=(Case("one", {"force": {"min": 5e3}}),)),
        lambda m: settings(m, cases=(Case("one", {"forces": {}}),)),
        lambda m: settings(m, cases=(Case("one", {"force": {"scale": 2.0}}),)),
        lambda m: settings(m, inputs=(Input("force"),)),
        lambda m: Observer.kalman(m, {"body.az": 0.0}, input_noise=1.0),
        lambda m: Observer.kalman(m, {"body.az": 0.1}, input_noise=1.0, walks=1e-3),
        lambda m: Observer.kalman(m, {"body.az": 0.1}, input_noise=1.0, offsets={"body.z": 1.0, "body.az": 1.0}),
        lambda m: MpcModel.sampled(lin_of(), 0.01, inputs=["forse"], outputs=[]),
    ],
)
def test_mistakes_are_named(model, change, raises) -> None:
    with raises(MpcError):
        change(model)


@pytest.mark.parametrize(
    ("weighted", "cases"),
    [
        ({"travel": ["suspension.deflexion"]}, 1),
        ({"one": ["body.az"], "other": ["body.az"]}, 1),
        ({"both": ["body.az", "force"]}, 1),
        ({"ride": ["body.az"]}, 2),
    ],
    ids=["unknown", "twice", "different", "cases"],
)
def test_weights_that_cannot_be_parameters_are_refused(car, model, weighted, cases, raises) -> None:
    mpc = settings(model, cases=tuple(Case(n) for n in ("one", "two")[:cases]))
    with raises(MpcError):
        mpc_component(mpc, car, name="Law", description="x", source="x", weighted=weighted, backend=Daqp())


def lin_of():
    return quarter_car(load_quarter_car("quarter_car_hmmwv")).linearize()


@pytest.mark.parametrize(
    "preview",
    [
        Preview({"road": "preview"}, 15, PERIOD),
        Preview({"road": "preview"}, 40, 0.007),
        Preview({"rode": "preview"}, 21, PERIOD),
        Preview({}, 21, PERIOD),
    ],
)
def test_preview_that_does_not_fit_is_refused(car, model, preview, raises) -> None:
    with raises(MpcError):
        mpc_component(settings(model), car, name="Law", description="x", source="x", preview=preview)


def test_coarser_preview_is_interpolated() -> None:
    grid = Preview({"road": "preview"}, 6, 0.02).grid("Law", 0.01, 12)
    np.testing.assert_allclose(grid @ np.arange(6.0), [*np.arange(0, 5.01, 0.5), 5.0])


def test_preview_step_of_the_road_is_checked(car, model) -> None:
    v = law(settings(model), car).variable("preview.step")
    assert v.must_equal == PERIOD
    assert (v.start, v.min, v.max) == ((0.0,), None, None)


def test_sample_time_of_the_component_must_be_that_of_the_model(model, raises) -> None:
    c = Component("Wrong", kind="discrete", sample_time=0.02, description="x", source="x", symbols=ca.MX)
    mpc = settings(model)
    with raises(MpcError):
        add_mpc(c, mpc, state=ca.MX.zeros(4), previous=previous_command(c, mpc))


def test_law_in_straight_line_symbols_is_refused(model) -> None:
    c = Component("Wrong", kind="discrete", sample_time=PERIOD, description="x", source="x")
    mpc = settings(model)
    with pytest.raises((MpcError, DeclarationError), match=r"symbols=ca\.MX"):
        add_mpc(c, mpc, state=ca.SX.zeros(4), previous=previous_command(c, mpc))
