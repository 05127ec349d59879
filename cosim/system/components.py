"""The pieces of a system: components with their rates and values, connections, groups."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from build_fmus.base.checks import number
from build_fmus.base.units import UnitMismatchError, conversion, meant
from cosim.core.component import Component
from cosim.core.description import INTEGER_RANGE, Description, Variable, split_index
from cosim.core.errors import WiringError
from cosim.core.signals import Array
from cosim.system.renewal import PythonSource


@dataclass(eq=False)
class SystemComponent:
    """A component in a system, with its rate [s, exact] and the values it starts with."""

    name: str
    implementation: Component
    step: Fraction
    offset: Fraction
    kind: str
    values: dict[str, Any] = field(default_factory=dict)
    source: PythonSource | None = None
    """Of a component written in Python: what it is made of for each run. `implementation` ran last."""

    @property
    def description(self) -> Description:
        """Variables and capabilities of the component."""
        return self.implementation.description

    @property
    def discrete(self) -> bool:
        """Whether the component is discrete."""
        return self.kind == "discrete"

    def set(self, values: Mapping[str, Any] | None = None, **more: Any) -> None:
        """Set parameters and start values for the next initialization, by variable name.

        A name without its index (`gain.y`) takes an array for all of `gain.y[i,j]`, row major, and a column of real
        numbers of a table an array for all of its rows. Raises WiringError for unknown names, values of the wrong type
        or shape, and values outside min and max; nothing is set then.
        """
        given = [self.expand(name, value) for name, value in {**(values or {}), **more}.items()]
        for expanded in given:
            self.values.update(expanded)

    def start(self, name: str) -> Any:
        """Value that a variable starts with: as set, else the FMU's own; None if neither says it."""
        found = self.description.find(name, self.name)
        return self.values.get(found.name, found.start)

    def expand(self, name: str, value: Any) -> dict[str, Any]:
        """What `set` would set, element by element, without setting it."""
        name = self.description.canonical(name)
        names = self.description.arrays.get(name)
        if names is None or name in self.description.variables:
            variable = self.description.find(name, self.name)
            return {name: _checked(self.name, variable, value)}
        kind = object if self.description.variables[names[0]].fmi_type == "Binary" else None  # numpy cuts off zeros
        array = np.asarray(value, dtype=kind)
        shape = tuple(np.max([indices(n) for n in names], axis=0).tolist())
        if array.shape != shape and not (array.ndim <= 1 and array.size == len(names)):
            raise WiringError(f"{self.name}.{name} has shape {shape}, the value given has {array.shape}")
        variables = self.description.variables
        ordered = sorted(names, key=indices)
        return {n: _checked(self.name, variables[n], v) for n, v in zip(ordered, array.ravel().tolist(), strict=True)}


@dataclass(frozen=True)
class Connection:
    """source.output -> target.input, with target = scale * source + offset.

    `flow`: the target takes the flow that the source gives, so no other component may take it. `size`: bytes at most
    that go with the number, of a String or Binary, or of a 64-bit integer that arrives exactly.
    """

    source: SystemComponent
    output: Variable
    target: SystemComponent
    input: Variable
    delay: bool = False
    extrapolate: bool = False
    scale: float = 1.0
    offset: float = 0.0
    flow: bool = False
    size: int = 0

    @property
    def is_clock(self) -> bool:
        """Whether it connects clocks."""
        return self.output.fmi_type == "Clock"

    @property
    def sets_parameter(self) -> bool:
        """Whether it passes a calculated parameter on to a parameter, in initialization only."""
        return self.input.causality == "parameter"

    @property
    def source_name(self) -> str:
        """Full name of the output, `component.variable`."""
        return f"{self.source.name}.{self.output.name}"

    @property
    def target_name(self) -> str:
        """Full name of the input, `component.variable`."""
        return f"{self.target.name}.{self.input.name}"

    def __str__(self) -> str:
        notes = []
        if (self.scale, self.offset) != (1.0, 0.0):
            named = self.output.unit_name != self.input.unit_name
            linear = f"times {self.scale:g} plus {self.offset:g}"
            notes.append(f"{self.output.unit_name} to {self.input.unit_name}" if named else linear)
        if self.delay:
            notes.append("one step of delay")
        if self.extrapolate:
            notes.append("extrapolated")
        return f"{self.source_name} -> {self.target_name}" + (f" ({', '.join(notes)})" if notes else "")


