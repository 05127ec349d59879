"""The preview LQ controller as a component: modes, horizons, memory, invariance, bad input."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from build_fmus.reference import Evaluator
from fmu_sources.controllers.lq import preview
from fmu_sources.controllers.lq.design import LqError, continuous_lq, output_index, sampled_lq
from fmu_sources.controllers.lq.design.riccati import RESIDUAL_LIMIT
from fmu_sources.controllers.lq.design.tunable import tunable_taps
from fmu_sources.controllers.lq.preview import (
    CONTINUOUS_PERIOD,
    MODES,
    WEIGHTED,
    design_taps,
    preview_lq,
    ride_plant,
    weight_parameters,
)
from fmu_sources.controllers.lq.preview_weights import WeightsError, control_weights, load_weights, output_weights
from fmu_sources.models.corners import CORNERS
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car

SPEED = 75 / 3.6
WHEELBASE = 2.814
ORDER = (*output_weights(CORNERS), *control_weights(CORNERS))


@pytest.fixture(scope="module")
def car():
    return ride_car(load_ride_car("sedan"), name="RideCarSedan")


@pytest.fixture(scope="module")
def plant(car):
    return ride_plant(car)


@pytest.fixture(scope="module")
def controller(car):
    return preview_lq(car, load_weights("comfort"), name="PreviewLqComfort").model()


@pytest.fixture(scope="module")
def tunable(car):
    return preview_lq(car, load_weights("road_holding"), name="X", preview_count=2, memory=0.02, tunable=True)


@pytest.fixture(scope="module")
def coarse(car):
    return preview_lq(car, load_weights("comfort"), name="PreviewLqComfort5ms", period=5e-3).model()


def run(controller, road, states, *, steps: int, offset: float = 0.0, speed: float = SPEED, **parameters: float):
    """Feed a road (function of side and time) and states (rows); returns outputs (steps, 5) and the states' names."""
    evaluator = Evaluator(controller, parameters)
    slots = {e.name: e.slot for e in controller.elements("input")}
    T = controller.sample_time
    out = []
    for k in range(steps):
        u = evaluator.u
        u[slots["speed"]] = speed
        for side in ("fl", "fr"):
            u[slots[f"road.{side}.height"]] = road(side, k * T) + offset
            for i in range(48):
                u[slots[f"preview.{side}[{i + 1}]"]] = road(side, k * T + 0.005 * i) + offset
        for name, value in states(k).items():
            lifted = name == "body.z" or name.endswith(".z")
            u[slots[name]] = value + (offset if lifted else 0.0)
        evaluator.step(T)
        out.append(evaluator.outputs())
    return np.array(out)


def hills(side: str, t: float) -> float:
    return 0.03 * np.sin(11 * t + (side == "fr")) + 0.01 * np.cos(35 * t)


def wobble(plant):
    def states(k: int) -> dict[str, float]:
        return {n: 0.01 * np.sin(0.02 * k + i) for i, n in enumerate(plant.states)}

    return states


def still(plant):
    return lambda k: dict.fromkeys(plant.states, 0.0)


def test_plant_is_the_cars_own_linear_model(plant) -> None:
    assert plant.A.shape == (14, 14)
    assert plant.outputs == WEIGHTED
    np.testing.assert_array_equal(plant.F[:7], 0.0)  # accelerations and travels do not see the road directly


def test_cars_with_damped_tires_are_refused(raises) -> None:
    hmmwv = ride_car(load_ride_car("ride_car_hmmwv"), name="RideCarHmmwv")
    with raises(ValueError):
        ride_plant(hmmwv)


