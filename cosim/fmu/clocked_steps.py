"""FMI 3.0 Co-Simulation FMUs with clocks: what `engine/clocked_steps.c`, which has the rule, needs to know of them."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NoReturn

import numpy as np

from cosim.core.component import Action, Transfer
from cosim.core.description import LONGEST_TEXT, TEXTS, WIDE, Description, Variable
from cosim.core.errors import CallFailed, CosimError, FmuError
from cosim.core.signals import Array
from cosim.engine.library import engine_transfers, interface, library
from cosim.fmu.calls import WARNING
from cosim.fmu.driver import Driver
from cosim.fmu.transfers import Arrangement, arrangements, slots, sources

_KINDS = {"triggered": 1, "constant": 2, "fixed": 2, "tunable": 3, "changing": 4, "countdown": 5}  # `ClockKind`
_EXACT = 2**53


def refusal(about: Description) -> str:
    """Why the clocks of an FMU cannot be driven; empty if they can, or if there are none."""
    for clock in about.clocks:
        if clock.causality == "input" and not about.event_mode:
            return f"its clock '{clock.name}' needs event mode, which it does not offer (hasEventMode)"
    return ""


def returns_early(about: Description) -> bool:
    """Whether an FMU with clocks may return early from its steps."""
    return about.early_return and about.variable_step and about.can_save


@dataclass(frozen=True)
class ClockedGroup:
    """Variables that are moved together: `ClockedGroup` of clocked_steps.h."""

    first: int
    n: int
    clocks: tuple[int, ...]
    how: tuple[int, bool, bool]  # waits, at_events, at_first


class ClockedValues:
    """Groups and places of the values of one FMU with clocks, and its `ClockedSetup`.

    Unconnected inputs of clocks (`waiting`) have places behind the others: their values wait for a tick.
    """

    def __init__(
        self,
        about: Description,
        inputs: Sequence[Variable],
        outputs: Sequence[Variable],
        sizes: Mapping[Variable, int],
        waiting: Iterable[Variable],
    ):
        self.about = about
        self.clocks = sorted(about.clocks, key=lambda c: c.reference)
        late = [v for v in waiting if v.clocks and v not in inputs]
        own = {
            v: 8 if v.fmi_type in WIDE else v.max_size or LONGEST_TEXT for v in late if v.fmi_type in (*WIDE, *TEXTS)
        }
        self.sizes = {**sizes, **own}
        self.n_outputs = sum(slots(sizes.get(v, 0)) for v in outputs)
        self.place: dict[Variable, int] = {}
        at = [0, 0]
        for side, variables in enumerate(([*inputs, *late], outputs)):
            for v in variables:
                self.place[v] = at[side]
                at[side] += self.width(v)
        self.n_inputs, self.waits = at[0], dict[Variable, int]()
        for v in late:
            self.waits[v] = next((w for o, w in self.waits.items() if o.reference == v.reference), self.n_inputs)
            self.n_inputs = max(self.n_inputs, self.waits[v] + 1)
        first = None if about.kind is not None else about.initial_unknowns  # FMUs of this project compute them all
        self.sets, self.inputs = self._grouped([*inputs, *late], None)
        self.gets, self.outputs = self._grouped(outputs, first)

    def width(self, variable: Variable) -> int:
        """Places of a value."""
        return slots(self.sizes.get(variable, 0))

    def index(self, references: Iterable[int]) -> tuple[int, ...]:
        """Numbers of clocks; that of an unknown one is behind all others."""
        known = {c.reference: i for i, c in enumerate(self.clocks)}
        return tuple(sorted(known.get(r, len(known)) for r in references))

    def _grouped(
        self, variables: Sequence[Variable], first: frozenset[str] | None
    ) -> tuple[list[Arrangement], list[ClockedGroup]]:
        about = self.about

        def of(v: Variable) -> tuple[tuple[int, ...], int, bool]:
            return self.index(v.clocks), self.waits.get(v, -1), not v.clocks and about.waits(v)

        calls: list[Arrangement] = []
        groups = []
        for key in dict.fromkeys(map(of, variables)):
            own = [v for v in variables if of(v) == key]
            moves = arrangements(3, variables, lambda v, key=key: of(v) == key, self.sizes)  # type: ignore[misc]
            at_first = not key[0] or first is None or all(v.declared in first for v in own)
            groups.append(ClockedGroup(len(calls), len(moves), key[0], (*key[1:], at_first)))
            calls += moves
        return calls, groups

    def clock_setups(self) -> list[tuple[Any, ...]]:
        """`ClockSetup` of each clock, without its name."""
        kinds = [_KINDS[c.kind] if c.causality == "input" else 0 for c in self.clocks]
        return [
            (c.reference, kind, c.interval is not None, c.fractions, _time(c.interval or Fraction(0)), _time(c.shift))
            for c, kind in zip(self.clocks, kinds, strict=True)
        ]

    def numbers(self) -> list[int]:
        """`ClockedSetup` without its pointers."""
        return [
            len(self.clocks),
            len(self.inputs),
            len(self.outputs),
            self.n_inputs,
            self.n_outputs,
            self.about.variable_step,
            returns_early(self.about),
        ]


def _time(seconds: Fraction) -> tuple[int, int, float]:
    """`ClockedTime`."""
    n, d = seconds.as_integer_ratio()
    return (n, d, float(seconds)) if max(n, d) < _EXACT else (0, 0, float(seconds))


def _packed(variable: Variable, value: Any, n: int, size: int) -> list[float]:
    """A value in the places of the exchange: `n` for one of at most `size` bytes (`engine/exact_values.h`)."""
    if n == 1:
        return [float(value)]
    if variable.fmi_type in WIDE:
        first, data = float(value), (int(value) % 2**64).to_bytes(8, "little")
    else:
        data = value.encode() if isinstance(value, str) else bytes(value)
        first = len(data)
    if len(data) > size:
        raise CosimError(f"{variable.name} has {len(data)} bytes, and at most {size} can wait for its clock to tick")
    return [first, *np.frombuffer(data.ljust(4 * n - 4, b"\0"), dtype="<u4").tolist()]


class ClockedSteps(Driver):
    """The steps of one instance."""

    def __init__(self, component: Any):
        super().__init__()
        self.component = component
        self._calls = self._library.cosim_clocked_calls()
        self._handle = self._ffi.new_handle(component)
        self.values: ClockedValues
        self.fmu: Any = None
        self.network: ClockNetwork | None = None
        self._kept: list[Any] = []
        self._u = self._y = np.zeros(0)

    @property
    def stepping(self) -> bool:
        """Whether initialization is over."""
        return self.fmu is not None and bool(self.fmu.stepping)

    @property
    def step(self) -> tuple[Any, Any]:
        return self._calls.step, self.fmu

    @property
    def changed(self) -> int:
        """Bits of the floating-point environment that it has changed in a network (`environment.h`)."""
        return 0 if self.fmu is None else int(self.fmu.changed)

    # Binding.

    def bind(
        self, inputs: Sequence[Variable], outputs: Sequence[Variable], sizes: Mapping[Variable, int], y: Array
    ) -> None:
        """A fresh setup for these inputs and outputs; `y`: where the exchange has the outputs."""
        component, ffi, about = self.component, self._ffi, self.component.description
        self.values = values = ClockedValues(about, inputs, outputs, sizes, about.inputs.values())
        self._kept, self.network = (keep := []), None

        def new(*what: Any) -> Any:
            keep.append(ffi.new(*what))
            return keep[-1]

        def groups(listed: Sequence[ClockedGroup]) -> Any:
            made = [(g.first, g.n, new("uint32_t[]", g.clocks), len(g.clocks), *g.how) for g in listed]
            return new("ClockedGroup[]", made)

        names = [new("char[]", text.encode()) for text in (component.name, *(c.name for c in values.clocks))]
        clocks = new("ClockSetup[]", [(n, *c) for n, c in zip(names[1:], values.clock_setups(), strict=True)])
        pointers = names[0], clocks, groups(values.inputs), groups(values.outputs)
        setup = new("ClockedSetup*", (*pointers, *values.numbers()))
        memory = new("int64_t[]", self._calls.size(setup) // 8 + 1)
        self.fmu = f = self._calls.make(memory, setup, self._pointer(component.address))
        f.owner, f.foreign, f.shown = self._handle, component.foreign, self._pointer(y.ctypes.data)
        for i in range(self._library.CLOCKED_VALUES):
            with contextlib.suppress(FmuError):  # it lacks one that may never be called
                f.call[i] = self._pointer(component._address(component._function(self._name(i))))
        at = (f.values.u, values.n_inputs), (f.values.y, values.n_outputs)
        self._u, self._y = (np.frombuffer(ffi.buffer(p, 8 * n)) if n else np.zeros(0) for p, n in at)
        self._sets, self._gets = (
            [component._transfer(direction, how, buffer).transfer for how in calls]
            for direction, calls, buffer in (("Set", values.sets, self._u), ("Get", values.gets, self._y))
        )
        f.sets, f.gets = (engine_transfers(3, calls, keep) for calls in (self._sets, self._gets))

    def port(self, direction: str, data: Array) -> list[tuple[Action, Transfer]]:
        """What sets inputs from `data` ("Set"), or gets outputs to it: as an action and as a call; none for none."""
        call, name = getattr(self._calls, direction.lower()), direction
        arguments = self._ffi.cast("uint32_t*", self.fmu), 0, self._pointer(data.ctypes.data), len(data)
        transfer = Transfer(name, self._address(call), self._address(self.fmu), 0, data)
        return [(lambda: self._pass(call(self._ffi.NULL, *arguments)), transfer)] if len(data) else []

    def use(self, flags: Any, last: Any) -> None:
        """`bool[4]` and `double*` that steps set."""
        self.fmu.flags, self.fmu.last = self._ffi.cast("bool*", flags), self._ffi.cast("double*", last)

    def follow(self, component: Any, values: Any, adaptive: Any) -> None:
        """From now on inputs of clocks have at ticks what `adaptive` extrapolates, if it is not NULL."""
        f, about, found = self.fmu, self.values, []
        inputs = (i for v, i in about.place.items() if v.clocks and v.causality == "input" and v not in about.waits)
        for i, slot in sources(component, values, inputs).items():
            if adaptive and adaptive.published <= slot < adaptive.published + adaptive.n:
                scale = (component.scale[i], component.offset[i]) if component.scale else (1.0, 0.0)
                found.append((0, 0, slot - adaptive.published, i, 1, *scale))
        self._followed = self._ffi.new("ClockWire[]", found)
        f.adaptive, f.followed, f.n_followed = adaptive, self._followed, len(found)

    def _name(self, function: int) -> str:
        return str(self._ffi.string(self._calls.function(function)).decode())

    # Life.

    def exit_initialization(self, start: float) -> None:
        """Read intervals, leave initialization mode, and leave the event mode after it for step mode.

        FMUs with connected clocks leave that event mode together. `start`: begin of initialization [s].
        """
        self._pass(self._calls.intervals(self.fmu, start))
        self.component._must("ExitInitializationMode")
        if self.network is None:
            self.begin()

    def begin(self) -> None:
        """Those of its network that have not begun leave the event mode after initialization."""
        self._pass(self._calls.begin(self.fmu.network))

    def set(self, values: Mapping[Variable, Any]) -> None:
        """Set parameters and inputs between steps, in event mode.

        Inputs of a clock wait for its next tick; a tunable clock's new interval starts now.
        """
        for v, value in values.items():
            if v in self.values.waits:
                self._wait(v, value)
        if now := {v: x for v, x in values.items() if v not in self.values.waits}:
            self.fmu.tuned = True
            self._pass(self._calls.enter(self.fmu))
            self.component._set_values(now)
            self._pass(self._calls.leave(self.fmu))

    def _wait(self, variable: Variable, value: Any) -> None:
        values, waits = self.values, self.values.waits[variable]
        given = {variable: value}
        if variable.size > 1 and not self._u[waits]:  # the other elements keep what they are
            whole = [v for v, w in values.waits.items() if w == waits]
            given = dict(zip(whole, self.component.get(whole), strict=True)) | given
        for v, x in given.items():
            self._part(self._u, v)[:] = _packed(v, x, values.width(v), values.sizes.get(v, 0))
        self._u[waits] = 1.0

    # What a saved state has beside that of the FMU.

    def saved(self) -> bytes:
        """State of the clocks, inputs that wait for a tick, and outputs of clocks that show until the next one.

        Values have names: which of them are bound may differ from run to run.
        """
        f, values, size = self.fmu, self.values, self._ffi.sizeof("ClockDue") * len(self.values.clocks)
        waiting = [v for v, w in values.waits.items() if self._u[w]]
        kept: dict[str, Any] = {
            "memory": bytes(self._ffi.buffer(self._ffi.addressof(f, "memory"))).hex(),
            "due": bytes(self._ffi.buffer(f.due, size)).hex(),
            "waiting": {v.name: self._part(self._u, v).tobytes().hex() for v in waiting},
            "shown": {v.name: self._part(self._y, v).tobytes().hex() for v in values.place if v.causality == "output"},
        }
        return json.dumps(kept).encode()

    def restore(self, saved: bytes) -> None:
        """Restore a state that `saved` returned. Raises CosimError for anything else."""
        f, values = self.fmu, self.values
        memory, due = self._ffi.buffer(self._ffi.addressof(f, "memory")), self._ffi.sizeof("ClockDue")
        try:
            kept = json.loads(saved)
            memory_was, due_was = bytes.fromhex(kept["memory"]), bytes.fromhex(kept["due"])
            waiting, shown = (
                {name: np.frombuffer(bytes.fromhex(x)) for name, x in kept[of].items()} for of in ("waiting", "shown")
            )
            if len(memory_was) != len(memory) or len(due_was) != due * len(values.clocks):
                raise ValueError
        except (ValueError, KeyError, TypeError, AttributeError):
            raise CosimError(f"the state of '{self.component.name}' does not hold its clocks") from None
        memory[:] = memory_was
        self._ffi.buffer(f.due, len(due_was))[:] = due_was
        f.arrived = False
        for v, w in values.waits.items():
            self._u[w] = v.name in waiting
        for array, held in ((self._u, waiting), (self._y, shown)):
            for v in values.place:
                x = held.get(v.name)
                if x is not None and len(x) == values.width(v):
                    self._part(array, v)[:] = x

    def _part(self, array: Array, variable: Variable) -> Array:
        at = self.values.place[variable]
        return array[at : at + self.values.width(variable)]

    # Failures.

    def _pass(self, status: int) -> None:
        if status > WARNING:
            self.fail()

    def fail(self, *, whole: bool = False) -> NoReturn:
        """Raise the exception for what the report says, of this FMU or of another one of its network.

        `whole`: all of them have taken their step whole.
        """
        lib, ffi, report = self._library, self._ffi, self.fmu.network.report
        culprit, end, text = ffi.from_handle(report.fmu.owner), report.end, ffi.new("char[]", 4096)
        self._calls.why(self.fmu.network, text, len(text))
        said = ffi.string(text).decode(errors="replace")
        if end == lib.CLOCKED_TERMINATED:
            culprit._end_requested(said, whole)
        if end == lib.CLOCKED_CALL_FAILED and report.function == lib.CLOCKED_DO_STEP:
            culprit.do_step_failed(report.status, report.time, report.until - report.time, within=not whole)
        if end == lib.CLOCKED_CALL_FAILED:
            own = culprit.clocked
            if report.function == lib.CLOCKED_VALUES:
                calls, k = (own._sets, report.call) if report.call > 0 else (own._gets, -report.call)
                culprit._fail(calls[k - 1].function, report.status)
            culprit._function(name := self._name(report.function))  # raises if the library lacks it
            culprit._fail(name, report.status)
        if end in (lib.CLOCKED_BAD_INTERVAL, lib.CLOCKED_BAD_SHIFT):
            raise CosimError(f"'{culprit.name}': {said}")
        raise CallFailed(culprit.name, "fmi3DoStep" if end == lib.CLOCKED_BAD_TIME else "event mode", 3, said)


class ClockNetwork:
    """FMUs whose clocks are connected: they take their steps together.

    `ticks`: `ClockTick` of each connection of clocks; `wires`: `ClockWire` of each input of a clock that another one of
    them drives, with its clocks in the place of `clocks` and `n_clocks`.
    """

    def __init__(self, fmus: Sequence[ClockedSteps], ticks: Sequence[tuple[int, ...]], wires: Sequence[ClockWire]):
        ffi, self._fmus = interface(), fmus
        self._network = n = ffi.new("ClockedNetwork*")
        self._pointers = ffi.new("ClockedFmu*[]", 4 * len(fmus))
        self._pointers[0 : len(fmus)] = [f.fmu for f in fmus]
        self._clocks = [ffi.new("uint32_t[]", w.clocks) for w in wires]
        self._ticks = ffi.new("ClockTick[]", list(ticks))
        listed = zip(wires, self._clocks, strict=True)
        self._wires = ffi.new("ClockWire[]", [(*w.numbers, clocks, len(w.clocks), w.plain) for w, clocks in listed])
        n.ticks, n.n_ticks, n.wires, n.n_wires = self._ticks, len(ticks), self._wires, len(wires)
        library().cosim_clocked_calls().join(n, self._pointers, len(fmus))
        for f in fmus:
            f.network = self

    def begin(self) -> None:
        """Those that have not begun leave the event mode after initialization."""
        self._fmus[0].begin()


@dataclass(frozen=True)
class ClockWire:
    """`numbers`: source, target, from, to, n, scale, offset."""

    numbers: tuple[Any, ...]
    clocks: tuple[int, ...]
    plain: bool
