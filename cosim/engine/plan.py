"""The plan of an exchange: what `engine.h` describes, as data without pointers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from cosim.core.component import Array, Ports
from cosim.core.description import Variable
from cosim.core.time import MOST_TICKS, TimeBase
from cosim.engine.adaptive import AdaptiveSteps, tolerance_of_loops
from cosim.engine.clock import Clock
from cosim.engine.loops import RepeatedStep, declared_or
from cosim.engine.recorder import Recorder
from cosim.engine.values import EXACT, Index, Layout, make_layout
from cosim.system.components import SystemComponent
from cosim.system.followers import find_followers
from cosim.system.loops import AlgebraicLoop
from cosim.system.schedule import Schedule

LOOP_TOLERANCE = 1e-9
"""Of the values that solve an algebraic loop, relative to max(nominal value, |value|)."""
_NEVER = 16 * MOST_TICKS


class Setup:
    """What an engine executes: the components of a schedule, their slots in the values, their clocks and ports."""

    def __init__(
        self,
        schedule: Schedule,
        start: Fraction = Fraction(0),
        *,
        record: Sequence[tuple[SystemComponent, Variable]] = (),
        watch: Sequence[tuple[SystemComponent, Variable]] = (),
        interval: Fraction | None = None,
        allow_nan: bool = False,
        loop_tolerance: float = LOOP_TOLERANCE,
        tolerance: float | None = None,
    ):
        """`interval` [s] is that of the recorder, a multiple of the schedule's tick; default: the smallest step.

        With a `tolerance`, the schedule is one of `for_tolerance`, and no clock decides when continuous components
        are due.
        """
        self.schedule = schedule
        self.allow_nan = allow_nan
        self.loop_tolerance = loop_tolerance if tolerance is None else tolerance_of_loops(tolerance, loop_tolerance)
        self.tolerance = tolerance
        self.adaptive: AdaptiveSteps | None = None  # known when all components are initialized
        self.loops: tuple[AlgebraicLoop, ...] = schedule.loops  # initialization adds those that it measures
        self.late_loops: tuple[AlgebraicLoop, ...] = schedule.late_loops  # initialization adds them
        self.measured = None if schedule.possible_loops else schedule.measured  # initialization measures them
        self.repeated: Mapping[SystemComponent, RepeatedStep] = {}  # in these loops; known when they are initialized
        self.base: TimeBase = schedule.time_base(start)
        self.layout: Layout = make_layout(schedule, record, watch)
        self.values = self.layout.values
        self.recorder = Recorder(self.values, self.layout.record_index, *self.layout.record_conversion)
        self.ports: dict[SystemComponent, Ports] = {}  # bound by the initialization
        if interval is None:
            interval = min(m.step for m in schedule.components)
        self.clocks = (  # of the components, then the recorder's
            *(self._clock(m) for m in schedule.components),
            Clock(self.base.count(interval), 0),
        )

    def _clock(self, component: SystemComponent) -> Clock:
        if self.tolerance is not None and not component.discrete:
            return Clock(_NEVER, _NEVER)
        return Clock(self.base.count(component.step), self.base.count(component.offset))


@dataclass(frozen=True)
class Copy:
    """values[to : to + n] = values[source : source + n]."""

    to: int
    source: int
    n: int


@dataclass(frozen=True)
class ComponentPlan:
    """One component's part; the names are those of `EngineComponent`."""

    component: SystemComponent
    clock: int
    step: float
    check_before: bool
    begins_with_events: bool
    previous: tuple[Copy, ...]
    published: tuple[Copy, ...]
    timestamp_slot: int | None
    index: Index
    in_place: bool
    scale: Array | None
    offset: Array | None
    extrapolations: tuple[
        tuple[int, int, int, int, float, float], ...
    ]  # input, now, before, sample_time, period, shift
    first: int  # slot of its first output
    n_outputs: int


@dataclass(frozen=True)
class DerivativePlan:
    """Of a component of a loop; the names are those of `EngineDerivative`."""

    knowns: tuple[int, ...] = ()
    inputs: tuple[int, ...] = ()
    unknowns: tuple[int, ...] = ()
    outputs: tuple[int, ...] = ()


@dataclass(frozen=True)
class LoopPlan:
    """An algebraic loop; the names are those of `EngineLoop`."""

    components: tuple[int, ...]
    clock: int
    follows_discrete: bool
    repeats: bool
    published: tuple[int, ...]
    computed: tuple[int, ...]
    nominal: tuple[float, ...]
    start: tuple[float, ...]
    derivatives: tuple[DerivativePlan | None, ...]  # by component; empty: none offers them
    read: tuple[int, ...]


@dataclass(frozen=True)
class FollowerPlan:
    """What follows first event iterations; the names are those of `EngineFollower`."""

    component: int
    loop: int
    read: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """A whole exchange; the names are those of `Engine`. `clocks` ends with the recorder's."""

    size: int
    components: tuple[ComponentPlan, ...]
    loops: tuple[LoopPlan, ...]
    n_running: int  # of the loops, those that are solved at each exchange; the others are so in initialization only
    n_late: int  # of the loops, the last ones: they take the place of all others where initial values do not settle
    followers: tuple[FollowerPlan, ...]
    n_discrete: int
    clocks: tuple[Clock, ...]
    time: tuple[int, int, int]
    recorded: tuple[int, ...]

    def exact_until(self, tick: int) -> bool:
        """Whether all times up to a tick are quotients of integers that doubles hold, and so correctly rounded in C."""
        a, b, d = self.time
        return d < EXACT and abs(b) + abs(a) * (abs(tick) + 1) < EXACT


