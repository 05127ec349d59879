"""The rule of adaptive steps, written to be read: what `cosim/engine/adaptive.c` must compute, bit for bit.

`cosim/engine/adaptive.py` states it in words. Values are dictionaries by component and variable, and lengths are
integers in ticks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from cosim import Execution, Recording, System
from cosim.engine.adaptive import FLOOR, SHARE
from oracles.exchange_rule import Key, Rule


class AdaptiveRule(Rule):
    """A system that has just been initialized, taken through a run with a tolerance."""

    def __init__(
        self, system: System, stop: Fraction, record: Sequence[str], interval: Fraction | None, tolerance: float
    ):
        super().__init__(system, stop, record, interval, Execution(tolerance=tolerance))
        self.tick, self.tolerance = self.exchange.base.tick, SHARE * tolerance
        declared = min(m.step for m in self.schedule.continuous)
        internal = [m.description.internal_step for m in self.schedule.continuous if m.description.internal_step]
        self.internal = int(least_common_multiple(internal) / self.tick) if internal else 0
        self.smallest = self.internal or 1
        self.next, self.largest = int(declared / self.tick), int(64 * declared / self.tick)
        self.outputs: list[Key] = [
            (m, v) for m in self.schedule.continuous for v in self.exchange.layout.ports[m].outputs
        ]
        self.connections = [c for c in self.schedule.connections if not c.target.discrete]
        self.read = {(c.source, c.output) for c in self.connections}
        self.last = {(c.source, c.output) for c in self.connections if c.target in self.exchange.adaptive.in_steps}
        self.held = {key for key in self.outputs if key[1].is_stepwise}
        self.loops = list(self.exchange.loops)
        self.refreshed = self.in_order()
        self.size = {(m, v): FLOOR * v.nominal for m, v in self.outputs}
        self.back = dict.fromkeys(self.outputs, 0.0)  # slopes in the step before, of so many ticks
        self.past = 0
        self.at = dict.fromkeys(self.outputs, 0.0)
        self.begin = self.end = self.start
        self.jumps, self.accepted, self.rejected = 0, 0, 0

    def in_order(self) -> list[Any]:
        """Components whose outputs depend directly on inputs and follow them without a step, level by level."""

        def direct(m: Any, v: Any) -> list[Any]:
            known = m.description.dependencies.get(v.name)
            return [c for c in self.connections if c.target is m and (known is None or c.input.name in known)]

        def loop_of(m: Any, v: Any) -> Any:
            return next((k for k in self.loops if any((c.source, c.output) == (m, v) for c in k.connections)), None)

        def inputs(m: Any, v: Any) -> list[Any]:
            held = m in self.exchange.adaptive.in_steps
            return [] if held else [(c.source, c.output) for c in direct(m, v) if not c.source.discrete]

        def level(m: Any, v: Any) -> int:
            loop = loop_of(m, v)
            values = {(c.source, c.output) for c in loop.connections} if loop else {(m, v)}
            before = [
                level(*key) for value in values for key in inputs(*value) if not loop or loop_of(*key) is not loop
            ]
            return 1 + max(before) if before else 0

        levels: dict[int, set[Any]] = {}
        for m, v in {*self.outputs} | {key for key in self.read if not key[0].discrete}:
            if loop_of(m, v) or (direct(m, v) and m not in self.exchange.adaptive.in_steps):
                levels.setdefault(level(m, v), set()).add(loop_of(m, v) or m)
        return [
            item
            for _, found in sorted(levels.items(), key=lambda level: level[0])
            for item in [
                *sorted((m for m in found if m not in self.loops), key=lambda m: m.name),
                *(loop for loop in self.loops if loop in found),
            ]
        ]

    # The rule.

    def run_adaptive(self, names: Sequence[str]) -> Recording:
        times, rows = [], []
        clocks = [(m.offset, m.step) for m in self.schedule.discrete]
        t = self.start
        while True:
            now = float(t)
            due = [m for m in self.due(t) if m.discrete]
            self.arrive(t)
            for m in due:
                self.publish(m, now)
            for m in due:
                self.step(m, t)
            for loop in self.loops if due else ():
                if any(c.target in loop.components and c.source.discrete for c in self.schedule.connections):
                    self.solve_unless_repeated(loop)
            if self.records(t):
                times.append(now)
                rows.append([self.value(n) for n in names])
            if t == self.stop:
                break
            instants = [after(t - self.start, *clock) for clock in clocks]
            if t == self.end:
                self.take_step(t, min([*instants, self.stop - self.start]) - (t - self.start), changes=bool(due))
            t = self.start + min(*instants, self.end - self.start, after(t - self.start, Fraction(0), self.interval))
        data = np.asfortranarray(np.array(rows).reshape(len(times), len(names)))
        return Recording(np.array(times), list(names), data, {})

    def arrive(self, t: Fraction) -> None:
        """What is computed is published; within a step, on a parabola."""
        if t == self.end:
            self.learn(0 if self.jumps == 1 else int((self.end - self.begin) / self.tick), accepted=True)
            self.published |= {key: self.computed[key] for key in self.outputs}
            return
        h, share = (
            float(self.end - self.begin),
            int((t - self.begin) / self.tick) / int((self.end - self.begin) / self.tick),
        )
        for key in self.outputs:
            change = self.computed[key] - self.at[key] if not key[1].is_stepwise else 0.0
            bend = self.bend(key, change / h, h) * h * h
            self.published[key] = self.at[key] + share * (change - bend * (1.0 - share))

    def take_step(self, t: Fraction, left: Fraction, *, changes: bool) -> None:
        """A step from t on, no longer than `left`; `changes`: discrete components have just changed something."""
        most = int(left / self.tick)
        if changes or t == self.start:
            self.refresh(after=False)
            self.past = 0
        self.at = {key: self.published[key] for key in self.outputs}
        for key, y in self.at.items():
            self.size[key] = max(self.size[key], abs(y))
        n = most if self.next >= most else (most + 1) // 2 if 2 * self.next > most else self.next
        n = min(self.fitting(n), most)
        states = {m: m.implementation.save() for m in self.schedule.continuous}
        while True:
            h = float(n * self.tick)
            parts = [-1, 1] if n > self.smallest and n == self.fitting(n) else [0]
            for i, side in enumerate(parts):
                for key in self.outputs:
                    self.published[key] = self.constant(key, h, side)
                for m in self.schedule.continuous:
                    self.advance(m, float(t) + i * h / 2, h / len(parts))
            for key in self.outputs:
                self.published[key] = self.computed[key]
            solved = True
            try:
                self.refresh(after=True)
            except ArithmeticError:
                solved = False
            error, worst = self.error(h) if solved else (math.inf, None)
            if error <= 1.0 or n <= self.smallest:
                break
            self.rejected += 1
            factor = self.factor(n, error, worst, 0.9, follows=False)
            if factor > 0.1:
                self.learn(n, accepted=False)
            for m, state in states.items():
                m.implementation.restore(state)
            n = self.next = self.fitting(int(factor * n))
        self.jumps = 0 if error <= 1.0 else self.jumps + 1
        self.accepted += 1
        factor = self.factor(n, error, worst, 2.0, follows=True)
        self.next = int(factor * n) if factor < 2.0 else max(self.next, 2 * n)
        self.next = min(max(self.next, 1), self.largest)
        self.begin, self.end = t, t + n * self.tick
        self.published |= self.at

    def fitting(self, n: int) -> int:
        """The longest step up to n whose halves are multiples of the internal steps, or the smallest step."""
        if self.internal and n >= 2 * self.internal:
            return n // (2 * self.internal) * 2 * self.internal
        return self.smallest if self.internal else max(n, 1)

    def constant(self, key: Key, h: float, side: int) -> float:
        """What is read in a half of the step, the first (-1) or the second (1), or in all of it (0)."""
        slope, bend = self.slope[key] + self.curve[key] * float(self.over * self.tick), self.curve[key] * h
        change = side * (h * (slope + bend) / 3.0)
        if key in self.last:
            change = (side or 1) * (h * (slope / 2.0 + bend * 2.0 / 3.0))
        return self.at[key] + h * (slope / 2.0 + bend / 3.0) + change

    def bend(self, key: Key, slope: float, h: float) -> float:
        """The second divided difference over the step before and one of length h."""
        past = float(self.past * self.tick)
        return (slope - self.back[key]) / (h + past) if past and key not in self.held else 0.0

    def learn(self, n: int, *, accepted: bool) -> None:
        """Slopes and curves by the step that was accepted, or by one that was rejected; n = 0: there are none."""
        h = float(n * self.tick)
        if not n:
            self.past = 0
        known = [key for key in self.outputs if n and key not in self.held]
        self.slope = dict.fromkeys(self.outputs, 0.0)
        self.slope |= {key: (self.computed[key] - self.at[key]) / h for key in known}
        self.curve = {key: self.bend(key, slope, h) if n else 0.0 for key, slope in self.slope.items()}
        self.over, self.far = n if accepted else -n, self.past + n if accepted and self.past else self.past
        if accepted:
            self.back, self.past = self.slope, n

    def error(self, h: float) -> tuple[float, Key | None]:
        """The largest error of what continuous components read, relative to what a step may have."""
        over = float(self.over * self.tick)
        expected = {k: self.at[k] + h * (self.slope[k] + self.curve[k] * (h + over)) for k in self.outputs}
        errors = {
            key: abs(y - expected[key]) / (self.tolerance * max(self.size[key], abs(y)))
            for key, y in ((key, self.computed[key]) for key in self.outputs if key in self.read)
        }
        largest = max(errors.values(), default=0.0)
        return largest, next((key for key, e in errors.items() if e == largest), None)

    def factor(self, n: int, error: float, worst: Key | None, most: float, *, follows: bool) -> float:
        """By which the next step, or this one when it is tried again, may be longer: `most`, or less by the error.

        The error grows with the distances from the end of a step to the three values that it was extrapolated from.
        """
        known = worst is not None and self.slope[worst] != 0.0
        before = [x / n for x in (self.over, self.far) if x] if known else []
        after = [1.0, 1.0 + self.past / n][: len(before)] if follows else before
        while most > 0.1 and error * growth(most, after) > 0.9 * growth(1.0, before):
            most *= 0.96
        return max(most, 0.1)

    def solve_unless_repeated(self, loop: Any) -> None:
        if not any(m in self.exchange.repeated for m in loop.components):
            self.solve(loop)

    def refresh(self, *, after: bool) -> None:
        """Outputs that depend directly on inputs, of the inputs as they are published, and loops.

        `after` a step, which the components of some loops repeat.
        """
        for m in self.refreshed:
            if m in self.loops:
                (self.solve if after else self.solve_unless_repeated)(m)
                continue
            port = self.exchange.layout.ports[m]
            port.u[:] = [self.input(m, v, None) for v in port.inputs]
            self.exchange.ports[m].set_inputs()
            self.exchange.ports[m].get_outputs()
            for v, y in zip(port.outputs, port.y.tolist(), strict=True):
                self.computed[m, v] = self.published[m, v] = y

    def advance(self, m: Any, now: float, h: float) -> None:
        port = self.exchange.layout.ports[m]
        port.u[:] = [self.input(m, v, now) for v in port.inputs]
        self.exchange.ports[m].run(now, h)
        self.computed |= {(m, v): y for v, y in zip(port.outputs, port.y.tolist(), strict=True)}


def least_common_multiple(of: Sequence[Fraction]) -> Fraction:
    whole = math.lcm(*(x.denominator for x in of))
    return Fraction(math.lcm(*(int(x * whole) for x in of)), whole)


def growth(f: float, distances: Sequence[float]) -> float:
    """How an error grows with the length f of a step, beside its distances to known values."""
    product = f
    for distance in distances:
        product *= abs(f + distance)
    return product


def after(since: Fraction, offset: Fraction, step: Fraction) -> Fraction:
    """When a clock is due next after some time since the start."""
    return offset + step * ((since - offset) // step + 1) if since >= offset else offset


def by_the_adaptive_rule(
    system: System, stop: Fraction, names: Sequence[str], tolerance: float, interval: Fraction | None = None
) -> tuple[Recording, int, int]:
    """A whole run to `stop` [s], as `System.run` makes it, with the numbers of accepted and rejected steps."""
    rule = AdaptiveRule(system, stop, names, interval, tolerance)
    try:
        recording = rule.run_adaptive(names)
    finally:
        rule.simulation.close()
    return recording, rule.accepted, rule.rejected
