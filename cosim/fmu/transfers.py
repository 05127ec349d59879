"""Which values one FMI call moves, and where they lie in the buffer of the caller."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

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

    @property
    def keeps(self) -> bool:
        """There are elements of arrays that are not moved."""
        return self.total > len(self.place)


def arrangements(
    version: int, variables: Sequence[Variable], chosen: Callable[[Variable], bool] = lambda _: True
) -> list[Arrangement]:
    """The calls that move all variables that are `chosen`, one for each type."""
    types = by_type(v for v in variables if chosen(v))
    return [_arranged(version, variables, fmi_type, chosen) for fmi_type in types]


def _arranged(
    version: int, variables: Sequence[Variable], fmi_type: str, chosen: Callable[[Variable], bool]
) -> Arrangement:
    places = [i for i, v in enumerate(variables) if v.fmi_type == fmi_type and chosen(v)]
    arrays = by_reference([variables[i] for i in places])
    offsets, total = {}, 0
    for reference, elements in arrays.items():
        offsets[reference] = total
        total += elements[0].size
    element = np.array([offsets[variables[i].reference] + variables[i].index for i in places], dtype=np.intp)
    place = np.array(places, dtype=np.intp)
    contiguous = len(places) == total and np.array_equal(place, place[0] + np.arange(total))
    is_double = fmi.c_types(version)[fmi_type] == "double"
    in_place = is_double and contiguous and np.array_equal(element, np.arange(total))
    return Arrangement(fmi_type, arrays, total, element, place, in_place)


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
