"""Many copies of one system, stepped together. See `Batch`."""

from __future__ import annotations

import math
import os
import time as clock
import warnings
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import did_you_mean, whole_number
from cosim.batch.initial_states import Copies
from cosim.batch.lane_source import LaneSource, NoLanes, lane_source
from cosim.batch.library import Target, choose_target
from cosim.batch.structs import CopyFailure
from cosim.core.description import Variable
from cosim.core.errors import CallFailed, ComponentError, CosimError, TimeError, UnconnectedInputsWarning, WiringError
from cosim.core.interrupt import HeldInterrupt
from cosim.core.memory import physical_memory
from cosim.core.signals import Array
from cosim.core.time import TimeLike, positive, rational, seconds_text
from cosim.engine.execution import Record
from cosim.engine.stops import StopWhen, watched_names
from cosim.fmu.component import FmuComponent
from cosim.recording.recording import Recording
from cosim.system.components import SystemComponent
from cosim.system.schedule import only_numbers
from cosim.system.wiring import Wiring

_TWIN = 1024  # bytes that an instance of an FMU needs at least
_PIECE = 0.1  # s of wall time between looks at Ctrl-C


class CopyFailedWarning(UserWarning):
    """A copy has ended with an error; the others continue."""


@dataclass(frozen=True)
class BatchRecording:
    """Recorded values of a batch. `recording["car.body.az"]` is one variable, of shape (copies, samples).

    `time` [s] has the shape (samples,), `data` (copies, samples, variables); `names` and `units` are those of the
    variables. Values of a copy are NaN after it has ended. `failed`: time [s] at which a copy failed; `stopped`: the
    stop condition that has ended a copy, and the time; `about`: the rest of what a `Recording` has; `tangents`:
    derivatives of `data` along the `seeds` (copies, samples, variables, directions); `sides`: numbers that are equal
    where components have taken the same sides of all comparisons so far (copies, samples, components).
    """

    time: Array
    names: list[str]
    data: Array
    units: dict[str, str] = field(default_factory=dict)
    failed: Mapping[int, float] = field(default_factory=dict)
    stopped: Mapping[int, tuple[str, float]] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)
    tangents: Array = field(default_factory=lambda: np.empty(0))
    sides: npt.NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))

    def __getitem__(self, name: str) -> Array:
        if name not in self.names:
            raise KeyError(f"'{name}' was not recorded{did_you_mean(name, self.names)}")
        found: Array = self.data[:, :, self.names.index(name)]
        return found

    def one(self, copy: int, until: float = math.inf) -> Recording:
        """What was recorded of one copy until a time [s], as of a run of this copy alone unless it failed before."""
        by, at = self.stopped.get(copy, (None, math.inf))
        count = np.searchsorted(self.time, min(until, at), side="right")
        data = np.asfortranarray(self.data[copy, :count])
        return Recording(
            self.time[:count], list(self.names), data, dict(self.units), by if at <= until else None, **self.about
        )


