"""Units as FMI describes them: exponents of the SI base units, a factor and an offset."""

from __future__ import annotations

import math
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


def _si(name: str, factor: float = 1.0, offset: float = 0.0, **exponents: int) -> Unit:
    return Unit(name, tuple(exponents.get(base, 0) for base in BASE_UNITS), factor, offset)


_DEGREE = math.pi / 180.0

# Units components written in Python may use; FMUs bring their own definitions.
KNOWN = {
    unit.name: unit
    for unit in (
        _si("1"), _si("%", 0.01), _si("m", m=1), _si("mm", 1e-3, m=1), _si("cm", 1e-2, m=1), _si("km", 1e3, m=1),
        _si("s", s=1), _si("ms", 1e-3, s=1), _si("Hz", s=-1), _si("1/s", s=-1), _si("kg", kg=1), _si("m/s", m=1, s=-1),
        _si("km/h", 1 / 3.6, m=1, s=-1), _si("m/s2", m=1, s=-2), _si("m2", m=2), _si("mm2", 1e-6, m=2),
        _si("m3/s", m=3, s=-1), _si("rad", rad=1), _si("deg", _DEGREE, rad=1), _si("rad/s", rad=1, s=-1),
        _si("deg/s", _DEGREE, rad=1, s=-1), _si("rad/s2", rad=1, s=-2), _si("N", kg=1, m=1, s=-2),
        _si("kN", 1e3, kg=1, m=1, s=-2), _si("N/m", kg=1, s=-2), _si("N/(m/s)", kg=1, s=-1), _si("N.s/m", kg=1, s=-1),
        _si("N.m", kg=1, m=2, s=-2), _si("W", kg=1, m=2, s=-3), _si("kW", 1e3, kg=1, m=2, s=-3),
        _si("J", kg=1, m=2, s=-2), _si("Pa", kg=1, m=-1, s=-2), _si("bar", 1e5, kg=1, m=-1, s=-2), _si("A", A=1),
        _si("V", kg=1, m=2, s=-3, A=-1), _si("K", K=1), _si("degC", 1.0, 273.15, K=1),
    )
}  # fmt: skip
