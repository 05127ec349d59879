"""Units: exponents of the SI base units, factor, offset, and the multiples in which people read and write values.

One table. Model descriptions, documentation, the declaration language, vehicle and road files and components in Python
read it; FMUs bring units of their own, described alike. Notation follows the FMI convention: `.` multiplies, `/`
divides once, an integer behind a symbol is its exponent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

from build_fmus.base.checks import did_you_mean

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class DisplayUnit:
    """A unit for people: `value_display = factor * value + offset`."""

    name: str
    factor: float
    offset: float = 0.0


@dataclass(frozen=True)
class Unit:
    """A unit as FMI declares it: `value_SI = factor * value + offset` in base units.

    `exponents` follow `BASE_UNITS`; None where an FMU does not define its unit.
    """

    name: str
    exponents: tuple[int, ...] | None = None
    factor: float = 1.0
    offset: float = 0.0
    display: tuple[DisplayUnit, ...] = ()

    @property
    def powers(self) -> dict[str, int]:
        """Exponents that are not 0, by base unit."""
        return {base: n for base, n in zip(BASE_UNITS, self.exponents or (), strict=False) if n}


_DEGREE = Fraction(math.pi / 180)
_MULTIPLES: dict[str, tuple[str, Fraction | int]] = {  # name -> the unit it is a multiple of, and which
    "%": ("1", Fraction(1, 100)),
    "mm": ("m", Fraction(1, 1000)),
    "cm": ("m", Fraction(1, 100)),
    "km": ("m", 1000),
    "in": ("m", Fraction(254, 10000)),
    "mm2": ("m2", Fraction(1, 10**6)),
    "l": ("m3", Fraction(1, 1000)),
    "l/min": ("m3/s", Fraction(1, 60000)),
    "ms": ("s", Fraction(1, 1000)),
    "km/h": ("m/s", Fraction(1000, 3600)),
    "deg": ("rad", _DEGREE),
    "deg/s": ("rad/s", _DEGREE),
    "deg/s2": ("rad/s2", _DEGREE),
    "kN": ("N", 1000),
    "kN.m": ("N.m", 1000),
    "N/mm": ("N/m", 1000),
    "N/(m/s)": ("N.s/m", 1),
    "kN.s/m": ("N.s/m", 1000),
    "bar": ("Pa", 10**5),
    "MPa": ("Pa", 10**6),
    "kW": ("W", 1000),
    "degC": ("K", 1),
}
_ZERO = {"degC": 273.15}  # multiples whose 0 is elsewhere: where, in the unit they are a multiple of


def _displayed(name: str) -> DisplayUnit:
    per = 1 / Fraction(_MULTIPLES[name][1])
    return DisplayUnit(name, float(per), 0.0 - float(per) * _ZERO.get(name, 0.0))


def _unit(name: str, *display: str, **exponents: int) -> Unit:
    return Unit(name, tuple(exponents.get(b, 0) for b in BASE_UNITS), display=tuple(map(_displayed, display)))


UNITS: dict[str, Unit] = {
    u.name: u
    for u in (
        _unit("1", "%"),
        _unit("m", "mm", m=1),
        _unit("m2", m=2),
        _unit("m2/s", m=2, s=-1),
        _unit("m3", "l", m=3),
        _unit("m3/s", "l/min", m=3, s=-1),
        _unit("s", "ms", s=1),
        _unit("1/s", s=-1),
        _unit("1/s2", s=-2),
        _unit("Hz", s=-1),
        _unit("kg", kg=1),
        _unit("kg.m2", kg=1, m=2),
        _unit("m/s", "km/h", m=1, s=-1),
        _unit("m/s2", m=1, s=-2),
        _unit("rad", "deg", rad=1),
        _unit("rad/s", "deg/s", rad=1, s=-1),
        _unit("rad/s2", "deg/s2", rad=1, s=-2),
        _unit("rad/m", rad=1, m=-1),
        _unit("rad.s/m", rad=1, s=1, m=-1),
        _unit("rad.s2/m", rad=1, s=2, m=-1),
        _unit("s/m", s=1, m=-1),
        _unit("N", "kN", kg=1, m=1, s=-2),
        _unit("N/s", kg=1, m=1, s=-3),
        _unit("N.m", "kN.m", kg=1, m=2, s=-2),
        _unit("N.m.s/rad", kg=1, m=2, s=-1, rad=-1),
        _unit("N/m", "N/mm", kg=1, s=-2),
        _unit("N/m3", kg=1, m=-2, s=-2),
        _unit("N.s/m", "kN.s/m", kg=1, s=-1),
        _unit("N/rad", kg=1, m=1, s=-2, rad=-1),
        _unit("1/m", m=-1),
        _unit("kg/m3", kg=1, m=-3),
        _unit("Pa", "bar", "MPa", kg=1, m=-1, s=-2),
        _unit("Pa/s", kg=1, m=-1, s=-3),
        _unit("Pa.s", kg=1, m=-1, s=-1),
        _unit("m5/(N.s)", kg=-1, m=4, s=1),
        _unit("W", "kW", kg=1, m=2, s=-3),
        _unit("J", kg=1, m=2, s=-2),
        _unit("V", kg=1, m=2, s=-3, A=-1),
        _unit("V/m", kg=1, m=1, s=-3, A=-1),
        _unit("A", A=1),
        _unit("K", K=1),
    )
}
"""What variables of our FMUs have: products of base units, with those of their multiples that tools display."""

KNOWN: dict[str, Unit] = UNITS | {
    name: Unit(name, UNITS[of].exponents, float(size), _ZERO.get(name, 0.0)) for name, (of, size) in _MULTIPLES.items()
}
"""What users may write: the above, and all multiples."""


def _bare(name: str) -> str:
    """A unit without the signs that people leave out or write differently."""
    return name.translate(str.maketrans("", "", ".*·^ "))


def meant(text: str) -> Unit | None:
    """The unit of the table that a text means: `[m]` is m, `N*m` is N.m. None where the table has none."""
    bare = _bare(text.strip().removeprefix("[").removesuffix("]"))
    return next((u for name, u in KNOWN.items() if _bare(name) == bare), None)


def unit(name: str) -> Unit:
    """Look up a unit.

    Raises:
        KeyError: the unit is not in the table; the message proposes the nearest one.
    """
    try:
        return UNITS[name]
    except KeyError:
        same = [u for u in UNITS if _bare(u) == _bare(name)]  # Nm, N*m -> N.m
        hint = did_you_mean(name, same or UNITS)
        raise KeyError(f"unknown unit {name!r}{hint} (units are listed in build_fmus/base/units.py)") from None


def display_unit(unit_name: str, name: str) -> DisplayUnit:
    """The display unit `name` of `unit_name`. Raises KeyError with the choices for an unknown name."""
    for d in unit(unit_name).display:
        if d.name == name:
            return d
    choices = ", ".join(d.name for d in unit(unit_name).display) or "none"
    raise KeyError(f"unit {unit_name!r} has no display unit {name!r} (it has: {choices})")


def derivative(of: Unit) -> str | None:
    """Name of the unit of a time derivative; None where the table has none."""
    powers = {**of.powers, "s": of.powers.get("s", 0) - 1}
    same = (u.name for u in UNITS.values() if u.powers == {base: n for base, n in powers.items() if n})
    return next(same, None)


def convert(value: float, given: str, to: str) -> float:
    """`value` in the unit `given`, converted to the unit `to`, a unit of variables.

    Raises:
        KeyError: the units do not measure the same thing, or `given` is unknown; the message says what is accepted.
    """
    exponents = unit(to).exponents
    accepted = [u.name for u in KNOWN.values() if u.exponents == exponents]
    if given not in accepted:
        accepted.sort(key=to.__ne__)
        hint = did_you_mean(given, accepted)
        raise KeyError(f"unit {given!r} where {to!r} is expected (accepted: {', '.join(accepted)}){hint}")
    if given in UNITS:
        return value
    d = _displayed(given)
    return (value - d.offset) / d.factor


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
