"""The C engine, bound to the values, clocks and ports of one system."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cosim.core.component import Array, FmiCalls
from cosim.core.errors import LoopNotSolved, NotFinite
from cosim.engine.library import engine_transfers, interface, library
from cosim.engine.plan import ComponentPlan, Copy, DerivativePlan, LoopPlan, Setup, make_plan
from cosim.engine.stops import Stop, StopWhen, Timed
from cosim.recording.recording import LoopEffort
from cosim.system.components import SystemComponent

SlotStop = tuple[StopWhen, int, float, float]
"""A stop condition with slot, scale and offset of the variable that it reads."""

_RELATIONS = {">=": "ENGINE_GE", ">": "ENGINE_GT", "<=": "ENGINE_LE", "<": "ENGINE_LT"}


class BoundEngine:
    """The engine's structs for one system, and what keeps their arrays alive."""

    def __init__(self, setup: Setup, stops: Sequence[SlotStop] = (), check: Timed | None = None):
        """Both `stops` and `check`, a function of the time, are checked after every sample."""
        self._ffi, self._library = interface(), library()
        self._setup, self._stops, self._check = setup, stops, check
        self._keep: list[Any] = []
        self._adaptive = self._ffi.NULL if setup.adaptive is None else setup.adaptive.struct
        self._failure: BaseException | None = None
        self._rows: Any = None  # the recorder's chunk that the engine writes to
        ffi = self._ffi
        names = ("AT_END", "FULL", "STOPPED", "NOT_FINITE", "BACK_FAILED", "UNSETTLED", "NO_SOLUTION")
        self.AT_END, self.FULL, self.STOPPED, self.NOT_FINITE, self.BACK_FAILED, self.UNSETTLED, self.NO_SOLUTION = (
            getattr(self._library, f"ENGINE_{name}") for name in names
        )
        self.plan = plan = make_plan(setup)
        self._components = ffi.new("EngineComponent[]", len(plan.components))
        self._calls: list[FmiCalls | None] = []
        for struct, component in zip(self._components, plan.components, strict=True):
            self._fill(struct, component)
        self._state = e = ffi.new("Engine*")
        e.values = self._pointer("double*", setup.values)
        e.components, e.n_components, e.n_discrete = self._components, len(plan.components), plan.n_discrete
        e.clocks = self._array("EngineClock", [{"period": c.period, "offset": c.offset} for c in plan.clocks])
        e.n_clocks = len(plan.clocks)
        e.next, e.due = self._new(f"int64_t[{e.n_clocks}]"), self._new(f"bool[{e.n_clocks}]")
        e.list, e.computed = (
            self._new(f"EngineComponent*[{e.n_components}]"),
            self._new(f"EnginePiece[{e.n_components}]"),
        )
        self._named = *setup.loops, *setup.schedule.initial_loops, *setup.late_loops
        self._work = [np.zeros(self._library.cosim_engine_loop_work(len(loop.nominal))) for loop in plan.loops]
        self._starts = [np.array(loop.start) for loop in plan.loops]
        self._loops = self._array("EngineLoop", [*map(self._loop, plan.loops, self._work, self._starts)])
        e.loops, e.n_loops, e.n_late = self._loops, plan.n_running, plan.n_late
        e.n_initial = len(plan.loops) - plan.n_running - plan.n_late
        e.followers, e.n_followers = (
            self._array(
                "EngineFollower",
                [
                    {"component": f.component, "loop": f.loop, "read": self._slots(f.read), "n_read": len(f.read)}
                    for f in plan.followers
                ],
            ),
            len(plan.followers),
        )
        e.published = self._new(f"EngineCopy[{sum(len(m.published) for m in plan.components)}]")
        e.a, e.b, e.d = plan.time
        e.check_finite = not setup.allow_nan
        e.recorded, e.n_recorded = self._slots(plan.recorded), len(plan.recorded)
        e.stops, e.n_stops = self._array("EngineStop", [self._stop(s) for s in stops]), len(stops)
        e.checks = check is not None
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

    def exact_until(self, tick: int) -> bool:
        """Whether the engine computes all times up to a tick exactly."""
        return self.plan.exact_until(tick)

    def raise_failure(self, result: int) -> None:
        """Raise the exception for the result with which the engine came back: of a component, or a stop condition."""
        e, setup = self._state, self._setup
        if result == self.STOPPED:
            raise Stop(str(self._stops[e.call][0]))
        if result == self.BACK_FAILED:
            failure, self._failure = self._failure, None
            assert failure is not None
            raise failure
        t = setup.base.seconds(self.tick)
        if result == self.NO_SOLUTION:
            self._raise_no_solution(e.component, t, switches=bool(e.call))
        if result == self._library.ENGINE_NO_STEP:
            assert setup.adaptive is not None
            raise setup.adaptive.failure(t)
        component = setup.schedule.components[e.component]
        if result == self.NOT_FINITE:
            culprit = setup.layout.not_finite([component], t, self._components[e.component].step)
            raise culprit or NotFinite(component.name, "?", float("nan"), t)
        if result == self._library.ENGINE_STATE_FAILED:
            calls = self._calls[e.component]
            assert calls is not None
            calls.call_failed("SetFMUState" if e.call else "GetFMUState", e.status)
        self.fail(component, e.call, e.status, t, self._components[e.component].step)

    def _raise_no_solution(self, number: int, t: float, *, switches: bool) -> None:
        loop, work = self._named[number], self._work[number]
        culprit = self._setup.layout.not_finite(loop.components)
        n = len(loop.unknowns)
        values = [(f"{m.name}.{v.name}", z, r) for (m, v), z, r in zip(loop.unknowns, work[:n], work[n:], strict=False)]
        name, tolerance = loop.components[0].name, self._setup.loop_tolerance
        raise LoopNotSolved(name, values, tolerance, t, str(loop), culprit, switches)

    @property
    def loop_effort(self) -> list[LoopEffort]:
        """What the solution of each algebraic loop has cost so far."""
        return [
            LoopEffort(
                tuple(f"{m.name}.{v.name}" for m, v in loop.unknowns),
                struct.n_solutions,
                struct.n_evaluations,
                struct.most_evaluations,
                struct.n_derivatives,
            )
            for loop, struct in zip(self._named, self._loops or (), strict=True)
        ][: len(self._named) - len(self._setup.late_loops)]

    def fail(self, component: SystemComponent, call: int, status: int, t: float, h: float | None = None) -> None:
        """Raise the exception for an FMI call of a component with this status.

        It came in a step from `t` on, of length `h` or the component's own [s]. `call`: 0 for the step, k > 0 for set
        number k - 1, k < 0 for get number -k - 1.
        """
        calls = self._setup.ports[component].fmi
        assert calls is not None
        if call == self._library.ENGINE_DERIVATIVE:
            calls.call_failed("GetDirectionalDerivative", status)
        if call:
            transfer = calls.sets[call - 1] if call > 0 else calls.gets[-call - 1]
            calls.call_failed(transfer.function, status)
        else:
            calls.step_failed(status, t, float(component.step) if h is None else h)

    def publish(self) -> None:
        """Computed outputs become visible, and visible ones previous ones, of all components."""
        self._library.cosim_engine_publish(self._state)

    def settle(self, components: Sequence[SystemComponent], *, late: bool = False) -> npt.NDArray[np.bool_]:
        """Pass outputs to inputs of initialized components until nothing changes except for rounding.

        `late`: with the late loops at once.

        Returns which of the values still change then. Raises what the calls raise.
        """
        values = self._setup.values
        chosen = np.array([m in components for m in self._setup.schedule.components], dtype=np.bool_)
        changes = np.zeros(len(values))
        for start, loop in zip(self._starts, self._named, strict=True):
            start[:] = loop.first_guess
        pointers = self._address("bool*", chosen), self._address("double*", changes)
        result = self._call(0, lambda: self._library.cosim_engine_settle(self._state, *pointers, len(values), late))
        if result not in (self.AT_END, self.UNSETTLED):
            self.raise_failure(result)
        return changes.astype(np.bool_)

    def follow_events(self, before: Array) -> None:
        """Publish all outputs, and compute again what depends on those that first event iterations have changed.

        `before`: all values before these, overwritten.
        """
        values = self._address("double*", before)
        result = self._call(0, lambda: self._library.cosim_engine_follow_events(self._state, values))
        if result != self.AT_END:
            self.raise_failure(result)

    def run(self, tick: int, end: int) -> int:
        """Execute instants from `tick` to before `end`; returns why it came back."""
        return self._call(tick, lambda: self._library.cosim_engine_run(self._state, self._adaptive, end))

    def instant(
        self,
        tick: int,
        t: float,
        *,
        resumed: bool = False,
        arrives: bool = False,
        samples: bool = False,
        advances: bool = False,
    ) -> int:
        """Execute parts of the instant at `tick`, time `t` [s]; returns why it came back.

        `resumed`: of the instant in which a component has failed, continue behind that component.
        """
        return self._call(
            tick,
            lambda: self._library.cosim_engine_instant(
                self._state, self._adaptive, t, resumed, arrives, samples, advances
            ),
        )

    def cut(self, tick: int) -> int:
        """End the present step of an adaptive run at `tick`, within it; returns why it came back."""
        return self._call(tick, lambda: self._library.cosim_engine_cut(self._state, self._adaptive, tick))

    def _call(self, tick: int, call: Callable[[], Any]) -> int:
        e, recorder = self._state, self._setup.recorder
        times, rows, row = recorder.room()
        begin = recorder.count - row
        if rows is not self._rows:
            self._rows = rows
            e.times, e.rows = self._address("double*", times), self._address("double*", rows)
        e.count, e.room, e.tick = row, len(times), tick
        self.ready()
        try:
            return int(call())
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
        ports, port = self._setup.ports[plan.component], self._setup.layout.ports[plan.component]
        m.clock, m.step, m.check_before = plan.clock, plan.step, plan.check_before
        copies = [*plan.previous, *plan.published]
        m.copies, m.n_copies = self._array("EngineCopy", [_copy(c) for c in copies]), len(copies)
        m.n_copies_before = len(plan.previous)
        m.begins_with_events = plan.begins_with_events
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
            if ports.fmi.follow is not None:
                steps = self._ffi.NULL if plan.component.discrete else self._adaptive
                ports.fmi.follow(m, self._pointer("double*", self._setup.values), steps)

    def _loop(self, plan: LoopPlan, work: Array, start: Array) -> dict[str, Any]:
        return {
            "components": self._pointer("int32_t*", np.array(plan.components, dtype=np.int32)),
            "n_components": len(plan.components),
            "clock": plan.clock,
            "follows_discrete": plan.follows_discrete,
            "repeats": plan.repeats,
            "n": len(plan.nominal),
            "published": self._slots(plan.published),
            "computed": self._slots(plan.computed),
            "nominal": self._pointer("double*", np.array(plan.nominal)),
            "start": self._pointer("double*", start),
            "tolerance": self._setup.loop_tolerance,
            "read": self._slots(plan.read),
            "n_read": len(plan.read),
            "derivatives": self._array(
                "EngineDerivative",
                [*map(self._derivative, plan.components, plan.derivatives)] if plan.derivatives else [],
            ),
            "work": self._pointer("double*", work),
        }

    def _derivative(self, component: int, plan: DerivativePlan | None) -> dict[str, Any]:
        calls = self._calls[component]
        if plan is None or calls is None or not calls.derivative:
            return {}
        n, version = (len(plan.knowns), len(plan.unknowns)), calls.version
        return {
            f"call{version}": self._ffi.cast(f"EngineDerivative{version}", calls.derivative),
            "knowns": self._slots(plan.knowns),
            "inputs": self._slots(plan.inputs),
            "n_knowns": n[0],
            "unknowns": self._slots(plan.unknowns),
            "outputs": self._slots(plan.outputs),
            "n_unknowns": n[1],
            "work": self._pointer("double*", np.zeros(2 * sum(n))),
        }

    def _bind(self, m: Any, calls: FmiCalls) -> None:
        ffi = self._ffi
        m.fmi, m.instance = calls.version, ffi.cast("void*", calls.instance)
        m.stepped = ffi.cast("void*", calls.stepped or calls.instance)
        setattr(m, f"step{calls.version}", ffi.cast(f"EngineStep{calls.version}", calls.do_step))
        if calls.version == 3:
            m.flags, m.last = ffi.cast("bool*", calls.flags), ffi.cast("double*", calls.last)
        m.foreign, m.integrated = calls.foreign, calls.integrated
        m.sets, m.n_sets = engine_transfers(calls.version, calls.sets, self._keep), len(calls.sets)
        m.gets, m.n_gets = engine_transfers(calls.version, calls.gets, self._keep), len(calls.gets)
        m.direct = len(calls.sets) == len(calls.gets) == 1 and all(
            t.element is None for t in (*calls.sets, *calls.gets)
        )

    def _stop(self, condition: SlotStop) -> dict[str, Any]:
        stop, slot, scale, offset = condition
        relation = getattr(self._library, _RELATIONS[stop.relation])
        return {"slot": slot, "relation": relation, "scale": scale, "offset": offset, "value": float(stop.value)}

    def _back(self) -> Any:
        check, adaptive, structs = self._check, self._setup.adaptive, self._components
        called = [self._setup.ports[m] for m in self._setup.schedule.components]

        def back(_: Any, i: int, t: float) -> int:
            try:
                if i < -1:
                    assert adaptive is not None
                    adaptive.move_others(i)
                elif i < 0:
                    assert check is not None
                    check(t)
                else:
                    ports = called[i]
                    if math.isnan(t):
                        ports.set_inputs()
                        ports.get_outputs()
                    else:
                        ports.run(t, structs[i].step)
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
