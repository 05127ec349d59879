"""One Python face for the C interface of an FMU, FMI 2.0 and FMI 3.0 alike.

`Model` is what a model description says, `Library` a loaded FMU, `Instance` an instance of it.
`Instance.call` passes anything to any function and returns the status; the other methods wrap it for the usual cases
and raise `CallFailed` with the FMU's own message. Values are read and written by variable name.
"""

from __future__ import annotations

import csv
import ctypes as c
import io
import re
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

OK, WARNING, DISCARD, ERROR, FATAL = range(5)
TYPES2 = {"Real": c.c_double, "Integer": c.c_int, "Boolean": c.c_int, "String": c.c_char_p}
TYPES3 = {"Float64": c.c_double, "Int32": c.c_int32, "Boolean": c.c_bool, "String": c.c_char_p}
_KINDS = {"Real": "real", "Float64": "real", "Integer": "integer", "Int32": "integer", "Boolean": "boolean"}
LOGGER2 = c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p)
LOGGER3 = c.CFUNCTYPE(None, c.c_void_p, c.c_int, c.c_char_p, c.c_char_p)


class Callbacks2(c.Structure):
    """`fmi2CallbackFunctions`."""

    _fields_ = (
        ("logger", LOGGER2),
        ("allocate", c.c_void_p),
        ("free", c.c_void_p),
        ("finished", c.c_void_p),
        ("environment", c.c_void_p),
    )


class CallFailed(Exception):  # noqa: N818 (reads as what happened)
    """A call that returned neither OK nor Warning."""


@dataclass(frozen=True)
class Variable:
    """One variable of the model description."""

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    initial: str | None
    start: str | None
    min: float | None
    max: float | None
    derivative: str | None  # index (FMI 2.0) or value reference (FMI 3.0) of the state
    nominal: float | None = None
    unit: str | None = None

    @property
    def kind(self) -> str:
        """`real`, `integer` or `boolean`."""
        return _KINDS[self.type]

    @property
    def start_value(self) -> float | None:
        """Start value as a number."""
        if self.start is None:
            return None
        return float(self.start == "true") if self.kind == "boolean" else float(self.start)


