"""FMUs that are integrated by the master: Model Exchange of FMI 2.0 and 3.0 by `engine/integrator.c`.

The integrator has the step function of a Co-Simulation FMU, so that the engine, recordings and saved states make no
difference between the two. Between communication steps the FMU is in event mode, where all its inputs may be set;
within them inputs keep their values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Literal, NoReturn, Protocol

import numpy as np

from build_fmus.base import surface
from build_fmus.base.checks import number, unknown
from cosim.core.component import Array, is_whole
from cosim.core.description import Description, Variable
from cosim.core.errors import CallFailed, CosimError, FmuError, IntegrationFailed, WiringError
from cosim.core.time import seconds_text
from cosim.engine.library import interface, library
from cosim.fmu.calls import WARNING, full_name
from cosim.fmu.driver import Driver
from cosim.fmu.isolation import IsolatedLibrary

Solver = Literal["auto", "explicit", "implicit"]
SOLVERS: Mapping[str, int] = {"auto": 0, "explicit": 1, "implicit": 2}  # IntegratorMethod
LARGEST_TOLERANCE = 1e-8  # unless the user says otherwise
_DIFFERENCE = 6e-6  # of a central difference, relative to the value or its nominal one: cube root of the precision
_COMPARED = 2.0**-20  # of differences that are compared with directional derivatives, relative to the same
LARGEST_IMPLICIT = 5000  # states, of which two matrices are kept


@dataclass(frozen=True)
class ModelExchange:
    """How a Model Exchange FMU is integrated.

    Args:
        tolerance: relative error of a state in one step of the integrator; multiplied by its nominal value it is the
            absolute one. None: that of the FMU's default experiment, at most 1e-8.
        solver: "explicit" is Dormand-Prince 5(4), "implicit" is the Rosenbrock method RODAS 4(3) for stiff models;
            "auto" begins explicitly and changes to the implicit method when the model proves to be stiff.
    """

    tolerance: float | None = None
    solver: Solver = "auto"

    def __post_init__(self) -> None:
        if self.tolerance is not None:
            number("tolerance", self.tolerance, above=0.0, most=0.1, error=WiringError)
        if self.solver not in SOLVERS:
            raise WiringError(unknown("solver", self.solver, SOLVERS))


def refusal(about: Description) -> str:
    """Why an FMU cannot be integrated; empty if it can."""
    if about.clocks:
        return (
            f"its clock '{about.clocks[0].name}' is not supported in Model Exchange: use interface=\"cs\" if the FMU"
            " offers Co-Simulation"
        )
    if about.unpaired:
        return f"its derivative '{about.unpaired}' names no state (attribute derivative); export the FMU again"
    return ""


def function_names(version: int) -> list[str]:
    """Names of the functions that the integrator calls, without their prefix, in its order."""
    ffi, compiled = interface(), library()
    pointers = (compiled.cosim_integrator_function(version, i) for i in range(compiled.INTEGRATOR_FUNCTIONS))
    return [ffi.string(p).decode() for p in pointers if p]


def integrator_setup(about: Description, options: ModelExchange) -> tuple[list[float], list[int]]:
    """Fields of `IntegratorSetup` in their order; value references of the states, then of their derivatives.

    Raises FmuError for too many states.
    """
    n = len(about.states)
    if options.solver == "implicit" and n > LARGEST_IMPLICIT:
        raise FmuError(
            f"'{about.name}' has {n} states, and the implicit solver supports at most {LARGEST_IMPLICIT}: use"
            ' solver="explicit"'
        )
    states, derivatives = (list(dict.fromkeys(v.reference for v in s)) for s in (about.states, about.derivatives))
    tolerance = options.tolerance or min(about.tolerance or math.inf, LARGEST_TOLERANCE)
    counts = [n, about.event_indicators, len(states)]
    flags = [int(about.completed_steps), int(about.directional_derivatives), int(about.kind is None)]
    return [int(about.fmi_version[0]), SOLVERS[options.solver], *counts, *flags, tolerance], [*states, *derivatives]


_OPTIONS = {
    "TOO_SMALL": " (interface=ModelExchange(tolerance=...))",
    "TOO_MANY_STEPS": ' (interface=ModelExchange(tolerance=..., solver="implicit"))',
}
"""What helps against a failure of the integrator, for those who call Python."""


class Instance(Protocol):
    """What is needed of an instance of an FMU."""

    name: str
    description: Description
    _instance: Any
    _library: Any

    def _function(self, name: str) -> Callable[..., int]: ...

    def _address(self, pointer: Any) -> int: ...

    def get(self, variables: Sequence[Variable]) -> list[Any]: ...

    def kept(self) -> AbstractContextManager[None]: ...

    def _set_values(self, values: Mapping[Variable, Any]) -> None: ...

    def _must(self, function: str, *arguments: Any) -> None: ...

    def _fail(self, function: str, status: int, detail: str = "") -> None: ...

    def _end_requested(self, detail: str, complete: bool) -> NoReturn: ...

    def took_whole_step(self, status: int, t: float, h: float) -> bool: ...

    def _recent_log(self) -> list[str]: ...


class Integration(Driver):
    """The integrator of one instance."""

    def __init__(self, component: Instance, options: ModelExchange):
        super().__init__()
        self._component, self._about = component, (about := component.description)
        ffi, compiled = self._ffi, self._library
        fields, self._references = integrator_setup(about, options)
        self._setup = setup = ffi.new("IntegratorSetup*", fields)
        self._names = function_names(int(about.fmi_version[0]))
        size = compiled.cosim_integrator_size(setup)
        if not size:
            raise FmuError(f"component '{component.name}' has too many states for Model Exchange: {len(about.states)}")
        references = ffi.new("uint32_t[]", self._references)
        self._packed = bytes(ffi.buffer(setup)) + bytes(ffi.buffer(references))
        self._memory, self._report = ffi.new("IntegratorMemory*"), ffi.new("IntegratorReport*")
        needed = [n for i, n in enumerate(self._names) if compiled.cosim_integrator_needs(setup, i)]
        self._isolated = component._library if isinstance(component._library, IsolatedLibrary) else None
        if self._isolated is not None:
            missing = [n for name in needed if (n := full_name(about.fmi_version[0], name)) in self._isolated.absent]
            if missing:
                raise FmuError(f"component '{component.name}': its library lacks {', '.join(missing)}")
            return
        calls, there = ffi.new("void*[]", compiled.INTEGRATOR_FUNCTIONS), component._library.handle
        for i, name in enumerate(self._names):
            if name in needed or hasattr(there, full_name(about.fmi_version[0], name)):
                calls[i] = self._pointer(component._address(component._function(name)))
        self._space = ffi.new("double[]", (size + 7) // 8)
        instance = self._pointer(component._address(component._instance))
        self._integrator = compiled.cosim_integrator_make(self._space, setup, references, instance, calls)
        self._memory, self._report = (ffi.addressof(self._integrator, n) for n in ("memory", "report"))

    @property
    def here(self) -> bool:
        """Whether the integrator is in this process; an isolated FMU has it beside it, behind its `DoStep`."""
        return self._isolated is None

    @property
    def step(self) -> tuple[Any, Any]:
        return getattr(self._library, f"cosim_integrator_step{self._setup.version}"), self._integrator

    @property
    def counts(self) -> dict[str, int]:
        """What it has done since the start: steps, rejected steps, evaluations of the derivatives, events."""
        self._fetch()
        return {k: int(getattr(self._report, k)) for k in ("steps", "rejected", "evaluations", "events")}

    def begin(self, t: float) -> None:
        """After initialization, in event mode."""
        if self._isolated is not None:
            status = self._isolated.integrate(self._packed, t)
        else:
            status = self._library.cosim_integrator_begin(self._integrator, t)
        if status > WARNING:
            self.fail(status, "its first event iteration")

    def linearize(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> tuple[Array, Array, Array, Array]:
        """(A, B, C, D) at the present state by central differences; the state is restored after it.

        Raises CosimError if the FMU is isolated or cannot save its state.
        """
        n = len(self._about.states)
        if self._isolated is not None or not self._about.can_save:
            why = "is isolated: add it without isolation" if self._about.can_save else "cannot save its state"
            raise CosimError(f"its FMU offers no directional derivatives; differences are not possible, as it {why}")
        discrete = next((v.name for v in inputs if v.variability == "discrete"), None)
        if discrete is not None:
            raise CosimError(
                f"its FMU offers no directional derivatives; differences are not possible for its discrete input"
                f" {discrete}: name other inputs"
            )
        with self._moved(inputs, outputs) as (shown, present, scale):
            columns = []
            for k, size in enumerate(scale):
                step = _DIFFERENCE * size
                ends = [[*present[:k], present[k] + sign * step, *present[k + 1 :]] for sign in (1.0, -1.0)]
                columns.append((shown(ends[0]) - shown(ends[1])) / (ends[0][k] - ends[1][k]))
        jacobian = np.array(columns).reshape(len(present), n + len(outputs)).T
        if not np.isfinite(jacobian).all():
            raise CosimError("its derivatives or outputs are not finite beside its present state")
        return jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n], jacobian[n:, n:]

    def agrees(self, jacobian: Array, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> bool:
        """Whether derivatives agree with differences along one direction, by the rule of `compare` in `integrator.c`.

        True where no differences are possible. `jacobian`: of the states' derivatives and `outputs` by states and
        `inputs`.
        """
        discrete = any(v.variability == "discrete" for v in inputs)
        if self._isolated is not None or not self._about.can_save or discrete:
            return True
        try:
            with self._moved(inputs, outputs) as (shown, present, scale):
                steps = _COMPARED * np.array(scale)
                here, *ends = (shown([*(present + sign * steps)]) for sign in (0.0, 1.0, -1.0))
        except CallFailed as failure:
            if failure.status == "Fatal":
                raise
            return True
        change, parts = (ends[0] - ends[1]) / 2, jacobian * steps
        allowed = 0.01 * np.abs(parts).sum(axis=1) + 1e-9 * np.maximum(1.0, np.abs(here))
        within = np.abs(change - parts.sum(axis=1)) <= allowed  # NaN does not agree
        return bool(within.all() or not np.isfinite(change).all())

    @contextmanager
    def _moved(
        self, inputs: Sequence[Variable], outputs: Sequence[Variable]
    ) -> Iterator[tuple[Callable[[Sequence[float]], Array], list[float], list[float]]]:
        """The states' derivatives and `outputs` as a function of states and `inputs`; these at present and their sizes.

        The state is restored afterward.
        """
        component, ffi, n = self._component, self._ffi, len(self._about.states)
        x, slopes = ffi.new("double[]", n), ffi.new("double[]", n)
        variables = [*self._about.states, *inputs]
        report = bytes(ffi.buffer(self._report))
        try:
            with component.kept():
                self.begin(self._memory.time)  # its event iteration
                component._must(self._names[8])
                component._must(self._names[2], x, n)
                present = [*x, *map(float, component.get(inputs))]

                def shown(point: Sequence[float]) -> Array:
                    component._must(self._names[1], ffi.new("double[]", point[:n]), n)
                    component._set_values(dict(zip(inputs, point[n:], strict=True)))
                    component._must(self._names[3], slopes, n)
                    return np.array([*slopes, *component.get(outputs)], dtype=float)

                yield shown, present, [max(abs(at), v.nominal) for at, v in zip(present, variables, strict=True)]
        finally:
            ffi.buffer(self._report)[:] = report

    def saved(self) -> bytes:
        """What continues from step to step, apart from the state of the FMU."""
        self._fetch()
        return bytes(self._ffi.buffer(self._memory))

    def restore(self, saved: bytes) -> None:
        """Continue from what `saved` returned. Raises CosimError for anything else."""
        if len(saved) != self.saved_size:
            raise CosimError(f"the state of '{self._component.name}' does not hold the memory of its integrator")
        self._ffi.buffer(self._memory)[:] = saved
        if self._isolated is not None:
            self._isolated.remember(saved)

    @property
    def saved_size(self) -> int:
        """Bytes of `saved`."""
        return int(self._ffi.sizeof("IntegratorMemory"))

    def _fetch(self) -> bool:
        """Memory and report of an isolated integrator; False when its process is lost."""
        if self._isolated is None:
            return True
        size = self.saved_size
        data = self._isolated.remembered(size + self._ffi.sizeof("IntegratorReport"))
        if data is not None:
            self._ffi.buffer(self._memory)[:], self._ffi.buffer(self._report)[:] = data[:size], data[size:]
        return data is not None

    def step_failed(self, status: int, t: float, h: float) -> NoReturn:
        """Raise the exception for a step that failed."""
        self.fail(status, f"step from {t:.9g} s, length {seconds_text(h)}", (t, h))

    def fail(self, status: int, where: str, step: tuple[float, float] | None = None) -> NoReturn:
        """Raise the exception for what the integrator reports; `step`: begin and length [s], if it was in a step."""
        component = self._component
        if not self._fetch():
            component._fail("DoStep", status, where)
        report, ends = self._report, self._ffi.typeof("IntegratorEnd").elements
        why, at = ends[report.end].removeprefix("INTEGRATOR_"), float(report.time)
        if why in ("CALL_FAILED", "FINE"):
            component._fail(self._names[report.index] if why != "FINE" else "DoStep", status, where)
        if why == "TERMINATED":
            component._end_requested(f"at {at:.9g} s; {where}", step is not None and is_whole(at, *step))
        states, text = self._about.states, self._ffi.new("char[]", 1024)
        state = f"'{states[report.index].name if report.index < len(states) else '?'}'"
        self._library.cosim_integrator_why(self._setup, report, state.encode(), text, len(text))
        said = self._ffi.string(text).decode(errors="replace") + surface.hint(_OPTIONS.get(why, ""))
        raise IntegrationFailed(component.name, said, at, component._recent_log())
