"""Curves thinned for drawing keep what a reader looks for."""

import numpy as np
import pytest

from cosim.report import keep_peaks


def test_an_impact_of_one_sample_survives():
    t = np.arange(40_000) / 2000
    y = np.sin(t)
    y[12_345] = 114.6
    x, kept = keep_peaks(t, y, 500)
    assert len(x) == len(kept) <= 500
    assert kept.max() == 114.6
    assert x[np.argmax(kept)] == t[12_345]
    assert kept.min() == y.min()
    assert y[::40].max() < 2  # what every fortieth sample shows


def test_order_ends_and_short_curves():
    t = np.linspace(0, 1, 1001)
    x, y = keep_peaks(t, -t, 100)
    assert (np.diff(x) > 0).all()
    assert (x[0], x[-1], y[-1]) == (0, 1, -1)
    np.testing.assert_array_equal(keep_peaks(t[:50], t[:50], 100)[0], t[:50])


def test_gaps_stay_gaps():
    y = np.concatenate([np.ones(1000), np.full(1000, np.nan), np.ones(1000)])
    x, kept = keep_peaks(np.arange(3000.0), y, 60)
    assert np.isnan(kept[(x > 1100) & (x < 1900)]).all()
    assert np.isfinite(kept[(x < 900) | (x > 2100)]).all()


@pytest.mark.parametrize(("x", "y", "points"), [([0, 1], [0], 10), ([[0]], [[0]], 10), ([0, 1], [0, 1], 3)])
def test_bad_curves_are_refused(x, y, points, raises):
    with raises(ValueError):
        keep_peaks(x, y, points)
