"""An instance whose values and steps are bound to the master's buffers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NoReturn

import numpy as np

import cosim.fmu.calls as fmi
from cosim.core.component import Action, Array, EndRequested, FmiCalls, Ports, Transfer, is_whole
from cosim.core.description import TEXTS, Variable
from cosim.core.errors import CosimError, FmuError
from cosim.core.time import seconds_text
from cosim.fmu.exact_values import ExactCall
from cosim.fmu.instance import FmuInstance
from cosim.fmu.transfers import Arrangement, arrangements


@dataclass(frozen=True)
class _Bound:
    """One bound FMI call that moves values: `move` does it and checks the status; `transfer` is the same for C."""

    move: Action
    transfer: Transfer


_DoStep = tuple[Callable[..., int], tuple[Any, ...], Any]


class BoundInstance(FmuInstance):
    """What `FmuComponent` is made of next: calls that move values between the FMU and the master, and step it."""

    _get_outputs: Action

    # Values.

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
        function = f"{direction}{fmi.accessed_as(self.fmu.major, how.fmi_type)}"
        arguments = (references, len(how.arrays), pointer, *((total,) if v3 else ()))
        bare = self._function(function)
        direct = self._checked(partial(bare, self._instance, *arguments), function)

        def scatter() -> None:
            data[element] = buffer[place]
            direct()

        def gather() -> None:
            direct()
            buffer[place] = data[element]

        if direction == "Set" and how.keeps:
            self._keep_elements(how, data)
        transfer = Transfer(
            function,
            self._address(bare),
            self._address(references),
            len(how.arrays),
            data,
            None if how.in_place else element,
            None if how.in_place else place,
            how.widths,
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
            self._keep_elements(how, call.values)
        self._exact.append(call)
        function = f"{direction}{how.fmi_type}"
        move = call.bound(self._address(self._function(function)), self.address)
        return _Bound(self._checked(move, function), call.transfer(function))

    def _checked(self, call: Callable[[], int], function: str) -> Action:
        """A call that raises the exception for its failure."""
        fail, warning = self._fail, fmi.WARNING

        def checked() -> None:
            status = call()
            if status > warning:
                fail(function, status)

        return checked

    def _keep_elements(self, how: Arrangement, values: Any) -> None:
        """Let elements of an array that nobody drives keep their values."""

        def keep() -> None:
            values[:] = [x for r, e in how.arrays.items() for x in self._get_raw(how.fmi_type, [r], e[0].size)]

        keep()
        self._kept.append(keep)

    # Steps.

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
