"""Least squares with few Jacobians: minima that are known, bounds, samples that jump, and what is counted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy import optimize

from cosim.core.signals import Array
from cosim.study import least_squares
from cosim.study.least_squares import Minimum, _loss, minimize_squares

FREE = (np.full(2, -10.0), np.full(2, 10.0))
TIME = np.linspace(0.0, 3.0, 301)
NOISE = np.random.default_rng(4).standard_normal(len(TIME))


class Counted:
    """Residuals and their derivatives, and the points that both were asked at."""

    def __init__(self, values: Callable[[Array], Array], slopes: Callable[[Array], Array]) -> None:
        self.values, self.slopes = values, slopes
        self.at: list[Array] = []
        self.exact_at: list[Array] = []

    def residuals(self, x: Array) -> Array:
        self.at.append(x.copy())
        return self.values(x)

    def with_jacobian(self, x: Array) -> tuple[Array, Array]:
        self.exact_at.append(x.copy())
        return self.values(x), self.slopes(x)

    def fit(self, x: list[float], low: Array = FREE[0], high: Array = FREE[1]) -> Minimum:
        found = minimize_squares(self.residuals, self.with_jacobian, np.array(x), low, high)
        np.testing.assert_array_equal(found.residuals, self.values(found.x))
        np.testing.assert_array_equal(found.jacobian, self.slopes(found.x))
        assert (found.x >= low).all()
        assert (found.x <= high).all()
        return found


def rosenbrock() -> Counted:
    return Counted(
        lambda x: np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]),
        lambda x: np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]]),
    )


def decay(jump: float = 0.0) -> Counted:
    """exp(x0 - exp(x1) t) with noise of 1 % of it, over the noise; one sample jumps with every thousandth of x1."""

    def shown(x: Array) -> Array:
        return np.exp(x[0] - np.exp(x[1]) * TIME)

    def values(x: Array) -> Array:
        found: Array = 100.0 * (shown(x) - shown(np.zeros(2))) - NOISE
        found[40] += jump * (round(1e3 * x[1]) % 2)
        return found

    return Counted(values, lambda x: 100.0 * shown(x)[:, None] * np.column_stack([TIME**0, -np.exp(x[1]) * TIME]))


def reference(of: Counted) -> Array:
    found: Array = optimize.least_squares(of.values, np.zeros(2), jac=of.slopes, xtol=1e-14, ftol=1e-14).x
    return found


def test_a_curved_valley_leads_to_its_minimum() -> None:
    of = rosenbrock()
    found = of.fit([-1.2, 1.0])
    assert found.converged
    np.testing.assert_allclose(found.x, 1.0, atol=1e-6)
    assert len(of.at) < 100


def test_a_fit_to_noise_needs_two_jacobians_and_no_point_twice() -> None:
    of = decay()
    found = of.fit([0.3, -0.4])
    deviations = np.sqrt(np.diag(np.linalg.inv(found.jacobian.T @ found.jacobian)))
    assert found.converged
    np.testing.assert_array_less(np.abs(found.x - reference(of)), 0.1 * deviations)
    assert len(of.exact_at) == 2
    np.testing.assert_array_equal(of.exact_at[-1], found.x)
    assert len({tuple(x) for x in (*of.at, *of.exact_at)}) == len(of.at) + len(of.exact_at)


def test_beyond_the_limit_a_residual_counts_by_its_magnitude() -> None:
    r = np.array([0.0, 1.0, -30.0])
    total, weights = _loss(r, 2.0)
    assert total == pytest.approx(np.sum(8.0 * (np.sqrt(1.0 + r**2 / 4.0) - 1.0)), rel=1e-14)
    h = 1e-6 * np.eye(3)
    slopes = [(_loss(r + e, 2.0)[0] - _loss(r - e, 2.0)[0]) / 2e-6 for e in h]
    np.testing.assert_allclose(slopes, 2.0 * weights * r, atol=1e-7)
    assert _loss(r, None)[0] == 901.0


def test_an_upper_bound_holds() -> None:
    """With x0 at its end, more of it would fit better."""
    of = decay()
    found = of.fit([-0.4, 0.3], high=np.array([-0.1, 10.0]))
    assert found.converged
    assert found.x[0] == -0.1
    slope = found.jacobian.T @ found.residuals
    assert slope[0] < 0.0
    assert abs(slope[1]) < 0.1 * np.linalg.norm(found.jacobian[:, 1]) * found.residuals.std()


def test_bounds_hold_and_the_rest_is_at_its_minimum_along_them() -> None:
    """With x1 at its end the other solves a linear problem in exp(x0)."""
    of = decay()
    found = of.fit([0.3, 0.3], low=np.array([-10.0, 0.1]))
    model = 100.0 * np.exp(-np.exp(0.1) * TIME)
    expected = np.log(model @ (100.0 * np.exp(-TIME) + NOISE) / (model @ model))
    assert found.converged
    np.testing.assert_allclose(found.x, [expected, 0.1], atol=1e-4)


def test_all_may_end_at_bounds() -> None:
    of = Counted(lambda x: np.array([x[0] - 3.0, 2.0 * (x[0] - 3.0), 1.0]), lambda _: np.array([[1.0], [2.0], [0.0]]))
    found = of.fit([0.0], np.array([-1.0]), np.array([1.0]))
    assert (found.x[0], found.converged) == (1.0, True)


def test_a_bound_of_the_other_side_is_left_again() -> None:
    """The first step ends at it, the minimum lies inside."""
    found = rosenbrock().fit([1.9, 0.5], low=np.array([0.5, 0.2]), high=np.array([2.0, 4.0]))
    np.testing.assert_allclose(found.x, 1.0, atol=1e-6)


def test_what_moves_nothing_stays_where_it_began() -> None:
    of = decay()
    slopes = of.slopes
    of.slopes = lambda x: slopes(x) * [1.0, 0.0]
    values = of.values
    of.values = lambda x: values(x * [1.0, 0.0])
    found = of.fit([0.5, 0.7])
    assert found.converged
    assert found.x[1] == pytest.approx(0.7)
    still = Counted(lambda _: np.ones(5), lambda _: np.zeros((5, 2))).fit([0.5, 0.7])
    assert still.converged
    np.testing.assert_array_equal(still.x, [0.5, 0.7])


def test_residuals_of_zero_are_a_minimum() -> None:
    found = Counted(lambda x: np.append(x - 1.0, 0.0), lambda _: np.eye(3, 2)).fit([4.0, -2.0])
    assert found.converged
    np.testing.assert_allclose(found.x, 1.0, atol=1e-12)


@pytest.mark.parametrize("start", [[0.3, -0.4], [-0.5, 0.6], [0.05, 0.02]])
def test_a_sample_that_jumps_stops_no_fit(start: list[float]) -> None:
    """It jumps by 40 standard deviations, so steps across it look bad; the result stays within one of them."""
    of, smooth = decay(jump=40.0), decay()
    found = of.fit(start)
    deviations = np.sqrt(np.diag(np.linalg.inv(found.jacobian.T @ found.jacobian)))
    assert found.converged
    np.testing.assert_array_less(np.abs(found.x - reference(smooth)), deviations)
    assert len(of.exact_at) <= 8


def test_a_fit_that_runs_out_of_steps_has_not_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(least_squares, "STEPS", 1)
    assert not rosenbrock().fit([-1.2, 1.0]).converged
