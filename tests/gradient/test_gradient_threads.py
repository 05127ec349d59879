"""Gradients of one system that several threads ask for."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from built import BuiltFmus

from cosim import System
from cosim.gradient import Final, Rms
from cosim.gradient.frameworks import _Metrics

NAMES = ["car.body.mass", "car.suspension.damping"]


@pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")
def test_a_call_has_the_parameters_that_it_was_given(built_fmus: BuiltFmus) -> None:
    """As JAX calls them, which has threads of its own."""
    system = System()
    system.add("car", built_fmus.path("QuarterCarBench", 3), step="1 ms", start={"body.z": 0.01})
    of = _Metrics(system, {"ride": Rms("car.body.az"), "end": Final("car.body.z")}, NAMES, 0.2, "2 ms", None)
    points = [np.array([2.0 + 0.1 * k, 6.0 + k]) for k in range(8)]
    alone = [(of.values(x), *of.jacobian(x)) for x in points]
    with ThreadPoolExecutor(4) as pool:
        values, slopes = list(pool.map(of.values, points)), list(pool.map(of.jacobian, points))
    for expected, value, found in zip(alone, values, slopes, strict=True):
        for one, other in zip(expected, (value, *found), strict=True):
            np.testing.assert_array_equal(one, other)
