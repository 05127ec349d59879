"""Runs that keep pace with the clock: when each instant begins, what counts as late, and that nothing else changes.

Times are those of a clock that the tests move; with the real one only what no busy machine can change is asserted.
"""

from __future__ import annotations

import awkward
import numpy as np
import pytest
from ctrl_c import ctrl_c
from probes import Clock, Integrator
from same import assert_same

from cosim import Execution, Interrupted, PythonComponent, Record, StopWhen, System, TimeError
from cosim.core import real_time
from cosim.recording.spool import Spool, read_spool

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning")


class FakeTime:
    """A clock that moves when somebody sleeps or looks at it, by `late` more than was asked for."""

    def __init__(self):
        self.now, self.late, self.naps = 1000.0, 0.0, []

    def perf_counter(self):
        self.now += 1e-9
        return self.now

    def sleep(self, seconds):
        self.naps.append(seconds)
        self.now += seconds + self.late


@pytest.fixture
def fake(monkeypatch):
    clock = FakeTime()
    monkeypatch.setattr(real_time, "time", clock)
    return clock


class Worker(PythonComponent):
    """Takes its time: `busy[k]` [s] of the clock in its step number k; remembers when its steps began."""

    kind = "discrete"
    outputs = ("y",)

    def __init__(self, clock, busy=()):
        super().__init__()
        self.clock, self.busy, self.began = clock, dict(busy), []

    def step(self, t, h, u, y):  # noqa: ARG002
        self.began.append(self.clock.now - 1000.0)
        self.clock.now += self.busy.get(len(self.began) - 1, 0.0)
        y[0] = t


def working(clock, busy=(), step="10 ms"):
    system = System()
    system.add("worker", lambda: Worker(clock, busy), step=step)  # which moves this clock, not a copy
    return system


def test_every_instant_begins_when_it_is_due(fake):
    system = working(fake)
    recording = system.run(0.1, execution=Execution(real_time=1.0))
    np.testing.assert_allclose(system["worker"].implementation.began, np.arange(11) * 0.01, atol=1e-6)
    assert fake.now - 1000.0 == pytest.approx(0.1, abs=1e-6)
    kept = recording.real_time
    assert (kept.factor, kept.instants, kept.overruns) == (1.0, 10, 0)
    assert kept.lateness[0] == 10
    assert kept.within(1e-5) == 1.0


@pytest.mark.parametrize("factor", [0.5, 2.0, 1000.0])
def test_faster_and_slower_than_the_clock(fake, factor):
    system = working(fake)
    system.run(0.1, execution=Execution(real_time=factor))
    np.testing.assert_allclose(system["worker"].implementation.began, np.arange(11) * 0.01 / factor, atol=1e-5)


def test_what_comes_late_is_caught_up_with_and_nothing_is_left_out(fake):
    """The third step takes 35 ms: the three after it are due before it ends; then all is as if nothing had been."""
    system = working(fake, {2: 0.035})
    recording = system.run(0.1, execution=Execution(real_time=1.0))
    expected = [0, 0.01, 0.02, 0.055, 0.055, 0.055, 0.06, 0.07, 0.08, 0.09, 0.1]
    np.testing.assert_allclose(system["worker"].implementation.began, expected, atol=1e-6)
    np.testing.assert_array_equal(recording.time, np.arange(11) / 100)
    kept = recording.real_time
    assert (kept.instants, kept.overruns) == (10, 3)
    assert kept.worst == pytest.approx(0.025, abs=1e-6)
    late = dict(zip([*real_time.EDGES, None], kept.lateness, strict=True))
    assert {edge: n for edge, n in late.items() if n} == {1e-5: 7, 1e-2: 1, 1e-1: 2}
    assert str(kept).splitlines()[0] == "1 times real time: 10 instants, 3 overruns, the latest 25 ms late"


def test_sleeps_that_end_late_are_no_overruns_and_do_not_add_up(fake):
    fake.late = 0.0007
    system = working(fake)
    kept = system.run(1.0, execution=Execution(real_time=1.0)).real_time
    assert kept.overruns == 0
    assert kept.worst == pytest.approx(0.0005, abs=2e-5)  # less what is spun through
    np.testing.assert_allclose(system["worker"].implementation.began, np.arange(101) * 0.01, atol=6e-4)


def test_naps_are_short_and_the_last_stretch_is_spun_through(fake):
    working(fake, step=1).run(2, execution=Execution(real_time=1.0))
    assert max(fake.naps) <= real_time.NAP <= 0.05
    assert sum(fake.naps) == pytest.approx(2 - 2 * real_time.SPIN, abs=1e-4)


