"""An FMU as the checks call it: any function with any arguments, rightly or wrongly, in the process of the check.

`Fmu` is a loaded library, `Instance` an instance of it. `call` returns whatever status comes back; the other methods do
what an importer does and raise `Refused` where the FMU does not. What is being called is written into memory that
outlives a crash, so that the crash has a name.
"""

from __future__ import annotations

import contextlib
import ctypes as c
import math
import os
import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cosim.fmu.calls as fmi
from cosim.check.model import Interface, Model, Var
from cosim.check.rules import NotApplicable
from cosim.core.memory import physical_memory

OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)
STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
TYPES: dict[str, Any] = {
    "Real": c.c_double,
    "Integer": c.c_int,
    "Float64": c.c_double,
    "Float32": c.c_float,
    "Int8": c.c_int8,
    "UInt8": c.c_uint8,
    "Int16": c.c_int16,
    "UInt16": c.c_uint16,
    "Int32": c.c_int32,
    "UInt32": c.c_uint32,
    "Int64": c.c_int64,
    "UInt64": c.c_uint64,
    "String": c.c_char_p,
}

MOST_LOGGED = 200  # messages of an instance that are kept
LONGEST = 300  # characters of a message that are shown
LOOP = 100  # event iterations


class EventInfo2(c.Structure):
    """`fmi2EventInfo`."""

    _fields_ = (*((n, c.c_int) for n in ("again", "terminate", "nominals", "values", "timed")), ("next", c.c_double))


class Refused(Exception):  # noqa: N818
    """A call did not return OK or Warning: `function`, `status`, and in words."""

    def __init__(self, function: str, status: int | None, message: str, where: str):
        self.function, self.status, self._given = function, status, (function, status, message, where)
        said = f": {message}" if message else ""
        super().__init__(f"{function} {where} returned {shown(status)}{said}")

    def __reduce__(self) -> Any:  # it can be raised in another process
        return Refused, self._given


class Ended(Exception):  # noqa: N818
    """The FMU asks to end the simulation."""


def shown(status: int | None) -> str:
    """A status by its name."""
    if status is None:
        return "NULL"
    return STATUS[status] if 0 <= status < len(STATUS) else f"{status}, which is not an FMI status"


class Fmu:
    """A loaded library. Raises OSError where it cannot be loaded."""

    def __init__(self, model: Model, folder: Path, libraries: Mapping[str, Path], say: Any = None):
        self.model = model
        self.folder = folder
        self.version = model.version
        self.libraries = libraries
        self.say = say or (lambda text: None)
        # the call that returned Fatal: then no instance may be called any more (FMI 2.0, 2.1.3; FMI 3.0, 2.2.4)
        self.fatal = ""
        self._loaded: dict[Path, tuple[Any, Any]] = {}
        self.types = {**TYPES, "Boolean": c.c_int if self.version == "2" else c.c_bool}
        self.flag = c.c_int if self.version == "2" else c.c_bool

    def dll(self, kind: str) -> Any:
        """The library of an interface."""
        path = self.libraries[kind]
        if path not in self._loaded:
            self.say(f"loading {path.name}")
            if sys.platform == "win32":
                os.add_dll_directory(str(path.parent))
            self._loaded[path] = c.CDLL(str(path)), fmi.ffi_of(self.version).dlopen(str(path))
        return self._loaded[path][0]

    def typed(self, kind: str) -> Any:
        """The same library with the types of its functions."""
        self.dll(kind)
        return self._loaded[self.libraries[kind]][1]

    def has(self, kind: str, function: str) -> bool:
        """Whether the library of an interface exports an FMI function, given without its prefix."""
        return hasattr(self.dll(kind), f"fmi{self.version}{function}")

    def instance(self, kind: str, **options: Any) -> Instance:
        """A new instance of an interface; `options` are those of `Instance`."""
        return Instance(self, kind, **options)

    def groups(self, variables: Iterable[Var]) -> dict[str, list[Var]]:
        """Variables by the functions that access them."""
        found: dict[str, list[Var]] = {}
        for v in variables:
            found.setdefault(v.access, []).append(v)
        return found

    def readable(self, variables: Iterable[Var]) -> list[Var]:
        """Those that can be read at any time in a run."""
        return [
            v for v in variables if v.access in self.types and not v.clocked and v.reference is not None and v.size > 0
        ]


