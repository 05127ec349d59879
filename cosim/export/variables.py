"""The variables of a system's FMU: which of its components', in which order, with which values."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from build_fmus.base import escape, units
from build_fmus.base.units import Unit
from cosim.core.description import WIDE, Variable
from cosim.core.errors import WiringError
from cosim.system.components import Connection, SystemComponent
from cosim.system.names import SystemComponents
from cosim.system.schedule import Schedule

TYPES = {"real": "Float64", "integer": "Int32", "boolean": "Boolean", "string": "String"}
_NARROW = ("Integer", "Int32", "Int16", "UInt16", "Int8", "UInt8", "Enumeration")
_FITS = {
    "input": {"Real", "Float64", "Float32", *_NARROW, "Boolean"},
    "parameter": {"Real", "Float64", "Float32", *_NARROW, "Boolean", "String"},
}
_LARGE = ("UInt32", *WIDE)  # integers that an Int32 may not hold


@dataclass(frozen=True)
class Exported:
    """One variable of the system's FMU: `component.variable`."""

    component: SystemComponent
    variable: Variable
    causality: str  # parameter, input, output
    start: Any  # of parameters and inputs

    @property
    def name(self) -> str:
        """Full name, `component.variable`."""
        return f"{self.component.name}.{self.variable.name}"

    @property
    def type(self) -> str:
        """FMI 3.0 type; Float64 for outputs that an Int32 may not hold."""
        return "Float64" if self.variable.fmi_type in _LARGE else TYPES[self.variable.type]

    @property
    def description(self) -> str:
        """The variable's own, and what its type is if it is another one here."""
        own, kind = self.variable.description, self.variable.fmi_type
        said = f"{kind} as {self.type}" if kind in (*_LARGE, "Enumeration") else ""
        said += ", exact up to 2^53" if kind in _LARGE else ""
        return f"{own} ({said})" if own and said else own or said

    @property
    def tunable(self) -> bool:
        """Whether it is a tunable parameter."""
        return self.causality == "parameter" and self.variable.variability == "tunable" and self.type != "String"


def choose(
    schedule: Schedule,
    inputs: str | Iterable[str] | None,
    outputs: str | Iterable[str] | None,
    parameters: str | Iterable[str] | None,
) -> list[Exported]:
    """Parameters, inputs and outputs by names and patterns.

    `inputs`: default all that no component drives. `outputs`: default all outputs that are no array elements.
    `parameters`: "*", all. Raises WiringError for a name that fits nothing, that is driven, or whose type no system's
    FMU has.
    """
    components = SystemComponents((m.name, m) for m in schedule.components)
    driven = {c.target_name: c for c in schedule.value_connections}
    found = [
        *_chosen(components, parameters, "parameter", driven),
        *_chosen(components, inputs if inputs is not None else "*", "input", driven),
    ]
    shown = [(m, v) for m, v in components.select(outputs) if v.causality != "parameter"]
    taken = {e.name for e in found}
    found += [Exported(m, v, "output", None) for m, v in shown if f"{m.name}.{v.name}" not in taken]
    return found


def _chosen(
    components: SystemComponents, patterns: str | Iterable[str] | None, causality: str, driven: dict[str, Connection]
) -> list[Exported]:
    """Variables of one causality: all that can be had for a pattern, every one for a plain name."""
    chosen: dict[str, Exported] = {}
    for pattern in [patterns] if isinstance(patterns, str) else patterns or ():
        plain = not set("*?") & set(pattern)
        candidates = components.fitting(pattern, causality)
        for component, variable in candidates:
            name = f"{component.name}.{variable.name}"
            reason = _unfit(variable, causality, driven.get(name))
            if reason and plain:
                raise WiringError(
                    f"{name} cannot be {'an input' if causality == 'input' else f'a {causality}'} of the FMU: {reason}"
                )
            if not reason:
                chosen[name] = Exported(component, variable, causality, _start(component, variable))
        if plain and not candidates:
            raise WiringError(f"no component has the {causality} '{pattern}'")
    return list(chosen.values())


def _unfit(variable: Variable, causality: str, connection: Connection | None) -> str:
    if variable.causality != causality:
        return f"it is {variable.causality}"
    if connection is not None:
        return f"it is driven by {connection.source_name}"
    if variable.fmi_type not in _FITS[causality]:
        possible = ", ".join(sorted(_FITS[causality]))
        return f"its type is {variable.fmi_type}; possible types are {possible}; set it in the system before the export"
    if variable.size > 1:
        return f"it is an element of the array {variable.declared}; set it in the system before the export"
    return ""


def _start(component: SystemComponent, variable: Variable) -> Any:
    value = component.start(variable.name)
    if value is None:
        return "" if variable.fmi_type == "String" else 0
    if isinstance(value, str) and escape.NO_XML.search(value):
        raise WiringError(
            f"{component.name}.{variable.name} starts with {value!r}, which has characters that XML cannot contain: set"
            " another text, or leave it out of the parameters of the FMU"
        )
    return value


def units_of(variables: Sequence[Exported]) -> list[Unit]:
    """Units by name, that of time first.

    Raises WiringError when two components use one name for different units.
    """
    found: dict[str, tuple[Unit, str]] = {"s": (units.unit("s"), "time")}
    for e in variables:
        unit = e.variable.unit
        if unit is None or e.type != "Float64":
            continue
        other, name = found.setdefault(unit.name, (unit, e.name))
        if other.exponents is None:
            found[unit.name] = unit, e.name
        elif unit.exponents is not None and (other.exponents, other.factor, other.offset) != (
            unit.exponents,
            unit.factor,
            unit.offset,
        ):
            raise WiringError(
                f"{name} and {e.name} both have the unit '{unit.name}', which their FMUs define differently: leave"
                " one out"
            )
    return [unit for unit, _ in found.values()]


def feedthrough(schedule: Schedule, variables: Sequence[Exported]) -> dict[str, list[str]]:
    """Inputs that an output depends on within the same step, by name.

    These are the inputs of sampled systems, whose outputs are valid from the sample on. Outputs of continuous
    components are valid from the end of a step on.
    """
    inputs = {e.name for e in variables if e.causality == "input"}
    ahead = {c.target_name: c for c in schedule.connections if not c.delay and c not in schedule.lagging}
    found: dict[str, frozenset[str]] = {}

    def of(component: SystemComponent, output: str) -> frozenset[str]:
        name = f"{component.name}.{output}"
        if name not in found:
            found[name] = frozenset()
            for needed in component.description.depends(output) if component.discrete else ():
                found[name] |= at(f"{component.name}.{needed}")
        return found[name]

    def at(target: str) -> frozenset[str]:
        connection = ahead.get(target)
        if connection is not None:
            return of(connection.source, connection.output.name)
        return frozenset({target}) & inputs

    return {
        e.name: sorted(at(e.name) if e.variable.causality == "input" else of(e.component, e.variable.name))
        for e in variables
        if e.causality == "output"
    }
