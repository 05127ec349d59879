"""Units of FMU variables: name -> SI base-unit exponents, factor, offset, display units.

One table; `modelDescription.xml`, documentation and the declaration language read it. Notation follows the FMI
convention: ``.`` multiplies, ``/`` divides once, an integer behind a symbol is its exponent.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from build_fmus.checks import did_you_mean


@dataclass(frozen=True)
class DisplayUnit:
    """A unit for people: ``value_display = factor * value + offset``."""

    name: str
    factor: float
    offset: float = 0.0


@dataclass(frozen=True)
class Unit:
    """A unit as FMI declares it: ``value_SI = factor * value + offset`` in the given base units."""

    name: str
    exponents: dict[str, int] = field(default_factory=dict)
    factor: float = 1.0
    offset: float = 0.0
    display: tuple[DisplayUnit, ...] = ()


_DEG = 57.29577951308232  # 180 / pi


def _unit(name: str, display: tuple[DisplayUnit, ...] = (), **exponents: int) -> Unit:
    return Unit(name, exponents, display=display)


UNITS: dict[str, Unit] = {
    u.name: u
    for u in (
        _unit("1", (DisplayUnit("%", 100.0),)),
        _unit("m", (DisplayUnit("mm", 1000.0),), m=1),
        _unit("m2", m=2),
        _unit("m2/s", m=2, s=-1),
        _unit("m3", (DisplayUnit("l", 1000.0),), m=3),
        _unit("m3/s", (DisplayUnit("l/min", 60000.0),), m=3, s=-1),
        _unit("s", (DisplayUnit("ms", 1000.0),), s=1),
        _unit("1/s", s=-1),
        _unit("1/s2", s=-2),
        _unit("Hz", s=-1),
        _unit("kg", kg=1),
        _unit("kg.m2", kg=1, m=2),
        _unit("m/s", (DisplayUnit("km/h", 3.6),), m=1, s=-1),
        _unit("m/s2", m=1, s=-2),
        _unit("rad", (DisplayUnit("deg", _DEG),), rad=1),
        _unit("rad/s", (DisplayUnit("deg/s", _DEG),), rad=1, s=-1),
        _unit("rad/s2", (DisplayUnit("deg/s2", _DEG),), rad=1, s=-2),
        _unit("rad/m", rad=1, m=-1),
        _unit("rad.s/m", rad=1, s=1, m=-1),
        _unit("N", (DisplayUnit("kN", 1e-3),), kg=1, m=1, s=-2),
        _unit("N/s", kg=1, m=1, s=-3),
        _unit("N.m", (DisplayUnit("kN.m", 1e-3),), kg=1, m=2, s=-2),
        _unit("N/m", (DisplayUnit("N/mm", 1e-3),), kg=1, s=-2),
        _unit("N/m3", kg=1, m=-2, s=-2),
        _unit("N.s/m", (DisplayUnit("kN.s/m", 1e-3),), kg=1, s=-1),
        _unit("N/rad", kg=1, m=1, s=-2, rad=-1),
        _unit("1/m", m=-1),
        _unit("kg/m3", kg=1, m=-3),
        _unit("Pa", (DisplayUnit("bar", 1e-5), DisplayUnit("MPa", 1e-6)), kg=1, m=-1, s=-2),
        _unit("Pa/s", kg=1, m=-1, s=-3),
        _unit("Pa.s", kg=1, m=-1, s=-1),
        _unit("m5/(N.s)", kg=-1, m=4, s=1),
        _unit("W", (DisplayUnit("kW", 1e-3),), kg=1, m=2, s=-3),
        _unit("J", kg=1, m=2, s=-2),
        _unit("V", kg=1, m=2, s=-3, A=-1),
        _unit("V/m", kg=1, m=1, s=-3, A=-1),
    )
}


def _bare(name: str) -> str:
    """A unit without the signs that people leave out or write differently."""
    return name.translate(str.maketrans("", "", ".*·^ "))


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
        raise KeyError(f"unknown unit {name!r}{hint} (units are listed in build_fmus/units.py)") from None


def display_unit(unit_name: str, name: str) -> DisplayUnit:
    """The display unit ``name`` of ``unit_name``; KeyError with the choices when there is none."""
    for d in unit(unit_name).display:
        if d.name == name:
            return d
    choices = ", ".join(d.name for d in unit(unit_name).display) or "none"
    raise KeyError(f"unit {unit_name!r} has no display unit {name!r} (it has: {choices})")


def convert(value: float, given: str, wanted: str) -> float:
    """``value`` in unit or display unit ``given``, expressed in the unit ``wanted``.

    Raises:
        KeyError: the units do not measure the same thing, or ``given`` is unknown; the message says what is accepted.
    """
    target = unit(wanted)
    if given == wanted:
        return value
    for d in target.display:
        if d.name == given:
            return (value - d.offset) / d.factor
    if given in UNITS and UNITS[given].exponents == target.exponents:
        return (UNITS[given].factor * value + UNITS[given].offset - target.offset) / target.factor
    accepted = [wanted, *(d.name for d in target.display)]
    hint = did_you_mean(given, accepted)
    raise KeyError(f"unit {given!r} where {wanted!r} is expected (accepted: {', '.join(accepted)}){hint}")
