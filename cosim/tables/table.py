"""Signals over time that drive inputs: a component whose outputs are the columns of a table."""

from __future__ import annotations

import copy
import hashlib
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from build_fmus.base import surface
from build_fmus.base.checks import did_you_mean, unknown
from cosim.core.component import FmiCalls, Ports
from cosim.core.description import Description, Variable
from cosim.core.errors import CallFailed, CosimError
from cosim.core.signals import Array
from cosim.engine.library import interface, library
from cosim.tables.source import Signal, Signals, TableError, read

Interpolation = Literal["linear", "held"]
After = Literal["error", "hold"]
DEFAULT_STEP = Fraction(1, 1000)  # s, as that of roads
_EARLY = 1e-6  # of the shortest interval: times in files are rounded
_EQUAL = 1e-6  # relative difference up to which intervals are the same
_FMI_TYPES = {"real": "Float64", "integer": "Int64", "boolean": "Boolean"}


class Table:
    """Signals from `source`: a CSV or Parquet file, a DataFrame, a mapping of names to arrays, or a `Recording`.

        road = system.add("road", Table("track.csv"))
        system.connect("road.z", "car.wheel.fl.road")

    Its outputs are the columns, by name; units stand in the header (`z [mm]`), in the metadata of a Parquet field
    (`unit`), in `attrs["units"]` of a DataFrame, or in `units`, and are converted when they are connected. `time`: the
    column of the time [s or the unit it has], else that called time, t or timestamp. `columns`: those to take.

    `interpolation`: "linear" between rows or "held" from row to row, for all or by column (`{"gear": "held"}`, the
    others linear). Integers that are held connect to Integer inputs; Booleans are always held. It is sampled like other
    discrete components: by default every millisecond, or at the interval of its rows where that is shorter and always
    the same.

    `system["road"].set({"z": samples})` sets the values of a column of real numbers, one for each row, for the next
    runs.

    The last row is held for the length of the interval before it. After that a run ends with an error, and one whose
    stop time is later is refused before it begins, unless `after="hold"` keeps the last values. `shift` [s] is added to
    all times. Raises TableError.
    """

    def __init__(
        self,
        source: Any,
        *,
        time: str | None = None,
        columns: Iterable[str] | None = None,
        units: Mapping[str, str] | None = None,
        interpolation: Interpolation | Mapping[str, Interpolation] = "linear",
        after: After = "error",
        shift: float = 0.0,
    ):
        if after not in ("error", "hold"):
            raise TableError(unknown("way to go on after the table", after, ("error", "hold")))
        if not np.isfinite(shift):
            raise TableError(f"shift is {shift}; give a finite number of seconds")
        self.signals: Signals = read(source, time=time, columns=columns, units=units)
        self.times: Array = self.signals.time + float(shift)
        self.after: After = after
        for signal in self.signals.columns:
            signal.values.flags.writeable = False  # they are start values, which `set` replaces
        linear = _linear(self.signals, interpolation)
        variables = {s.name: _variable(i, s, s.name in linear) for i, s in enumerate(self.signals.columns)}
        self._linear = frozenset(linear)
        self._read = self._values = np.column_stack([s.values for s in self.signals.columns])
        shortest = float(np.diff(self.times).min())
        self._valid_from = self.times - _EARLY * shortest
        last = float(self.times[-1] - self.times[-2])
        self.end = np.inf if after == "hold" else float(self.times[-1]) + last * (1 + _EQUAL)
        self._now = np.zeros(1)
        self._name = self.signals.name
        self.description = Description(
            name="Table",
            variables=variables,
            kind="discrete",
            default_step=_step(self.times),
            can_save=True,
            native=True,
            dependencies={n: frozenset() for n in variables},
        )
        self._column = {v: i for i, v in enumerate(variables.values())}

    def clone(self) -> Table:
        """Another component that plays the same signals."""
        other = copy.copy(self)
        other._now = np.zeros(1)
        return other

    # What the master calls.

    def instantiate(self, name: str) -> None:
        self._name = name
        self._now[0] = self.times[0]
        self._values = self._read

    def set(self, values: Mapping[Variable, Any]) -> None:
        """Samples (rows,) of columns."""
        self._values = self._values.copy()
        for variable, samples in values.items():
            self._values[:, self._column[variable]] = samples

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        """Values at the time of its last step."""
        found = np.empty(len(variables))
        _Sampler(self, variables, found).sample(float(self._now[0]))
        return [float(x) for x in found]

    def enter_initialization(self, start: float, stop: float | None) -> None:
        """Refuses a run that is not within the table."""
        self._now[0] = start
        if start < self._valid_from[0]:
            raise TableError(
                f"'{self._name}': {self.signals.name} begins at t = {self.times[0]:.9g} s, the run at {start:.9g} s;"
                f" begin it there{surface.hint(' (start_time=...)')}, or move the table by {start - self.times[0]:.9g}"
                f" s{surface.hint(' (shift=...)')}"
            )
        if start > self.end or (stop is not None and stop > self.end):
            raise TableError(
                f"'{self._name}': {self._ends()}, the run at {max(start, stop or start):.9g} s; {_remedy()}"
            )

    def exit_initialization(self) -> None: ...

    def bind(self, inputs: Sequence[Variable], outputs: Sequence[Variable], u: Array, y: Array) -> Ports:  # noqa: ARG002
        sampler = _Sampler(self, outputs, y)
        sampler.sample(float(self._now[0]))  # other components settle to it

        def step(t: float, h: float) -> None:  # noqa: ARG001
            if not t <= self.end:
                self._failed()
            self._now[0] = t

        ports = Ports.of(lambda: None, step, lambda: sampler.sample(float(self._now[0])))
        calls = sampler.calls(library(), self._failed)
        return Ports(ports.set_inputs, ports.step, ports.get_outputs, ports.run, calls)

    def save(self) -> Any:
        return float(self._now[0])

    def restore(self, state: Any) -> None:
        self._now[0] = state

    def forget(self, state: Any) -> None: ...

    def identity(self) -> Mapping[str, str]:
        """Another table, or the same file with other contents, would not continue with bit-identical values."""
        declared = [
            f"{v.name} [{v.unit_name}] {v.type} {v.name in self._linear}" for v in self.description.variables.values()
        ]
        digest = hashlib.sha256(self.times.tobytes() + self._values.tobytes()).hexdigest()
        return {"class": "Table", "list of columns": "; ".join(declared), "table": f"{self.after} {digest}"}

    def pack(self, state: Any) -> bytes:
        return struct.pack("<d", state)

    def unpack(self, data: bytes) -> None:
        try:
            (now,) = struct.unpack("<d", data)
        except struct.error:
            raise CosimError(f"the state of '{self._name}' is not a state of a table") from None
        self._now[0] = now

    def sampled_states(self) -> dict[str, float]:
        """None: what it shows depends on the time alone."""
        return {}

    def set_sampled_states(self, x: Array) -> None: ...

    def terminate(self) -> None: ...

    def close(self) -> None: ...

    def _failed(self) -> None:
        raise CallFailed(self._name, "step", 3, f"{self._ends()}; {_remedy()}")

    def _ends(self) -> str:
        return f"{self.signals.name} ends at t = {self.times[-1]:.9g} s"


