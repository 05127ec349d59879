"""The master algorithm: how components exchange values, instant by instant.

The rule. Time is an integer count of base ticks. At every instant t at which something is due:

1. Arrival. Continuous components whose step ends at t show the outputs they reached.
2. Discrete components that are due run in topological order of direct feed-through: each reads its inputs as they
   stand now, is stepped from t to its next sample, and its outputs are used from t on.
3. The recorder takes its sample if it is due, and the stop conditions are looked at. A recording at t therefore
   shows plant outputs at t together with the controllers' new outputs at t.
4. Continuous components that are due advance from t to t + step with inputs as of t. What they reach stays hidden
   until t + step: that is the Jacobi exchange, and it needs no order. In a Gauss-Seidel group, members see at once
   what the members before them have reached (their latest step, if they are slower).

A run ends at its stop time with an arrival and a last sample; discrete components are not run there, so their
outputs are still those of the sample before. If the simulation is continued, the instant is completed first and its
sample replaced: advancing in pieces gives what advancing in one go gives. Nothing is shortened to meet the stop
time: a step that reaches beyond it was begun before it, and shows its outputs when its end is reached.

A component may ask to end the simulation. When its step was done the run ends at the end of that step, as if that were
the stop time; otherwise at its beginning, with the sample there and nobody advanced further.

No component ever reads a NaN or an infinity that another one has made: outputs are looked at as soon as they are there,
and the first that is not finite ends the run (unless `allow_nan`).

A delayed connection delivers what the source showed before its latest step (discrete: its latest run).

All values lie in one vector of floats. An FMU reads its outputs into its slice of it and its inputs come from it
with one indexed copy; the master does no Python work per variable and step.
"""

from __future__ import annotations

import enum
import itertools
import time as clock
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.component import Action, Array, EndRequested, Ports
from cosim.errors import (
    CallFailed,
    ComponentError,
    CosimError,
    Interrupted,
    NotFinite,
    TimeError,
    UnconnectedInputsWarning,
    WiringError,
    did_you_mean,
)
from cosim.progress import HeldInterrupt, ProgressBar
from cosim.recording import Recorder, Recording
from cosim.schedule import Schedule
from cosim.stops import COMPARE, Stop, StopCondition, StopWhen, View
from cosim.timebase import TimeBase, TimeLike, positive, rational
from cosim.timetable import Clock, Timetable
from cosim.values import Layout, make_layout

if TYPE_CHECKING:
    from cosim.description import Variable
    from cosim.members import Member
    from cosim.system import System

Timed = Callable[[float], None]


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


@dataclass
class SystemState:
    """A saved state of a simulation at `time` [s]. Give it to `Simulation.restore` of the same simulation, or to
    `System.initialize(state=...)` of the same system after changing its wiring; any number of times."""

    tick: int
    phase: Phase
    values: Array
    inputs: dict[str, Array]
    components: dict[str, Any]
    samples: int
    owner: Simulation
    ending: tuple[int, str] | None = None

    @property
    def time(self) -> float:
        return self.owner._base.seconds(self.tick)


