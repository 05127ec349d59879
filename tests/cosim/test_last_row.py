"""The last row of `System.run` is, bit for bit, the row that a longer run has at that time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from probes import Clock, Delta, DiscreteProbe, Integrator
from random_systems import systems, wired
from same import bits

from cosim import ComponentError, LoopError, PythonComponent, Record, StopWhen, System

pytestmark = pytest.mark.filterwarnings(
    "ignore::cosim.UnconnectedInputsWarning",
    "ignore::cosim.AlgebraicLoopWarning",
    "ignore:initial values do not settle",
)


def assert_rows_of_a_longer_run(system: System, stop: float, longer: float, **options: Any) -> None:
    one, other = (system.run(until, **options) for until in (stop, longer))
    assert one.time[-1] == stop < other.time[-1]
    np.testing.assert_array_equal(bits(one.time), bits(other.time[: len(one)]))
    np.testing.assert_array_equal(bits(one.data), bits(other.data[: len(one)]))


class Filter(PythonComponent):
    """A discrete component in Python."""

    kind = "discrete"
    inputs = ("z [m]",)
    outputs = ("low [m]",)

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] += 0.25 * (u[0] - y[0])


@pytest.mark.parametrize("isolated", [False, True])
@pytest.mark.parametrize("fmi", [2, 3])
def test_a_car_with_components_of_four_rates(built_fmus, fmi, isolated):
    """Discrete FMUs that refuse a step beyond the stop time that they are told, one of which the road depends on."""
    system = System()
    for name, fmu, step in (
        ("road", "RoadSine", "2 ms"),
        ("car", "FullCarHmmwvModified", "1 ms"),
        ("law", "GpcPreview", None),
    ):
        system.add(name, built_fmus.path(fmu, fmi), step=step, isolated=isolated)
    system.add("filter", Filter(), step="5 ms")
    system.connect_matching("road", "car", "road.*")
    system.connect("car.x", "road.x")
    system.connect_matching("car", "law", "body.*")
    system.connect_matching("law", "car", "force.*")
    system.connect("car.body.z", "filter.z")
    with system:
        record = ["car.*", "law.*", "road.*", "filter.*"]
        assert_rows_of_a_longer_run(system, 0.5, 1.5, record=Record(record, "1 ms"))


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(plan=systems(), tenths=st.integers(0, 9))
def test_random_systems(plan, tenths, follower):
    """FMI 2.0, FMI 3.0 and Python, with delays and offsets, to a tick at which many or few components are due."""
    with wired(plan, follower) as system:
        try:
            tick = system.schedule().tick
        except LoopError:
            return
        every = [
            f"{m}.{v}" for m in system.components for v in system.components[m].description.outputs if "[" not in v
        ]
        step = max(m.step for m in system.components.values())
        stop = (2 * step + tenths * step / 10) // tick * tick
        interval = min(m.step for m in system.components.values())
        one, other = (system.run(until, record=Record(every, interval)) for until in (stop, stop + step))
        np.testing.assert_array_equal(bits(one.data), bits(other.data[: len(one)]))


def loop() -> System:
    system = System()
    system.add("control", Delta(), step="3 ms")
    system.add("plant", Integrator(), step="2 ms", parameters={"gain": 5.0})
    system.connect("plant.y", "control.u")
    system.connect("control.y", "plant.u")
    return system


@pytest.mark.parametrize("stop", [0, 0.001, 0.002, 0.003, 0.004, 0.006])
def test_any_stop_time(stop):
    """Also the start time, and times at which nothing is due."""
    assert_rows_of_a_longer_run(loop(), stop, 1, record=Record(interval="1 ms"))


def test_a_run_from_a_saved_state():
    system = loop()
    for stop in (0.006, 0.007):  # the controller is due, or not
        simulation = system.initialize(record=Record(interval="1 ms"))
        simulation.advance(stop)
        state = simulation.save()
        here = system.run(stop, record=Record(interval="1 ms"), state=state)
        whole = loop().run(1, record=Record(interval="1 ms"))
        np.testing.assert_array_equal(bits(here.data[0]), bits(whole.data[whole.time == stop][0]))


def test_final_advance_is_continued_with_the_bits_of_one_run():
    """Nothing is done twice: neither steps nor rows."""
    system = System()
    system.add("probe", DiscreteProbe(), step="3 ms")
    system.add("plant", Integrator(), step="2 ms")
    system.connect("plant.y", "probe.u")
    whole = system.run("12 ms", record=Record(interval="1 ms"))
    simulation = system.initialize(record=Record(interval="1 ms"))
    for ms in (0, 3, 3, 4, 6, 12, 12):
        simulation.advance(f"{ms} ms", final=True)
        np.testing.assert_array_equal(bits(simulation.recording.data), bits(whole.data[: ms + 1]))
    assert [t for t, _ in system["probe"].implementation.log] == [0, 3, 6, 9, 12]


def test_advance_leaves_the_last_row_provisional():
    with loop() as system:
        simulation = system.initialize(record=Record(["control.y"], "1 ms"))
        simulation.advance("6 ms")
        before = simulation.recording["control.y"]
        assert before[-1] == before[-2]
        simulation.advance("7 ms")
        after = simulation.recording["control.y"]
        assert after[6] == after[7] != before[6]


def test_a_condition_that_holds_in_the_last_row_stops_the_run():
    system = System()
    system.add("clock", Clock(), step="1 ms")
    found = [system.run(until, stop_when=[StopWhen("clock.y", ">=", 0.005)]) for until in ("5 ms", "9 ms")]
    assert [f.stopped_by for f in found] == ["clock.y >= 0.005"] * 2
    np.testing.assert_array_equal(bits(found[0].data), bits(found[1].data))


class Fails(Clock):
    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        super().step(t, h, u, y)
        if t >= 0.005:
            raise ValueError("no value here")


def test_a_failure_at_the_stop_time_is_that_of_a_longer_run(raises):
    system = System()
    system.add("clock", Fails(), step="1 ms")
    found = []
    for until in ("5 ms", "9 ms"):
        with raises(ComponentError) as error:
            system.run(until)
        found.append((error.value.time, str(error.value), error.value.recording.data.tobytes()))
    assert found[0] == found[1]
