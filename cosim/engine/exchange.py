"""The master algorithm: how components exchange values, instant by instant.

The rule. Time is an integer count of base ticks. At every instant t at which something is due:

1. Arrival. Continuous components whose step ends at t show the outputs they reached.
2. Discrete components that are due run in topological order of direct feed-through: each reads its inputs as they
   stand now, is stepped from t to its next sample, and its outputs are used from t on.
3. The recorder takes its sample if it is due, and the stop conditions are looked at. A recording at t therefore
   shows plant outputs at t together with the controllers' new outputs at t.
4. Continuous components that are due advance from t to t + step with inputs as of t. What they reach stays hidden
   until t + step: that is the Jacobi exchange, and it needs no order. In a Gauss-Seidel group, components see at once
   what the components before them have reached (their latest step, if they are slower).

`System.run` ends with part 3 at its stop time: its last row is the row that a longer run has at that time.
`Simulation.advance` ends with part 1 and a provisional sample, so that inputs can be set before discrete components
run; if the simulation is continued, the instant is completed first and its sample replaced: advancing in pieces gives
what advancing in one go gives. Nothing is shortened to meet the stop time: a step that reaches beyond it was begun
before it, and shows its outputs when its end is reached.

A component may ask to end the simulation. When its step was done the run ends at the end of that step, with an arrival
and a last sample (no component runs there); otherwise at its beginning, with the sample there and nobody advanced
further.

No component ever reads a NaN or an infinity that another one has made: outputs are looked at as soon as they are there,
and the first that is not finite ends the run (unless `allow_nan`).

A delayed connection delivers what the source showed before its latest step (discrete: its latest run).

All values lie in one vector of floats. An FMU reads its outputs into its slice of it and its inputs come from it
with one indexed copy; the master does no Python work per variable and step.
"""

from __future__ import annotations

import enum
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from cosim.core.component import EndRequested, Ports
from cosim.core.description import Variable
from cosim.core.time import TimeBase
from cosim.engine.recorder import Recorder
from cosim.engine.stops import Reader, Stop, StopCondition, stop_check
from cosim.engine.timetable import Clock, Timetable
from cosim.engine.values import Layout, Timed, make_layout
from cosim.system.components import SystemComponent
from cosim.system.schedule import Schedule


@dataclass
class Instant:
    """What happens at an instant, in three parts: 1; 2 and 3; 4 of the rule above. `recorded`: it has a sample."""

    arrive: tuple[Timed, ...]
    sample: tuple[Timed, ...]
    advance: tuple[Timed, ...]
    recorded: bool

    def __post_init__(self) -> None:
        self.whole = self.arrive + self.sample + self.advance


class Phase(enum.Enum):
    """How much of the present instant is done."""

    NOTHING = 0
    ARRIVED = 1  # arrival, and a provisional sample if one is due
    SAMPLED = 2  # all but the continuous components