def make_plan(setup: Setup) -> Plan:
    """The plan of a system."""
    layout, schedule = setup.layout, setup.schedule
    clocks: dict[Clock, int] = {}
    own = [clocks.setdefault(clock, len(clocks)) for clock in setup.clocks[:-1]]
    seidel = {m for g in schedule.groups if g.method == "gauss-seidel" for m in g.components}
    return Plan(
        size=len(layout.values),
        components=tuple(_component(layout, m, c, m in seidel) for m, c in zip(schedule.components, own, strict=True)),
        loops=tuple(_loop(setup, loop, own) for loop in (*setup.loops, *schedule.initial_loops, *setup.late_loops)),
        n_running=len(setup.loops),
        n_late=len(setup.late_loops),
        followers=tuple(_followers(setup)),
        n_discrete=len(schedule.discrete),
        clocks=(*clocks, setup.clocks[-1]),
        time=setup.base.integers(),
        recorded=tuple(layout.record_index),
    )


def _component(layout: Layout, component: SystemComponent, clock: int, seidel: bool) -> ComponentPlan:
    port = layout.ports[component]
    previous, published = layout.copies(component)
    return ComponentPlan(
        component=component,
        clock=clock,
        step=float(component.step),
        check_before=seidel,
        begins_with_events=component.description.begins_with_events,
        previous=tuple(_runs(previous)),
        published=tuple(_runs(published)),
        timestamp_slot=layout.sample_times.get(component),
        index=port.index,
        in_place=port.in_place,
        scale=port.scale,
        offset=port.offset,
        extrapolations=tuple(port.extrapolated()),
        first=port.first,
        n_outputs=len(port.y),
    )


def _loop(setup: Setup, loop: AlgebraicLoop, clocks: Sequence[int]) -> LoopPlan:
    layout, components = setup.layout, setup.schedule.components
    numbers = tuple(components.index(m) for m in loop.components)
    driven = any(c.target in loop.components and c.source.discrete for c in setup.schedule.connections)
    repeats = any(m in setup.repeated for m in loop.components)
    derivatives = tuple(_derivative(setup, loop, m) for m in loop.components)

    return LoopPlan(
        components=numbers,
        clock=clocks[numbers[0]],
        follows_discrete=driven and not repeats,
        repeats=repeats,
        published=tuple(layout.visible[key] for key in loop.unknowns),
        computed=tuple(layout.reached(key) for key in loop.unknowns),
        nominal=tuple(variable.nominal for _, variable in loop.unknowns),
        start=tuple(loop.first_guess),
        derivatives=derivatives if any(derivatives) else (),
        read=tuple(dict.fromkeys(layout.reached((c.source, c.output)) for c in loop.connections))
        if loop.has_events
        else (),
    )


def _followers(setup: Setup) -> Iterator[FollowerPlan]:
    """Of the followers, those that are in no loop whose components compute their outputs in steps only."""
    if setup.measured is None:
        return
    layout, components = setup.layout, setup.schedule.components
    kept = {m for loop in setup.loops if not setup.repeated.keys().isdisjoint(loop.components) for m in loop.components}
    for f in find_followers(setup.schedule, setup.loops, declared_or(setup.measured)):
        of = f.what.components if isinstance(f.what, AlgebraicLoop) else (f.what,)
        if kept.isdisjoint(of):
            loops = (i for i, loop in enumerate(setup.loops) if f.what is loop or f.what in loop.components)
            read = tuple(layout.reached(key) + k for key in f.reads for k in range(layout.width(key)))
            number = -1 if isinstance(f.what, AlgebraicLoop) else components.index(f.what)
            yield FollowerPlan(number, next(loops, -1), read)


def _derivative(setup: Setup, loop: AlgebraicLoop, m: SystemComponent) -> DerivativePlan | None:
    """What directional derivatives tell of a component without a step, if it offers them for its part of a loop."""
    port = setup.layout.ports[m]
    inputs = dict.fromkeys(c.input for c in loop.connections if c.target is m)
    outputs = dict.fromkeys(c.output for c in loop.connections if c.source is m)
    doubles = all(v.fmi_type in ("Real", "Float64") and v.size == 1 for v in (*inputs, *outputs))
    if not m.description.directional_derivatives or not doubles:
        return None
    return DerivativePlan(
        knowns=tuple(v.reference for v in inputs),
        inputs=tuple(port.inputs.index(v) for v in inputs),
        unknowns=tuple(v.reference for v in outputs),
        outputs=tuple(port.outputs.index(v) for v in outputs),
    )


def _runs(pairs: Iterable[tuple[int, int]]) -> Sequence[Copy]:
    """Pairs (to, from) as pieces that lie side by side."""
    runs: list[Copy] = []
    for to, source in sorted(pairs):
        last = runs[-1] if runs else None
        if last and (to, source) == (last.to + last.n, last.source + last.n):
            runs[-1] = Copy(last.to, last.source, last.n + 1)
        else:
            runs.append(Copy(to, source, 1))
    return runs
