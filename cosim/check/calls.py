"""An FMU as the checks call it: any function of `cosim.fmu.calls`, rightly or wrongly, in the process of the check.

`Fmu` is a loaded library, `Instance` an instance of it. `call` returns whatever status comes back; the other methods do
what an importer does and raise `Refused` where the FMU does not. What is being called is written into memory that
outlives a crash, so that the crash has a name.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cosim.fmu.calls as fmi
from cosim.check.model import Model, Var
from cosim.check.rules import NotApplicable
from cosim.core.errors import STATUS_NAMES
from cosim.core.memory import physical_memory
from cosim.fmu.interface import INTERFACES, NAMES, Interface

MOST_LOGGED = 200  # messages of an instance that are kept
LONGEST = 300  # characters of a message that are shown
LOOP = 100  # event iterations
SPARE = 8  # values


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
    return STATUS_NAMES[status] if 0 <= status < len(STATUS_NAMES) else f"{status}, which is not an FMI status"


def parse_types(version: str) -> None:
    """Parse the C types of what instances pass, each some tenths of a millisecond."""
    ffi, kinds = fmi.ffi_of(version), fmi.c_types(int(version)).values()
    for kind in {*kinds, "int", "uint8_t", "size_t", "void*", "char"}:
        for of in ("", "*", "[]"):
            ffi.typeof(f"{kind}{of}")
    if version == "2":
        ffi.typeof("EventInfo*")


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
        self.ffi = fmi.ffi_of(self.version)
        self.types = fmi.c_types(int(self.version))
        self._loaded: dict[Path, Any] = {}

    def library(self, kind: str) -> Any:
        """The library of an interface."""
        path = self.libraries[kind]
        if path not in self._loaded:
            self.say(f"loading {path.name}")
            if sys.platform == "win32":
                os.add_dll_directory(str(path.parent))
            ctypes.CDLL(str(path))  # raises the loader's own words, which cffi puts others around
            self._loaded[path] = self.ffi.dlopen(str(path))
        return self._loaded[path]

    def groups(self, variables: Iterable[Var]) -> dict[str, list[Var]]:
        """Variables by the functions that access them."""
        found: dict[str, list[Var]] = {}
        for v in variables:
            found.setdefault(v.access, []).append(v)
        return found

    def readable(self, variables: Iterable[Var]) -> list[Var]:
        """Those that can be read at any time in a run."""
        types = self.types.keys() - {"Binary"}
        return [v for v in variables if v.access in types and not v.clocked and v.reference is not None and v.size > 0]


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
        self.ffi = fmu.ffi
        self._library = fmu.library(kind)
        self._saved: list[Any] = []
        self._ticking: list[tuple[int, float, float]] = []
        if event_mode is None:
            event_mode = fmu.model.clocks and self.interface.can("hasEventMode")
        self.event_mode = event_mode and kind == "cs"
        self._keep: list[Any] = []
        self._texts: list[Any] = []  # that were set last
        self.handle = self._instantiate(name, fmu.model.token if token is None else token, logging) or None
        self.state = "instantiated"

    @property
    def _instantiator(self) -> str:
        """Name of the function that instantiates, without its prefix."""
        return "Instantiate" + ("" if self.version == "2" else INTERFACES[self.kind])

    def _instantiate(self, name: str, token: str, logging: bool) -> Any:
        """The instance; NULL if the FMU returns none."""
        self.raw(self._instantiator)
        resources, given = (self.fmu.folder / "resources").resolve(), (self._log, self._keep, self.kind, logging)
        if self.version == "2":
            return fmi.instantiate2(self._library, fmi.c_library(), (name, token, resources.as_uri()), *given)
        return fmi.instantiate3(self._library, (name, token, f"{resources}{os.sep}"), *given, self.event_mode)

    def _log(self, status: int, category: str, message: str) -> None:  # noqa: ARG002
        if len(self.messages) < MOST_LOGGED:
            self.messages.append((status, message))

    # ---------------------------------------------------------------------------------------------------------- calls

    @property
    def where(self) -> str:
        """Its interface and state, in words."""
        return f"({NAMES[self.kind]}, {self.state})"

    def full_name(self, function: str) -> str:
        """The name of a function of FMI 3.0 in this version."""
        return fmi.full_name(self.version, function)

    def raw(self, function: str) -> Any:
        """A function, announced as the one that is called next."""
        if self.fmu.fatal:
            raise NotApplicable(f"{self.fmu.fatal} returned Fatal, after which no function may be called")
        name = self.full_name(function)
        self.fmu.say(f"{name} {self.where}")
        try:
            return getattr(self._library, name)
        except AttributeError:
            raise Refused(name, None, "the library does not have it", self.where) from None

    def call(self, function: str, *arguments: Any) -> int:
        """Call on this instance; None passes as NULL. Returns the status."""
        passed = (self.ffi.NULL if a is None else a for a in (self.handle, *arguments))
        status = int(self.ffi.cast("int", self.raw(function)(*passed)))
        if status == fmi.FATAL:
            self.fmu.fatal, self.handle = f"{self.full_name(function)} {self.where}", None
        return status

    def flags(self, n: int) -> tuple[Any, list[Any]]:
        """A buffer for Booleans that the FMU returns, and where each of them is."""
        kind = self.fmu.types["Boolean"]
        values = self.buffer(kind, n)
        return values, [self.ffi.cast(f"{kind}*", values + i) for i in range(n)]

    def must(self, function: str, *arguments: Any) -> None:
        """Call that has to succeed. Raises Refused."""
        before = len(self.messages)
        self._demand(function, self.call(function, *arguments), before)

    def _demand(self, function: str, status: int, before: int, when: str = "") -> None:
        """Raise Refused unless a status is OK or Warning; `before`: number of the messages before the call."""
        if not good(status):
            raise Refused(self.full_name(function), status, self.said(before), f"{self.where}{when}")

    def said(self, since: int = 0) -> str:
        """Its latest message."""
        texts = [" ".join(t.split()) for _, t in self.messages[since:] if t.strip()]
        return texts[-1][:LONGEST] if texts else ""

    # ----------------------------------------------------------------------------------------------------- life cycle

    def require(self) -> Instance:
        """Itself; raises Refused where it could not be instantiated."""
        if self.handle is None:
            raise Refused(self.full_name(self._instantiator), None, self.said(), f"({NAMES[self.kind]})")
        return self

    def setup(self, stop: float | None = None) -> tuple[Any, ...]:
        """Arguments of fmi2SetupExperiment and fmi3EnterInitializationMode."""
        tolerance = self.tolerance if self.tolerance is not None else self.model.experiment.get("tolerance", 0.0)
        given = 0.0 < tolerance < math.inf
        return (given, tolerance if given else 0.0, float(self.model.start_time), stop is not None, float(stop or 0.0))

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
        # FMI 2.0 (2.1.6) allows it before only with `initial` exact or approx, and inputs have no `initial`.
        early = {v: x for v, x in (values or {}).items() if self.version == "3" or v.causality != "input"}
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
            seconds, qualifier = self.ffi.new("double*"), self.ffi.new("int*")
            self.must("GetIntervalDecimal", [reference], 1, seconds, qualifier)
            interval = seconds[0]
            self.must("GetShiftDecimal", [reference], 1, seconds)
            shift = seconds[0]
            if not 0 < interval < math.inf:
                raise Refused("fmi3GetIntervalDecimal", fmi.OK, f"says {interval:g} s", self.where)
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
            before = len(self.messages)
            status, again, ends, timed, at = self.update_discrete_states()
            self._demand("UpdateDiscreteStates", status, before)
            self.next_event = at if timed else math.inf
            if ends:
                raise Ended
            if not again:
                break
        else:
            text = f"{LOOP} times in a row, and still requires event iterations"
            raise Refused(self.full_name("UpdateDiscreteStates"), fmi.OK, text, self.where)
        self.must("EnterContinuousTimeMode" if self.kind == "me" else "EnterStepMode")
        self.state = "continuous-time mode" if self.kind == "me" else "step mode"
        if self.kind == "me":
            self.indicators = self.get_indicators()

    def update_discrete_states(self) -> tuple[int, bool, bool, bool, float]:
        """Status of an event iteration; whether it needs another, ends, has a next event, and when that is [s]."""
        if self.version == "2":
            info = self.ffi.new("EventInfo*")
            status = self.call("UpdateDiscreteStates", info)
            return status, info.again, info.ends, info.timed, info.next
        (flags, pointers), next_ = self.flags(5), self.ffi.new("double*")
        status = self.call("UpdateDiscreteStates", *pointers, next_)
        return status, flags[0], flags[1], flags[4], next_[0]

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
            self.raw("FreeInstance")(self.handle)
        self.handle = None

    def __enter__(self) -> Instance:
        return self.require()

    def __exit__(self, *_: object) -> None:
        if self.handle is None:
            return
        for state in self._saved:
            with contextlib.suppress(Refused, NotApplicable):
                self.call("FreeFMUState", state)
        self.free()

    # --------------------------------------------------------------------------------------------------------- values

    @staticmethod
    def references(variables: Iterable[Var]) -> list[int]:
        """Value references as they are passed."""
        return [v.passed_reference for v in variables]

    def buffer(self, c_type: str, n: int) -> Any:
        """A C array for `n` values, and for some more: an FMU that writes too many does not end the check.

        Booleans of FMI 3.0 are bytes in it, since an FMU may write others than 0 and 1.
        """
        return self.ffi.new("uint8_t[]" if c_type == "bool" else f"{c_type}[]", n + SPARE)

    def get_raw(self, access: str, variables: Sequence[Var]) -> tuple[int, Any]:
        """Status, and a C array of the values of variables of one type."""
        n = sum(v.size for v in variables)
        kind = self.fmu.types[access]
        buffer = self.buffer(kind, n)
        pointer = self.ffi.cast(f"{kind}*", buffer)
        return self.transfer(f"Get{access}", self.references(variables), len(variables), pointer, n), buffer

    def set_raw(self, access: str, variables: Sequence[Var], values: Sequence[Any]) -> int:
        """Status of setting variables of one type."""
        buffer = self._buffer(access, values)
        return self.transfer(f"Set{access}", self.references(variables), len(variables), buffer, len(values))

    def transfer(self, function: str, references: Any, n: int, buffer: Any, size: int) -> int:
        """Status of a function that gets or sets `size` values of `n` variables."""
        return self.call(function, references, n, buffer, *(() if self.version == "2" else (size,)))

    def _buffer(self, access: str, values: Sequence[Any]) -> Any:
        kind = self.fmu.types[access]
        if access == "String":
            self._texts = [self.ffi.new("char[]", v if isinstance(v, bytes) else str(v).encode()) for v in values]
            return self.ffi.new("const char*[]", self._texts)
        if kind not in ("double", "float"):  # an integer beyond its type passes as C would convert it
            values = [int(self.ffi.cast(kind, int(v))) for v in values]
        return self.ffi.new(f"{kind}[]", values)

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
            values, at = self._values(access, buffer), 0
            for v in group:
                found[v] = values[at : at + v.size]
                at += v.size
        return found

    def _values(self, access: str, buffer: Any) -> list[Any]:
        if access == "String":
            return [self.ffi.string(x) if x else None for x in buffer]
        return [bool(x) for x in buffer] if self.fmu.types[access] == "bool" else list(buffer)

    # ----------------------------------------------------------------------------------------------------------- time

    def do_step(self, time: float, step: float) -> int:
        """Status of DoStep; follows what it says about events and ends. Raises Ended."""
        if self.version == "2":
            return self.call("DoStep", time, step, True)
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
            if not good(status):
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
        self.must("SetClock", references, len(references), [True] * len(references))
        self.handle_events()

    def _do_step(self, time: float, step: float) -> int:
        flags, pointers = self.flags(3)
        status = self.call("DoStep", time, step, True, *pointers, self.ffi.new("double*", math.nan))
        if good(status) and flags[1]:
            raise Ended
        if good(status) and flags[0] and self.event_mode:
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
        enter = ends = 0
        if self.interface.wants_completed_steps(self.version):
            flags, pointers = self.flags(2)
            self.must("CompletedIntegratorStep", True, *pointers)
            enter, ends = flags[0:2]
        if ends:
            raise Ended
        if crossed or enter or self.time >= self.next_event:
            self.must("EnterEventMode")
            self.state = "event mode"
            self.handle_events()
        else:
            self.indicators = new

    # ---------------------------------------------------------------------------------------------------------- states

    def save(self) -> Any:
        """A pointer to an FMU state, freed with the instance."""
        state = self.ffi.new("void**")
        self.must("GetFMUState", state)
        self._saved.append(state)
        return state

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        self.must("SetFMUState", state[0])

    def serialize(self, state: Any) -> bytes:
        """A saved state as bytes; raises Refused if its size is more than this machine's memory."""
        size = self.ffi.new("size_t*")
        self.must("SerializedFMUStateSize", state[0], size)
        if size[0] > physical_memory():
            text = f"says that a state has {size[0]} bytes, which is more than this machine has"
            raise Refused(self.full_name("SerializedFMUStateSize"), fmi.OK, text, self.where)
        data = self.ffi.new("char[]", size[0])
        self.must("SerializeFMUState", state[0], data, size[0])
        return bytes(self.ffi.buffer(data))

    def deserialize(self, data: bytes) -> Any:
        """Make a saved state of bytes."""
        state = self.ffi.new("void**")
        self.must("DeserializeFMUState", data, len(data), state)
        self._saved.append(state)
        return state

    # -------------------------------------------------------------------------------------------------- model exchange

    def _vector(self, function: str, n: int) -> list[float]:
        if n == 0:
            return []  # nothing to ask for
        data = self.buffer("double", n)
        self.must(function, data, n)
        return list(data)[:n]

    def get_states(self) -> list[float]:
        """Continuous states, in the order of their derivatives (Model Exchange)."""
        return self._vector("GetContinuousStates", self.model.n_states)

    def set_states(self, x: Sequence[float]) -> bool:
        """Set the continuous states (Model Exchange); returns true."""
        self.must("SetContinuousStates", list(x), len(x))
        return True

    def get_derivatives(self) -> list[float]:
        """Derivatives of the continuous states (Model Exchange)."""
        return self._vector("GetContinuousStateDerivatives", self.model.n_states)

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
        n = sum(v.size for v in (knowns if adjoint else unknowns))
        result = self.buffer("double", n)
        lists = (self.references(unknowns), len(unknowns), self.references(knowns), len(knowns))
        seed = list(seed)
        tail = (seed, result) if self.version == "2" else (seed, len(seed), result, n)
        self.must("GetAdjointDerivative" if adjoint else "GetDirectionalDerivative", *lists, *tail)
        return list(result)[:n]


def good(status: int) -> bool:
    """Whether a status is OK or Warning."""
    return status in (fmi.OK, fmi.WARNING)


def bits(values: Mapping[Var, Sequence[Any]]) -> dict[Var, bytes]:
    """Values of variables as bytes, for which NaN equals NaN."""
    return {
        v: b"\0".join(struct.pack("d", x) if isinstance(x, float) else repr(x).encode() for x in xs)
        for v, xs in values.items()
    }
