"""Units as FMI describes them: exponents of the SI base units, a factor and an offset."""

from __future__ import annotations

from dataclasses import dataclass

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """value in base units = factor * value + offset. `exponents` follow `BASE_UNITS`; None = not defined."""

    name: str
    exponents: tuple[int, ...] | None = None
    factor: float = 1.0
    offset: float = 0.0


class UnitMismatchError(ValueError):
    """Two units that cannot be converted into each other; the text says why."""


def conversion(source: Unit | None, target: Unit | None, relative: bool = False) -> tuple[float, float]:
    """(scale, offset) with target value = scale * source value + offset.

    A missing unit on either side, or the same unit text, needs no conversion. `relative` drops the offsets
    (temperature differences). Raises UnitMismatchError when the quantities differ or a unit has no definition.
    """
    if source is None or target is None or source.name == target.name:
        return 1.0, 0.0
    for unit in (source, target):
        if unit.exponents is None:
            raise UnitMismatchError(f"its FMU does not define the unit '{unit.name}' in base units")
    if source.exponents != target.exponents:
        raise UnitMismatchError("they measure different quantities")
    scale = source.factor / target.factor
    offset = 0.0 if relative else (source.offset - target.offset) / target.factor
    return scale, offset
