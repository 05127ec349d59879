"""Linear models in place of components: the same master runs them with the same schedule, exactly.

It runs one deviation at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.core.component import Array, PythonComponent
from cosim.core.description import Description, Variable
from cosim.core.errors import CosimError
from cosim.system.components import SystemComponent


@dataclass(frozen=True)
class Model:
    """Linear model of a continuous component, inputs and outputs those of its connections."""

    a: Array
    b: Array
    c: Array
    d: Array


def model_of(component: SystemComponent, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Model:
    """The model of a component where it stands. Raises CosimError when it has none."""
    try:
        linearize = component.implementation.linearize  # type: ignore[attr-defined]
    except AttributeError:
        raise CosimError("it offers no linear model") from None
    return Model(*linearize(inputs, outputs))


def diagonal(models: Sequence[Model]) -> Model:
    """Models side by side."""
    from scipy.linalg import block_diag  # slow to import, and few runs need it

    return Model(*(block_diag(*(getattr(m, name) for m in models)) for name in "abcd"))


class _Linearized(PythonComponent):
    def __init__(self, kind: str, inputs: Sequence[Variable], outputs: Sequence[Variable], states: int):
        super().__init__()
        self.x = np.zeros(states)
        self.description = Description("linear", {v.name: v for v in [*inputs, *outputs]}, kind=kind)
        self._inputs = {v: i for i, v in enumerate(inputs)}
        self._outputs = {v: i for i, v in enumerate(outputs)}

    def instantiate(self, name: str) -> None:
        super().instantiate(name)
        self._u[:] = 0.0  # deviations, whatever the variables start at

    @property
    def held(self) -> Array:
        """Inputs of its latest step, may be written to."""
        return self._u


class LinearizedContinuous(_Linearized):
    """A component that steps a linear model exactly, from the state 0."""

    computes_on_get = True

    def __init__(self, model: Model, inputs: Sequence[Variable], outputs: Sequence[Variable], step: float):
        super().__init__("continuous", inputs, outputs, len(model.a))
        depends = {
            o.name: frozenset(i.name for i, gain in zip(inputs, row, strict=True) if gain)
            for o, row in zip(outputs, model.d, strict=True)
        }
        self.description = replace(self.description, dependencies=depends)
        n = len(model.a)
        block = np.zeros((n + len(inputs), n + len(inputs)))
        block[:n, :n], block[:n, n:] = model.a, model.b
        from scipy.linalg import expm

        self._map = expm(block * step)[:n]
        self._out = np.hstack([model.c, model.d])

    def outputs_now(self) -> Array:
        """What its state and the inputs of its latest step give."""
        return self._out @ np.concatenate([self.x, self._u])

    def start(self, u: Array, y: Array) -> None:
        y[:] = self._out @ np.concatenate([self.x, u])

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        self.x[:] = self._map @ np.concatenate([self.x, u])
        y[:] = self._out @ np.concatenate([self.x, u])


class LinearizedSampled(_Linearized):
    """A component that runs one linear update after the other, and begins from scratch after the last."""

    def __init__(self, updates: Sequence[Array], inputs: Sequence[Variable], outputs: Sequence[Variable]):
        """`updates`: matrices from [x; u] to [x_next; y]."""
        super().__init__("discrete", inputs, outputs, updates[0].shape[1] - len(inputs))
        from scipy.sparse import csr_array

        self._updates = [csr_array(m) for m in updates]  # memories that shift are mostly zeros
        self.sample = 0  # number of the next one

    def start(self, u: Array, y: Array) -> None: ...

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        result = self._updates[self.sample % len(self._updates)] @ np.concatenate([self.x, u])
        self.x[:], y[:] = result[: len(self.x)], result[len(self.x) :]
        self.sample += 1


class Source(_Linearized):
    """Outputs that are what `values` is set to."""

    def __init__(self, outputs: Sequence[Variable]):
        super().__init__("discrete", (), outputs, 0)
        self.values = np.zeros(len(outputs))

    def start(self, u: Array, y: Array) -> None: ...

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        y[:] = self.values