def test_active_mode_is_state_feedback_alone(controller, plant) -> None:
    index = output_index(plant, load_weights("comfort").outputs(CORNERS), load_weights("comfort").controls(CORNERS))
    K = sampled_lq(plant, index, 1e-3).K
    states = wobble(plant)
    got = run(controller, hills, states, steps=20, mode=MODES["active"])
    expected = np.array([-K @ np.array(list(states(k).values())) for k in range(20)])
    np.testing.assert_allclose(got[:, :4], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_preview_sees_ahead_and_delay_does_not(controller, plant) -> None:
    def step_ahead(side: str, t: float) -> float:  # noqa: ARG001
        return 0.05 if t >= 0.1 else 0.0

    for mode, acts in (("active", False), ("delay", False), ("preview", True)):
        forces = run(controller, step_ahead, still(plant), steps=5, mode=MODES[mode])[:, :4]
        assert (np.abs(forces).max() > 1.0) == acts


def test_rear_wheels_follow_after_the_delay(controller, plant) -> None:
    """In delay mode the front forces stay zero; the rear ones begin when the front wheels meet the step."""

    def step(side: str, t: float) -> float:
        return 0.05 if side == "fl" and t >= 0.0995 else 0.0

    forces = run(controller, step, still(plant), steps=300, mode=MODES["delay"])[:, :4]
    active = np.abs(forces).max(axis=1) > 1e-6
    assert active.argmax() == 100  # seen by the front wheel, known to come to the rear wheel 135 ms later
    assert not active[:100].any()


def test_feedforward_equals_the_integral(controller, plant) -> None:
    """Against adaptive quadrature of (17) for a road that is linear between the preview points."""
    weights = load_weights("comfort")
    law = continuous_lq(plant, output_index(plant, weights.outputs(CORNERS), weights.controls(CORNERS)))
    tp, tau = 0.12, WHEELBASE / SPEED

    def road(side: str, t: float) -> float:  # linear between points 5 ms apart, at rest before 0
        i = np.floor(t / 0.005 + 1e-9)
        a, b = (0.02 * np.sin(40 * 0.005 * max(j, 0) + (side == "fr")) * (j > 0) for j in (i, i + 1))
        return a + (b - a) * (t / 0.005 - i)

    steps = 201
    got = run(controller, road, still(plant), steps=steps, preview_time=tp)[-1, :4]
    now = (steps - 1) * 1e-3
    whole = np.floor(tau / 1e-3) * 1e-3
    expected = np.zeros(4)
    for column, (side, lag, horizon) in enumerate(
        (("fl", 0.0, tp), ("fr", 0.0, tp), ("fl", tau, tp + whole), ("fr", tau, tp + whole))
    ):
        n = round(horizon / 1e-3)
        s = np.linspace(0, horizon, 8 * n + 1)  # Simpson on a grid that holds every corner of the sampled road
        knots = np.arange(n + 1) * 1e-3
        heights = np.interp(s, knots, _sampled(road, side, now, lag, knots))
        kernel = np.array([law.kernel(x)[:, column] for x in s])
        weight = np.ones(len(s))
        weight[1:-1:2], weight[2:-1:2] = 4, 2
        expected += (weight[:, None] * kernel * heights[:, None]).sum(axis=0) * (s[1] - s[0]) / 3
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def _sampled(road, side: str, now: float, lag: float, ahead: np.ndarray) -> np.ndarray:
    """Road as the controller knows it at now + ahead - lag: linear between ticks of 1 ms."""
    t = now + ahead - lag
    k = np.floor(t / 1e-3 + 1e-9)
    part = t / 1e-3 - k
    return np.array(
        [(1 - p) * road(side, i * 1e-3) + p * road(side, (i + 1) * 1e-3) for i, p in zip(k, part, strict=True)]
    )


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("which", ["controller", "coarse"])
def test_hold_tail_ignores_a_shift_of_everything(which: str, mode: str, plant, request) -> None:
    controller = request.getfixturevalue(which)
    results = [
        run(controller, hills, wobble(plant), steps=150, offset=offset, mode=MODES[mode], hold_tail=True)[:, :4]
        for offset in (0.0, 0.7)
    ]
    np.testing.assert_allclose(*results, rtol=0, atol=1e-9 * np.abs(results[0]).max())


def test_without_hold_tail_a_shift_asks_for_forces(controller, plant) -> None:
    results = [run(controller, hills, still(plant), steps=50, offset=offset)[:, :4] for offset in (0.0, 0.7)]
    assert np.abs(results[0] - results[1]).max() > 100.0


@pytest.mark.parametrize(
    ("speed", "parameters", "truncated"),
    [
        (SPEED, {}, False),
        (SPEED, {"preview_time": 0.235}, False),
        (SPEED, {"preview_time": 0.236}, True),
        (0.0, {}, True),
        (0.0, {"mode": MODES["delay"]}, True),
        (0.0, {"mode": MODES["active"]}, False),
        (WHEELBASE / 0.49, {"mode": MODES["delay"]}, False),
        (WHEELBASE / 0.51, {"mode": MODES["delay"]}, True),
    ],
)
def test_truncated_horizons_are_told(controller, plant, speed: float, parameters: dict, truncated: bool) -> None:
    got = run(controller, hills, wobble(plant), steps=3, speed=speed, **parameters)
    assert np.isfinite(got).all()
    assert bool(got[-1, 4]) is truncated


def test_mirrored_input_mirrors_the_forces(controller, plant) -> None:
    swap = str.maketrans("lr", "rl")

    def mirrored_road(side: str, t: float) -> float:
        return hills(side.translate(swap), t)

    def mirror(name: str) -> str:
        parts = name.split(".")
        return f"wheel.{parts[1][0]}{parts[1][1].translate(swap)}.{parts[2]}" if parts[0] == "wheel" else name

    states = wobble(plant)

    def mirrored(k: int) -> dict[str, float]:
        values = states(k)
        return {n: (-1 if "roll" in n else 1) * values[mirror(n)] for n in values}

    a = run(controller, hills, states, steps=200)[:, :4]
    b = run(controller, mirrored_road, mirrored, steps=200)[:, :4]
    np.testing.assert_allclose(b[:, [1, 0, 3, 2]], a, rtol=0, atol=1e-9 * np.abs(a).max())


def test_taps_of_both_forms_agree_for_short_periods(plant) -> None:
    """The exact sampled gains approach the continuous kernel as the period shrinks."""
    weights = load_weights("comfort")
    fine = design_taps(plant, weights, 1e-3, 100)
    sampled = sampled_lq(plant, output_index(plant, weights.outputs(CORNERS), weights.controls(CORNERS)), 1e-3)
    gains = -sampled.preview_gains(100)
    scale = np.abs(gains).max()
    assert np.abs(fine.interior[5:95] - gains[5:95]).max() < 0.1 * scale


def test_other_steps_need_another_build(car, raises) -> None:
    with raises(ValueError):
        preview_lq(car, load_weights("comfort"), name="X", period=2e-3, preview_step=5e-3)
    built = preview_lq(car, load_weights("comfort"), name="X", preview_step=10e-3, preview_count=24)
    assert built.variable("preview.step").must_equal == 10e-3


def test_weights_files(tmp_path, raises) -> None:
    good = (tmp_path / "mine.toml").resolve()
    text = (load_weights.__globals__["_HERE"] / "comfort.toml").read_text()
    good.write_text(text)
    assert load_weights(good) == load_weights("comfort")
    for change in (
        ("heave = 3.0", "heave = -3.0"),
        ("heave = 3.0", "heav = 3.0"),
        ("front = 1e-6", "front = 0.0"),
        ("[tire]", "[tires]"),
        ("rear = 1400.0", "rear = [1400.0, 1.0]"),
    ):
        bad = tmp_path / "bad.toml"
        bad.write_text(text.replace(*change, 1))
        with raises(WeightsError):
            load_weights(bad)
    with raises(WeightsError):
        load_weights("confort")


def test_weights_are_in_the_order_of_outputs_and_corners(tmp_path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        'name = "m"\nsource = "s"\n[acceleration]\nheave = 1\npitch = 2\nroll = 3\n[suspension]\nfront = 4\nrear = 5\n'
        "[tire]\nfront = 6\nrear = 7\n[force]\nfront = 8\nrear = 9\n"
    )
    weights = load_weights(file)
    assert weights.outputs(("fl", "fr", "rl", "rr")) == [1, 2, 3, 4, 4, 5, 5, 6, 6, 7, 7]
    assert weights.outputs(("rl", "fl")) == [1, 2, 3, 5, 4, 7, 6]
    assert weights.controls(("fl", "fr", "rl", "rr")) == [8, 8, 9, 9]
    assert weights.controls(("rr", "fl")) == [9, 8]
    assert weights.as_dict()["tire"] == {"front": 6.0, "rear": 7.0}
    assert list(weights.by_name().items())[2:5] == [
        ("acceleration.roll", 3),
        ("suspension.front", 4),
        ("suspension.rear", 5),
    ]
    assert list(weights.descriptions()) == list(weights.by_name())


def test_an_unstabilizable_car_is_named(plant) -> None:
    index = output_index(plant, load_weights("comfort").outputs(CORNERS), load_weights("comfort").controls(CORNERS))
    A = plant.A.copy()
    A[0, :], A[:, 0] = 0.0, 0.0
    A[0, 0] = 0.5  # a state that runs away and no actuator reaches
    B = plant.B.copy()
    B[0] = 0.0
    with pytest.raises(LqError, match=plant.states[0]):
        continuous_lq(replace(plant, A=A, B=B), index)


COUNT = 300


@pytest.fixture(scope="module")
def designed(plant):
    """K, feed-forward and residuals of a law that is designed of expressions, for weights of outputs and controls."""
    weights = ca.MX.sym("weights", len(plant.outputs) + len(plant.controls))
    made = tunable_taps(plant, weights, CONTINUOUS_PERIOD, COUNT)
    evaluate = ca.Function("taps", [weights], [made.K, made.interior, made.end, made.tail, made.residuals])
    return lambda given: [np.array(found) for found in evaluate(given)]


def by_numbers(plant, given):
    """K and feed-forward as they are designed in Python."""
    index = output_index(plant, given[: len(plant.outputs)], given[len(plant.outputs) :])
    foh = continuous_lq(plant, index).foh_weights(CONTINUOUS_PERIOD, COUNT)
    return [
        sampled_lq(plant, index, CONTINUOUS_PERIOD).K,
        *(np.hstack(list(a)) for a in (foh.interior, foh.end, foh.tail)),
    ]


def furthest(found, expected) -> float:
    """The largest difference, relative to the largest gain of its kind."""
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in zip(found, expected, strict=False))


