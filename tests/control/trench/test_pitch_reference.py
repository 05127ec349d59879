"""Pitch reference of paper 003: ramps, hold and preview."""

import numpy as np
import pytest

from fmu_sources.controllers.trench.pitch_reference import pitch_reference


@pytest.fixture(scope="module")
def reference():
    return pitch_reference().model()


def at(reference, time, **parameters):
    p = reference.vector("parameter")
    names = [e.name for e in reference.elements("parameter")]
    for name, value in parameters.items():
        p[names.index(name.replace("__", "."))] = value
    return np.asarray(reference.functions["out"](time, [], [], p)).ravel()


def test_ramp_hold_and_return(reference):
    """0 to 3 degrees from 15 to 17 s, held to 22 s, back by 24 s."""
    times = np.array([0.0, 14.9, 15.0, 15.5, 16.0, 17.0, 19.0, 22.0, 23.0, 24.0, 30.0, 1e6])
    now = [np.degrees(at(reference, t)[0]) for t in times]
    assert now == pytest.approx([0, 0, 0, 0.75, 1.5, 3, 3, 3, 1.5, 0, 0, 0], abs=1e-9)


def test_the_preview_is_what_comes(reference):
    for t in (14.9, 15.0, 16.333, 21.9, 23.9):
        ahead = at(reference, t)
        assert len(ahead) == 50
        assert ahead == pytest.approx([at(reference, t + 5e-3 * i)[0] for i in range(50)], abs=1e-12)


def test_steps_where_durations_are_zero(reference):
    step = {"pitch": 0.1, "ramp__start": 1.0, "ramp__duration": 0.0, "hold__duration": 2.0, "return__duration": 0.0}
    assert [at(reference, t, **step)[0] for t in (0.0, 0.999, 1.0, 2.999, 3.0, 4.0)] == [0, 0, 0.1, 0.1, 0, 0]
    start = {"pitch": -0.1, "ramp__start": 0.0, "ramp__duration": 0.0, "hold__duration": 1e6}
    assert list(at(reference, 0.0, **start)) == [-0.1] * 50


def test_between_rest_and_pitch(reference):
    times = (0.0, 16.0, 20.0, 23.5, 25.0)
    values = [at(reference, t, rest=0.02, pitch=-0.06)[0] for t in times]
    assert values == pytest.approx([0.02, -0.02, -0.06, 0.0, 0.02])
