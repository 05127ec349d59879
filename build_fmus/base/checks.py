"""Checks of what people give: numbers within their limits, and the names that somebody who mistyped one may have meant.

Every message names what was given and says what is accepted.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def nearest(name: object, known: Iterable[object]) -> list[str]:
    """The best match among the known names, and at most two that are about as close.

    Without a close match: the names that contain `name`, at most three.
    """
    given, candidates = str(name), [str(k) for k in known]
    best = difflib.get_close_matches(given, candidates, n=1, cutoff=0.5)
    if not best:
        return [c for c in candidates if given.lower() in c.lower()][:3]
    similarity = difflib.SequenceMatcher(None, best[0], given).ratio()
    return difflib.get_close_matches(given, candidates, n=3, cutoff=similarity - 0.05)


def did_you_mean(name: object, known: Iterable[object]) -> str:
    """`"; did you mean 'a' or 'b'?"` for the nearest known names, else an empty string."""
    near = nearest(name, known)
    return "; did you mean " + " or ".join(f"'{n}'" for n in near) + "?" if near else ""


def unknown(what: str, value: object, known: Iterable[object]) -> str:
    """The error message for an unknown value."""
    names = list(map(str, known))
    return f"no {what} {value!r}{did_you_mean(value, names)} (there are: {', '.join(names)})"


def one_line(text: str, longest: int = 300) -> str:
    """A stranger's text, for a message: cut where it is long, without line breaks and signs that steer a terminal."""
    cut = text if len(text) <= longest else text[: longest - 3] + "..."
    if cut.isprintable():
        return cut
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "replace").decode() for c in cut)


def plain(message: str) -> str:
    """A message with strangers' texts in it, line by line: long words and lines cut, no signs that steer a terminal."""
    return "\n".join(one_line(_LONG_WORD.sub(r"\1...", line), 2000) for line in message.split("\n"))


_LONG_WORD = re.compile(r"(\S{200})\S{300,}")  # longer than paths are


def number(
    what: str,
    value: float,
    unit: str = "",
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    error: type[Exception] = ValueError,
) -> float:
    """The value, which is finite, larger than `above`, and neither below `least` nor above `most`.

    Raises:
        ValueError: (or `error`) it is not; the message names `what`, the value and what is accepted, with the unit.
    """
    try:
        is_finite = math.isfinite(value)
    except TypeError:
        raise error(f"{what} is {value!r}; give a number") from None
    within = (above is None or value > above) and (least is None or value >= least) and (most is None or value <= most)
    if is_finite and within:
        return value
    unit = f" {unit}" if unit else ""
    if least is not None and most is not None:
        accepted = f"a number from {short(least)} to {short(most)}{unit}"
    else:
        bounds = (("above", above), ("of at least", least), ("of at most", most))
        accepted = "a finite number" + "".join(f" {words} {short(b)}{unit}" for words, b in bounds if b is not None)
    raise error(f"{what} is {short(value)}{unit}; give {accepted}")


def whole_number(what: str, value: int, *, least: int = 1, error: type[Exception] = ValueError) -> int:
    """The value as an int of at least `least`; raises `error` for anything else, also for a Boolean."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise error(f"{what} is {value!r}; give a whole number of at least {least}")
    return int(value)


def finite(what: str, values: Array, *, sampled: bool = False, error: type[Exception] = ValueError) -> None:
    """Refuse an array with a value that is not finite.

    The message names the first such value by its indices, and by its sample where the first axis is time (`sampled`).
    """
    bad = np.argwhere(~np.isfinite(values))
    if not len(bad):
        return
    first = [int(k) for k in bad[0]]
    sample, place = (f" at sample {first[0]}", first[1:]) if sampled else ("", first)
    raise error(f"{what}{place or ''} is {values[tuple(first)]}{sample}")


def short(value: float) -> str:
    """Few digits, but no two numbers alike."""
    text = f"{value:g}"
    return text if float(text) == value or not math.isfinite(value) else str(value)


def glob(pattern: str) -> Callable[[str], Any]:
    """Predicate for names; only * and ? are special, brackets are part of names."""
    text = re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".")
    return re.compile(text).fullmatch
