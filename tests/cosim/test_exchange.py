"""The exchange rule: what each component reads at which instant, for every combination of rates."""

import itertools
import math

import numpy as np
import pytest
from probes import INITIAL, Clock, Delta, DiscreteProbe, Integrator, Moore, Probe

from cosim import LoopError, PythonComponent, Record, System

STEPS = (1, 2, 3, 5)
PAIRS = list(itertools.product(STEPS, STEPS))
END = 60  # ms, a multiple of all steps
pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning", "ignore::cosim.AlgebraicLoopWarning")


def ms(value):
    return f"{value} ms"


def shown(kind, step, offset, t, ahead=False):
    """What a probe of this kind shows at t [ms]."""
    if t < offset:
        return INITIAL
    begin = offset + (t - offset) // step * step
    if kind == "discrete":
        return begin
    if ahead:
        return begin + step
    return begin if begin > offset else INITIAL


def probe(kind):
    return DiscreteProbe() if kind == "discrete" else Probe()


@pytest.mark.parametrize("target_kind", ["discrete", "continuous"])
@pytest.mark.parametrize("source_kind", ["discrete", "continuous"])
@pytest.mark.parametrize(("source_step", "target_step"), PAIRS)
def test_values_arrive_at_exact_instants(source_kind, target_kind, source_step, target_step):
    for source_offset, target_offset in itertools.product((0, 1, 4), (0, 2, 3)):
        target = probe(target_kind)
        system = System()
        system.add("target", target, step=ms(target_step), offset=ms(target_offset))
        system.add("source", probe(source_kind), step=ms(source_step), offset=ms(source_offset))
        system.connect("source.y", "target.u")
        system.run(ms(END))
        last = END + (target_kind == "discrete")  # runs at the stop time, too
        expected = [
            (t, shown(source_kind, source_step, source_offset, t)) for t in range(target_offset, last, target_step)
        ]
        assert system["target"].implementation.log == expected


@pytest.mark.parametrize(("first_step", "second_step"), PAIRS)
def test_gauss_seidel_sees_members_before_it_ahead(first_step, second_step):
    for first_offset, second_offset in itertools.product((0, 1), (0, 2)):
        first, second = Probe(), Probe()
        system = System()
        system.add("a", second, step=ms(second_step), offset=ms(second_offset))
        system.add("b", first, step=ms(first_step), offset=ms(first_offset))
        system.connect("b.y", "a.u")
        system.connect("a.y", "b.u")
        system.group("pair", ["b", "a"], "gauss-seidel")
        system.run(ms(END))
        assert system["a"].implementation.log == [
            (t, shown("continuous", first_step, first_offset, t, ahead=True))
            for t in range(second_offset, END, second_step)
        ]
        assert system["b"].implementation.log == [
            (t, shown("continuous", second_step, second_offset, t)) for t in range(first_offset, END, first_step)
        ]


@pytest.mark.parametrize(("source_step", "target_step"), PAIRS)
@pytest.mark.parametrize("kind", ["discrete", "continuous"])
def test_delay_is_one_step_of_the_source(kind, source_step, target_step):
    target = DiscreteProbe()
    system = System()
    system.add("target", target, step=ms(target_step))
    system.add("source", probe(kind), step=ms(source_step))
    system.connect("source.y", "target.u", delay=True)
    system.run(ms(END))

    def before(t):
        latest = t // source_step * source_step
        first = 0 if kind == "discrete" else source_step
        return latest - source_step if latest - source_step >= first else INITIAL

    assert system["target"].implementation.log == [(t, before(t)) for t in range(0, END + 1, target_step)]


def test_discrete_chain_has_no_lag_and_does_not_depend_on_the_order_of_adding():
    results = []
    for order in itertools.permutations(["c", "a", "b", "plant"]):
        system = System()
        for name in order:
            system.add(name, Integrator() if name == "plant" else Delta(), step="1 ms")
        for source, target in (("a.y", "b.u"), ("b.y", "c.u"), ("c.y", "plant.u"), ("plant.y", "a.u")):
            system.connect(source, target)
        results.append(system.run(0.02))
    first = results[0]
    np.testing.assert_array_equal(first["c.y"], first["plant.y"] + 1 + 1 + 1)
    for other in results[1:]:
        for name in first.names:
            np.testing.assert_array_equal(other[name], first[name])


