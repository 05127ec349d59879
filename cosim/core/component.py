"""What the master asks of a component: FMUs (`cosim.fmu`), pure Python components, mocks in tests."""

from __future__ import annotations

import copy
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import unknown
from build_fmus.base.units import KNOWN, Unit
from cosim.core import plain
from cosim.core.dependencies import Dependencies, by_perturbation
from cosim.core.description import Description, Variable
from cosim.core.errors import CallFailed, CosimError, WiringError
from cosim.core.signals import Array
from cosim.core.time import TimeLike, positive

Action = Callable[[], None]


@dataclass(frozen=True)
class Transfer:
    """An FMI call, bound to its arguments, that moves variables of one type.

    `data[element[i]]` belongs to `place[i]` of the master's buffer; None: `data` is a part of that buffer. `call` and
    `references` are addresses; `widths` has the number of elements of each variable, None: all have one.
    """

    function: str
    call: int
    references: int
    n_references: int
    data: npt.NDArray[Any]
    element: npt.NDArray[np.intp] | None = None
    place: npt.NDArray[np.intp] | None = None
    widths: npt.NDArray[np.uint32] | None = None


@dataclass(frozen=True)
class FmiCalls:
    """Ports of an FMU as addresses, for callers that are written in C.

    It also turns a failure of one of these calls into the exception that the ports raise.
    """

    version: int  # 2, 3
    instance: int
    do_step: int
    sets: Sequence[Transfer]
    gets: Sequence[Transfer]
    flags: int  # FMI 3.0: bool[4], event, (not used), terminate, early; 0 for FMI 2.0
    last: int  # FMI 3.0: double*, the time that a step reached
    no_set_prior: Callable[[], bool]  # noSetFMUStatePriorToCurrentPoint of the next step
    call_failed: Callable[[str, int], None]  # (function, status)
    step_failed: Callable[[int, float, float], None]  # (status, time at its begin [s], length [s])
    states: Mapping[str, int] | None = None  # fmiXGetFMUState, fmiXSetFMUState, fmiXFreeFMUState: `get`, `set`, `free`
    derivative: int = 0  # fmiXGetDirectionalDerivative, where the FMU offers it
    stepped: int = 0  # what `do_step` gets instead of the instance: its integrator
    integrated: bool = False  # `do_step` at NaN updates its discrete states alone
    foreign: bool = False  # the floating-point environment is put back after its calls
    changed: Callable[[int], None] = lambda bits: None  # says what it has changed there
    follow: Callable[[Any, Any, Any], None] | None = None
    """Gets its `EngineComponent*`, the values and the `EngineAdaptive*`: inputs follow them."""


@dataclass(frozen=True)
class Ports:
    """The three calls of one communication step, bound to the master's buffers, and `run`, the three in a row.

    Each raises CallFailed. `fmi`: the same three as FMI calls, if they are nothing else.
    """

    set_inputs: Action
    step: Callable[[float, float], None]  # (time at its begin [s], length [s])
    get_outputs: Action
    run: Callable[[float, float], None]
    fmi: FmiCalls | None = None

    @classmethod
    def of(cls, set_inputs: Action, step: Callable[[float, float], None], get_outputs: Action) -> Ports:
        """Ports from the three calls."""

        def run(t: float, h: float) -> None:
            set_inputs()
            step(t, h)
            get_outputs()

        return cls(set_inputs, step, get_outputs, run)


def is_whole(reached: float, t: float, h: float) -> bool:
    """Whether a step from t of length h [s] was taken whole if it reached the time `reached` [s]."""
    return reached >= t + h - 1e-6 * h


class Component(Protocol):
    """One instance in a system.

    Order of calls: `instantiate`, `set`, `enter_initialization`, `bind`, (ports), `exit_initialization`, (ports, save,
    restore, set, get), `terminate`; `instantiate` again resets; `close` ends.
    """

    description: Description

    def instantiate(self, name: str) -> None:
        """Bring a fresh instance, all variables at their start values; resets one that has run before."""

    def set(self, values: Mapping[Variable, Any]) -> None:
        """Set parameters, start values or inputs."""

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        """Present values."""

    def enter_initialization(self, start: float, stop: float | None) -> None:
        """Enter initialization mode at `start` [s]; `stop` [s] is the end of the simulation, if known."""

    def exit_initialization(self) -> None:
        """Leave initialization mode; the component is ready for its first step."""

    def bind(self, inputs: Sequence[Variable], outputs: Sequence[Variable], u: Array, y: Array) -> Ports:
        """Ports that read `inputs` from `u` and write `outputs` to `y`; both contiguous, one float per variable."""

    def save(self) -> Any:
        """A copy of the whole state, to be given to `restore` of the same instance."""

    def restore(self, state: Any) -> None:
        """Restore a state that `save` of the same instance returned."""

    def forget(self, state: Any) -> None:
        """Free a saved state."""

    def terminate(self) -> None:
        """End the simulation of the instance."""

    def close(self) -> None:
        """Free all resources; no other method may be called afterwards."""


