"""FMI 3.0 Co-Simulation FMUs with time-based clocks: instants of each clock, and event mode (FMI 3.0, 2.2.9, 4.2).

A communication step from t to t + h holds the ticks in [t, t + h): at each the FMU is in event mode, its clocks are
set, the inputs of these clocks are set, their outputs are read, discrete states are updated, and `fmi3DoStep` continues
to the next tick or to the end. Inputs that are discrete without a clock are set in event mode at t. What a clock
computes shows until it ticks again.

| clock | its interval |
|---|---|
| constant | in modelDescription.xml |
| fixed, tunable | there, or what the FMU says at the end of initialization; of a tunable one again when a parameter was
set |
| changing | what the FMU says at each tick: the time to the next |
| countdown | what the FMU says in any event mode, if it knows it |

Triggered input clocks tick when an output clock of another FMU does that is connected to them. Such FMUs take their
steps together, see `clock_network.py`, which says when what is called. An FMU may return early if it takes steps of any
length and saves its state. No intermediate update is requested, which is a right of whoever imports it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NoReturn, Protocol

import numpy as np

from cosim.core.component import Action, EndRequested, Ports
from cosim.core.description import Clock, Description, Variable
from cosim.core.errors import CallFailed, CosimError
from cosim.core.signals import Array
from cosim.core.time import rational, seconds_text
from cosim.fmu.clock_network import ClockNetwork
from cosim.fmu.transfers import Arrangement, arrangements, slots

NOT_YET_KNOWN, UNCHANGED, CHANGED = range(3)  # fmi3IntervalQualifier
PERIODIC = ("constant", "fixed", "tunable")


def refusal(about: Description) -> str:
    """Why the clocks of an FMU cannot be driven; empty if they can, or if there are none."""
    for clock in about.clocks:
        if clock.causality == "input" and not about.event_mode:
            return f"its clock '{clock.name}' needs event mode, which it does not offer (hasEventMode)"
    return ""


class Instance(Protocol):
    """What is needed of an instance: its calls, and how its values are moved."""

    name: str
    description: Description
    _ffi: Any
    _flags: Any
    _sizes: Mapping[Variable, int]

    def _must(self, function: str, *arguments: Any) -> None: ...

    def _set_values(self, values: Mapping[Variable, Any]) -> None: ...

    def _check_environment(self) -> None: ...

    def _transfer(self, direction: str, how: Arrangement, buffer: Array) -> Any: ...

    def _advance(self, t: float, h: float, *, early: bool) -> float | None: ...


@dataclass(frozen=True)
class Due:
    """When a clock ticks: at `base + count * interval` [s], exactly; `interval` None: not known yet."""

    base: Fraction
    count: int = 0
    interval: Fraction | None = None

    @property
    def next(self) -> float:
        """Time of the next tick [s]; infinite if it is not known."""
        return math.inf if self.interval is None else float(self.base + self.count * self.interval)


@dataclass
class _Group:
    """Variables that are moved together, `places` of the master's buffer."""

    variables: list[Variable]
    clocks: frozenset[int]  # that they belong to; none: to no clock
    at_events: bool  # inputs that are discrete without belonging to a clock
    places: Any
    parts: dict[Variable, slice]  # of places and buffer: one place for each variable, or several
    buffer: Array
    moves: tuple[Action, ...]

    def move(self) -> None:
        for move in self.moves:
            move()


