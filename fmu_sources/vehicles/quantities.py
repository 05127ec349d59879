"""Quantities, tables and heads of vehicle files: values with unit and source, converted and within limits."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from build_fmus.base import units
from build_fmus.component import source_fault, text_fault


@dataclass(frozen=True)
class Declared:
    """Unit, limits, display unit and usual size of a field; pydantic's own field has its description."""

    unit: str
    min: float
    max: float
    display_unit: str | None = None
    nominal: float | None = None
    size: int | None = None
    increasing: bool = False


class Quantity(BaseModel):
    """One value of a vehicle file. `value` is in the unit of the field's declaration once the file is loaded."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    value: float = Field(allow_inf_nan=False)
    unit: str
    source: str

    @field_validator("source")
    @classmethod
    def _is_one(cls, given: str) -> str:
        if fault := source_fault(given):
            raise PydanticCustomError("source", "{text}", {"text": fault})
        return given


class Numbers(BaseModel):
    """Several values of one unit in a vehicle file: the coordinates of a point, or a row of a table."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    value: tuple[Annotated[float, Field(allow_inf_nan=False)], ...]
    unit: str
    source: str

    _is_one = field_validator("source")(Quantity._is_one.__func__)  # type: ignore[attr-defined]


def quantity(
    unit: str,
    min: float,
    max: float,
    description: str,
    *,
    display_unit: str | None = None,
    nominal: float | None = None,
    size: int | None = None,
    increasing: bool = False,
    default: float | tuple[float, ...] | None = None,
) -> Any:
    """Declare a field of type `Quantity` or `Numbers`.

    `nominal` is for values that may well be 0. Of `Numbers`, `size`: how many (None: two at least); `increasing`: where
    a table relies on it. `default`: of files without this field, in `unit`; None: every file has it.
    """
    declared = Declared(unit, min, max, display_unit, nominal, size, increasing)
    given: dict[str, Any] = {}
    if default is not None:
        kind = Numbers if isinstance(default, tuple) else Quantity
        given["default"] = kind(value=default, unit=unit, source="assumed: not in the vehicle file")  # type: ignore[arg-type]
    return Field(description=description, json_schema_extra={"declared": declared}, **given)  # type: ignore[dict-item]


class Section(BaseModel):
    """A table of a vehicle file. Unknown fields are refused; units are converted; limits are checked."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def declared(cls, field: str) -> Declared | None:
        """Declaration of a quantity field, None for anything else."""
        extra = cls.model_fields[field].json_schema_extra
        return extra.get("declared") if isinstance(extra, dict) else None  # type: ignore[return-value]

    @field_validator("*", mode="after")
    @classmethod
    def _in_declared_unit(cls, given: Any, info: ValidationInfo) -> Any:
        if not isinstance(given, Quantity | Numbers):
            return given
        declared = cls.declared(info.field_name or "")
        assert declared is not None, f"{cls.__name__}.{info.field_name}: declare it with quantity()"
        if isinstance(given, Quantity):
            return Quantity(
                value=_converted(declared, given.value, given.unit), unit=declared.unit, source=given.source
            )
        values = tuple(_converted(declared, v, given.unit, f"value {i}: ") for i, v in enumerate(given.value, 1))
        if fault := _row_fault(declared, values):
            raise PydanticCustomError("row", "{text}", {"text": fault})
        return Numbers(value=values, unit=declared.unit, source=given.source)


def _converted(declared: Declared, given: float, unit: str, where: str = "") -> float:
    """A value of a file in the declared unit; what is wrong with it as a pydantic error."""
    try:
        value = units.convert(given, unit, declared.unit)
    except KeyError as error:
        raise PydanticCustomError("unit", "{text}", {"text": error.args[0]}) from None
    if not declared.min <= value <= declared.max:
        word, bound = ("least", declared.min) if value < declared.min else ("most", declared.max)
        text = f"{where}{given:g} {unit} is out of range: it must be at {word} {bound:g} {declared.unit}"
        raise PydanticCustomError("limit", "{text}", {"text": text})
    return value


def _row_fault(declared: Declared, values: tuple[float, ...]) -> str:
    """What is wrong with the values of a row together; empty when nothing is."""
    if declared.size is not None and len(values) != declared.size:
        return f"{len(values)} values; {declared.size} are needed"
    if len(values) < 2:
        return f"{len(values)} value(s); two at least are needed"
    if declared.increasing:
        for i, (before, after) in enumerate(pairwise(values), 1):
            if after <= before:
                return (
                    f"value {i + 1} is {after:g} {declared.unit} after {before:g} {declared.unit}; the values of this"
                    " row must increase"
                )
    return ""


class Vehicle(Section):
    """Head of every vehicle file."""

    kind: str
    name: str = Field(min_length=1)
    description: str = Field(min_length=1)

    @field_validator("name", "description")
    @classmethod
    def _can_be_held(cls, given: str) -> str:
        if fault := text_fault(given):
            raise PydanticCustomError("source", "{text}", {"text": fault})
        return given
