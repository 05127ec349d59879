"""Nine-degree ride model of the 6x6 against an independent derivation.

From energy, statics, mirror images, stability.
"""

import numpy as np
import positive
import pytest
from hypothesis import given, settings
from named import Named

from build_fmus.stability import check_solver
from fmu_sources.plants import ride_car
from fmu_sources.roads import RoadLayout
from fmu_sources.vehicles import load_ride_car, load_three_axle

CORNERS = ("a1l", "a1r", "a2l", "a2r", "a3l", "a3r")
LEFT = np.array([1.0, -1.0] * 3)
POSITIONS = ["body.z", "body.roll", "body.pitch", *(f"wheel.{k}.z" for k in CORNERS)]
RATES = ["body.vz", "body.roll_rate", "body.pitch_rate", *(f"wheel.{k}.vz" for k in CORNERS)]
INPUTS = [pattern.format(k) for pattern in ("road.{}.height", "road.{}.rate", "force.{}") for k in CORNERS]


@pytest.fixture(scope="module")
def car():
    return ride_car(load_three_axle("three_axle"), name="ThreeAxleRide").model()


def values_of(car):
    return {e.name: e.start for e in car.elements("parameter") if e.name != "solver.step"}


def uneven(car, seed=0):
    """Every parameter changed by a factor of its own: nothing is symmetric any more."""
    rng = np.random.default_rng(seed)
    return {name: value * rng.uniform(0.6, 1.6) for name, value in values_of(car).items()}


