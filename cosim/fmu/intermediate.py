"""FMI 3.0 Co-Simulation FMUs whose inputs follow inside a step, by intermediate update (`engine/intermediate.c`).

Inputs with `intermediateUpdate` that are extrapolated begin a step with their value at its begin. When the FMU asks for
them, they get their value at the time that it gives. All others keep what they had at the begin of the step.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cosim.core.description import Variable
from cosim.core.errors import CallFailed, FmuWarning
from cosim.core.time import seconds_text
from cosim.engine.library import interface, library
from cosim.fmu.calls import Intermediate
from cosim.fmu.isolation import IsolatedLibrary
from cosim.fmu.model_exchange import Instance
from cosim.fmu.transfers import slots


class IntermediateUpdates:
    """The inputs of one instance that follow inside its steps; made before the instance, which gets its address."""

    def __init__(self, inputs: Sequence[Variable]):
        self._ffi, self._library, self._inputs = interface(), library(), inputs
        self._steps = self._ffi.new("IntermediateStep*")
        self._line = np.zeros(2 + 3 * len(inputs))
        self._references = np.zeros(len(inputs), dtype=np.uint32)
        self._steps.lines = self._lines = self._ffi.new("EngineExtrapolation[]", len(inputs))
        self._places: dict[int, Variable] = {}
        update = self._steps.update
        update.line = self._ffi.cast("double*", self._line.ctypes.data)
        update.references = self._ffi.cast("uint32_t*", self._references.ctypes.data)

    def _address(self, pointer: Any) -> int:
        return int(self._ffi.cast("uintptr_t", pointer))

    def _function(self, name: str) -> Any:
        return self._ffi.addressof(self._library, f"cosim_intermediate_{name}")

    @property
    def callback(self) -> Intermediate:
        """What the FMU is instantiated with."""
        return self._address(self._function("update")), self._address(self._steps), [v.reference for v in self._inputs]

    @property
    def step(self) -> tuple[Any, Any]:
        """The step function and its first argument, for Python."""
        return self._library.cosim_intermediate_step, self._steps

    @property
    def addresses(self) -> tuple[int, int]:
        """The same as addresses."""
        return self._address(self._function("step")), self._address(self._steps)

    def attach(self, component: Instance) -> None:
        """After instantiation."""
        ffi = self._ffi
        self._steps.step = ffi.cast("EngineStep3", component._address(component._function("DoStep")))
        self._steps.update.instance = ffi.cast("void*", component._address(component._instance))
        if isinstance(component._library, IsolatedLibrary):
            component._library.follow(self._address(self._steps))
        else:
            setter = component._address(component._function("SetFloat64"))
            self._steps.update.set = ffi.cast("EngineValues3", setter)

    def bind(self, inputs: Sequence[Variable], sizes: Mapping[Variable, int]) -> None:
        """The inputs that are connected, as they lie in the master's buffer."""
        at = 0
        self._places, self._steps.update.n, self._steps.update.report.requests = {}, 0, 0
        for v in inputs:
            self._places[at] = v
            at += slots(sizes.get(v, 0))

    def follow(self, component: Any, values: Any) -> None:
        """From now on they follow what an `EngineComponent*` extrapolates from `values`."""
        steps, n = self._steps, 0
        steps.values, steps.scale, steps.offset = values, component.scale, component.offset
        for line in component.extrapolations[0 : component.n_extrapolations]:
            if (variable := self._places[line.input]).follows:
                self._lines[n], self._references[n], n = line, variable.reference, n + 1
        steps.update.n = n

    def warn_if_unused(self, name: str) -> None:
        """Warn that the FMU has never asked for inputs: they were held at the begin of each step."""
        update = self._steps.update
        if update.n and self._line[1] and not update.report.requests:
            names = ", ".join(v.name for v in self._places.values() if v.reference in self._references[: update.n])
            warnings.warn(
                f"component '{name}': its FMU never asked for inputs inside of a step, although it declares"
                f" intermediateUpdate; {names} had the values of the begin of each step: connect without extrapolation,"
                " or export the FMU without intermediateUpdate",
                FmuWarning,
                stacklevel=3,
            )

    def step_failed(self, component: Instance) -> None:
        """Raise the exception for a step in which inputs were not set; nothing if they were."""
        report, (begin, end) = self._steps.update.report, self._line[:2].tolist()
        step = f"step from {begin:.9g} s, length {seconds_text(end - begin)}"
        if report.end == self._library.INTERMEDIATE_SET_FAILED:
            component._fail("SetFloat64", report.status, f"in an intermediate update at {report.time:.9g} s; {step}")
        if report.end == self._library.INTERMEDIATE_BAD_TIME:
            said = f"it asked for inputs at {report.time:.9g} s, which is outside of the {step}; correct the FMU"
            raise CallFailed(component.name, "its intermediate update", 3, said, component._recent_log())
