"""Direct dependencies of outputs on inputs, measured during initialization where a component does not declare them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cosim.core.description import Variable

Dependencies = Mapping[str, frozenset[str]]  # inputs by output, by name

_STEP = 1e-3  # by which an input is changed, relative to max(1, |value|)
_ROUNDING = 1e-9  # changes of an output that are smaller, relative to its value, are none


def by_perturbation(
    component: Any, inputs: Sequence[Variable], outputs: Sequence[Variable], compute: Callable[[], None] = lambda: None
) -> Dependencies:
    """Find direct dependencies by perturbation: change each input in turn, and change it back.

    An output depends on an input if it changes by clearly more than the error that remains after the input is back.
    `compute` makes the component compute its outputs, unless it does so by itself.
    """

    def shown() -> list[float]:
        compute()
        return [float(x) for x in component.get(outputs)]

    found: dict[str, set[str]] = {o.name: set() for o in outputs}
    for i in inputs:
        present = component.get([i])[0]
        before = shown()
        component.set({i: _changed(i, present)})
        changed = shown()
        component.set({i: present})
        for o, y, there, back in zip(outputs, before, changed, shown(), strict=True):
            if abs(there - y) > _ROUNDING * abs(y) + 100 * abs(back - y):
                found[o.name].add(i.name)
    return {name: frozenset(of) for name, of in found.items()}


def by_derivatives(
    derivative: Callable[[Sequence[Variable], Variable], Sequence[float]],
    inputs: Sequence[Variable],
    outputs: Sequence[Variable],
) -> Dependencies:
    """`derivative(outputs, input)` gives the derivatives of outputs by an input."""
    found: dict[str, set[str]] = {o.name: set() for o in outputs}
    for i in inputs:
        for o, slope in zip(outputs, derivative(outputs, i), strict=True):
            if slope:
                found[o.name].add(i.name)
    return {name: frozenset(of) for name, of in found.items()}


def _changed(variable: Variable, present: Any) -> Any:
    """Another value of an input, within its limits."""
    if variable.type == "boolean":
        return not present
    step = 1 if variable.type == "integer" else _STEP * max(1.0, abs(present))
    return present - step if present + step > variable.limits[1] else present + step
