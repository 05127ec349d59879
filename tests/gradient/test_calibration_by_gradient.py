"""A fit by derivatives of the run finds what one by differences finds, in fewer runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from built import BuiltFmus

from cosim import System
from cosim.study.calibration import SystemResponse, calibrate

NAMES = {"car.body.mass": 2.45, "car.suspension.stiffness": 900.0, "car.suspension.damping": 7.5}


@pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
def test_a_fit_by_gradients_agrees_with_one_by_differences(
    built_fmus: BuiltFmus, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = 0

    def counted(call: Any) -> Any:
        def run(*arguments: Any, **more: Any) -> Any:
            nonlocal runs
            runs += 1
            return call(*arguments, **more)

        return run

    for name in ("run", "gradient"):
        monkeypatch.setattr(System, name, counted(getattr(System, name)))
    found, needed = [], []
    for gradient in (False, True):
        with System(allow_unconnected=True) as system:
            system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms")
            system["car"].set({"body.z": 0.01})
            model = SystemResponse(
                system, ["car.body.z", "car.body.az"], stop_time=0.5, interval="5 ms", lanes="off", gradient=gradient
            )
            noise = np.random.default_rng(3).normal(size=(101, 2)) * (1e-5, 1e-2)
            measured = model(NAMES) + noise
            runs = 0
            ranges = {n: (1.2 * v, 0.3 * v, 3.0 * v) for n, v in NAMES.items()}
            found.append(calibrate(model, measured, ranges, noise=(1e-5, 1e-2)))
            needed.append(runs)
    by_differences, by_gradient = found
    assert by_gradient.converged
    assert by_gradient.by_difference == {}
    np.testing.assert_allclose(
        np.log(by_gradient.values / by_differences.values) / by_differences.deviations, 0.0, atol=0.01
    )
    np.testing.assert_allclose(by_gradient.deviations, by_differences.deviations, rtol=1e-5)
    np.testing.assert_allclose(by_gradient.intervals, by_differences.intervals, rtol=1e-5)
    np.testing.assert_allclose(by_gradient.values, list(NAMES.values()), rtol=0.02)
    assert needed[1] * 5 < needed[0]


class Jumping(SystemResponse):
    """A decay whose sample 40 jumps with every thousandth of the rate, as an acceleration does at a touch-down."""

    t = np.linspace(0.0, 2.0, 201)

    def __init__(self, gradient: bool) -> None:
        self.gradient, self.by_difference = gradient, {}

    def __call__(self, values: Mapping[str, float]) -> np.ndarray:
        y = values["size"] * np.exp(-values["rate"] * self.t)
        y[40] += 0.5 * (round(1e3 * values["rate"]) % 2)
        return y[:, None]

    def together(self, several: Sequence[Mapping[str, float]]) -> list[np.ndarray]:
        return [self(values) for values in several]

    def with_slopes(self, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        e = np.exp(-values["rate"] * self.t)
        return self(values), np.stack([e, -values["size"] * self.t * e], axis=-1)[:, None]


def test_samples_that_jump_are_no_slopes() -> None:
    """Differences take the jump of a sample for a slope, so that their interval is too narrow."""
    truth = {"size": 2.0, "rate": 1.2005}
    noise = 0.05 * np.random.default_rng(1).normal(size=(201, 1))
    ranges = {"size": (2.6, 0.2, 20.0), "rate": (0.9, 0.1, 12.0)}
    found = {g: calibrate(Jumping(g), Jumping(g)(truth) + noise, ranges, noise=0.05) for g in (True, False)}
    slopes = Jumping(True).with_slopes(truth)[1][:, 0] * list(truth.values()) / 0.05
    expected = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    np.testing.assert_allclose(found[True].deviations, expected, rtol=0.02)
    assert np.abs(np.log(found[True].values / list(truth.values()))).max() < 3.0 * expected.max()
    assert found[False].deviations[1] < 0.5 * expected[1]


def test_components_that_are_followed_by_differences_are_named() -> None:
    model = Jumping(True)
    model.by_difference["car"] = "it is isolated"
    found = calibrate(model, model({"size": 2.0, "rate": 1.2}), {"size": (2.6, 0.2, 20.0), "rate": (0.9, 0.1, 12.0)})
    assert "car: derivatives from differences of two neighboring instances (it is isolated)" in found.text()
