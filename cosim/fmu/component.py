"""One instance of an FMU as the master sees it, FMI 2.0 or 3.0."""

from __future__ import annotations

import logging
import math
import os
import warnings
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NoReturn

import numpy as np

import cosim.fmu.calls as fmi
from cosim.core.component import Action, Array, EndRequested, FmiCalls, Ports, Transfer, is_whole
from cosim.core.dependencies import Dependencies, by_derivatives, by_perturbation
from cosim.core.description import TEXTS, Variable
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
from cosim.core.time import seconds_text
from cosim.fmu.clocked_steps import ClockedSteps, refusal, returns_early
from cosim.fmu.environment import restorer, what_changed
from cosim.fmu.event_steps import EventSteps, steps_with_events
from cosim.fmu.exact_values import ExactCall
from cosim.fmu.file import FmuFile, Library
from cosim.fmu.intermediate import IntermediateUpdates, followed
from cosim.fmu.isolation import IsolatedLibrary, Isolation, WorkerCrashed
from cosim.fmu.kinks import refuse_kinks
from cosim.fmu.model_exchange import Integration, ModelExchange
from cosim.fmu.model_exchange import refusal as exchange_refusal
from cosim.fmu.own_states import MORE_THAN_STATES, StateLayout, find_states
from cosim.fmu.saved_states import FmuState, StatePool, split
from cosim.fmu.transfers import Arrangement, arrangements, by_reference, by_type

LARGEST = 2**30  # bytes of a serialized state


@dataclass(frozen=True)
class _Bound:
    """One bound FMI call that moves values: `move` does it and checks the status; `transfer` is the same for C."""

    move: Action
    transfer: Transfer


_DoStep = tuple[Callable[..., int], tuple[Any, ...], Any]


