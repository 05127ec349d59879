"""A system while it is being stepped: where it stands, its recording, its saved states."""

from __future__ import annotations

import math
import threading
import time as clock
import warnings
import weakref
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from fractions import Fraction
from functools import cached_property
from types import TracebackType
from typing import Any

import numpy as np

from build_fmus.base import surface
from build_fmus.base.checks import did_you_mean
from cosim.core.component import Action, Array
from cosim.core.description import TEXTS, Variable
from cosim.core.errors import (
    CallFailed,
    ComponentError,
    CosimError,
    Interrupted,
    LoopNotSolved,
    NotFinite,
    TimeError,
    WiringError,
)
from cosim.core.interrupt import HeldInterrupt, held
from cosim.core.real_time import Pace, RealTime
from cosim.core.time import TimeLike, gcd, positive, rational
from cosim.engine.adaptive import State as AdaptiveState
from cosim.engine.exchange import Exchange, Phase
from cosim.engine.initialization import initialize
from cosim.engine.plan import LOOP_TOLERANCE
from cosim.engine.progress import ProgressBar
from cosim.engine.saving import EngineStatePool
from cosim.engine.state import SystemState, Wiring, wiring_of
from cosim.engine.stops import Stop, StopCondition
from cosim.engine.values import EXACT
from cosim.fmu.saved_states import SavedStates
from cosim.recording.recording import Recording
from cosim.recording.spool import Spool
from cosim.system.components import Connection, SystemComponent, article
from cosim.system.names import SystemComponents
from cosim.system.schedule import Schedule