def test_a_law_designed_of_expressions_is_the_one_designed_of_numbers(plant, designed) -> None:
    """Published weights, and others drawn about them, each by up to ten times."""
    rng = np.random.default_rng(7)
    published = [load_weights(name) for name in ("comfort", "road_holding")]
    for trial in range(8):
        w = published[trial % 2]
        given = np.array([*w.outputs(CORNERS), *w.controls(CORNERS)])
        if trial > 1:
            given *= 10 ** rng.uniform(-1, 1, len(given))
        found = designed(given)
        assert furthest(found, by_numbers(plant, given)) < 1e-10
        assert found[-1].max() < 1e-11


def test_over_the_whole_range_of_weights_a_law_is_right_or_refused(plant, designed, tunable) -> None:
    """Both limits of every weight included.

    What the solver of the design in Python refuses may be found, but nothing wrong is.
    """
    low, high = (np.array([getattr(tunable.variable(f"weight.{n}"), end) for n in ORDER]) for end in ("min", "max"))
    rng = np.random.default_rng(3)
    refused = 0
    for trial in range(60):
        given = np.where(low > 0, low, high * 1e-9) * (high / np.where(low > 0, low, high * 1e-9)) ** rng.uniform(
            size=len(low)
        )
        given = np.where(rng.uniform(size=len(low)) < 0.1, low, np.where(rng.uniform(size=len(low)) < 0.1, high, given))
        found = designed(given)
        if not (found[-1] < RESIDUAL_LIMIT).all():
            refused += 1
            continue
        try:
            expected = by_numbers(plant, given)
        except LqError:
            continue
        assert furthest(found, expected) < 1e-6, (trial, dict(zip(ORDER, given, strict=True)))
    assert refused < 6


