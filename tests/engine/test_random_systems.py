"""Random systems, run by the engine in pieces: bit-identical to the rule of exchange in plain Python."""

from __future__ import annotations

import math
import warnings
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import eventful, relay, sloped
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracles.exchange_rule import by_the_rule
from random_systems import SampledSaw, Saw, systems, wired
from same import assert_same, bits

from cosim import ComponentError, CosimError, LoopError, PythonComponent, Record, Recording, StopWhen, System

pytestmark = pytest.mark.filterwarnings(
    "ignore::cosim.UnconnectedInputsWarning",
    "ignore::cosim.AlgebraicLoopWarning",
    "ignore:initial values do not settle",
)
END = Fraction(12, 100)


def names(system: System) -> list[str]:
    outputs = [f"{m}.{v}" for m in system.components for v in system.components[m].description.outputs if "[" not in v]
    driven = [c.target_name for c in system.schedule().connections]
    return [*outputs, *(["m0.u"] if "m0.u" in driven else [])]


def conditions(plan: dict[str, Any]) -> list[StopWhen]:
    return [] if plan["stop"] is None else [StopWhen("m0.y", *plan["stop"])]


def run(plan: dict[str, Any], follower: dict[int, Path]) -> Recording:
    """In pieces, with a state saved at one cut and gone back to at the next."""
    stop = conditions(plan)
    with (
        wired(plan, follower) as system,
        system.initialize(record=Record(names(system), plan["interval"]), stop_time=END) as simulation,
    ):
        state = None
        for i, until in enumerate([*plan["cuts"], END]):
            if simulation.advance(until, stop_when=stop, final=until == END):
                break
            if i == plan["saved_at"]:
                state = simulation.save()
            elif state is not None:
                simulation.restore(state)
                state = None
                simulation.advance(until, stop_when=stop, final=until == END)
        return simulation.recording


@settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(plan=systems())
def test_the_engine_follows_the_rule(plan, follower):
    try:
        with wired(plan, follower) as system:
            system.schedule()
    except LoopError:
        return  # refused before anything runs
    found = run(plan, follower)
    with wired(plan, follower) as system:
        expected = by_the_rule(system, END, names(system), plan["interval"], conditions(plan))
    assert_same(found, expected)
    assert len(found)


class Mixer(PythonComponent):
    """A state, and an output that depends directly on both inputs, with a kink."""

    inputs = ("u", "v")
    outputs = ("y",)
    parameters = {"a": 0.5, "b": 0.5, "kink": 0.1}  # noqa: RUF012
    feedthrough = {"y": ("u", "v")}  # noqa: RUF012

    def begin(self) -> None:
        self.x = 0.1

    def start(self, u: Any, y: Any) -> None:
        y[0] = self.x + self.a * u[0] + self.b * np.sin(u[1]) + self.kink * abs(u[0] - u[1])

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        self.x += h * (np.sin(37.0 * t) - u[0])
        self.start(u, y)


class MixerOnGet(Mixer):
    computes_on_get = True


@settings(max_examples=40, deadline=None)
@given(
    kinds=st.lists(st.sampled_from([Mixer, MixerOnGet]), min_size=1, max_size=4),
    gains=st.lists(st.floats(-1.5, 1.5), min_size=8, max_size=8),
    wires=st.lists(st.integers(0, 5), min_size=8, max_size=8),
)
def test_the_engine_solves_loops_by_the_rule(kinds, gains, wires):
    """Components with direct feedthrough, wired at random to each other, a continuous source and a discrete one."""

    def made() -> System:
        system = System()
        for i, kind in enumerate(kinds):
            system.add(f"m{i}", kind(), step="2 ms", parameters={"a": gains[i], "b": gains[4 + i] / 2})
        system.add("x", SampledSaw(), step="4 ms")
        system.add("y", Saw(), step="1 ms")
        sources = [f"m{i}" for i in range(len(kinds))] + ["x", "y"]
        for k, wire in enumerate(wires[: 2 * len(kinds)]):
            system.connect(f"{sources[wire % len(sources)]}.y", f"m{k // 2}.{'uv'[k % 2]}", linear=(1.0, 0.0))
        system.connect("m0.y", "x.u", linear=(1.0, 0.0))
        return system

    recorded = [f"m{i}.y" for i in range(len(kinds))] + ["x.y"]
    try:
        with made() as system:
            whole = system.run(END, record=recorded)
    except ComponentError:
        return  # without a solution
    with made() as system, system.initialize(record=recorded, stop_time=END) as simulation:
        simulation.advance("50 ms")
        state = simulation.save()
        simulation.advance("71 ms")
        simulation.restore(state)
        simulation.advance(END, final=True)
        assert_same(simulation.recording, whole)
    with made() as system:
        assert_same(whole, by_the_rule(system, END, recorded))


