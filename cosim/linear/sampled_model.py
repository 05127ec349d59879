"""Sampled models: one period of a system with sampled components, by differences and derivatives of its components."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from cosim.core.component import Array, Ports
from cosim.core.description import Variable
from cosim.core.errors import CallFailed, CosimError, TimeError
from cosim.engine.exchange import Exchange, Phase
from cosim.engine.initialization import initialize
from cosim.linear.linearization import Signal, component_models, name_of, operating_point, state_signals, units_by_name
from cosim.linear.linearized import LinearizedContinuous, LinearizedSampled, Source
from cosim.linear.statespace import Matrices
from cosim.system.components import Connection, Group, SystemComponent
from cosim.system.loops import certain, find_loops
from cosim.system.schedule import Schedule

_STEP = float(np.finfo(float).eps) ** (1 / 3)  # of central differences, relative to max(1, |value|)
LARGEST = 50_000_000  # numbers in matrices: 7000 states and inputs, minutes of work
_ROUNDING = 1e-6  # relative; differences of differences below it are none


def common_period(schedule: Schedule, given: Fraction | None) -> Fraction:
    """The least common multiple of all steps, or a multiple of it. Raises TimeError for any other period."""
    ticks = math.lcm(*(int(m.step / schedule.tick) for m in schedule.components))
    least = ticks * schedule.tick
    if given is None:
        return least
    if (given / least).denominator != 1:
        raise TimeError(
            f"the period of the sampled model must be a multiple of {least} s, which all steps divide, not {given} s"
        )
    return given


@dataclass
class _Updates:
    """Linear updates of a discrete component, found while the system runs through a period.

    They are a matrix [x; u] -> [x_next; y] per sample, states before and after the period, and the states that jump
    when perturbed.
    """

    component: SystemComponent
    inputs: list[Variable]
    outputs: list[Variable]
    samples: int = 1  # in the period
    names: list[str] = field(default_factory=list)
    matrices: list[Array] = field(default_factory=list)
    before: Array = field(default_factory=lambda: np.zeros(0))
    after: Array = field(default_factory=lambda: np.zeros(0))
    jumps: set[int] = field(default_factory=set)

    def left_out(self) -> list[int]:
        """States that are constants, and counters of samples.

        Raises CosimError for a counter that does not return to its initial value.
        """
        n, drop = len(self.names), []
        for i in range(n):
            rows = [m[i] for m in self.matrices]
            alone = not any(np.delete(row, i).any() for row in rows)
            acts = any(np.delete(m[:, i], i).any() for m in self.matrices)
            counts = not acts and (alone or i in self.jumps)
            back = abs(self.after[i] - self.before[i]) <= 1e-9 * max(1.0, abs(self.before[i]))
            if i in self.jumps and acts:
                raise CosimError(
                    f"'{self.component.name}' cannot be linearized: it jumps when its {self.names[i]} changes"
                )
            if counts and not back:
                raise CosimError(
                    f"'{self.component.name}' cannot be linearized over this period: its {self.names[i]} counts, from"
                    f" {self.before[i]:g} to {self.after[i]:g}; give the period after which it begins from scratch,"
                    " discrete='10 ms' (of one FMU: period='10 ms')"
                )
            if counts or (alone and back and all(abs(row[i] - 1) < 1e-9 for row in rows)):
                drop.append(i)
        return drop

    def linearized(self) -> tuple[LinearizedSampled, list[str]]:
        """The linear model, and the names of its states."""
        drop, width = self.left_out(), len(self.names) + len(self.inputs)
        columns = [i for i in range(width) if i not in drop]
        rows = [i for i in range(len(self.names) + len(self.outputs)) if i not in drop]
        kept = [m[np.ix_(rows, columns)] for m in self.matrices]
        names = [f"{self.component.name}.{n}" for i, n in enumerate(self.names) if i not in drop]
        return LinearizedSampled(kept, self.inputs, self.outputs), names

    def look(self, step: Callable[[], None]) -> None:
        """Linearize the component's next sample about where it stands, and leave it there."""
        component = self.component.implementation
        point = component.sampled_states()  # type: ignore[attr-defined]
        if not self.matrices:
            self.names, self.before = list(point), np.array(list(point.values()))
            _check_size(
                f"'{self.component.name}'", len(point) + len(self.inputs), len(point) + len(self.outputs), self.samples
            )
        x, u = np.array(list(point.values())), component.get(self.inputs)
        saved, n = component.save(), len(point)

        def result(column: int | None = None, change: float = 0.0) -> Array:
            component.restore(saved)
            if column is not None and column < n:
                moved = x.copy()
                moved[column] += change
                component.set_sampled_states(moved)  # type: ignore[attr-defined]
            elif column is not None:
                component.set({self.inputs[column - n]: u[column - n] + change})
            step()
            after = component.sampled_states()  # type: ignore[attr-defined]
            if list(after) != self.names:
                raise CosimError(
                    "a step adds or removes some of its states: make them floats or arrays of floats from the start"
                )
            return np.array([*after.values(), *component.get(self.outputs)], dtype=float)

        here = result()
        self.after = here[:n]
        matrix = np.zeros((n + len(self.outputs), n + len(u)))
        for column in range(n + len(u)):
            variable = None if column < n else self.inputs[column - n]
            if variable is not None and (variable.type != "real" or variable.must_equal is not None):
                continue
            matrix[:, column] = self._slope(
                here, result, column, x[column] if variable is None else u[column - n], variable
            )
        component.restore(saved)
        component.forget(saved)
        self.matrices.append(matrix)

    def _slope(
        self, here: Array, result: Callable[[int, float], Array], column: int, value: float, variable: Variable | None
    ) -> Array:
        h = _STEP * max(1.0, abs(value))
        low, high = (-np.inf, np.inf) if variable is None else variable.limits
        if value - h < low:  # at a limit the derivative is that of the inside
            return (result(column, h) - here) / h
        if value + h > high:
            return (here - result(column, -h)) / h
        slope, apart = _differences(here, result, column, h)
        scale = max(np.abs(slope).max(initial=0.0), np.abs(here).max(initial=0.0), 1.0)
        wrong = apart > _ROUNDING * scale + _ROUNDING * np.abs(slope)
        if wrong.any():  # of a smooth function half the step halves the difference between the slopes on both sides
            wrong &= _differences(here, result, column, h / 2)[1] > 0.75 * apart
        rows = np.flatnonzero(wrong)
        if not len(rows):
            return slope
        if variable is None and list(rows) == [column]:
            self.jumps.add(column)
            slope[column] = 0.0
            return slope
        names = [*self.names, *(v.name for v in self.outputs)]
        cause = self.names[column] if variable is None else variable.name
        raise CosimError(
            f"'{self.component.name}' cannot be linearized: its {names[rows[0]]} has a kink or jump over {cause} ="
            f" {value:g}"
        )


