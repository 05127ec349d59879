"""Derivatives of a run by many parameters, carried from its end to its beginning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cosim.batch.copies import Batch
from cosim.batch.library import Target, batch_library, interface
from cosim.batch.structs import HEADER
from cosim.core.errors import CosimError
from cosim.core.memory import physical_memory
from cosim.core.signals import Array
from cosim.core.time import TimeLike, rational
from cosim.engine.execution import Record
from cosim.engine.simulation import Simulation
from cosim.fmu.own_states import saved_values
from cosim.recording.recording import Recording
from cosim.system.components import SystemComponent
from cosim.system.wiring import Wiring

SEGMENTS = 64  # of a run: as many states are saved, and the tape of one is kept
TRIED = 4  # segments that begin to run first, to see what depends on the parameters
PARTS = 8  # of such a segment, of which the first one runs
WIDTHS = (1, 2, 4, 8)  # results side by side (adjoints.h)
_SPARE = 4096  # TAPE_SPARE
_ENTRIES = 1 << 18  # entries that a tape has space for at first; memory that is not written takes none

Numbers = npt.NDArray[np.float64]
Indices = npt.NDArray[np.uint64]
Which = npt.NDArray[np.bool_]


class Tape:
    """Memory of a tape (batch.h) for so many entries, a power of two, and four operands for each."""

    def __init__(self, entries: int):
        operands = 4 * entries
        if 64 * entries > physical_memory() // 2:  # with what is computed for each entry
            raise CosimError(
                "the operations of a part of this run need more than half of the memory of this machine"
                f" ({physical_memory() / 1e9:.3g} GB): end it earlier, or take mode='forward'"
            )
        self.slopes, self.operands = np.empty(operands + _SPARE), np.empty(operands + _SPARE, np.uint32)
        self.ends = np.empty(entries, np.uint32)
        self.struct = t = interface().new("Tape*")
        t.slopes = interface().cast("double*", self.slopes.ctypes.data)
        t.operands = interface().cast("uint32_t*", self.operands.ctypes.data)
        t.ends = interface().cast("uint32_t*", self.ends.ctypes.data)
        t.most, t.mask = operands, entries - 1

    def begin(self, independents: int) -> None:
        """Forget all but the numbers 1 to `independents`, which depend on nothing."""
        self.struct.n, self.struct.n_operands = independents, 0
        self.ends[independents & int(self.struct.mask)] = 0

    @property
    def full(self) -> bool:
        """Whether there was no space for some entries."""
        return bool(self.struct.n > self.struct.mask or self.struct.n_operands >= self.struct.most)


class NoAdjointError(CosimError):
    """A system with components that have no adjoint."""


@dataclass
class _State:
    """Where a segment begins: its tick, the values of the exchange, and of each component those of its instance."""

    tick: int
    exchange: Numbers
    components: list[tuple[Numbers, Numbers]]  # header; values and warm starts of quadratic programs


class AdjointRun(Batch):
    """One run, and derivatives of its results by parameters, start values, inputs and series, whatever their number.

    The engine runs the system once and saves a state at the beginning of each of `SEGMENTS` segments. Then each
    segment, from the last to the first, runs again from its state over numbers whose operations are kept on a tape
    (adjoints.h): what the results owe to the numbers at its end becomes what they owe to those at its beginning.

    Raises NoAdjointError naming components that have no adjoint.
    """

    def __init__(self, system: Wiring, names: Sequence[str], record: Record, stop_time: TimeLike):
        samples = [m.description.variables[v].samples for m, v in map(system.components.split, names)]
        self._n, self._n_samples = sum(n or 1 for n in samples), sum(samples)
        # Samples are the first numbers of each tape; the other ones are the first of that of the begin only.
        is_sample = np.repeat([n > 0 for n in samples], [n or 1 for n in samples])
        self._order = np.argsort(np.argsort(~is_sample, kind="stable"), kind="stable")
        indices = (self._order + 1).astype(np.uint64).view(np.float64)
        ends = np.cumsum([n or 1 for n in samples])
        seeds = {
            name: indices[end - (n or 1) : end].reshape((n, 1, 1) if n else (1, 1))
            for name, n, end in zip(names, samples, ends, strict=True)
        }
        super().__init__(system, 1, record=record, stop_time=stop_time, threads=1, seeds=seeds, begin=False)
        without = {m.name: why for m, why in self._fixed_reasons.items() if not m.description.native}
        if without:
            why = "; ".join(f"'{name}' has no adjoint ({why})" for name, why in without.items())
            raise NoAdjointError(f"{why}: take mode='forward'")
        self._begun = self._tape = Tape(_ENTRIES)
        while True:
            self._begun.begin(self._n)
            self.reset()
            if not self._begun.full:
                break
            self._begun = self._tape = Tape(4 * len(self._begun.ends))
        # Memory of the exchange and of each component, and rows that can depend on the parameters between instants.
        self._components = [m for m in self._schedule.components if m in self._lanes and m in self._followed]
        self._arrays = [(self._whole[0], np.arange(len(self._whole[0])))]
        self._arrays += [(self._lanes[m].whole[0], self._lasting(m)) for m in self._components]
        self._borders = np.cumsum([len(rows) for _, rows in self._arrays])[:-1]
        self._counts = [self._lanes[m].source.n_values for m in self._components]
        self._warm_starts = [self._warm_starts_of(m) for m in self._components]
        self._first = self._indices()
        self._sides = [self._lanes[m].sides for m in self._components]
        self._first_sides = [each.copy() for each in self._sides]

    def _with_derivatives(self) -> Target:
        return self._target.with_adjoints()

    def _lasting(self, m: SystemComponent) -> npt.NDArray[np.intp]:
        """Rows of the values of an instance, of solutions, and of what depends on its parameters only."""
        lanes = self._lanes[m]
        end, further = lanes.library.cosim_lanes_numbers(), sum(lanes.source.sizes[k] for k in ("qp_solution", "fixed"))
        return np.r_[HEADER : HEADER + lanes.source.n_values, end - further : end]

    def _warm_starts_of(self, m: SystemComponent) -> Numbers:
        at = self._lanes[m].library.cosim_lanes_memory() // 8
        return self._lanes[m].whole[0].reshape(-1)[at : at + self._lanes[m].source.sizes["qp_memory"]]

    @property
    def side_changes(self) -> dict[str, int]:
        """As of a batch, after `backward`."""
        changes = {}
        for m, each in zip(self._components, zip(*self._taken, strict=True), strict=True):
            taken = np.concatenate(each)  # by segment
            last, first = taken["last"][:-1], taken["first"][1:]
            changes[m.name] = int(taken["changes"].sum() + ((last != 0) & (last != first)).sum())
        return changes

    def _start_lanes(self) -> None:
        self._use(self._begun)
        super()._start_lanes()

    def _use(self, tape: Tape) -> None:
        self._tape = tape
        for library in (batch_library(self._target), *(m.library for m in self._lanes.values())):
            library.cosim_use_tape(tape.struct)

    def forward(self, until: TimeLike) -> Recording:
        """Run to a time [s] and save states. Raises ComponentError for a run that fails."""
        base = self._exchange.base
        self._end = base.at_or_after(rational(until, "until"))
        bounds = np.unique(np.linspace(self._tick, self._end, SEGMENTS + 1).astype(np.int64)).tolist()
        self._make_room(self._end)
        self._states: list[_State] = []
        simulation = Simulation(
            self._schedule,
            self._start_time,
            record=self._record,
            record_interval=self._interval,
            stop_time=self.stop_time,
        )
        counts = [n + len(warm) for n, warm in zip(self._counts, self._warm_starts, strict=True)]
        with simulation:
            for tick, following in pairwise(bounds):
                data = [m.implementation.serialize() for m in self._components]  # type: ignore[attr-defined]
                saved = [saved_values(each, count) for each, count in zip(data, counts, strict=True)]
                self._states.append(_State(tick, simulation.exchange.values.copy(), saved))
                if simulation.advance(base.exact(following), final=following == self._end) is not None:
                    raise CosimError(f"the run ends at t = {simulation.time:.9g} s, before {until} s")
            return simulation.recording

    def backward(self, weights: Sequence[Array]) -> Array:
        """Derivatives (results, parameters) of results whose derivatives by the samples are `weights`.

        weights: of each result (samples, variables).
        """
        active: Which = self._first != 0
        self._taken: list[list[npt.NDArray[np.void]]] = [[] for _ in self._states]
        for number in np.unique(np.linspace(0, len(self._states) - 1, TRIED).astype(int)).tolist():
            while (more := self._run_segment(number, active, PARTS)) is not None:
                active = more
        found = []
        for i in range(0, len(weights), WIDTHS[-1]):
            part = np.stack(weights[i : i + WIDTHS[-1]], axis=-1)
            width = next(w for w in WIDTHS if w >= part.shape[-1])
            part = np.pad(part, [(0, 0), (0, 0), (0, width - part.shape[-1])])
            part *= self._exchange.layout.record_conversion[0][:, None]
            while isinstance(swept := self._swept(part, active), tuple):
                (active,) = swept
            found.append(swept)
        return np.concatenate(found, axis=-1).T[: len(weights)]

    def _swept(self, weights: Array, active: Which) -> Array | tuple[Which]:
        """Of as many results as go side by side: (samples, variables, results) to (parameters, results).

        active: what depends on the parameters where segments begin; where that is more, it is returned instead.
        """
        rows, period = self._rows[0], self._plan.clocks[-1].period
        end, width = len(weights), weights.shape[-1]
        first, n = self._n_samples + 1, self._n_samples + int(np.count_nonzero(active))
        of, by_end = np.zeros((first, width)), np.zeros((0, width))  # those by the samples stay from tape to tape
        for number, state in reversed(list(enumerate(self._states))):
            more = self._run_segment(number, active)
            if more is not None:
                return (more,)
            if len(of) < len(self._tape.ends):
                of = np.concatenate([of[:first], np.zeros((len(self._tape.ends) - first, width))])
            begin = max(0, -(-state.tick // period) - self._chunks[0][0])
            np.add.at(of, rows[0, begin:end, :, 1].astype(np.intp), weights[begin:end])
            if len(by_end):
                np.add.at(of, self._indices()[active], by_end)
            of[0] = 0.0
            self._sweep(self._tape, of, n)
            end, by_end = begin, of[first : n + 1].copy()
            of[first : n + 1] = 0.0
        of = np.concatenate([of[:first], np.zeros((len(self._begun.ends) - first, width))])
        np.add.at(of, self._first[active], by_end)
        of[0] = 0.0
        self._sweep(self._begun, of, self._n)
        return of[1 : self._n + 1][self._order]

    def _run_segment(self, number: int, active: Which, parts: int = 1) -> Which | None:
        """Run one segment with its operations on the tape, on which samples and numbers that are active are the first.

        parts: the segment is divided into so many, and the first of them runs. Returns all that is active if that is
        more in the end.
        """
        state = self._states[number]
        end = self._end if state is self._states[-1] else self._states[number + 1].tick
        end -= (end - state.tick) * (parts - 1) // parts
        indices = (np.cumsum(active, dtype=np.uint64) + np.uint64(self._n_samples)) * active
        if self._tape is self._begun:
            self._use(Tape(_ENTRIES))
        while True:
            self._whole[0, :, 0] = state.exchange
            for (array, _), n, warm, (header, values) in zip(
                self._arrays[1:], self._counts, self._warm_starts, state.components, strict=True
            ):
                array[: len(header), 0], array[HEADER : HEADER + n, 0], warm[:] = header, values[:n], values[n:]
            for (array, its_rows), own in zip(self._arrays, np.split(indices, self._borders), strict=True):
                array[its_rows, 1] = own.view(np.float64)
            for sides, at_first in zip(self._sides, self._first_sides, strict=True):
                sides[:] = 0 if number else at_first
            self._tape.begin(self._n_samples + int(np.count_nonzero(active)))
            self._structs.batch.next_group = 0
            self._structs.run(self._structs.workers[0], state.tick, end, end == self._end)
            if not self._tape.full:
                break
            self._use(Tape(4 * len(self._tape.ends)))
        if not self._alive[0]:
            raise CosimError(str(self._structs.failure(0)))
        self._taken[number] = [each.copy() for each in self._sides]
        now = active | (self._indices() != 0)
        return None if (now == active).all() else self._closed(now)

    def _closed(self, active: Which) -> Which:
        """With all states and outputs of components of which one is active: the next segments would find them."""
        exchange, *parts = np.split(active, self._borders)
        plans = {plan.component: plan for plan in self._plan.components}
        for m, own in zip(self._components, parts, strict=True):
            source = self._lanes[m].source
            behind_inputs = own[source.sizes["parameters"] + source.sizes["inputs"] : len(own) - source.sizes["fixed"]]
            if behind_inputs.any():
                behind_inputs[:] = True
                exchange[plans[m].first : plans[m].first + plans[m].n_outputs] = True
        return active

    def _indices(self) -> Indices:
        """On the tape, of all that can depend on the parameters; 0 where it does not."""
        return np.concatenate([array[rows, 1] for array, rows in self._arrays]).view(np.uint64)

    def _sweep(self, tape: Tape, of: Array, first: int) -> None:
        at = interface().cast("double*", of.ctypes.data)
        batch_library(self._target).cosim_sweep_back(tape.struct, at, first, of.shape[1])