class Batch(Copies):
    """`copies` of a system, stepped together on all cores; each is bit-identical to a run of its own.

        batch = Batch(system, 1000, start={"car.body.mass": masses}, inputs=["car.force.*"], outputs=["car.body.az"])
        batch.advance("0.1 s")
        az = batch.step("0.01 s", forces)         # (1000, 4) in, (1000, 1) out

    FMUs of this project are vectorized where all copies take the same branches: 2, 4 or 8 copies run in the *lanes*
    of one vector of the processor. Others (quadratic programs, stiff solvers, third-party FMUs, signals from
    tables) run as scalar code in the same batch. `print(batch)` lists both, with reasons.

    Args:
        system: whose components, connections and rates every copy has. The batch uses its components: it has no other
            simulation meanwhile.
        copies: how many.
        start: parameters and start values by full name: one value for all copies, or an array (copies,); of an array
            variable or a series (copies, ...).
        inputs: names and patterns of real inputs that nothing drives, which `set` and `step` take as (copies, n); their
            order is `input_names`. Default: none.
        outputs: names and patterns of what `outputs` and `step` give as (copies, n); their order is `output_names`.
        record, start_time, stop_time: as in `System.initialize`.
        stop_when: as in `System.run`, but no functions. A copy that satisfies one ends without a failure; `stopped`
            says which.
        threads: default one for each core that this process may use. The bits do not depend on it.
        vectors: "avx512", "avx2", "baseline" (what every processor has), or "auto", the widest that this one has. Nor
            on this.
        begin: False where `reset` or `reset_each` comes later.
        seeds: derivatives of parameters and start values, by full name (copies, directions); of a series (rows, copies,
            directions). All have the same number of directions, which fills whole vectors: a multiple of 8 does so on
            every processor. What is recorded then has derivatives (`BatchRecording.tangents`); components on which no
            output or recorded variable depends do without.

    A copy that fails (a state without bounds, an FMU's error, an output that is not finite) ends; the others go on. It
    is in `failures`, a CopyFailedWarning tells of it, and its outputs are NaN from then on. An output that nothing
    reads is not computed in lanes, so a copy does not end when only such an output is not finite.

    Raises WiringError for names and values that do not fit, CosimError for a system that cannot be in a batch, and
    where there is no C compiler, ComponentError when no copy can be initialized.
    """

    def __init__(
        self,
        system: Wiring,
        copies: int,
        *,
        start: Mapping[str, Any] | None = None,
        inputs: str | Iterable[str] = (),
        outputs: str | Iterable[str] = (),
        record: Record | str | Iterable[str] = (),
        start_time: TimeLike | None = None,
        stop_time: TimeLike | None = None,
        stop_when: Sequence[StopWhen] = (),
        threads: int | None = None,
        vectors: str = "auto",
        begin: bool = True,
        seeds: Mapping[str, Array] | None = None,
    ):
        self.system = system
        # What messages call this, and what they advise instead.
        self._words = (
            ("a gradient", "compare runs with different values instead")
            if seeds
            else ("a batch", "run the copies without a batch")
        )
        self._set_copies(copies)
        for m in system.components.values():
            if not isinstance(m.implementation, FmuComponent) and not m.description.native:
                what, instead = self._words
                raise CosimError(
                    f"'{m.name}' is written in Python, and {what} has no Python in its loop: declare it as a component"
                    f" that build-fmus makes an FMU of, or {instead}"
                )
        if threads is not None:
            whole_number("threads", threads, error=CosimError)
        self.threads = int(threads) if threads is not None else _cores()
        self._inputs = self._free_inputs(inputs)
        self.input_names = [f"{m.name}.{v.name}" for m, v in self._inputs]
        self._outputs = system.select(_listed(outputs)) if _listed(outputs) else []
        self.output_names = [f"{m.name}.{v.name}" for m, v in self._outputs]
        kept = Record.of(record)
        self._record = system.select(kept.names) if kept.names else []
        self.record_names = [f"{m.name}.{v.name}" for m, v in self._record]
        self._interval = None if kept.interval is None else positive(kept.interval, "the interval of the record")
        self._start_time = system.experiment[0] if start_time is None else rational(start_time, "start_time")
        self.stop_time = stop_time
        self._stops = list(stop_when)
        self._watch = [pair for name in watched_names(self._stops) for pair in system.select([name])]
        if any(not isinstance(s, StopWhen) for s in self._stops):
            raise CosimError("copies end by conditions StopWhen(name, relation, value), not by functions")
        free = [n for n in system.unconnected() if n not in self.input_names and n not in (start or {})]
        if free and not system.allow_unconnected:
            more = f" and {len(free) - 10} more" if len(free) > 10 else ""
            text = (
                f"inputs that nothing drives keep their start values: {', '.join(free[:10])}{more}"
                f" ({UnconnectedInputsWarning.remedy})"
            )
            warnings.warn(text, UnconnectedInputsWarning, stacklevel=2)
        self._target: Target = choose_target(vectors)
        self._seeds = {system.components.split(name): np.asarray(value) for name, value in (seeds or {}).items()}
        if self._seeds:
            self._target = self._with_derivatives()
        schedule = system.schedule(*([] if self._interval is None else [self._interval]))
        for c in schedule.parameters:
            raise WiringError(
                f"{c.source_name} -> {c.target_name} passes on a calculated parameter, which {self._words[0]} does not:"
                " set the parameter instead, and take this connection out"
            )
        self._schedule = only_numbers(schedule, *self._words)
        self._refuse(self._schedule.loops)
        self._sources: dict[SystemComponent, LaneSource] = {}
        self.scalar: dict[str, str] = {}
        """Names of components that are not vectorizable, and why."""
        self._fixed_reasons: dict[SystemComponent, str] = {}
        for m in system.components.values():
            try:
                self._sources[m] = self._lanes_of(m)
            except NoLanes as reason:
                self._fixed_reasons[m] = str(reason)
        read = [
            *self._outputs,
            *self._record,
            *self._watch,
            *((c.source, c.output) for c in system.connections.values()),
        ]
        for m, v in read:
            if m in self._sources and self._sources[m].place(v)[0] == "derivative":
                del self._sources[m]
                self._fixed_reasons[m] = f"its derivative {v.name} is read"
        for m, name in self._seeds:
            if m in self._sources and self._sources[m].profiles:
                raise CosimError(
                    f"{m.name}.{name} has no derivative: {m.description.name} computes random profiles from its"
                    " parameters"
                )
        self.scalar = {m.name: why for m, why in self._fixed_reasons.items()}
        tables = {m for m in self._fixed_reasons if m.description.native}
        self._followed = self._reached({m for m, _ in (*self._outputs, *self._record)}, backward=True)
        self._moving = self._followed & self._reached({m for m, _ in self._seeds})
        self._probed = (self._moving & set(self._fixed_reasons)) - tables
        self._check_memory()
        super().__init__()
        self._pool: ThreadPoolExecutor | None = None
        self.failures: list[CopyFailure] = []
        """Copies that have failed, in the order in which that was found."""
        self.stopped: dict[int, tuple[str, float]] = {}
        """By copy, the stop condition that has ended it, and the time [s]."""
        if begin:
            self.reset(start)

    def _with_derivatives(self) -> Target:
        """Of numbers that have derivatives in the directions of the seeds."""
        widths = {s.shape[-2:] for s in self._seeds.values()}
        _, directions = next(iter(widths)) if len(widths) == 1 and len(min(widths)) == 2 else (0, 0)
        if widths != {(self.copies, directions)} or directions % self._target.lanes or not directions:
            raise CosimError(
                f"the seeds have the shapes {', '.join(map(str, sorted(widths)))}; give all of them the same,"
                f" ({self.copies}, n), where n is a multiple of {self._target.lanes}"
            )
        return self._target.with_tangents(directions)

    def _check_memory(self) -> None:
        """Raise an error when the values of the copies alone need more memory than this machine has.

        The check comes first, before the system starts to swap.
        """
        needed = 8.0 * self.copies * sum(
            source.n_values for source in self._sources.values()
        ) + _TWIN * self.copies * len(self._fixed_reasons)
        for m, name in self._seeds:
            needed += 8.0 * self.copies * m.description.variables[name].samples * self._target.width
        if needed > physical_memory():
            instead = "take mode='adjoint'" if self._seeds else "make fewer, and several batches one after the other"
            raise CosimError(
                f"{self.copies} copies need {needed / 1e9:.3g} GB of memory at least, and this machine has"
                f" {physical_memory() / 1e9:.3g} GB: {instead}"
            )

    def _reached(self, found: set[SystemComponent], *, backward: bool = False) -> set[SystemComponent]:
        """With all components that depend on these, or that these depend on."""
        pairs = [(c.source, c.target)[:: -1 if backward else 1] for c in self.system.connections.values()]
        while more := {b for a, b in pairs if a in found} - found:
            found = found | more
        return found

    def _lanes_of(self, component: SystemComponent) -> LaneSource:
        implementation = component.implementation
        if not isinstance(implementation, FmuComponent):
            raise NoLanes("its signals are from a table")
        if implementation.integrated:
            raise NoLanes("the master integrates it (Model Exchange)")
        if implementation.isolation is not None:
            raise NoLanes("it is isolated in a process of its own")
        source = lane_source(implementation.fmu)
        if source.one_at_a_time and not self._target.directions:
            raise NoLanes(source.one_at_a_time)
        return source

    def _free_inputs(self, names: str | Iterable[str]) -> list[tuple[SystemComponent, Variable]]:
        components, driven = self.system.components, self.system.connections
        found: dict[tuple[SystemComponent, Variable], None] = {}
        for name in _listed(names):
            pattern = "*" in name or "?" in name
            chosen = [
                (m, v)
                for m, v in components.fitting(name, "input")
                if not pattern or f"{m.name}.{v.name}" not in driven
            ]
            if not chosen:
                free = ", ".join(self.system.unconnected()) or "none"
                raise WiringError(f"'{name}' fits no unconnected input; there are: {free}")
            for m, v in chosen:
                full = f"{m.name}.{v.name}"
                if full in driven:
                    raise WiringError(f"{full} is driven by {driven[full].source_name}")
                if v.causality != "input":
                    raise WiringError(f"{full} is no input, but {v.causality}: give it in start=..., or to reset()")
                if v.type != "real":
                    raise WiringError(f"{full} is of type {v.fmi_type}; inputs of a batch are real")
                found[m, v] = None
        return list(found)

    # Beginning.

    def reset(self, start: Mapping[str, Any] | None = None, *, copies: int | None = None) -> None:
        """Reset all copies to the start time, with these parameters and start values (see the class).

        Other parameters keep the values of the system. `copies`: how many from now on.
        """
        if copies is not None:
            self._set_copies(copies)
        self._reset(self._given(start or {}))

    def reset_each(self, values: Sequence[Mapping[str, Mapping[str, Any]]]) -> None:
        """As `reset`, to one copy for each of `values`: all values of the components, by component and variable."""
        self._set_copies(len(values))
        keys = [(m, n) for m, own in values[0].items() for n in own]
        self._reset({(self.system[m], n): [v[m][n] for v in values] for m, n in keys})

    def _reset(self, given: Mapping[tuple[SystemComponent, str], list[Any]]) -> None:
        self.failures, self.stopped, self._wall_time = [], {}, 0.0
        before, self._alone = getattr(self, "_alone", None), dict(self._fixed_reasons)
        for m in self._sources:
            steps = given.get((m, "solver.step"))
            if steps is not None and len(set(steps)) > 1:
                self._alone[m] = "its copies have different solver.step"
        self.scalar = {m.name: why for m, why in sorted(self._alone.items(), key=lambda item: item[0].name)}
        lanes = self._target.lanes
        self._groups = -(-self.copies // lanes)
        seeds = [abs(s).reshape(-1, *s.shape[-2:]).sum(axis=0) for s in self._seeds.values()]
        probes = 2 * np.count_nonzero(sum(seeds)) if self._probed else 0
        if before != self._alone:
            self._simulations.clear()
        for m in self._schedule.components:
            clones = self._clones.setdefault(m, [])
            while len(clones) < (self.copies + probes if m in self._alone else 1):
                clones.append(m.implementation.clone())  # type: ignore[attr-defined]
        self._begin(given)

    def _set_copies(self, copies: int) -> None:
        whole_number("copies", copies, error=CosimError)
        self.copies = int(copies)

    def _given(self, start: Mapping[str, Any]) -> dict[tuple[SystemComponent, str], list[Any]]:
        """Start values of all copies, element by element."""
        found: dict[tuple[SystemComponent, str], list[Any]] = {}
        for name, value in start.items():
            component, variable = self.system.components.split(name)
            array = np.asarray(value)
            own = component.description.arrays.get(component.description.canonical(variable))
            described = component.description.variables.get(component.description.canonical(variable))
            is_array = bool(described.samples) if described else own is not None
            each = array.ndim >= 1 and len(array) == self.copies and (not is_array or array.ndim > 1)
            if not each and array.ndim >= 1 and not is_array:
                raise WiringError(
                    f"{name} has shape {array.shape}; give one value for all copies, or an array of shape"
                    f" ({self.copies},)"
                )
            for copy in range(self.copies):
                try:
                    expanded = component.expand(
                        variable, (array[copy] if array.ndim > 1 else array[copy].item()) if each else value
                    )
                except WiringError as error:
                    raise WiringError(f"copy {copy}: {error}" if each else str(error)) from None
                for n, v in expanded.items():
                    found.setdefault((component, n), [None] * self.copies)[copy] = v
                if not each:
                    for n in expanded:
                        found[component, n] = [found[component, n][0]] * self.copies
                    break
        return found

    # Stepping.

    @property
    def time(self) -> float:
        """Present time [s] of all copies that run."""
        return self._exchange.base.seconds(self._tick)

    @property
    def running(self) -> npt.NDArray[np.bool_]:
        """Which copies have not ended, (copies,)."""
        return self._alive[: self.copies].astype(np.bool_)

    def set(self, values: npt.ArrayLike) -> None:
        """Set `inputs`, values (copies, n) in the order of `input_names`, effective from the next step on.

        Raises WiringError for another shape and for numbers that are not finite.
        """
        given = np.asarray(values, dtype=float)
        if given.shape != (self.copies, len(self._inputs)):
            raise WiringError(
                f"the inputs have shape {given.shape}; give {(self.copies, len(self._inputs))}, a row for each copy"
            )
        running = self.running
        wrong = np.argwhere(~np.isfinite(given) & running[:, None])
        if len(wrong):
            copy, i = wrong[0]
            raise WiringError(f"copy {copy}: {self.input_names[i]} is {given[copy, i]}; inputs are finite")
        self._check_limits(given, running)
        constants = self._exchange.layout.constants
        for i, (m, v) in enumerate(self._inputs):
            column = np.where(running, given[:, i], 0.0)
            if m in self._lanes:
                self._put(self._lanes[m].memory, self._lanes[m].row(v), column)
            if (m, v) in constants:
                self._put(self._values, constants[m, v], column)
        for m in self._alone:
            mine = [(i, v) for i, (owner, v) in enumerate(self._inputs) if owner is m]
            for copy in np.flatnonzero(running) if mine else ():
                try:
                    self._clones[m][copy].set({v: float(given[copy, i]) for i, v in mine})
                except CallFailed as failure:
                    self._alive[copy] = 0
                    self._ended(
                        CopyFailure(int(copy), m.name, self.time, str(ComponentError(failure, self.time, None)))
                    )

    def _check_limits(self, given: Array, running: npt.NDArray[np.bool_]) -> None:
        """As those of `Simulation.set`."""
        for i, (m, v) in enumerate(self._inputs):
            low, high = v.limits
            suspect = (given[:, i] < low) | (given[:, i] > high) | (v.must_equal is not None)
            for copy in np.flatnonzero(suspect & running):
                try:
                    m.expand(v.name, float(given[copy, i]))
                except WiringError as error:
                    raise WiringError(f"copy {copy}: {error}") from None

    def step(self, duration: TimeLike, inputs: npt.ArrayLike | None = None) -> Array:
        """Set `inputs` (copies, n) if given, advance by `duration` [s], and return the outputs (copies, n).

        `duration` is a multiple of the base tick.
        """
        base = self._exchange.base
        end = self._tick + base.count(positive(duration, "duration"))
        if inputs is not None:
            self.set(inputs)
        self.advance(base.exact(end))
        return self.outputs

    def advance(self, until: TimeLike, *, final: bool = False) -> None:
        """Advance all copies to the first base tick at or after `until` [s].

        `final`: the last row is the row of `System.run`; only `reset` may follow. Ctrl-C stops between two instants,
        at the same one for all copies.
        """
        exchange = self._exchange
        end = exchange.base.at_or_after(rational(until, "until"))
        if end < self._tick:
            raise TimeError(f"cannot advance to {until} s: the batch stands at {self.time:.9g} s")
        if not self._plan.exact_until(end):
            raise TimeError(
                f"{until} s is beyond what a batch counts exactly with a tick of {seconds_text(self._schedule.tick)}"
            )
        if end == self._tick:
            return
        self._make_room(end)
        length = max(1, (end - self._tick) // 64)
        with HeldInterrupt() as interrupt:
            while self._tick < end and self._alive.any():
                begin = clock.perf_counter()
                self._run(min(end, self._tick + length), final and self._tick + length >= end)
                if interrupt.pending:
                    break
                took = clock.perf_counter() - begin
                self._wall_time += took
                length = max(1, int(length * min(8.0, _PIECE / max(took, 1e-6))))
        if interrupt.pending:
            raise KeyboardInterrupt
        self._tick = end

    def _make_room(self, end: int) -> None:
        period = self._plan.clocks[-1].period
        first, last = -(-self._tick // period), end // period
        count = max(last - first + 1, 0) if self._plan.recorded else 0
        directions = self._target.directions
        rows = np.full((self.copies, count, len(self._plan.recorded), 1 + directions), np.nan)
        sides = np.zeros((self.copies, count, len(self._plan.components)), dtype=np.uint64) if directions else None
        if count > 0:
            self._chunks.append((first, rows, sides))
        self._rows = rows, sides
        self._structs.record_to(rows, sides, first)

    def _run(self, end: int, final: bool) -> None:
        """One piece, by all threads."""
        run, workers = self._structs.run, self._structs.workers[: min(self.threads, self._groups)]
        before = self._alive.copy()
        self._structs.batch.next_group = 0
        if len(workers) == 1:
            run(workers[0], self._tick, end, final)
        else:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(self.threads, thread_name_prefix="cosim-batch")
            list(self._pool.map(lambda w: run(w, self._tick, end, final), workers))
        self._tick = end
        for copy in np.flatnonzero(before != self._alive).tolist():
            stopped = self._structs.stopped(copy)
            if stopped is None:
                self._ended(self._structs.failure(copy))
            else:
                self.stopped[copy] = str(self._stops[stopped[0]]), self._exchange.base.seconds(stopped[1])

    # What failed.

    def _ended(self, failure: CopyFailure) -> None:
        self.failures.append(failure)
        warnings.warn(str(failure), CopyFailedWarning, stacklevel=4)

    # Looking at it.

    def __getitem__(self, name: str) -> Array:
        """Present values (copies,) of a variable among `outputs`, `inputs` or `record`; NaN for ended copies."""
        readable = self._exchange.layout.readable
        full = self.system.components.canonical(name)
        if full not in readable:
            raise KeyError(
                f"'{name}' is not read by this batch{did_you_mean(name, readable)}; name it in outputs=[...]"
            )
        slot, scale, offset = readable[full]
        found: Array = self._values[:, slot, :].flatten()[: self.copies]
        if (scale, offset) != (1.0, 0.0):
            found = scale * found + offset
        found[~self.running] = np.nan
        return found

    @property
    def outputs(self) -> Array:
        """Present values (copies, n) of `output_names`; NaN of copies that have ended."""
        return (
            np.column_stack([self[n] for n in self.output_names]) if self.output_names else np.empty((self.copies, 0))
        )

    @property
    def recording(self) -> BatchRecording:
        """What was recorded so far; the last sample is provisional, as in `Simulation.recording`."""
        layout, clocks = self._exchange.layout, self._plan.clocks
        parts: list[Array] = [np.empty((self.copies, 0, len(self._plan.recorded), 1 + self._target.directions))]
        sides = [np.empty((self.copies, 0, len(self._plan.components)), dtype=np.uint64)]
        numbers: list[int] = []
        for (first, rows, taken), following in zip(self._chunks, [*self._chunks[1:], None], strict=True):
            count = rows.shape[1] if following is None else min(rows.shape[1], following[0] - first)
            parts.append(rows[:, :count])
            sides += [] if taken is None else [taken[:, :count]]
            numbers += range(first, first + count)
        data = parts[1] if len(parts) == 2 else np.concatenate(parts, axis=1)
        ticks = np.array(numbers, dtype=np.int64) * clocks[-1].period
        a, b, d = self._plan.time
        time = (ticks[ticks <= self._tick] * a + b) / d  # exact, see `advance`
        return BatchRecording(
            time,
            list(self.record_names),
            data[:, : len(time), :, 0],
            dict(layout.record_units),
            {f.copy: f.time for f in self.failures},
            self.stopped,
            {
                "wall_time": self._wall_time / self.copies,
                "aliases": layout.aliases,
                "types": layout.record_types,
                "display": layout.record_display,
            },
            data[:, : len(time), :, 1:],
            np.concatenate(sides, axis=1)[:, : len(time)],
        )

    @property
    def side_changes(self) -> dict[str, int]:
        """By component with derivatives, in how many steps it took other sides than in the step before; the most."""
        return {name: int(sides["changes"].max()) for name, sides in self._sides_by_name().items()}

    @property
    def ties(self) -> dict[str, float]:
        """By component in which a tie has decided a derivative, the time [s] of the first step with one."""
        found = self._sides_by_name().items()
        return {name: float(s["tie"][s["ties"] > 0].min()) for name, s in found if s["ties"].any()}

    def _sides_by_name(self) -> dict[str, npt.NDArray[np.void]]:
        """Of components with derivatives what sides they have taken (copies,), see `Lanes`."""
        lanes = self._lanes.items() if self._target.directions else ()
        return {m.name: own.sides[: self.copies] for m, own in lanes}

    @property
    def by_difference(self) -> dict[str, str]:
        """Components whose derivatives are differences of neighboring instances, and why."""
        return {m.name: self._fixed_reasons[m] for m in self.system.components.values() if m in self._probed}

    @property
    def of_exact_solutions(self) -> list[str]:
        """Components whose programs OSQP alone solves, to a tolerance, with derivatives of the exact solutions."""
        return [m.name for m, own in self._sources.items() if m in self._moving and own.approximates]

    def end(self, until: TimeLike) -> tuple[float, int]:
        """Time [s] at which `advance(until)` ends, and the number of samples that `recording` has of a copy then."""
        base = self._schedule.time_base(self._start_time)
        tick = base.at_or_after(rational(until, "until"))
        interval = min(m.step for m in self._schedule.components) if self._interval is None else self._interval
        return base.seconds(tick), tick // base.count(interval) + 1

    def __str__(self) -> str:
        t = self._target
        lines = [
            f"{self.copies} copies in {self._groups} groups of {t.lanes} ({t.name}), {self.threads}"
            f" thread{'s' * (self.threads != 1)}, at t = {self.time:.9g} s"
        ]
        together = [m for m in self._schedule.components if m in self._lanes]
        if together:
            lines.append("in lanes:")
            lines += [f"     {m.name} ({m.description.name})" for m in together]
        if self._alone:
            lines.append("scalar:")
            lines += [
                f"     {m.name} ({m.description.name}): {self._alone[m]}"
                for m in self._schedule.components
                if m in self._alone
            ]
        if self.failures:
            lines.append(f"{len(self.failures)} ended:")
            lines += [f"     {f}" for f in self.failures[:10]]
        return "\n".join(lines)

    # The end.

    def close(self) -> None:
        """Free the copies' own instances; the system stays."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
        for clones in self._clones.values():
            for component in clones:
                component.close()
        self._clones.clear()
        self._simulations.clear()

    def __enter__(self) -> Batch:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _listed(names: str | Iterable[str]) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


def _cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
