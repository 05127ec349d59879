"""Calibration of responses whose answers are known in closed form, and of systems; what users do wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from cosim import PythonComponent, System
from cosim.study.calibration import Calibration, CalibrationError, SystemResponse, _by_parameter, calibrate

TIME = np.linspace(0, 3, 301)
NOISE = 0.01


def decay(values: Mapping[str, float]) -> np.ndarray:
    """Model size exp(-rate t): both parameters are identifiable."""
    return values["size"] * np.exp(-values["rate"] * TIME)


def noisy(clean: np.ndarray, seed: int = 0) -> np.ndarray:
    return clean + NOISE * np.random.default_rng(seed).standard_normal(clean.shape)


TRUE = {"size": 2.0, "rate": 0.7}
RANGES = {"size": (1.0, 0.1, 10.0), "rate": (2.0, 0.1, 10.0)}


def test_values_information_and_intervals_are_those_of_the_formula() -> None:
    found = calibrate(decay, noisy(decay(TRUE)), RANGES, noise=NOISE)
    assert found.converged
    np.testing.assert_allclose(found.values, [2.0, 0.7], rtol=0.01)
    size, rate = found.values
    columns = np.column_stack([size * np.exp(-rate * TIME), -rate * TIME * size * np.exp(-rate * TIME)])
    exact = columns.T @ columns / NOISE**2
    np.testing.assert_allclose(found.information, exact, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(exact), rtol=1e-6)
    low, high = found.intervals[0]
    assert math.log(high / low) == pytest.approx(2 * 1.95996 * found.deviations[0], rel=1e-4)
    assert found.not_identifiable == found.correlated == []
    assert found.misfit == pytest.approx(1, abs=0.2)
    assert not found.underfits


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """95 of 100, within three standard deviations of such a count, with the noise given or estimated."""
    for noise in (NOISE, None):
        held = 0
        for seed in range(60):
            found = calibrate(decay, noisy(decay(TRUE), seed), RANGES, noise=noise)
            held += sum(low <= TRUE[n] <= high for n, (low, high) in zip(found.names, found.intervals, strict=True))
        assert 120 * 0.95 - 3 * math.sqrt(120 * 0.95 * 0.05) <= held <= 120


def test_the_noise_is_estimated_from_the_residuals() -> None:
    found = calibrate(decay, noisy(decay(TRUE)), RANGES)
    assert found.estimated
    assert found.noise[0] == pytest.approx(NOISE, rel=0.15)
    given = calibrate(decay, noisy(decay(TRUE)), RANGES, noise=NOISE)
    np.testing.assert_allclose(found.values, given.values, rtol=1e-6)
    np.testing.assert_allclose(found.deviations, given.deviations, rtol=0.25)
    low, high = found.intervals[0]
    assert math.log(high / low) == pytest.approx(
        2 * 1.96793 * found.deviations[0], rel=1e-4
    )  # Student's t, 299 degrees of freedom


def test_what_moves_nothing_is_not_told() -> None:
    found = calibrate(decay, noisy(decay(TRUE)), {**RANGES, "colour": (3.0, 1.0, 9.0)}, noise=NOISE)
    assert found.not_identifiable == ["colour"]
    assert found.intervals[2] == (0.0, math.inf)
    assert found.values[2] == pytest.approx(3.0)
    assert "Not identifiable from these data: colour." in found.text()
    np.testing.assert_allclose(found.values[:2], [2.0, 0.7], rtol=0.01)
    assert np.isfinite(found.deviations[:2]).all()


def test_a_product_is_told_and_its_factors_are_not() -> None:
    def product(values: Mapping[str, float]) -> np.ndarray:
        return values["mass"] * values["gain"] * np.exp(-values["rate"] * TIME)

    ranges = {"mass": (1.5, 0.1, 10.0), "gain": (1.0, 0.1, 10.0), "rate": (1.0, 0.1, 10.0)}
    found = calibrate(product, noisy(decay(TRUE)), ranges, noise=NOISE)
    assert found.not_identifiable == ["mass", "gain"]
    assert found.values[0] * found.values[1] == pytest.approx(2.0, rel=0.01)
    worst = found.combinations[-1][1]
    assert set(worst) == {"mass", "gain"}
    assert worst["mass"] == -worst["gain"]
    assert found.combinations[-1][0] > 1e3 * found.combinations[0][0]
    assert np.isinf(found.deviations).tolist() == [True, True, False]


@pytest.mark.parametrize("seed", range(4))
def test_combinations_do_not_depend_on_the_basis_that_lapack_chooses(seed: int) -> None:
    """Two parameters with equal information and two with none.

    Any axes of either plane, of either sign, give the same result.
    """
    rng = np.random.default_rng(seed)
    size, axes = np.array([3.0, 3.0, 1e-17, 0.0]), np.linalg.qr(np.random.default_rng(9).standard_normal((4, 4)))[0]
    turn = np.zeros((4, 4))
    turn[:2, :2], turn[2:, 2:] = (np.linalg.qr(rng.standard_normal((2, 2)))[0] for _ in range(2))
    expected, found = _by_parameter(size, axes), _by_parameter(size, axes @ turn)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(found.T @ found, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(found[:, :2] @ found[:, :2].T, axes[:, :2] @ axes[:, :2].T, atol=1e-12)


def test_two_that_do_nearly_the_same_are_told_together_only() -> None:
    def nearly(values: Mapping[str, float]) -> np.ndarray:
        return values["a"] * np.exp(-0.7 * TIME) + values["b"] * np.exp(-0.8 * TIME)

    found = calibrate(nearly, noisy(nearly({"a": 1.0, "b": 1.0})), dict.fromkeys("ab", (0.5, 0.01, 10.0)), noise=1e-3)
    ((one, other, r),) = found.correlated
    assert {one, other} == {"a", "b"}
    assert r < -0.99
    assert (
        "Identifiable only in combination: a and b (correlation -0.99" in found.text()
        or "(correlation -1.000" in found.text()
    )


def test_pairs_come_by_how_much_they_are_one() -> None:
    """The nearer two rates are, the less the data tell their sizes apart."""
    rates = {"a": 0.7, "b": 0.9, "c": 1.0}

    def sizes(values: Mapping[str, float]) -> np.ndarray:
        return sum(values[n] * np.exp(-rate * TIME) for n, rate in rates.items()) + 0 * TIME

    found = calibrate(
        sizes, noisy(sizes(dict.fromkeys("abc", 1.0))), dict.fromkeys("abc", (0.9, 0.01, 10.0)), noise=1e-3
    )
    assert len(found.correlated) > 1
    strengths = [abs(r) for *_, r in found.correlated]
    assert strengths == sorted(strengths, reverse=True)
    assert strengths[0] > strengths[-1]
    assert set(found.correlated[0][:2]) == {"b", "c"}


def test_an_end_of_a_range_is_no_result() -> None:
    found = calibrate(decay, decay(TRUE), {**RANGES, "rate": (0.3, 0.1, 0.5)}, noise=NOISE)
    assert found.at_bounds == [False, True]
    assert "rate" in found.not_identifiable
    assert "rate ended at a bound of its range" in found.text()


def test_a_model_that_lacks_something_is_told_by_its_residuals() -> None:
    data = noisy(decay(TRUE) + 0.3 * np.sin(5 * TIME))
    given, estimated = (calibrate(decay, data, RANGES, noise=n) for n in (NOISE, None))
    assert given.underfits
    assert "The residuals are larger than the noise" in given.text()
    assert estimated.inflation > 10
    assert "Residuals are autocorrelated" in estimated.text()
    assert calibrate(decay, noisy(decay(TRUE)), RANGES).inflation < 1.5


def test_outputs_of_different_size_count_alike() -> None:
    def both(values: Mapping[str, float]) -> np.ndarray:
        return np.column_stack([1e6 * decay({**values, "size": 1.0}), values["size"] * np.ones_like(TIME)])

    found = calibrate(both, both(TRUE), RANGES)
    np.testing.assert_allclose(found.values, [2.0, 0.7], rtol=1e-4)
    assert found.residuals.shape == (301, 2)


def test_further_first_values_find_a_smaller_sum() -> None:
    def wave(values: Mapping[str, float]) -> np.ndarray:
        return np.sin(values["rate"] * TIME)

    def fit(others: int) -> Calibration:
        return calibrate(wave, wave({"rate": 9.0}), {"rate": (2.0, 1.0, 20.0)}, noise=NOISE, others=others)

    assert fit(0).underfits
    assert fit(20).values[0] == pytest.approx(9.0)


# -------------------------------------------------------------------------------------------------------------- systems


class Lag(PythonComponent):
    """y' = rate (1 - y), by Euler."""

    outputs = ("y [m]",)
    parameters = {"rate [1/s]": 1.0}  # noqa: RUF012
    default_step = "10 ms"

    def begin(self) -> None:
        self.y = 0.0

    def start(self, u: np.ndarray, y: np.ndarray) -> None:  # noqa: ARG002
        y[0] = self.y

    def step(self, t: float, h: float, u: np.ndarray, y: np.ndarray) -> None:  # noqa: ARG002
        self.y += h * self.rate * (1 - self.y)
        y[0] = self.y


