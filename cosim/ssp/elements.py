"""What elements of a structure say: numbers, transformations, units and enumerations, each checked."""

from __future__ import annotations

import math
from typing import Any

from lxml import etree

from build_fmus.base.checks import one_line, unknown
from build_fmus.base.units import BASE_UNITS, Unit
from cosim.core.errors import SspError
from cosim.ssp.names import SSC
from cosim.ssp.structure import Transformation

_KINDS = ("Linear", "BooleanMapping", "IntegerMapping", "EnumerationMapping")


def is_true(element: Any, attribute: str) -> bool:
    """Whether an attribute, false by default, is true."""
    return element.get(attribute, "false").strip() in ("true", "1")


def transformation_of(element: Any, where: str) -> Transformation | None:
    """The transformation of a connection or of an entry of a mapping. Raises SspError for one that there is not."""
    for e in element:
        name = etree.QName(e).localname
        if not name.endswith("Transformation"):
            continue
        kind = name.removesuffix("Transformation")
        here = f"{where}, line {e.sourceline}"
        if kind not in _KINDS or not e.tag.startswith(SSC):
            raise SspError(f"{here}: {unknown('transformation', name, (f'{t}Transformation' for t in _KINDS))}")
        if kind == "Linear":
            return Transformation(kind, _number(e, "factor", 1.0, here), _number(e, "offset", 0.0, here))
        read_one = {"BooleanMapping": _boolean, "IntegerMapping": _integer}.get(kind, _item)
        table: dict[Any, Any] = {}
        for entry in e.iterfind(f"{SSC}MapEntry"):
            source, target = (read_one(entry.get(k), f"{here}: MapEntry {k}") for k in ("source", "target"))
            if source in table:
                raise SspError(f"{here}: {source!r} is mapped twice")
            table[source] = target
        if not table:
            raise SspError(f"{here}: {name} has no MapEntry")
        return Transformation(kind, table=table)
    return None


def _number(element: Any, attribute: str, default: float, where: str) -> float:
    text = element.get(attribute)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SspError(f"{where}: {attribute} is {one_line(text, 40)!r}, which is not a finite number")
    return value


def _boolean(text: str | None, what: str) -> bool:
    known = {"true": True, "1": True, "false": False, "0": False}
    if text not in known:
        raise SspError(f"{what} is {text!r}; true or false is expected")
    return known[text]


def _integer(text: str | None, what: str) -> int:
    if text is None or len(text) > 20 or not text.strip().removeprefix("-").isdecimal():
        raise SspError(f"{what} is {text!r}, which is not a whole number")
    return int(text)


def _item(text: str | None, what: str) -> str:
    if not text:
        raise SspError(f"{what} names no item")
    return text


def units_of(root: Any, path: str, where: str) -> dict[str, Unit]:
    """Units by name."""
    found: dict[str, Unit] = {}
    for e in root.iterfind(path):
        name = e.get("name", "")
        here = f"{where}, line {e.sourceline}: unit '{name}'"
        if name in found:
            raise SspError(f"{here} is defined twice")
        base = e.find(f"{SSC}BaseUnit")
        if base is None:
            raise SspError(f"{here} has no BaseUnit")
        exponents = tuple(_integer(base.get(b, "0"), f"{here}: {b}") for b in BASE_UNITS)
        factor, offset = _number(base, "factor", 1.0, here), _number(base, "offset", 0.0, here)
        if factor == 0 or max(map(abs, exponents)) > 100:
            raise SspError(f"{here} has a factor of 0 or an exponent beyond 100")
        found[name] = Unit(name, exponents, factor, offset)
    return found


def enumerations_of(root: Any, path: str, where: str) -> dict[str, dict[str, int]]:
    """Names and values of the items of enumerations, by their names. Raises SspError."""
    found: dict[str, dict[str, int]] = {}
    for e in root.iterfind(path):
        name = e.get("name", "")
        here = f"{where}, line {e.sourceline}: enumeration '{name}'"
        if name in found:
            raise SspError(f"{here} is defined twice")
        found[name] = {i.get("name", ""): _integer(i.get("value"), here) for i in e.iterfind(f"{SSC}Item")}
    return found
