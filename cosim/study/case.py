"""Cases: one run of an experiment as a frozen dataclass, whose fields are options for people and machines.

    @dataclass(frozen=True)
    class Ride(Case):
        road: str = option("sine", choices=ROADS, help="road under the wheels", always=True)
        speed: float = option(50.0, unit="km/h", within=(5, 120), help="speed", label="{:g}kmh")

From a field come its command-line option with help and checks, its part of the key of a stored run, of the run's label,
and of the tables and figures of a report.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import inspect
import itertools
import json
import re
import types
import typing
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeVar

from build_fmus.base import surface
from build_fmus.base.checks import number, short, unknown
from cosim.core.errors import CosimError


class CaseError(CosimError, ValueError):
    """A run that does not exist; the message says which choice is wrong and what there is."""


@dataclass(frozen=True)
class Option:
    """What a field of a case carries; see `option`."""

    help: str = ""
    unit: str = ""
    within: tuple[float, float] | None = None
    choices: Collection[Any] | None = None
    files: str = ""
    name: str = ""
    aliases: tuple[str, ...] = ()
    label: str | Callable[[Any], str] = "{}"
    always: bool = False
    only: tuple[Callable[[Any], bool], str] | None = None


@dataclass(frozen=True)
class Field:
    """A field of a class of cases: Python name, type without None, default, and the settings of `option`."""

    attribute: str
    type: type
    optional: bool
    default: Any
    option: Option

    @property
    def name(self) -> str:
        """As people write it: the long option without its dashes."""
        return self.option.name or self.attribute.replace("_", "-")

    @property
    def text(self) -> str:
        """For headings: name and unit."""
        words = self.name.replace("-", " ")
        return f"{words} [{self.option.unit}]" if self.option.unit else words


def option(
    default: Any,
    *,
    help: str,
    unit: str = "",
    within: tuple[float, float] | None = None,
    choices: Collection[Any] | None = None,
    files: str = "",
    name: str = "",
    aliases: tuple[str, ...] = (),
    label: str | Callable[[Any], str] = "{}",
    always: bool = False,
    only: tuple[Callable[[Any], bool], str] | None = None,
) -> Any:
    """A field of a case.

    Args:
        default: value when nothing is said; None for "as in the FMU".
        help: one line for people, without the unit.
        unit: of a number.
        within: smallest and largest number, both included.
        choices: all values that exist, of a text or a whole number.
        files: suffix (".fmu") of files that may be named besides the choices.
        name: of the command-line option where it is not the field's.
        aliases: earlier names of the option, which still work.
        label: how the value stands in the run's label: a format, or a function of the value.
        always: whether it stands there also when it is the default.
        only: where the field means something, a function of the case, and that in words: "the explicit controller".
            Elsewhere every value but the default is refused.
    """
    found = Option(help, unit, within, choices, files, name, aliases, label, always, only)
    return dataclasses.field(default=default, metadata={"option": found})


@dataclass(frozen=True)
class Case:
    """Base of a class of cases: a case that exists is one that can be run.

    Raises:
        CaseError: a value that is of the wrong type, no choice, out of range, or has no meaning beside the others.
    """

    def __post_init__(self) -> None:
        check(self)

    @property
    def label(self) -> str:
        """What tells this run's files from those of others."""
        return label(self)


C = TypeVar("C")


def fields(case: type) -> tuple[Field, ...]:
    """Fields of a class of cases in their order.

    Raises:
        CaseError: a field of a type that no option has, or without a default.
    """
    if case not in _FIELDS:
        _FIELDS[case] = _fields(case)
    return _FIELDS[case]


_FIELDS: dict[type, tuple[Field, ...]] = {}


def _fields(case: Any) -> tuple[Field, ...]:
    name = getattr(case, "__name__", repr(case))
    if not dataclasses.is_dataclass(case):
        raise CaseError(f"{name} is no dataclass; a case is a frozen dataclass with fields made by option(...)")
    types_ = typing.get_type_hints(case)
    found = []
    for f in sorted(dataclasses.fields(case), key=lambda f: bool(f.kw_only)):  # as in the arguments
        kind, optional = _plain(types_[f.name])
        if kind not in (str, int, float, bool):
            raise CaseError(f"{name}.{f.name}: a field is a str, int, float or bool, not {types_[f.name]}")
        if f.default is dataclasses.MISSING:
            raise CaseError(f"{name}.{f.name} needs a default, so that every case can be named by its differences")
        found.append(
            Field(f.name, kind, optional, f.default, f.metadata.get("option", Option(f.name.replace("_", " "))))
        )
    return tuple(found)


