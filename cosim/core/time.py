"""Exact time: every step and offset is a rational number of seconds, master time an integer count of ticks.

The base tick is the greatest common divisor of all steps and offsets in the system. Integer nanoseconds
cannot hold 1/60 s, a rational base tick can: 10^6 steps of 1 ms, or of 1/60 s, end exactly where they
should. Seconds are made from the exact rational by one correctly rounded division, never by adding up.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TypeVar

from build_fmus.base.checks import number
from cosim.core.errors import TimeError

TimeLike = int | float | str | Fraction
_Number = TypeVar("_Number", float, Fraction)

_UNITS = {
    "": Fraction(1),
    "s": Fraction(1),
    "ms": Fraction(1, 1000),
    "us": Fraction(1, 10**6),
    "ns": Fraction(1, 10**9),
    "min": Fraction(60),
}
SHORTEST, LONGEST = 1e-15, 1e12  # s; what is beyond is a mistake, and exact numbers of that size cost memory
MOST_TICKS = 2**50
_TEXT = re.compile(r"\s*([^\sa-zA-Z]+(?:[eE][-+]?\d+)?)\s*([a-zA-Z]*)\s*")


def rational(value: TimeLike, what: str = "time") -> Fraction:
    """Exact seconds from an int, a Fraction, a float (1e-3 means 1/1000, 1/60 means 1/60) or a text.

    Texts are "1/60", "0.001", "10 ms" or "60 Hz". Raises TimeError naming `what` for anything else.
    """
    if isinstance(value, str):
        return _bounded(_from_text(value, what), what)
    if isinstance(value, bool) or not isinstance(value, int | float | Fraction):
        try:
            value = float(value)
        except (TypeError, ValueError):
            raise TimeError(f"{what} must be a number of seconds or a text like '10 ms', not {value!r}") from None
    if isinstance(value, float):
        _bounded(number(what, value, "s", error=TimeError), what)
        return _nearest(value)
    return _bounded(Fraction(value), what)


def _nearest(value: float | Fraction) -> Fraction:
    """The simplest number that a float may stand for; a Fraction as it is."""
    if isinstance(value, Fraction):
        return value
    near = Fraction(value).limit_denominator(10**6)
    return near if float(near) == value else Fraction(repr(float(value)))


def _bounded(value: _Number, what: str) -> _Number:
    if value and not SHORTEST <= abs(value) <= LONGEST:
        size = "shorter" if abs(value) < SHORTEST else "longer"
        bound = SHORTEST if abs(value) < SHORTEST else LONGEST
        raise TimeError(f"{what} is {size} than {bound:g} s; give seconds")
    return value


def _from_text(text: str, what: str) -> Fraction:
    match = _TEXT.fullmatch(text) if len(text) <= 100 else None
    exponent = re.search(r"[eE]([-+]?\d+)", match[1]) if match else None
    try:
        if match is None or (exponent and abs(int(exponent[1])) > 100):
            raise ValueError(text)
        number, unit = Fraction(match[1]), match[2]
        if unit == "Hz":
            return 1 / number
        return number * _UNITS[unit]
    except (ValueError, KeyError, ZeroDivisionError):
        shown = text if len(text) <= 100 else text[:97] + "..."
        raise TimeError(f"{what}: cannot read {shown!r}; write seconds, or e.g. '10 ms', '1/60', '60 Hz'") from None


def positive(value: TimeLike, what: str) -> Fraction:
    """`rational`, refusing zero and negative values."""
    result = rational(value, what)
    if result <= 0:
        raise TimeError(f"{what} must be positive, not {value}")
    return result


def seconds_text(value: Fraction | float) -> str:
    """A duration [s] as text, exact: `0.001234567 s`, `1/60 s`."""
    digits = repr(float(value)).removesuffix(".0")
    exact = not math.isfinite(value) or Fraction(digits) == _nearest(value)
    return f"{digits if exact else _nearest(value)} s"


def gcd(values: list[Fraction]) -> Fraction:
    """Greatest common divisor of positive rationals; zeros are ignored."""
    result = Fraction(0)
    for value in values:
        if value:
            numerator = math.gcd(result.numerator * value.denominator, value.numerator * result.denominator)
            result = Fraction(numerator, result.denominator * value.denominator)
    return result


@dataclass(frozen=True)
class TimeBase:
    """Converts integer ticks to seconds. `tick` is the exact length of one tick [s], `start` the time of tick 0."""

    tick: Fraction
    start: Fraction = Fraction(0)

    def count(self, duration: Fraction) -> int:
        """Number of ticks in a duration that is a multiple of the tick."""
        ticks = duration / self.tick
        if ticks.denominator != 1:
            raise TimeError(
                f"{seconds_text(duration)} is not a multiple of the base tick of {seconds_text(self.tick)}, the"
                " greatest common divisor of all steps"
            )
        return self._limited(int(ticks), duration)

    def at_or_after(self, time: Fraction) -> int:
        """First tick at or after a time."""
        return self._limited(math.ceil((time - self.start) / self.tick), time)

    def _limited(self, ticks: int, time: Fraction) -> int:
        if abs(ticks) > MOST_TICKS:
            raise TimeError(
                f"{seconds_text(time)} takes {ticks:.3g} ticks of {seconds_text(self.tick)}, the greatest common"
                " divisor of all steps and offsets: give steps that divide each other better, as '1/30' instead of"
                " 0.0333333"
            )
        return ticks

    def exact(self, tick: int) -> Fraction:
        """Time of a tick, exact [s]."""
        return self.start + tick * self.tick

    def integers(self) -> tuple[int, int, int]:
        """(a, b, d) with time = (tick * a + b) / d: Python's integer division is correctly rounded."""
        return self._integers

    @cached_property
    def _integers(self) -> tuple[int, int, int]:
        d = math.lcm(self.tick.denominator, self.start.denominator)
        return int(self.tick * d), int(self.start * d), d

    def seconds(self, tick: int) -> float:
        """Time of a tick [s], the float nearest to the exact value."""
        a, b, d = self._integers
        return (tick * a + b) / d

    def nanoseconds(self, tick: int) -> int:
        """Time of a tick rounded to integer nanoseconds."""
        return round(self.exact(tick) * 10**9)
