"""Random systems, run with a tolerance and in pieces: bit-identical to the rule of adaptive steps in plain Python."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foreign import sloped
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from oracles.adaptive_rule import by_the_adaptive_rule
from same import assert_same

from cosim import Execution, PythonComponent, Record, System

pytestmark = pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning", "ignore::cosim.FmuWarning")
END = Fraction(9, 100)


class Mass(PythonComponent):
    """A damped oscillator; its outputs do not depend directly on the force."""

    inputs = ("u",)
    outputs = ("y", "v")
    parameters = {"rate": 30.0, "a": 1.0}  # noqa: RUF012
    feedthrough = {"y": (), "v": ()}  # noqa: RUF012

    def begin(self) -> None:
        self.x, self.v = self.a, 0.0

    def start(self, u: Any, y: Any) -> None:  # noqa: ARG002
        y[:] = self.x, self.v / self.rate

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        for _ in range(4):
            self.v += 0.25 * h * self.rate * (self.rate * (u[0] - self.x) - self.v)
            self.x += 0.25 * h * self.v
        self.start(u, y)


class Spring(PythonComponent):
    """An output that depends directly on the input, and follows it without a step."""

    inputs = ("u",)
    outputs = ("y",)
    parameters = {"a": 1.0, "rate": 0.0}  # noqa: RUF012
    feedthrough = {"y": ("u",)}  # noqa: RUF012
    computes_on_get = True

    def start(self, u: Any, y: Any) -> None:
        y[0] = self.a * np.sin(u[0])

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.start(u, y)


class Lagging(Spring):
    """The same, but it follows in steps only."""

    computes_on_get = False


class Kick(Mass):
    """Its output jumps within a step."""

    def step(self, t: float, h: float, u: Any, y: Any) -> None:
        super().step(t, h, u, y)
        y[0] += t + h > 0.0337


class Sampled(PythonComponent):
    kind = "discrete"
    inputs = ("u",)
    outputs = ("y",)
    parameters = {"a": 1.0, "rate": 0.0}  # noqa: RUF012

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        y[0] = self.a * u[0] + np.sin(90.0 * t)


class Bent(PythonComponent):
    """A part of an algebraic loop, of which it computes outputs at any time."""

    inputs = ("u", "w")
    outputs = ("y",)
    parameters = {"a": 0.5}  # noqa: RUF012
    feedthrough = {"y": ("u", "w")}  # noqa: RUF012
    computes_on_get = True

    def start(self, u: Any, y: Any) -> None:
        y[0] = self.a * np.cos(u[0]) + u[1]

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.start(u, y)


class Repeating(Bent):
    """The same, but its last step is repeated; it remembers how far it went."""

    computes_on_get = False

    def begin(self) -> None:
        self.way = 0.0

    def step(self, t: float, h: float, u: Any, y: Any) -> None:  # noqa: ARG002
        self.way += h * u[1]
        y[0] = self.a * np.cos(u[0]) + self.way


KINDS = {"mass": Mass, "spring": Spring, "lagging": Lagging, "kick": Kick, "sampled": Sampled}
STEPS = [Fraction(1, 500), Fraction(1, 100), Fraction(1, 300), Fraction(7, 999)]
piece = st.tuples(
    st.sampled_from(["mass", "mass", "spring", "sampled", "sampled", "lagging", "kick", "2", "3"]),
    st.sampled_from(STEPS),
    st.floats(5.0, 60.0),
    st.floats(-1.0, 1.0),
    st.integers(0, 5),
)


@pytest.fixture(scope="module")
def slopes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU with direct dependencies and directional derivatives."""
    return sloped.build(3, tmp_path_factory.mktemp("sloped"))


def with_loop(system: System, loop: str, slopes: Path) -> None:
    """Two components in a loop: the first component drives one of them, and another oscillator reads the other."""
    system.add("p", Bent(), step="2 ms")
    system.add("q", slopes if loop == "fmu" else Bent() if loop == "bent" else Repeating(), step="2 ms")
    system.add("x", Mass(), step="2 ms")
    system.connect("m0.y", "p.w")
    system.connect("q.a" if loop == "fmu" else "q.y", "p.u")
    system.connect("p.y", "q.p" if loop == "fmu" else "q.u")
    system.connect("q.a" if loop == "fmu" else "q.y", "x.u")
    system.connect("x.y", "q.q" if loop == "fmu" else "q.w")


def made(pieces: list[Any], follower: dict[int, Path], loop: str, slopes: Path, internal: Fraction | None) -> System:
    """A chain of components, each of which reads one ahead of it, or, if nothing of it depends directly, any.

    With a `loop` of this kind behind the first one. The first component has `internal` steps.
    """
    system = System()
    for i, (kind, step, rate, a, _) in enumerate(pieces):
        if kind in KINDS:
            system.add(f"m{i}", KINDS[kind](), step=step, parameters={"rate": rate, "a": a})
        else:
            system.add(f"m{i}", follower[int(kind)], step=step, parameters={"rate": rate}, kind="continuous")
    for i, (kind, *_, source) in enumerate(pieces):
        k = source % len(pieces) if kind in ("mass", "kick") else source % max(i, 1)
        if kind not in ("mass", "kick") and k >= i:
            continue
        system.connect(f"m{k}.y", f"m{i}.u", linear=(1.0, 0.1 * (i % 2)))
    if loop:
        with_loop(system, loop, slopes)
    system["m0"].description.internal_step = internal
    return system


@settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(
    pieces=st.lists(piece, min_size=2, max_size=6),
    tolerance=st.sampled_from([1e-2, 1e-3]),
    interval=st.sampled_from([None, Fraction(1, 1000), Fraction(1, 60)]),
    cuts=st.lists(st.floats(0.001, 0.089), max_size=3).map(sorted),
    loop=st.sampled_from(["", "", "bent", "fmu", "repeating"]),
)
def test_the_engine_follows_the_rule(pieces, tolerance, interval, cuts, loop, follower, slopes):
    names = [*(f"m{i}.y" for i in range(len(pieces))), *(["p.y", "x.y"] if loop else [])]
    if all(kind == "sampled" for kind, *_ in pieces) and not loop:
        return
    internal = Fraction(1, 20000) if len(cuts) == 1 else None
    with made(pieces, follower, loop, slopes, internal) as system:
        expected, accepted, rejected = by_the_adaptive_rule(system, END, names, tolerance, interval)
    record, execution = Record(names, interval), Execution(tolerance=tolerance)
    with (
        made(pieces, follower, loop, slopes, internal) as system,
        system.initialize(record=record, stop_time=END, execution=execution) as simulation,
    ):
        state = None
        for until in cuts:
            simulation.advance(until)
            if state is None:
                state = simulation.save()
            else:
                simulation.restore(state)
                simulation.advance(until)
        simulation.advance(END, final=True)
        found = simulation.recording
    assert_same(found, expected)
    assert found.steps.accepted == accepted
    assert found.steps.rejected == rejected
