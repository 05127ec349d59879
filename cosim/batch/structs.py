"""The structs of `batch.h` for the copies of one system, and what they say of copies that failed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from cosim.batch.lane_source import LaneSource
from cosim.batch.library import Target, batch_library, interface
from cosim.core.component import EndRequested
from cosim.core.description import Variable
from cosim.core.errors import CallFailed, ComponentError
from cosim.engine.bound import BoundEngine
from cosim.engine.exchange import Ending, Exchange
from cosim.engine.plan import ComponentPlan, Plan
from cosim.system.components import SystemComponent

HEADER = 8  # rows of a group's memory before the values of its instances (lane_component.h)
_STATE_BEYOND, _OUTPUT_NOT_FINITE, _SINGULAR = 1, 3, 4  # why a lane failed (lane_component.h)
_INPUT_REFUSED, _STOPPED, _PROBE_FAILED = 101, 102, 104  # BATCH_...
_TYPES = {"real": 0, "integer": 1, "boolean": 2}


@dataclass(frozen=True)
class CopyFailure:
    """A copy that has ended: index, component that failed, time [s] at which its step began, and message."""

    copy: int
    component: str
    time: float
    message: str

    def __str__(self) -> str:
        return f"copy {self.copy} ended at t = {self.time:.9g} s: {self.message}"


@dataclass
class Lanes:
    """A component whose copies lie side by side."""

    source: LaneSource
    library: Any
    whole: npt.NDArray[np.float64]  # (groups, rows, numbers of a value)
    lanes: int

    @property
    def memory(self) -> npt.NDArray[np.float64]:
        """Values of the copies (groups, rows, lanes)."""
        return self.whole[:, :, : self.lanes]

    def row(self, variable: Variable) -> int:
        """Where a variable is."""
        role, slot = self.source.place(variable)
        return HEADER + self.source.first(role) + slot

    @property
    def sides(self) -> npt.NDArray[np.void]:
        """`Sides` (batch.h) of each group of numbers with derivatives (groups,)."""
        types = {"uint64_t": np.uint64, "double": np.float64}
        form = np.dtype([(name, types[f.type.cname]) for name, f in interface().typeof("Sides").fields])
        at = self.library.cosim_lanes_sides()
        found = self.whole.view(np.uint8).reshape(len(self.whole), -1)[:, at : at + form.itemsize]
        return found.view(form)[:, 0]

    def values(self) -> npt.NDArray[np.float64]:
        """Parameters, inputs, states, derivatives and outputs (groups, values, lanes)."""
        return self.memory[:, HEADER : HEADER + self.source.n_values]


@dataclass(frozen=True)
class Probes:
    """Instances on both sides of components that depend on a direction and have no derivatives of their own.

    apart: (copies, directions), how far along each direction; 0 where nothing moves.
    exchanges: those of the instances, for each copy and direction two.
    """

    components: Collection[SystemComponent]
    apart: npt.NDArray[np.float64]
    exchanges: Sequence[Exchange | None]

    @property
    def ended(self) -> dict[int, Ending]:
        """Copies beside which one of the components has asked for the end in its first event iteration."""
        found: dict[int, Ending] = {}
        names = {m.name for m in self.components}
        for at, e in enumerate(self.exchanges):
            if e is not None and e.ending is not None and e.ending.component in names:
                copy = at // (2 * self.apart.shape[1])
                found.setdefault(copy, e.ending._replace(text=beside(e.ending.component)))
        return found


class Structs:
    """A plan for all copies, ready for the engine.

    `exchanges`: of each copy, None where it could not be initialized; those of copies with scalar components are
        kept. `samples`: of tables with derivatives, numbers (copies, rows * columns, numbers of a value).
    `followed`: components that what is read depends on.
    """

    def __init__(
        self,
        plan: Plan,
        exchange: Exchange,
        exchanges: Sequence[Exchange | None],
        lanes: Mapping[SystemComponent, Lanes],
        alone: Collection[SystemComponent],
        values: npt.NDArray[np.float64],
        alive: npt.NDArray[np.uint8],
        target: Target,
        threads: int,
        probes: Probes | None = None,
        samples: Mapping[SystemComponent, npt.NDArray[np.float64]] | None = None,
        followed: Collection[SystemComponent] = (),
    ):
        self._probes, self._samples = probes, samples or {}
        self._followed = followed
        self._plan, self._exchange, self._lanes, self._target = plan, exchange, lanes, target
        self._keep: list[Any] = []
        self._engines: list[BoundEngine | None] = []
        ffi, copies = interface(), len(exchanges)
        if alone:
            self._engines = [None if e is None else e.engine for e in exchanges]
            # Where a copy could not be initialized nothing is called.
            pointers = [ffi.NULL if e is None else ffi.cast("Engine*", e.struct) for e in self._engines]
            self._alone_engines = self._new("Engine*[]", pointers + [ffi.NULL] * (len(alive) - copies))
        if probes is not None:
            engines = [ffi.NULL if e is None else ffi.cast("Engine*", e.engine.struct) for e in probes.exchanges]
            self._probe_engines = self._new("Engine*[]", engines)
        self._components = self._new("BatchComponent[]", len(plan.components))
        for struct, component in zip(self._components, plan.components, strict=True):
            self._fill(struct, component)
        self.batch = b = self._new("Batch*")
        b.components = self._components
        b.n_copies_of_system, b.n_groups = copies, len(values)
        b.values, b.n_values = self._address("char*", values), plan.size
        b.alive = self._address("uint8_t*", alive)
        self._failures = self._new("BatchFailure[]", len(alive))
        b.failures = self._failures
        scale, offset = exchange.layout.record_conversion
        b.recorded, b.n_recorded = self._array("uint32_t", plan.recorded), len(plan.recorded)
        b.record_scale, b.record_offset = self._array("double", scale), self._array("double", offset)
        b.n_components = len(plan.components)
        if probes is not None:
            b.apart = self._address("double*", probes.apart)
        b.record_converted = self._array("uint8_t", (scale != 1.0) | (offset != 0.0))
        self.workers = [self._worker() for _ in range(threads)]

    def record_to(self, rows: npt.NDArray[np.float64], sides: npt.NDArray[np.uint64] | None, first: int) -> None:
        """Where samples go (copies, samples, variables, 1 + directions), from sample number `first` on.

        `sides`: those of the components (copies, samples, components). The caller keeps the arrays.
        """
        b = self.batch
        b.sides = interface().NULL if sides is None else interface().cast("uint64_t*", sides.ctypes.data)
        b.rows, b.first_row, b.n_rows = interface().cast("double*", rows.ctypes.data), first, rows.shape[1]

    def run(self, worker: Any, tick: int, end: int, final: bool) -> None:
        """Groups that no other worker has taken, to the arrival at `end`; `final`: to the sample there."""
        batch_library(self._target).cosim_batch_run(self.batch, worker, tick, end, final)

    def settle(self) -> None:
        """Initialize copies whose components are all in lanes; those that cannot be are no longer alive."""
        batch_library(self._target).cosim_batch_settle(self.batch, self.workers[0])

    def _worker(self) -> Any:
        """With lists of its own; all else is the engine's."""
        w, own = self._new("BatchWorker*"), self._exchange.engine.struct
        w.engine = e = own[0]
        w.engine.next, w.engine.due = self._new(f"int64_t[{e.n_clocks}]"), self._new(f"bool[{e.n_clocks}]")
        w.engine.list = self._new(f"EngineComponent*[{e.n_components}]")
        w.engine.computed = self._new(f"EnginePiece[{e.n_components}]")
        w.engine.published = self._new(f"EngineCopy[{sum(len(m.published) for m in self._plan.components)}]")
        w.before = self._address("char*", aligned(1, self._plan.size, self._target.width))
        return w

    def _fill(self, m: Any, plan: ComponentPlan) -> None:
        ffi = interface()
        m.index, m.n_inputs = self._array("uint32_t", plan.index), len(plan.index)
        m.followed = plan.component in self._followed
        if plan.component not in self._lanes:
            reads = {int(i) for i in plan.index} | {i for line in plan.extrapolations for i in line[1:4]}
            m.reads, m.n_reads = self._array("uint32_t", sorted(reads)), len(reads)
            m.alone = self._alone_engines
            if plan.component in self._samples:
                m.samples = self._address("char*", self._samples[plan.component])
            if self._probes is not None and plan.component in self._probes.components:
                m.probes = self._probe_engines
            return
        lanes, port = self._lanes[plan.component], self._exchange.layout.ports[plan.component]
        m.run = ffi.cast("BatchStep", lanes.library.cosim_lanes_step)
        m.begin = ffi.cast("BatchStep", lanes.library.cosim_lanes_begin)
        m.memory, m.stride = self._address("char*", lanes.whole), lanes.whole[0].nbytes
        m.sides = lanes.library.cosim_lanes_sides()
        m.to = self._array("uint32_t", [lanes.row(v) for v in port.inputs])
        setattr(m, "from", self._array("uint32_t", [lanes.row(v) for v in port.outputs]))
        types = [_TYPES[v.type] for v in port.inputs]
        m.to_type = self._array("uint8_t", types)
        m.from_type = self._array("uint8_t", [_TYPES[v.type] for v in port.outputs])
        largest = float(np.finfo(float).max)
        limited = [v.limits if kind else (-largest, largest) for v, kind in zip(port.inputs, types, strict=True)]
        m.least = self._array("double", [max(least, -largest) for least, _ in limited])
        m.most = self._array("double", [min(most, largest) for _, most in limited])
        m.checked = any(types) or plan.scale is not None or bool(plan.extrapolations)

    def _new(self, *what: Any) -> Any:
        made = interface().new(*what)
        self._keep.append(made)
        return made

    def _array(self, of: str, values: Sequence[float] | npt.NDArray[Any]) -> Any:
        types = {"uint32_t": np.uint32, "double": np.float64, "uint8_t": np.uint8}
        array = np.array(values, dtype=types[of])
        return self._address(f"{of}*", array)

    def _address(self, of: str, array: npt.NDArray[Any]) -> Any:
        self._keep.append(array)
        return interface().cast(of, array.ctypes.data)

    # What failed.

    def stopped(self, copy: int) -> tuple[int, int] | None:
        """Number of the stop condition that has ended a copy, and the tick; None where none has."""
        found = self._failures[copy]
        return (found.call, found.tick) if found.result == _STOPPED else None

    def failure(self, copy: int) -> CopyFailure:
        """The failure of a copy, with the message that a run of this copy alone would give."""
        found = self._failures[copy]
        component = self._plan.components[found.component].component
        t = self._exchange.base.seconds(found.tick)
        if component in self._lanes:
            return CopyFailure(copy, component.name, t, self._lane_message(copy, component, found))
        if found.result == _PROBE_FAILED:
            return CopyFailure(copy, component.name, t, beside(component.name))
        engine = self._engines[copy]
        assert engine is not None
        # What is raised is what a run of this copy alone would raise.
        try:
            if found.result == engine.NOT_FINITE:
                text = f"component '{component.name}': an output is not finite"
            else:
                engine.fail(component, found.call, found.status, t)
                text = f"component '{component.name}' failed"
        except CallFailed as failure:
            text = str(ComponentError(failure, t, None))
        except EndRequested as request:
            text = str(request)
        return CopyFailure(copy, component.name, t, text)

    def _lane_message(self, copy: int, component: SystemComponent, found: Any) -> str:
        """In the words of the FMU (fmu_core.c)."""
        group, lane = divmod(copy, self._target.lanes)
        lanes, port = self._lanes[component], self._exchange.layout.ports[component]
        memory = lanes.memory[group, :, lane]
        if found.result == _INPUT_REFUSED:
            variable = port.inputs[found.call]
            value, (least, most) = float(memory[lanes.row(variable)]), variable.limits
            why = f"is outside its range [{least:.9g}, {most:.9g}]" if np.isfinite(value) else "is not finite"
            return f"component '{component.name}': value {value:.9g} for {variable.declared or variable.name} {why}"
        kind, slot, when, value = (int(memory[4]), int(memory[5]), float(memory[6]), float(memory[7]))
        role = "output" if kind == _OUTPUT_NOT_FINITE else "state"
        name = lanes.source.name_of(role, slot, component.description.variables.values())
        if kind == _SINGULAR:
            return (
                f"component '{component.name}': the matrix of solver ros2 is singular or not finite at time"
                f" {when:.9g} s (state {name}); try another solver.step"
            )
        if kind != _STATE_BEYOND:
            return f"component '{component.name}': {name} is not finite at time {when:.9g} s"
        return (
            f"component '{component.name}': state {name} diverged at time {when:.9g} s: it is {value:g}, beyond its"
            f" bound {lanes.source.bounds[slot]:g}; check inputs and parameters, or reduce solver.step"
        )


def beside(component: str) -> str:
    """Message of an instance beside the run that has failed."""
    return f"component '{component}': an instance beside it, for differences, failed where it did not"


def aligned(groups: int, rows: int, width: int) -> npt.NDArray[np.float64]:
    """Zeros (groups, rows, width) that begin at a multiple of 64 bytes, as vectors must."""
    raw = np.zeros(groups * rows * width + 8)
    begin = (-raw.ctypes.data % 64) // 8
    return raw[begin : begin + groups * rows * width].reshape(groups, rows, width)
