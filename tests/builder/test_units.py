"""The table of units: multiples agree with what they are multiples of, in both directions."""

from __future__ import annotations

import math

import pytest

from build_fmus.base.units import KNOWN, UNITS, conversion, convert, derivative, display_unit, unit

MULTIPLES = sorted(KNOWN.keys() - UNITS.keys())


@pytest.mark.parametrize("name", MULTIPLES)
def test_what_users_write_is_converted_as_between_fmus(name: str) -> None:
    of = next(u for u in UNITS.values() if u.exponents == KNOWN[name].exponents)
    scale, offset = conversion(KNOWN[name], of)
    assert convert(12.5, name, of.name) == pytest.approx(scale * 12.5 + offset, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "given", "wanted", "found"),
    [
        (35.0, "cm", "m", 0.35),
        (18.0, "km/h", "m/s", 5.0),
        (350.0, "N/mm", "N/m", 350e3),
        (180.0, "deg", "rad", math.pi),
        (2.0, "bar", "Pa", 2e5),
        (30.0, "l/min", "m3/s", 0.0005),
        (20.0, "degC", "K", 293.15),
        (7.0, "N/(m/s)", "N.s/m", 7.0),
        (3.0, "1/s", "Hz", 3.0),
        (50.0, "%", "1", 0.5),
    ],
)
def test_values(value: float, given: str, wanted: str, found: float) -> None:
    assert convert(value, given, wanted) == pytest.approx(found, rel=1e-15)


def test_display_units_are_the_inverse(raises) -> None:
    for u in UNITS.values():
        for d in u.display:
            assert convert(d.factor, d.name, u.name) == 1.0
            assert d.factor * KNOWN[d.name].factor == pytest.approx(1.0, rel=1e-15)
    with raises(KeyError):
        display_unit("m", "cm")


def test_what_measures_something_else_is_refused_with_what_is_accepted(raises) -> None:
    # other tests may have added to the accepted units
    with pytest.raises(KeyError, match=r"'mmm' .* 'm' .*\(accepted: m, mm, cm, km[^)]*\); .*'mm'"):
        convert(1.0, "mmm", "m")
    with raises(KeyError):
        unit("Nm")


def test_units_of_time_derivatives() -> None:
    found = {name: derivative(unit(name)) for name in ("m", "rad/s", "1", "Pa", "W")}
    assert found == {"m": "m/s", "rad/s": "rad/s2", "1": "1/s", "Pa": "Pa/s", "W": None}
