"""The rule of exchange, written to be read: what the engine must compute, bit for bit.

`cosim/engine/exchange.py` states the rule in words, and `cosim/engine/engine.c` executes it on flat arrays. Here it
stands once more, without arrays and ticks: times are fractions of seconds, values are dictionaries by component and
variable, and every instant is worked out from scratch. Only the components are the same: FMUs and Python objects.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from fractions import Fraction
from typing import Any
from unittest.mock import patch

import numpy as np

from cosim import Execution, Record, Recording, StopWhen, System
from cosim.core.component import EndRequested
from cosim.core.errors import CosimError
from cosim.engine.bound import BoundEngine
from cosim.engine.exchange import Exchange
from oracles.loop_rule import solve

COMPARE = {">=": operator.ge, ">": operator.gt, "<=": operator.le, "<": operator.lt}
Key = tuple[Any, ...]  # component and variable, and which four of its bytes


class Rule:
    """A system that has just been initialized, taken through the instants of a run."""

    def __init__(
        self,
        system: System,
        stop: Fraction,
        record: Sequence[str],
        interval: Fraction | None,
        execution: Execution | None = None,
    ):
        with without_followers() as seen:
            self.simulation = system.initialize(record=Record(record, interval), stop_time=stop, execution=execution)
        self.exchange = self.simulation.exchange
        self.schedule = self.exchange.schedule
        base = self.exchange.base
        self.start, self.stop = base.start, base.exact(base.at_or_after(stop))
        self.interval = min(m.step for m in self.schedule.components) if interval is None else interval
        self.sources = {(c.target, c.input): c for c in self.schedule.connections}
        # If one input of a component is converted, all are, some by a factor of 1.
        self.converting = {c.target for c in self.schedule.connections if (c.scale, c.offset) != (1.0, 0.0)}
        layout, ((settled, values),) = self.exchange.layout, seen
        self.published: dict[Key, float] = {
            piece: values[slot + k] for key, slot in layout.visible.items() for k, piece in enumerate(self.pieces(key))
        }
        self.computed: dict[Key, float] = {
            piece: values[slot + k] for key, slot in layout.latest.items() for k, piece in enumerate(self.pieces(key))
        }
        self.before: dict[Key, float] = {
            piece: values[slot + k] for key, slot in layout.previous.items() for k, piece in enumerate(self.pieces(key))
        }
        self.published_at = {m: values[slot] for m, slot in layout.sample_times.items()}
        self.evaluated: dict[Any, tuple[dict[Any, float], dict[Any, float]]] = {}  # inputs and outputs, in loops
        self.ending: Fraction | None = None if self.exchange.ending is None else self.start
        places = layout.visible | layout.latest
        self.follow({k: settled[slot + i] for key, slot in places.items() for i, k in enumerate(self.pieces(key))})

    # The rule.

    def follow(self, settled: dict[Key, float]) -> None:
        """After first event iterations: what depends directly on outputs that have changed is computed again.

        `settled`: all outputs before these.
        """
        self.published |= self.computed
        was = {k: settled[k] if k[0].description.begins_with_events else y for k, y in self.published.items()}
        known: dict[Any, bool] = {}
        for m in self.schedule.continuous:
            for output in m.description.outputs:
                self.compute_again(m, output, was, known)
        self.before = {key: self.published[key] for key in self.before}

    def compute_again(self, m: Any, output: str, was: dict[Key, float], known: dict[Any, bool]) -> bool:
        """An output, or a loop that it is in, after what it depends on; returns whether it may have changed."""
        loop = next((k for k in self.exchange.loops if (m, output) in outputs_of(k)), None)
        value = loop or (m, output)
        if m.discrete or value in known:
            return known.get(value, False)
        known[value] = False  # for itself
        read = [c for owner, name in (outputs_of(loop) if loop else [(m, output)]) for c in self.direct(owner, name)]
        moved = [
            (c.source, c.output)
            for c in read
            if self.compute_again(c.source, c.output.name, was, known) or c.source.description.begins_with_events
        ]
        events = loop is not None and any(self.has_events(k) for k in loop.components)
        known[value] = bool(moved) or events
        changed = any(self.published[k] != was[k] for key in moved for k in self.pieces(key))
        of = [m] if loop is None else loop.components
        inside = [k for k in self.exchange.loops if any(component in k.components for component in of)]
        if not (changed or events) or any(map(self.repeats, inside)):
            return known[value]
        if loop is not None:
            self.solve(loop)
        elif inside:
            self.solve_values(inside[0])
        else:
            self.published |= self.outputs_without_a_step(m)
        return known[value]

    def direct(self, m: Any, output: str) -> list[Any]:
        """Connections to inputs on which an output depends directly."""
        known = m.description.dependencies.get(output)
        inputs = (self.exchange.measured or {}).get(m, {}).get(output) if known is None else known
        return [
            c
            for c in self.schedule.connections
            if c.target is m and (inputs is None or c.input.name in inputs)
            if not c.delay and not c.input.clocks and c.output.fmi_type not in ("String", "Binary")
        ]

    def repeats(self, loop: Any) -> bool:
        """Whether components of a loop compute their outputs in steps only."""
        return any(m in self.exchange.repeated for m in loop.components)

    def has_events(self, m: Any) -> bool:
        return m.description.interface == "me" and m.description.kind is None

    def outputs_without_a_step(self, m: Any) -> dict[Key, float]:
        """What a component computes of its inputs as they are published."""
        port = self.exchange.layout.ports[m]
        port.u[:] = self.read_by(m, port, None)
        self.exchange.ports[m].set_inputs()
        self.exchange.ports[m].get_outputs()
        written = dict(zip(self.written(m, port), port.y.tolist(), strict=True))
        self.computed |= written
        return written

    def run(self, names: Sequence[str], stops: Sequence[StopWhen] = ()) -> Recording:
        """All instants from the start to the stop time."""
        rows: list[list[float]] = []
        times: list[float] = []
        stopped_by = None
        for t in self.instants():
            now, due = float(t), self.due(t)
            for m in due:
                self.publish(m, now)
            self.solve_loops(due, t)
            if self.ending == t > self.start:
                if self.records(t):
                    times.append(now)
                    rows.append([self.value(n) for n in names])
                break
            advances = t < self.stop
            for m in due:
                if m.discrete:
                    advances &= self.step(m, t)
            if any(m.discrete for m in due):
                self.solve_loops(due, t, after_discrete=True)
            if self.records(t):
                times.append(now)
                rows.append([self.value(n) for n in names])
            stopped_by = next((s for s in stops if COMPARE[s.relation](self.value(s.name), s.value)), None)
            if stopped_by or self.ending == t:
                break
            for m in due:
                if not m.discrete and advances:
                    advances &= self.step(m, t)
        data = np.asfortranarray(np.array(rows).reshape(len(times), len(names)))
        recording = Recording(np.array(times), list(names), data, {})
        recording.stopped_by = None if stopped_by is None else str(stopped_by)
        return recording

    def instants(self) -> Iterator[Fraction]:
        """Times at which something is due, up to the stop time."""
        clocks = [(m.offset, m.step) for m in self.schedule.components] + [(Fraction(0), self.interval)]
        t = self.start
        while t <= self.stop and (self.ending is None or t <= self.ending):
            yield t
            since = t - self.start
            t = self.start + min(
                offset + step * max(0, (since - offset) // step + 1) if since >= offset else offset
                for offset, step in clocks
            )

    def due(self, t: Fraction) -> list[Any]:
        """Components whose step begins at t, in the order of execution."""
        since = t - self.start
        return [m for m in self.schedule.components if since >= m.offset and (since - m.offset) % m.step == 0]

    def records(self, t: Fraction) -> bool:
        return (t - self.start) % self.interval == 0

    def publish(self, m: Any, now: float) -> None:
        """What was published becomes the previous value; what a continuous component has computed is published."""
        if m in self.published_at:
            self.published_at[m] = now
        for key in [k for k in self.before if k[0] is m]:
            self.before[key] = self.published[key]
        for key in [k for k in self.computed if k[0] is m]:
            self.published[key] = self.computed[key]

    def step(self, m: Any, t: Fraction) -> bool:
        """Inputs as they stand, one step, outputs; returns whether continuous components may advance afterward."""
        now, port = float(t), self.exchange.layout.ports[m]
        port.u[:] = self.read_by(m, port, now)
        may_advance = True
        try:
            self.exchange.ports[m].run(now, float(m.step))
        except EndRequested as request:
            ending = t + m.step * request.complete
            self.ending = ending if self.ending is None else min(self.ending, ending)
            may_advance = request.complete
        outputs = self.published if m.discrete else self.computed
        outputs |= zip(self.written(m, port), port.y.tolist(), strict=True)
        return may_advance

    def solve_loops(self, due: Sequence[Any], t: Fraction, *, after_discrete: bool = False) -> None:
        """Algebraic loops whose components are due: at their arrival, and after discrete components that drive them."""
        for loop in self.exchange.loops:
            driven = any(c.target in loop.components and c.source.discrete for c in self.schedule.connections)
            if loop.components[0] not in due or (t == self.start and not after_discrete):
                continue
            if after_discrete and (self.repeats(loop) or not driven):
                continue
            self.solve(loop)

    def solve(self, loop: Any) -> None:
        """The values of a loop, again while discrete states of its Model Exchange FMUs change with them."""
        self.solve_values(loop)
        foreign = [m for m in loop.components if self.has_events(m)]
        for _ in range(100 if foreign else 0):
            before, _ = self.sum_of(loop)
            for m in foreign:
                if m not in self.exchange.repeated:
                    with suppress(EndRequested):
                        self.exchange.ports[m].step(math.nan, float(m.step))
            self.solve_values(loop)
            after, size = self.sum_of(loop)
            if not abs(after - before) > 1e-12 * size:
                return
        if foreign:
            raise ArithmeticError(f"discrete states change with each solution: {loop}")

    def sum_of(self, loop: Any) -> tuple[float, float]:
        """A sum that changes with the values that the components of a loop read of each other, and its size."""
        total, weight, size = 0.0, 1.0, 1.0
        for key in dict.fromkeys((c.source, c.output) for c in loop.connections):
            term = weight * self.computed[key]
            total += term
            size += abs(term)
            weight += 0.6180339887498949 if weight < 1.4 else -0.3819660112501051
        return total, size

    def solve_values(self, loop: Any) -> None:
        """From the published values on."""
        guess = [self.published[key] for key in loop.unknowns]
        nominal = [v.nominal for _, v in loop.unknowns]
        offered = {m: d for m in loop.components if (d := self.derivative(loop, m))}
        along = (lambda z, change: self.residual(loop, z, offered, change)) if offered else None
        solve(lambda z: self.residual(loop, z), guess, nominal, self.exchange.loop_tolerance, along)

    def derivative(self, loop: Any, m: Any) -> tuple[list[Any], list[Any]] | None:
        """Outputs and inputs of a component in a loop, if it tells their directional derivatives."""
        if not m.description.directional_derivatives or m in self.exchange.repeated:
            return None
        outputs = dict.fromkeys(c.output for c in loop.connections if c.source is m)
        return [*outputs], [*dict.fromkeys(c.input for c in loop.connections if c.target is m)]

    def residual(
        self, loop: Any, z: Sequence[float], offered: dict[Any, tuple[list[Any], list[Any]]] | None = None, change=1.0
    ) -> list[float]:
        """What the components of a loop compute from its unknowns z, without a step, minus z.

        With derivatives that are `offered`: along these, from the last evaluation on, which is `change` away.
        """

        def put() -> None:
            self.published |= zip(loop.unknowns, z, strict=True)
            self.computed |= zip(loop.unknowns, z, strict=True)

        put()
        for m in loop.components:
            port = self.exchange.layout.ports[m]
            inputs = {v: self.input(m, v, None) for v in port.inputs}
            if offered and m in offered:
                self.computed |= self.along(m, inputs, *offered[m], change)
            else:
                written = self.outputs_without_a_step(m)
                self.evaluated[m] = inputs, {v: written[m, v] for v in port.outputs}
            self.published |= {key: y for key, y in self.computed.items() if key[0] is m}
        found = [self.computed[key] - x for key, x in zip(loop.unknowns, z, strict=True)]
        put()
        return found

    def pieces(self, key: Key) -> list[Key]:
        """The number of a value, and the bytes that go with it."""
        return [key, *((*key, k) for k in range(1, self.exchange.layout.width(key)))]

    def written(self, m: Any, port: Any) -> list[Key]:
        """What a component writes."""
        return [piece for v in port.outputs for piece in self.pieces((m, v))]

    def read_by(self, m: Any, port: Any, now: float | None) -> list[float]:
        """What a component reads, with the bytes that go with it."""
        return [
            self.input(m, v, now, (k,) if k else ())
            for v in port.inputs
            for k in range(1 + (self.sources[m, v].size + 3) // 4)
        ]

    def along(self, m: Any, inputs: dict[Any, float], of: list[Any], by: list[Any], change: float) -> dict[Key, float]:
        """Outputs of a component in a loop by their derivative, from its last evaluation on."""
        u, y = self.evaluated[m]
        seeds = {v: (inputs[v] - u[v]) / change for v in by}
        try:
            slopes = m.implementation.directional(of, seeds)
        except CosimError:
            slopes = [math.nan] * len(of)
        return {(m, v): y[v] + slope * change for v, slope in zip(of, slopes, strict=True)}

    def input(self, m: Any, variable: Any, now: float | None, piece: tuple[int, ...] = ()) -> float:
        """What an input reads at an instant, for a step that begins `now`, or for outputs without a step."""
        c = self.sources[m, variable]
        key = (c.source, c.output, *piece)
        if c.delay:
            value = self.before[key]
        elif c.extrapolate and now is not None:
            value = self.extrapolated(m, c, now)
        else:
            value = (self.computed if self.is_ahead(c.source, m) else self.published)[key]
        return value * c.scale + c.offset if m in self.converting else value

    def extrapolated(self, m: Any, c: Any, now: float) -> float:
        """On the line through the last two values of the source, at the middle of the step that begins."""
        key, period = (c.source, c.output), float(c.source.step)
        if self.is_ahead(c.source, m):
            old, new, since = self.published[key], self.computed[key], period
        else:
            old, new, since = self.before[key], self.published[key], 0.0
        ahead = float(m.step) / 2 - since
        return new + (new - old) * ((now + ahead - self.published_at[c.source]) / period)

    def is_ahead(self, source: Any, m: Any) -> bool:
        """Whether both are in a Gauss-Seidel group, in which the source advances first."""
        for group in self.schedule.groups:
            if group.method == "gauss-seidel" and source in group.components and m in group.components:
                return group.components.index(source) < group.components.index(m)
        return False

    # What is recorded.

    def value(self, name: str) -> float:
        """Present value of an output, of an input that keeps its start value, or of a connected one.

        The last is what its source shows, converted.
        """
        component, _, variable = name.partition(".")
        m = next(m for m in self.schedule.components if m.name == component)
        v = m.description.find(variable, component)
        c = self.sources.get((m, v))
        if c is None:
            return self.published[m, v] if (m, v) in self.published else float(m.values.get(v.name, v.start))
        value = (self.before if c.delay else self.published)[c.source, c.output]
        return value if (c.scale, c.offset) == (1.0, 0.0) else value * c.scale + c.offset


def outputs_of(loop: Any) -> dict[tuple[Any, str], None]:
    """Outputs that a loop goes through."""
    return dict.fromkeys((c.source, c.output.name) for c in loop.connections)


@contextmanager
def without_followers() -> Iterator[list[tuple[list[float], list[float]]]]:
    """Initialization ends with the first event iterations; collects all values before and after these."""
    seen: list[tuple[list[float], list[float]]] = []

    def publish(engine: Any, before: Any) -> None:
        seen.append((before.tolist(), engine._setup.values.tolist()))
        engine.publish()

    with patch.object(BoundEngine, "follow_events", publish), patch.object(Exchange, "sample"):
        yield seen


def by_the_rule(
    system: System,
    stop: Fraction | float | str,
    names: Sequence[str],
    interval: Fraction | None = None,
    stops: Sequence[StopWhen] = (),
) -> Recording:
    """A whole run to `stop` [s], as `System.run` makes it."""
    rule = Rule(system, Fraction(str(stop)) if not isinstance(stop, Fraction) else stop, names, interval)
    try:
        recording = rule.run(names, stops)
    finally:
        rule.simulation.close()
    assert all(map(math.isfinite, recording.time))
    return recording
