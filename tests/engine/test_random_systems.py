"""Random systems, run by the engine in pieces: bit-identical to the rule of exchange in plain Python."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from oracles.exchange_rule import by_the_rule
from random_systems import Saw, systems, wired
from same import assert_same

from cosim import LoopError, Record, Recording, StopWhen, System

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
