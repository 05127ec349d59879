"""Steps of FMUs with clocks: one alone, or several whose clocks are connected, which take their steps together.

A communication step from t to t + h of connected FMUs. All of them do `fmi3DoStep` to the next time at which one has an
event that is known before (a tick of a time-based clock, `nextEventTime`), or to the end. FMUs that may return early
step first. Where one does, the others step to that time only; those that are beyond go back to their saved states.
There, those with an event are in event mode:

1. Their time-based clocks tick, and inputs of these clocks are set.
2. Output clocks that tick are read. What is connected to such a clock ticks at once: its FMU is in event mode too, and
   reads the inputs of this clock as the other FMUs have them at this time. Its own output clocks are read then.
3. When no output clock is left, the discrete states of all of them are updated. Those that need another update begin at
   2 again.

So a tick, and what belongs to it, takes no time on any number of connections. Events that an FMU reports only after a
step (`eventHandlingNeeded`) are processed at its end. Other values travel by the rule of `engine/exchange.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn, Protocol

import numpy as np

from cosim.core.description import Description, Variable
from cosim.core.errors import CallFailed
from cosim.core.signals import Array

ITERATIONS = 1000  # of an event, and ticks at one instant; beyond does not converge


class ClockedFmu(Protocol):
    """One FMU with clocks (`EventMode`), as far as it is called here."""

    component: Any
    about: Description
    now: float
    returns_early: bool

    @property
    def next(self) -> float: ...

    @property
    def sets_at_events(self) -> bool: ...

    def ticking(self, near: float) -> frozenset[int]: ...

    def wants_event(self, near: float) -> bool: ...

    def advance(self, to: float, *, within: bool) -> None: ...

    def enter(self) -> None: ...

    def leave(self) -> None: ...

    def tick(self, clocks: frozenset[int], *, first: bool = False) -> None: ...

    def told_now(self) -> frozenset[int]: ...

    def update(self, active: frozenset[int], ticking: frozenset[int]) -> bool: ...

    def read_inputs(self) -> None: ...

    def set_inputs(self, which: Callable[[Any], bool]) -> None: ...

    def get_outputs(self, which: Callable[[Any], bool]) -> None: ...

    def place(self, variable: Variable) -> tuple[Array, Any]: ...


@dataclass(frozen=True)
class Tick:
    """`clock` of `target` ticks when `origin` of `source` does, an output clock or a time-based one."""

    source: ClockedFmu
    origin: int
    target: ClockedFmu
    clock: int


@dataclass(frozen=True)
class Wire:
    """An input that belongs to a clock, and the output of another FMU that drives it: scale * output + offset."""

    source: ClockedFmu
    output: Variable
    target: ClockedFmu
    input: Variable
    scale: float = 1.0
    offset: float = 0.0

    def pass_on(self) -> bool:
        """The input gets what the output is now; whether that is another value."""
        (u, to), (y, of) = self.target.place(self.input), self.source.place(self.output)
        value = self.scale * y[of] + self.offset
        if np.array_equal(u[to], value[: len(u[to])]):
            return False
        u[to] = value[: len(u[to])]
        return True


class ClockNetwork:
    """FMUs that take their steps together."""

    def __init__(self, fmus: Sequence[ClockedFmu], ticks: Sequence[Tick] = (), wires: Sequence[Wire] = ()):
        self._fmus, self._ticks, self._wires = list(fmus), ticks, wires
        self._arrived: list[ClockedFmu] = []  # whose inputs of the present step are known

    @property
    def alone(self) -> bool:
        """Whether it is one FMU."""
        return len(self._fmus) == 1

    def begin(self, fmus: Sequence[ClockedFmu]) -> None:
        """Leave the event mode after initialization, in which these FMUs are."""
        self._iterate({m: frozenset() for m in fmus})

    def change(self, fmu: ClockedFmu, action: Callable[[], None]) -> None:
        """Change values of an FMU between steps, in event mode."""
        fmu.enter()
        action()
        self._iterate({fmu: frozenset()})

    def step(self, fmu: ClockedFmu, t: float, h: float) -> None:
        """A communication step with all ticks in [t, t + h); the last FMU to call takes it for all."""
        if fmu in self._arrived:
            self._arrived.clear()
        self._arrived.append(fmu)
        if len(self._arrived) < len(self._fmus):
            return
        self._arrived.clear()
        self._step(t, t + h, min(1e-9 * (1.0 + abs(t)), 1e-3 * h))
        for other in self._fmus:
            if other is not fmu:  # which reads them itself
                other.get_outputs(lambda g: not g.clocks)

    def _step(self, t: float, end: float, near: float) -> None:
        for m in self._fmus:
            m.now = t
            m.read_inputs()
            m.set_inputs(lambda g: not g.clocks and not g.at_events)
        self._events(near, first=True)
        for _ in range(ITERATIONS):
            following = min(m.next for m in self._fmus)
            to = self._advance(t, following if following < end - near else end, end, near)
            if to == end:
                self._event({m: frozenset() for m in self._fmus if m.component._flags[0]})
                return
            self._events(near)
        why = f"clocks tick, or FMUs return early, more than {ITERATIONS} times from {t:.9g} s to {end:.9g} s"
        self._stop(self._fmus[0], why)

    def _advance(self, t: float, to: float, end: float, near: float) -> float:
        """All of them do a step to the same time: `to`, or where the first one returns early."""
        ahead: list[tuple[ClockedFmu, Any]] = []
        returning = [m for m in self._fmus if m.returns_early]
        try:
            for m in (*returning, *(m for m in self._fmus if not m.returns_early)):
                if to < end and not m.about.variable_step:
                    self._stop(
                        m,
                        f"a clock ticks at {to:.9g} s, within a step from {t:.9g} s to {end:.9g} s, and the FMU takes"
                        " no steps of other lengths (canHandleVariableCommunicationStepSize): give it a step so that"
                        " every tick is at the beginning of a step",
                    )
                if m in returning[:-1]:
                    ahead.append((m, m.component.save()))
                m.advance(to, within=to < end)
                if m.now < to - near:
                    to = m.now
                    for other, state in ahead[: returning.index(m)]:
                        other.component.restore(state)
                        other.advance(to, within=True)
        finally:
            for m, state in ahead:
                m.component.forget(state)
        return to

    def _events(self, near: float, *, first: bool = False) -> None:
        """Process all events at the present time; `first`: at the beginning of a step, where discrete inputs change."""
        for _ in range(ITERATIONS):
            ticking = {m: m.ticking(near) for m in self._fmus}
            active = {
                m: clocks
                for m, clocks in ticking.items()
                if clocks or (first and m.sets_at_events) or m.wants_event(near)
            }
            if not active:
                return
            self._event(active, first=first)
            first = False
        self._stop(next(iter(active)), "event iteration did not converge: clocks tick again after every update")

    def _event(self, ticking: dict[ClockedFmu, frozenset[int]], *, first: bool = False) -> None:
        """Event mode of these FMUs, with their time-based clocks that tick."""
        for m, clocks in ticking.items():
            m.enter()
            m.tick(clocks, first=first)
        self._iterate(ticking)

    def _iterate(self, ticking: dict[ClockedFmu, frozenset[int]]) -> None:
        """Let ticks spread and update discrete states until they stay; all of these FMUs are in event mode."""
        inside, waiting = dict.fromkeys(ticking), list(ticking)
        for _ in range(ITERATIONS):
            active = {m: set(ticking.get(m, ())) for m in waiting}
            self._spread(ticking, active, inside)
            waiting = [m for m, clocks in active.items() if m.update(frozenset(clocks), ticking.get(m, frozenset()))]
            ticking = {}
            if not waiting:
                for m in inside:
                    m.leave()
                return
        names = ", ".join(sorted(f"'{m.component.name}'" for m in inside))
        self._stop(
            waiting[0],
            "event iteration did not converge: every update of discrete states requires another one"
            + ("" if self.alone else f"; it goes through {names}, whose clocks are connected"),
        )

    def _spread(
        self,
        ticking: dict[ClockedFmu, frozenset[int]],
        active: dict[ClockedFmu, set[int]],
        inside: dict[ClockedFmu, None],
    ) -> None:
        """Ticks of output clocks, and of time-based ones, reach what is connected to them.

        `active` and `inside` grow.
        """
        queue, reached, sent = list(active), dict[ClockedFmu, set[int]](), dict[ClockedFmu, set[int]]()
        while queue:  # in one round a clock ticks once, so this ends
            source = queue.pop(0)
            new = (source.told_now() | ticking.get(source, frozenset())) - sent.setdefault(source, set())
            active[source] |= new
            sent[source] |= new
            ticked: dict[ClockedFmu, set[int]] = {}
            for tick in self._ticks:
                if tick.source is source and tick.origin in new:
                    ticked.setdefault(tick.target, set()).add(tick.clock)
            for target, clocks in ticked.items():
                self._pass_on(target, clocks, active)
                if target not in inside:
                    inside[target] = None
                    target.enter()
                target.tick(frozenset(clocks))
                for known in (active, reached):
                    known.setdefault(target, set()).update(clocks)
                if target not in queue:
                    queue.append(target)
        for target, clocks in reached.items():  # what was computed after the tick
            if self._pass_on(target, clocks, active):
                target.set_inputs(lambda g, clocks=clocks: bool(g.clocks & clocks))  # type: ignore[misc]

    def _pass_on(self, target: ClockedFmu, clocks: set[int], active: dict[ClockedFmu, set[int]]) -> bool:
        """Inputs of these clocks get what other FMUs have now; whether one of them has changed."""
        wires = [w for w in self._wires if w.target is target and clocks & set(w.input.clocks)]
        for source in dict.fromkeys(w.source for w in wires):
            ticks = active.get(source, set())
            plain = any(w.source is source and not w.output.clocks for w in wires)
            if ticks or plain:
                source.get_outputs(lambda g, t=ticks, p=plain: bool(g.clocks & t) or (p and not g.clocks))  # type: ignore[misc]
        changed = [wire.pass_on() for wire in wires]
        return any(changed)

    def _stop(self, fmu: ClockedFmu, why: str) -> NoReturn:
        raise CallFailed(fmu.component.name, "event mode", 3, f"{why} (at {fmu.now:.9g} s)")
