"""The co-simulation algorithm: how components exchange values, instant by instant.

The rule. Time is an integer count of base ticks. At every instant t at which something is due:

1. Arrival. Continuous components whose step ends at t show the outputs they reached.
2. Discrete components that are due run in topological order of direct feed-through: each reads its inputs as they
   stand now, is stepped from t to its next sample, and its outputs are used from t on.
3. The recorder takes its sample if it is due, and the stop conditions are checked. A recording at t therefore
   shows plant outputs at t together with the controllers' new outputs at t.
4. Continuous components that are due advance from t to t + step with inputs as of t. What they reach stays hidden
   until t + step: that is the Jacobi exchange, and it needs no order. In a Gauss-Seidel group, components see at once
   what the components before them have reached (their latest step, if they are slower).

`System.run` ends with part 3 at its stop time: its last row is the row that a longer run has at that time.
`Simulation.advance` ends with part 1 and a provisional sample, so that inputs can be set before discrete components
run; if the simulation is continued, the instant is completed first and its sample replaced: advancing in pieces gives
what advancing in one go gives. Nothing is shortened to meet the stop time: a step that reaches beyond it was begun
before it, and shows its outputs when its end is reached.

Algebraic loops whose components are due are solved at the end of part 1, and again after part 2 where discrete
components drive them. If discrete states of Model Exchange FMUs in a loop change with its solution, it is solved again
with these, at most 100 times, until the values stay that its components read of each other.

Initialization ends with first event iterations: of Model Exchange FMUs, and of Co-Simulation FMUs with event mode. What
depends directly on outputs that have changed there follows once, in the order of dependency: continuous components
compute their outputs again, without a step, and loops are solved again. Discrete states are updated again in loops
alone. Connections with a delay pass nothing on. A component that computes its outputs in steps only keeps them, and so
do all components in a loop with it. A discrete input of a Co-Simulation FMU with event mode is set in its first step.
An exported system that holds such FMUs keeps its outputs, and what reads them follows in its first step: it counts as a
Co-Simulation FMU without event mode.

A component may ask to end the simulation. When its step was done the run ends at the end of that step, with an arrival
and a last sample (no component runs there); otherwise at its beginning, with the sample there and nobody advanced
further. After a request in a first event iteration, that is the first instant.

No component ever reads a NaN or an infinity that another one has made: outputs are checked as soon as they are there,
and the first that is not finite ends the run (unless `allow_nan`).

A delayed connection delivers what the source showed before its latest step (discrete: its latest run).

All values lie in one vector of floats. An FMU reads its outputs into its slice of it, and its inputs come from it with
one indexed copy. `engine.c` executes instants; this module keeps the position in time and what ends a run.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import NamedTuple

from cosim.core.component import EndRequested
from cosim.core.errors import TimeError
from cosim.core.time import seconds_text
from cosim.engine.bound import BoundEngine, SlotStop
from cosim.engine.plan import Setup
from cosim.engine.stops import Reader, Stop, StopCondition, StopWhen, Timed, stop_check
from cosim.recording.recording import LoopEffort
from cosim.system.names import SystemComponents


class Phase(enum.Enum):
    """How much of the present instant is done."""

    NOTHING = 0
    ARRIVED = 1  # arrival, and a provisional sample if one is due
    SAMPLED = 2  # all but the continuous components


class Ending(NamedTuple):
    """A component has asked to end the run at a tick, and says so in a sentence."""

    tick: int
    component: str
    text: str


class Exchange(Setup):
    """A system on its vector of values, taken from instant to instant.

    Made first and initialized then (`cosim.engine.initialization`), which binds `ports`. `tick` and `phase` say where
    it stands, `ending` where a component asked it to end.
    """

    tick = 0
    phase = Phase.ARRIVED
    ending: Ending | None = None
    _stops: Sequence[SlotStop] = ()
    _check: Timed | None = None
    _engine: BoundEngine | None = None
    _effort: Sequence[LoopEffort] = ()  # of engines that were bound before

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self.base.seconds(self.tick)

    @property
    def engine(self) -> BoundEngine:
        """What executes its instants, bound to its ports."""
        if self._engine is None:
            self._engine = BoundEngine(self, self._stops, self._check)
        return self._engine

    def check_samples(self, check: Timed | None) -> None:
        """Call `check` with the time after every sample from now on; it ends the run by raising Stop."""
        self._stops, self._check = (), check
        self.forget()

    def stop_when(self, conditions: Sequence[StopCondition], read: Reader) -> None:
        """Check `conditions` after every sample from now on; `read` gives the present value of a variable.

        The engine checks them itself, unless one of them is a function or reads what is not in the values.
        """
        plain = [c for c in conditions if isinstance(c, StopWhen)]
        canonical = SystemComponents((m.name, m) for m in self.schedule.components).canonical
        known = [self.layout.readable.get(canonical(c.name)) for c in plain]
        if len(plain) < len(conditions) or None in known:
            self.check_samples(stop_check(conditions, read))
        else:
            self.check_samples(None)
            self._stops = [(c, *k) for c, k in zip(plain, known, strict=True) if k]

    def forget(self) -> None:
        """Ports, loops or checks have changed: bind the engine again."""
        self._effort, self._engine = self.loop_effort, None

    @property
    def loop_effort(self) -> Sequence[LoopEffort]:
        """What the solution of each algebraic loop has cost so far."""
        if self._engine is None:
            return self._effort
        known = {effort.unknowns: effort for effort in self._effort}
        return [e + known[e.unknowns] if e.unknowns in known else e for e in self._engine.loop_effort]

    def next_instant(self, tick: int) -> int:
        """The first tick at or after `tick` at which something is due."""
        return min(c.next(tick) for c in self.clocks)

    def last_tick(self, end: int) -> int:
        """`end`, or where a component asked to end if that is sooner."""
        return end if self.ending is None else min(end, self.ending.tick)

    # Where one instant is left and continued.

    def arrive(self) -> None:
        """Show what has been reached at the present tick, and take a provisional sample if one is due."""
        result = self.engine.instant(self.tick, self.time, arrives=True)
        if result != self.engine.AT_END:
            self.engine.raise_failure(result)
        if self.clocks[-1].due(self.tick):
            self.recorder.sample(self.time)
        self.phase = Phase.ARRIVED

    def sample(self) -> None:
        """Run the discrete components due at the present tick, and replace the provisional sample by the final one."""
        self._drop_provisional()
        self._execute(samples=True, advances=False)

    def complete(self) -> None:
        """Do what is left of the present instant."""
        if self.phase is Phase.NOTHING:
            return
        samples = self.phase is Phase.ARRIVED
        if samples:
            self._drop_provisional()
        if self._execute(samples=samples, advances=True):
            self.tick += 1
            self.phase = Phase.NOTHING

    def _drop_provisional(self) -> None:
        self.recorder.count -= self.clocks[-1].due(self.tick)
        self.phase = Phase.SAMPLED

    def set_from_outside(self) -> None:
        """Inputs or parameters are about to be set: an adaptive step that is under way ends at the present tick."""
        if self.adaptive is None:
            return
        if self.adaptive.within(self.tick) and self.phase is not Phase.NOTHING:
            result = self.engine.cut(self.tick)
            if result != self.engine.AT_END:
                self.engine.raise_failure(result)
        self.adaptive.changed()

    # Many instants.

    def run_instants(self, end: int) -> None:
        """Run all instants from the present tick, of which nothing is done, up to but not including `end`.

        It stops earlier if a component requests the end of the simulation.
        """
        engine = self.engine
        if not engine.exact_until(end):
            if self.adaptive is not None:
                raise TimeError(
                    f"ticks of {seconds_text(self.base.tick)} are too short for a run with a tolerance to"
                    f" {self.base.seconds(end):.9g} s: give steps that divide each other better"
                )
            self._run_exactly(end)
            return
        while self.tick < end:
            try:
                result = engine.run(self.tick, end)
            finally:
                self.tick = engine.tick
            if result not in (engine.AT_END, engine.FULL):
                if self._resume(*self._after_failure(result)):
                    self.tick += 1
                return

    def _run_exactly(self, end: int) -> None:
        """As `run_instants`, where times are quotients of integers that doubles do not hold."""
        ending = self.ending
        while (tick := self.next_instant(self.tick)) < end:
            self.tick = tick
            if not self._execute(arrives=True, samples=True, advances=True):
                return
            self.tick += 1
            if self.ending != ending:
                return
        self.tick = end

    def run_instants_to(self, tick: int) -> None:
        """To `tick`, of which nothing is done yet: what is left of the present instant, then all instants before it."""
        if tick > self.tick:
            self.complete()
            self.run_instants(tick)
        self.phase = Phase.NOTHING

    def step_to(self, end: int) -> None:
        """Advance to the arrival at `end`: `complete`, `run_instants` and `arrive`, for loops that step by hand.

        If there are no previous values, the present instant is repeated from its beginning instead of completed: its
        arrival gives the same values.
        """
        if self.tick >= self.last_tick(end) and self.phase is not Phase.NOTHING:
            return
        if self.phase is Phase.ARRIVED and not self.layout.previous and not self.layout.sample_times:
            self.recorder.count -= self.clocks[-1].due(self.tick)  # the provisional sample
            self.phase = Phase.NOTHING
        else:
            self.complete()
        while self.phase is Phase.NOTHING and self.tick < self.last_tick(end):
            self.run_instants(self.last_tick(end))
        if self.phase is Phase.NOTHING:
            self.arrive()

    # What the engine comes back with.

    def _execute(self, *, arrives: bool = False, samples: bool, advances: bool) -> bool:
        """Parts of the present instant; returns whether continuous components have advanced."""
        result = self.engine.instant(self.tick, self.time, arrives=arrives, samples=samples, advances=advances)
        if result == self.engine.AT_END:
            return advances
        samples, may_advance = self._after_failure(result)
        return self._resume(samples, advances and may_advance)

    def _resume(self, samples: bool, advances: bool) -> bool:
        """The rest of an instant in which a component has asked for the end; returns as `_execute`."""
        while samples or advances:
            result = self.engine.instant(self.tick, self.time, resumed=True, samples=samples, advances=advances)
            if result == self.engine.AT_END:
                return advances
            samples, may_advance = self._after_failure(result)
            advances = advances and may_advance
        return False

    def _after_failure(self, result: int) -> tuple[bool, bool]:
        """Raise what has ended the run.

        After a component's request to end the simulation, return what is left of the instant instead: the sample, and
        the advance of continuous components. A request whose step was done ends it at the end of that step.
        """
        try:
            self.engine.raise_failure(result)
        except Stop:
            self.phase = Phase.SAMPLED
            raise
        except EndRequested as request:
            component = next(m for m in self.schedule.components if m.name == request.component)
            ticks = self.base.count(component.step)
            if self.adaptive is not None and not component.discrete:
                ticks = self.adaptive.ticks
            ending = Ending(self.tick + ticks * request.complete, request.component, str(request))
            self.ending = ending if self.ending is None else min(self.ending, ending)
            if not request.complete:
                self.phase = Phase.SAMPLED
            return component.discrete, request.complete
        raise AssertionError(f"the engine came back with {result}")