def _remedy() -> str:
    given = surface.hint("after='hold'", "--hold-input")
    return f"{given} keeps its last values" if given else "give a longer file, or end the run earlier"


class _Sampler:
    """Some outputs at a time, into a buffer: the specification of `table.c`, whose operations these are."""

    def __init__(self, table: Table, outputs: Sequence[Variable], y: Array):
        self._table, self._y = table, y
        self._columns = np.array([table._column[v] for v in outputs], dtype=np.uint32)
        linear = np.array([v.name in table._linear for v in outputs], dtype=bool)
        self._linear, self._held = np.flatnonzero(linear), np.flatnonzero(~linear)

    def sample(self, t: float) -> None:
        table, y, columns = self._table, self._y, self._columns
        row = max(0, int(np.searchsorted(table._valid_from, t, "right")) - 1)
        a = table._values[row]
        y[self._held] = a[columns[self._held]]
        at = columns[self._linear]
        if row + 1 < len(table.times):
            b, times = table._values[row + 1], table.times
            w = max(0.0, (t - times[row]) / (times[row + 1] - times[row]))
            y[self._linear] = a[at] + w * (b[at] - a[at])
        else:
            y[self._linear] = a[at]

    def calls(self, compiled: Any, failed: Callable[[], None]) -> FmiCalls:
        """The same as a function of C, for the engine."""
        ffi, table = interface(), self._table
        order = np.concatenate([self._linear, self._held])
        keep = {
            "columns": np.ascontiguousarray(self._columns[order]),
            "places": order.astype(np.uint32),
            "values": np.ascontiguousarray(table._values),
            "times": table.times,
            "valid_from": table._valid_from,
        }
        c = ffi.new("Table*")
        for name in ("times", "valid_from", "values"):
            setattr(c, name, ffi.cast("double*", keep[name].ctypes.data))
        c.columns, c.places = (ffi.cast("uint32_t*", keep[n].ctypes.data) for n in ("columns", "places"))
        c.rows, c.width = table._values.shape
        c.end, c.y, c.n, c.n_linear = table.end, ffi.cast("double*", self._y.ctypes.data), len(order), len(self._linear)
        c.now = ffi.cast("double*", table._now.ctypes.data)
        address = int(ffi.cast("uintptr_t", ffi.addressof(compiled, "cosim_table_step")))
        return _Calls(
            version=2,
            instance=int(ffi.cast("uintptr_t", c)),
            do_step=address,
            sets=(),
            gets=(),
            flags=0,
            last=0,
            no_set_prior=lambda: False,
            call_failed=lambda function, status: None,
            step_failed=lambda status, t, h: failed(),
            keep=(c, keep, self._y),
        )