class FmuComponent:
    """One instance of an FMU, as a `Component`; in this process, or isolated in one of its own."""

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
        self._functions = fmi.FUNCTION3 if self._v3 else fmi.FUNCTION2
        self.foreign = False  # another's, in this process
        self._restore = _nothing_to_restore
        self._reported: set[int] = (
            set()
        )  # what it has changed of the floating-point environment, as far as that was said
        self._library: Library | IsolatedLibrary
        self._instance: Any = None
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
    def _driver(self) -> Integration | ClockedSteps | EventSteps | IntermediateUpdates | None:
        """What steps it instead of itself, in this process: its integrator, or what divides steps or sets inputs."""
        own = self.integration if self.integration is not None and self.integration.here else None
        return own or self.clocked or self._event_steps or self._intermediate

    @property
    def _remembers(self) -> ClockedSteps | Integration | EventSteps | None:
        """What has a state beside that of the FMU."""
        return self.clocked or self.integration or self._event_steps

    def clone(self) -> FmuComponent:
        """Another component of the same FMU, with an instance of its own."""
        made = FmuComponent(self.fmu, self.isolation, self.exchange)
        if self.structure:
            made.restructure(self.structure)
        return made

    def restructure(self, structure: Mapping[str, Any]) -> None:
        """Other values of structural parameters, by name, before it is instantiated: its arrays have other sizes.

        Raises FmuError for sizes that are too large.
        """
        self.description, self.structure = self.fmu.structured(structure), dict(structure)

    def _configure(self) -> None:
        """Structural parameters of a fresh instance, in configuration mode."""
        if not self.structure:
            return
        self._must("EnterConfigurationMode")
        for name, value in self.structure.items():
            variable = self.description.variables[name]
            self._set_raw(variable.fmi_type, variable.reference, [value], name)
        self._must("ExitConfigurationMode")

    # Life of the instance.

    def instantiate(self, name: str) -> None:
        self._forget_messages()
        self._reads_values = False
        self._given.clear()
        self._kept.clear()
        for pool in (pools := (*self._earlier_pools, *self.state_pools)):
            pool.free_unused()
        self._earlier_pools = [p for p in pools if p.in_use]
        self.state_pools, self._own_pool = [], None
        reusable = self._instance is not None and not self._dead and self._library.reusable(self.isolation)
        self.clocked = ClockedSteps(self) if self.in_event_mode else None
        if reusable and self._call("Reset") <= fmi.WARNING:
            if self._event_steps is not None:
                self._event_steps.end()
            self._configure()
            return
        self.close()
        self._forget_messages()
        self.name = name
        self._dead = False
        self.foreign = self.description.kind is None and self.isolation is None
        self._restore = restorer() if self.foreign else _nothing_to_restore
        library = self._open()
        self._keep = []
        resources = library.folder / "resources"
        log = _logger(name, self.messages, self.problems)
        texts = (name, self.description.token, f"{resources}{os.sep}" if self._v3 else resources.as_uri())
        divided = steps_with_events(self.description)
        how = {"event_mode": True, "early_return": returns_early(self.description)} if self.clocked else {}
        if divided:
            about = self.description
            how = {"event_mode": about.event_mode, "early_return": about.variable_step}
        follows = followed(self.description)
        self._intermediate = IntermediateUpdates(follows) if follows else None
        update = self._intermediate.callback if self._intermediate else None
        instance = library.instantiate(texts, log, self._keep, **how, intermediate=update)
        self._check_environment()
        if instance == self._ffi.NULL and divided and self.description.event_mode and not library.lost():
            self._forget_messages()
            instance, divided = library.instantiate(texts, log, self._keep, intermediate=update), False
            if instance != self._ffi.NULL:
                warnings.warn(
                    f"component '{name}': its FMU declares event mode (hasEventMode) and cannot be instantiated with"
                    " it; it runs without, and processes its events by itself",
                    FmuWarning,
                    stacklevel=2,
                )
        if instance == self._ffi.NULL:
            lost = library.lost()
            library.release()
            if lost:
                raise IsolationCrashed(name, f"fmi{self.fmu.major}Instantiate", lost, self._recent_log())
            failure_detail = library.failure_detail()
            said = [f"    {line}" for line in [*self._recent_log(), *([failure_detail] if failure_detail else [])]]
            if self.description.needs_tool:
                said.append("  it needs the tool that exported it (needsExecutionTool): is it installed?")
            colon = ":\n" if said else ""
            raise FmuError(f"{self.fmu.path}: cannot be instantiated as '{name}'{colon}" + "\n".join(said))
        self._library, self._instance, self._kept_from_start = library, instance, len(self._keep)
        self._finalizer = weakref.finalize(self, _free, library, self._v3, instance, self._keep)
        self.integration = Integration(self, self.exchange) if self.integrated else None
        self._event_steps = EventSteps(self, self._intermediate) if divided else None
        if self._intermediate is not None:
            self._intermediate.attach(self)
            self._keep.append(self._intermediate)
            self._kept_from_start = len(self._keep)
        self._configure()

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
        function = f"Set{self._functions.get(fmi_type, fmi_type)}"
        counts = (len(data),) if self._v3 else ()
        self._must(function, ffi.new("VR[]", [reference]), 1, *before, buffer, *counts, detail=detail[:200])

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        return [self._get_raw(v.fmi_type, [v.reference], v.size)[v.index] for v in variables]

    def _get_raw(self, fmi_type: str, references: list[int], size: int) -> list[Any]:
        ffi = self._ffi
        buffer = ffi.new(f"{self._c_types[fmi_type]}[]", size)
        function = f"Get{self._functions.get(fmi_type, fmi_type)}"
        sizes = (ffi.new("size_t[]", size),) if fmi_type == "Binary" else ()
        counts = (size,) if self._v3 else ()
        self._must(function, ffi.new("VR[]", references), len(references), *sizes, buffer, *counts)
        if sizes:
            return [bytes(ffi.buffer(x, n)) if n else b"" for x, n in zip(buffer, sizes[0], strict=True)]
        if fmi_type == "String":
            return [fmi.text(ffi, x) for x in buffer]
        return [bool(x) for x in buffer] if fmi_type == "Boolean" else list(buffer)

    # Values, bound to the master's buffers.

    def bind(
        self,
        inputs: Sequence[Variable],
        outputs: Sequence[Variable],
        u: Array,
        y: Array,
        sizes: Mapping[Variable, int] | None = None,
    ) -> Ports:
        """`sizes`: bytes at most, of values that have more than one place in `u` and `y` (`exact_values.h`)."""
        self._kept.clear()
        self._exact.clear()
        self._sizes = sizes or {}
        if self._intermediate is not None:
            self._kept += self._intermediate.bind(inputs, self._sizes)
        del self._keep[self._kept_from_start :]  # buffers of the run before
        if self.clocked is not None:
            self.clocked.bind(inputs, outputs, self._sizes, y)
            setters, getters = ([_Bound(*p) for p in self.clocked.port(*to)] for to in (("Set", u), ("Get", y)))
        else:
            setters = self._setters(inputs, u)
            getters = [
                self._transfer("Get", how, y) for how in arrangements(int(self.fmu.major), outputs, sizes=self._sizes)
            ]
        set_inputs, get_outputs = _sequence([s.move for s in setters]), _sequence([g.move for g in getters])
        self._get_outputs = get_outputs
        do_step = self._do_step()
        calls = self._fmi_calls([s.transfer for s in setters], [g.transfer for g in getters])
        ports = replace(Ports.of(set_inputs, self._stepper(do_step), get_outputs), fmi=calls)
        return self._with_guards(ports)

    def _setters(self, inputs: Sequence[Variable], u: Array) -> list[_Bound]:
        """Calls that set inputs; with event mode, discrete ones wait for it once initialization is over."""
        major, steps, waits = int(self.fmu.major), self._event_steps, self.description.waits
        if steps is None or not self.description.event_mode:
            return [self._transfer("Set", how, u) for how in arrangements(major, inputs, sizes=self._sizes)]
        groups = (
            [self._transfer("Set", how, u) for how in arrangements(major, inputs, chosen, self._sizes)]
            for chosen in (lambda v: not waits(v), waits)
        )
        continuous, discrete = groups
        waiting = steps.bind([s.transfer for s in discrete])

        def late(bound: _Bound) -> Action:
            to = bound.transfer

            def move() -> None:
                if not steps.stepping:
                    bound.move()
                elif to.element is not None:
                    to.data[to.element] = u[to.place]

            return move

        return [*continuous, *(_Bound(late(s), t) for s, t in zip(discrete, waiting, strict=True))]

    def _with_guards(self, ports: Ports) -> Ports:
        """Put back the floating-point environment after calls into third-party FMUs."""
        if not self.foreign:
            return ports
        guard = self._guarded
        return replace(
            ports,
            set_inputs=guard(ports.set_inputs),
            step=guard(ports.step),
            get_outputs=guard(ports.get_outputs),
            run=guard(ports.run),
        )

    def _guarded(self, call: Callable[..., None]) -> Callable[..., None]:
        """The floating-point environment is put back after it."""
        look = self._check_environment

        def guarded(*arguments: float) -> None:
            try:
                call(*arguments)
            finally:
                look()

        return guarded

    def _fmi_calls(self, sets: Sequence[Transfer], gets: Sequence[Transfer]) -> FmiCalls:
        address, own = self._address, self._driver
        return FmiCalls(
            version=int(self.fmu.major),
            instance=self.address,
            do_step=address(self._function("DoStep")) if own is None else own.addresses[0],
            stepped=0 if own is None else own.addresses[1],
            sets=sets,
            gets=gets,
            flags=address(self._flags) if self._v3 else 0,
            last=address(self._last) if self._v3 else 0,
            no_set_prior=self._no_set_prior,
            states=self._state_calls(),
            derivative=self._derivative_call(),
            call_failed=self._fail if self.clocked is None else lambda *_: self.clocked.fail(),  # type: ignore[union-attr]
            step_failed=self._step_failed,
            integrated=self.integration is not None and self.description.kind is None,
            foreign=self.foreign,
            changed=self._tell_changed,
            follow=next((own.follow for own in (self._intermediate, self.clocked) if own), None),
        )

    def _derivative_call(self) -> int:
        if not self.description.directional_derivatives:
            return 0
        try:
            return self._address(self._function("GetDirectionalDerivative"))
        except FmuError:  # it is declared but not there; nothing depends on it
            return 0

    def _address(self, pointer: Any) -> int:
        return int(self._ffi.cast("uintptr_t", pointer))

    @property
    def address(self) -> int:
        """Of its instance."""
        return self._address(self._instance)

    def _transfer(self, direction: str, how: Arrangement, buffer: Array) -> _Bound:
        """One FMI call that moves all variables of one type.

        Doubles that fill their arrays and lie side by side in the master's buffer are passed in place; anything else
        goes through a buffer of its own.
        """
        if how.sizes:
            return self._exact_transfer(direction, how, buffer)
        ffi, v3, total = self._ffi, self._v3, how.total
        element, place, c_type = how.element, how.place, self._c_types[how.fmi_type]
        first = int(place[0])
        data: Any = buffer[first : first + total] if how.in_place else np.zeros(total, dtype=fmi.DTYPES[c_type])
        pointer = ffi.cast(f"{c_type}*", data.ctypes.data)
        references = ffi.new("VR[]", list(how.arrays))
        self._keep += [data, references]
        function = f"{direction}{self._functions.get(how.fmi_type, how.fmi_type)}"
        arguments = (references, len(how.arrays), pointer, *((total,) if v3 else ()))
        bare, fail = self._function(function), self._fail
        call = partial(bare, self._instance, *arguments)
        warning = fmi.WARNING

        def direct() -> None:
            status = call()
            if status > warning:
                fail(function, status)

        def scatter() -> None:
            data[element] = buffer[place]
            direct()

        def gather() -> None:
            direct()
            buffer[place] = data[element]

        if direction == "Set" and how.keeps:  # elements of an array that nobody drives keep their values

            def keep() -> None:
                data[:] = [x for r, e in how.arrays.items() for x in self._get_raw(how.fmi_type, [r], e[0].size)]

            keep()
            self._kept.append(keep)
        transfer = Transfer(
            function,
            self._address(bare),
            self._address(references),
            len(how.arrays),
            data,
            *(() if how.in_place else (element, place)),
        )
        return _Bound(direct if how.in_place else scatter if direction == "Set" else gather, transfer)

    def _exact_transfer(self, direction: str, how: Arrangement, buffer: Array) -> _Bound:
        """The same of values that have more than one place in the master's buffer."""
        call = ExactCall(how, buffer, direction, int(self.fmu.major))
        if direction == "Set" and how.keeps:
            if how.fmi_type in TEXTS:
                names = sorted({elements[0].declared for elements in how.arrays.values()})
                raise CosimError(
                    f"'{self.name}': {', '.join(names)}: connect all elements of an array of texts, or none"
                )

            def keep() -> None:
                call.values[:] = [x for r, e in how.arrays.items() for x in self._get_raw(how.fmi_type, [r], e[0].size)]

            keep()
            self._kept.append(keep)
        self._exact.append(call)
        function = f"{direction}{how.fmi_type}"
        move = call.bound(self._address(self._function(function)), self.address)
        fail, warning = self._fail, fmi.WARNING

        def checked() -> None:
            status = move()
            if status > warning:
                fail(function, status)

        return _Bound(checked, call.transfer(function))

    def _do_step(self) -> _DoStep:
        """The step function as (call, last arguments, ended): `call(t, h, *last arguments)`.

        `ended[0]` is true after a step that stopped early or requests the end of the simulation (FMI 3).
        """
        own = self._driver
        function, first = (self._function("DoStep"), self._instance) if own is None else own.step
        call = partial(function, first)
        if not self._v3:
            return call, (), (0,)
        flags, self._last = self._ffi.new("bool[4]"), self._ffi.new("double*")  # event needed, -, terminate, early
        self._flags = flags
        self._terminate, self._early = flags + 2, flags + 3
        self._keep += [flags, self._last]
        if self.clocked is not None:
            self.clocked.use(flags, self._last)
        ended = self._ffi.cast("uint16_t*", self._terminate)
        return call, (flags, self._terminate, self._early, self._last), ended

    def _stepper(self, do_step: _DoStep) -> Callable[[float, float], None]:
        call, rest, ended = do_step
        fail, warning, no_set_prior = self._step_failed, fmi.WARNING, self._no_set_prior

        def step(t: float, h: float) -> None:
            status = call(t, h, no_set_prior(), *rest)
            if status > warning or ended[0]:
                fail(status, t, h)

        return step

    def _step_failed(self, status: int, t: float, h: float) -> None:
        """Raise what a step's status means, with what the FMU can tell about it."""
        if self.clocked is not None:
            self.clocked.fail(whole=self.took_whole_step(status, t, h))
        if (failing_function := self._library.failing_function("DoStep")) != "DoStep":
            self._fail(failing_function, status)
        if self._intermediate is not None:
            self._intermediate.step_failed(self)
        if self.integration is not None:
            self.integration.step_failed(status, t, h)
        if self._event_steps is not None:
            self._event_steps.step_failed(status, t, h)
        self.do_step_failed(status, t, h)

    def took_whole_step(self, status: int, t: float, h: float) -> bool:
        """Whether the last step of an FMU of FMI 3.0, from t of length h [s], which returned `status`, was whole."""
        return status <= fmi.WARNING and not self._early[0] and is_whole(self._last[0], t, h)

    def do_step_failed(self, status: int, t: float, h: float, *, within: bool = False) -> None:
        """Raise what a status of `fmi3DoStep` itself, or of its like, means.

        `within`: the step is only a part of the communication step.
        """
        last, terminated, whole = None, False, False
        if self._v3 and status <= fmi.DISCARD:
            last, terminated = self._last[0], bool(self._terminate[0])
            whole = self.took_whole_step(status, t, h) and not within
        elif status == fmi.DISCARD:
            number, boolean = self._ffi.new("double*"), self._ffi.new("int*")
            if self._query("GetRealStatus", 2, number):
                last = number[0]
                whole = is_whole(last, t, h)
            if self._query("GetBooleanStatus", 3, boolean):
                terminated = bool(boolean[0])
        detail = f"step from {t:.9g} s, length {seconds_text(h)}"
        if last is not None and not whole:
            detail += f"; it reached {last:.9g} s"
        if terminated:
            told = last is not None
            self._end_requested(detail if told else f"{detail}; it does not tell fmi2LastSuccessfulTime", whole)
        if self._v3 and status <= fmi.WARNING and self._early[0]:
            detail += "; it returned early, which it was not allowed to (earlyReturnAllowed is false)"
        if status == fmi.PENDING and not self._v3:
            detail += "; asynchronous steps are not supported"
        self._fail("DoStep", max(status, fmi.DISCARD), detail)

    def _end_requested(self, detail: str, complete: bool) -> NoReturn:
        """Raise that the FMU asks to end the simulation, after reading the outputs of a complete step."""
        text = f"component '{self.name}' asked to end the simulation ({detail})"
        said = self._recent_log()[-1:]
        if complete:
            self._get_outputs()
        raise EndRequested(self.name, text + (f"; its message: {said[0]}" if said else ""), complete=complete)

    def _query(self, function: str, *arguments: Any) -> bool:
        """Call what an FMU need not answer, or have."""
        try:
            return self._call(function, *arguments) <= fmi.WARNING
        except FmuError:
            return False

    # State and derivatives.

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

    def _no_set_prior(self) -> bool:
        """The argument noSetFMUStatePriorToCurrentPoint of the next step: true unless this run may be rolled back.

        Until it is true, FMUs may hold back actions that they cannot undo: files, hardware, or all progress.
        """
        return not any(p.in_use for p in self.state_pools)

    def _state_calls(self) -> dict[str, int] | None:
        """Addresses of the functions for states; None if more than these calls is necessary, or the FMU has none."""
        if self.foreign or self._kept or self._remembers or not self.description.can_save:
            return None
        return {n: self._address(self._function(f"{n.title()}FMUState")) for n in ("get", "set", "free")}

    def serialize(self) -> bytes:
        """The present state as bytes. Raises CosimError when the FMU does not offer it."""
        if not self.description.can_serialize:
            raise CosimError("its FMU cannot serialize its state")
        if self.clocked is not None:
            raise CosimError("it has clocks, whose next ticks are not part of the state that the FMU serializes")
        state = self.save()
        try:
            return self.pack_pointer(state.pointer)
        finally:
            self.forget(state)

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

    def identity(self) -> Mapping[str, str]:
        about = self.description
        return {
            "model": about.name,
            "FMI version": about.fmi_version,
            "token": about.token,
            **({"interface": "Model Exchange"} if self.integrated else {}),
            **({"structural parameters": str(self.structure)} if self.structure else {}),
            "content (SHA-256 of description and library)": self.fmu.digest,
        }

    def pack(self, state: FmuState) -> bytes:
        """A saved state as the FMU serializes it. Raises CosimError when it does not offer that."""
        return state.pack()

    def unpack(self, data: bytes) -> None:
        if not self.description.can_serialize:
            raise CosimError(f"'{self.name}' cannot restore serialized states (canSerializeFMUState)")
        self._unpack(data)

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

    def sampled_states(self) -> dict[str, float]:
        """States that a sampled FMU of this project keeps between samples, element by element.

        They are `state[1]`, ... in the order of the declaration. Raises CosimError for other FMUs, and for those with a
        quadratic program.
        """
        data = self.serialize()
        if self._layout is None:
            about = self.description
            outputs = list(about.outputs.values())

            def shown(other: bytes) -> list[float]:
                self.deserialize(other)
                return [float(v) for v in self.get(outputs)]

            try:
                self._layout = find_states(data, len(about.parameters), len(about.inputs), len(outputs), shown)
            except CallFailed:
                raise CosimError(MORE_THAN_STATES) from None
            finally:
                self.deserialize(data)
        return {f"state[{i}]": float(x) for i, x in enumerate(self._layout.read(data), start=1)}

    def set_sampled_states(self, x: Array) -> None:
        """Other values for all of `sampled_states`, in their order; call that first."""
        assert self._layout is not None
        self.deserialize(self._layout.write(self.serialize(), x))

    def linearize(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D) at the present state for the given inputs and outputs, by directional derivatives.

        By differences where an FMU of Model Exchange does not offer them, or where those of a third-party one do not
        agree with differences, of which an FmuWarning tells. States and derivatives are those of the model structure.
        Raises CosimError when the FMU offers neither.
        """
        states, derivatives = self.description.states, self.description.derivatives
        if not self.description.directional_derivatives:
            if self.integration is not None:
                return self.integration.linearize(inputs, outputs)
            remedy = ': add it with interface="me" for differences' if self.description.model_exchange else ""
            raise CosimError(f"its FMU offers no directional derivatives{remedy}")
        unknowns, knowns, n = [*derivatives, *outputs], [*states, *inputs], len(states)
        jacobian = np.array([[float(of is by) for by in knowns] for of in unknowns]).reshape(-1, len(knowns))
        asked = [i for i, of in enumerate(unknowns) if of not in states]  # FMUs differ in what they say of the others
        for column, known in enumerate(knowns):
            if asked:
                jacobian[asked, column] = self.derivative([unknowns[i] for i in asked], known)
        own = self.integration
        if own is not None and self.description.kind is None and not own.agrees(jacobian, inputs, outputs):
            warnings.warn(
                f"component '{self.name}': the directional derivatives of its FMU ({self.fmu.path.name}) do not agree"
                " with differences, by which it is linearized",
                FmuWarning,
                stacklevel=2,
            )
            return own.linearize(inputs, outputs)
        return jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n], jacobian[n:, n:]

    def refuse_kinks(self, inputs: Sequence[Variable], outputs: Sequence[Variable], slopes: Array) -> None:
        """Raise CosimError if the present state lies on a kink or jump.

        `slopes`: the result of `linearize`, [[A, B], [C, D]]. States can be moved only in FMUs of this project.
        """
        about = self.description
        if slopes.size and about.kind is not None and about.can_serialize:
            refuse_kinks(self, slopes, [*about.derivatives, *outputs], about.states, inputs)

    def measure_dependencies(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Dependencies:
        """Inputs on which outputs depend directly at the present values during initialization.

        They are found by directional derivatives, or by changes that a saved state takes back. Raises CosimError when
        the FMU offers neither.
        """
        about = self.description
        if about.directional_derivatives and all(v.type == "real" for v in (*inputs, *outputs)):
            return by_derivatives(self.derivative, inputs, outputs)
        if not about.can_save or self.in_event_mode:
            raise CosimError("its FMU offers neither directional derivatives nor saved states")
        with self.kept():
            return by_perturbation(self, inputs, outputs)

    def derivative(self, unknowns: Sequence[Variable], known: Variable) -> list[float]:
        """Derivatives d unknowns / d known by the FMU's directional derivatives.

        Raises CosimError if one is not finite.
        """
        found = self.directional(unknowns, {known: 1.0})
        for variable, value in zip(unknowns, found, strict=True):
            if not math.isfinite(value):
                raise CosimError(f"its derivative of {variable.name} by {known.name} is {value}")
        return found

    def directional(self, unknowns: Sequence[Variable], seeds: Mapping[Variable, float]) -> list[float]:
        """Derivatives of unknowns along a change of variables, by one call; arrays are requested as a whole."""
        ffi, groups, knowns = self._ffi, by_reference(unknowns), by_reference(list(seeds))
        (begin, result), (at, seed) = (self._room(g) for g in (groups, knowns))
        for variable, value in seeds.items():
            seed[at[variable.reference] + variable.index] = value
        of, by = ffi.new("VR[]", list(groups)), ffi.new("VR[]", list(knowns))
        if self._v3:
            arguments: tuple[Any, ...] = (seed, len(seed), result, len(result))
        else:
            arguments = (seed, result)
        self._must("GetDirectionalDerivative", of, len(groups), by, len(knowns), *arguments)
        return [result[begin[v.reference] + v.index] for v in unknowns]

    def _room(self, groups: Mapping[int, Sequence[Variable]]) -> tuple[dict[int, int], Any]:
        """Where arrays begin, by value reference, and doubles for all of them."""
        ends = np.cumsum([0, *(elements[0].size for elements in groups.values())]).tolist()
        return dict(zip(groups, ends, strict=False)), self._ffi.new("double[]", ends[-1])


def _nothing_to_restore() -> int:
    return 0


_KEEP_FOREVER: list[Any] = []  # callbacks of instances that reported Fatal


_LOG = logging.getLogger("cosim.fmu")
_LEVELS = (logging.DEBUG, logging.WARNING)  # of OK and Warning; what is worse is an error


def _logger(name: str, messages: deque[str], problems: deque[str]) -> fmi.Log:
    """What FMUs call to log. All categories are on: not every FMU files its errors under the category it declares.

    The logger `cosim.fmu` of Python gets all of it, with the component's name.
    """

    def log(status: int, category: str, message: str) -> None:
        level = STATUS_NAMES[status] if 0 <= status < len(STATUS_NAMES) else str(status)
        text = f"[{level}] {category + ': ' if category else ''}{message.rstrip()}"
        messages.append(text)
        _LOG.log(_LEVELS[status] if 0 <= status < len(_LEVELS) else logging.ERROR, "%s: %s", name, text)
        if status >= fmi.WARNING:
            problems.append(text)

    return log


def _free(library: Library | IsolatedLibrary, v3: bool, instance: Any, keep: list[Any]) -> None:
    (library.handle.fmi3FreeInstance if v3 else library.handle.fmi2FreeInstance)(instance)
    keep.clear()
    library.release()


def _sequence(actions: list[Action]) -> Action:
    if not actions:
        return lambda: None
    if len(actions) == 1:
        return actions[0]
    together = tuple(actions)

    def run() -> None:
        for action in together:
            action()

    return run
