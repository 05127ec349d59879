"""The instance of an FMU: its life, its calls, and values one call at a time."""

from __future__ import annotations

import warnings
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import cosim.fmu.calls as fmi
from cosim.core.component import Action
from cosim.core.description import Variable
from cosim.core.errors import (
    STATUS_NAMES,
    CallFailed,
    CosimError,
    FmuError,
    FmuWarning,
    IsolationCrashed,
    IsolationCrashedWarning,
    WiringError,
)
from cosim.fmu.clocked_steps import ClockedSteps, refusal
from cosim.fmu.driver import Driver
from cosim.fmu.environment import what_changed
from cosim.fmu.event_steps import EventSteps
from cosim.fmu.exact_values import ExactCall
from cosim.fmu.file import FmuFile, Library
from cosim.fmu.intermediate import IntermediateUpdates
from cosim.fmu.isolation import IsolatedLibrary, Isolation, WorkerCrashed
from cosim.fmu.model_exchange import Integration, ModelExchange
from cosim.fmu.model_exchange import refusal as exchange_refusal
from cosim.fmu.own_states import StateLayout
from cosim.fmu.saved_states import FmuState, StatePool, split
from cosim.fmu.transfers import by_reference, by_type

LARGEST = 2**30  # bytes of a serialized state


class FmuInstance:
    """What `FmuComponent` is made of first: the instance, in this process or isolated in one of its own."""

    def __init__(self, fmu: FmuFile, isolation: Isolation | None = None, exchange: ModelExchange | None = None):
        """`exchange`: how it is integrated if it is used by Model Exchange."""
        self.integrated = fmu.description.interface == "me"
        if why := (exchange_refusal if self.integrated else refusal)(fmu.description):
            raise FmuError(f"{fmu.path}: {why}")
        self.fmu = fmu
        self.isolation = isolation
        self.exchange = exchange or ModelExchange()
        self.description = fmu.description
        self.structure: dict[str, Any] = {}  # values of structural parameters other than the FMU's own
        self.name = fmu.description.name
        self.messages: deque[str] = deque(maxlen=200)  # everything it logged lately
        self.problems: deque[str] = deque(maxlen=50)  # warnings and worse
        self._ffi = fmu._ffi
        self._v3 = fmu.major == "3"
        self._c_types = fmi.c_types(int(fmu.major))
        self.foreign = False  # another's, in this process
        self._restore = nothing_to_restore
        self._reported: set[int] = set()  # changes of the floating-point environment that were told
        self._library: Library | IsolatedLibrary
        self._instance: Any = None
        self._finalizer: weakref.finalize[Any, Any]
        self._dead = False
        self._keep: list[Any] = []
        self._kept_from_start = 0  # of `_keep`, what the instance itself needs
        self.state_pools: list[StatePool] = []  # of the states that it saved in this run
        self._earlier_pools: list[StatePool] = []
        self._own_pool: StatePool | None = None  # of the states that it saved without others
        self._layout: StateLayout | None = None  # of the states of a sampled FMU of ours
        self._reads_values = False  # from initialization on
        self._given: dict[int, list[Any]] = {}  # what was set before that: value reference -> all elements
        self._kept: list[Action] = []  # what reads values of elements that nobody drives into the master's buffers
        self._exact: list[ExactCall] = []  # bound calls that move what doubles do not hold
        self._sizes: Mapping[Variable, int] = {}
        self.clocked: ClockedSteps | None = None
        self.integration: Integration | None = None
        self._event_steps: EventSteps | None = None
        self._intermediate: IntermediateUpdates | None = None

    @property
    def in_event_mode(self) -> bool:
        """Whether the master activates its clocks in event mode.

        An isolated discrete FMU of this project counts its samples itself.
        """
        about = self.description
        return (
            bool(about.clocks)
            and about.event_mode
            and not self.integrated
            and not (self.isolation is not None and about.kind is not None)
        )

    @property
    def _driver(self) -> Driver | None:
        """What steps it instead of itself, in this process: its integrator, or what divides steps or sets inputs."""
        own = self.integration if self.integration is not None and self.integration.here else None
        return own or self.clocked or self._event_steps or self._intermediate

    @property
    def _remembers(self) -> ClockedSteps | Integration | EventSteps | None:
        """What has a state beside that of the FMU."""
        return self.clocked or self.integration or self._event_steps

    # Life of the instance.

    def _configure(self) -> None:
        """Structural parameters of a fresh instance, in configuration mode."""
        if not self.structure:
            return
        self._must("EnterConfigurationMode")
        for name, value in self.structure.items():
            variable = self.description.variables[name]
            self._set_raw(variable.fmi_type, variable.reference, [value], name)
        self._must("ExitConfigurationMode")

    def _open(self) -> Library | IsolatedLibrary:
        """The library for a new instance."""
        if self.isolation is None:
            return self.fmu.library()
        try:
            return self.fmu.isolated(self.isolation)
        except WorkerCrashed as lost:
            raise IsolationCrashed(self.name, "loading its library", str(lost)) from None

    def enter_initialization(self, start: float, stop: float | None) -> None:
        tolerance = self.description.tolerance
        experiment = (tolerance is not None, tolerance or 0.0, start, stop is not None, stop or 0.0)
        if self._v3:
            self._must("EnterInitializationMode", *experiment)
        else:
            self._must("SetupExperiment", *experiment)
            self._must("EnterInitializationMode")
        self._reads_values, self._begin = True, start

    def exit_initialization(self) -> None:
        if self.clocked is not None:
            self.clocked.exit_initialization(self._begin)
        else:
            self._must("ExitInitializationMode")
        if (own := self.integration or self._event_steps) is not None:
            own.begin(self._begin)
            self._check_environment()

    def terminate(self) -> None:
        if self._instance is not None and not self._dead:
            status = self._call("Terminate")
            self._warn_of_crash("Terminate")
            if status > fmi.WARNING and not self._library.lost():
                self._warn_of_end(status)
            if self._intermediate is not None:
                self._intermediate.warn_if_unused(self.name)

    def _warn_of_end(self, status: int) -> None:
        """Warn that it did not terminate: all results are there, but not what an FMU does itself at its end."""
        name = STATUS_NAMES[status] if status < len(STATUS_NAMES) else str(status)
        said = "".join(f"\n    {line}" for line in self._recent_log())
        warnings.warn(
            f"component '{self.name}': {fmi.full_name(self.fmu.major, 'Terminate')} returned {name}; the results of the"
            f" run are complete, but files that the FMU writes at its end may not be{said}",
            FmuWarning,
            stacklevel=3,
        )

    def close(self) -> None:
        """Free the instance, and close its library if it was the last one.

        An instance that reported Fatal is not freed: none of its functions may be called any more.
        """
        if self._instance is not None:
            if not self._dead:
                self._end_states()
                self._finalizer()
                self._warn_of_crash("FreeInstance")
            self._instance = None

    def _warn_of_crash(self, function: str) -> None:
        """Warn where an isolated FMU crashed after its last call."""
        lost = self._library.lost()
        if lost:
            said = str(IsolationCrashed(self.name, fmi.full_name(self.fmu.major, function), lost, self._recent_log()))
            warnings.warn(said, IsolationCrashedWarning, stacklevel=3)

    # Calls and what to do with their status.

    def _call(self, name: str, *arguments: Any) -> int:
        if self._instance is None:
            raise CosimError(f"'{self.name}' has no instance: initialize its system first")
        if self._dead:
            raise CosimError(f"'{self.name}' has failed and was shut down: initialize its system again")
        status = self._function(name)(self._instance, *arguments)
        self._check_environment()
        if status == fmi.FATAL:
            self._die()
        return status

    def _check_environment(self) -> None:
        changed = self._restore() | (self.clocked.changed if self.clocked is not None else 0)
        if changed:
            self._tell_changed(changed)

    def _tell_changed(self, bits: int) -> None:
        if bits not in self._reported:
            self._reported.add(bits)
            text = (
                f"component '{self.name}' ({self.fmu.path.name}) changes {what_changed(bits)}; cosim restores it"
                " after each call"
            )
            warnings.warn(text, stacklevel=2)

    def _function(self, name: str) -> Callable[..., int]:
        try:
            return fmi.function(self.fmu.major, self._library.handle, name)
        except FmuError as error:
            raise FmuError(f"{self.fmu.path}: {error}") from None

    def _must(self, function: str, *arguments: Any, detail: str = "") -> None:
        status = self._call(function, *arguments)
        if status > fmi.WARNING:
            self._fail(function, status, detail)

    def _fail(self, function: str, status: int, detail: str = "") -> None:
        detail = next((said for call in self._exact if (said := call.complaint())), detail)
        lost = self._library.lost()
        function, detail = self._library.failing_function(function), self._library.failure_detail() or detail
        if status == fmi.FATAL or lost:
            self._die()
        if self._library.cancelled:
            raise KeyboardInterrupt
        if lost:
            raise IsolationCrashed(self.name, fmi.full_name(self.fmu.major, function), lost, self._recent_log())
        signed = int(self._ffi.cast("int32_t", status))
        known = STATUS_NAMES[: fmi.PENDING] if self._v3 else STATUS_NAMES
        raise CallFailed(self.name, fmi.full_name(self.fmu.major, function), signed, detail, self._recent_log(), known)

    def _die(self) -> None:
        """Nothing of this instance may be called any more."""
        if self._dead:
            return
        self._dead = True
        self._end_states()
        self._finalizer.detach()
        if isinstance(self._library, Library):
            self.fmu.abandon(self._library)
            _KEEP_FOREVER.append(self._keep)
        else:
            self._library.release()

    def _forget_messages(self) -> None:
        self.messages.clear()
        self.problems.clear()

    def _recent_log(self) -> list[str]:
        """The last log lines, those about problems if there are any."""
        return list(self.problems or self.messages)[-10:]

    def _query(self, function: str, *arguments: Any) -> bool:
        """Call what an FMU need not answer, or have."""
        try:
            return self._call(function, *arguments) <= fmi.WARNING
        except FmuError:
            return False

    # Values, one call at a time: parameters, start values, inspection.

    def set(self, values: Mapping[Variable, Any]) -> None:
        if self.clocked is not None and self.clocked.stepping:
            self.clocked.set(values)
        elif self._event_steps is not None and self._event_steps.stepping:
            self._event_steps.change(lambda: self._set_values(values))
        else:
            self._set_values(values)

    def _set_values(self, values: Mapping[Variable, Any]) -> None:
        for fmi_type, group in by_type(values).items():
            for reference, elements in by_reference(group).items():
                data = self._present(elements)
                for variable in elements:
                    data[variable.index] = values[variable]
                self._set_raw(fmi_type, reference, data, elements[0].declared)
                if not self._reads_values:
                    self._given[reference] = data
        self._keep_values()

    def _keep_values(self) -> None:
        """Pass on elements that no connection drives with those of their arrays that one drives.

        Their values may have changed.
        """
        for keep in self._kept:
            keep()

    def _present(self, elements: Sequence[Variable]) -> list[Any]:
        """Values of the array of these elements; for a scalar or a complete array, those that are about to be set.

        Before initialization an FMU returns no values: they are those that were set last, else its start values.
        """
        one = elements[0]
        if len(elements) >= one.size:  # more, where scalars of one value reference are aliases (FMI 2.0)
            return [None] * one.size
        if self._reads_values:
            return self._get_raw(one.fmi_type, [one.reference], one.size)
        if one.reference in self._given:
            return list(self._given[one.reference])
        data: list[Any] = [None] * one.size
        for name in self.description.arrays[one.declared]:
            variable = self.description.variables[name]
            data[variable.index] = variable.start_as_set
            if data[variable.index] is None and variable not in elements:
                raise WiringError(f"'{self.name}': set all of {one.declared}; the FMU has no start value for {name}")
        return data

    def _set_raw(self, fmi_type: str, reference: int, data: list[Any], name: str) -> None:
        c_type, ffi = self._c_types[fmi_type], self._ffi
        before: tuple[Any, ...] = ()
        if fmi_type == "String":
            keep = [ffi.new("char[]", str(x).encode()) for x in data]
            buffer = ffi.new("const char*[]", keep)
        elif fmi_type == "Binary":
            keep = [ffi.from_buffer("uint8_t[]", bytes(x)) for x in data]
            before = (ffi.new("size_t[]", [len(x) for x in data]),)
            buffer = ffi.new("const uint8_t*[]", keep)
        elif fmi_type == "Boolean":
            buffer = ffi.new(f"{c_type}[]", [bool(x) for x in data])
        elif c_type in ("double", "float"):
            buffer = ffi.new(f"{c_type}[]", [float(x) for x in data])
        else:
            buffer = ffi.new(f"{c_type}[]", [int(x) for x in data])
        detail = f"{name} = {data[0] if len(data) == 1 else data}"
        function = f"Set{fmi.accessed_as(self.fmu.major, fmi_type)}"
        counts = (len(data),) if self._v3 else ()
        self._must(function, ffi.new("VR[]", [reference]), 1, *before, buffer, *counts, detail=detail[:200])

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        return [self._get_raw(v.fmi_type, [v.reference], v.size)[v.index] for v in variables]

    def _get_raw(self, fmi_type: str, references: list[int], size: int) -> list[Any]:
        ffi = self._ffi
        buffer = ffi.new(f"{self._c_types[fmi_type]}[]", size)
        function = f"Get{fmi.accessed_as(self.fmu.major, fmi_type)}"
        sizes = (ffi.new("size_t[]", size),) if fmi_type == "Binary" else ()
        counts = (size,) if self._v3 else ()
        self._must(function, ffi.new("VR[]", references), len(references), *sizes, buffer, *counts)
        if sizes:
            return [bytes(ffi.buffer(x, n)) if n else b"" for x, n in zip(buffer, sizes[0], strict=True)]
        if fmi_type == "String":
            return [fmi.text(ffi, x) for x in buffer]
        return [bool(x) for x in buffer] if fmi_type == "Boolean" else list(buffer)

    # States.

    def save(self) -> FmuState:
        if self._own_pool is None:
            self._own_pool = StatePool({self.name: self}, self._ffi, self._save_pointer, self.free_pointer)
        own = self._remembers
        return FmuState(self._own_pool.save(), events=own.saved() if own else None)

    def restore(self, state: FmuState) -> None:
        if not state.belongs_to(self):
            raise CosimError(f"'{self.name}': this is a state of another instance")
        if not state.pointer:  # its instance has ended
            try:
                data = state.pack()
            except CosimError as error:
                raise CosimError(f"'{self.name}': {error}") from None
            self._unpack(data)
            return
        self._must("SetFMUState", state.pointer)
        if own := self._remembers:
            own.restore(state.events or b"")
        self._keep_values()

    def forget(self, state: FmuState) -> None:
        state.saved.pool.forget(state.saved)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Calls that change its state, which is restored after them, unless it returns Fatal."""
        state = self.save()
        try:
            yield
        finally:
            if not self._dead:
                self.restore(state)
                self.forget(state)

    def _save_pointer(self, pointer: Any) -> None:
        self._must("GetFMUState", pointer)

    def free_pointer(self, pointer: Any) -> None:
        """Free the state that a `void**` points to."""
        if pointer[0]:
            self._call("FreeFMUState", pointer)

    def _end_states(self) -> None:
        """Serialize and free the states of the instance, which ends."""
        for pool in (*self._earlier_pools, *self.state_pools):
            pool.end_instance(self, failed=self._dead)

    def pack_pointer(self, pointer: Any) -> bytes:
        """A state as the FMU serializes it. Raises CosimError where it does not."""
        if not self.description.can_serialize:
            raise CosimError("its FMU does not serialize states (canSerializeFMUState)")
        size = self._ffi.new("size_t*")
        self._must("SerializedFMUStateSize", pointer, size)
        if size[0] > LARGEST:
            raise CosimError(f"its FMU reports a state of {size[0]:,} bytes; at most {LARGEST:,} are allowed")
        data = self._ffi.new("char[]", size[0])
        self._must("SerializeFMUState", pointer, data, size[0])
        return bytes(self._ffi.buffer(data))

    def _unpack(self, data: bytes) -> None:
        if own := self._remembers:
            data, saved = split(data)
            own.restore(saved)
        self.deserialize(data)

    def deserialize(self, data: bytes) -> None:
        """Continue from a state that `serialize` gave."""
        pointer, given = self._ffi.new("void**"), self._ffi.from_buffer("char[]", data)
        self._must("DeserializeFMUState", given, len(data), pointer)
        self._must("SetFMUState", pointer[0])
        self._call("FreeFMUState", pointer)
        self._keep_values()


def nothing_to_restore() -> int:
    """What looks at the floating-point environment where nobody changes it."""
    return 0


_KEEP_FOREVER: list[Any] = []  # callbacks of instances that reported Fatal