PORTS = {  # the inputs and the output that are wired, by kind
    **dict.fromkeys(("relay 2", "relay 3"), ("ua", "y")),
    **dict.fromkeys(("sloped 2", "sloped 3", "lazy"), ("pq", "a")),
    **dict.fromkeys(("mixer", "mixer on get"), ("uv", "y")),
    "eventful": ("u", "count"),
}


@pytest.fixture(scope="module")
def third_party(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """FMUs by kind; relays are Model Exchange FMUs, and the eventful one has event mode."""
    folder = tmp_path_factory.mktemp("third party")
    built = {f"{of.__name__[8:]} {v}": of.build(v, folder) for of in (relay, sloped) for v in (2, 3)}
    return built | {"lazy": built["sloped 3"], "eventful": eventful.build(folder)}


pieces = st.tuples(
    st.sampled_from(list(PORTS)), st.floats(-1.0, 1.0), st.sampled_from([-2.0, -2.0, 0.3, 1e9]), st.booleans()
)
wires = st.tuples(st.integers(0, 6), st.sampled_from([False, False, False, True]))  # source, 0: none; delay


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    made_of=st.lists(pieces, min_size=1, max_size=5).map(lambda rest: [("relay 3", 0.4, -2.0, False), *rest]),
    wired_by=st.lists(wires, min_size=12, max_size=12),
    names=st.permutations("abcdef"),
    recorded=st.integers(0, 5),
)
def test_the_first_row_follows_first_event_iterations_by_the_rule(made_of, wired_by, names, recorded, third_party):
    """Neither other components nor what is recorded changes it."""

    def made(*, more: bool = False) -> System:
        system = System()
        for name, (kind, gain, on, ends) in zip(names, made_of, strict=False):
            given = {"a": gain, "b": gain / 2}
            if kind == "eventful":
                given = {"kind": eventful.KINDS.index("at_end"), "period": 0.0 if on < 0.0 else 0.003}
            elif kind.startswith("relay"):
                given = {"gain": gain, "on": on, "off": on, "ends": float(ends and on > 0.0)}
            elif kind not in ("mixer", "mixer on get"):
                given = {"k": gain, "trouble": 6.0 if kind == "lazy" else 0.0}
            what = {"mixer": Mixer, "mixer on get": MixerOnGet}.get(kind)
            system.add(name, what() if what else third_party[kind], step="2 ms", parameters=given)
        for k, (wire, delay) in enumerate(wired_by[: 2 * len(made_of)]):
            inputs, _ = PORTS[made_of[k // 2][0]]
            if wire and k % 2 < len(inputs):
                source = f"{names[wire % len(made_of)]}.{PORTS[made_of[wire % len(made_of)][0]][1]}"
                system.connect(source, f"{names[k // 2]}.{inputs[k % 2]}", delay=delay, linear=(1.0, 0.0))
        if more:
            for name in ("A", "bb", "g"):
                jumps = {"on": -1.0, "off": -1.0}
                system.add(name, third_party["relay 3"], step="2 ms", parameters=jumps)
            system.connect("A.y", "g.u")
        return system

    every = [f"{name}.{PORTS[kind][1]}" for name, (kind, *_) in zip(names, made_of, strict=False)]
    every += [f"{name}.updates" for name, (kind, *_) in zip(names, made_of, strict=False) if kind[:5] == "relay"]
    try:
        with made() as system, warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            whole = system.run("8 ms", record=every)
    except CosimError:
        return  # without a solution, with a loop that cannot be solved, or ended by the first event iteration
    with made() as system:
        expected = by_the_rule(system, "0.008", every)
    expected.stopped_by = whole.stopped_by  # a request for the end, which the rule keeps as a time
    assert_same(whole, expected)
    if any("do not settle" in str(w.message) for w in found):
        return  # values that initialization passes on in more rounds, the more components there are
    name = every[recorded % len(every)]
    with made(more=True) as system:
        alone = system.run("8 ms", record=[name])
    assert bits(alone[name]).tolist() == bits(whole[name]).tolist()


@pytest.mark.parametrize("steps", [("2 ms", "1 ms"), ("1 ms", "1/700"), ("1/60", "4 ms")])
@pytest.mark.parametrize("order", ["", "ab", "ba"])
@pytest.mark.parametrize("how", ["delay", "extrapolate", "degrees"])
def test_one_connection_of_each_kind(steps, order, how):
    """Between two rates, side by side or in a group."""

    def made() -> System:
        system = System()
        for name, step in zip("ab", steps, strict=True):
            system.add(name, Saw(), step=step)
        if how == "degrees":
            system.connect("a.y", "b.u", linear=(180 / math.pi, 0.1))
        else:
            system.connect("a.y", "b.u", **{how: True})
        if order:
            system.group("group", list(order), "gauss-seidel")
        return system

    with made() as system:
        found = system.run(END, record=["a.y", "b.y", "b.u"])
    with made() as system:
        assert_same(found, by_the_rule(system, END, ["a.y", "b.y", "b.u"]))
