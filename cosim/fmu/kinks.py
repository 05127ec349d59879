"""Kinks of a continuous FMU at its operating point: where the slopes on both sides of a state or input differ.

The directional derivative gives one of the two without a word. States of FMUs of this project are moved in a serialized
state, inputs are set; one-sided differences over h and over h / 4 are compared with the directional derivative. Of a
smooth function, what lies between them goes with h; of a kink it stays; of a jump it grows.

What is rounding is measured: third differences of values a few thousandths of h apart, which of a smooth function are
nothing else. Differences below a millionth of what the same unknown changes by over other states and inputs do not
count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from cosim.core.description import Description, Variable
from cosim.core.errors import CosimError
from cosim.core.signals import Array
from cosim.fmu.own_states import StateLayout

STEP = float(np.finfo(float).eps) ** (1 / 3)  # relative to max(1, |value|)
RELEVANT = 1e-6
POINTS, SPACING, SAFETY = 8, 2.0**-8, 16.0  # of the values whose third differences are rounding


class Instance(Protocol):
    """What is needed of an instance."""

    description: Description

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        """Present values."""

    def set(self, values: Mapping[Variable, Any]) -> None:
        """Set values."""

    def serialize(self) -> bytes:
        """The present state as bytes."""

    def deserialize(self, data: bytes) -> None:
        """Restore a state that `serialize` returned."""


def refuse_kinks(
    component: Instance,
    slopes: Array,
    unknowns: Sequence[Variable],
    states: Sequence[Variable],
    inputs: Sequence[Variable],
) -> None:
    """Raise CosimError naming an unknown that has a kink or jump over a state or input at the present values.

    Args:
        component: an instance that can serialize its state, which is restored.
        slopes: directional derivatives, shape (unknowns, states + inputs).
        unknowns: outputs and derivatives of the states.
        states: continuous states, in the order of the declaration.
        inputs: inputs by which the component is linearized.
    """
    about, data, knowns = component.description, component.serialize(), [*states, *inputs]
    layout = StateLayout(len(about.parameters) + len(about.inputs), len(states), recomputed=True)
    x, at = layout.read(data), np.array(component.get(knowns), dtype=float)
    if not np.array_equal(x, at[: len(states)]):
        raise CosimError("its FMU is from another build, so the position of its states in a saved state is unknown")
    steps = STEP * np.maximum(1.0, np.abs(at))

    def value(column: int, change: float) -> Array:
        moved = x.copy()
        if column < len(states):
            moved[column] += change
        component.deserialize(layout.write(data, moved))
        if column >= len(states):
            component.set({knowns[column]: at[column] + change})
        return np.array(component.get(unknowns), dtype=float)

    try:
        here = np.array(component.get(unknowns), dtype=float)
        counts = RELEVANT * np.abs(slopes * steps).max(axis=1, initial=0.0)
        for column, known in enumerate(knowns):
            sides = [s for s in (1.0, -1.0) if _allowed(known, at[column] + s * steps[column])]
            row = _kink(here, lambda d, k=column: value(k, d), slopes[:, column], counts, steps[column], sides)  # type: ignore[misc]
            if row is not None:
                what = unknowns[row]
                other = " or choose outputs without it (outputs=...)" if what.causality == "output" else ""
                raise CosimError(
                    f"its {what.name} has a kink or jump over {known.name} = {at[column]:g}, where the slopes on both"
                    f" sides differ: linearize at another value (start=..., settle=...){other}"
                )
    finally:
        component.deserialize(data)


def _kink(
    here: Array, value: Callable[[float], Array], slope: Array, counts: Array, h: float, sides: Sequence[float]
) -> int | None:
    """The row in which the slopes over one known differ most, or None. `counts`: changes that count."""

    def apart(h: float) -> Array:
        found = np.array([s * (value(s * h) - here) - h * slope for s in sides])
        return np.asarray(np.abs(found).max(axis=0, initial=0.0))

    first = apart(h)
    if not (first > counts).any():
        return None
    near = np.array([value(sides[0] * h * (1.0 + k * SPACING)) for k in range(POINTS)])
    rounding = SAFETY * np.abs(np.diff(near, 3, axis=0)).max(axis=0)
    second = apart(h / 4)
    wrong = (first > counts + rounding) & (4 * second > counts + 4 * rounding) & (4 * second > 0.5 * first)
    return int(np.argmax(np.where(wrong, second / (counts + rounding + 1e-300), 0.0))) if wrong.any() else None


def _allowed(known: Variable, value: float) -> bool:
    """Whether a known can be moved there: beyond its limits an input acts no more."""
    low, high = known.limits
    return known.causality != "input" or low <= value <= high