_SHOWN = 0.05  # s between looks at the progress bar and the spool in a paced run


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
        schedule: Schedule,
        start_time: TimeLike = 0,
        *,
        record: Sequence[tuple[SystemComponent, Variable]] = (),
        record_interval: Fraction | None = None,
        watch: Sequence[tuple[SystemComponent, Variable]] = (),
        stop_time: TimeLike | None = None,
        state: SystemState | None = None,
        allow_nan: bool = False,
        loop_tolerance: float = LOOP_TOLERANCE,
        tolerance: float | None = None,
        lock: AbstractContextManager[Any] | None = None,
    ):
        """The schedule's tick must divide `record_interval` [s]; the rest is as in `System.initialize`.

        `lock`: a reentrant lock for calls of the components.
        """
        start = rational(start_time, "start_time")
        if state is not None and (tolerance is not None or state.steps is not None):
            raise CosimError(
                "a run with a tolerance does not continue from a state of another simulation, and its states belong to"
                " it: use Simulation.save and Simulation.restore, or leave the tolerance out"
            )
        if state is not None:
            start = state.base.exact(state.tick)
            if state.continues(schedule):
                schedule = replace(schedule, tick=gcd([schedule.tick, start - state.base.start]))
                start = state.base.start
        self._stop_time = None if stop_time is None else rational(stop_time, "stop_time")
        self.schedule = schedule
        self._components = SystemComponents((m.name, m) for m in schedule.components)
        self._exchange = Exchange(
            schedule,
            start,
            record=record,
            watch=watch,
            interval=record_interval,
            allow_nan=allow_nan,
            loop_tolerance=loop_tolerance,
            tolerance=tolerance,
        )
        self._layout = self._exchange.layout
        self._lock = threading.RLock() if lock is None else lock
        self._over: str | None = None  # why it cannot be continued
        self._terminated = False
        self._stops: list[StopCondition] = []
        self._stopped_by: str | None = None
        self._wall_time = 0.0
        self._pace: Pace | None = None
        self._kept_pace: RealTime | None = None
        self._spool: Spool | None = None
        self._rounded: set[str] = set()  # integers that were said to be rounded
        self._initialize(state)

    def _initialize(self, state: SystemState | None = None) -> None:
        self.guarded(lambda: initialize(self._exchange, self._stop_time, state))
        if self._exchange.clocks[-1].due(self._exchange.tick):
            self._exchange.recorder.sample(self.time)
        if state is None and self._exchange.ending is not None:  # in a first event iteration: the run ends here
            with suppress(Stop):
                self.guarded(self._exchange.sample)

    def restart(self) -> None:
        """Reset and initialize all components with the values that they have now, as for a simulation of its own.

        It takes a fraction of the time. Saved states and what was recorded are gone.
        """
        self._over, self._terminated, self._exchange.recorder.count = None, False, 0
        self._initialize()

    # Where it stands.

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self._exchange.time

    @property
    def finished(self) -> bool:
        """It was closed, or ended by a failure or by a component that asked for it."""
        return self._over is not None

    @property
    def time_ns(self) -> int:
        """Present time, rounded to integer nanoseconds."""
        return self._exchange.base.nanoseconds(self._exchange.tick)

    def __getitem__(self, name: str) -> float:
        """Present value of a recorded or watched variable."""
        try:
            slot, scale, offset = self._layout.readable[self._components.canonical(name)]
        except KeyError:
            hint = did_you_mean(name, self._layout.readable) or "; name it in record=[...] or Record(watch=[...])"
            raise KeyError(f"'{name}' is not read by this simulation{hint}") from None
        value = self._exchange.values.item(slot)
        return value if (scale, offset) == (1.0, 0.0) else scale * value + offset  # which would make 0.0 of -0.0

    def text(self, name: str) -> str | bytes:
        """Present value of a String or Binary, as its component has it, which may be ahead of what others see.

        Raises WiringError for other variables.
        """
        component, variable = self._components.split(name)
        found = component.description.find(variable, component.name)
        if found.fmi_type not in TEXTS:
            raise WiringError(f"{name} is {article(found.fmi_type)}, not a String or Binary: read simulation['{name}']")
        value: list[str | bytes] = []
        self.guarded(lambda: value.extend(component.implementation.get([found])))
        return value[0]

    def set(self, name: str, value: Any) -> None:
        """Change a tunable parameter or an unconnected input, effective from the next step on."""
        component, variable = self._components.split(name)
        values = {
            component.description.find(n, component.name): v for n, v in component.expand(variable, value).items()
        }
        self._check_settable(name, component, values)

        def put() -> None:
            self._exchange.set_from_outside()
            component.implementation.set(values)

        self.guarded(put)
        for changed, number in values.items():
            slot = self._layout.constants.get((component, changed))
            if slot is not None:
                self._exchange.values[slot] = number

    def _check_settable(self, name: str, component: SystemComponent, variables: Collection[Variable]) -> None:
        for v in variables:
            driven = self._driven.get((component, v))
            if driven is not None:
                raise WiringError(
                    f"{name if len(variables) == 1 else driven.target_name} is driven by {driven.source_name}"
                )
        if any(v.causality != "input" and v.variability != "tunable" for v in variables):
            raise WiringError(
                f"{name} is fixed while the simulation runs: set it with system['{component.name}'].set(...) before it"
            )

    def setter(self, names: Sequence[str]) -> Callable[[Array], None]:
        """Return a function that sets these variables, as `set` does, to values (n,) in their order.

        Names are looked up once, for loops that step by hand. The values must be finite and within the variables'
        limits, which the function does not check.
        """
        found = [self._components.split(n) for n in names]
        variables = [m.description.find(v, m.name) for m, v in found]
        for name, (component, _), variable in zip(names, found, variables, strict=True):
            self._check_settable(name, component, [variable])
        of: dict[SystemComponent, list[int]] = {}
        for i, (component, _) in enumerate(found):
            of.setdefault(component, []).append(i)
        groups = [(m.implementation, [(variables[i], i) for i in places]) for m, places in of.items()]
        keys = [(m, v) for (m, _), v in zip(found, variables, strict=True)]
        shown = [(self._layout.constants[k], i) for i, k in enumerate(keys) if k in self._layout.constants]
        values = self._exchange.values

        def put(given: Sequence[float]) -> None:
            self._exchange.set_from_outside()
            for implementation, places in groups:
                implementation.set({variable: given[i] for variable, i in places})
            for slot, i in shown:
                values[slot] = given[i]

        return lambda given: self._tried(lambda: put(given.tolist()))

    def reader(self, names: Sequence[str]) -> Callable[[], Array]:
        """What gives the present values (n,) of recorded or watched variables, in this order."""
        for name in names:
            self[name]
        slots, scale, offset = zip(*(self._layout.readable[self._components.canonical(n)] for n in names), strict=True)
        index, values = np.array(slots, dtype=np.intp), self._exchange.values
        if set(scale) == {1.0} and set(offset) == {0.0}:
            return lambda: values.take(index)
        factor, shift = np.array(scale), np.array(offset)
        return lambda: factor * values.take(index) + shift

    @property
    def recording(self) -> Recording:
        """A copy of everything recorded so far."""
        names, units = self._layout.record_names, self._layout.record_units
        result = self._exchange.recorder.recording(names, units)
        self._warn_rounded(
            {
                n: np.abs(result[n]).max(initial=0.0)
                for n in names
                if self._layout.readable[n][0] in self._layout.wide.values()
            }
        )
        result.stopped_by, result.wall_time = self._stopped_by, self._wall_time
        result.loops = tuple(self._exchange.loop_effort)
        result.steps = None if self._exchange.adaptive is None else self._exchange.adaptive.effort
        result.aliases, result.types, result.display = (
            self._layout.aliases,
            self._layout.record_types,
            self._layout.record_display,
        )
        result.real_time = None if self._kept_pace is None else self._kept_pace.copy()
        return result

    def advance(
        self,
        until: TimeLike,
        *,
        stop_when: Sequence[StopCondition] = (),
        progress: bool = False,
        real_time: float | None = None,
        final: bool = False,
    ) -> str | None:
        """Run to the first base tick at or after `until` [s].

        The run ends earlier at the first instant that satisfies one of `stop_when`, or where a component requests the
        end of the simulation, which is over then. Returns the text of that condition or request, or None. Raises
        ComponentError (the simulation is over then) and Interrupted (it stands between two instants and can be
        continued).

        The row recorded at `until` is provisional: discrete components that are due there run when the simulation is
        continued, and the row is replaced then. With `final` they run at once, as at the end of `System.run`.

        With `real_time` every instant begins when it is due by the clock, 1.0 at its pace, 2.0 twice as fast; what
        comes too late is caught up with. Due times count from the first of such calls, so that time between them is not
        lost, until one with another pace or none, or `restore`. `recording.real_time` says how it went.
        """
        exchange = self._exchange
        end = exchange.base.at_or_after(rational(until, "until"))
        if end < exchange.tick:
            raise TimeError(f"cannot advance to {until} s: the simulation stands at {self.time:.9g} s")
        if list(stop_when) != self._stops:
            self._stops = list(stop_when)
            exchange.stop_when(self._stops, self.__getitem__)
        self._stopped_by = None
        self._set_pace(real_time)
        begin = clock.perf_counter()
        try:
            with HeldInterrupt() as interrupt, ProgressBar(progress, self.time, exchange.base.seconds(end)) as bar:
                self.guarded(lambda: self._run(end, interrupt, bar, final))
        except Stop as stop:
            self._stopped_by = str(stop)
        finally:
            self._wall_time += clock.perf_counter() - begin
            if self._layout.wide:
                self._warn_rounded({n: abs(self._exchange.values.item(i)) for n, i in self._layout.wide.items()})
        return self._stopped_by

    def _warn_rounded(self, largest: Mapping[str, float]) -> None:
        """Say once of each integer that it is no longer exchanged and recorded exactly."""
        found = [name for name, value in largest.items() if value >= EXACT and name not in self._rounded]
        if found:
            self._rounded.update(found)
            warnings.warn(
                f"{', '.join(found)}: integers from 2^53 on are exchanged and recorded as doubles, which hold only some"
                " of them",
                stacklevel=4,
            )

    def _run(self, end: int, interrupt: HeldInterrupt, bar: ProgressBar, final: bool) -> None:
        """To the arrival at `end`, with `final` to the sample there."""
        exchange = self._exchange
        self._run_to_arrival(end, interrupt, bar)
        ended = exchange.ending is not None and exchange.tick >= exchange.ending.tick
        if final and not ended and exchange.phase is Phase.ARRIVED:
            exchange.sample()
        if exchange.ending is not None and exchange.tick >= exchange.ending.tick:
            self._over = exchange.ending.text
            raise Stop(self._over)
        if interrupt.pending:
            raise Interrupted(self.time, self.recording)

    def _run_to_arrival(self, end: int, interrupt: HeldInterrupt, bar: ProgressBar) -> None:
        """Run in pieces of about a twentieth of a second, for Ctrl-C and the progress bar, at no cost per instant."""
        exchange = self._exchange
        if exchange.tick >= exchange.last_tick(end) and exchange.phase is not Phase.NOTHING:
            return
        exchange.complete()
        if self._pace is not None:
            self._run_paced(self._pace, end, interrupt, bar)
        piece = 1
        while self._pace is None and exchange.tick < exchange.last_tick(end) and not interrupt.pending:
            begin = clock.perf_counter()
            exchange.run_instants(min(exchange.last_tick(end), exchange.tick + piece))
            took = clock.perf_counter() - begin
            piece = max(1, min(4 * piece, int(0.05 * piece / max(took, 1e-9))))
            bar.at(self.time)
            self._spill()
        if exchange.phase is Phase.NOTHING:
            exchange.arrive()

    def stepper(self, step: TimeLike, *, stop_when: Sequence[StopCondition] = ()) -> Callable[[], str | None]:
        """Return a function that advances by `step` [s] at little cost, for loops that step by hand.

        `step` is a multiple of the tick. Values and answers are bit-identical to those of `advance`, without pace,
        progress and spool. Ctrl-C within a step ends the simulation.
        """
        exchange, stops = self._exchange, list(stop_when)
        ticks = exchange.base.count(positive(step, "step"))

        def go() -> None:
            exchange.step_to(exchange.tick + ticks)
            if exchange.ending is not None and exchange.tick >= exchange.ending.tick:
                self._over = exchange.ending.text
                raise Stop(self._over)

        def run() -> str | None:
            if self._stops != stops:
                self._stops = stops
                exchange.stop_when(stops, self.__getitem__)
            self._stopped_by, self._pace = None, None
            begin = clock.perf_counter()
            try:
                self._tried(go)
            except Stop as stop:
                self._stopped_by = str(stop)
            finally:
                self._wall_time += clock.perf_counter() - begin
            return self._stopped_by

        return run

    def _set_pace(self, real_time: float | None) -> None:
        """The pace of the next instants: that of the call before, if it is the same and nothing came in between."""
        if real_time is None:
            self._pace = None
            return
        factor, exchange, old = _factor(real_time), self._exchange, self._pace
        if old is None or old.kept.factor != factor or old.tick != exchange.tick:
            self._pace = Pace(factor, exchange.tick, exchange.base.tick)
            if self._kept_pace is not None and self._kept_pace.factor == factor:
                self._pace.kept = self._kept_pace
        self._kept_pace = self._pace.kept if self._pace is not None else None

    def _run_paced(self, pace: Pace, end: int, interrupt: HeldInterrupt, bar: ProgressBar) -> None:
        """As `_run`, instant by instant, each when it is due."""
        exchange, shown = self._exchange, clock.perf_counter()
        while (tick := exchange.next_instant(exchange.tick)) < exchange.last_tick(end) and pace.wait(tick, interrupt):
            exchange.run_instants(tick + 1)
            if clock.perf_counter() > shown + _SHOWN:
                bar.at(self.time)
                self._spill()
                shown = clock.perf_counter()
        last = exchange.last_tick(end)
        if pace.wait(last, interrupt):
            exchange.run_instants(last)
        pace.tick = exchange.tick

    def spool(self, spool: Spool | None) -> None:
        """Write rows to a spool while it advances, from now on; None: no more."""
        self._spool = spool

    def _spill(self) -> None:
        """Write what the spool does not have yet, if that is due. All samples are final between two instants."""
        spool, recorder = self._spool, self._exchange.recorder
        if spool is not None and spool.due:
            spool.cut(recorder.count)
            spool.add(*recorder.since(spool.count))

    def guarded(self, work: Action) -> None:
        """Call a function that uses components.

        A failure ends the simulation, and the exception carries the recording; a second Ctrl-C ends a call that does
        not return.
        """

        def hold() -> None:
            with held():
                work()

        self._tried(hold)

    def _tried(self, work: Callable[[], None]) -> None:
        """As `guarded`; a Ctrl-C within `work` ends the simulation."""
        if self._over:
            raise CosimError(f"this simulation cannot be continued: {self._over}")
        try:
            with self._lock:
                work()
        except CallFailed as failure:
            self._over = "a component failed"
            recording = self.recording if self._exchange.recorder.count else None
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
        """A component that cannot take a NaN does not cause it. Only initialization hands such values on."""
        if self._exchange.allow_nan or isinstance(failure, NotFinite):
            return failure
        found = self._layout.not_finite(self.schedule.components)
        loop = failure.culprit if isinstance(failure, LoopNotSolved) else None
        return failure if found is None or (loop and loop.component == found.component) else found

    @cached_property
    def _driven(self) -> dict[tuple[SystemComponent, Variable], Connection]:
        return {(c.target, c.input): c for c in self.schedule.value_connections}

    @cached_property
    def _wiring(self) -> Wiring:
        return wiring_of(self.schedule)

    @property
    def exchange(self) -> Exchange:
        """Its components on the vector of values."""
        return self._exchange

    # Saved states.

    @cached_property
    def _state_pool(self) -> EngineStatePool | None:
        """The states of the FMUs that C may call."""
        calls = {m: ports.fmi for m, ports in self._exchange.ports.items() if ports.fmi and ports.fmi.states}
        return EngineStatePool(calls) if calls else None

    @cached_property
    def _saved_individually(self) -> list[SystemComponent]:
        """Components that `_state_pool` does not save. Raises CosimError naming those that cannot save their state."""
        unable = [m.name for m in self.schedule.components if not m.implementation.description.can_save]
        if unable:
            raise CosimError(
                f"cannot save the state of {', '.join(unable)}: the FMU does not offer it "
                "(canGetAndSetFMUState); rerun from the start instead"
            )
        joint = () if self._state_pool is None else self._state_pool.names
        return [m for m in self.schedule.components if m.name not in joint]

    def save(self) -> SystemState:
        """A copy of the whole state: components, exchanged values, time and length of the recording.

        Pickled or written to a file, it continues in other processes; FMUs serialize their states then. Raises
        CosimError naming the components that cannot save their state.
        """
        e, components, pool = self._exchange, self._saved_individually, self._state_pool
        individual: dict[str, Any] = {}
        joint: SavedStates | None = None
        steps: AdaptiveState | None = None

        def save() -> None:
            nonlocal joint, steps
            if e.adaptive is not None:
                steps = e.adaptive.save(e.tick)
            for m in components:
                individual[m.name] = m.implementation.save()
            if pool is not None:
                joint = pool.save()

        (self.guarded if components else self._tried)(save)  # C comes back before Python looks for Ctrl-C
        return SystemState(
            tick=e.tick,
            phase=e.phase,
            base=e.base,
            values=e.values.copy(),
            keys=self._layout.keys,
            individual=individual,
            wiring=self._wiring,
            joint=joint,
            samples=e.recorder.count,
            steps=steps,
            ending=e.ending,
            instances=self._components,
            owner=weakref.ref(e),
            lock=self._lock,
        )

    def restore(self, state: SystemState) -> None:
        """Go back to a saved state of this simulation; samples recorded after it are dropped."""
        if state.owner is None or state.owner() is not self._exchange:
            raise CosimError("this state was saved by another simulation: use System.initialize(state=...)")

        components, pool, joint = self._saved_individually, self._state_pool, state.joint
        missing = [m.name for m in self.schedule.components if m.name not in state.components]
        if missing:
            raise CosimError(f"this state does not contain '{missing[0]}'; was it freed by Simulation.forget?")

        def restore() -> None:
            if self._exchange.adaptive is not None and state.steps is not None:
                self._exchange.adaptive.restore(state.steps)
            for m in components:
                m.implementation.restore(state.components[m.name])
            if pool is not None and joint is not None:
                pool.restore(joint)

        (self.guarded if components else self._tried)(restore)
        exchange = self._exchange
        for step in exchange.repeated.values():
            step.forget()
        self._pace = None
        exchange.tick, exchange.phase, exchange.ending = state.tick, state.phase, state.ending
        exchange.values[:] = state.values
        exchange.recorder.count = state.samples
        if self._spool is not None:
            self._spool.cut(max(0, state.samples - 1))  # the last one is provisional

    def forget(self, state: SystemState) -> None:
        """Free a saved state; it cannot be restored any more."""
        with self._lock:
            for m in self.schedule.components:
                if m.name in state.components and state.instances.get(m.name) is m:
                    m.implementation.forget(state.components.pop(m.name))

    # The end.

    def close(self) -> None:
        """Terminate the components. They can be initialized again by `System.initialize`."""
        if self._terminated:
            return
        self._terminated = True
        if self._over is None or self._exchange.ending is not None:
            with self._lock, held():
                for m in self.schedule.components:
                    m.implementation.terminate()
        self._over = self._over or "it is closed"

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _factor(real_time: object) -> float:
    """The pace that was given. Raises TimeError for what is no positive number."""
    if isinstance(real_time, bool) or not isinstance(real_time, int | float) or not 0 < real_time < math.inf:
        raise TimeError(
            f"{surface.name_of('real_time')} is {real_time!r}; give a positive number: 1.0 for the clock's pace, 2.0"
            " for twice that"
        )
    return float(real_time)
