"""The values that parameter sets give: of all levels of nested systems, the outermost counts, of one level the last."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from build_fmus.base.checks import did_you_mean, one_line
from build_fmus.base.units import Unit, UnitMismatchError, conversion
from cosim.core.description import TEXTS, Variable
from cosim.core.errors import SspError
from cosim.fmu.file import FmuFile
from cosim.ssp.signals import Change, Place
from cosim.ssp.structure import Component, Element, System, Value
from cosim.ssp.values import items_of
from cosim.system.components import article

_BOOLEAN = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True)
class BoundValue:
    """A value for a connector or a variable; `depth` of the system whose binding it is."""

    value: Value
    depth: int

    def for_(self, variables: list[Variable], fmu: FmuFile | None) -> Any:
        """As a component's variable takes it, or the elements of an array. Raises SspError."""
        value, v = self.value, variables[0]
        texts = [self._mapped(t) for t in value.texts]
        parsed = [self._parsed(t, v, fmu) for t in texts]
        if v.type == "real":
            factor, offset = (1.0, 0.0) if value.suppress else _conversion(value.unit, v.unit, v.relative)
            t = value.transformation
            factor, offset = (
                (factor, offset)
                if t is None or t.kind != "Linear"
                else (t.factor * factor, t.factor * offset + t.offset)
            )
            parsed = [x if (factor, offset) == (1.0, 0.0) else factor * x + offset for x in parsed]
        return _shaped(parsed, variables, value.name)

    def along(self, how: Change | None, variables: list[Variable], fmu: FmuFile | None, unit: Unit | None) -> Any:
        """As it arrives at a component's variable by way of connectors of systems."""
        v = variables[0]
        parsed = [self._parsed(self._mapped(t), v, fmu) for t in self.value.texts]
        if v.fmi_type in TEXTS:
            return _shaped(parsed, variables, self.value.name)
        if how is None:
            factor, offset = (
                _conversion(self.value.unit or unit, v.unit, v.relative) if v.type == "real" else (1.0, 0.0)
            )
            how = Change(factor, offset)
        table = dict(how.table)
        plain = (how.factor, how.offset) == (1.0, 0.0)
        moved = [table.get(x, x) if table else x if plain else how.factor * x + how.offset for x in parsed]
        return _shaped(moved, variables, self.value.name)

    def _mapped(self, text: str) -> str:
        """A text of the parameter set after the mapping of Booleans, integers or items."""
        t = self.value.transformation
        if t is None or t.kind == "Linear":
            if t is not None and self.value.type not in ("Real", "Float64", "Float32"):
                raise SspError(f"a LinearTransformation needs a real value, and this is {self.value.type}")
            return text
        key: Any = text
        if t.kind == "BooleanMapping":
            key = _boolean(text)
        elif t.kind == "IntegerMapping":
            key = _whole(text)
        if key not in t.table:
            raise SspError(f"{one_line(text, 40)!r} is not in its {t.kind}Transformation")
        found = t.table[key]
        return str(found).lower() if isinstance(found, bool) else str(found)

    def _parsed(self, text: str, v: Variable, fmu: FmuFile | None) -> Any:
        if (self.value.type == "Binary") is not (v.fmi_type == "Binary"):
            raise SspError(f"it is {article(self.value.type)}, and the variable is {article(v.fmi_type)}")
        if v.fmi_type == "Binary":
            return _bytes(text)
        if v.type == "string":
            return text
        if v.type == "boolean":
            return _boolean(text)
        if v.fmi_type == "Enumeration" and self.value.type == "Enumeration":
            if fmu is None:
                raise SspError(f"{one_line(text, 40)!r} is not a number")
            items = items_of(fmu, v)[1]
            if text not in items:
                raise SspError(
                    f"{one_line(text, 40)!r} is not an item of its enumeration{did_you_mean(text, items)}"
                    f" ({', '.join(items)})"
                )
            return items[text]
        if v.type == "integer" and self.value.type not in ("Real", "Float64", "Float32"):
            return _whole(text)
        try:
            return float(text)
        except ValueError:
            raise SspError(f"{one_line(text, 40)!r} is not a number") from None


def values_of(top: System) -> dict[Place, BoundValue]:
    """What is given for each connector of a system and each variable of a component, by place."""
    found: dict[Place, BoundValue] = {}
    _collect(top, (), top, found)
    return found


def _collect(e: Element, path: tuple[str, ...], top: System, found: dict[Place, BoundValue]) -> None:
    """First what is in it, then its own, so that the outermost comes last."""
    if isinstance(e, System):
        for inner in e.elements.values():
            _collect(inner, (*path, inner.name), top, found)
    for binding in e.values:
        for value in binding:
            place = _place(e, path, value.name)
            if place is not None:
                found[place] = BoundValue(value, len(path))


def _place(e: Element, path: tuple[str, ...], name: str) -> Place | None:
    """What a hierarchical name means in an element; None for nothing: the standard has such values ignored."""
    if not isinstance(e, System):
        return Place(path, name) if isinstance(e, Component) else None
    if name in e.connectors:
        return Place(path, name)
    for inner in e.elements.values():
        if name.startswith(f"{inner.name}."):
            found = _place(inner, (*path, inner.name), name[len(inner.name) + 1 :])
            if found is not None:
                return found
    return None


def _conversion(given: Unit | None, own: Unit | None, relative: bool) -> tuple[float, float]:
    try:
        return conversion(given, own, relative)
    except UnitMismatchError as error:
        raise SspError(
            f"its unit is {given.name if given else ''}, that of the variable {own.name if own else ''}: {error}"
        ) from None


def _boolean(text: str) -> bool:
    if text not in _BOOLEAN:
        raise SspError(f"{one_line(text, 40)!r} is neither true nor false")
    return _BOOLEAN[text]


def _bytes(text: str) -> bytes:
    try:
        return bytes.fromhex(text)
    except ValueError:
        raise SspError(f"{one_line(text, 40)!r} is not made of pairs of hexadecimal digits") from None


def _whole(text: str) -> int:
    if len(text) > 20 or not text.removeprefix("-").isdecimal():
        raise SspError(f"{one_line(text, 40)!r} is not a whole number")
    return int(text)


def _shaped(values: list[Any], variables: list[Variable], name: str) -> Any:
    if len(values) != len(variables):
        raise SspError(f"{name} has {len(values)} value(s) for {len(variables)} element(s)")
    return values[0] if len(variables) == 1 else values