class EventMode:
    """The clocks of one instance."""

    def __init__(self, component: Instance):
        self.component = component
        self.about = component.description
        self.clocks = {c.reference: c for c in self.about.clocks if c.causality == "input" and c.kind != "triggered"}
        self.network = ClockNetwork([self])
        self.returns_early = self.about.early_return and self.about.variable_step and self.about.can_save
        self.told = [c.reference for c in self.about.clocks if c.causality == "output"]  # that the FMU itself ticks
        self.due: dict[int, Due] = {}
        self.now, self.next_event = 0.0, math.inf
        self.initializing = False
        self._tuned = False  # a parameter was set, which intervals may depend on
        self._start = Fraction(0)
        self._later: dict[Variable, Any] = {}  # inputs of clocks that were set between their ticks
        self._inputs: list[_Group] = []
        self._outputs: list[_Group] = []
        self._u, self._y, self._given = np.zeros(0), np.zeros(0), np.zeros(0)

    # Initialization.

    def enter_initialization(self, start: float) -> None:
        """Start the clocks at `start` [s]."""
        self.now, self._start, self.initializing = start, rational(start, "start time"), True
        self._later.clear()

    def exit_initialization(self) -> None:
        """Read intervals, leave initialization mode, and leave the event mode after it for step mode.

        No time-based clock has ticked yet. FMUs with connected clocks leave that event mode together.
        """
        for clock in self.clocks.values():
            self.due[clock.reference] = self._first(clock)
        self.component._must("ExitInitializationMode")
        self.initializing = False
        if self.network.alone:
            self.network.begin([self])

    def _first(self, clock: Clock) -> Due:
        if clock.kind not in PERIODIC:
            qualifier, interval = self._ask(clock)
            return Due(self._start + interval, 0, interval) if qualifier != NOT_YET_KNOWN else Due(self._start)
        if clock.interval is not None:
            return Due(self._start + clock.shift, 0, self._positive(clock, clock.interval))
        shift = self._seconds(clock, "Shift")
        return Due(self._start + shift, 0, self._positive(clock, self._ask(clock)[1]))

    def _ask(self, clock: Clock) -> tuple[int, Fraction]:
        """fmi3GetInterval: (qualifier, interval)."""
        qualifier = self.component._ffi.new("int[1]", [UNCHANGED])
        interval = self._seconds(clock, "Interval", qualifier)
        return qualifier[0], interval

    def _seconds(self, clock: Clock, what: str, *more: Any) -> Fraction:
        """What fmi3GetIntervalDecimal or its like says, exactly where the FMU can; 0 where it does not know."""
        new, reference = self.component._ffi.new, self.component._ffi.new("VR[]", [clock.reference])
        if clock.fractions:
            counter, resolution = new("uint64_t[1]"), new("uint64_t[1]", [1])
            self.component._must(f"Get{what}Fraction", reference, 1, counter, resolution, *more)
            if not resolution[0]:
                self._refuse(clock, f"its {what.lower()} is {counter[0]} / 0")
            return Fraction(counter[0], resolution[0])
        value = new("double[1]")
        self.component._must(f"Get{what}Decimal", reference, 1, value, *more)
        if more and more[0][0] == NOT_YET_KNOWN:
            return Fraction(0)
        if not (math.isfinite(value[0]) and value[0] >= 0):
            self._refuse(clock, f"its {what.lower()} is {seconds_text(value[0])}")
        return rational(value[0], f"{what.lower()} of clock '{clock.name}'")

    def _positive(self, clock: Clock, interval: Fraction) -> Fraction:
        if interval <= 0:
            self._refuse(clock, f"its interval is {seconds_text(interval)}")
        return interval

    def _refuse(self, clock: Clock, why: str) -> NoReturn:
        raise CosimError(f"'{self.component.name}': clock '{clock.name}' cannot be driven: {why}")

    # Values.

    def ports(self, inputs: Sequence[Variable], outputs: Sequence[Variable], u: Array, y: Array) -> Ports:
        """Ports that read `inputs` from `u` and write `outputs` to `y`, with events at the ticks of clocks."""
        self._inputs, self._outputs = self._grouped("Set", inputs), self._grouped("Get", outputs)
        self._given, self._u, self._y = u, u.copy(), y
        first = (
            None if self.about.kind is not None else self.about.initial_unknowns
        )  # FMUs of this project compute them all
        at_first = [
            g for g in self._outputs if not g.clocks or first is None or all(v.declared in first for v in g.variables)
        ]

        def set_inputs() -> None:
            if self.initializing:  # later they are set when they may be: in the step
                self.read_inputs()
                self.set_inputs(lambda _: True)

        def get_outputs() -> None:
            self.get_outputs(lambda g: g in at_first if self.initializing else not g.clocks)

        return Ports.of(set_inputs, lambda t, h: self.network.step(self, t, h), get_outputs)

    def read_inputs(self) -> None:
        """Note the inputs as the exchange has them; within a step they do not change."""
        self._u[:] = self._given

    def _grouped(self, direction: str, variables: Sequence[Variable]) -> list[_Group]:
        """Variables by their clocks; inputs that are discrete apart from those that are not."""
        sizes, at = self.component._sizes, 0
        groups: dict[tuple[frozenset[int], bool], dict[Variable, range]] = {}
        for v in variables:
            at_events = direction == "Set" and not v.clocks and v.variability == "discrete"
            n = slots(sizes.get(v, 0))
            groups.setdefault((frozenset(v.clocks), at_events), {})[v] = range(at, at + n)
            at += n
        made = []
        for (clocks, at_events), places in groups.items():
            own, all_places = list(places), [i for r in places.values() for i in r]
            begins = np.cumsum([0, *(len(r) for r in places.values())]).tolist()
            buffer = np.zeros(len(all_places))
            moves = [self.component._transfer(direction, how, buffer).move for how in arrangements(3, own, sizes=sizes)]
            parts = {v: slice(b, b + len(r)) for (v, r), b in zip(places.items(), begins, strict=False)}
            made.append(
                _Group(own, clocks, at_events, np.array(all_places, dtype=np.intp), parts, buffer, tuple(moves))
            )
        return made

    def place(self, variable: Variable) -> tuple[Array, Any]:
        """Where a variable is: in the noted inputs or in the outputs, and its places there."""
        for array, groups in ((self._u, self._inputs), (self._y, self._outputs)):
            for group in groups:
                if variable in group.parts:
                    return array, group.places[group.parts[variable]]
        raise KeyError(variable.name)

    @property
    def sets_at_events(self) -> bool:
        """Whether it has inputs that are discrete without belonging to a clock."""
        return any(g.at_events for g in self._inputs)

    def set_inputs(self, which: Callable[[_Group], bool]) -> None:
        """Set these of the noted inputs."""
        for group in self._inputs:
            if which(group):
                group.buffer[:] = self._u[group.places]
                group.move()

    def get_outputs(self, which: Callable[[_Group], bool]) -> None:
        """Read these outputs; those of clocks that do not tick keep what they showed."""
        for group in self._outputs:
            if which(group):
                group.move()
            self._y[group.places] = group.buffer

    def set(self, values: Mapping[Variable, Any]) -> None:
        """Set parameters and inputs during the simulation, in event mode.

        Inputs of a clock wait for its next tick; a tunable clock's new interval starts now.
        """
        self._later |= {v: x for v, x in values.items() if v.clocks}
        if now := {v: x for v, x in values.items() if not v.clocks}:
            self._tuned = True
            self.network.change(self, lambda: self.component._set_values(now))

    # What a saved state has beside that of the FMU.

    def saved(self) -> Any:
        """State of the clocks, which is saved beside the FMU's own state."""
        held = {v: g.buffer[part].copy() for g in self._outputs if g.clocks for v, part in g.parts.items()}
        return dict(self.due), self.now, self.next_event, dict(self._later), held

    def restore(self, state: Any) -> None:
        """Restore a state that `saved` returned."""
        due, self.now, self.next_event, later, held = state
        self.due, self._later = dict(due), dict(later)
        for group in self._outputs:
            if group.clocks:
                for v, part in group.parts.items():
                    if v in held and len(held[v]) == part.stop - part.start:
                        group.buffer[part] = held[v]

    # What `ClockNetwork` calls, in event mode but for `advance`.

    @property
    def next(self) -> float:
        """When it must be in event mode next [s]."""
        return min([self.next_event, *(due.next for due in self.due.values())])

    def ticking(self, near: float) -> frozenset[int]:
        """Time-based clocks that tick now."""
        return frozenset(r for r, due in self.due.items() if due.next <= self.now + near)

    def wants_event(self, near: float) -> bool:
        """Whether it has reported an event, or announced one for now."""
        return bool(self.component._flags[0]) or self.next_event <= self.now + near

    def advance(self, to: float, *, within: bool) -> None:
        """`fmi3DoStep` from where it stands to `to`, or to where it returns early."""
        try:
            reached = self.component._advance(self.now, to - self.now, early=self.returns_early)
        except EndRequested as request:
            raise EndRequested(request.component, str(request), complete=request.complete and not within) from None
        finally:
            self.component._check_environment()
        if reached is not None and not self.now <= reached <= to:
            why = f"it returned early at {reached:.9g} s, outside of the step from {self.now:.9g} s to {to:.9g} s"
            raise CallFailed(self.component.name, "fmi3DoStep", 3, why)
        self.now = to if reached is None else reached

    def enter(self) -> None:
        """Enter event mode."""
        self.component._must("EnterEventMode")
        self.component._flags[0] = False

    def leave(self) -> None:
        """Enter step mode."""
        self.component._must("EnterStepMode")

    def tick(self, clocks: frozenset[int], *, first: bool = False) -> None:
        """These clocks tick: their inputs are set; `first`: discrete inputs without a clock too."""
        new = self.component._ffi.new
        if clocks:
            references = sorted(clocks)
            self.component._must(
                "SetClock", new("VR[]", references), len(references), new("bool[]", [True] * len(references))
            )
        self.set_inputs(lambda g: bool(g.clocks & clocks) or (first and g.at_events))
        if later := {v: x for v, x in self._later.items() if clocks & set(v.clocks)}:
            self.component._set_values(later)
            self._later = {v: x for v, x in self._later.items() if v not in later}
        for reference in clocks & self.due.keys():
            self.due[reference] = replace(self.due[reference], count=self.due[reference].count + 1)

    def update(self, active: frozenset[int], ticking: frozenset[int]) -> bool:
        """Read outputs of active clocks and update discrete states; whether another update is required.

        `ticking`: those of the active clocks that are time-based.
        """
        flags, when = self.component._ffi.new("bool[5]"), self.component._ffi.new("double*")
        if active:
            self.get_outputs(lambda g: bool(g.clocks & active))
        self._reschedule(ticking)
        self.component._must("UpdateDiscreteStates", *(flags + k for k in range(5)), when)
        if flags[1]:
            text = f"component '{self.component.name}' asked to end the simulation (in event mode at {self.now:.9g} s)"
            raise EndRequested(self.component.name, text, complete=False)
        if not flags[0]:
            self._reschedule(frozenset())
            self._retune()
            self.next_event = when[0] if flags[4] else math.inf
        return bool(flags[0])

    def told_now(self) -> frozenset[int]:
        """Output clocks that tick."""
        if not self.told:
            return frozenset()
        values = self.component._ffi.new("bool[]", len(self.told))
        self.component._must("GetClock", self.component._ffi.new("VR[]", self.told), len(self.told), values)
        return frozenset(r for r, ticks in zip(self.told, values, strict=True) if ticks)

    def _retune(self) -> None:
        """Intervals of tunable clocks, after a parameter was set."""
        for clock in self.clocks.values() if self._tuned else ():
            if clock.kind == "tunable" and clock.interval is None:
                qualifier, interval = self._ask(clock)
                if qualifier == CHANGED:
                    time = rational(self.now, "time")
                    self.due[clock.reference] = Due(time + self._positive(clock, interval), 0, interval)
        self._tuned = False

    def _reschedule(self, ticking: frozenset[int]) -> None:
        """Intervals that the FMU tells in event mode."""
        for reference, clock in self.clocks.items():
            if clock.kind == "countdown" or (clock.kind == "changing" and reference in ticking):
                now, (qualifier, interval) = rational(self.now, "time"), self._ask(clock)
                if qualifier == CHANGED:
                    self.due[reference] = Due(now + interval, 0, interval)
                elif clock.kind == "countdown" and reference in ticking:
                    self.due[reference] = Due(now)
