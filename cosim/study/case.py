"""Cases: one run of an experiment as a frozen dataclass, whose fields carry what people and machines need to know of them.

    @dataclass(frozen=True)
    class Ride(Case):
        road: str = option("sine", choices=ROADS, help="road under the wheels", always=True)
        speed: float = option(50.0, unit="km/h", within=(5, 120), help="speed", label="{:g}kmh")

From a field come its command-line option with help and checks, its part of the key of a stored run, of the run's label, and
of the tables and figures of a report.
"""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import types
import typing
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from build_fmus.checks import number, short, unknown


class CaseError(ValueError):
    """A run that does not exist; the message says which choice is wrong and what there is."""


@dataclass(frozen=True)
class Option:
    """What a field of a case carries; see :func:`option`."""

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
    """A field of a class of cases: its name in Python, its type without None, its default, and what :func:`option` says of it."""

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
        only: where the field means something, a function of the case, and that in words: "the explicit controller". Elsewhere
            every value but the default is refused.
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
    """Type behind an annotation, and whether None is allowed: ``float | None``, ``Literal["a", "b"]``."""
    optional = False
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        arguments = [a for a in typing.get_args(hint) if a is not type(None)]
        optional = len(arguments) < len(typing.get_args(hint))
        hint = arguments[0] if len(arguments) == 1 else hint
    if typing.get_origin(hint) is typing.Literal:
        hint = type(typing.get_args(hint)[0])
    return hint, optional


def check(case: Any) -> None:
    """Refuse a case with a value that cannot be; see :class:`Case`."""
    for f in fields(type(case)):
        value = getattr(case, f.attribute)
        if not (value is None and f.optional):
            _check_value(f, value)
        where = f.option.only
        if where is not None and value != f.default and not where[0](case):
            raise CaseError(f"{f.name} is for {where[1]} only")


def _check_value(f: Field, value: Any) -> None:
    about, words = f.option, f.name.replace("-", " ")
    accepted = (int, float) if f.type is float else f.type
    if not isinstance(value, accepted) or (isinstance(value, bool) and f.type is not bool):
        kinds = {str: "a text", int: "a whole number", float: "a number", bool: "True or False"}
        raise CaseError(f"{words} {value!r}: give {kinds[f.type]}")
    if about.choices is not None and not (about.files and isinstance(value, str) and value.endswith(about.files)):
        beside = f"; or a file NAME{about.files}" if about.files else ""
        check_choice(words, value, about.choices, beside)
    if isinstance(value, int | float) and not isinstance(value, bool):
        low, high = about.within or (None, None)
        number(words, value, about.unit, least=low, most=high, error=CaseError)


def check_choice(what: str, value: Any, known: Collection[Any], beside: str = "") -> None:
    """Refuse ``value`` unless it is one of ``known``; ``beside`` ends the message.

    Raises:
        CaseError: names the nearest choice and all of them.
    """
    if value not in known:
        raise CaseError(unknown(what, value, known) + beside)


def label(case: Any) -> str:
    """The values of a case that tell it from others, joined by dashes; "default" when there are none."""
    parts = []
    for f in fields(type(case)):
        value = getattr(case, f.attribute)
        if not (f.option.always or value != f.default) or (f.option.only and not f.option.only[0](case)):
            continue
        if f.type is bool:
            parts += (
                [f.name] if value and f.option.label == "{}" else [_labelled(f, value)] if value else [f"no-{f.name}"]
            )
        elif value is not None:
            parts.append(_labelled(f, value))
    return "-".join(parts) or "default"


def _labelled(f: Field, value: Any) -> str:
    form = f.option.label
    if callable(form):
        return form(value)
    if f.option.files and isinstance(value, str) and value.endswith(f.option.files):
        value = Path(value).stem
    if form == "{}" and f.type in (int, float):
        return f"{f.name}-{short(value)}"
    return form.format(value)


def values(case: Any) -> dict[str, Any]:
    """A case as JSON values by field; whole numbers in fields of real ones count as real."""
    found = {}
    for f in fields(type(case)):
        value = getattr(case, f.attribute)
        found[f.attribute] = float(value) if f.type is float and value is not None else value
    return found


def named_files(case: Any) -> list[Path]:
    """Files that a case names, in the order of its fields; see ``files`` of :func:`option`."""
    named = ((f.option.files, getattr(case, f.attribute)) for f in fields(type(case)))
    return [Path(v) for suffix, v in named if suffix and isinstance(v, str) and v.endswith(suffix)]


def grid(case: type[C], **axes: Iterable[Any]) -> list[C]:
    """All combinations of values of some fields, the last varying fastest: ``grid(Ride, speed=(30, 50), road=ROADS)``.

    Raises:
        CaseError: no such field, or a combination that cannot be run.
    """
    known = {f.attribute for f in fields(case)}
    for name in axes:
        check_choice(f"field of {case.__name__}", name, known)
    return [case(**dict(zip(axes, point, strict=True))) for point in itertools.product(*axes.values())]


def case_of(function: Callable[..., Any]) -> type[Case]:
    """The class of cases behind a function's keyword arguments: ``def system(speed: float = 50.0)``.

    A default may be an :func:`option`.

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


def as_mapping(case: Any) -> Mapping[str, Any]:
    """Values by the names that people write, for tables and files."""
    return {f.name: getattr(case, f.attribute) for f in fields(type(case))}