class Simulation:
    """A system that is being stepped. Made by `System.initialize`; see `System.run` for whole runs.

        simulation = system.initialize(record=["car.*"])
        simulation.advance(2.0)
        state = simulation.save()
        simulation.advance(3.0)
        simulation.restore(state)

    `time` [s] is where it stands, `recording` what was recorded so far.
    """

    def __init__(
        self,
        system: System,
        start_time: TimeLike = 0,
        *,
        record: str | Iterable[str] | None = None,
        record_interval: TimeLike | None = None,
        watch: Iterable[str] = (),
        stop_time: TimeLike | None = None,
        state: SystemState | None = None,
        allow_nan: bool = False,
    ):
        self._over: str | None = None  # why it cannot be continued
        self._ending: tuple[int, str] | None = None  # a component asked to end it: at which tick, and why
        self._terminated = False
        self._allow_nan = allow_nan
        start = rational(start_time, "start_time") if state is None else state.owner._base.exact(state.tick)
        interval = None if record_interval is None else positive(record_interval, "record_interval")
        self.schedule: Schedule = system.schedule(*([interval] if interval else []))
        if interval is None:
            interval = min(m.step for m in self.schedule.members)
        if self.schedule.unconnected:
            listed = ", ".join(self.schedule.unconnected[:10])
            more = f" and {len(self.schedule.unconnected) - 10} more" if len(self.schedule.unconnected) > 10 else ""
            text = f"unconnected inputs keep their start values: {listed}{more}"
            warnings.warn(text, UnconnectedInputsWarning, stacklevel=4)
        self.system = system
        self._base: TimeBase = self.schedule.time_base(start)
        self._layout: Layout = make_layout(self.schedule, system.select(record), self._watched(system, watch))
        self._values = self._layout.values
        self._stops: list[StopCondition] = []
        self._view = View(self)
        self._tick = 0
        self._phase = Phase.ARRIVED
        self._stopped_by: str | None = None
        self._wall_time = 0.0
        self._recorder = Recorder(self._values, self._layout.record_index, *self._layout.record_conversion)
        self._clocks = [Clock(self._base.count(m.step), self._base.count(m.offset)) for m in self.schedule.members] + [
            Clock(self._base.count(interval), 0)
        ]
        stop = None if stop_time is None else rational(stop_time, "stop_time")
        self._guarded(lambda: self._initialize(stop, state))
        self._timetable = Timetable(self._clocks, self._compile)
        self._recorder.sample(self.time)

    @staticmethod
    def _watched(system: System, names: Iterable[str]) -> list[tuple[Member, Variable]]:
        return [pair for name in names for pair in system.select([name])]

    # Where it stands.

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self._base.seconds(self._tick)

    @property
    def finished(self) -> bool:
        """It was closed, or ended by a failure or by a component that asked for it."""
        return self._over is not None

    @property
    def time_ns(self) -> int:
        """Present time, rounded to integer nanoseconds."""
        return self._base.nanoseconds(self._tick)

    def __getitem__(self, name: str) -> float:
        """Present value of a recorded or watched variable."""
        try:
            slot, scale, offset = self._layout.readable[self.system.canonical(name)]
        except KeyError:
            hint = did_you_mean(name, self._layout.readable) or "; name it in record=[...] or watch=[...]"
            raise KeyError(f"'{name}' is not read by this simulation{hint}") from None
        return scale * self._values.item(slot) + offset

    def set(self, name: str, value: Any) -> None:
        """Change a tunable parameter or an unconnected input, effective from the next step on."""
        member, variable = self.system._split(name)
        if driven := self.system.connections.get(self.system.canonical(name)):
            raise WiringError(f"{name} is driven by {driven.source_name}")
        values = {member.description.find(n, member.name): v for n, v in member._expand(variable, value).items()}
        if any(v.causality != "input" and v.variability != "tunable" for v in values):
            raise WiringError(
                f"{name} is fixed while the simulation runs: set it with system['{member.name}'].set(...) before it"
            )
        self._guarded(lambda: member.component.set(values))
        for changed, number in values.items():
            slot = self._layout.constants.get((member.name, changed.name))
            if slot is not None:
                self._values[slot] = number

    @property
    def recording(self) -> Recording:
        """A copy of everything recorded so far."""
        names, units = self._layout.record_names, self._layout.record_units
        result = self._recorder.recording(names, units)
        result.stopped_by, result.wall_time = self._stopped_by, self._wall_time
        result.aliases = self._layout.aliases
        return result

    # Initialization.

    def _initialize(self, stop: Fraction | None, state: SystemState | None) -> None:
        """All components into initialization mode; inputs and outputs settle; out of it again. Components that are in
        `state` continue from there, and the others settle to them."""
        members = self.schedule.members
        restored = [] if state is None else self._continued(state)
        for m in members:
            m.component.instantiate(m.name)
            if m.values:
                m.component.set({m.description.variables[n]: v for n, v in m.values.items()})
        for m in members:
            begin = self._base.start + m.offset
            met = stop is not None and stop > begin and ((stop - begin) / m.step).denominator == 1
            m.component.enter_initialization(float(begin), float(stop) if stop is not None and met else None)
        self._ports: dict[Member, Ports] = {}
        for m in members:
            place = self._layout.places[m]
            self._ports[m] = m.component.bind(place.inputs, place.outputs, place.u, place.y)
        for (name, variable), slot in self._layout.constants.items():
            member = self.system[name]
            self._values[slot] = float(member.component.get([member.description.variables[variable]])[0])
        for m in restored:
            m.component.exit_initialization()
            m.component.restore(state.components[m.name])  # type: ignore[union-attr]
            self._ports[m].get_outputs()
        self._layout.show_everything()
        fresh = [m for m in members if m not in restored]
        self._settle(fresh)
        self._check_constants(fresh)
        for m in fresh:
            m.component.exit_initialization()
            self._ports[m].get_outputs()
        self._layout.show_everything()
        self._check_initial_values()
        if state is not None:
            self._layout.take_previous(state.owner._layout, state.values)

    def _check_initial_values(self) -> None:
        if self._allow_nan:
            return
        culprit = self._layout.not_finite(self.schedule.members)
        for (member, variable), slot in self._layout.constants.items():
            if culprit is None and not np.isfinite(self._values[slot]):
                culprit = NotFinite(member, variable, float(self._values[slot]))
        if culprit is not None:
            raise culprit

    def _continued(self, state: SystemState) -> list[Member]:
        """The members that are in a saved state, checked to be at the end of a step there."""
        owner = state.owner
        if owner.system is not self.system:
            raise CosimError("this state was saved in another system; FMU states belong to their instances")
        if state.phase is not Phase.ARRIVED:
            raise CosimError("this state was saved at a stop condition; save it after an advance that reached its time")
        restored = [m for m in self.schedule.members if m in owner.schedule.members and m.name in state.components]
        for m in restored:
            clock_ = Clock(owner._base.count(m.step), owner._base.count(m.offset))
            if m.offset or not clock_.due(state.tick):
                raise CosimError(
                    f"'{m.name}' is within a step (or has an offset) at t = {state.time:.9g} s: save the state at a "
                    "common multiple of all steps"
                )
        return restored

    def _settle(self, members: Sequence[Member]) -> None:
        """Pass outputs to inputs, in order of execution, until nothing changes any more, but for rounding."""
        gather = {m: self._layout.gather(m) for m in members}
        for _ in range(20 + len(members)):
            before = self._values.copy()
            for m in members:
                gather[m](0.0)
                self._ports[m].set_inputs()
                self._ports[m].get_outputs()
                self._layout.show_everything()
            with np.errstate(invalid="ignore"):
                moved = np.abs(self._values - before) > 1e-12 * np.maximum(1.0, np.abs(before))
            if not moved.any():
                return
        names = [n for n, (slot, _, _) in self._layout.readable.items() if moved[slot]]
        warnings.warn(
            f"initial values do not settle, there is a loop among them: {', '.join(names[:10])}", stacklevel=6
        )

    def _check_constants(self, members: Sequence[Member]) -> None:
        """Refuse sources that do not have the constant which an input must equal, where only now they show it."""
        for m in members:
            place = self._layout.places[m]
            for variable, value in zip(place.inputs, place.u, strict=True):
                if not variable.accepts(float(value)):
                    connection = self.system.connections[f"{m.name}.{variable.name}"]
                    raise WiringError(f"{connection}: the input {variable.refusal(float(value))}")

    # One instant.

    def _compile(self, due: frozenset[int]) -> Instant:
        """The instant at which the clocks numbered `due` are due."""
        members = [m for i, m in enumerate(self.schedule.members) if i in due]
        recording = len(self._clocks) - 1 in due
        arrive = self._layout.arrival(members)
        discrete = self._steps([m for m in members if m.discrete])
        sample = [self._recorder.sample] if recording else []
        stops = [self._check_stops] if self._stops else []
        continuous = self._steps([m for m in members if not m.discrete])
        return Instant(tuple(arrive), (*discrete, *sample, *stops), tuple(continuous), recording)

    def _steps(self, members: Sequence[Member]) -> list[Timed]:
        """The steps of components in their order, each followed by a look at its outputs before anybody reads them.
        Components that advance side by side read nothing of each other: they are looked at together."""
        if self._allow_nan:
            return [self._step(m) for m in members]
        seidel = {m for group in self.schedule.groups if group.method == "gauss-seidel" for m in group.members}
        acts: list[Timed] = []
        together: list[Member] = []
        for m, following in itertools.zip_longest(members, members[1:]):
            acts.append(self._step(m))
            together.append(m)
            if m.discrete or following is None or following in seidel:
                acts += self._layout.finite_checks(together)
                together = []
        return acts

    def _step(self, member: Member) -> Timed:
        """One communication step of a component: inputs as they stand, doStep, outputs."""
        run, h, place = self._ports[member].run, float(member.step), self._layout.places[member]
        take, index, u = self._values.take, place.index, place.u
        gather = self._layout.gather(member)

        def without_inputs(t: float) -> None:
            run(t, h)

        def plain(t: float) -> None:
            take(index, 0, u, "clip")
            run(t, h)

        def converted(t: float) -> None:
            gather(t)
            run(t, h)

        return without_inputs if place.in_place else plain if place.plain else converted

    def _check_stops(self, t: float) -> None:
        self._view.time = t
        for condition in self._stops:
            if isinstance(condition, StopWhen):
                if COMPARE[condition.relation](self[condition.name], condition.value):
                    raise Stop(str(condition))
            elif condition(self._view):
                raise Stop(getattr(condition, "__name__", repr(condition)))

    # Many instants.

    def advance(
        self, until: TimeLike, *, stop_when: Sequence[StopCondition] = (), progress: bool = False
    ) -> str | None:
        """Run to the first base tick at or after `until` [s], to the first instant that fulfils one of `stop_when`, or to
        where a component asks to end (the simulation is over then). Returns the text of that condition or request, or
        None. Raises ComponentError (the simulation is over then) and Interrupted (it stands between two instants and can
        be continued)."""
        end = self._base.at_or_after(rational(until, "until"))
        if end < self._tick:
            raise TimeError(f"cannot advance to {until} s: the simulation stands at {self.time:.9g} s")
        if list(stop_when) != self._stops:
            self._stops = list(stop_when)
            self._timetable.forget()
        self._stopped_by = None
        begin = clock.perf_counter()
        try:
            with HeldInterrupt() as interrupt, ProgressBar(progress, self.time, self._base.seconds(end)) as bar:
                self._guarded(lambda: self._run(end, interrupt, bar))
        except Stop as stop:
            self._stopped_by = str(stop)
        finally:
            self._wall_time += clock.perf_counter() - begin
        return self._stopped_by

    def _run(self, end: int, interrupt: HeldInterrupt, bar: ProgressBar) -> None:
        """To the arrival at `end`, in pieces of about a twentieth of a second: that keeps Ctrl-C and the progress bar
        alive at no cost per instant."""
        if self._tick == end and self._phase is not Phase.NOTHING:
            return
        self._complete()
        piece = 1
        while self._tick < self._last_tick(end) and not interrupt.pending:
            begin = clock.perf_counter()
            self._run_instants(min(self._last_tick(end), self._tick + piece))
            took = clock.perf_counter() - begin
            piece = max(1, min(4 * piece, int(0.05 * piece / max(took, 1e-9))))
            bar.at(self.time)
        if self._phase is Phase.NOTHING:
            self._arrive()
        if self._ending is not None and self._tick >= self._ending[0]:
            self._over = self._ending[1]
            raise Stop(self._over)
        if interrupt.pending:
            raise Interrupted(self.time, self.recording)

    def _last_tick(self, end: int) -> int:
        return end if self._ending is None else min(end, self._ending[0])

    def _complete(self) -> None:
        """Do what is left of the present instant."""
        if self._phase is Phase.NOTHING:
            return
        instant, t = self._timetable.at(self._tick), self.time
        if self._phase is Phase.ARRIVED:
            self._recorder.count -= instant.recorded  # the provisional sample
            self._phase = Phase.SAMPLED
            rest = instant.sample + instant.advance
        else:
            rest = instant.advance
        if self._finish(rest, len(instant.advance), t):
            self._tick += 1
            self._phase = Phase.NOTHING

    def _run_instants(self, end: int) -> None:
        """All instants from the present tick up to but not including `end`, or to where a component asks to end: the
        hot loop."""
        a, b, d = self._base.integers()
        tick = self._tick
        try:
            for tick, instant in self._timetable.instants(tick, end):  # noqa: B020
                t = (tick * a + b) / d
                for act in (rest := iter(instant.whole)):
                    act(t)
            tick = end
        except Stop:
            self._phase = Phase.SAMPLED  # stop conditions are looked at after the sample
            raise
        except EndRequested as request:
            self._tick = tick
            if self._end_requested(request, tuple(rest), len(instant.advance), t):
                tick += 1
        finally:
            self._tick = tick

    def _end_requested(self, request: EndRequested, rest: tuple[Timed, ...], advances: int, t: float) -> bool:
        """A component asked to end the simulation at the present tick; `rest` is what was still to be done there, its last
        `advances` are steps of continuous components. Sets when it ends; returns whether the instant is done."""
        step = self._base.count(self.system[request.component].step)
        ending = self._tick + step * request.complete, str(request)
        self._ending = ending if self._ending is None else min(self._ending, ending)
        if not request.complete:
            self._phase = Phase.SAMPLED
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

    def _arrive(self) -> None:
        """Show what has been reached at the present tick, and take a provisional sample if one is due."""
        instant, t = self._timetable.at(self._tick), self.time
        for act in instant.arrive:
            act(t)
        if instant.recorded:
            self._recorder.sample(t)
        self._phase = Phase.ARRIVED

    def _guarded(self, work: Action) -> None:
        """Do something with components. A failure ends the simulation and carries what was recorded."""
        if self._over:
            raise CosimError(f"this simulation cannot be continued: {self._over}")
        try:
            work()
        except CallFailed as failure:
            self._over = "a component failed"
            recording = self.recording if self._recorder.count else None
            raise ComponentError(self._origin(failure), self.time, recording) from failure
        except Interrupted:
            raise
        except KeyboardInterrupt:
            self._over = "it was interrupted within an instant"
            raise Interrupted(self.time, self.recording) from None
        except Stop:
            raise
        except BaseException:
            self._over = "an error occurred"
            raise

    def _origin(self, failure: CallFailed) -> CallFailed:
        """A component that cannot take a NaN is not to blame for it. Only initialization hands such values on."""
        if self._allow_nan or isinstance(failure, NotFinite):
            return failure
        return self._layout.not_finite(self.schedule.members) or failure

    # Saved states.

    def save(self) -> SystemState:
        """A copy of the whole state: components, exchanged values, time and length of the recording. Raises CosimError
        naming the components that cannot save their state."""
        unable = [m.name for m in self.schedule.members if not m.component.description.can_save]
        if unable:
            raise CosimError(
                f"cannot save the state of {', '.join(unable)}: the FMU does not offer it "
                "(canGetAndSetFMUState); run again from the start instead"
            )
        components: dict[str, Any] = {}

        def save() -> None:
            components.update((m.name, m.component.save()) for m in self.schedule.members)

        self._guarded(save)
        inputs = {m.name: p.u.copy() for m, p in self._layout.places.items()}
        return SystemState(
            self._tick, self._phase, self._values.copy(), inputs, components, self._recorder.count, self, self._ending
        )

    def restore(self, state: SystemState) -> None:
        """Go back to a saved state of this simulation; samples recorded after it are dropped."""
        if state.owner is not self:
            raise CosimError("this state was saved by another simulation: use System.initialize(state=...)")

        def restore() -> None:
            for m in self.schedule.members:
                m.component.restore(state.components[m.name])

        self._guarded(restore)
        self._tick, self._phase, self._ending = state.tick, state.phase, state.ending
        self._values[:] = state.values
        for m, place in self._layout.places.items():
            place.u[:] = state.inputs[m.name]
        self._recorder.count = state.samples

    def forget(self, state: SystemState) -> None:
        """Free a saved state; it cannot be restored any more."""
        for m in self.schedule.members:
            if m.name in state.components:
                m.component.forget(state.components.pop(m.name))

    # The end.

    def close(self) -> None:
        """Terminate the components. They can be initialized again by `System.initialize`."""
        if self._terminated:
            return
        self._terminated = True
        if self._over is None or self._ending is not None:
            for m in self.schedule.members:
                m.component.terminate()
        self._over = self._over or "it is closed"

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