def _plain(hint: Any) -> tuple[type, bool]:
    """Type behind an annotation, and whether None is allowed: `float | None`, `Literal["a", "b"]`."""
    optional = False
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        arguments = [a for a in typing.get_args(hint) if a is not type(None)]
        optional = len(arguments) < len(typing.get_args(hint))
        hint = arguments[0] if len(arguments) == 1 else hint
    if typing.get_origin(hint) is typing.Literal:
        hint = type(typing.get_args(hint)[0])
    return hint, optional


def check(case: Any) -> None:
    """Refuse a case with a value that cannot be; see `Case`."""
    for f in fields(type(case)):
        value = getattr(case, f.attribute)
        if not (value is None and f.optional):
            _check_value(f, value)
        where = f.option.only
        if where is not None and value != f.default and not where[0](case):
            raise CaseError(f"{_spelled(f)} is for {where[1]} only")


def _spelled(f: Field) -> str:
    return surface.name_of(f.attribute, f.name)


def _check_value(f: Field, value: Any) -> None:
    about, words = f.option, f.name.replace("-", " ")
    accepted = (int, float) if f.type is float else f.type
    if not isinstance(value, accepted) or (isinstance(value, bool) and f.type is not bool):
        kinds = {str: "a text", int: "a whole number", float: "a number", bool: "True or False"}
        raise CaseError(f"{_spelled(f)} {value!r}: give {kinds[f.type]}")
    if about.choices is not None and not (about.files and isinstance(value, str) and value.endswith(about.files)):
        beside = f"; or a file NAME{about.files}" if about.files else ""
        check_choice(words, value, about.choices, beside)
    if isinstance(value, int | float) and not isinstance(value, bool):
        low, high = about.within or (None, None)
        number(_spelled(f), value, about.unit, least=low, most=high, error=CaseError)


def check_choice(what: str, value: Any, known: Collection[Any], beside: str = "") -> None:
    """Refuse `value` unless it is one of `known`; `beside` ends the message.

    Raises:
        CaseError: names the nearest choice and all of them.
    """
    if value not in known:
        raise CaseError(unknown(what, value, known) + beside)


def label(case: Any) -> str:
    """The values of a case that tell it from others, joined by dashes; "default" when there are none.

    Two cases of a class have different labels, also where upper and lower case are the same, and a label is a name for
    files. A text that other cases could have as well, or that no file can have, ends with eight digits of a hash of the
    case.
    """
    pieces = [(f, getattr(case, f.attribute)) for f in fields(type(case))]
    pieces = [(f, v) for f, v in pieces if _is_labeled(f, v) and not (f.option.only and not f.option.only[0](case))]
    text = "-".join(_labeled(f, v) for f, v in pieces) or "default"
    exact = all(_is_exact(f, v) for f, v in pieces) and (text != "default" or not pieces) and not _HASHED.search(text)
    named = exact and _FILE_NAME.fullmatch(text) and len(text) <= LONGEST
    if named and _readings(type(case), text.lower()) == 1:  # type: ignore[arg-type]
        return text
    return _with_hash(text, case)


LONGEST = 120  # letters of a label; file systems take 255 bytes with folder and ending
_FILE_NAME = re.compile(r"(?!(con|prn|aux|nul|com\d|lpt\d)(\.|$))[\w.+=, -]*[\w+=,-]", re.ASCII | re.IGNORECASE)
_HASHED = re.compile(r"-[0-9a-f]{8}$", re.IGNORECASE)
_NUMBER = re.compile(r"(?:(?<!\w)[-+])?\d+(?:\.\d+)?(?:e[-+]?\d+)?", re.IGNORECASE)


def file_name(case: Any) -> str:
    """The label of a case as a name for files, also where its class has a `label` of its own."""
    own = str(getattr(case, "label", None) or label(case))
    safe = own == label(case) or (own == own.lower() and _FILE_NAME.fullmatch(own) and len(own) <= LONGEST)
    return own if safe else _with_hash(own, case)


def _with_hash(text: str, case: Any) -> str:
    digest = hashlib.sha256(json.dumps(values(case), sort_keys=True).encode()).hexdigest()[:8]
    return f"{re.sub(r'[^A-Za-z0-9_.+=, -]', '_', text)[:80]}-{digest}"


def _is_labeled(f: Field, value: Any) -> bool:
    if value is None:
        return f.default is not None
    return f.option.always or value != f.default


def _labeled(f: Field, value: Any) -> str:
    form = f.option.label
    if value is None or value is False:
        return f"no-{f.name}"
    if callable(form):
        return str(form(value))
    if f.option.files and isinstance(value, str) and value.endswith(f.option.files):
        value = Path(value).stem
    if form == "{}" and f.type in (int, float):
        return f"{f.name}-{short(value)}"
    if form == "{}" and f.type is bool:
        return f.name
    return form.format(value)


