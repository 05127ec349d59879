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
from oracles.exchange_rule import Key, Rule


class AdaptiveRule(Rule):
    """A system that has just been initialized, taken through a run with a tolerance."""

    def __init__(
        self, system: System, stop: Fraction, record: Sequence[str], interval: Fraction | None, tolerance: float
    ):
        super().__init__(system, stop, record, interval, Execution(tolerance=tolerance))
        self.tick, self.tolerance = self.exchange.base.tick, tolerance
        declared = min(m.step for m in self.schedule.continuous)
        self.next, self.largest = int(declared / self.tick), int(64 * declared / self.tick)
        self.outputs: list[Key] = [
            (m, v) for m in self.schedule.continuous for v in self.exchange.layout.ports[m].outputs
        ]
        self.connections = [c for c in self.schedule.connections if not c.target.discrete]
        self.read = {(c.source, c.output) for c in self.connections}
        self.held = {(c.source, c.output) for c in self.connections if c.target in self.exchange.adaptive.held}
        self.held |= {key for key in self.outputs if key[1].type != "real"}
        self.loops = list(self.exchange.loops)
        self.refreshed = self.in_order()
        self.size = {(m, v): v.nominal for m, v in self.outputs}
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
            held = m in self.exchange.adaptive.held
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
            if loop_of(m, v) or (direct(m, v) and m not in self.exchange.adaptive.held):
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
        """What is computed is published; within a step, on the line from its begin to its end."""
        if t == self.end:
            self.over = 0 if self.jumps % 2 else int((self.end - self.begin) / self.tick)
            self.slope = self.slopes(self.over)
        share = 1.0 if t == self.end else ((t - self.begin) / self.tick) / float((self.end - self.begin) / self.tick)
        for key in self.outputs:
            if t == self.end:
                self.published[key] = self.computed[key]
            elif key[1].type == "real":
                self.published[key] = self.at[key] + (self.computed[key] - self.at[key]) * float(share)
            else:
                self.published[key] = self.at[key]

    def take_step(self, t: Fraction, left: Fraction, *, changes: bool) -> None:
        """A step from t on, no longer than `left`; `changes`: discrete components have just changed something."""
        most, over, slope = int(left / self.tick), self.over, self.slope
        if changes or t == self.start:
            self.refresh(after=False)
        self.at = {key: self.published[key] for key in self.outputs}
        for key, y in self.at.items():
            self.size[key] = max(self.size[key], abs(y))
        n = most if self.next >= most else (most + 1) // 2 if 2 * self.next > most else self.next
        states = {m: m.implementation.save() for m in self.schedule.continuous}
        while True:
            h = float(n * self.tick)
            for key in self.outputs:
                self.published[key] = self.at[key] + slope[key] * (0.5 * h)
            for m in self.schedule.continuous:
                self.advance(m, float(t), h)
            for key in self.outputs:
                self.published[key] = self.computed[key]
            solved = True
            try:
                self.refresh(after=True)
            except ArithmeticError:
                solved = False
            error, worst = self.error(slope, h) if solved else (math.inf, None)
            if error <= 1.0 or n == 1:
                break
            self.rejected += 1
            if solved:
                slope, over = self.slopes(-n), -n
            for m, state in states.items():
                m.implementation.restore(state)
            n = self.next = max(1, int(max(0.9 / error, 0.1) * n))
        self.jumps = 0 if error <= 1.0 else self.jumps + 1
        self.accepted += 1
        self.control(n, error, over, held=worst is not None and slope[worst] == 0.0)
        self.begin, self.end = t, t + n * self.tick
        self.published |= self.at

    def slopes(self, over: int) -> dict[Key, float]:
        """Slopes from the begin to the end of the step before, or of one that was rejected."""
        h = abs(float(over * self.tick))
        return {
            key: (self.computed[key] - self.at[key]) / h if over and key not in self.held else 0.0
            for key in self.outputs
        }

    def error(self, slope: dict[Key, float], h: float) -> tuple[float, Key | None]:
        """The largest error of what continuous components read, relative to the tolerance."""
        errors = {
            key: abs(y - (self.at[key] + slope[key] * h)) / (self.tolerance * max(self.size[key], abs(y)))
            for key, y in ((key, self.computed[key]) for key in self.outputs if key in self.read)
        }
        largest = max(errors.values(), default=0.0)
        return largest, next((key for key, e in errors.items() if e == largest), None)

    def control(self, n: int, error: float, over: int, *, held: bool) -> None:
        """The length of the next step."""
        factor = 2.0
        if error > 0.0 and held:
            factor = 0.9 / error
        elif error > 0.0:
            factor = 0.5 * (math.sqrt(1.0 + 4.0 * 0.9 * abs(1.0 + over / n) / error) - 1.0)
        factor = max(factor, 0.1)
        self.next = int(factor * n) if factor < 2.0 else max(self.next, 2 * n)
        self.next = min(max(self.next, 1), self.largest)

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