@dataclass(frozen=True)
class _Calls(FmiCalls):
    keep: Any = field(default=None, repr=False)  # what the addresses point to


def _linear(signals: Signals, interpolation: Interpolation | Mapping[str, Interpolation]) -> list[str]:
    """Names of the columns that are linear between rows."""
    names = [s.name for s in signals.columns]
    chosen = interpolation if isinstance(interpolation, Mapping) else dict.fromkeys(names, interpolation)
    for name, how in chosen.items():
        if name not in names:
            raise TableError(f"{signals.name}: no column '{name}'{did_you_mean(name, names)} to be interpolated")
        if how not in ("linear", "held"):
            raise TableError(unknown("interpolation", how, ("linear", "held")))
        signal = signals.columns[names.index(name)]
        if isinstance(interpolation, Mapping) and how == "linear" and signal.type == "boolean":
            raise TableError(f"{signals.name}: the column '{name}' holds Booleans, which are held")
    return [s.name for s in signals.columns if chosen.get(s.name, "linear") == "linear" and s.type != "boolean"]


def _variable(number: int, signal: Signal, linear: bool) -> Variable:
    kind = "real" if linear else "integer" if signal.type == "whole" else signal.type
    return Variable(
        signal.name,
        kind,
        _FMI_TYPES[kind],
        causality="output",
        variability="continuous" if kind == "real" else "discrete",
        initial="exact" if kind == "real" else None,
        start=signal.values if kind == "real" else None,
        samples=len(signal.values) if kind == "real" else 0,
        unit=signal.unit,
        reference=number,
        declared=signal.name,
    )


def _step(times: Array) -> Fraction:
    """A millisecond, or the interval of the rows where that is shorter and always the same."""
    intervals = np.diff(times)
    mean = float(times[-1] - times[0]) / len(intervals)
    if mean < DEFAULT_STEP and np.all(np.abs(intervals - mean) <= _EQUAL * mean + 4 * np.spacing(abs(times[1:]))):
        return Fraction(mean).limit_denominator(10**7) or DEFAULT_STEP
    return DEFAULT_STEP