class Exchange:
    """The components of a schedule on the vector of values, taken from instant to instant.

    Made first and initialized then (`cosim.engine.initialization`), which binds `ports`. `tick` and `phase` say where
    it stands; `ending` is the tick at which a component asked it to end, and why.
    """

    def __init__(
        self,
        schedule: Schedule,
        start: Fraction = Fraction(0),
        *,
        record: Sequence[tuple[SystemComponent, Variable]] = (),
        watch: Sequence[tuple[SystemComponent, Variable]] = (),
        interval: Fraction | None = None,
        allow_nan: bool = False,
    ):
        """`interval` [s] is that of the recorder, a multiple of the schedule's tick; default: the smallest step."""
        self.schedule = schedule
        self.allow_nan = allow_nan
        self.base: TimeBase = schedule.time_base(start)
        self.layout: Layout = make_layout(schedule, record, watch)
        self.values = self.layout.values
        self.recorder = Recorder(self.values, self.layout.record_index, *self.layout.record_conversion)
        self.ports: dict[SystemComponent, Ports] = {}
        self.tick = 0
        self.phase = Phase.ARRIVED
        self.ending: tuple[int, str] | None = None
        self._check: Timed | None = None
        if interval is None:
            interval = min(m.step for m in schedule.components)
        self._step_of: dict[SystemComponent, Timed] = {}
        self.clocks = (  # of the components, then the recorder's
            *(Clock(self.base.count(m.step), self.base.count(m.offset)) for m in schedule.components),
            Clock(self.base.count(interval), 0),
        )
        self.timetable = Timetable(self.clocks, self._compile)

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self.base.seconds(self.tick)

    def check_samples(self, check: Timed | None) -> None:
        """Call `check` with the time after every sample from now on; it ends the run by raising Stop."""
        self._check = check
        self.forget()

    def stop_when(self, conditions: Sequence[StopCondition], read: Reader) -> None:
        """Look at `conditions` after every sample from now on; `read` gives the present value of a variable."""
        self.check_samples(stop_check(conditions, read))

    def forget(self) -> None:
        """Ports or checks have changed: work out all instants again."""
        self._step_of.clear()
        self.timetable.forget()

    # One instant.

    def _compile(self, due: frozenset[int]) -> Instant:
        """The instant at which the clocks numbered `due` are due."""
        components = [m for i, m in enumerate(self.schedule.components) if i in due]
        recording = len(self.clocks) - 1 in due
        arrive = self.layout.arrival(components)
        discrete = self._steps([m for m in components if m.discrete])
        sample = [self.recorder.sample] if recording else []
        check = [] if self._check is None else [self._check]
        continuous = self._steps([m for m in components if not m.discrete])
        return Instant(tuple(arrive), (*discrete, *sample, *check), tuple(continuous), recording)

    def _steps(self, components: Sequence[SystemComponent]) -> list[Timed]:
        """Steps of components in their order, each followed by a check of its outputs before any component reads them.

        Components that advance side by side read nothing from each other, so they are checked together.
        """
        if self.allow_nan:
            return [self._step(m) for m in components]
        seidel = {m for group in self.schedule.groups if group.method == "gauss-seidel" for m in group.components}
        acts: list[Timed] = []
        together: list[SystemComponent] = []
        for m, following in itertools.zip_longest(components, components[1:]):
            acts.append(self._step(m))
            together.append(m)
            if m.discrete or following is None or following in seidel:
                acts += self.layout.finite_checks(together)
                together = []
        return acts

    def _step(self, component: SystemComponent) -> Timed:
        """One communication step of a component: inputs as they stand, doStep, outputs."""
        if component not in self._step_of:
            self._step_of[component] = self._make_step(component)
        return self._step_of[component]

    def _make_step(self, component: SystemComponent) -> Timed:
        run, h, port = self.ports[component].run, float(component.step), self.layout.ports[component]
        take, index, u = self.values.take, port.index, port.u
        gather = self.layout.gather(component)

        def without_inputs(t: float) -> None:
            run(t, h)

        def plain(t: float) -> None:
            take(index, 0, u, "clip")
            run(t, h)

        def converted(t: float) -> None:
            gather(t)
            run(t, h)

        return without_inputs if port.in_place else plain if port.plain else converted

    # Many instants.

    def last_tick(self, end: int) -> int:
        """`end`, or where a component asked to end if that is sooner."""
        return end if self.ending is None else min(end, self.ending[0])

    def sample(self) -> bool:
        """Run the discrete components due at the present tick, and replace the provisional sample by the final one.

        Returns whether continuous components may advance.
        """
        instant, t = self.timetable.at(self.tick), self.time
        self.recorder.count -= instant.recorded  # the provisional sample
        self.phase = Phase.SAMPLED
        return self._finish(instant.sample, 0, t)

    def complete(self) -> None:
        """Do what is left of the present instant."""
        if self.phase is Phase.NOTHING or (self.phase is Phase.ARRIVED and not self.sample()):
            return
        advance = self.timetable.at(self.tick).advance
        if self._finish(advance, len(advance), self.time):
            self.tick += 1
            self.phase = Phase.NOTHING

    def run_instants(self, end: int) -> None:
        """The hot loop: run all instants from the present tick up to but not including `end`.

        It stops earlier if a component requests the end of the simulation.
        """
        a, b, d = self.base.integers()
        tick = self.tick
        try:
            for tick, instant in self.timetable.instants(tick, end):  # noqa: B020
                t = (tick * a + b) / d
                for act in (rest := iter(instant.whole)):
                    act(t)
            tick = end
        except Stop:
            self.phase = Phase.SAMPLED  # stop conditions are looked at after the sample
            raise
        except EndRequested as request:
            self.tick = tick
            if self._end_requested(request, tuple(rest), len(instant.advance), t):
                tick += 1
        finally:
            self.tick = tick

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
        if self.phase is Phase.ARRIVED and not self.layout.previous and not self.layout.sample_times:
            self.recorder.count -= self.clocks[-1].due(self.tick)  # the provisional sample
            self.phase = Phase.NOTHING
        else:
            self.complete()
        self.run_instants(self.last_tick(end))
        if self.phase is Phase.NOTHING:
            self.arrive()

    def _end_requested(self, request: EndRequested, rest: tuple[Timed, ...], advances: int, t: float) -> bool:
        """Handle the request of a component to end the simulation at the present tick.

        Returns whether the instant is done. `rest` is the remaining work of the instant; its last `advances` entries
        are steps of continuous components. Sets the time of the end.
        """
        step = next(self.base.count(m.step) for m in self.schedule.components if m.name == request.component)
        ending = self.tick + step * request.complete, str(request)
        self.ending = ending if self.ending is None else min(self.ending, ending)
        if not request.complete:
            self.phase = Phase.SAMPLED
            rest, advances = rest[: max(0, len(rest) - advances)], 0
        return self._finish(rest, advances, t) and request.complete

    def _finish(self, rest: tuple[Timed, ...], advances: int, t: float) -> bool:
        """Do the rest of an instant; returns whether it is done."""
        acts = iter(rest)
        try:
            for act in acts:
                act(t)
        except EndRequested as request:
            return self._end_requested(request, tuple(acts), advances, t)
        return True

    def arrive(self) -> None:
        """Show what has been reached at the present tick, and take a provisional sample if one is due."""
        instant, t = self.timetable.at(self.tick), self.time
        for act in instant.arrive:
            act(t)
        if instant.recorded:
            self.recorder.sample(t)
        self.phase = Phase.ARRIVED
