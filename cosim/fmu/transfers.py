"""Which values one FMI call moves, and where they lie in the buffer of the caller."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import cosim.fmu.calls as fmi
from cosim.core.description import Variable

Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Arrangement:
    """Variables of one type in one call: all elements of `arrays` (value reference -> elements that are moved).

    Of these, number `element[i]` belongs to `place[i]` of the caller's buffer.
    """

    fmi_type: str
    arrays: dict[int, list[Variable]]
    total: int
    element: Index
    place: Index
    in_place: bool  # all that is in the call lies side by side in the buffer, as doubles
    sizes: tuple[int, ...] = ()  # bytes at most of each value that has more than one place (`engine/exact_values.h`)

    @property
    def widths(self) -> npt.NDArray[np.uint32] | None:
        """Number of elements of each variable, None: all have one."""
        found = np.array([elements[0].size for elements in self.arrays.values()], dtype=np.uint32)
        return found if (found > 1).any() else None

    @property
    def keeps(self) -> bool:
        """There are elements of arrays that are not moved."""
        return self.total > len(self.place)


def arrangements(
    version: int,
    variables: Sequence[Variable],
    chosen: Callable[[Variable], bool] = lambda _: True,
    sizes: Mapping[Variable, int] | None = None,
) -> list[Arrangement]:
    """The calls that move all variables that are `chosen`, one for each type.

    `sizes`: bytes at most of those that have more than one place in the buffer.
    """
    sizes, at = sizes or {}, 0
    groups: dict[tuple[str, bool], dict[Variable, int]] = {}  # places by type
    for v in variables:
        if chosen(v):
            groups.setdefault((v.fmi_type, v in sizes), {})[v] = at
        at += slots(sizes.get(v, 0))
    return [_arranged(version, fmi_type, group, sizes) for (fmi_type, _), group in groups.items()]


def slots(size: int) -> int:
    """Places of a value in the master's buffers: one, and one for four of its `size` bytes, if it has any."""
    return 1 + (size + 3) // 4


def sources(component: Any, values: Any, inputs: Iterable[int]) -> dict[int, int]:
    """Which of `values` these inputs of an `EngineComponent*` read, by their numbers."""
    first = component.u - values  # where nothing is copied
    return {i: component.index[i] if component.n_inputs else first + i for i in inputs}


def _arranged(
    version: int, fmi_type: str, places: Mapping[Variable, int], sizes: Mapping[Variable, int]
) -> Arrangement:
    arrays = by_reference(places)
    offsets, total = {}, 0
    for reference, elements in arrays.items():
        offsets[reference] = total
        total += elements[0].size
    element = np.array([offsets[v.reference] + v.index for v in places], dtype=np.intp)
    place = np.array(list(places.values()), dtype=np.intp)
    contiguous = len(places) == total and np.array_equal(place, place[0] + np.arange(total))
    is_double = fmi.c_types(version)[fmi_type] == "double"
    in_place = is_double and contiguous and np.array_equal(element, np.arange(total))
    return Arrangement(fmi_type, arrays, total, element, place, in_place, tuple(sizes[v] for v in places if v in sizes))


def by_type(variables: Iterable[Variable]) -> dict[str, list[Variable]]:
    """Variables by their FMI type, in order."""
    groups: dict[str, list[Variable]] = {}
    for variable in variables:
        groups.setdefault(variable.fmi_type, []).append(variable)
    return groups


def by_reference(variables: Iterable[Variable]) -> dict[int, list[Variable]]:
    """Variables by their value reference: the elements of each array, in order."""
    groups: dict[int, list[Variable]] = {}
    for variable in variables:
        groups.setdefault(variable.reference, []).append(variable)
    return groups