@runtime_checkable
class Portable(Protocol):
    """A component whose saved states can continue in another instance of the same component, in another process too."""

    def identity(self) -> Mapping[str, str]:
        """What tells its states from those of other components: texts that must be equal, by what they say."""

    def pack(self, state: Any) -> bytes:
        """What `save` gave, as bytes. Raises CosimError saying why that cannot be."""

    def unpack(self, data: bytes) -> None:
        """Continue from what `pack` gave, maybe that of another instance. Raises CosimError for anything else."""


_FIXED = ("description", "_inputs", "_outputs", "_u", "_y")  # attributes of a PythonComponent that are no state
_OF_THE_INSTANCE = ("_name", "_initializing")
_U, _Y = "its inputs", "its outputs"  # beside the attributes in a saved state, whose names have no blanks
_NAME = re.compile(r"(\S+)(?:\s+\[(.*)\])?")
_STUCK_UNIT = re.compile(r"([^\[\]]+)\[([^\[\]]*[^\d,\s][^\[\]]*)\]")  # not the indices of an array


class PythonComponent:
    """Base of a component written in Python.

    A subclass says what it has in class attributes (a name may carry a unit, `"x [m]"`) and overrides `step`,
    which reads `u` and writes `y`, both in declared order, and `start`, which puts initial outputs into `y`:

        class Gain(PythonComponent):
            inputs = ("u [m]",)
            outputs = ("y [N]",)
            parameters = {"k": 2.0}

            def step(self, t, h, u, y):
                y[0] = self.k * u[0]

    Parameters become attributes before `start`. `feedthrough` maps an output to the inputs it depends on directly;
    an output missing there depends on all. Exceptions raised in `step` end the run like an FMU's Error.

    Where `start` gives the outputs of any state and inputs, not only the initial ones, say `computes_on_get = True`: an
    algebraic loop through the component then reads outputs between steps instead of repeating steps.

    Each run executes a copy of the object that was added (`cosim.system.renewal`), so attributes that `__init__` sets
    are as new in every run.
    """

    inputs: ClassVar[Sequence[str]] = ()
    outputs: ClassVar[Sequence[str]] = ()
    parameters: ClassVar[Mapping[str, Any]] = {}
    feedthrough: ClassVar[Mapping[str, Sequence[str]]] = {}
    kind: ClassVar[str] = "continuous"
    default_step: ClassVar[TimeLike | None] = None
    computes_on_get: ClassVar[bool] = False

    def __init__(self) -> None:
        variables = [
            *(_variable(text, "input", "continuous", 0.0) for text in self._listed("inputs", self.inputs)),
            *(_variable(text, "output", "continuous", None) for text in self._listed("outputs", self.outputs)),
            *(_variable(text, "parameter", "tunable", value) for text, value in self.parameters.items()),
        ]
        self._check_names(variables)
        self.description = Description(
            name=type(self).__name__,
            variables={v.name: v for v in variables},
            kind=self.kind,
            default_step=None if self.default_step is None else positive(self.default_step, "default_step"),
            can_save=True,
            dependencies={output: frozenset(names) for output, names in self.feedthrough.items()},
        )
        self._inputs = {v: i for i, v in enumerate(self.description.inputs.values())}
        self._outputs = {v: i for i, v in enumerate(self.description.outputs.values())}
        self._name = self.description.name

    def _listed(self, what: str, names: Sequence[str]) -> Sequence[str]:
        if isinstance(names, str):
            where = f"{type(self).__name__}.{what}"
            raise WiringError(f"{where} is the text {names!r}, not a tuple of names: write ({names!r},), with a comma")
        return names

    def _check_names(self, variables: Sequence[Variable]) -> None:
        """Raise WiringError for names that stand for two things, and for a feedthrough of unknown variables."""
        who, counts = type(self).__name__, Counter(v.name for v in variables)
        twice = [n for n, count in counts.items() if count > 1]
        if twice:
            raise WiringError(f"{who} declares the variable '{twice[0]}' twice")
        given = [v.name for v in variables if v.causality == "parameter"]
        methods = [n for n in given if callable(getattr(type(self), n, None))]
        if methods:
            raise WiringError(f"{who} has a method '{methods[0]}', which a parameter of that name would replace")
        known = {c: [v.name for v in variables if v.causality == c] for c in ("input", "output")}
        for output, names in self.feedthrough.items():
            listed = self._listed(f"feedthrough[{output!r}]", names)
            for causality, name in [("output", output), *(("input", n) for n in listed)]:
                if name not in known[causality]:
                    raise WiringError(f"{who}.feedthrough: {unknown(causality, name, known[causality])}")

    # To be overridden.

    def start(self, u: Array, y: Array) -> None:
        """Initial outputs from initial inputs; called again when inputs change, so commit no state here."""

    def step(self, t: float, h: float, u: Array, y: Array) -> None:
        """Advance from `t` to `t + h` [s]."""
        raise NotImplementedError(f"{type(self).__name__} has no function step(self, t, h, u, y); write one")

    def begin(self) -> None:
        """Set the state to its initial value (parameters are known)."""

    # What the master calls.

    def instantiate(self, name: str) -> None:
        self._name = name
        self._u = np.array([v.start for v in self._inputs], dtype=float)
        self._y = np.zeros(len(self._outputs))
        for variable in self.description.parameters.values():
            setattr(self, variable.name, variable.start)

    def set(self, values: Mapping[Variable, Any]) -> None:
        for variable, value in values.items():
            if variable in self._inputs:
                self._u[self._inputs[variable]] = value
            else:
                setattr(self, variable.name, value)

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        if self.computes_on_get:
            self._started()
        return [self._value(v) for v in variables]

    def _value(self, variable: Variable) -> Any:
        if variable in self._inputs:
            return float(self._u[self._inputs[variable]])
        if variable in self._outputs:
            return float(self._y[self._outputs[variable]])
        return getattr(self, variable.name)

    def enter_initialization(self, start: float, stop: float | None) -> None:  # noqa: ARG002
        self._guard("begin", self.begin)
        self._initializing = True

    def exit_initialization(self) -> None:
        self._started()
        self._initializing = False

    def bind(self, inputs: Sequence[Variable], outputs: Sequence[Variable], u: Array, y: Array) -> Ports:
        to = np.array([self._inputs[v] for v in inputs], dtype=np.intp)
        source = np.array([self._outputs[v] for v in outputs], dtype=np.intp)
        own_u, own_y = self._u, self._y
        advance: Callable[..., Any] = self.step

        def set_inputs() -> None:
            own_u[to] = u

        def step(t: float, h: float) -> None:
            try:
                returned = advance(t, h, own_u, own_y)
                if returned is not None:
                    self._written("step", returned)
            except Exception as error:
                detail = f"{type(error).__name__}: {error}"
                raise CallFailed(self._name, "step", 3, detail) from error

        def get_outputs() -> None:
            if self._initializing or self.computes_on_get:
                self._started()
            own_y.take(source, 0, y, "clip")

        return Ports.of(set_inputs, step, get_outputs)

    def save(self) -> Any:
        own = {k: v for k, v in vars(self).items() if k not in _FIXED} | {_U: self._u, _Y: self._y}
        try:
            return plain.copied(own, [(self, self)]), plain.sharing(own), self
        except Exception:
            name, why = next(iter(uncopyable(own, self).items()), ("", "its attributes cannot be copied together"))
            raise CosimError(
                f"cannot save the state of '{self._name}': its attribute {name} cannot be copied ({why})"
            ) from None

    def restore(self, state: Any) -> None:
        saved, _, of = state  # which may have run before this one
        self._u[:], self._y[:] = saved[_U], saved[_Y]
        own = plain.copied(saved, [(saved[_U], self._u), (saved[_Y], self._y), (of, self)])
        self._take({k: v for k, v in own.items() if k not in (_U, _Y)})

    def _take(self, own: Mapping[str, Any]) -> None:
        """These attributes, and no others but those that are no state."""
        for name in vars(self).keys() - own.keys() - {*_FIXED, *_OF_THE_INSTANCE}:
            delattr(self, name)
        vars(self).update(own)

    def forget(self, state: Any) -> None: ...

    def identity(self) -> Mapping[str, str]:
        declared = [f"{v.causality} {v.name} [{v.unit_name}] {v.type}" for v in self.description.variables.values()]
        return {"class": type(self).__qualname__, "list of variables": "; ".join(declared)}

    def pack(self, state: Any) -> bytes:
        """The state as plain data (`cosim.core.plain`). Raises CosimError naming an attribute that is not."""
        own, shared, _ = state
        try:
            if shared is not None:
                raise plain.NotPlain(f"{shared[0]} and {shared[1]} share memory, which copies would not")
            return plain.encode({k: v for k, v in own.items() if k not in _OF_THE_INSTANCE})
        except plain.NotPlain as error:
            raise CosimError(f"its attribute {error}") from None

    def unpack(self, data: bytes) -> None:
        try:
            own = plain.decode(data)
        except plain.NotPlain as error:
            raise CosimError(f"the state of '{self._name}' {error}") from None
        for name, buffer in ((_U, self._u), (_Y, self._y)):
            values = own.pop(name, None)
            if not isinstance(values, np.ndarray) or values.dtype != float or values.shape != buffer.shape:
                raise CosimError(f"the state of '{self._name}' does not hold {name}")
            buffer[:] = values
        hidden = [n for n in own if n in (*_FIXED, *_OF_THE_INSTANCE) or callable(getattr(type(self), n, None))]
        if hidden:
            raise CosimError(f"the state of '{self._name}' would replace its {hidden[0]}, which is no state")
        self._take(own)

    def measure_dependencies(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Dependencies:
        """Inputs on which initial outputs depend directly, measured on a copy during initialization.

        Raises CosimError if an attribute cannot be copied.
        """
        shared = {id(v): v for v in self.description.variables.values()}  # by which a component knows its values
        try:
            other = copy.deepcopy(self, shared)  # type: ignore[arg-type]
        except Exception as error:
            raise CosimError(f"'{self._name}' cannot be copied: {type(error).__name__}: {error}") from None
        return by_perturbation(other, inputs, outputs, other.exit_initialization)

    def sampled_states(self) -> dict[str, float]:
        """States that the component keeps between samples, element by element.

        These are attributes that are floats or arrays of floats, except parameters. Raises CosimError for attributes of
        another or unknown kind.
        """
        return {
            f"{name}[{i}]" if isinstance(value, np.ndarray) else name: float(element)
            for name, value in self._memory().items()
            for i, element in enumerate(np.ravel(value), start=1)
        }

    def set_sampled_states(self, x: Array) -> None:
        """Other values for all of `sampled_states`, in their order."""
        begin = 0
        for name, value in self._memory().items():
            part = np.asarray(x[begin : begin + np.size(value)], dtype=float)
            setattr(self, name, part.reshape(value.shape) if isinstance(value, np.ndarray) else float(part[0]))
            begin += np.size(value)

    def _memory(self) -> dict[str, Any]:
        own = {k: v for k, v in vars(self).items() if not k.startswith("_") and k not in self.description.parameters}
        del own["description"]
        for name, value in own.items():
            known = bool | int | str | float | None
            if not isinstance(value, known) and not (isinstance(value, np.ndarray) and value.dtype == float):
                raise CosimError(
                    f"its attribute {name} is of type {type(value).__name__}; states are floats and arrays of floats"
                )
        return {k: v for k, v in own.items() if isinstance(v, float | np.ndarray)}

    def terminate(self) -> None: ...

    def close(self) -> None: ...

    def _written(self, function: str, returned: Any) -> None:
        """Refuse outputs that are returned instead of written into y."""
        if returned is not None and returned is not self._y:
            what = f"{type(returned).__name__} {returned!r:.60}"
            raise TypeError(f"{function} returned {what}: write outputs into y instead, y[0] = ...")

    def _started(self) -> None:
        start: Callable[[Array, Array], Any] = self.start
        self._guard("start", lambda: self._written("start", start(self._u, self._y)))

    def _guard(self, function: str, call: Action) -> None:
        try:
            call()
        except Exception as error:
            raise CallFailed(self._name, function, 3, f"{type(error).__name__}: {error}") from error


def uncopyable(values: Mapping[str, Any], owner: object = None) -> dict[str, str]:
    """Names of values that cannot be copied, and why; `owner`, to which they may refer, is left alone."""
    found = {}
    for name, value in values.items():
        try:
            plain.copied({name: value}, [(owner, owner)])
        except Exception as error:
            found[name] = f"{type(value).__name__}: {error}"
    return found


def _variable(text: str, causality: str, variability: str, start: Any) -> Variable:
    match = _NAME.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r}: write a variable as 'name' or 'name [unit]'")
    if match[2] is None and (stuck := _STUCK_UNIT.fullmatch(text)):
        raise ValueError(f"{text!r}: put a blank between name and unit, '{stuck[1]} [{stuck[2]}]'")
    kind = "boolean" if isinstance(start, bool) else "string" if isinstance(start, str) else "real"
    unit = KNOWN.get(match[2], Unit(match[2])) if match[2] else None
    name = match[1]
    return Variable(name, kind, causality=causality, variability=variability, start=start, unit=unit, declared=name)


class EndRequested(Exception):  # noqa: N818
    """A component asks to end the simulation; the argument says so in words. `complete`: its step was done first."""

    def __init__(self, component: str, text: str, *, complete: bool):
        super().__init__(text)
        self.component = component
        self.complete = complete
