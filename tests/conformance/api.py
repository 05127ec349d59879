"""FMUs as the tests of this folder call them: those of `cosim check`, with variables by their names.

`Model` is what a model description says, `Library` a loaded FMU, `Instance` an instance of it. `Instance.call` passes
anything to any function and returns the status; what has to succeed raises `Refused` with the FMU's own message.
"""

from __future__ import annotations

import csv
import io
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from lxml import etree

from cosim.check import calls
from cosim.check.calls import Refused
from cosim.check.model import Var, read
from cosim.fmu import calls as fmi
from cosim.fmu.calls import DISCARD, ERROR, OK, WARNING

__all__ = ["DISCARD", "ERROR", "OK", "WARNING", "Instance", "Library", "Model", "Refused", "Signals", "Variable"]
NEVER = {
    2: ("CancelStep", "SetRealInputDerivatives", "GetRealOutputDerivatives"),
    3: (
        *("GetClock", "SetClock", "ActivateModelPartition", "EvaluateDiscreteStates", "EnterStepMode"),
        *(
            f"{what}{unit}"
            for what in ("GetInterval", "GetShift", "SetInterval", "SetShift")
            for unit in ("Decimal", "Fraction")
        ),
        *("EnterConfigurationMode", "ExitConfigurationMode", "GetOutputDerivatives"),
        *("GetNumberOfVariableDependencies", "GetVariableDependencies"),
    ),
}
"""Functions that no FMU of this project provides: called with an instance alone, they return Error."""
UNPROVIDED = cffi.FFI()
"""Types of these, and of functions that `cosim check` does not call."""
UNPROVIDED.cdef("".join(f"int fmi{version}{name}(void*);" for version, names in NEVER.items() for name in names))
UNPROVIDED.cdef("""
int fmi2GetStatus(void*, int, int*);
int fmi2GetIntegerStatus(void*, int, int*);
void* fmi3InstantiateScheduledExecution(const char*, const char*, const char*, bool, bool, void*, void*, void*, void*,
                                        void*);
""")
_KINDS = {"Real": "real", "Float64": "real", "Integer": "integer", "Int32": "integer", "Boolean": "boolean"}


class Variable:
    """A variable as `cosim check` reads it; `initial` as it is written, no default."""

    def __init__(self, said: Var) -> None:
        self._said = said
        self.__dict__.update(vars(said))  # most accesses are to these; __getattr__ would be slow
        self.kind = _KINDS[said.type]
        self.initial = said.says.get("initial")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._said, name)

    @property
    def start_value(self) -> float | None:
        """Start value as a number."""
        starts = self._said.starts()
        return None if starts is None else float(starts[0])