def test_recording_shows_plant_and_controller_at_the_same_instant():
    system = System()
    system.add("control", Delta(), step=0.1)
    system.add("plant", Integrator(), step=0.1)
    system.connect("plant.y", "control.u")
    system.connect("control.y", "plant.u")
    result = system.run(0.3)
    np.testing.assert_allclose(result.time, [0, 0.1, 0.2, 0.3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(result["plant.y"], [0, 0.1, 0.21, 0.331])
    np.testing.assert_allclose(result["control.y"], [1, 1.1, 1.21, 1.331])


def test_a_loop_of_discrete_components_is_refused_by_name():
    system = System()
    for name in "abc":
        system.add(name, Delta(), step="1 ms")
    system.connect("a.y", "b.u")
    system.connect("b.y", "c.u")
    system.connect("c.y", "a.u")
    with pytest.raises(LoopError) as error:
        system.run(0.01)
    text = str(error.value)
    assert text.index("a.y -> b.u") < text.index("b.y -> c.u") < text.index("c.y -> a.u")
    assert "delay=True" in text


def test_a_delay_opens_the_loop_where_it_is_put():
    system = System()
    system.add("b", Delta(), step="1 ms")
    system.add("a", Delta(), step="1 ms")
    system.connect("a.y", "b.u")
    system.connect("b.y", "a.u", delay=True)
    result = system.run(0.004)
    np.testing.assert_array_equal(result["a.y"], [1, 3, 5, 7, 9])
    np.testing.assert_array_equal(result["b.y"], [2, 4, 6, 8, 10])


def test_a_loop_without_feed_through_runs_and_the_schedule_says_who_lags():
    system = System()
    system.add("b", Delta(), step="1 ms")
    system.add("a", Moore(), step="1 ms")
    system.connect("a.y", "b.u")
    system.connect("b.y", "a.u")
    schedule = system.schedule()
    assert [m.name for m in schedule.discrete] == ["a", "b"]
    assert [str(c) for c in schedule.lagging] == ["b.y -> a.u"]
    assert "see the sample before" in str(schedule)


def test_a_component_may_not_wait_for_itself():
    system = System()
    system.add("a", Delta(), step="1 ms")
    system.connect("a.y", "a.u")
    with pytest.raises(LoopError, match=r"a\.y -> a\.u"):
        system.schedule()


class Ramp(PythonComponent):
    """y = t at the end of each step."""

    outputs = ("y",)

    def step(self, t, h, u, y):  # noqa: ARG002
        y[0] = t + h


@pytest.mark.parametrize(("source_step", "target_step"), [(1, 1), (4, 1), (1, 4), (3, 2)])
def test_extrapolation_aims_at_the_middle_of_the_step(source_step, target_step):
    target = Probe()
    system = System()
    system.add("ramp", Ramp(), step=f"{source_step} s")
    system.add("target", target, step=f"{target_step} s")
    system.connect("ramp.y", "target.u", extrapolate=True)
    system.run(30)
    for t, value in system["target"].implementation.log:
        if t >= 1000 * 2 * source_step:  # two values of the source are there
            assert value == t + 500 * target_step


@pytest.mark.parametrize(("source_step", "target_step"), [(1, 1), (4, 1), (1, 4)])
def test_a_source_ahead_in_the_group_is_interpolated(source_step, target_step):
    """Gauss-Seidel: the target sees the source in the middle of the target's step, from the very first step on."""
    target = Probe()
    system = System()
    system.add("ramp", Ramp(), step=f"{source_step} s")
    system.add("target", target, step=f"{target_step} s")
    system.connect("ramp.y", "target.u", extrapolate=True)
    system.group("g", ["ramp", "target"])
    system.run(30)
    assert system["target"].implementation.log
    for t, value in system["target"].implementation.log:
        if source_step >= target_step or t > 0:  # a faster source has two values then
            assert value == t + 500 * target_step


def test_oscillation_between_two_components_converges_with_the_square_of_the_step():
    """A mass and a spring as two components, mass first: plain exchange is of first order, extrapolated of second."""

    class Mass(PythonComponent):
        inputs, outputs = ("f",), ("v",)

        def step(self, t, h, u, y):  # noqa: ARG002
            y[0] += h * u[0]

    class Spring(PythonComponent):
        inputs, outputs = ("v",), ("f",)

        def start(self, u, y):  # noqa: ARG002
            y[0] = 1.0

        def step(self, t, h, u, y):  # noqa: ARG002
            y[0] -= h * u[0]

    def error(steps, extrapolate):
        system = System()
        for name, component in (("mass", Mass()), ("spring", Spring())):
            system.add(name, component, step=f"1/{steps}")
        system.connect("spring.f", "mass.f", extrapolate=extrapolate)
        system.connect("mass.v", "spring.v", extrapolate=extrapolate)
        system.group("g", ["mass", "spring"])
        return abs(system.run(3)["spring.f"][-1] - math.cos(3.0))

    for extrapolate, order in ((False, 1), (True, 2)):
        assert math.log2(error(100, extrapolate) / error(200, extrapolate)) == pytest.approx(order, abs=0.15)


def test_group_extrapolates_its_continuous_inputs():
    system = System()
    system.add("ramp", Ramp(), step=1)
    system.add("target", Probe(), step=1)
    system.connect("ramp.y", "target.u")
    system.group("g", ["target"], "jacobi", extrapolate=True)
    assert system.connections["target.u"].extrapolate
    assert "extrapolated" in str(system.schedule())


@pytest.mark.parametrize(("step", "stop"), [("1 ms", "1000"), ("1/60", "50000/3")])
def test_a_million_steps_end_exactly(step, stop):
    system = System()
    counter = system.add("clock", Clock(), step=step)
    system.run(stop, record=Record(["clock.y"], "1000/6" if step == "1/60" else 1))
    simulation = system._simulation
    exchange = simulation._exchange
    assert exchange.tick == 10**6
    assert exchange.base.exact(exchange.tick) == 10**6 * counter.step
    assert simulation.recording["clock.y"][-1] == float(counter.step * 10**6)
    assert simulation.time == float(10**6 * counter.step)


def test_rates_without_a_short_common_period():
    fast, slow = DiscreteProbe(), DiscreteProbe()
    system = System()
    system.add("fast", fast, step="1 ms")
    system.add("slow", slow, step="1000001 us")
    system.connect("fast.y", "slow.u")
    system.run(5, record=Record([], 1))
    assert [u for _, u in system["slow"].implementation.log] == [0, 1000, 2000, 3000, 4000]
    assert len(system["fast"].implementation.log) == 5001


def test_schedule_can_be_read():
    system = System()
    system.add("control", Delta(), step="10 ms")
    system.add("car", Probe(), step="1/60", offset="5 ms")
    system.add("valve", Probe(), step="1 ms")
    system.group("stiff", ["car", "valve"])
    text = str(system.schedule())
    assert "control (Delta) every 0.01 s" in text
    assert "car (Probe) every 1/60 s from 0.005 s" in text
    assert "Gauss-Seidel 'stiff'" in text
    assert "base tick 1/3000 s" in text
    assert "valve.u" in text.split("Unconnected")[1]


def test_factors_may_be_whole_numbers():
    """A factor and an offset without decimal places mean the same as with them."""
    seen = []
    for linear in ((3, 1), (3.0, 1.0)):
        system = System()
        system.add("source", Clock(), step="1 ms")
        system.add("target", Probe(), step="1 ms")
        system.connect("source.y", "target.u", linear=linear)
        system.run("5 ms")
        seen.append(system["target"].implementation.log)
    assert seen[0] == [(t, 3 * t + 1000) for t in range(5)]
    assert seen[1] == seen[0]


def test_slots_of_a_python_component_have_one_order():
    """Not that of hashes: the errors of a run with a tolerance are compared in it."""
    names = [f"y{i}" for i in range(9)]

    class Many(PythonComponent):
        outputs = names

    with System() as system:
        system.add("m", Many(), step="1 ms")
        with system.initialize(record=[f"m.{n}" for n in reversed(names)]) as simulation:
            assert [v.name for _, v in simulation.exchange.layout.visible] == names
