"""Curves as text: width, ends, peaks, and terminals without Braille."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.study.curve import HEIGHT, bars, drawn

T = np.linspace(0.0, 10.0, 5001)


def dots(text):
    """Rows and columns of the dots, from the top left."""
    found = []
    for row, line in enumerate(text.splitlines()[1 : HEIGHT + 1]):
        for column, character in enumerate(line.partition("│")[2]):
            bits = ord(character) - 0x2800 if character != " " else 0
            for bit, (r, c) in enumerate([(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1), (3, 0), (3, 1)]):
                if bits >> bit & 1:
                    found.append((4 * row + r, 2 * column + c))
    return np.array(found)


@pytest.mark.parametrize("width", [40, 80, 133])
@pytest.mark.parametrize("plain", [False, True])
def test_as_wide_as_the_terminal_and_no_wider(width, plain):
    lines = drawn("car.body.az [m/s2]", T, np.sin(T), width, plain=plain).splitlines()
    assert len(lines) == HEIGHT + 2
    assert lines[0] == "car.body.az [m/s2]"
    assert max(map(len, lines)) == width
    assert lines[1].split()[0] == "1"
    assert lines[HEIGHT].split()[0] == "-1"
    assert lines[-1].split() == ["0", "10", "s"]
    if plain:
        assert "\n".join(lines).isascii()


def test_a_rising_line_rises_from_corner_to_corner():
    found = dots(drawn("a", T, T, 60))
    assert found[found[:, 1].argmin()][0] == 4 * HEIGHT - 1
    assert found[found[:, 1].argmax()][0] == 0
    last = found[:, 1].max()
    heights = [found[found[:, 1] == c][:, 0].mean() for c in range(last + 1)]
    assert np.all(np.diff(heights) <= 0)


def test_a_peak_of_one_sample_is_seen():
    values = np.zeros(len(T))
    values[1234] = 7.0
    text = drawn("a", T, values, 60)
    assert text.splitlines()[1].split()[0] == "7"
    top = [c for r, c in dots(text) if r == 0]
    assert top == [int(1234 / 5000 * 2 * (60 - 3))]


def test_constants_gaps_and_nothing(raises):
    assert drawn("a", [0.0, 1.0], [3.0, 3.0], 40).splitlines()[1].split()[0] == "3"
    assert len(dots(drawn("a", [0.0, 1.0, 2.0], [0.0, np.nan, 1.0], 40))) == 2
    with raises(ValueError):
        drawn("a", [0.0], [np.nan], 40)


@pytest.mark.parametrize("plain", [False, True])
def test_bars_are_as_long_as_what_they_stand_for(plain: bool) -> None:
    """70 columns: 52 for the bars where the longest name has 9 letters.

    The whole is at the longest bar, twice the whole at most.
    """
    full, mark, beyond = "#|>" if plain else "█│▶"
    lines = bars({"half": 0.5, "a quarter": 0.25, "whole": 1.0, "nothing": 0.0}, 70, plain=plain).splitlines()
    assert [line.count(full) for line in lines] == [26, 13, 52, 0]
    assert [line.find(mark) for line in lines] == [61, 61, -1, 61]
    assert [line.rstrip(" %").split()[-1] for line in lines] == ["50", "25", "100", "0"]
    assert max(map(len, lines)) <= 70
    more = bars({"half": 0.5, "five": 5.0, "two": 2.0}, 60, plain=plain).splitlines()
    assert [line.count(full) for line in more] == [12, 46, 47]
    assert [beyond in line for line in more] == [False, True, False]
    assert more[1].endswith("500 %")


def test_bars_that_cannot_be_drawn(raises) -> None:
    for bad in ({}, {"a": -1.0}, {"a": float("nan")}):
        with raises(ValueError):
            bars(bad, 80)
    assert "a very long name of a metri..." in bars(
        {"a very long name of a metric that nobody reads": 1.0, "b": 0.1}, 60
    )