class Model:
    """What the model description of an FMU says."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with zipfile.ZipFile(path) as z:
            self.xml = etree.fromstring(z.read("modelDescription.xml"))
        self.fmi = int(self.xml.get("fmiVersion")[0])
        self.name: str = self.xml.get("modelName")
        self.token: str = self.xml.get("guid" if self.fmi == 2 else "instantiationToken")
        self.variables = {v.name: v for v in self._read_variables()}
        self.order = list(self.variables)
        self.by_reference = {v.reference: v for v in self.variables.values()}
        experiment = self.xml.find("DefaultExperiment")
        self.step = float(experiment.get("stepSize"))
        component = self.xml.find(".//Component[@kind]")
        self.kind: str = component.get("kind")
        self.is_continuous = self.kind == "continuous"

    def __repr__(self) -> str:
        return f"{self.name}-fmi{self.fmi}"

    def _read_variables(self) -> Iterable[Variable]:
        for element in self.xml.find("ModelVariables"):
            typed = element[0] if self.fmi == 2 else element
            low, high, nominal = (typed.get(k) for k in ("min", "max", "nominal"))
            yield Variable(
                element.get("name"),
                int(element.get("valueReference")),
                typed.tag,
                element.get("causality"),
                element.get("variability"),
                element.get("initial"),
                typed.get("start"),
                None if low is None else float(low),
                None if high is None else float(high),
                typed.get("derivative"),
                None if nominal is None else float(nominal),
                typed.get("unit"),
            )

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
        return [self._state_of(d) for d in self.derivatives]

    @cached_property
    def derivatives(self) -> list[str]:
        return list(self.structure("Derivatives", "ContinuousStateDerivative"))

    def _state_of(self, derivative: str) -> str:
        key = int(self.variables[derivative].derivative or 0)
        return self.order[key - 1] if self.fmi == 2 else self.by_reference[key].name

    def structure(self, tag2: str, tag3: str) -> dict[str, list[str]]:
        """Unknowns of one group of the model structure with the names they depend on."""
        if self.fmi == 2:
            group = self.xml.find(f"ModelStructure/{tag2}")
            return {
                self.order[int(e.get("index")) - 1]: [
                    self.order[int(i) - 1] for i in (e.get("dependencies") or "").split()
                ]
                for e in (group if group is not None else ())
            }
        return {
            self.by_reference[int(e.get("valueReference"))].name: [
                self.by_reference[int(i)].name for i in (e.get("dependencies") or "").split()
            ]
            for e in self.xml.findall(f"ModelStructure/{tag3}")
        }


class Library(Model):
    """An FMU, unpacked and loaded once.

    `resources`: the resource path that instances get; None by default, since most need none.
    """

    resources: bytes | None = None

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._folder = tempfile.TemporaryDirectory(prefix="conformance-")
        self.folder = Path(self._folder.name)
        with zipfile.ZipFile(path) as z:
            z.extractall(self.folder)
        self.binary = next(p for p in self.folder.glob("binaries/*/*") if p.suffix in (".so", ".dll", ".dylib"))
        self.dll = c.CDLL(str(self.binary))
        self.types: dict[str, Any] = TYPES2 if self.fmi == 2 else TYPES3
        self.real = "Real" if self.fmi == 2 else "Float64"
        self.state_type = "FMUstate" if self.fmi == 2 else "FMUState"
        for function in (
            "Instantiate",
            "InstantiateModelExchange",
            "InstantiateCoSimulation",
            "InstantiateScheduledExecution",
        ):
            if hasattr(self.dll, f"fmi{self.fmi}{function}"):
                getattr(self.dll, f"fmi{self.fmi}{function}").restype = c.c_void_p
        for function in ("GetVersion", "GetTypesPlatform"):
            if hasattr(self.dll, f"fmi{self.fmi}{function}"):
                getattr(self.dll, f"fmi{self.fmi}{function}").restype = c.c_char_p

    def documentation_csv(self, what: str) -> Signals:
        """`NAME_in.csv` or `NAME_ref.csv` of the documentation."""
        return Signals.read((self.folder / "documentation" / f"{self.name}_{what}.csv").read_text())

    @cached_property
    def stimulus(self) -> Signals:
        """Inputs of the reference result."""
        return self.documentation_csv("in")

    def instance(self, kind: str = "cs", *, logging: bool = True) -> Instance:
        """A new instance for Co-Simulation (`"cs"`) or Model Exchange (`"me"`)."""
        return Instance(self, kind, logging=logging)


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


class Instance:
    """An instance of an FMU; `messages` holds (status, category, text) of everything it logged."""

    def __init__(
        self,
        library: Library,
        kind: str = "cs",
        *,
        token: str | None = None,
        name: str = "x",
        logging: bool = True,
        logger: bool = True,
    ) -> None:
        self.library, self.fmi, self.kind = library, library.fmi, kind
        self.messages: list[tuple[int, str, str]] = []
        self.time = 0.0
        token_bytes = (library.token if token is None else token).encode()
        if self.fmi == 2:
            self._logger: Any = LOGGER2(self._log2) if logger else LOGGER2()
            self._callbacks = Callbacks2(self._logger, None, None, None, None)
            handle = self.raw(
                "Instantiate",
                name.encode(),
                1 if kind == "cs" else 0,
                token_bytes,
                library.resources or b"",
                c.byref(self._callbacks),
                0,
                int(logging),
            )
        else:
            self._logger = LOGGER3(self._log3) if logger else LOGGER3()
            tail = (None, self._logger, None) if kind == "cs" else (None, self._logger)
            flags = (False, c.c_bool(logging), False, False, None, c.c_size_t(0)) if kind == "cs" else (False, logging)
            handle = self.raw(
                f"Instantiate{'CoSimulation' if kind == 'cs' else 'ModelExchange'}",
                name.encode(),
                token_bytes,
                library.resources,
                *flags,
                *tail,
            )
        self.handle = c.c_void_p(handle) if handle else None
        self._references: dict[tuple[str, ...], list[tuple[Any, ...]]] = {}

    def _log2(self, _: Any, __: bytes, status: int, category: bytes, message: bytes) -> None:
        self.messages.append((status, category.decode(), message.decode().replace("%%", "%")))

    def _log3(self, _: Any, status: int, category: bytes, message: bytes) -> None:
        self.messages.append((status, category.decode(), message.decode()))

    # ------------------------------------------------------------------ calls

    def raw(self, function: str, *arguments: Any) -> Any:
        """Call `fmi<n><function>` as it is."""
        return getattr(self.library.dll, f"fmi{self.fmi}{function}")(*arguments)

    def call(self, function: str, *arguments: Any) -> int:
        """Call on this instance; Python floats pass as double, ints as int."""
        passed = [
            c.c_double(a) if isinstance(a, float) else c.c_bool(a) if isinstance(a, bool) else a for a in arguments
        ]
        return int(self.raw(function, self.handle, *passed))

    def must(self, function: str, *arguments: Any) -> None:
        """Call that has to succeed."""
        status = self.call(function, *arguments)
        if status > WARNING:
            raise CallFailed(f"{function}: status {status}: {self.last_message}")

    @property
    def last_message(self) -> str:
        """Text of the latest message."""
        return self.messages[-1][2] if self.messages else ""

    # ------------------------------------------------------------------ life cycle

    def enter_initialization(self, start: float = 0.0, stop: float | None = None) -> int:
        """`SetupExperiment` where there is one, then `EnterInitializationMode`; the first bad status."""
        self.time = start
        setup = (self.flag(False), 0.0, start, self.flag(stop is not None), stop or 0.0)
        if self.fmi == 2:
            status = self.call("SetupExperiment", *setup)
            return self.call("EnterInitializationMode") if status <= WARNING else status
        return self.call("EnterInitializationMode", *setup)

    def initialize(
        self, values: Mapping[str, float] | None = None, start: float = 0.0, stop: float | None = None
    ) -> Instance:
        """Set start values, go through initialization mode. Returns itself."""
        if values:
            self.set(values)
        if self.enter_initialization(start, stop) > WARNING:
            raise CallFailed(self.last_message)
        self.must("ExitInitializationMode")
        return self

    def continuous_time(self) -> Instance:
        """From event mode to continuous-time mode. Returns itself."""
        self.must("EnterContinuousTimeMode")
        return self

    def reset(self) -> None:
        self.must("Reset")

    def free(self) -> None:
        self.raw("FreeInstance", self.handle)
        self.handle = None

    def __enter__(self) -> Instance:
        return self

    def __exit__(self, *_: object) -> None:
        self.free()

    def flag(self, value: bool) -> Any:
        """A Boolean argument of this FMI version."""
        return c.c_int(value) if self.fmi == 2 else c.c_bool(value)

    # ------------------------------------------------------------------ values

    def array(self, kind: str, values: Iterable[Any]) -> Any:
        """A C array of one of the FMI types."""
        data = list(values)
        element = self.library.types[kind]
        return (element * len(data))(*(data if element is c.c_double else map(int, data)))

    @staticmethod
    def references(references: Iterable[int]) -> Any:
        """A C array of value references."""
        data = list(references)
        return (c.c_uint32 * len(data))(*data)

    def access(self, direction: str, kind: str, references: Iterable[int], values: Any) -> int:
        """`Get` or `Set` by value reference and FMI type; the status."""
        refs = self.references(references)
        count = () if self.fmi == 2 else (c.c_size_t(len(values)),)
        return self.call(f"{direction}{kind}", refs, c.c_size_t(len(refs)), values, *count)

    def try_set(self, values: Mapping[str, float]) -> int:
        """Set variables by name, one call per type; the first status that is not OK."""
        groups: dict[str, dict[int, float]] = {}
        for name, value in values.items():
            v = self.library.variables[name]
            groups.setdefault(v.type, {})[v.reference] = value
        for kind, group in groups.items():
            status = self.access("Set", kind, group, self.array(kind, group.values()))
            if status > WARNING:
                return status
        return OK

    def set(self, values: Mapping[str, float]) -> None:
        """Set variables by name."""
        status = self.try_set(values)
        if status > WARNING:
            raise CallFailed(f"Set: status {status}: {self.last_message}")

    def get(self, names: Iterable[str]) -> np.ndarray:
        """Values of variables by name, all as float."""
        key = tuple(names)
        if key not in self._references:
            groups: dict[str, list[int]] = {}
            for i, n in enumerate(key):
                groups.setdefault(self.library.variables[n].type, []).append(i)
            self._references[key] = [
                (
                    kind,
                    at,
                    [self.library.variables[key[i]].reference for i in at],
                    (self.library.types[kind] * len(at))(),
                )
                for kind, at in groups.items()
            ]
        out = np.empty(len(key))
        for kind, at, refs, buffer in self._references[key]:
            if self.access("Get", kind, refs, buffer) > WARNING:
                raise CallFailed(f"Get: {self.last_message}")
            out[at] = buffer[:]
        return out

    # ------------------------------------------------------------------ time

    def do_step(self, time: float, step: float) -> int:
        """`DoStep`; the status."""
        tail: tuple[Any, ...] = (self.flag(True),)
        if self.fmi == 3:
            flags = (c.c_bool * 3)()
            last = c.c_double()
            at = c.sizeof(c.c_bool)
            tail += (c.byref(flags), c.byref(flags, at), c.byref(flags, 2 * at), c.byref(last))
        return self.call("DoStep", time, step, *tail)

    def step(self, step: float) -> None:
        """Advance by `step` from where it is."""
        status = self.do_step(self.time, step)
        if status > WARNING:
            raise CallFailed(f"DoStep at {self.time}: status {status}: {self.last_message}")
        self.time += step

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
            status = self.do_step(k * h, h)
            if status > WARNING:
                raise CallFailed(f"DoStep {k}: {self.last_message}")
            self.time = (k + 1) * h
            out.append(self.get(self.library.outputs))
        return np.array(out)

    # ------------------------------------------------------------------ state

    def save(self) -> Any:
        """An FMU state."""
        state = c.c_void_p()
        self.must(f"Get{self.library.state_type}", c.byref(state))
        return state

    def restore(self, state: Any) -> None:
        self.must(f"Set{self.library.state_type}", state)

    def free_state(self, state: Any) -> None:
        self.must(f"Free{self.library.state_type}", c.byref(state))

    def serialize(self, state: Any = None) -> bytes:
        """The given state (or the present one) as bytes."""
        own = state is None
        state = self.save() if own else state
        size = c.c_size_t()
        self.must(f"Serialized{self.library.state_type}Size", state, c.byref(size))
        data = c.create_string_buffer(size.value)
        self.must(f"Serialize{self.library.state_type}", state, data, size)
        if own:
            self.free_state(state)
        return data.raw

    def try_deserialize(self, data: bytes) -> tuple[int, Any]:
        """Status and FMU state of serialized bytes."""
        state = c.c_void_p()
        name = "DeSerialize" if self.fmi == 2 else "Deserialize"
        status = self.call(f"{name}{self.library.state_type}", data, c.c_size_t(len(data)), c.byref(state))
        return status, state

    def deserialize(self, data: bytes) -> None:
        """Continue from serialized bytes."""
        status, state = self.try_deserialize(data)
        if status > WARNING:
            raise CallFailed(self.last_message)
        self.restore(state)
        self.free_state(state)

    # ------------------------------------------------------------------ derivatives

    def try_directional(self, unknowns: list[str], knowns: list[str], seed: Iterable[float]) -> tuple[int, np.ndarray]:
        """Status and sensitivities of `unknowns` for `seed` of `knowns`."""
        z, v = (self.references(self.library.variables[n].reference for n in names) for names in (unknowns, knowns))
        dv, dz = (c.c_double * len(knowns))(*seed), (c.c_double * len(unknowns))()
        nz, nv = c.c_size_t(len(unknowns)), c.c_size_t(len(knowns))
        arguments = (z, nz, v, nv, dv, dz) if self.fmi == 2 else (z, nz, v, nv, dv, nv, dz, nz)
        return self.call("GetDirectionalDerivative", *arguments), np.array(dz[:])

    def column(self, unknowns: list[str], known: str) -> np.ndarray:
        """One column of the Jacobian."""
        status, values = self.try_directional(unknowns, [known], [1.0])
        if status > WARNING:
            raise CallFailed(self.last_message)
        return values

    # ------------------------------------------------------------------ model exchange

    def set_states(self, x: Iterable[float]) -> None:
        data = self.array(self.library.real, x)
        self.must("SetContinuousStates", data, c.c_size_t(len(data)))

    def get_states(self) -> np.ndarray:
        data = (c.c_double * len(self.library.states))()
        self.must("GetContinuousStates", data, c.c_size_t(len(data)))
        return np.array(data[:])

    def get_derivatives(self) -> np.ndarray:
        data = (c.c_double * len(self.library.states))()
        name = "GetDerivatives" if self.fmi == 2 else "GetContinuousStateDerivatives"
        self.must(name, data, c.c_size_t(len(data)))
        return np.array(data[:])


def structured_name(name: str) -> bool:
    """Whether a name follows the structured naming of the standard (without quoted names)."""
    part = r"[A-Za-z_][A-Za-z_0-9]*(\[[0-9]+(,[0-9]+)*\])?"
    identifier = rf"{part}(\.{part})*"
    return re.fullmatch(rf"{identifier}|der\({identifier}(,[0-9]+)?\)", name) is not None