def test_a_system_is_calibrated_by_the_names_of_its_parameters(raises) -> None:
    with System() as system:
        system.add("lag", Lag())
        model = SystemResponse(system, ["lag.y"], stop_time=2.0, interval="20 ms")
        data = model({"lag.rate": 3.0})
        assert data.shape == (101, 1)
        found = calibrate(model, data, {"lag.rate": (1.0, 0.1, 30.0)}, noise=1e-3)
        assert found.values[0] == pytest.approx(3.0, rel=1e-6)
        with raises(ValueError):
            calibrate(model, data, {"lag.rat": (1.0, 0.1, 30.0)})
    with pytest.raises(ValueError, match="no component 'lag'"):
        SystemResponse(System(), ["lag.y"], stop_time=1, interval=0.1)


@pytest.mark.parametrize(
    "changes",
    [
        {"parameters": {}},
        {"parameters": {"rate": (1.0, 2.0, 3.0)}},
        {"parameters": {"rate": (1.0, 3.0, 0.5)}},
        {"parameters": {"rate": (1.0, 0.0, 3.0)}},
        {"parameters": {"rate": 1.0}},
        {"measured": np.zeros(17)},
        {"measured": np.full(301, np.nan)},
        {"noise": 0.0},
    ],
)
def test_what_users_do_wrong(changes: dict[str, object], raises) -> None:
    given: dict[str, object] = {"measured": decay(TRUE), "parameters": RANGES, **changes}
    full = dict.fromkeys(RANGES, 1.0)
    with raises(CalibrationError):
        calibrate(lambda v: decay({**full, **v}), given.pop("measured"), given.pop("parameters"), **given)  # type: ignore[arg-type]


def test_too_few_data_and_a_response_that_is_not_finite(raises) -> None:
    with raises(CalibrationError):
        calibrate(lambda v: np.zeros(2), np.zeros(2), RANGES)
    with pytest.raises(CalibrationError, match=r"the response.* is inf at sample 3"):
        calibrate(lambda v: np.where(np.arange(301) == 3, np.inf, decay(v)), decay(TRUE), RANGES)


def test_no_value_is_beyond_a_bound_by_rounding() -> None:
    """exp(log(10)) is 10.000000000000002."""
    time, tried = np.linspace(0.0, 1.0, 50), []

    def response(values):
        tried.append(values["k"])
        return values["k"] * time

    found = calibrate(response, 12.0 * time, {"k": (9.0, 1.0, 10.0)}, noise=[0.01])
    assert max(tried) <= 10.0
    assert found.values[0] <= 10.0
