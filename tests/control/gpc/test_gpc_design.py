"""GPC design: identification, multi-step prediction and control laws (Brown, Murugan, Mazza)."""

import json
from dataclasses import replace

import numpy as np
import osqp
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, optimize, sparse

from fmu_sources.controllers.gpc.arx import ArxModel, identify_arx
from fmu_sources.controllers.gpc.control_law import GpcLaw, gpc_law, gpc_sequence
from fmu_sources.controllers.gpc.prediction import multi_step_predictor

Q_PAPER = [50.0, 10.0, 1.0]


def random_arx(rng, p, *, m, rc, rd, gain=0.9):
    """A stable model: the norms of the alpha_i sum to less than 1."""
    alpha = rng.standard_normal((p, m, m))
    alpha *= gain / sum(np.linalg.norm(a, 2) for a in alpha)
    return ArxModel(alpha, rng.standard_normal((p + 1, m, rc)), rng.standard_normal((p + 1, m, rd)))


def random_plant(rng, states, m=3, inputs=8):
    """A stable discrete plant of lightly damped modes with direct feed-through: A, B, C, D."""
    radius, angle = rng.uniform(0.8, 0.97, states // 2), rng.uniform(0.1, 1.5, states // 2)
    turns = [np.array([[np.cos(w), np.sin(w)], [-np.sin(w), np.cos(w)]]) for w in angle]
    mix = linalg.qr(rng.standard_normal((states, states)))[0] + 0.3 * rng.standard_normal((states, states))
    a = linalg.solve(mix, linalg.block_diag(*(r * turn for r, turn in zip(radius, turns, strict=True))) @ mix)
    return a, rng.standard_normal((states, inputs)), rng.standard_normal((m, states)), rng.standard_normal((m, inputs))


def seven_degree_car():
    """A linear car of about the modified HMMWV's numbers at 100 Hz: A, B, C, D, B and D with 4 forces [N], 4 roads [m].

    Body heave, pitch (nose down), roll (left up), four wheels; outputs (g, deg, deg). Tire damping acts on the wheel
    only, so that the road enters by its height alone and the zero-order hold is exact.
    """
    x, y = np.array([1.98, 1.98, -1.32, -1.32]), np.array([0.91, -0.91, 0.91, -0.91])
    strut = np.column_stack([np.ones(4), -x, y, -np.eye(4)])  # body minus wheel
    tire = np.hstack([np.zeros((4, 3)), np.eye(4)])
    mass = np.array([5000.0, 8700.0, 2600.0, *[110.0] * 4])[:, None]  # kg, kg m2
    stiffness = strut.T @ np.diag([60e3, 60e3, 97e3, 97e3]) @ strut + 350e3 * tire.T @ tire  # N/m
    damping = strut.T @ np.diag([3.6e3, 3.6e3, 7.2e3, 7.2e3]) @ strut + 500.0 * tire.T @ tire  # Ns/m
    a = np.block([[np.zeros((7, 7)), np.eye(7)], [-stiffness / mass, -damping / mass]])
    b = np.vstack([np.zeros((7, 8)), np.hstack([strut.T, 350e3 * tire.T]) / mass])
    step = linalg.expm(0.01 * np.block([[a, b], [np.zeros((8, 22))]]))
    c = np.vstack([a[7] / 9.80665, np.degrees(np.eye(14)[1:3])])
    d = np.vstack([b[7] / 9.80665, np.zeros((2, 8))])
    return step[:14, :14], step[:14, 14:], c, d


def run_plant(plant, inputs):
    a, b, c, d = plant
    x, y = np.zeros(len(a)), np.empty((len(inputs), len(c)))
    for t, u in enumerate(inputs):
        y[t] = c @ x + d @ u
        x = a @ x + b @ u
    return y


def random_past(rng, model):
    return {
        "y_past": rng.standard_normal((model.order, model.outputs)),
        "u_past": rng.standard_normal((model.order, model.controls)),
        "d_past": rng.standard_normal((model.order, model.disturbances)),
    }


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def model(rng):
    return random_arx(rng, p=5, m=3, rc=4, rd=2)


class TestPredictor:
    @settings(deadline=None, max_examples=150)
    @given(
        p=st.integers(1, 10),
        size=st.fixed_dictionaries({"m": st.integers(1, 4), "rc": st.integers(1, 4), "rd": st.integers(0, 4)}),
        horizons=st.tuples(st.integers(1, 14), st.integers(1, 14)),
        seed=st.integers(0, 2**32 - 1),
    )
    def test_equals_brute_force_simulation(self, p, size, horizons, seed):
        h_p, h_c = max(horizons), min(horizons)
        rng = np.random.default_rng(seed)
        model = random_arx(rng, p, **size)
        predictor = multi_step_predictor(model, h_p, h_c)
        past = random_past(rng, model)
        u, d = rng.standard_normal((h_p, size["rc"])), rng.standard_normal((h_p, size["rd"]))
        u[h_c:] = 0.0
        simulated = model.simulate(u, d, **past)
        predicted = predictor.predict(u[:h_c], past["y_past"], past["u_past"], past["d_past"], d)
        assert np.max(np.abs(predicted - simulated)) <= 1e-12 * np.max(np.abs(simulated))

    def test_shapes_and_structure(self, model):
        predictor = multi_step_predictor(model, 7, 4)
        assert predictor.tau.shape == (21, 16)
        assert predictor.alpha.shape == (21, 15)
        assert predictor.beta.shape == (21, 20)
        assert predictor.delta.shape == (21, 10)
        assert predictor.gamma.shape == (21, 14)
        for j in range(4):
            np.testing.assert_array_equal(predictor.tau[3 * j : 3 * j + 3, 4 * j : 4 * j + 4], model.beta[0])
            assert not predictor.tau[: 3 * j, 4 * j :].any()
        # The first block row is the model itself, the second (8b) by hand.
        np.testing.assert_array_equal(predictor.alpha[:3], np.hstack(list(model.alpha)))
        np.testing.assert_array_equal(predictor.beta[:3], np.hstack(list(model.beta[1:])))
        np.testing.assert_array_equal(predictor.delta[:3], np.hstack(list(model.delta[1:])))
        np.testing.assert_allclose(predictor.alpha[3:6, :3], model.alpha[1] + model.alpha[0] @ model.alpha[0])
        np.testing.assert_allclose(predictor.alpha[3:6, -3:], model.alpha[0] @ model.alpha[-1])

    def test_first_order_scalar_by_hand(self):
        model = ArxModel(np.array([[[0.5]]]), np.array([[[2.0]], [[1.0]]]))
        predictor = multi_step_predictor(model, 3, 2)
        np.testing.assert_allclose(predictor.tau, [[2.0, 0.0], [2.0, 2.0], [1.0, 2.0]])
        np.testing.assert_allclose(predictor.alpha[:, 0], [0.5, 0.25, 0.125])
        np.testing.assert_allclose(predictor.beta[:, 0], [1.0, 0.5, 0.25])
        assert predictor.gamma.shape == (3, 0)

    @pytest.mark.parametrize(("h_p", "h_c"), [(0, 1), (4, 5), (4, 0), (2.0, 1), (True, 1)])
    def test_refuses_horizons(self, model, h_p, h_c, raises):
        with raises(ValueError):
            multi_step_predictor(model, h_p, h_c)


class TestModel:
    def test_simulation_continues_from_its_own_history(self, rng, model):
        u, d = rng.standard_normal((40, 4)), rng.standard_normal((40, 2))
        whole = model.simulate(u, d)
        past = [run[20 - 5 : 20][::-1] for run in (whole, u, d)]
        rest = model.simulate(u[20:], d[20:], y_past=past[0], u_past=past[1], d_past=past[2])
        np.testing.assert_array_equal(rest, whole[20:])

    @pytest.mark.parametrize(
        "change",
        [
            {"alpha": np.zeros((2, 3, 2))},
            {"alpha": np.zeros((2, 3))},
            {"beta": np.zeros((5, 3, 4))},
            {"delta": np.zeros((6, 2, 4))},
            {"beta": np.full((6, 3, 4), np.nan)},
        ],
    )
    def test_refuses_shapes(self, model, change, raises):
        with raises(ValueError):
            replace(model, **change)

    def test_refuses_signals(self, model):
        with pytest.raises(ValueError, match=r"u has shape \(10, 3\).*4 columns"):
            model.simulate(np.zeros((10, 3)), np.zeros((10, 2)))
        with pytest.raises(ValueError, match="d is missing"):
            model.simulate(np.zeros((10, 4)))
        with pytest.raises(ValueError, match="d has 9 samples, u has 10"):
            model.simulate(np.zeros((10, 4)), np.zeros((9, 2)))
        with pytest.raises(ValueError, match=r"y_past has shape \(4, 3\)"):
            model.simulate(np.zeros((10, 4)), np.zeros((10, 2)), y_past=np.zeros((4, 3)))

    def test_is_read_only(self, model):
        with pytest.raises(ValueError, match="read-only"):
            model.alpha[0, 0, 0] = 1.0


class TestIdentification:
    @pytest.mark.parametrize("states", [6, 7, 8])
    @pytest.mark.parametrize("seed", range(5))
    def test_recovers_markov_parameters_of_a_linear_plant(self, states, seed):
        rng = np.random.default_rng(seed)
        plant = random_plant(rng, states - states % 2)
        if states % 2:  # one real mode more
            a, b, c, d = plant
            plant = (
                linalg.block_diag(a, 0.9),
                np.vstack([b, rng.standard_normal(8)]),
                np.hstack([c, np.ones((3, 1))]),
                d,
            )
        a, b, c, d = plant
        units = rng.standard_normal((600, 8))
        y = run_plant(plant, units)
        size = np.array([2000.0] * 4 + [0.03] * 4)  # as in a vehicle: kilonewtons and centimeters
        inputs = units * size
        found = identify_arx(inputs[:, :4], y, inputs[:, 4:], order=8, samples=400)
        assert found.rank < len(found.singular_values)  # 24 past outputs describe 6 to 8 states: not all are needed
        predictor = multi_step_predictor(found.model, h_p=30)
        markov = [d, *(c @ np.linalg.matrix_power(a, k) @ b for k in range(29))]
        for gains, columns in ((predictor.tau[:, :4], slice(0, 4)), (predictor.gamma[:, :4], slice(4, 8))):
            expected = np.vstack(markov)[:, columns]
            error = np.max(np.abs(gains * size[columns] - expected)) / np.max(np.abs(expected))
            assert error < 1e-9
        assert np.all(found.residual_rms < 1e-12 * np.std(y, axis=0))

    @pytest.mark.parametrize("seed", range(4))
    def test_recovers_markov_parameters_of_a_car(self, seed):
        """14 states, stiff, on a smooth road that the rear wheels meet 0.3 s after the front: condition 3e5."""
        rng = np.random.default_rng(seed)
        a, b, c, d = car = seven_degree_car()
        road = np.cumsum(0.005 * rng.standard_normal((640, 2)), axis=0)
        road = (road[:-1] + road[1:]) / 2
        inputs = np.hstack([2000.0 * rng.standard_normal((600, 4)), road[30:630], road[:600]])
        found = identify_arx(inputs[:, :4], run_plant(car, inputs), inputs[:, 4:], order=8, samples=400)
        predictor = multi_step_predictor(found.model, h_p=30)
        markov = np.vstack([d, *(c @ np.linalg.matrix_power(a, k) @ b for k in range(29))])
        error = np.abs(np.hstack([predictor.tau[:, :4], predictor.gamma[:, :4]]) - markov)
        assert np.all(error.max(axis=0) < 1e-9 * np.abs(markov).max(axis=0))

    def test_does_not_depend_on_units(self, rng):
        plant = random_plant(rng, 6)
        inputs = rng.standard_normal((400, 8))
        y = run_plant(plant, inputs) + 0.01 * rng.standard_normal((400, 3))
        u, d = inputs[:, :4], inputs[:, 4:]
        unit_u, unit_y, unit_d = 1e4, np.array([1e-3, 1.0, 57.0]), 1e-3
        plain = identify_arx(u, y, d, order=4).model
        scaled = identify_arx(u * unit_u, y * unit_y, d * unit_d, order=4).model
        np.testing.assert_allclose(scaled.alpha * unit_y / unit_y[:, None], plain.alpha, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(scaled.beta * unit_u / unit_y[:, None], plain.beta, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(scaled.delta * unit_d / unit_y[:, None], plain.delta, rtol=1e-9, atol=1e-11)

    @pytest.mark.parametrize("rd", [0, 2])
    def test_recovers_an_arx_model_of_its_own_order(self, rng, rd):
        truth = random_arx(rng, p=3, m=2, rc=3, rd=rd)
        u, d = rng.standard_normal((300, 3)), rng.standard_normal((300, rd))
        found = identify_arx(u, truth.simulate(u, d), d if rd else None, order=3)
        for name in ("alpha", "beta", "delta"):
            np.testing.assert_allclose(getattr(found.model, name), getattr(truth, name), atol=1e-10)
        assert found.rank == len(found.singular_values) == 3 + rd + (5 + rd) * 3
        assert not found.dropped
        assert found.condition == found.singular_values[0] / found.singular_values[-1]

    def test_is_the_least_squares_fit(self, rng):
        """Against lstsq on the regression written out by hand; residual rms is that of the outputs."""
        u, y = rng.standard_normal((120, 2)), rng.standard_normal((120, 2))
        found = identify_arx(u, y, order=2)
        v = np.hstack([u[2:], u[1:-1], y[1:-1], u[:-2], y[:-2]])
        fit = np.linalg.lstsq(v, y[2:], rcond=None)[0].T
        model = found.model
        ours = np.hstack([model.beta[0], model.beta[1], model.alpha[0], model.beta[2], model.alpha[1]])
        np.testing.assert_allclose(ours, fit, atol=1e-12)
        np.testing.assert_allclose(found.residual_rms, np.std(y[2:] - v @ fit.T, axis=0, mean=0.0), rtol=1e-10)

    def test_uses_the_last_samples_and_no_zeros_before_them(self, rng):
        """A run that does not begin at rest is fitted exactly, and what came before `samples` has no influence."""
        truth = random_arx(rng, p=3, m=2, rc=2, rd=0)
        u = rng.standard_normal((200, 2))
        y = truth.simulate(u, **{**random_past(rng, truth), "d_past": None})
        found = identify_arx(u, y, order=3, samples=100)
        np.testing.assert_allclose(found.model.alpha, truth.alpha, atol=1e-10)
        assert (found.samples, found.equations) == (100, 97)
        spoiled = y.copy()
        spoiled[:100] = rng.standard_normal((100, 2))
        np.testing.assert_array_equal(identify_arx(u, spoiled, order=3, samples=100).model.alpha, found.model.alpha)

    def test_drops_rows_without_variance(self, rng, raises):
        truth = random_arx(rng, p=2, m=2, rc=2, rd=2)
        u, d = rng.standard_normal((200, 2)), rng.standard_normal((200, 2))
        u[:, 1], d[:, 0] = 0.0, 0.0
        y = truth.simulate(u, d)
        d[:, 0] = 0.1  # a constant that does not act
        found = identify_arx(u, y, d, order=2)
        assert found.dropped == ("d[0](t)", "u[1](t)", "d[0](t-1)", "u[1](t-1)", "d[0](t-2)", "u[1](t-2)")
        assert not found.model.beta[:, :, 1].any()
        assert not found.model.delta[:, :, 0].any()
        np.testing.assert_allclose(found.model.beta[:, :, 0], truth.beta[:, :, 0], atol=1e-10)
        np.testing.assert_allclose(found.model.delta[:, :, 1], truth.delta[:, :, 1], atol=1e-10)
        with raises(ValueError):
            identify_arx(np.ones((100, 1)), np.zeros((100, 1)), order=2)

    def test_same_input_same_model(self, rng):
        u, y = rng.standard_normal((400, 4)), rng.standard_normal((400, 3))
        first, second = (identify_arx(u, y, order=8, samples=400).model for _ in range(2))
        np.testing.assert_array_equal(first.alpha, second.alpha)
        np.testing.assert_array_equal(first.beta, second.beta)

    def test_summary_is_json(self, rng):
        found = identify_arx(rng.standard_normal((100, 2)), rng.standard_normal((100, 1)), order=2)
        assert json.loads(json.dumps(found.summary()))["unknowns_per_output"] == 2 + 3 * 2

    @pytest.mark.parametrize("signal", ["u", "y", "d"])
    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    def test_names_non_finite_data(self, rng, signal, value):
        data = {name: rng.standard_normal((200, 2)) for name in ("u", "y", "d")}
        data[signal][37, 1] = value
        with pytest.raises(ValueError, match=rf"{signal}\[1\] is {value} at sample 37"):
            identify_arx(**data, order=2)

    @pytest.mark.parametrize(
        ("shapes", "options"),
        [
            ({}, {"order": 8, "samples": 103}),
            ({}, {"order": 8, "samples": 401}),
            ({}, {"order": 0}),
            ({}, {"order": 2.5}),
            ({}, {"order": 8, "samples": -1}),
            ({"y": (399, 3)}, {"order": 8}),
            ({"d": (401, 4)}, {"order": 8}),
            ({"u": (400,)}, {"order": 8}),
            ({"y": (400, 0)}, {"order": 8}),
        ],
    )
    def test_refuses_wrong_data(self, rng, shapes, options, raises):
        shapes = {"u": (400, 4), "y": (400, 3), "d": (400, 4)} | shapes
        with raises(ValueError):
            identify_arx(**{name: rng.standard_normal(shape) for name, shape in shapes.items()}, **options)

    def test_smallest_sufficient_sample_count(self, rng):
        truth = random_arx(rng, p=2, m=1, rc=1, rd=0)
        u = rng.standard_normal((7, 1))
        found = identify_arx(u, truth.simulate(u), order=2)
        np.testing.assert_allclose(found.model.alpha, truth.alpha, rtol=1e-8)


def dense_problem(model, h_c, R, past, d_future):
    """Fq, Fr, tau, f of: minimise |Fq (tau u + f)|^2 + |Fr u|^2, from brute-force simulation only."""
    h_p = len(d_future)
    zero = np.zeros((h_p, model.controls))
    free = model.simulate(zero, d_future, **past).ravel()
    columns = []
    for k in range(h_c * model.controls):
        u = zero.copy()
        u.ravel()[k] = 1.0
        columns.append(model.simulate(u, np.zeros_like(d_future)).ravel())
    q_factor, r_factor = np.diag(np.sqrt(np.tile(Q_PAPER, h_p))), np.sqrt(R) * np.eye(len(columns))
    return q_factor, r_factor, np.array(columns).T, free


def commands(sequence, *signals):
    """The whole optimal sequence, flat, for histories of outputs, controls and disturbances, and what lies ahead."""
    gains = (sequence.gain_y, sequence.gain_u, sequence.gain_d, sequence.gain_preview)
    return sum(gain @ np.ravel(signal) for gain, signal in zip(gains, signals, strict=True))


class TestLaw:
    @pytest.mark.parametrize("case", [(8, 8, 8, 1e-3), (5, 12, 4, 1.0), (3, 1, 1, 0.1), (8, 8, 8, 1e-7)])
    @pytest.mark.parametrize("rd", [0, 4])
    def test_equals_the_dense_qp(self, rng, case, rd):
        p, h_p, h_c, R = case
        model = random_arx(rng, p, m=3, rc=4, rd=rd)
        past = random_past(rng, model)
        d_future = rng.standard_normal((h_p, rd))
        predictor = multi_step_predictor(model, h_p, h_c)
        sequence = gpc_sequence(predictor, Q_PAPER, R)
        u = commands(sequence, past["y_past"], past["u_past"], past["d_past"], d_future)

        q_factor, r_factor, tau, free = dense_problem(model, h_c, R, past, d_future)
        stacked = np.vstack([q_factor @ tau, r_factor])
        target = -np.concatenate([q_factor @ free, np.zeros(h_c * 4)])
        best = optimize.lsq_linear(stacked, target, method="bvls", tol=1e-15).x
        assert np.max(np.abs(u - best)) <= 1e-8 * np.max(np.abs(best))

        # The same problem with predicted outputs as variables and (6) as constraint, solved by its KKT system.
        n_y, n_u = 3 * h_p, 4 * h_c
        kkt = np.block(
            [
                [q_factor**2, np.zeros((n_y, n_u)), np.eye(n_y)],
                [np.zeros((n_u, n_y)), r_factor**2, -tau.T],
                [np.eye(n_y), -tau, np.zeros((n_y, n_y))],
            ]
        )
        solution = np.linalg.solve(kkt, np.concatenate([np.zeros(n_y + n_u), free]))[n_y : n_y + n_u]
        assert np.max(np.abs(u - solution)) <= 1e-8 * np.max(np.abs(best))

        law = gpc_law(predictor, Q_PAPER, R, "preview" if rd else "implicit")
        disturbances = (past["d_past"], d_future) if rd else ()
        np.testing.assert_allclose(law.command(past["y_past"], past["u_past"], *disturbances), u[:4], rtol=1e-10)

    def test_equals_osqp(self, rng, model):
        past, d_future = random_past(rng, model), rng.standard_normal((8, 2))
        law = gpc_law(multi_step_predictor(model, 8, 6), Q_PAPER, 0.5, "preview")
        q_factor, r_factor, tau, free = dense_problem(model, 6, 0.5, past, d_future)
        solver = osqp.OSQP()
        solver.setup(
            sparse.csc_matrix(np.triu(2 * (tau.T @ q_factor**2 @ tau + r_factor**2))),
            2 * tau.T @ q_factor**2 @ free,
            sparse.eye(24, format="csc"),
            np.full(24, -1e6),
            np.full(24, 1e6),
            verbose=False,
            polishing=True,
            eps_abs=1e-9,
            eps_rel=1e-9,
            max_iter=100_000,
        )
        solution = solver.solve(raise_error=True)
        assert solution.info.status == "solved"
        u = law.command(past["y_past"], past["u_past"], past["d_past"], d_future)
        np.testing.assert_allclose(u, solution.x[:4], rtol=1e-5, atol=1e-6)

    def test_explicit_assumes_no_disturbance_ahead(self, rng, model):
        predictor = multi_step_predictor(model, 8)
        explicit = gpc_law(predictor, Q_PAPER, 1.0, "explicit")
        preview = gpc_law(predictor, Q_PAPER, 1.0, "preview")
        for name in ("gain_y", "gain_u", "gain_d", "gain_preview"):
            np.testing.assert_array_equal(getattr(explicit, name), getattr(preview, name))
        past = list(random_past(rng, model).values())
        np.testing.assert_array_equal(explicit.command(*past), preview.command(*past, np.zeros((8, 2))))

    def test_hold_equals_preview_of_a_constant_future(self, rng, model):
        predictor = multi_step_predictor(model, 9, 5)
        hold = gpc_law(predictor, Q_PAPER, 1.0, "explicit", hold=True)
        preview = gpc_law(predictor, Q_PAPER, 1.0, "preview")
        y_past, u_past, d_past = random_past(rng, model).values()
        u = preview.command(y_past, u_past, d_past, np.tile(d_past[0], (9, 1)))
        np.testing.assert_allclose(hold.command(y_past, u_past, d_past), u, rtol=1e-12, atol=1e-12)
        # The pure gains stay available, so that a controller can switch hold on by itself.
        off = gpc_law(predictor, Q_PAPER, 1.0, "explicit")
        np.testing.assert_array_equal(hold.gain_d, off.gain_d)
        switched = off.command(y_past, u_past, d_past) + off.gain_hold @ d_past[0]
        np.testing.assert_allclose(switched, u, rtol=1e-12, atol=1e-12)
        assert off.gain_hold.shape == (4, 2)

    def test_large_control_weight_turns_the_law_off(self, model):
        predictor = multi_step_predictor(model, 8)
        sizes = [
            max(np.max(np.abs(g)) for g in (law.gain_y, law.gain_u, law.gain_d, law.gain_preview))
            for law in (gpc_law(predictor, Q_PAPER, R, "preview") for R in (1.0, 1e6, 1e12))
        ]
        assert sizes[1] < 1e-3 * sizes[0]
        assert sizes[2] < 1.1e-6 * sizes[1]

    def test_small_control_weight_cancels_the_prediction(self, rng):
        """As many controls as outputs, acting at once: with R -> 0 the whole predicted response vanishes."""
        model = random_arx(rng, 3, m=2, rc=2, rd=1)
        model = replace(model, beta=np.concatenate([5.0 * np.eye(2)[None], model.beta[1:]]))
        predictor = multi_step_predictor(model, 4)
        sequence = gpc_sequence(predictor, 1.0, 1e-18)
        past, d = random_past(rng, model), rng.standard_normal((4, 1))
        u = commands(sequence, *past.values(), d).reshape(4, 2)
        assert np.max(np.abs(predictor.predict(u, *past.values(), d))) < 1e-9

    def test_forms_of_weights_agree(self, model):
        predictor = multi_step_predictor(model, 6, 3)
        reference = gpc_law(predictor, Q_PAPER, 0.3, "preview")
        forms_q = [Q_PAPER, np.diag(Q_PAPER), np.kron(np.eye(6), np.diag(Q_PAPER))]
        forms_r = [0.3, [0.3] * 4, 0.3 * np.eye(4), 0.3 * np.eye(12)]
        for Q in forms_q:
            for R in forms_r:
                law = gpc_law(predictor, Q, R, "preview")
                np.testing.assert_allclose(law.gain_y, reference.gain_y, rtol=1e-11, atol=1e-13)
                np.testing.assert_allclose(law.gain_preview, reference.gain_preview, rtol=1e-11, atol=1e-13)

    def test_full_weights(self, rng, model):
        """Dense matrices, Q of rank one, against (12) by its normal equations."""
        predictor = multi_step_predictor(model, 4, 2)
        row, root = rng.standard_normal((1, 12)), rng.standard_normal((8, 8))
        Q, R = row.T @ row, root @ root.T + np.eye(8)
        normal = predictor.tau.T @ Q @ predictor.tau + R
        expected = -np.linalg.solve(normal, predictor.tau.T @ Q @ predictor.alpha)
        np.testing.assert_allclose(gpc_sequence(predictor, Q, R).gain_y, expected, atol=1e-11)

    @pytest.mark.parametrize(
        ("Q", "R"),
        [
            ([1.0, 1.0], 1.0),
            (np.eye(4), 1.0),
            ([1.0, -1.0, 1.0], 1.0),
            (np.diag([1.0, 1.0, -2.0]), 1.0),
            ([[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 1.0),
            ([1.0, np.nan, 1.0], 1.0),
            (1.0, 0.0),
            (1.0, [1.0, 1.0, 1.0]),
            (1.0, -np.eye(4)),
            (1.0, np.inf),
        ],
    )
    def test_refuses_weights(self, model, Q, R, raises):
        with raises(ValueError):
            gpc_law(multi_step_predictor(model, 8, 5), Q, R, "preview")

    def test_refuses_a_singular_control_weight(self, model):
        with pytest.raises(ValueError, match=r"^R .*eigenvalue"):
            gpc_law(multi_step_predictor(model, 8, 5), 1.0, np.ones((4, 4)), "preview")

    def test_refuses_a_control_weight_lost_in_rounding(self, model):
        """32 controls act on 24 predicted outputs: only R decides between those that do the same."""
        with pytest.raises(ValueError, match=r"^R .*tau' Q tau"):
            gpc_law(multi_step_predictor(model, 8), 1.0, 1e-40, "preview")

    def test_refuses_wrong_variants(self, rng, model, raises, refused):
        with_d = multi_step_predictor(model, 8)
        without_d = multi_step_predictor(random_arx(rng, 5, m=3, rc=4, rd=0), 8)
        with raises(ValueError):
            gpc_law(with_d, 1.0, 1.0, "implicit")
        for variant in ("explicit", "preview"):
            with raises(ValueError, match=f"{variant}"):
                gpc_law(without_d, 1.0, 1.0, variant)
        refused(
            ValueError,
            lambda: gpc_law(with_d, 1.0, 1.0, "exlicit"),
            lambda: gpc_law(with_d, 1.0, 1.0, "preview", hold=True),
        )

    def test_refuses_wrong_histories(self, rng, model, refused):
        predictor = multi_step_predictor(model, 8)
        y, u, d = random_past(rng, model).values()
        preview, explicit = (gpc_law(predictor, 1.0, 1.0, variant) for variant in ("preview", "explicit"))
        refused(
            ValueError,
            lambda: preview.command(y, u, d),
            lambda: explicit.command(y, u, d, np.zeros((8, 2))),
            lambda: explicit.command(y, u),
        )
        with pytest.raises(ValueError, match=r"d_future has shape \(7, 2\); expected \(8, 2\) or \(16,\)"):
            preview.command(y, u, d, np.zeros((7, 2)))
        np.testing.assert_array_equal(explicit.command(y.ravel(), u.ravel(), d.ravel()), explicit.command(y, u, d))


def spectral_radius(model, law):
    """Largest eigenvalue of law and model in a loop: one step of both from every unit history."""
    p, m, rc, rd = model.order, model.outputs, model.controls, model.disturbances
    none = (np.zeros((p, rd)), np.zeros((law.h_p, rd))) if rd else ()
    columns = []
    for history in np.eye(p * (m + rc)):
        y, u = history[: p * m].reshape(p, m), history[p * m :].reshape(p, rc)
        u_now = law.command(y, u, *none)[None]
        y_now = model.simulate(u_now, np.zeros((1, rd)), y_past=y, u_past=u)
        columns.append(np.concatenate([y_now.ravel(), y[:-1].ravel(), u_now.ravel(), u[:-1].ravel()]))
    return np.max(np.abs(np.linalg.eigvals(np.array(columns).T)))


class TestClosedLoop:
    def test_short_control_horizon_on_a_car(self, rng):
        """With cheap control, h_c = 4 at h_p = 8 drives the car unstable where h_c = 8 does not."""
        inputs = np.array([2000.0] * 4 + [0.03] * 4) * rng.standard_normal((400, 8))
        y = run_plant(seven_degree_car(), inputs)
        model = identify_arx(inputs[:, :4], y, inputs[:, 4:], order=8).model
        radius = {
            (h_c, R): spectral_radius(model, gpc_law(multi_step_predictor(model, 8, h_c), Q_PAPER, R, "preview"))
            for h_c in (4, 8)
            for R in (1e-7, 1e-9)
        }
        assert radius[4, 1e-9] > 1.0
        assert max(radius[8, 1e-9], radius[4, 1e-7], radius[8, 1e-7]) < 1.0

    def test_order_one(self):
        model = ArxModel(np.array([[[0.5]]]), np.array([[[1.0]], [[0.0]]]))
        law = gpc_law(multi_step_predictor(model, 1), 1.0, 1.0, "implicit")  # u = -y/4
        assert law.gain_y[0, 0] == pytest.approx(-0.25)
        assert spectral_radius(model, law) == pytest.approx(0.25)


class TestStorage:
    @pytest.fixture
    def law(self, model):
        provenance = {"seed": 3, "road": "perryman-3", "identification": {"condition": 1.25e6, "dropped": []}}
        return gpc_law(multi_step_predictor(model, 8, 6), Q_PAPER, 1e-7, "explicit", hold=True, provenance=provenance)

    def test_round_trip_is_exact_and_reproducible(self, law):
        text = law.to_json()
        back = GpcLaw.from_json(text)
        for name in ("gain_y", "gain_u", "gain_d", "gain_preview", "output_weight", "control_weight"):
            np.testing.assert_array_equal(getattr(back, name), getattr(law, name))
        assert (back.variant, back.hold, back.order, back.h_p, back.h_c) == ("explicit", True, 5, 8, 6)
        assert back.provenance == law.provenance
        assert back.to_json() == text
        assert max(len(line) for line in text.splitlines()) < 1000  # a row per line: differences can be read

    def test_implicit_round_trip(self, rng):
        law = gpc_law(multi_step_predictor(random_arx(rng, 2, m=1, rc=1, rd=0), 3), 1.0, 1.0, "implicit")
        back = GpcLaw.from_json(law.to_json())
        assert back.gain_d.shape == (1, 0)
        assert back.disturbances == 0

    @pytest.mark.parametrize(
        "change",
        [
            {"format": "gpc-law/9"},
            {"extra": 1},
            {"variant": "preveiw"},
            {"gain_u": [[1.0]]},
            {"h_p": 7},
            {"order": 0},
            {"hold": 1},
        ],
    )
    def test_refuses_damaged_laws(self, law, change, raises):
        with raises(ValueError):
            GpcLaw.from_dict(law.to_dict() | change)

    def test_refuses_missing_and_non_finite(self, law):
        data = law.to_dict()
        del data["gain_d"]
        with pytest.raises(ValueError, match=r"lacks \['gain_d'\]"):
            GpcLaw.from_dict(data)
        data = law.to_dict()
        data["gain_y"][1][2] = float("nan")
        with pytest.raises(ValueError, match=r"gain_y\[1, 2\] is nan"):
            GpcLaw.from_dict(data)
        with pytest.raises(ValueError, match="no JSON object"):
            GpcLaw.from_json("[]")
        with pytest.raises(ValueError, match="not JSON compliant"):
            replace(law, provenance={"x": float("nan")}).to_json()
