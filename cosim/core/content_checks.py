"""Checks of what reports and scenes are made of; errors say where and what."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TypeVar, get_args

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import unknown

Array = npt.NDArray[np.float64]
Scalar = str | bool | int | float | None
T = TypeVar("T")

_ID = re.compile(r"[a-z0-9][a-z0-9_-]*")
_LABEL = re.compile(r"(?P<quantity>\S.*) \[(?P<unit>[^\[\]]+)\]", re.DOTALL)
# brackets in the unit, too, which an FMU of anybody names
_WITH_BRACKETS = re.compile(r"(?P<quantity>\S.*?) \[(?P<unit>.+)\]", re.DOTALL)


UNKNOWN = "?"
"""The unit in the label of a quantity whose unit nobody gave; it is not drawn. "-" is the unit of a quantity without
dimension.
"""


def label_of(quantity: str, unit: str) -> str:
    """A label, "pitch [deg]"; without a unit one that is drawn as "pitch"."""
    return f"{quantity} [{unit or UNKNOWN}]"


def drawn_label(label: str) -> str:
    """A label as people read it."""
    return label.removesuffix(f" [{UNKNOWN}]")


def split_label(label: str, where: str = "label") -> tuple[str, str]:
    """("pitch", "deg") from "pitch [deg]"."""
    match = _LABEL.fullmatch(label) or _WITH_BRACKETS.fullmatch(label)
    if match is None:
        raise ValueError(f"{where}: label '{label}' carries no unit; write 'pitch [deg]', or 'ratio [-]' without one")
    return match["quantity"], match["unit"]


def assign(target: object, name: str, value: object) -> None:
    """Set an attribute of a frozen dataclass."""
    object.__setattr__(target, name, value)


def check_id(where: str, identifier: str) -> None:
    """Raise ValueError unless an identifier can name a file."""
    if not _ID.fullmatch(identifier):
        raise ValueError(f"{where}: an id names a file; use lower-case letters, digits, '-' and '_' only")


def check_choice(where: str, name: str, value: object, choices: object) -> None:
    """Raise ValueError unless a value is one of the choices, a `Literal` type."""
    if value not in get_args(choices):
        raise ValueError(f"{where}: {unknown(name, value, get_args(choices))}")


def check_text(where: str, **texts: str) -> None:
    """Raise ValueError for a text that is empty."""
    for name, text in texts.items():
        if not isinstance(text, str) or not text.strip():
            raise ValueError(f"{where}: '{name}' is empty")


def check_unique(where: str, kind: str, names: Iterable[str]) -> None:
    """Raise ValueError for names that appear more than once."""
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ValueError(f"{where}: {kind} {', '.join(repr(n) for n in twice)} appears more than once")


def items(where: str, name: str, values: Iterable[T], kind: type | tuple[type, ...]) -> tuple[T, ...]:
    """Values as a tuple; raises ValueError unless all are of a kind."""
    if isinstance(values, str):
        raise ValueError(f"{where}: '{name}' is one text; give a list")
    items = tuple(values)
    expected = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
    for item in items:
        if not isinstance(item, kind):
            raise ValueError(f"{where}: '{name}' holds {item!r}, which is no {expected}")
    return items


def curve(where: str, name: str, values: npt.ArrayLike) -> Array:
    """Values as a read-only array (n,); raises ValueError if they are no list of numbers."""
    try:
        curve = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {name} is not a list of numbers ({error})") from None
    if curve.ndim != 1:
        raise ValueError(f"{where}: {name} has shape {curve.shape}; a curve has one dimension")
    curve.setflags(write=False)
    return curve


def plain_value(where: str, value: object) -> Scalar:
    """The value as text, Boolean, number or None; numpy scalars become Python's."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise ValueError(f"{where}: {value!r} is neither text nor a number")


def plain_tree(where: str, value: object) -> object:
    """The value with plain texts, Booleans, numbers and None in dicts and lists; raises ValueError for others."""
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise ValueError(f"{where}: key {key!r} is no text")
        return {key: plain_tree(f"{where}, '{key}'", item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain_tree(where, item) for item in value]
    return plain_value(where, value)