def _check_size(whose: str, columns: int, rows: int, samples: int = 1) -> None:
    """Refuse what would take hours and gigabytes, before it starts."""
    if columns * rows * samples > LARGEST:
        times = f" for each of the {samples} samples in the period" if samples > 1 else ""
        raise CosimError(
            f"{whose} cannot be linearized: with {columns:,} states and inputs its model is a matrix of {rows:,} x"
            f" {columns:,} numbers{times}, and at most {LARGEST:,} are computed"
        )


def _differences(here: Array, result: Callable[[int, float], Array], column: int, h: float) -> tuple[Array, Array]:
    """Central difference, and how far the differences on both sides are apart."""
    up, down = result(column, h), result(column, -h)
    return (up - down) / (2 * h), np.abs((up - here) - (here - down)) / h


def sampled_model(
    exchange: Exchange, period: Fraction, not_before: Fraction, inputs: Sequence[Signal], outputs: Sequence[Signal]
) -> Matrices:
    """Model of an initialized system over one period.

    The period begins at its first multiple at or after `not_before` [s] that is past all offsets, but not at the start
    itself. `exchange` observes `outputs`. No component drives `inputs`. Raises CosimError for components without a
    linear model.
    """
    schedule, layout = exchange.schedule, exchange.layout
    for c in schedule.connections:
        if c.extrapolate:
            raise CosimError(f"{c} is extrapolated: the sampled model knows values that are held; connect without it")
    length = int(period / schedule.tick)
    latest = max([not_before, *(m.offset for m in schedule.components)])
    # a first sample is special: calculated start states follow its inputs
    begin = max(1, -(-latest // period)) * length
    exchange.run_instants_to(begin)
    real = [c for c in schedule.connections if c.output.type == c.input.type == "real"]
    ports = {
        m: (
            [*(v for v in layout.ports[m].inputs if v.type == "real"), *(v for owner, v in inputs if owner is m)],
            [v for v in layout.ports[m].outputs if v.type == "real"],
        )
        for m in schedule.components
    }
    models = component_models(schedule, ports)
    known = [(m, v) for m in schedule.continuous for v in m.description.states]
    units, point = units_by_name([*known, *inputs, *outputs]), operating_point([*known, *inputs, *outputs])
    found = _through_period(exchange, length, ports)
    linearized_components: dict[SystemComponent, SystemComponent] = {}
    names: dict[SystemComponent, list[str]] = {}
    for m in schedule.components:
        if m.discrete:
            linearized, names[m] = found[m].linearized()
        else:
            linearized = LinearizedContinuous(models[m], *ports[m], float(m.step))  # type: ignore[assignment]
            names[m] = [name for name, _ in state_signals(m, len(models[m].a))]
        linearized_components[m] = SystemComponent(m.name, linearized, m.step, m.offset, m.kind)
    return _Period(schedule, linearized_components, names, real, inputs, outputs, period, begin).matrices(units, point)


def _through_period(
    exchange: Exchange, length: int, ports: Mapping[SystemComponent, tuple[list[Variable], list[Variable]]]
) -> dict[SystemComponent, _Updates]:
    """Run one period, and linearize every sample of the discrete components on the way."""
    found: dict[SystemComponent, _Updates] = {}
    for m in exchange.schedule.discrete:
        if not m.description.can_save:
            raise CosimError(
                f"'{m.name}' cannot be linearized: its state cannot be saved and restored, so it cannot be perturbed"
            )
        if not hasattr(m.implementation, "sampled_states"):
            raise CosimError(f"'{m.name}' cannot be linearized: it does not say what it remembers between samples")
        found[m] = _Updates(m, *ports[m], samples=max(1, length // int(m.step / exchange.schedule.tick)))
        exchange.ports[m] = _linearizing(exchange.ports[m], found[m])
    exchange.forget()
    exchange.run_instants_to(exchange.tick + length)
    return found


def _linearizing(ports: Ports, updates: _Updates) -> Ports:
    """Ports that linearize the component before each step."""

    def run(t: float, h: float) -> None:
        ports.set_inputs()
        try:
            updates.look(lambda: ports.step(t, h))
        except CallFailed as error:
            raise CosimError(f"'{updates.component.name}' cannot be linearized: {error}") from None
        except CosimError as error:
            about = str(error)
            prefix = f"'{updates.component.name}' cannot be linearized"
            raise CosimError(about if about.startswith(prefix) else f"{prefix}: {about}") from None
        ports.run(t, h)

    return replace(ports, run=run, fmi=None)


class _Period:
    """The linear models in the place of the components of a schedule, run over one period at a time."""

    def __init__(
        self,
        schedule: Schedule,
        linearized_components: dict[SystemComponent, SystemComponent],
        names: dict[SystemComponent, list[str]],
        real: Sequence[Connection],
        inputs: Sequence[Signal],
        outputs: Sequence[Signal],
        period: Fraction,
        begin: int,
    ):
        copies = [
            replace(c, source=linearized_components[c.source], target=linearized_components[c.target], offset=0.0)
            for c in real
        ]
        self._source = Source(drives := [replace(v, name=f"{m.name}.{v.name}", causality="output") for m, v in inputs])
        first: tuple[SystemComponent, ...] = ()
        if inputs:
            source = SystemComponent("", self._source, period, Fraction(0), "discrete")
            first = (source,)
            copies += [
                Connection(source, drive, linearized_components[m], v)
                for drive, (m, v) in zip(drives, inputs, strict=True)
            ]
        linear = Schedule(
            schedule.tick,
            first + tuple(linearized_components[m] for m in schedule.discrete),
            tuple(
                Group(g.name, tuple(linearized_components[m] for m in g.components), g.method) for g in schedule.groups
            ),
            (),
            tuple(sorted(copies, key=lambda c: c.target_name)),
            (),
            tuple(find_loops(copies, certain)),
        )
        watched = [(linearized_components[m], v) for m, v in outputs]
        self.exchange = Exchange(linear, watch=watched, interval=period, allow_nan=True)
        initialize(self.exchange)
        self.exchange.check_samples(self._sample)
        self._begin, self._length, self._period = begin, int(period / schedule.tick), period
        self._shown: Array | None = None
        layout = self.exchange.layout
        self._out = [layout.readable[name_of(s)] for s in outputs]
        self._inputs, self._outputs = [name_of(s) for s in inputs], [name_of(s) for s in outputs]
        self._components = list(linearized_components.values())
        # an array of states, their names, whether they are held values
        self._parts: list[tuple[Array, list[str], bool]] = []
        for m, linearized in linearized_components.items():
            self._parts.append((linearized.implementation.x, names[m], False))  # type: ignore[attr-defined]
        for m, linearized in linearized_components.items():
            if not m.discrete:
                labels = [f"{m.name}.{v.name}.held" for v in linearized.implementation._inputs]  # type: ignore[attr-defined]
                self._parts.append((linearized.implementation.held, labels, True))  # type: ignore[attr-defined]
        self._slots = [
            (slot, f"{name_of(key)}.{word}")
            for slots, word in ((layout.visible, "shown"), (layout.previous, "before"))
            for key, slot in slots.items()
            if key[0] not in first
        ]

    def _sample(self, t: float) -> None:  # noqa: ARG002
        """Called at every instant; the first one of the period counts."""
        if self._shown is None:
            self._shown = np.array([scale * self.exchange.values[slot] for slot, scale, _ in self._out])

    def run(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Run one period from state `x` and inputs `u`; return x after the period, and y at its beginning."""
        exchange, place = self.exchange, 0
        for part, _, _ in self._parts:
            part[:] = x[place : place + len(part)]
            place += len(part)
        exchange.values[:] = 0.0
        exchange.values[[slot for slot, _ in self._slots]] = x[place:]
        self._source.values[:] = u
        for m in self._components:
            if isinstance(m.implementation, LinearizedContinuous):
                for variable, value in zip(m.implementation._outputs, m.implementation.outputs_now(), strict=True):
                    exchange.values[exchange.layout.latest[m, variable]] = value
            elif isinstance(m.implementation, LinearizedSampled):
                m.implementation.sample = 0
        exchange.tick, exchange.phase, self._shown = self._begin, Phase.NOTHING, None
        exchange.run_instants(self._begin + self._length)
        later = [*(part for part, _, _ in self._parts), exchange.values[[slot for slot, _ in self._slots]]]
        assert self._shown is not None
        return np.concatenate(later), self._shown

    def matrices(self, units: Mapping[str, str], point: Mapping[str, float]) -> Matrices:
        names = [n for _, labels, _ in self._parts for n in labels] + [n for _, n in self._slots]
        kept = [not is_held for part, _, is_held in self._parts for _ in part] + [False for _ in self._slots]
        n, m = len(names), len(self._inputs)
        _check_size("the system", n + m, n + len(self._outputs))
        a, c = np.zeros((n, n)), np.zeros((len(self._outputs), n))
        b, d = np.zeros((n, m)), np.zeros((len(self._outputs), m))
        for i, unit in enumerate(np.eye(n + m)):
            later, shown = self.run(unit[:n], unit[n:])
            if i < n:
                a[:, i], c[:, i] = later, shown
            else:
                b[:, i - n], d[:, i - n] = later, shown
        keep = list(range(n))
        for _ in itertools.count():  # values that nothing reads any more are no states
            used = [j for j in keep if kept[j] or a[keep, j].any() or c[:, j].any()]
            if used == keep:
                break
            keep = used
        return Matrices(
            a[np.ix_(keep, keep)],
            b[keep],
            c[:, keep],
            d,
            [names[i] for i in keep],
            self._inputs,
            self._outputs,
            float(self._period),
            units,
            point,
        )