def test_stepping_by_hand_keeps_the_first_beginning(fake):
    """What the caller does between two calls takes its time from the next wait, and does not delay what follows."""
    system = working(fake)
    simulation = system.initialize()
    for k in range(1, 6):
        simulation.advance(k * 0.01, real_time=1.0)
        assert fake.now - 1000.0 == pytest.approx(k * 0.01, abs=1e-6)
        fake.now += 0.004
    fake.now += 0.03
    simulation.advance(0.1, real_time=1.0)
    assert fake.now - 1000.0 == pytest.approx(0.1, abs=1e-6)
    assert simulation.recording.real_time.overruns == 3
    fake.now += 100.0  # somebody thinks
    state = simulation.save()
    simulation.advance(0.11)  # without a pace: the next one begins anew
    simulation.advance(0.12, real_time=1.0)
    assert simulation.recording.real_time.overruns == 3
    assert simulation.recording.real_time.instants == 11
    simulation.restore(state)
    simulation.advance(0.12, real_time=1.0)
    assert simulation.recording.real_time.overruns == 3
    simulation.advance(0.13, real_time=2.0)
    assert (simulation.recording.real_time.factor, simulation.recording.real_time.instants) == (2.0, 1)


def test_the_numbers_are_those_of_a_run_without_pace(awkward_fmus, tmp_path, monkeypatch):
    """Real clock, twenty times as fast. With a stop condition, a spool, a progress bar, offsets and several rates."""
    monkeypatch.setattr(Spool, "EVERY", 0.0)
    monkeypatch.setattr("cosim.engine.progress.ProgressBar.PATIENCE", 0.0)
    monkeypatch.setattr("cosim.engine.simulation._SHOWN", 0.0)
    with System() as system:
        system.add("plant", awkward_fmus[3], step="5 ms", parameters={"trouble": awkward.NONE, "at": 9.0, "value": 0.0})
        system.add("fast", Integrator(), step="2 ms", offset="1 ms", start={"u": 1.0})
        system.add("clock", Clock(), step="1/60")
        options = {"record": Record(interval="3 ms"), "stop_when": [StopWhen("fast.y", ">", 0.5)]}
        whole = system.run(1.0, **options)
        paced = system.run(
            1.0, **options, execution=Execution(real_time=20.0), progress=True, output=tmp_path / "a.csv"
        )
        assert_same(paced, whole)
        assert paced.stopped_by == "fast.y > 0.5"
        assert paced.wall_time >= (paced.time[-1] - 1e-9) / 20
        assert (whole.real_time, paced.real_time.factor) == (None, 20.0)
        unpaced = (tmp_path / "b.csv", system.run(1.0, **options, output=tmp_path / "b.csv"))[0]
        assert (tmp_path / "a.csv").read_bytes() == unpaced.read_bytes()
        with system.initialize(record=Record(interval="3 ms")) as simulation:
            spool = Spool(tmp_path / "c.csv.part", simulation.recording.names, simulation.recording.units)
            simulation.spool(spool)
            simulation.advance(0.2, real_time=50.0)
            assert len(read_spool(spool.path)) > 50


@pytest.mark.parametrize("trouble", [awkward.END, awkward.END_EARLY])
def test_a_component_that_asks_for_the_end_is_heard(awkward_fmus, trouble):
    with System() as system:
        system.add("plant", awkward_fmus[3], parameters={"trouble": trouble, "at": 0.3, "value": 0.0})
        system.add("fast", Integrator(), step="10 ms", start={"u": 1.0})
        whole = system.run(1)
        assert "asked to end" in whole.stopped_by
        assert_same(system.run(1, execution=Execution(real_time=50.0)), whole)


def test_ctrl_c_while_it_waits(awkward_fmus):
    """The next instant is due in ten seconds."""
    with System() as system:
        system.add("plant", awkward_fmus[2], step="10 ms", parameters={"trouble": 0, "at": 9.0, "value": 0.0})
        whole = system.run(0.1)
        simulation = system.initialize()
        simulation.advance(0.03)
        with ctrl_c(), pytest.raises(Interrupted) as caught:
            simulation.advance(0.1, real_time=0.001)
        assert caught.value.time < 0.1
        simulation.advance(0.1)
        assert_same(simulation.recording, whole)


@pytest.mark.parametrize("wrong", [0, -1.0, float("nan"), float("inf"), "fast", True])
def test_a_pace_that_is_none(wrong, raises):
    system = System()
    system.add("clock", Clock(), step="1 ms")
    with raises(TimeError):
        system.run(0.01, execution=Execution(real_time=wrong))
