"""What is said about numbers and names that cannot be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from build_fmus.base.checks import did_you_mean, finite, nearest, number, short, whole_number


class OwnError(Exception):
    """As each room has one."""


def test_near_names_are_proposed() -> None:
    assert did_you_mean("heigth", ["height", "rate"]) == "; did you mean 'height'?"
    assert did_you_mean("hight", ["height", "light", "rate"]) == "; did you mean 'height'?"
    assert did_you_mean("fast", ["past", "vast", "rate"]) == "; did you mean 'vast' or 'past'?"
    assert did_you_mean("rate", ["height"]) == ""
    assert did_you_mean(3.1, [3.0, 20.0]) == "; did you mean '3.0'?"


def test_names_that_hold_what_was_given_are_near() -> None:
    names = [f"body.acceleration.{k}" for k in "xyzw"]
    assert nearest("Body", names) == names[:3]


@pytest.mark.parametrize(
    ("value", "limits", "words"),
    [
        (math.nan, {}, "a finite number"),
        (-math.inf, {"most": 3}, "a finite number of at most 3 m"),
        (math.nan, {"least": 0, "most": 3}, "a number from 0 to 3 m"),
        (math.inf, {"above": 0}, "a finite number above 0 m"),
        (0.0, {"above": 0}, "a finite number above 0 m"),
        (-0.1, {"least": 0}, "a finite number of at least 0 m"),
        (-0.1, {"least": 0, "most": 3}, "a number from 0 to 3 m"),
        (3.1, {"least": 0, "most": 3}, "a number from 0 to 3 m"),
        (3.1, {"most": 3}, "a finite number of at most 3 m"),
    ],
)
def test_numbers_beyond_their_limits_are_refused(value, limits, words) -> None:
    with pytest.raises(OwnError) as refused:
        number("travel", value, "m", **limits, error=OwnError)
    assert str(refused.value) == f"travel is {value:g} m; give {words}"


def test_numbers_at_their_limits_are_returned() -> None:
    assert number("travel", 0.0, least=0, most=3) == 0
    assert number("travel", 3, least=0, most=3) == 3
    assert number("travel", 5e-324, above=0) == 5e-324


@pytest.mark.parametrize("value", ["1e-3", None, [1.0], 1j])
def test_what_is_no_number_is_refused(value: object) -> None:
    with pytest.raises(OwnError) as refused:
        number("travel", value, "m", least=0, error=OwnError)  # type: ignore[arg-type]
    assert str(refused.value) == f"travel is {value!r}; give a number"


def test_without_a_unit_none_is_told(raises) -> None:
    with raises(ValueError):
        number("ratio", -1, above=0)


@pytest.mark.parametrize("value", [0, True, 1.0, "1", math.nan])
def test_what_is_no_whole_number_is_refused(value, raises) -> None:
    with raises(OwnError, match=f"{value!r}"):
        whole_number("order", value, error=OwnError)


def test_whole_numbers_are_returned_as_int() -> None:
    assert type(whole_number("order", np.int32(1))) is int  # type: ignore[arg-type]
    assert whole_number("order", 0, least=0) == 0


def test_the_first_value_that_is_not_finite_is_named() -> None:
    finite("x", np.ones((2, 2)))
    values = np.array([[1.0, 2.0], [math.inf, math.nan]])
    for array, sampled, words in (
        (values, False, r"x\[1, 0\] is inf"),
        (values, True, r"x\[0\] is inf at sample 1"),
        (values[1:, 1], True, "x is nan at sample 0"),
        (values[1, 1], False, "x is nan"),
    ):
        with pytest.raises(OwnError, match=f"^{words}$"):
            finite("x", array, sampled=sampled, error=OwnError)


def test_short_numbers_are_told_apart() -> None:
    assert [short(x) for x in (1.0, 0.1, 1 / 3, 1234567.0, math.inf, math.nan)] == [
        "1",
        "0.1",
        "0.3333333333333333",
        "1234567.0",
        "inf",
        "nan",
    ]