def test_a_law_with_weights_as_parameters_is_for_cars_with_equal_sides(car, raises) -> None:
    heavy = design_taps(ride_plant(car), load_weights("comfort"), CONTINUOUS_PERIOD, 5)
    preview._check_sides(heavy, "X")
    for kind in ("interior", "tail"):
        table = getattr(heavy, kind).copy()
        table[2, 1, 3] *= 1.01  # of the right front actuator, for the road below the right rear wheel
        with raises(ValueError):
            preview._check_sides(replace(heavy, **{kind: table}), "X")


def test_weights_are_parameters_of_a_tunable_law(car, tunable, raises) -> None:
    weights = load_weights("road_holding")
    found = {name: tunable.variable(name).start[0] for name in weight_parameters(weights)}
    assert found == weight_parameters(weights)
    assert found["weight.acceleration.heave"] == 3.0
    assert (found["weight.tire.front"], found["weight.tire.rear"]) == (200000.0, 195000.0)
    texts = {n: tunable.variable(f"weight.{n}").description for n in ("acceleration.pitch", "tire.rear", "force.front")}
    assert texts == {
        "acceleration.pitch": "weight of the squares of accelerations of the body, rho_2 [s4/rad2]",
        "tire.rear": "weight of the squares of tire deflections [1/m2], both rear wheels",
        "force.front": "weight of the squares of actuator forces [1/N2], both front actuators",
    }
    limits = {n: (tunable.variable(f"weight.{n}").min, tunable.variable(f"weight.{n}").max) for n in ORDER}
    assert limits["acceleration.roll"] == (0.0, 1e4)
    assert limits["suspension.rear"] == (0.0, 1e7)
    assert limits["tire.front"] == (1.0, 1e8)
    assert limits["force.rear"] == (1e-9, 1e-2)
    with raises(ValueError):
        preview_lq(car, weights, name="X", period=5e-3, tunable=True)