class Model:
    """What the model description of an FMU says."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with zipfile.ZipFile(path) as z:
            self.xml = etree.fromstring(z.read("modelDescription.xml"))
        self.said = said = read(self.xml)
        self.fmi, self.name, self.token, self.step = int(said.version), said.name, said.token, said.step
        self.variables = {v.name: Variable(v) for v in said.variables}
        self.order = list(self.variables)
        self.is_continuous = self.xml.find(".//Component[@kind]").get("kind") == "continuous"

    def names(self, causality: str, kind: str | None = None) -> list[str]:
        """Names of the variables of one causality (and kind of value)."""
        return [v.name for v in self.variables.values() if v.causality == causality and kind in (None, v.kind)]

    @cached_property
    def inputs(self) -> list[str]:
        return self.names("input")

    @cached_property
    def outputs(self) -> list[str]:
        return self.names("output")

    @cached_property
    def states(self) -> list[str]:
        """Continuous states in the order of their derivatives in the model structure."""
        return [v.name for v in self.said.states]

    @cached_property
    def derivatives(self) -> list[str]:
        return list(self.structure("Derivative"))

    def structure(self, group: str) -> dict[str, list[str]]:
        """Unknowns of one group of the model structure with the names they depend on."""
        by_key = self.said.by_key
        return {
            by_key[u.key].name: [by_key[k].name for k in u.depends or ()]
            for u in self.said.structure
            if u.group == group
        }


class Library(Model):
    """An FMU, unpacked and loaded once.

    `resources`: the resource path for those who instantiate it themselves; None by default, since most need none.
    """

    resources: bytes | None = None

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._folder = tempfile.TemporaryDirectory(prefix="conformance-")
        self.folder = Path(self._folder.name)
        with zipfile.ZipFile(path) as z:
            z.extractall(self.folder)
        binary = next(p for p in self.folder.glob("binaries/*/*") if p.suffix in (".so", ".dll", ".dylib"))
        self.readings: dict[tuple[str, ...], list[Any]] = {}
        self.loaded = calls.Fmu(self.said, self.folder, dict.fromkeys(("cs", "me"), binary))
        self.real = "Real" if self.fmi == 2 else "Float64"
        self.unprovided = UNPROVIDED.dlopen(str(binary))

    def documentation_csv(self, what: str) -> Signals:
        """`NAME_in.csv` or `NAME_ref.csv` of the documentation."""
        return Signals.read((self.folder / "documentation" / f"{self.name}_{what}.csv").read_text())

    @cached_property
    def stimulus(self) -> Signals:
        """Inputs of the reference result."""
        return self.documentation_csv("in")

    def instance(self, kind: str = "cs", **options: Any) -> Instance:
        """A new instance for Co-Simulation (`"cs"`) or Model Exchange (`"me"`)."""
        return Instance(self, kind, **options)


@dataclass(frozen=True)
class Signals:
    """Columns by name over `time`."""

    time: np.ndarray
    values: np.ndarray
    names: list[str]

    @classmethod
    def read(cls, text: str) -> Signals:
        """From CSV with a header row that starts with `time`."""
        rows = list(csv.reader(io.StringIO(text)))
        table = np.array(rows[1:], dtype=float)
        return cls(table[:, 0], table[:, 1:], rows[0][1:])

    def row(self, k: int) -> dict[str, float]:
        """Values of one row by name."""
        return dict(zip(self.names, self.values[min(k, len(self.values) - 1)], strict=True))


class Instance(calls.Instance):
    """An instance of an FMU; `messages` holds (status, category, text) of everything it logged.

    `logger`: whether it gets a function to log with.
    """

    def __init__(self, library: Library, kind: str = "cs", *, logger: bool = True, **options: Any) -> None:
        self.library, self.fmi = library, library.fmi
        self._has_logger = logger
        super().__init__(library.loaded, kind, **options)

    def _instantiate(self, name: str, token: str, logging: bool) -> Any:
        if self._has_logger:
            return super()._instantiate(name, token, logging)
        ffi, process = self.ffi, fmi.c_library()
        self._keep = [ffi.NULL]
        if self.fmi == 2:
            callbacks = ffi.new("Callbacks*")
            callbacks.allocate = ffi.cast("void*", ffi.addressof(process, "calloc"))
            callbacks.release = ffi.cast("void*", ffi.addressof(process, "free"))
            self._keep.append(callbacks)
        return self.maker(name.encode(), token.encode(), interface=int(self.kind == "cs"))()

    def raw(self, function: str) -> Any:
        return getattr(self.library.unprovided, f"fmi{self.fmi}{function}", None) or super().raw(function)

    def _log(self, status: int, category: str, message: str) -> None:  # type: ignore[override]
        self.messages.append((status, category, message))

    @property
    def logger(self) -> Any:
        """Its logger as a pointer."""
        return self.ffi.cast("void*", self._keep[0])

    def maker(
        self,
        name: bytes | None = b"x",
        token: bytes | None = b"",
        *,
        interface: int = 1,
        events: bool = False,
        bare: bool = False,
    ) -> Callable[[], Any]:
        """Makes another instance, or None, with any arguments; in FMI 2.0 `bare` without callbacks."""
        given = self.library.token.encode() if token == b"" else token
        place, cs = self.library.resources, interface == 1
        if self.fmi == 2:
            function = self.raw("Instantiate")
            callbacks = None if bare else self._keep[1]
            arguments: tuple[Any, ...] = (name, interface, given, place or b"", callbacks, 0, 0)
        else:
            function = self.raw("InstantiateCoSimulation" if cs else "InstantiateModelExchange")
            flags = (False, False, *((events, False, None, 0) if cs else ()))
            arguments = (name, given, place, *flags, None, self.logger, *((None,) if cs else ()))
        passed = [self.ffi.NULL if x is None else x for x in arguments]
        return lambda: function(*passed) or None

    @property
    def last_message(self) -> str:
        """Text of the latest message."""
        return self.messages[-1][2] if self.messages else ""

    def said(self, since: int = 0) -> str:  # noqa: ARG002
        return self.last_message

    def try_enter(self, start: float = 0.0, stop: float | None = None) -> int:
        """`SetupExperiment` where there is one, then `EnterInitializationMode`; the first bad status."""
        self.time = start
        setup = (False, 0.0, start, stop is not None, stop or 0.0)
        if self.fmi == 2:
            status = self.call("SetupExperiment", *setup)
            return self.call("EnterInitializationMode") if status <= WARNING else status
        return self.call("EnterInitializationMode", *setup)

    def initialize(  # type: ignore[override]
        self, values: Mapping[str, float] | None = None, start: float = 0.0, stop: float | None = None
    ) -> Instance:
        """Set start values, go through initialization mode. Returns itself."""
        self.set(values or {})
        if (status := self.try_enter(start, stop)) > WARNING:
            raise Refused("EnterInitializationMode", status, self.last_message, self.where)
        self.must("ExitInitializationMode")
        return self

    def continuous_time(self) -> Instance:
        """From event mode to continuous-time mode. Returns itself."""
        self.must("EnterContinuousTimeMode")
        return self

    # ------------------------------------------------------------------ values

    def array(self, kind: str, values: Iterable[Any]) -> Any:
        """A C array of one of the FMI types."""
        return self._buffer(kind, list(values))

    def numbers(self, references: Iterable[int]) -> Any:
        """A C array of value references."""
        return self.ffi.new("VR[]", list(references))

    def access(self, direction: str, kind: str, references: Iterable[int], values: Any) -> int:
        """`Get` or `Set` by value reference and FMI type; the status."""
        refs = self.numbers(references)
        return self.transfer(f"{direction}{kind}", refs, len(refs), values, len(values))

    def try_set(self, values: Mapping[str, float]) -> int:
        """Set variables by name, one call per type; the first status that is not OK."""
        given = {self.library.variables[n]: x for n, x in values.items()}
        for kind, group in self.fmu.groups(given).items():
            if (status := self.set_raw(kind, group, [given[v] for v in group])) > WARNING:
                return status
        return OK

    def set(self, values: Mapping[str, float]) -> None:  # type: ignore[override]
        """Set variables by name."""
        super().set({self.library.variables[n]: [x] for n, x in values.items()})

    def get(self, names: Iterable[str]) -> np.ndarray:  # type: ignore[override]
        """Values of variables by name, all as float, of an array its first element.

        Groups are found once: derivatives of large FMUs are compared with thousands of readings.
        """
        names = tuple(names)
        if names not in self.library.readings:
            variables = [self.library.variables[n] for n in names]
            kinds = dict.fromkeys(v.access for v in variables)
            places = {kind: [i for i, v in enumerate(variables) if v.access == kind] for kind in kinds}
            self.library.readings[names] = [
                (kind, at, [0, *np.cumsum([variables[i].size for i in at[:-1]])], [variables[i] for i in at])
                for kind, at in places.items()
            ]
        values = np.empty(len(names))
        for kind, at, starts, group in self.library.readings[names]:
            before = len(self.messages)
            status, buffer = self.get_raw(kind, group)
            self._demand(f"Get{kind}", status, before)
            values[at] = np.array(self._values(kind, buffer))[starts]
        return values

    # ------------------------------------------------------------------ time

    def do_step(self, time: float, step: float) -> int:
        """`DoStep`; the status."""
        return self._do_step(time, step) if self.fmi == 3 else super().do_step(time, step)

    def run(
        self, steps: int, stimulus: Signals | None = None, *, first: int = 0, step: float | None = None
    ) -> np.ndarray:
        """Outputs after each of `steps` communication steps, inputs from rows `first`... of `stimulus`."""
        stimulus = self.library.stimulus if stimulus is None else stimulus
        h = step or self.library.step
        out = []
        for k in range(first, first + steps):
            if stimulus.names:
                self.set(stimulus.row(k))
            if (status := self.do_step(k * h, h)) > WARNING:
                raise Refused("DoStep", status, self.last_message, self.where)
            self.time = (k + 1) * h
            out.append(self.get(self.library.outputs))
        return np.array(out)

    # ------------------------------------------------------------------ state

    def save(self) -> Any:
        """An FMU state, which the caller frees."""
        state = super().save()
        self._saved.remove(state)
        return state

    def free_state(self, state: Any) -> None:
        self.must("FreeFMUState", state)

    def serialize(self, state: Any = None) -> bytes:
        """The given state (or the present one) as bytes."""
        own = self.save() if state is None else None
        data = super().serialize(state or own)
        if own is not None:
            self.free_state(own)
        return data

    def try_deserialize(self, data: bytes) -> tuple[int, Any]:
        """Status and FMU state of serialized bytes."""
        state = self.ffi.new("void**")
        return self.call("DeserializeFMUState", data, len(data), state), state

    def deserialize(self, data: bytes) -> None:
        """Continue from serialized bytes."""
        self.restore(super().deserialize(data))
        self.free_state(self._saved.pop())

    # ------------------------------------------------------------------ derivatives

    def try_directional(self, unknowns: list[str], knowns: list[str], seed: Iterable[float]) -> tuple[int, np.ndarray]:
        """Status and sensitivities of `unknowns` for `seed` of `knowns`."""
        z, v = (self.numbers(self.library.variables[n].reference for n in names) for names in (unknowns, knowns))
        dv, dz = list(seed), self.ffi.new("double[]", len(unknowns))
        nz, nv = len(unknowns), len(knowns)
        arguments = (z, nz, v, nv, dv, dz) if self.fmi == 2 else (z, nz, v, nv, dv, nv, dz, nz)
        return self.call("GetDirectionalDerivative", *arguments), np.array(list(dz))

    def column(self, unknowns: list[str], known: str) -> np.ndarray:
        """One column of the Jacobian."""
        of = self.library.variables
        return np.array(self.directional([of[n] for n in unknowns], [of[known]], [1.0]))

    def _vector(self, function: str, n: int) -> np.ndarray:  # type: ignore[override]
        return np.array(super()._vector(function, n))