class Instance:
    """An instance, and the state of FMI's state machine that it is in.

    `messages`: (status, text) of each message that it has logged.
    """

    def __init__(
        self,
        fmu: Fmu,
        kind: str,
        *,
        logging: bool = True,
        token: str | None = None,
        name: str = "check",
        event_mode: bool | None = None,
        tolerance: float | None = None,
    ):
        self.fmu, self.kind, self.version = fmu, kind, fmu.version
        self.model: Model = fmu.model
        self.interface: Interface = fmu.model.interfaces[kind]
        self.messages: list[tuple[int, str]] = []
        self.tolerance = tolerance  # instead of that of the default experiment
        self.state = "before instantiation"
        self.time = fmu.model.start_time
        self.handle: Any = None
        self.next_event = math.inf
        self.indicators: list[float] = []
        self._dll = fmu.dll(kind)
        self._saved: list[Any] = []
        self._ticking: list[tuple[int, float, float]] = []
        if event_mode is None:
            event_mode = fmu.model.clocks and self.interface.can("hasEventMode")
        self.event_mode = event_mode and kind == "cs"
        self._keep: list[Any] = []
        handle = self._instantiate(name, fmu.model.token if token is None else token, logging)
        self.handle = c.c_void_p(handle) if handle else None
        self.state = "instantiated"

    @property
    def _instantiator(self) -> str:
        """Name of the function that instantiates, without its prefix."""
        return "Instantiate" + {"2": ""}.get(self.version, "CoSimulation" if self.kind == "cs" else "ModelExchange")

    def _instantiate(self, name: str, token: str, logging: bool) -> int:
        """Address of the instance; 0 if the FMU returns no instance."""
        self.raw(self._instantiator)
        ffi, resources = fmi.ffi_of(self.version), (self.fmu.folder / "resources").resolve()
        library = self.fmu.typed(self.kind)
        if self.version == "2":
            texts = name, token, resources.as_uri()
            handle = fmi.instantiate2(library, fmi.c_library(), texts, self._log, self._keep, self.kind, logging)
        else:
            texts = name, token, f"{resources}{os.sep}"
            handle = fmi.instantiate3(library, texts, self._log, self._keep, self.kind, logging, self.event_mode)
        return int(ffi.cast("uintptr_t", handle))

    def _log(self, status: int, category: str, message: str) -> None:  # noqa: ARG002
        if len(self.messages) < MOST_LOGGED:
            self.messages.append((status, message))

    # ---------------------------------------------------------------------------------------------------------- calls

    @property
    def where(self) -> str:
        """Its interface and state, in words."""
        return f"({'Co-Simulation' if self.kind == 'cs' else 'Model Exchange'}, {self.state})"

    def raw(self, function: str) -> Any:
        """A function, announced as the one that is called next."""
        if self.fmu.fatal:
            raise NotApplicable(f"{self.fmu.fatal} returned Fatal, after which no function may be called")
        name = f"fmi{self.version}{function}"
        self.fmu.say(f"{name} {self.where}")
        try:
            return getattr(self._dll, name)
        except AttributeError:
            raise Refused(name, None, "the library does not have it", self.where) from None

    def call(self, function: str, *arguments: Any) -> int:
        """Call on this instance; floats pass as double, bools as the Boolean of this version. Returns the status."""
        passed = [self._argument(a) for a in arguments]
        f = self.raw(function)
        f.restype = c.c_int
        status = int(f(self.handle, *passed))
        if status == FATAL:
            self.fmu.fatal, self.handle = f"fmi{self.version}{function} {self.where}", None
        return status

    def _argument(self, value: Any) -> Any:
        if isinstance(value, bool):
            return self.fmu.flag(value)
        return c.c_double(value) if isinstance(value, float) else value

    def must(self, function: str, *arguments: Any) -> None:
        """Call that has to succeed. Raises Refused."""
        before = len(self.messages)
        self._demand(function, self.call(function, *arguments), before)

    def _demand(self, function: str, status: int, before: int, when: str = "") -> None:
        """Raise Refused unless a status is OK or Warning; `before`: number of the messages before the call."""
        if status not in (OK, WARNING):
            raise Refused(f"fmi{self.version}{function}", status, self.said(before), f"{self.where}{when}")

    def said(self, since: int = 0) -> str:
        """Its latest message."""
        texts = [" ".join(t.split()) for _, t in self.messages[since:] if t.strip()]
        return texts[-1][:LONGEST] if texts else ""

    # ----------------------------------------------------------------------------------------------------- life cycle

    def require(self) -> Instance:
        """Itself; raises Refused where it could not be instantiated."""
        if self.handle is None:
            where = f"({'Co-Simulation' if self.kind == 'cs' else 'Model Exchange'})"
            raise Refused(f"fmi{self.version}{self._instantiator}", None, self.said(), where)
        return self

    def setup(self, stop: float | None = None) -> tuple[Any, ...]:
        """Arguments of fmi2SetupExperiment and fmi3EnterInitializationMode."""
        tolerance = self.tolerance if self.tolerance is not None else self.model.experiment.get("tolerance", 0.0)
        given = 0.0 < tolerance < math.inf
        return (given, tolerance if given else 0.0, float(self.model.start_time), stop is not None, float(stop or 0.0))

    def settable_when_instantiated(self, v: Var) -> bool:
        """Whether a variable may be set before initialization mode.

        FMI 2.0 (2.1.6) allows it only with `initial` exact or approx, and inputs have no `initial`.
        """
        return self.version == "3" or v.causality != "input"

    def enter_initialization(
        self,
        values: Mapping[Var, Sequence[Any]] | None = None,
        *,
        stop: float | None = None,
        set_after_setup: bool = False,
    ) -> Instance:
        """Enter initialization mode; each value is set as soon as it may be.

        FMI 2.0: `set_after_setup` are parameters that are set after fmi2SetupExperiment.
        """
        early = {v: x for v, x in (values or {}).items() if self.settable_when_instantiated(v)}
        late = {v: x for v, x in (values or {}).items() if v not in early}
        self.time = self.model.start_time
        if set_after_setup:
            self.must("SetupExperiment", *self.setup(stop))
        self.set(early)
        if self.version == "2" and not set_after_setup:
            self.must("SetupExperiment", *self.setup(stop))
        self.must("EnterInitializationMode", *(self.setup(stop) if self.version == "3" else ()))
        self.state = "initialization mode"
        self.set(late)
        return self

    def exit_initialization(self) -> Instance:
        """To step mode, or to event mode."""
        if self.event_mode:
            self._ticking = [self._asked(*clock) for clock in self.model.ticking]
        self.must("ExitInitializationMode")
        self.state = "step mode" if self.kind == "cs" and not self.event_mode else "event mode"
        if self.state == "event mode" and self.kind == "cs":
            self.handle_events()
        return self

    def _asked(self, reference: int, interval: float, shift: float) -> tuple[int, float, float]:
        """Reference, interval and shift of a clock, of which importers have to ask what is not written."""
        if math.isnan(interval):
            which, seconds, qualifier = (c.c_uint32 * 1)(reference), (c.c_double * 1)(), (c.c_int * 1)()
            self.must("GetIntervalDecimal", which, c.c_size_t(1), seconds, qualifier)
            interval = seconds[0]
            self.must("GetShiftDecimal", which, c.c_size_t(1), seconds)
            shift = seconds[0]
            if not 0 < interval < math.inf:
                raise Refused("fmi3GetIntervalDecimal", OK, f"says {interval:g} s", self.where)
        return reference, interval, shift

    def initialize(self, values: Mapping[Var, Sequence[Any]] | None = None) -> Instance:
        """Through initialization; ME instances to continuous-time mode."""
        self.enter_initialization(values).exit_initialization()
        if self.kind == "me":
            self.handle_events()
        return self

    def handle_events(self) -> None:
        """Iterate in event mode and leave it. Raises Ended, Refused."""
        for _ in range(LOOP):
            if self.version == "2":
                info = EventInfo2()
                self.must("NewDiscreteStates", c.byref(info))
                again, ends, timed, at = info.again, info.terminate, info.timed, info.next
            else:
                flags, next_ = [c.c_bool() for _ in range(5)], c.c_double()
                self.must("UpdateDiscreteStates", *map(c.byref, flags), c.byref(next_))
                again, ends, timed, at = flags[0].value, flags[1].value, flags[4].value, next_.value
            self.next_event = at if timed else math.inf
            if ends:
                raise Ended
            if not again:
                break
        else:
            raise Refused(
                f"fmi{self.version}{'NewDiscreteStates' if self.version == '2' else 'UpdateDiscreteStates'}",
                OK,
                f"{LOOP} times in a row, and still requires event iterations",
                self.where,
            )
        self.must("EnterContinuousTimeMode" if self.kind == "me" else "EnterStepMode")
        self.state = "continuous-time mode" if self.kind == "me" else "step mode"
        if self.kind == "me":
            self.indicators = self.get_indicators()

    def terminate(self) -> None:
        """Call Terminate."""
        self.must("Terminate")
        self.state = "terminated"

    def reset(self) -> None:
        """Call Reset; the instance is instantiated at the start time again."""
        self.must("Reset")
        self.state = "instantiated"
        self.time = self.model.start_time
        self.next_event = math.inf

    def free(self) -> None:
        """Free the instance, unless a call has returned Fatal."""
        if self.handle is not None and not self.fmu.fatal:
            f = self.raw("FreeInstance")
            f.restype = None
            f(self.handle)
        self.handle = None

    def __enter__(self) -> Instance:
        return self.require()

    def __exit__(self, *_: object) -> None:
        if self.handle is None:
            return
        for state in self._saved:
            with contextlib.suppress(Refused, NotApplicable):
                self.call(f"Free{self.saved}", c.byref(state))
        self.free()

    # --------------------------------------------------------------------------------------------------------- values

    @staticmethod
    def references(variables: Iterable[Var]) -> Any:
        """Value references as an array in C."""
        found = [v.reference or 0 for v in variables]
        return (c.c_uint32 * max(1, len(found)))(*found)

    def get_raw(self, access: str, variables: Sequence[Var]) -> tuple[int, Any]:
        """Status, and a C array of the values of variables of one type."""
        n = sum(v.size for v in variables)
        buffer = (self.fmu.types[access] * max(1, n))()
        count = () if self.version == "2" else (c.c_size_t(n),)
        return self.call(f"Get{access}", self.references(variables), c.c_size_t(len(variables)), buffer, *count), buffer

    def set_raw(self, access: str, variables: Sequence[Var], values: Sequence[Any]) -> int:
        """Status of setting variables of one type."""
        buffer = self._buffer(access, values)
        count = () if self.version == "2" else (c.c_size_t(len(values)),)
        return self.call(f"Set{access}", self.references(variables), c.c_size_t(len(variables)), buffer, *count)

    def _buffer(self, access: str, values: Sequence[Any]) -> Any:
        kind = self.fmu.types[access]
        if access == "String":
            values = [v if isinstance(v, bytes) else str(v).encode() for v in values]
        elif kind not in (c.c_double, c.c_float):
            values = [int(v) for v in values]
        return (kind * max(1, len(values)))(*values)

    def set(self, values: Mapping[Var, Sequence[Any]]) -> bool:
        """Set variables; true. Raises Refused."""
        for access, variables in self.fmu.groups(values).items():
            flat = [x for v in variables for x in values[v]]
            before = len(self.messages)
            self._demand(f"Set{access}", self.set_raw(access, variables, flat), before)
        return True

    def get(self, variables: Sequence[Var]) -> dict[Var, list[Any]]:
        """Values of variables, as Python numbers and bytes. Raises Refused."""
        found: dict[Var, list[Any]] = {}
        for access, group in self.fmu.groups(variables).items():
            before = len(self.messages)
            status, buffer = self.get_raw(access, group)
            self._demand(f"Get{access}", status, before)
            values, at = list(buffer), 0
            for v in group:
                found[v] = values[at : at + v.size]
                at += v.size
        return found

    # ----------------------------------------------------------------------------------------------------------- time

    def do_step(self, time: float, step: float) -> int:
        """Status of DoStep; follows what it says about events and ends. Raises Ended."""
        if self.version == "2":
            return self.call("DoStep", float(time), float(step), True)
        begin, end, near = time, time + step, 1e-9 * (1.0 + abs(time))
        sensible = self._ticking and 0 < step < 1000 * min(interval for _, interval, _ in self._ticking)
        while sensible and self.state == "step mode":
            following = {r: self._following(time, interval, shift) for r, interval, shift in self._ticking}
            if due := [r for r, at in following.items() if at <= time + near]:
                self.tick(due)
            to = min(following[r] if r not in due else following[r] + interval for r, interval, _ in self._ticking)
            if to >= end - near:
                break
            status = self._do_step(time, to - time)
            if status not in (OK, WARNING):
                return status
            time = to
        return self._do_step(time, step if time == begin else end - time)

    def _following(self, time: float, interval: float, shift: float) -> float:
        """The first tick of a clock that is not before a time."""
        begin = self.model.start_time + shift
        return begin + max(0, math.ceil((time - begin) / interval - 1e-6)) * interval

    def tick(self, references: Sequence[int]) -> None:
        """Event mode in which these clocks tick. Raises Ended, Refused."""
        self.must("EnterEventMode")
        self.state = "event mode"
        n = len(references)
        self.must("SetClock", (c.c_uint32 * n)(*references), c.c_size_t(n), (c.c_bool * n)(*[True] * n))
        self.handle_events()

    def _do_step(self, time: float, step: float) -> int:
        flags, last = [c.c_bool() for _ in range(3)], c.c_double(math.nan)
        status = self.call("DoStep", float(time), float(step), True, *map(c.byref, flags), c.byref(last))
        if status in (OK, WARNING) and flags[1].value:
            raise Ended
        if status in (OK, WARNING) and flags[0].value and self.event_mode:
            self.must("EnterEventMode")
            self.state = "event mode"
            self.handle_events()
        return status

    def step(self, step: float) -> None:
        """Advance by a communication step, or with Model Exchange by an explicit Euler step with its events.

        Raises Refused, Ended.
        """
        if self.kind == "me":
            self._euler(step)
            return
        before = len(self.messages)
        when = f" from {self.time:.9g} to {self.time + step:.9g} s"
        self._demand("DoStep", self.do_step(self.time, step), before, when)
        self.time += step

    def _euler(self, step: float) -> None:
        n = self.model.n_states
        if n:
            x, dx = self.get_states(), self.get_derivatives()
        step = min(step, self.next_event - self.time) if self.next_event > self.time else step
        self.time += step
        self.must("SetTime", self.time)
        if n:
            self.set_states([a + step * b for a, b in zip(x, dx, strict=True)])
        new = self.get_indicators()
        crossed = any((a > 0) != (b > 0) for a, b in zip(self.indicators, new, strict=False))
        enter, ends = self.fmu.flag(), self.fmu.flag()
        if self.interface.wants_completed_steps(self.version):
            self.must("CompletedIntegratorStep", True, c.byref(enter), c.byref(ends))
        if ends.value:
            raise Ended
        if crossed or enter.value or self.time >= self.next_event:
            self.must("EnterEventMode")
            self.state = "event mode"
            self.handle_events()
        else:
            self.indicators = new

    # ---------------------------------------------------------------------------------------------------------- states

    @property
    def saved(self) -> str:
        """Name of a saved state in the function names of this FMI version."""
        return "FMUstate" if self.version == "2" else "FMUState"

    def save(self) -> Any:
        """An FMU state, freed with the instance."""
        state = c.c_void_p()
        self.must(f"Get{self.saved}", c.byref(state))
        self._saved.append(state)
        return state

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        self.must(f"Set{self.saved}", state)

    def serialize(self, state: Any) -> bytes:
        """A saved state as bytes; raises Refused if its size is more than this machine's memory."""
        size = c.c_size_t()
        self.must(f"Serialized{self.saved}Size", state, c.byref(size))
        if size.value > physical_memory():
            text = f"says that a state has {size.value} bytes, which is more than this machine has"
            raise Refused(f"fmi{self.version}Serialized{self.saved}Size", OK, text, self.where)
        data = c.create_string_buffer(max(1, size.value))
        self.must(f"Serialize{self.saved}", state, data, size)
        return data.raw[: size.value]

    def deserialize(self, data: bytes) -> Any:
        """Make a saved state of bytes."""
        state = c.c_void_p()
        name = ("DeSerialize" if self.version == "2" else "Deserialize") + self.saved
        self.must(name, data, c.c_size_t(len(data)), c.byref(state))
        self._saved.append(state)
        return state

    # -------------------------------------------------------------------------------------------------- model exchange

    def _vector(self, function: str, n: int) -> list[float]:
        if n == 0:
            return []  # nothing to ask for
        data = (c.c_double * n)()
        self.must(function, data, c.c_size_t(n))
        return list(data)[:n]

    def get_states(self) -> list[float]:
        """Continuous states, in the order of their derivatives (Model Exchange)."""
        return self._vector("GetContinuousStates", self.model.n_states)

    def set_states(self, x: Sequence[float]) -> bool:
        """Set the continuous states (Model Exchange); returns true."""
        self.must("SetContinuousStates", (c.c_double * max(1, len(x)))(*x), c.c_size_t(len(x)))
        return True

    def get_derivatives(self) -> list[float]:
        """Derivatives of the continuous states (Model Exchange)."""
        return self._vector(
            "GetDerivatives" if self.version == "2" else "GetContinuousStateDerivatives", self.model.n_states
        )

    def get_nominals(self) -> list[float]:
        """Nominal values of the continuous states (Model Exchange)."""
        return self._vector("GetNominalsOfContinuousStates", self.model.n_states)

    def get_indicators(self) -> list[float]:
        """Event indicators (Model Exchange)."""
        return self._vector("GetEventIndicators", self.model.n_indicators)

    # ----------------------------------------------------------------------------------------------------- derivatives

    def directional(
        self, unknowns: Sequence[Var], knowns: Sequence[Var], seed: Sequence[float], adjoint: bool = False
    ) -> list[float]:
        """Product of the Jacobian with a seed of the knowns; `adjoint`: of its transpose with one of the unknowns."""
        z, v = self.references(unknowns), self.references(knowns)
        nz, nv = sum(x.size for x in unknowns), sum(x.size for x in knowns)
        size = nv if adjoint else nz
        given, result = (c.c_double * max(1, len(seed)))(*seed), (c.c_double * max(1, size))()
        lists = (z, c.c_size_t(len(unknowns)), v, c.c_size_t(len(knowns)))
        tail = (given, result) if self.version == "2" else (given, c.c_size_t(len(seed)), result, c.c_size_t(size))
        self.must("GetAdjointDerivative" if adjoint else "GetDirectionalDerivative", *lists, *tail)
        return list(result)[:size]


def bits(values: Mapping[Var, Sequence[Any]]) -> dict[Var, bytes]:
    """Values of variables as bytes, for which NaN equals NaN."""
    return {
        v: b"\0".join(struct.pack("d", x) if isinstance(x, float) else repr(x).encode() for x in xs)
        for v, xs in values.items()
    }
