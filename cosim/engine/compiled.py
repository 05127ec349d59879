"""An exchange whose instants the compiled engine executes, with the same values and calls as in Python."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cosim.core.component import EndRequested, FmiCalls, Transfer
from cosim.core.errors import NotFinite
from cosim.engine.exchange import Exchange, Phase
from cosim.engine.library import interface, library
from cosim.engine.plan import ComponentPlan, Copy, make_plan
from cosim.engine.stops import Reader, Stop, StopCondition, StopWhen
from cosim.system.components import SystemComponent
from cosim.system.names import SystemComponents

_Stop = tuple[StopWhen, int, float, float]  # with slot, scale and offset of what it looks at
_RELATIONS = {">=": "ENGINE_GE", ">": "ENGINE_GT", "<=": "ENGINE_LE", "<": "ENGINE_LT"}
_TYPES = {
    np.dtype(np.float64): "ENGINE_DOUBLE",
    np.dtype(np.float32): "ENGINE_FLOAT",
    np.dtype(np.int8): "ENGINE_INT8",
    np.dtype(np.uint8): "ENGINE_UINT8",
    np.dtype(np.int16): "ENGINE_INT16",
    np.dtype(np.uint16): "ENGINE_UINT16",
    np.dtype(np.int32): "ENGINE_INT32",
    np.dtype(np.uint32): "ENGINE_UINT32",
    np.dtype(np.int64): "ENGINE_INT64",
    np.dtype(np.uint64): "ENGINE_UINT64",
    np.dtype(np.bool_): "ENGINE_BOOL",
}


class CompiledExchange(Exchange):
    """An `Exchange` with a compiled hot loop; initialization, saved states and all else are the same code."""

    _engine: BoundEngine | None = None
    _by_hand = False  # there are stop conditions that only Python can look at
    _stops: Sequence[_Stop] = ()

    def stop_when(self, conditions: Sequence[StopCondition], read: Reader) -> None:
        super().stop_when(conditions, read)
        plain = [c for c in conditions if isinstance(c, StopWhen)]
        canonical = SystemComponents((m.name, m) for m in self.schedule.components).canonical
        known = [self.layout.readable.get(canonical(c.name)) for c in plain]
        self._by_hand = len(plain) < len(conditions) or None in known
        self._stops = [] if self._by_hand else [(c, *k) for c, k in zip(plain, known, strict=True) if k]

    def forget(self) -> None:
        super().forget()
        self._engine = None

    def run_instants(self, end: int) -> None:
        if self._engine is None:
            self._engine = BoundEngine(self, self._stops)
        if self._by_hand or not self._engine.plan.exact_until(end):
            super().run_instants(end)
            return
        while self.tick < end and self._run(self._engine, end):
            pass

    def _run(self, engine: BoundEngine, end: int) -> bool:
        """Until the engine comes back; returns whether to go on."""
        try:
            result = engine.run(self.tick, end)
        finally:
            self.tick = engine.tick
        if result in (engine.AT_END, engine.FULL):
            return True
        if result == engine.STOPPED:
            self.phase = Phase.SAMPLED
            raise Stop(str(self._stops[engine.call][0]))
        component = self.schedule.components[engine.component]
        try:
            self.raise_failure(engine, result, component)
        except EndRequested as request:
            instant, t = self.timetable.at(self.tick), self.time
            rest = instant.whole[instant.whole.index(self._step(component)) + 1 :]
            if self._end_requested(request, rest, len(instant.advance), t):
                self.tick += 1
        return False

    def raise_failure(self, engine: BoundEngine, result: int, component: SystemComponent) -> None:
        """What the Python master would raise where the engine came back."""
        if result == engine.NOT_FINITE:
            culprit = self.layout.not_finite([component], self.time)
            raise culprit or NotFinite(component.name, "?", float("nan"), self.time)
        if result == engine.BACK_FAILED:
            raise engine.take_failure()
        engine.fail(component, engine.call, engine.status, self.time)


class BoundEngine:
    """The engine's structs for one exchange, and what keeps their arrays alive."""

    def __init__(self, exchange: Exchange, stops: Sequence[_Stop]):
        self._ffi, self._library = interface(), library()
        self._exchange = exchange
        self._keep: list[Any] = []
        self._failure: BaseException | None = None
        self._rows: Any = None  # the recorder's chunk that the engine writes to
        ffi = self._ffi
        names = ("AT_END", "FULL", "STOPPED", "NOT_FINITE", "CALL_FAILED", "BACK_FAILED")
        self.AT_END, self.FULL, self.STOPPED, self.NOT_FINITE, self.CALL_FAILED, self.BACK_FAILED = (
            getattr(self._library, f"ENGINE_{name}") for name in names
        )
        self.plan = plan = make_plan(exchange)
        self._components = ffi.new("EngineComponent[]", len(plan.components))
        self._calls: list[FmiCalls | None] = []
        for struct, component in zip(self._components, plan.components, strict=True):
            self._fill(struct, component)
        self._state = e = ffi.new("Engine*")
        e.values = self._pointer("double*", exchange.values)
        e.components, e.n_components, e.n_discrete = self._components, len(plan.components), plan.n_discrete
        e.clocks = self._array("EngineClock", [{"period": c.period, "offset": c.offset} for c in plan.clocks])
        e.n_clocks = len(plan.clocks)
        e.next, e.due = self._new(f"int64_t[{e.n_clocks}]"), self._new(f"bool[{e.n_clocks}]")
        e.list, e.computed = (
            self._new(f"EngineComponent*[{e.n_components}]"),
            self._new(f"EnginePiece[{e.n_components}]"),
        )
        e.published = self._new(f"EngineCopy[{sum(len(m.published) for m in plan.components)}]")
        e.a, e.b, e.d = plan.time
        e.check_finite = not exchange.allow_nan
        e.recorded, e.n_recorded = self._slots(plan.recorded), len(plan.recorded)
        e.stops, e.n_stops = self._array("EngineStop", [self._stop(s) for s in stops]), len(stops)
        e.back = self._back()

    # Where it stands, and what it says about a failure.

    @property
    def struct(self) -> Any:
        """The `Engine*`, ready for calls of single components; it lives as long as this object."""
        self.ready()
        return self._state

    @property
    def tick(self) -> int:
        """Present tick of the engine."""
        return int(self._state.tick)

    @property
    def component(self) -> int:
        """Index of the component that failed."""
        return int(self._state.component)

    @property
    def call(self) -> int:
        """Number of the FMI call that failed: 0 for the step, above 0 for a set, below 0 for a get."""
        return int(self._state.call)

    @property
    def status(self) -> int:
        """FMI status of the call that failed."""
        return int(self._state.status)

    def take_failure(self) -> BaseException:
        """What the callback raised."""
        failure, self._failure = self._failure, None
        assert failure is not None
        return failure

    def fail(self, component: SystemComponent, call: int, status: int, t: float) -> None:
        """Raise the exception of a component's ports for an FMU call with this status, in an instant at `t` [s]."""
        calls = self._exchange.ports[component].fmi
        assert calls is not None
        if call:
            transfer = calls.sets[call - 1] if call > 0 else calls.gets[-call - 1]
            calls.call_failed(transfer.function, status)
        else:
            calls.step_failed(status, t, float(component.step))

    def run(self, tick: int, end: int) -> int:
        """Execute instants from `tick` to before `end`; returns why it came back."""
        e, recorder = self._state, self._exchange.recorder
        times, rows, row = recorder.room()
        begin = recorder.count - row
        if rows is not self._rows:
            self._rows = rows
            e.times, e.rows = self._address("double*", times), self._address("double*", rows)
        e.count, e.room, e.tick = row, len(times), tick
        self.ready()
        try:
            return int(self._library.cosim_engine_run(e, end))
        finally:
            recorder.count = begin + int(e.count)
            for struct, calls in zip(self._components, self._calls, strict=True):
                if calls is not None and struct.changed:
                    calls.changed(int(struct.changed))
                    struct.changed = 0

    def ready(self) -> None:
        """Before components are stepped: whether their FMUs may be rolled back is known."""
        for struct, calls in zip(self._components, self._calls, strict=True):
            if calls is not None:
                struct.no_set_prior = calls.no_set_prior()

    # Making the structs.

    def _fill(self, m: Any, plan: ComponentPlan) -> None:
        ports, port = self._exchange.ports[plan.component], self._exchange.layout.ports[plan.component]
        m.clock, m.step, m.check_before = plan.clock, plan.step, plan.check_before
        copies = [*plan.previous, *plan.published]
        m.copies, m.n_copies = self._array("EngineCopy", [_copy(c) for c in copies]), len(copies)
        m.n_copies_before = len(plan.previous)
        m.timestamp_slot = -1 if plan.timestamp_slot is None else plan.timestamp_slot
        if not plan.in_place:
            m.index, m.n_inputs = self._slots(plan.index), len(plan.index)
        if plan.scale is not None and plan.offset is not None:
            m.scale, m.offset = self._pointer("double*", plan.scale), self._pointer("double*", plan.offset)
        m.extrapolations, m.n_extrapolations = (
            self._array("EngineExtrapolation", [list(line) for line in plan.extrapolations]),
            len(plan.extrapolations),
        )
        m.u, m.y = self._pointer("double*", port.u), self._pointer("double*", port.y)
        m.first, m.n_outputs = plan.first, plan.n_outputs
        self._calls.append(ports.fmi)
        if ports.fmi is not None:
            self._bind(m, ports.fmi)

    def _bind(self, m: Any, calls: FmiCalls) -> None:
        ffi = self._ffi
        m.fmi, m.instance = calls.version, ffi.cast("void*", calls.instance)
        setattr(m, f"step{calls.version}", ffi.cast(f"EngineStep{calls.version}", calls.do_step))
        if calls.version == 3:
            m.flags, m.last = ffi.cast("bool*", calls.flags), ffi.cast("double*", calls.last)
        m.foreign = calls.foreign
        m.sets, m.n_sets = self._transfers(calls.version, calls.sets), len(calls.sets)
        m.gets, m.n_gets = self._transfers(calls.version, calls.gets), len(calls.gets)
        m.direct = len(calls.sets) == len(calls.gets) == 1 and all(
            t.element is None for t in (*calls.sets, *calls.gets)
        )

    def _transfers(self, version: int, transfers: Sequence[Transfer]) -> Any:
        ffi = self._ffi
        structs = self._array("EngineTransfer", [{} for _ in transfers])
        for s, transfer in zip(structs if transfers else (), transfers, strict=True):
            setattr(s, f"call{version}", ffi.cast(f"EngineValues{version}", transfer.call))
            s.references, s.n_references = ffi.cast("uint32_t*", transfer.references), transfer.n_references
            s.data, s.n_data = self._pointer("void*", transfer.data), len(transfer.data)
            s.type = getattr(self._library, _TYPES[transfer.data.dtype])
            if transfer.element is not None and transfer.place is not None:
                s.n = len(transfer.place)
                s.element, s.place = self._slots(transfer.element), self._slots(transfer.place)
        return structs

    def _stop(self, condition: _Stop) -> dict[str, Any]:
        stop, slot, scale, offset = condition
        relation = getattr(self._library, _RELATIONS[stop.relation])
        return {"slot": slot, "relation": relation, "scale": scale, "offset": offset, "value": float(stop.value)}

    def _back(self) -> Any:
        components, ports = self._exchange.schedule.components, self._exchange.ports
        runs = [(ports[m].run, float(m.step)) for m in components]

        def back(_: Any, i: int, t: float) -> int:
            try:
                run, h = runs[i]
                run(t, h)
            except BaseException as error:
                self._failure = error
                return 1
            return 0

        callback = self._ffi.callback("int(void*, int32_t, double)", back, error=1)
        self._keep.append(callback)
        return callback

    def _array(self, of: str, items: Sequence[Any]) -> Any:
        return self._new(f"{of}[]", items) if items else self._ffi.NULL

    def _new(self, *what: Any) -> Any:
        made = self._ffi.new(*what)
        self._keep.append(made)
        return made

    def _slots(self, slots: Sequence[int] | npt.NDArray[Any]) -> Any:
        return self._pointer("uint32_t*", np.array(slots, dtype=np.uint32))

    def _pointer(self, of: str, array: npt.NDArray[Any]) -> Any:
        self._keep.append(array)
        return self._address(of, array)

    def _address(self, of: str, array: npt.NDArray[Any]) -> Any:
        return self._ffi.cast(of, array.ctypes.data)


def _copy(c: Copy) -> dict[str, int]:
    return {"to": c.to, "from": c.source, "n": c.n}