def _is_exact(f: Field, value: Any) -> bool:
    """Whether no other value of the field has the same text, and a label can be split where it begins and ends."""
    text = _labeled(f, value).lower()
    if value is None or f.type is bool:
        return True
    if f.option.choices is not None:
        texts = [_labeled(f, c).lower() for c in f.option.choices]
        if value in f.option.choices:
            return texts.count(text) == 1
        return value == text + f.option.files and text not in texts and "-" not in text
    if f.type is str:
        return value == text and "-" not in text
    numbers, scale = _NUMBER.findall(text), _scale(f)
    return bool(len(numbers) == 1 and scale and f.type(Decimal(numbers[0]) / scale) == value)


def _scale(f: Field) -> Decimal | None:
    """The number in the text of the value 1, with which a format or function multiplies; None if there is not one."""
    try:
        numbers = _NUMBER.findall(_labeled(f, f.type(1)))
    except Exception:  # of the user's function
        return None
    return Decimal(numbers[0]) if len(numbers) == 1 else None


@functools.lru_cache(maxsize=4096)
def _readings(case: type, text: str) -> int:
    """In how many ways a label in lower case can be split into texts of the fields of a class of cases."""
    known = fields(case)

    @functools.cache
    def ways(i: int, rest: str | None) -> int:
        if i == len(known):
            return rest is None
        f = known[i]
        left_out = not f.option.always or f.optional or f.option.only is not None
        found = ways(i + 1, rest) if left_out else 0
        for end in [] if rest is None else [*(m.start() for m in re.finditer("-", rest)), len(rest)]:
            if _may_be(f, rest[:end]):  # type: ignore[index]
                found += ways(i + 1, rest[end + 1 :] if end < len(rest) else None)  # type: ignore[index, arg-type]
        return found

    return ways(0, None if text == "default" else text)


def _may_be(f: Field, text: str) -> bool:
    """Whether some value of the field has this text, and is exact."""
    if (f.optional or f.type is bool) and text == f"no-{f.name}".lower():
        return True
    if f.type is bool:
        return text == _labeled(f, True).lower()
    if f.option.choices is not None:
        return bool(f.option.files and "-" not in text) or text in (_labeled(f, c).lower() for c in f.option.choices)
    if f.type is str:
        return "-" not in text
    return _scale(f) is not None and _NUMBER.sub("#", text) == _NUMBER.sub("#", _labeled(f, f.type(1)).lower())


def values(case: Any) -> dict[str, Any]:
    """A case as JSON values by field; whole numbers in fields of real ones count as real."""
    found = {}
    for f in fields(type(case)):
        value = getattr(case, f.attribute)
        found[f.attribute] = float(value) if f.type is float and value is not None else value
    return found


def named_files(case: Any) -> list[Path]:
    """Files that a case names, in the order of its fields; see `files` of `option`."""
    named = ((f.option.files, getattr(case, f.attribute)) for f in fields(type(case)))
    return [Path(v) for suffix, v in named if suffix and isinstance(v, str) and v.endswith(suffix)]


def grid(case: type[C], **axes: Iterable[Any]) -> list[C]:
    """All combinations of values of some fields, the last varying fastest: `grid(Ride, speed=(30, 50), road=ROADS)`.

    Raises:
        CaseError: no such field, or a combination that cannot be run.
    """
    known = [f.attribute for f in fields(case)]
    for name in axes:
        check_choice(f"field of {case.__name__}", name, known)
    return [case(**dict(zip(axes, point, strict=True))) for point in itertools.product(*axes.values())]


def case_of(function: Callable[..., Any]) -> type[Case]:
    """The class of cases behind a function's keyword arguments: `def system(speed: float = 50.0)`.

    A default may be an `option`.

    Raises:
        CaseError: an argument without default, or of a type that no option has.
    """
    made: list[tuple[str, Any, Any]] = []
    for name, p in inspect.signature(function, eval_str=True).parameters.items():
        if p.kind in (p.VAR_KEYWORD, p.VAR_POSITIONAL, p.POSITIONAL_ONLY) or p.default is p.empty:
            raise CaseError(
                f"{function.__name__}(): argument '{name}' needs a name and a default: it is an option of the runs"
            )
        given = p.default
        default = given.default if isinstance(given, dataclasses.Field) else given
        kind = p.annotation if p.annotation is not p.empty else type(default)
        made.append(
            (name, kind, given if isinstance(given, dataclasses.Field) else option(given, help=name.replace("_", " ")))
        )
    return dataclasses.make_dataclass(
        "Case", made, bases=(Case,), frozen=True, namespace={"__module__": function.__module__}
    )


def differing(cases: Iterable[Any]) -> list[Field]:
    """Fields in which the cases of a study are not all alike."""
    cases = list(cases)
    return [f for f in fields(type(cases[0])) if len({getattr(c, f.attribute) for c in cases}) > 1] if cases else []