@dataclass(frozen=True)
class Group:
    """Continuous components that advance together, by one method."""

    name: str
    components: tuple[SystemComponent, ...]
    method: str = "jacobi"


def indices(name: str) -> tuple[int, ...]:
    """`gain.y[2,3]` -> (2, 3)."""
    return split_index(name)[1]


def article(word: str) -> str:
    """The word with its indefinite article."""
    return f"{'an' if word[:1].lower() in 'aeiou' else 'a'} {word}"


def structural(component: str, about: Description, values: Mapping[str, Any] | None) -> dict[str, Any]:
    """The values of structural parameters among these, by the parameters' own names.

    Raises WiringError for values that do not fit.
    """
    found = {}
    for given, value in (values or {}).items():
        name = about.canonical(given)
        variable = about.variables.get(name)
        if variable is not None and variable.causality == "structuralParameter":
            found[name] = _checked(component, replace(variable, causality="parameter"), value)
    return found


_WITH_UNIT = re.compile(r"\s*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)\s*([^\s\d.].*)")


def _without_unit(value: Any, variable: Variable) -> str:
    """What to give in place of a text with a number and a unit; empty for other values."""
    match = _WITH_UNIT.fullmatch(value) if isinstance(value, str) else None
    unit = meant(match[2]) if match else None
    if match is None or unit is None or variable.unit is None:
        return ""
    try:
        scale, offset = conversion(unit, variable.unit)
    except UnitMismatchError:
        return f": give the number in {variable.unit_name}"
    return f": give the number in {variable.unit_name}, {scale * float(match[1]) + offset:.9g}"


def _checked_samples(name: str, variable: Variable, value: Any) -> Array:
    try:
        given = np.array(value, dtype=float)
    except (TypeError, ValueError):
        given = np.empty(0)
    if given.shape != (variable.samples,) or not np.isfinite(given).all():
        raise WiringError(f"{name} needs {variable.samples} finite numbers, one for each row of its table")
    given.flags.writeable = False
    return given


def _checked(component: str, variable: Variable, value: Any) -> Any:
    """The value in the variable's own type. Raises WiringError when it cannot be set or does not fit."""
    name = f"{component}.{variable.name}"
    settable = variable.causality in ("parameter", "input") or variable.initial in ("exact", "approx")
    if variable.causality == "structuralParameter":
        raise WiringError(
            f"{name} is a structural parameter, which is set when the component is added: give it in the parameters of"
            " add"
        )
    if variable.variability == "constant" or not settable:
        raise WiringError(f"{name} cannot be set: it is {article(variable.causality)}, {variable.variability}")
    if variable.samples:
        return _checked_samples(name, variable, value)
    if variable.type == "string":
        return str(value)
    if variable.fmi_type == "Binary":
        if not isinstance(value, bytes | bytearray):
            raise WiringError(f"{name} is a Binary and needs bytes, not {value!r}")
        return bytes(value)
    if variable.type == "boolean":
        if value not in (True, False, 0, 1):
            raise WiringError(f"{name} is a Boolean, not {value!r}")
        return bool(value)
    try:
        given = float(value)
    except (TypeError, ValueError, OverflowError):
        raise WiringError(f"{name} needs one number, not {value!r}{_without_unit(value, variable)}") from None
    number(name, given, variable.unit_name, least=variable.minimum, most=variable.maximum, error=WiringError)
    if not variable.accepts(given):
        raise WiringError(f"{name} {variable.refusal(given)}")
    if variable.type == "integer":
        if given != int(given):
            raise WiringError(f"{name} is an Integer, not {value!r}")
        low, high = INTEGER_RANGE.get(variable.fmi_type, INTEGER_RANGE["Int64"])
        if not low <= int(value) <= high:
            raise WiringError(f"{name} = {int(value)} does not fit into {variable.fmi_type}, {low} to {high}")
        return int(value)
    return given
