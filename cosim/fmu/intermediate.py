"""FMI 3.0 Co-Simulation FMUs whose inputs follow inside a step, by intermediate update (`engine/intermediate.c`).

Inputs with `intermediateUpdate` that are extrapolated begin a step with their value at its begin. When the FMU asks for
them, they get their value at the time that it gives. All others keep what they had at the begin of the step.
"""

from __future__ import annotations

import warnings
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.core.component import Action
from cosim.core.description import Description, Variable
from cosim.core.errors import CallFailed, FmuWarning
from cosim.core.time import seconds_text
from cosim.fmu.calls import Intermediate
from cosim.fmu.driver import Driver
from cosim.fmu.isolation import IsolatedLibrary
from cosim.fmu.model_exchange import Instance
from cosim.fmu.transfers import by_reference, slots, sources


def followed(about: Description) -> list[Variable]:
    """Inputs that may be set inside the steps of an FMU."""
    return [v for v in about.inputs.values() if v.follows]


@dataclass(frozen=True)
class Following:
    """One call that sets all inputs that follow: `references`, and `n` elements.

    `driven`: numbers of inputs that are connected, each with its element; `free`: elements of the others.
    """

    references: list[int]
    n: int
    driven: list[tuple[int, int]]
    free: dict[Variable, int]


def following(inputs: Sequence[Variable], places: Mapping[int, Variable], extrapolated: Container[int]) -> Following:
    """What follows of `inputs`, those with `intermediateUpdate`: arrays of which an element is extrapolated.

    `places`: the inputs that are connected, by their numbers.
    """
    numbers = {v: i for i, v in places.items()}
    found, at = Following([], 0, [], {}), 0
    for reference, array in by_reference(inputs).items():
        if any(numbers.get(v) in extrapolated for v in array):
            found.references.append(reference)
            found.driven.extend((numbers[v], at + v.index) for v in array if v in numbers)
            found.free.update({v: at + v.index for v in array if v not in numbers})
            at += array[0].size
    return replace(found, n=at)


class IntermediateUpdates(Driver):
    """The inputs of one instance that follow inside its steps; made before the instance, which gets its address."""

    def __init__(self, inputs: Sequence[Variable]):
        super().__init__()
        self._inputs = inputs
        self._steps = self._ffi.new("IntermediateStep*")
        self._line = np.zeros(2 + 3 * len(inputs))
        self._references, self._element = (np.zeros(len(inputs), dtype=np.uint32) for _ in range(2))
        self._steps.lines = self._lines = self._ffi.new("EngineExtrapolation[]", len(inputs))
        self._places: dict[int, Variable] = {}
        self._free: dict[Variable, int] = {}  # elements that no connection drives, and their places in the call
        update = self._steps.update
        update.line = self._ffi.cast("double*", self._line.ctypes.data)
        update.references = self._ffi.cast("uint32_t*", self._references.ctypes.data)
        self._steps.element = self._ffi.cast("uint32_t*", self._element.ctypes.data)

    @property
    def callback(self) -> Intermediate:
        """What the FMU is instantiated with."""
        update = self._address(self._library.cosim_intermediate_update)
        return update, self._address(self._steps), [*by_reference(self._inputs)]

    @property
    def step(self) -> tuple[Any, Any]:
        return self._library.cosim_intermediate_step, self._steps

    def attach(self, component: Instance) -> None:
        """After instantiation."""
        ffi, self._get = self._ffi, component.get
        self._steps.step = ffi.cast("EngineStep3", component._address(component._function("DoStep")))
        self._steps.update.instance = ffi.cast("void*", component._address(component._instance))
        if isinstance(component._library, IsolatedLibrary):
            component._library.follow(self._address(self._steps))
        else:
            setter = component._address(component._function("SetFloat64"))
            self._steps.update.set = ffi.cast("EngineValues3", setter)

    def bind(self, inputs: Sequence[Variable], sizes: Mapping[Variable, int]) -> list[Action]:
        """The inputs that are connected, as they lie in the master's buffer.

        Returns what reads elements of their arrays that are not connected, if there are any.
        """
        at = 0
        self._places, self._free, self._steps.n_lines, self._steps.update.report.requests = {}, {}, 0, 0
        self._steps.update.n = self._steps.update.n_references = 0
        for v in inputs:
            self._places[at] = v
            at += slots(sizes.get(v, 0))
        connected = {*inputs}
        partly = {v.reference for v in connected} & {v.reference for v in self._inputs if v not in connected}
        return [self._keep] if partly else []

    def follow(self, component: Any, values: Any, adaptive: Any) -> None:
        """From now on they follow what an `EngineComponent*` extrapolates from `values`, or what `adaptive` does."""
        steps, ffi = self._steps, self._ffi
        steps.values, steps.scale, steps.offset = values, component.scale, component.offset
        where = sources(component, values, self._places)
        lines = {line.input: line for line in component.extrapolations[0 : component.n_extrapolations]}
        steps.adaptive, steps.update.begins = adaptive, adaptive != ffi.NULL
        if adaptive != ffi.NULL:
            for i, slot in where.items():
                if adaptive.published <= slot < adaptive.published + adaptive.n:
                    lines[i] = {"input": i, "now": slot - adaptive.published, "period": 1.0}
        found = following(self._inputs, self._places, lines)
        for k, reference in enumerate(found.references):
            self._references[k] = reference
        for n, (i, element) in enumerate(found.driven):
            self._lines[n], self._element[n] = lines.get(i, {"input": i, "now": where[i]}), element
        self._free = found.free
        steps.n_lines, steps.update.n, steps.update.n_references = len(found.driven), found.n, len(found.references)
        self._line[:] = 0.0
        self._keep()

    def _keep(self) -> None:
        """Elements that no connection drives have the values that they have now."""
        for v, value in zip(self._free, self._get([*self._free]), strict=True):
            self._line[2 + self._free[v]] = value

    def warn_if_unused(self, name: str) -> None:
        """Warn that the FMU has never asked for inputs: they were held at the begin of each step."""
        update = self._steps.update
        if update.n and self._line[1] and not update.report.requests:
            references = self._references[: update.n_references]
            names = ", ".join(v.name for v in self._places.values() if v.reference in references)
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
