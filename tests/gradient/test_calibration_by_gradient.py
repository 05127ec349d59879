"""A fit by derivatives of the run finds what one by differences finds, in fewer runs."""

from __future__ import annotations

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
    np.testing.assert_allclose(by_gradient.values, by_differences.values, rtol=1e-6)
    np.testing.assert_allclose(by_gradient.intervals, by_differences.intervals, rtol=1e-5)
    np.testing.assert_allclose(by_gradient.values, list(NAMES.values()), rtol=0.02)
    assert needed[1] * 2 < needed[0]
