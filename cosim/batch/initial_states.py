"""How the copies of a batch begin: in lanes all at once, or one after the other."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from cosim.batch.lane_source import LaneSource
from cosim.batch.library import Target, interface, lane_library
from cosim.batch.structs import HEADER, CopyFailure, Lanes, Probes, Structs, aligned, beside
from cosim.core.description import Variable
from cosim.core.errors import CallFailed, ComponentError, CosimError
from cosim.core.signals import Array
from cosim.core.time import TimeLike
from cosim.engine.exchange import Exchange
from cosim.engine.plan import ComponentPlan, Plan, make_plan
from cosim.engine.simulation import Simulation
from cosim.engine.stops import StopWhen
from cosim.fmu.own_states import VALUES_AT
from cosim.system.components import SystemComponent
from cosim.system.loops import AlgebraicLoop
from cosim.system.schedule import Schedule
from cosim.system.wiring import Wiring

DISTANCE = 1e-5  # relative distance of instances on both sides of a component without derivatives
Signals = Sequence[tuple[SystemComponent, Variable]]


class Copies:
    """Values and states of the copies of one system; `cosim.batch.Batch` says what they are."""

    system: Wiring
    copies: int
    threads: int
    stop_time: TimeLike | None
    _schedule: Schedule
    _start_time: Fraction
    _interval: Fraction | None
    _record: Signals
    _inputs: Signals
    _outputs: Signals
    _watch: Signals
    _stops: Sequence[StopWhen]
    _target: Target
    _groups: int
    _sources: dict[SystemComponent, LaneSource]
    _alone: dict[SystemComponent, str]
    _seeds: Mapping[tuple[SystemComponent, str], Array]
    _followed: Collection[SystemComponent]
    _moving: Collection[SystemComponent]
    _probed: Collection[SystemComponent]
    _words: tuple[str, str]

    def __init__(self) -> None:
        self._clones: dict[SystemComponent, list[Any]] = {}
        self._simulations: dict[int, Simulation] = {}
        self._lanes: dict[SystemComponent, Lanes] = {}
        self._reset_values: dict[SystemComponent, Array] = {}
        self._samples: dict[SystemComponent, Array] = {}  # of tables with derivatives, see `Structs`
        self._spare: dict[SystemComponent, Lanes] = {}  # of an earlier reset: their libraries and memory serve again

    def _ended(self, failure: CopyFailure) -> None:
        raise NotImplementedError

    _probes: Probes | None = None

    def _begin(self, given: Mapping[tuple[SystemComponent, str], list[Any]]) -> None:
        """Initialize the copies: all at once in lanes, those that cannot be one after the other."""
        self.system.end_simulation()
        kept = [(m, m.values, m.implementation) for m in self._schedule.components]
        exchanges: list[Exchange | None] = [None] * self.copies
        errors: dict[int, ComponentError] = {}

        def initialized(copy: int, clone: int, moved: Mapping[tuple[SystemComponent, str], Any]) -> Exchange:
            for m, values, _ in kept:
                m.values = dict(values)
                m.implementation = self._clones[m][clone if m in self._alone else 0]
            for (m, name), each in given.items():
                m.values[name] = each[copy]
            for (m, name), by in moved.items():
                m.values[name] = _value(m, name) + by
            return self._initialized(clone if self._alone else 0)

        def alone(copy: int) -> None:
            try:
                exchanges[copy] = initialized(copy, copy, {})
            except ComponentError as error:
                errors[copy] = error

        try:
            if not (self._simulations and not self._alone):
                for copy in range(self.copies):
                    alone(copy)
                    if (first := exchanges[copy]) is not None:
                        self._exchange: Exchange = first
                        break
                else:
                    raise errors[0]
            self._prepare(self._exchange, [m for m in self._schedule.components if m not in self._alone])
            if self._alone:
                self._take(self._exchange, copy)
                rest = list(range(copy + 1, self.copies))
            else:
                self._bind(exchanges)
                rest = self._settle(given)
            for copy in rest:
                alone(copy)
                if (exchange := exchanges[copy]) is not None:
                    self._take(exchange, copy)
            if self._probed:
                self._probes = self._make_probes(initialized)
        finally:
            for m, values, component in kept:
                m.values, m.implementation = values, component
        if len(errors) == self.copies:
            raise errors[0]
        good = next(c for c in range(self.copies) if c not in errors)
        for copy in (*errors, *range(self.copies, len(self._alive))):
            self._copy_lane(good, copy)
        self._alive[: self.copies] = 1
        self._alive[self.copies :] = 0
        ended = {} if self._probes is None else self._probes.ended
        ended |= {copy: e.ending for copy, e in enumerate(exchanges) if e is not None and e.ending is not None}
        self._alive[[*errors, *ended]] = 0
        if self._alone or len(rest):  # else they are as they were initialized
            self._start_lanes()
        if self._alone:
            self._bind(exchanges)
        if self._target.directions and (self._alone or len(rest)):
            self._settle_tangents()
        self._tick = self._exchange.tick
        # Number of the first sample, samples, sides of the components.
        self._chunks: list[tuple[int, npt.NDArray[np.float64], npt.NDArray[np.uint64] | None]] = []
        for copy in sorted(errors):
            self._ended(CopyFailure(copy, errors[copy].component, float(self._start_time), str(errors[copy])))
        for copy, ending in ended.items():
            self._ended(CopyFailure(copy, ending.component, self._exchange.time, ending.text))

    def _bind(self, exchanges: Sequence[Exchange | None]) -> None:
        self._structs = Structs(
            self._plan,
            self._exchange,
            exchanges,
            self._lanes,
            self._alone,
            self._whole,
            self._alive,
            self._target,
            self.threads,
            self._probes,
            self._samples,
            self._followed,
        )

    def _settle(self, given: Mapping[tuple[SystemComponent, str], list[Any]]) -> list[int]:
        """Initialize copies in lanes; returns those that cannot be, or that their FMUs may refuse."""
        refused = np.zeros(len(self._alive), dtype=np.bool_)
        for m, lanes in self._lanes.items():
            own = lanes.values()
            own[:] = self._defaults(m)[:, None]
            values: dict[str, Any] = {n: [v] * self.copies for n, v in m.values.items()}
            values |= {n: each for (owner, n), each in given.items() if owner is m}
            for name, each in values.items():
                variable = m.description.variables[name]
                column, (least, most) = np.array(each, dtype=float), variable.limits
                real = variable.type == "real"
                within = np.isfinite(column) if real else column == np.floor(column)
                if variable.causality != "input" or not real:
                    within &= (column >= least) & (column <= most)
                refused[: self.copies] |= ~within
                self._put(lanes.memory, lanes.row(variable), column)
        for copy in range(self.copies, len(self._alive)):
            self._copy_lane(0, copy)
        self._whole[:] = 0.0
        self._alive[:] = ~refused
        self._put_seeds()
        for (m, variable), slot in self._exchange.layout.constants.items():
            self._whole[:, slot, :] = self._lanes[m].whole[:, self._lanes[m].row(variable), :]
        self._start_lanes()
        self._structs.settle()
        self._alive[:] &= np.isfinite(self._values).all(axis=1).ravel()
        for m, lanes in self._lanes.items():
            self._check(m, lanes, given)
        return np.flatnonzero(self._alive[: self.copies] == 0).tolist()

    def _put_seeds(self) -> None:
        """Derivatives of parameters and start values, of which those of all other values follow."""
        if not self._target.directions:
            return
        for lanes in self._lanes.values():
            lanes.whole[:, : lanes.library.cosim_lanes_numbers(), self._target.first :] = 0.0
        for (m, name), seeds in self._seeds.items():
            variable = m.description.variables[name]
            if variable.samples:
                columns = self._samples[m].reshape(self.copies, variable.samples, -1, self._target.width)
                columns[:, :, variable.reference, self._target.first :] = seeds.swapaxes(0, 1)
            elif m in self._lanes:  # else its probes are apart in it
                own = self._lanes[m]
                own.whole[:, own.row(variable), self._target.first :] = seeds

    def _make_probes(
        self, initialized: Callable[[int, int, Mapping[tuple[SystemComponent, str], Any]], Exchange]
    ) -> Probes:
        """Instances a little apart from each copy along each direction (`run_probes` of batch.c)."""
        directions, number = self._target.directions, self.copies
        apart = np.zeros((self.copies, directions))
        exchanges: list[Exchange | None] = []
        for copy, k in np.ndindex(self.copies, directions):
            along = {key: each[..., copy, k] for key, each in self._seeds.items() if each[..., copy, k].any()}
            if not along:
                exchanges += [None, None]
                continue
            apart[copy, k] = step = DISTANCE * min(self._size_of(key) / abs(seed).max() for key, seed in along.items())
            for side in (step, -step):
                moved = {key: side * seed for key, seed in along.items()}
                for (m, name), by in moved.items():
                    if not m.description.variables[name].samples:
                        self._check_range(m, m.description.variables[name], float(by))
                try:
                    exchanges.append(initialized(copy, number, moved))
                except ComponentError as error:
                    raise CosimError(f"{beside(error.component)}: {error}") from error
                number += 1
        return Probes(self._probed, apart, exchanges)

    def _size_of(self, key: tuple[SystemComponent, str]) -> float:
        """Magnitude of a value; of one that is 0 a thousandth of its range, or its nominal value."""
        m, name = key
        v = m.description.variables[name]
        wide = (v.maximum or 0.0) - (v.minimum or 0.0)
        return float(np.max(np.abs(_value(m, name)))) or (1e-3 * wide if 0.0 < wide < np.inf else v.nominal)

    def _check_range(self, m: SystemComponent, v: Variable, by: float) -> None:
        """Refuse a value that has no neighbor on one side."""
        least, most = v.limits
        if not least <= float(_value(m, v.name)) + by <= most:
            raise CosimError(
                f"{m.name}.{v.name} is at the end of its range, so it has neighbors on one side only:"
                f" {', '.join(sorted(c.name for c in self._probed))} can be followed by differences alone; move it a"
                " little"
            )

    def _settle_tangents(self) -> None:
        """Derivatives of initial values, of copies that are initialized."""
        before = self._values.copy()
        self._whole[:, :, self._target.first :] = 0.0
        self._put_seeds()
        if self._probes is not None:
            for plan in self._plan.components:
                if plan.component in self._probes.components:
                    self._put_differences(plan, self._probes)
        for (m, variable), slot in self._exchange.layout.constants.items():
            if m in self._lanes:
                self._whole[:, slot] = self._lanes[m].whole[:, self._lanes[m].row(variable)]
            elif (seeds := self._seeds.get((m, variable.name))) is not None:
                self._whole[: self.copies, slot, self._target.first :] = seeds
        self._start_lanes()
        self._structs.settle()
        moved = (before != self._values).any(axis=(0, 2))
        wrong = [p.component.name for p in self._plan.components if moved[p.first : p.first + p.n_outputs].any()]
        if wrong or moved.any():
            raise CosimError(f"the initial values of {', '.join(wrong)} cannot be computed again with derivatives")

    def _put_differences(self, plan: ComponentPlan, probes: Probes) -> None:
        """Derivatives of the initial outputs of a component that has no derivatives of its own."""
        own = slice(plan.first, plan.first + plan.n_outputs)
        for copy, k in np.argwhere(probes.apart):
            at = 2 * (copy * probes.apart.shape[1] + k)
            above, below = (e.values[own] for e in probes.exchanges[at : at + 2] if e is not None)
            self._whole[copy, own, self._target.first + k] = (above - below) / (2.0 * probes.apart[copy, k])

    def _defaults(self, component: SystemComponent) -> Array:
        """Values of an instance that was only reset."""
        if component not in self._reset_values:
            clone = self._clones[component][0]
            clone.instantiate(component.name)
            data = np.frombuffer(clone.serialize(), dtype=float, offset=VALUES_AT)
            self._reset_values[component] = data[: self._sources[component].n_values].copy()
        return self._reset_values[component]

    def _check(self, m: SystemComponent, lanes: Lanes, given: Mapping[tuple[SystemComponent, str], list[Any]]) -> None:
        """Have an FMU check what only it can: relations of parameters, and its solver with these parameters."""
        port, clone = self._exchange.layout.ports[m], self._clones[m][0]
        own, defaults = lanes.values(), self._defaults(m)
        n, rows = lanes.source.sizes["parameters"], [lanes.row(v) for v in port.inputs]
        for i, variable in enumerate(port.inputs):
            if variable.must_equal is not None:
                column = lanes.memory[:, rows[i], :].ravel()
                self._alive[:] &= [variable.accepts(x) for x in column.tolist()]
        calls = self._exchange.ports[m].fmi
        varied = {name: each for (owner, name), each in given.items() if owner is m}
        named = (m.description.variables[n] for n in (*m.values, *varied))
        at = {v: lanes.row(v) - HEADER for v in named}
        changed = (own[:, :n] != defaults[:n, None]).any(axis=1).ravel()
        if not lanes.source.checks:
            return
        for copy in np.flatnonzero(changed[: self.copies] & (self._alive[: self.copies] == 1)).tolist():
            group, lane = divmod(copy, self._target.lanes)
            values = m.values | {name: each[copy] for name, each in varied.items()}
            clone.instantiate(m.name)
            if calls is None or calls.states is None or calls.instance != clone.address:
                self._alive[copy] = 0
                continue
            set_ = {m.description.variables[name]: v for name, v in values.items()}
            clone.set({v: x for v, x in set_.items() if own[group, at[v], lane] != defaults[at[v]]})
            clone.enter_initialization(float(self._exchange.base.start + m.offset), None)
            port.u[:] = lanes.memory[group, rows, lane]
            self._exchange.ports[m].set_inputs()
            try:
                clone.exit_initialization()
            except CallFailed:
                self._alive[copy] = 0

    def _refuse(self, loops: Sequence[AlgebraicLoop]) -> None:
        """Raise CosimError for algebraic loops."""
        if loops:
            what, instead = self._words
            raise CosimError(
                f"the components {loops[0].names} form an algebraic loop, which {what} does not solve: {instead}, or"
                " give a connection of the loop delay=True"
            )

    def _initialized(self, clone: int) -> Exchange:
        """The exchange of the clones of this number, whose components are initialized."""
        known = self._simulations.get(clone)
        if known is not None:
            known.restart()
        else:
            known = Simulation(
                self._schedule,
                self._start_time,
                record=self._record,
                record_interval=self._interval,
                watch=[*self._outputs, *self._inputs, *self._watch],
                stop_time=self.stop_time,
            )
            self._refuse(known.exchange.loops)
            known.exchange.stop_when(self._stops, known.__getitem__)
        self._simulations[clone] = known
        return known.exchange

    def _take(self, exchange: Exchange, copy: int) -> None:
        """Values and states of a copy that has been initialized."""
        group, lane = divmod(copy, self._target.lanes)
        self._values[group, :, lane] = exchange.values
        for m, lanes in self._lanes.items():
            data = m.implementation.serialize()  # type: ignore[attr-defined]
            lanes.values()[group, :, lane] = np.frombuffer(
                data, dtype=float, offset=VALUES_AT, count=lanes.source.n_values
            )

    def _copy_lane(self, source: int, to: int) -> None:
        lanes = self._target.lanes
        (g, i), (h, k) = divmod(source, lanes), divmod(to, lanes)
        for array in (self._values, *(each.values() for each in self._lanes.values())):
            array[h, :, k] = array[g, :, i]

    def _prepare(self, exchange: Exchange, sources: Sequence[SystemComponent]) -> None:
        """Memory of all copies, once the exchange is known."""
        self._lanes.clear()
        self._plan: Plan = make_plan(exchange)
        lanes, groups = self._target.lanes, self._groups
        self._whole = aligned(groups, self._plan.size, self._target.width)
        self._values = self._whole[:, :, :lanes]
        tables = {m: m.description.variables for m, name in self._seeds if m.description.variables[name].samples}
        self._samples = {
            m: aligned(
                groups, len(columns) * next(v.samples for v in columns.values() if v.samples), self._target.width
            )
            for m, columns in tables.items()
        }
        self._alive = np.ones(groups * lanes, dtype=np.uint8)
        for m in sources:
            source, outputs = self._sources[m], exchange.layout.ports[m].outputs
            places = map(source.place, outputs)
            shown = tuple(sorted({slot for role, slot in places if role == "output"}))
            spare = self._spare.get(m)
            if spare is None or len(spare.whole) < groups:
                still = m not in self._moving
                library = lane_library(source, shown, self._target, still=still) if spare is None else spare.library
                whole = aligned(groups, library.cosim_lanes_rows(), self._target.width)
                spare = self._spare[m] = Lanes(source, library, whole, lanes)
            self._lanes[m] = replace(spare, whole=spare.whole[:groups])

    def _start_lanes(self) -> None:
        ffi, base = interface(), self._exchange.base
        for m, lanes in self._lanes.items():
            begin = float(base.start + m.offset)
            lanes.memory[:, 0:2] = begin
            lanes.memory[:, 2:HEADER] = 0.0
            for group in lanes.whole:
                lanes.library.cosim_lanes_prepare(ffi.cast("void*", group.ctypes.data))

    def _put(self, array: npt.NDArray[np.float64], row: int, column: Array) -> None:
        full = np.zeros(array.shape[0] * array.shape[2])
        full[: self.copies] = column
        array[:, row, :] = full.reshape(array.shape[0], array.shape[2])


def _value(m: SystemComponent, name: str) -> Any:
    """What a variable starts with: a number, or samples (rows,)."""
    found = m.start(name)
    return 0.0 if found is None else np.asarray(found, dtype=float)
