"""FMI 3.0 Co-Simulation FMUs that report events or return early, and have no clocks (`engine/event_steps.c`).

Such an FMU has the step function of one without events: its steps are completed, its events are processed in event
mode, and its discrete inputs are set there when they have changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NoReturn

import numpy as np

from cosim.core.component import Action, Transfer
from cosim.core.description import Description
from cosim.core.errors import CallFailed, CosimError
from cosim.core.time import seconds_text
from cosim.fmu.calls import WARNING
from cosim.fmu.driver import Driver
from cosim.fmu.intermediate import IntermediateUpdates
from cosim.fmu.model_exchange import Instance

_CALLS = ("DoStep", "EnterEventMode", "UpdateDiscreteStates", "EnterStepMode")  # in the order of `EventFunction`


def steps_with_events(about: Description) -> bool:
    """Whether steps of an FMU are divided: it has event mode without clocks, or may return early."""
    divided = about.event_mode or (about.early_return and about.variable_step)
    return divided and not about.clocks and about.interface == "cs"


class EventSteps(Driver):
    """The steps of one instance."""

    def __init__(self, component: Instance, updates: IntermediateUpdates | None = None):
        super().__init__()
        self._component, about, ffi = component, component.description, self._ffi
        self._steps = steps = ffi.new("EventSteps*")
        steps.instance = self._pointer(component._address(component._instance))
        steps.event_mode, steps.variable_step = about.event_mode, about.variable_step
        steps.internal = float(about.internal_step or 0)
        for i, name in enumerate(_CALLS if about.event_mode else _CALLS[:1]):
            steps.call[i] = self._pointer(component._address(component._function(name)))
        steps.stepped = steps.instance
        if updates is not None:
            steps.call[0], steps.stepped = (self._pointer(a) for a in updates.addresses)
        self._kept: list[Any] = []
        self._before = np.zeros(0, dtype=np.uint8)

    @property
    def stepping(self) -> bool:
        """Whether initialization is over."""
        return bool(self._steps.stepping)

    @property
    def step(self) -> tuple[Any, Any]:
        return self._library.cosim_event_steps_step, self._steps

    def bind(self, discrete: Sequence[Transfer]) -> list[Transfer]:
        """Transfers of discrete inputs that wait for event mode once initialization is over."""
        ffi = self._ffi
        self._steps.stepping = False
        inputs = ffi.new("EventInputs[]", len(discrete))
        self._before = np.zeros(sum(t.data.nbytes for t in discrete), dtype=np.uint8)
        self._kept, bound, at = [inputs, *(t.data for t in discrete)], [], 0
        for i, t in enumerate(discrete):
            one, size = inputs[i], t.data.nbytes
            one.steps, one.call = self._steps, ffi.cast("EngineValues3", t.call)
            one.references, one.n_references = ffi.cast("uint32_t*", t.references), t.n_references
            one.data, one.n_data, one.size = self._pointer(t.data.ctypes.data), len(t.data), size
            one.before, at = self._pointer(self._before.ctypes.data + at), at + size
            call = self._address(self._library.cosim_event_steps_set)
            bound.append(replace(t, call=call, references=self._address(inputs + i)))
        self._steps.inputs, self._steps.n_inputs = inputs, len(discrete)
        return bound

    def begin(self, t: float) -> None:
        """After initialization; the FMU is in step mode afterwards."""
        self._pass(self._library.cosim_event_steps_begin(self._steps, t), "its first event iteration")

    def end(self) -> None:
        """The FMU is reset."""
        self._steps.stepping = False

    def change(self, action: Action) -> None:
        """Set parameters or inputs between steps: in event mode, if the FMU has it."""
        if not self._steps.event_mode:
            return action()
        where, t = "a change of values", self._steps.report.time
        self._pass(self._library.cosim_event_steps_enter(self._steps, t), where)
        action()
        self._pass(self._library.cosim_event_steps_leave(self._steps, t), where)

    # What a saved state has beside that of the FMU.

    @property
    def saved_size(self) -> int:
        """Bytes of `saved`."""
        return int(self._ffi.sizeof("EventMemory")) + self._before.nbytes

    def saved(self) -> bytes:
        """The announced event, and the discrete inputs that were set last."""
        return bytes(self._ffi.buffer(self._ffi.addressof(self._steps, "memory"))) + self._before.tobytes()

    def restore(self, saved: bytes) -> None:
        """Continue from what `saved` returned. Raises CosimError for anything else."""
        if len(saved) != self.saved_size:
            raise CosimError(f"the state of '{self._component.name}' does not hold its events and discrete inputs")
        size = int(self._ffi.sizeof("EventMemory"))
        self._ffi.buffer(self._ffi.addressof(self._steps, "memory"))[:] = saved[:size]
        self._before[:] = np.frombuffer(saved[size:], dtype=np.uint8)

    # Failures.

    def _pass(self, status: int, where: str) -> None:
        if status > WARNING:
            self.fail(status, where)

    def step_failed(self, status: int, t: float, h: float) -> None:
        """Raise the exception for a step that failed, unless `fmi3DoStep` itself did."""
        report = self._steps.report
        if report.end != self._library.EVENT_FINE and (report.end, report.index) != (
            self._library.EVENT_CALL_FAILED,
            self._library.EVENT_DO_STEP,
        ):
            whole = self._component.took_whole_step(status, t, h)
            self.fail(status, f"step from {t:.9g} s, length {seconds_text(h)}", whole=whole)

    def fail(self, status: int, where: str, *, whole: bool = False) -> NoReturn:
        """Raise the exception for what the report says; `whole`: of a step that was taken whole."""
        component, report = self._component, self._steps.report
        why, at = self._ffi.typeof("EventEnd").elements[report.end].removeprefix("EVENT_"), float(report.time)
        if why == "TERMINATED":
            component._end_requested(f"in event mode at {at:.9g} s; {where}", whole)
        if why == "CALL_FAILED":
            function = _CALLS[report.index] if report.index < len(_CALLS) else "setting discrete inputs"
            component._fail(function, status, where)
        said = self._ffi.string(self._library.cosim_event_steps_why(self._ffi.addressof(report))).decode()
        raise CallFailed(component.name, "event mode", 3, f"{said} (at {at:.9g} s)", component._recent_log())
