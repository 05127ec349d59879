"""The preview chain of paper 001 in closed loop, from the built FMUs."""

import dataclasses

import numpy as np
import pytest

from cosim import LoopError
from cosim.experiments.hmmwv.preview import EXPERIMENT  # noqa: F401 (of the fixture `runner`)
from cosim.experiments.hmmwv.preview.published import FED, PRINTED, PRINTED_FED, RELATIVE, TWICE, generated, long, over
from cosim.experiments.hmmwv.preview.runs import BUMP_LENGTH, Case, signals, wire
from cosim.study import Runner


def arrays(runner: Runner, case: Case) -> dict[str, np.ndarray]:
    """Signals of a run."""
    return {name: np.array(values) for name, values in signals(runner.run(case)).items()}


@pytest.fixture(scope="module")
def small(runner):
    """Metrics of runs over a bump of 30 mm without noise."""
    return {c: runner.metrics(over(c, 30.0)) for c in (PRINTED, RELATIVE, FED)}


def test_road_fed_to_the_filter_leaves_no_dip(runner, small):
    """Issue: at most 1 mm behind a bump of 30 mm, nothing but the response and spot of the radar in the way."""
    assert small[FED]["lowest"] >= -1e-3
    assert small[FED]["highest"] <= 1e-3
    top = arrays(runner, FED)["buffered"].max()
    assert 0.6 * 0.030 < top < 0.030


def test_a_flat_road_assumed_makes_a_dip(runner, small):
    """As published: behind 76 mm some 30 to 40 mm on linear tires, more on tires that lift off."""
    assert small[PRINTED]["lowest"] < -8e-3
    assert -0.06 < runner.metrics(over(PRINTED, 76.0))["lowest"] < -0.025


def test_quarter_cars_on_top_count_twice(runner, small):
    """Outside a filter that follows the body already, they raise a road that is not there."""
    assert small[RELATIVE]["highest"] < 1e-3
    assert runner.metrics(over(TWICE, 30.0))["highest"] > 8e-3


def test_loop_is_stable_only_with_the_slow_pose(runner):
    """Noise for 10 s, with the road fed back.

    The filter of absolute states runs away, that of relative states does not.
    """
    wild, tame = (runner.metrics(dataclasses.replace(long(c), duration=10.0))["spread"] for c in (PRINTED_FED, FED))
    assert wild[1] > 2 * wild[0]
    assert max(tame) < 0.03


def test_a_sensor_that_fails_is_flagged_and_the_run_goes_on(runner):
    row = arrays(runner, dataclasses.replace(FED, noise=1.0, dropout_start=1.2, dropout=0.2))
    t, valid, road = (row[n] for n in ("time", "preview valid", "road valid"))
    lost = (t >= 1.2) & (t < 1.4)
    assert not row["range valid"][lost].any()
    assert len(set(row["range"][lost])) == 1
    assert valid[(t > 0.7) & (t < 1.195)].all()
    assert not valid[lost].any()
    assert valid[t > 2.1].all()
    assert road[t < 1.35].max() == 1
    assert not road.all()
    assert np.isfinite(row["buffered"]).all()
    assert np.abs(row["buffered"]).max() < 0.05


def test_the_optical_sensor_works_too(runner):
    """It sees 1.2 m ahead of the front axle, sharply: the buffer averages over the contact of the tire."""
    system = runner.system(FED)
    system["sensors"].set({"range.sensor": 1})
    system["buffer"].set({"contact.length": 0.25})
    try:
        row = arrays(runner, FED)
        assert row["range valid"].all()
        assert row["buffered"].max() == pytest.approx(row["true"].max(), rel=0.1)
        measured = runner.metrics(FED)
        assert measured["lowest"] > -1.5e-3
        assert measured["resolution"] == 0.0  # as set for a run without noise
        assert measured["ahead"] == pytest.approx(1.2, abs=0.05)
    finally:
        system["sensors"].set({"range.sensor": 0})
        system["buffer"].set({"contact.length": 0.0})


def test_generated_preview(runner):
    """Loads peak near the crests.

    A speedometer that shows too much moves the prediction ahead, more with every meter.
    """
    exact, wrong = (runner.metrics(generated(e))["offsets"] for e in (0.0, 2.0))
    assert np.abs(exact).max() < BUMP_LENGTH
    drift = np.subtract(wrong, exact)
    assert drift == pytest.approx([0.02 * 8.5, 0.02 * 14.5], abs=0.05)


def test_without_delay_the_loop_is_refused(fmus):
    with wire(fmus, FED) as system:
        system.disconnect("kalman.road.*")
        system.connect_matching("buffer", "kalman", "road.*")
        with pytest.raises(LoopError, match="kalman"):
            system.schedule()