def from_energy(v):
    """A (18 x 18), B (18 x 6), G (18 x 12) from the quadratic forms of energy, dissipation and work.

    T = q' M q / 2, V = e' K e / 2, R = e'' C e' / 2 with e = (strut lengths, tire lengths) = E q - F road; then
    M q'' = -E'K(E q - F r) - E'C(E q' - F r') + (E_struts)' u. Plain matrices; nothing of the component is used.
    """
    of = lambda pattern: np.array([v[pattern.format(k)] for k in CORNERS])  # noqa: E731
    struts = np.column_stack([np.ones(6), LEFT * of("wheel.{}.half_track"), -of("wheel.{}.x"), -np.eye(6)])
    tires = np.column_stack([np.zeros((6, 3)), np.eye(6)])
    M = np.diag([v["body.mass"], v["body.roll_inertia"], v["body.pitch_inertia"], *of("wheel.{}.mass")])
    E = np.vstack([struts, tires])
    K = np.diag(np.concatenate([of("suspension.{}.stiffness"), of("tire.{}.stiffness")]))
    C = np.diag(np.concatenate([of("suspension.{}.damping"), of("tire.{}.damping")]))
    F = np.vstack([np.zeros((6, 6)), np.eye(6)])
    Mi, none = np.linalg.inv(M), np.zeros((9, 6))
    A = np.block([[np.zeros((9, 9)), np.eye(9)], [-Mi @ E.T @ K @ E, -Mi @ E.T @ C @ E]])
    B = np.vstack([none, Mi @ struts.T])
    G = np.block([[none, none], [Mi @ E.T @ K @ F, Mi @ E.T @ C @ F]])
    return A, B, G


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_matrices_are_those_of_the_energies(car, seed):
    values = values_of(car) if seed is None else uneven(car, seed)
    model = car.linearize(p=car.vector("parameter", values))
    assert model.states == POSITIONS + RATES
    assert model.inputs == INPUTS
    A, B, G = from_energy(values)
    assert (A.shape, B.shape, G.shape) == ((18, 18), (18, 6), (18, 12))
    for matrix, expected in ((model.A, A), (model.B[:, 12:], B), (model.B[:, :12], G)):
        np.testing.assert_allclose(matrix, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_signs_that_the_printed_equations_have_wrong(car):
    """Pitch equation (3.44) and wheel equations (3.40), (3.41) of paper 003.

    Its roll and pitch are -1 times ours, so that coefficients of a body angle in a wheel or heave equation change sign
    and those of one angle in the equation of the other do not.
    """
    values = uneven(car)
    model = car.linearize(p=car.vector("parameter", values))
    rows = dict(zip(model.states, (dict(zip(model.states, r, strict=True)) for r in model.A), strict=True))
    k_s = {k: values[f"suspension.{k}.stiffness"] for k in CORNERS}
    x = {k: values[f"wheel.{k}.x"] for k in CORNERS}
    y = {k: values[f"wheel.{k}.half_track"] * (1 if k.endswith("l") else -1) for k in CORNERS}

    pitch = {name: a * values["body.pitch_inertia"] for name, a in rows["body.pitch_rate"].items()}
    assert -pitch["body.z"] == pytest.approx(-sum(k_s[k] * x[k] for k in CORNERS))  # 1l negative as the others
    assert pitch["body.roll"] == pytest.approx(sum(k_s[k] * x[k] * y[k] for k in CORNERS))  # -,+,-,+,+,- with |x|
    assert pitch["body.pitch"] == pytest.approx(-sum(k_s[k] * x[k] ** 2 for k in CORNERS))  # third axle too
    for k in ("a3l", "a3r"):  # nose up pulls the third axle's wheels down: a minus sign is missing in print
        row = rows[f"wheel.{k}.vz"]
        assert -row["body.pitch"] * values[f"wheel.{k}.mass"] == pytest.approx(-k_s[k] * abs(x[k]))


def test_lifting_the_road_lifts_everything_by_as_much(car):
    """DC gain of a rigid lift: 1 for body and wheels, 0 for angles and deflections."""
    for values in (values_of(car), uneven(car)):
        model = car.linearize(p=car.vector("parameter", values))
        lift = np.concatenate([np.ones(6), np.zeros(12)])
        gain = dict(zip(model.outputs, (model.D - model.C @ np.linalg.solve(model.A, model.B)) @ lift, strict=True))
        for name, value in gain.items():
            heights = name == "body.z" or (name.startswith("wheel.") and name.endswith(".z"))
            assert value == pytest.approx(1.0 if heights else 0.0, abs=1e-6), name


def test_outputs_are_those_of_the_two_axle_car(car):
    """The same names, with the corners of three axles."""
    two = [e.name for e in ride_car(load_ride_car("sedan")).model().output_elements()]
    body = {n for n in two if n.startswith(("body.", "seat."))}
    patterns = [n.replace(".fl.", ".{}.") for n in two if ".fl." in n]
    assert {e.name for e in car.output_elements()} == body | {p.format(k) for p in patterns for k in CORNERS}


def mirrored(name):
    turn = {k: k[:2] + ("r" if k.endswith("l") else "l") for k in CORNERS}
    return ".".join(turn.get(part, part) for part in name.split("."))


def test_mirror_image(car):
    """Exchanging left and right in parameters, inputs and start permutes all outputs over a whole run."""
    values = uneven(car)
    start = dict(zip(POSITIONS + RATES, 0.02 * np.random.default_rng(2).standard_normal(18), strict=True))
    names = [e.name for e in car.output_elements()]
    runs = []
    for image in (False, True):

        def turn(name, image=image):
            return mirrored(name) if image else name

        def sign(name, image=image):
            return -1.0 if image and "roll" in name else 1.0

        run = Named(car, {turn(n): v for n, v in values.items()} | {"seat.y": (-1 if image else 1) * values["seat.y"]})
        run.x = [start[turn(n)] * sign(n) for n in POSITIONS + RATES]
        inputs, rows = np.random.default_rng(3), []
        for _ in range(200):
            signals = inputs.standard_normal(18) * np.repeat([0.05, 1.0, 5e3], 6)
            given = dict(zip(INPUTS, signals, strict=True))
            run.u[:] = [given[turn(n)] for n in INPUTS]
            run.step(1e-3)
            y = run.shown()
            rows.append([y[turn(n)] * sign(n) for n in names])
        runs.append(np.array(rows))
    original, image = runs
    scale = np.maximum(1.0, np.abs(original).max(axis=0))
    np.testing.assert_allclose(image / scale, original / scale, rtol=0, atol=1e-9)


def test_symmetric_vehicle_on_a_symmetric_road_never_rolls(car):
    run = Named(car, {})
    rng = np.random.default_rng(4)
    for _ in range(200):
        run.u[:] = np.repeat(rng.standard_normal(9) * np.repeat([0.1, 1.0, 5e4], 3), 2)
        run.step(1e-3)
        y = run.shown()
        assert abs(y["body.roll"]) < 1e-12
        assert y["wheel.a2l.z"] == pytest.approx(y["wheel.a2r.z"], abs=1e-12)
    assert abs(y["body.pitch"]) > 1e-6


def test_a_force_lifts_the_body_and_turns_it(car):
    """Positive forces push the body up and the wheel down; at the front left: nose up, left side up (ISO 8855)."""
    model = car.linearize()
    column = model.inputs.index("force.a1l")
    row = dict(zip(model.outputs, model.D[:, column], strict=True))
    assert row["body.az"] > 0 > row["wheel.a1l.az"]
    assert row["body.pitch_acceleration"] < 0 < row["body.roll_acceleration"]


def test_static_response_to_forces(car):
    """Equal forces open all struts by F/ks and no tire feels them; forces at one axle shift load between the three."""
    model = car.linearize()
    dc = model.D - model.C @ np.linalg.solve(model.A, model.B)
    y = dict(zip(model.outputs, dc @ np.r_[np.zeros(12), np.full(6, 20e3)], strict=True))
    assert [y[f"suspension.{k}.deflection"] for k in CORNERS] == pytest.approx([0.1] * 6, abs=1e-12)
    assert [y[f"tire.{k}.deflection"] for k in CORNERS] == pytest.approx([0.0] * 6, abs=1e-12)
    y = dict(zip(model.outputs, dc @ np.r_[np.zeros(16), 20e3, 20e3], strict=True))
    assert y["body.pitch"] > 0  # the lifted rear puts the nose down
    loads = np.array([y[f"tire.{k}.deflection"] for k in CORNERS]) * -900e3
    assert loads.sum() == pytest.approx(0.0, abs=1e-6)
    assert loads @ np.repeat([1.98, -0.02, -2.02], 2) == pytest.approx(0.0, abs=1e-6)
    assert loads[4] > 1e3  # pressed onto the ground


def test_modes(car):
    """Heave below hop as of the values in the file: body on six struts in series with their tires."""
    values = np.linalg.eigvals(car.linearize().A)
    frequencies = np.sort(np.abs(values[values.imag > 0])) / (2 * np.pi)
    series = 6 / (1 / 200e3 + 1 / 900e3)
    assert frequencies.min() == pytest.approx(np.sqrt(series / 17000) / (2 * np.pi), rel=0.15)
    hop = np.sqrt((200e3 + 900e3) / 500) / (2 * np.pi)
    assert frequencies.max() == pytest.approx(hop, rel=0.1)
    check_solver(car)


@given(positive.parameters({k: {"a1": (0.3, 5.0), "a2": (-2.0, 2.0), "a3": (-5.0, -0.3)}[k[:2]] for k in CORNERS}))
@settings(deadline=None, max_examples=60)
def test_positive_parameters_are_always_stable(car, values):
    positive.check_stable(car, values)


def test_layout_of_a_road_has_six_wheels():
    layout = RoadLayout.of(load_three_axle("three_axle"), preview_count=50, preview_step=0.005)
    assert [w.corner for w in layout.wheels] == list(CORNERS)
    assert [w.x for w in layout.wheels] == [1.98, 1.98, -0.02, -0.02, -2.02, -2.02]
    assert [w.side for w in layout.wheels] == ["left", "right"] * 3
