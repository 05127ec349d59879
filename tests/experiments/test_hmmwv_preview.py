"""The preview chain of paper 001 in closed loop, from the built FMUs."""

import dataclasses

import numpy as np
import pytest
from hmmwv_made_up import made_up_preview

from cosim import LoopError
from cosim.experiments import hmmwv_preview as hp
from cosim.experiments.cases import CaseError
from cosim.experiments.hmmwv_preview import COMPENSATED, FED, PRINTED, PRINTED_FED, RELATIVE, Chain, PreviewBench
from cosim.report import Report


@pytest.fixture(scope="module")
def bench(fmus):
    bench = PreviewBench(fmus)
    yield bench
    bench.close()


def over(chain, height, **changes):
    return dataclasses.replace(chain, bumps=((1, height),), **changes)


@pytest.fixture(scope="module")
def small(bench):
    """Runs over a bump of 30 mm without noise."""
    return {c: bench.row(over(c, 0.030)) for c in (PRINTED, RELATIVE, FED)}


def test_road_fed_to_the_filter_leaves_no_dip(small):
    """Issue: at most 1 mm behind a bump of 30 mm, nothing but the response and spot of the radar in the way."""
    lowest, highest = hp.behind(small[FED])
    assert lowest >= -1e-3
    assert highest <= 1e-3
    top = max(small[FED]["buffered"])
    assert 0.6 * 0.030 < top < 0.030


def test_a_flat_road_believed_makes_a_dip(bench, small):
    """As published: behind 76 mm some 30 to 40 mm on linear tyres, more on tyres that lift off."""
    assert hp.behind(small[PRINTED])[0] < -8e-3
    assert -0.06 < hp.behind(bench.row(over(PRINTED, 0.076)))[0] < -0.025


def test_quarter_cars_on_top_count_twice(bench, small):
    """Outside a filter that follows the body already, they raise a road that is not there."""
    double = bench.row(over(Chain("relative", use_road=False, compensation=True), 0.030))
    assert hp.behind(small[RELATIVE])[1] < 1e-3
    assert hp.behind(double)[1] > 8e-3


def test_loop_is_stable_only_with_the_slow_pose(bench):
    """Noise for 10 s: the filter of absolute states with the road fed back runs away, that of relative states does not."""
    wild, tame = (hp.spread(bench.row(over(c, 0.030, noise=1.0, duration=10.0))) for c in (PRINTED_FED, FED))
    assert wild[1] > 2 * wild[0]
    assert max(tame) < 0.03


def test_a_sensor_that_fails_is_flagged_and_the_run_goes_on(bench):
    row = bench.row(over(FED, 0.030, noise=1.0, duration=2.6, dropout=(1.2, 0.2)))
    t, valid, road = (np.array(row[n]) for n in ("t", "preview valid", "road valid"))
    lost = (t >= 1.2) & (t < 1.4)
    assert not np.array(row["range valid"])[lost].any()
    assert len(set(np.array(row["range"])[lost])) == 1
    assert valid[(t > 0.7) & (t < 1.195)].all()
    assert not valid[lost].any()
    assert valid[t > 2.1].all()
    assert road[t < 1.35].max() == 1
    assert not road.all()
    assert np.isfinite(row["buffered"]).all()
    assert np.abs(row["buffered"]).max() < 0.05


def test_the_optical_sensor_works_too(bench):
    """It sees 1.2 m ahead of the front axle, sharply: the buffer averages over the contact of the tyre."""
    bench.row(over(FED, 0.030))  # makes the system
    system = bench._systems["relative"]
    system["sensors"].set({"range.sensor": 1})
    system["buffer"].set({"contact.length": 0.25})
    try:
        row = bench.row(over(FED, 0.030))
        assert all(row["range valid"])
        assert max(row["buffered"]) == pytest.approx(max(row["true"]), rel=0.1)
        assert hp.behind(row)[0] > -1.5e-3
    finally:
        system["sensors"].set({"range.sensor": 0})
        system["buffer"].set({"contact.length": 0.0})


def test_generated_preview(bench):
    """Loads peak near the crests; a speedometer that shows too much moves the prediction ahead, more with every metre."""
    exact, wrong = (hp.offsets(bench.generated(e)) for e in (0.0, 0.02))
    assert np.abs(exact).max() < hp.BUMP_LENGTH
    drift = np.subtract(wrong, exact)
    assert drift == pytest.approx([0.02 * 8.5, 0.02 * 14.5], abs=0.05)


def test_without_delay_the_loop_is_refused(fmus):
    with hp.wire(fmus, "KalmanHmmwv") as system:
        system.disconnect("kalman.road.*")
        system.connect_matching("buffer", "kalman", "road.*")
        with pytest.raises(LoopError, match="kalman"):
            system.schedule()


def test_unknown_filter():
    with pytest.raises(CaseError, match="did you mean relative"):
        Chain("relativ")


def test_report(small):
    """Every part of the report can be made from few runs."""
    study = made_up_preview(small[FED])
    report = Report(experiment="x", title="x", lead="x", claims=hp.claims(study), sections=hp.sections(study))
    assert len(report.claims) == 7
    verdicts = {c.id: c.verdict for c in report.claims}
    assert verdicts["preview-dip"] == "not reproduced", "no dip in these rows"
    assert {f.id for f in report.figures} == {"preview-generated", "preview-chain", "preview-dropout"}
    assert COMPENSATED.label in [row[0] for t in report.tables for row in t.rows]
