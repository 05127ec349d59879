"""Checks of modelDescription.xml: the schema, and the rules that no schema can say."""

from __future__ import annotations

import math
import pickle
import re
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from build_fmus.base.checks import one_line
from cosim.check.model import DEFAULT_INITIAL, Model, Var, clock_seconds, default_initial, number
from cosim.check.rules import Found, NotApplicable, file_check, names, note, require, warning
from cosim.fmu import validation
from cosim.fmu.archive import Archive


@dataclass
class File:
    """An FMU as a file: its archive, its description as a tree and as data, and where it is unpacked."""

    archive: Archive
    root: Any
    model: Model
    folder: Any = None  # Path; set once it is unpacked

    @cached_property
    def packed_model(self) -> bytes:
        """The description as data, for other processes."""
        return pickle.dumps(self.model)


@file_check(
    "description.schema",
    "modelDescription.xml conforms to the schema of its FMI version",
    fmi2="2.2 FMI Description Schema",
    fmi3="2.4 FMI Description Schema",
    advice="Correct the description according to the schema of its FMI version; importers may reject it otherwise.",
)
def schema(file: File) -> Found:
    from copy import deepcopy

    for f in validation._schema(deepcopy(file.root), file.model.version):
        reason = validation.harmless(file.model.tool, f.text)
        yield warning(f"{f.text} (known quirk of this tool: {reason})", f.line) if reason else (f.line, f.text)


@file_check(
    "description.version",
    "fmiVersion is an existing FMI version",
    fmi2="2.2.1 Definition of an FMU (fmiModelDescription)",
    fmi3="2.4.1 Definition of an FMU (fmiModelDescription)",
    advice='Write fmiVersion="2.0" for every FMI 2.0.x, and "3.0" (or "3.0.x" from pre-releases of tools) for FMI 3.0.',
)
def version(file: File) -> Found:
    m = file.model
    if m.version == "2" and m.fmi != "2.0":
        yield f'fmiVersion is "{m.fmi}"; for every FMI 2.0.x it must be "2.0"'
    if m.version == "3" and not re.fullmatch(r"3\.0(\.\d+)?(-.+)?", m.fmi):
        yield warning(f'fmiVersion is "{m.fmi}"; for FMI 3.0 it must be "3.0"')
    if not m.interfaces and not m.scheduled:
        yield "it offers neither Co-Simulation nor Model Exchange" + (
            " nor Scheduled Execution" if m.version == "3" else ""
        )
    if not m.token:
        yield note(
            f"{'guid' if m.version == '2' else 'instantiationToken'} is empty, so the library cannot verify that the"
            " description is its own"
        )


@file_check(
    "description.identifier",
    "modelIdentifier is a valid C function prefix and library name",
    fmi2="2.1.1 Header Files and Naming of Functions",
    fmi3="2.2.2 Header Files and Naming of Functions",
    advice="Use letters, digits and underscores only, and begin with a letter or an underscore.",
)
def identifier(file: File) -> Found:
    for interface in file.model.interfaces.values():
        if not re.fullmatch(r"[A-Za-z_]\w*", interface.identifier, re.ASCII):
            yield interface.line, f"modelIdentifier {interface.identifier!r} is not a valid C identifier"
        elif len(interface.identifier) > 64:
            yield note(
                f"modelIdentifier has {len(interface.identifier)} characters; some file systems and tools have limits",
                interface.line,
            )


@file_check(
    "description.names",
    "variable names are unique and follow the declared naming convention",
    fmi2="2.2.7 Definition of Model Variables; 2.2.9 Variable Naming Conventions",
    fmi3="2.4.7.5.1 Variable Naming Conventions",
    advice=(
        "Rename variables that break the convention (quote odd names with '...'), or declare"
        ' variableNamingConvention="flat".'
    ),
)
def variable_names(file: File) -> Found:
    seen: dict[str, Var] = {}
    for v in file.model.variables:
        for name in (v.name, *v.aliases):
            if not name:
                yield v.line, f"variable number {v.position} has no name"
            elif name in seen:
                yield v.line, f"variable {name!r}: this name is already used in line {seen[name].line}"
            seen.setdefault(name, v)
            if re.search(r"[\r\n\t]", name):
                yield v.line, f"variable {name!r}: line feeds and tabs are not allowed in names"
    if file.model.says.get("variableNamingConvention") == "structured":
        for name, v in seen.items():
            if name and not _STRUCTURED.fullmatch(name):
                yield v.line, f"variable {name!r} is not a valid structured name"


_Q = r"'(?:[A-Za-z_0-9!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['\"?\\abfnrtv])+'"
_B = rf"(?:[A-Za-z_][A-Za-z_0-9]*|{_Q})(?:\[\d+(?:,\d+)*\])?"
_ID = rf"{_B}(?:\.{_B})*"
_STRUCTURED = re.compile(rf"{_ID}|der\({_ID}(?:,\d+)?\)")


@file_check(
    "description.references",
    "only aliases share a value reference",
    fmi2="2.2.7 Definition of Model Variables (valueReference, alias variables)",
    fmi3="2.4.7.4 Variable Attributes (valueReference)",
    advice=(
        "Give each variable a value reference of its own; aliases (FMI 3.0: <Alias> elements) share one, and with it"
        " everything but name and display."
    ),
)
def references(file: File) -> Found:
    sets: dict[Any, list[Var]] = {}
    for v in file.model.variables:
        if v.reference is None or not 0 <= v.reference < 2**32:
            yield v.line, f"variable {v.name!r}: its valueReference is not an integer from 0 to 4294967295"
            continue
        sets.setdefault(v.key if file.model.version == "2" else v.reference, []).append(v)
    for same in sets.values():
        if len(same) < 2:
            continue
        shown, line = names(v.name for v in same), same[1].line
        if file.model.version == "3":
            yield line, f"variables {shown} have the same value reference {same[0].reference}"
            continue
        settable = [v for v in same if _settable(v)]
        if len(settable) > 1:
            text = (
                f"aliases {names(v.name for v in settable)} can all be set; at most one of an alias set may be settable"
            )
            yield line, text
        starts = [v for v in same if v.start is not None and v.variability != "constant"]
        if len(starts) > 1 and len(settable) < 2:
            yield (
                line,
                f"aliases {names(v.name for v in starts)} all have a start value; at most one variable of an alias"
                " set may have one",
            )
        if len({v.variability == "constant" for v in same}) > 1:
            yield line, f"aliases {shown}: some are constant, others not"
        if len({v.unit for v in same}) > 1:
            yield warning(f"aliases {shown} have different units", line)


def _settable(v: Var) -> bool:
    return v.causality in ("input", "parameter") or (
        v.variability != "constant" and v.says.get("initial") in ("exact", "approx")
    )


@file_check(
    "description.variability",
    "causality, variability and initial are an allowed combination",
    fmi2="2.2.7 Definition of Model Variables (tables of causality, variability and initial)",
    fmi3="2.4.7.4 Variable Attributes (tables of variability/causality and of initial)",
    advice="Use a combination that the tables of the standard allow.",
)
def variability(file: File) -> Found:
    for v in file.model.variables:
        if v.type == "Clock":
            if v.causality not in ("input", "output", "local"):
                yield v.line, f"clock {v.name!r} has causality {v.causality}"
            continue
        what = f"variable {v.name!r}"
        written = "variability" in v.says
        if v.variability == "continuous" and not v.is_float:
            text = f"{what}: {v.type} cannot be continuous" + (
                "" if written else ', which is the default; write variability="discrete"'
            )
            yield (v.line, text) if written else warning(text, v.line)
            continue
        default = default_initial(v.variability, v.causality)
        if default is None:
            allowed = ", ".join(sorted(a for pairs in DEFAULT_INITIAL.values() for a, c in pairs if c == v.causality))
            text = (
                f"{what}: {v.variability}{'' if written else ' (the default)'} is not allowed for causality"
                f" {v.causality}; allowed: {allowed}"
            )
            yield (v.line, text) if written else warning(text, v.line)
            continue
        initial = v.says.get("initial")
        if initial is None:
            continue
        options = {
            "exact": ("exact",),
            "calculated": (
                "approx",
                "calculated",
                *(("exact",) if v.variability in ("discrete", "continuous") else ()),
            ),
            "input": ("exact",) if file.model.version == "3" else (),
            "none": (),
        }[default]
        if initial not in options:
            which = " or ".join(options) or "none at all"
            text = f"{what}: initial={initial} is not allowed for a {v.variability} {v.causality} ({which})"
            yield (v.line, text) if default != "input" else warning(text, v.line)


@file_check(
    "description.start",
    "required start values exist, are valid, and lie between min and max",
    fmi2="2.2.7 Definition of Model Variables (start)",
    fmi3="2.4.7.5 Type specific properties (start)",
    advice=(
        "Inputs, parameters, constants and variables with initial exact or approx need a start value; calculated"
        " variables must not have one."
    ),
)
def start(file: File) -> Found:
    for v in file.model.variables:
        if v.type == "Clock" or default_initial(v.variability, v.causality) is None:
            continue
        what = f"variable {v.name!r}"
        needs = (
            v.causality in ("input", "parameter", "structuralParameter")
            or v.variability == "constant"
            or v.initial in ("exact", "approx")
        )
        if needs and v.start is None:
            kind = f"{'an' if v.causality[0] in 'aeiou' else 'a'} {v.causality}"
            yield v.line, f"{what}: {kind} with initial={v.initial} has no start value"
        own = v.says.get("start") is not None
        if own and (v.causality == "independent" or v.initial == "calculated"):
            why = "the independent variable" if v.causality == "independent" else "calculated"
            yield v.line, f"{what}: it has a start value, although it is {why}"
        if v.start is None or v.type == "Binary" or not own or (v.access == "String"):
            continue
        values = v.starts()
        if values is None:
            count = f" for {v.size} elements" if v.size != 1 else ""
            yield v.line, f"{what}: start={one_line(v.start, 60)!r} cannot be read as {v.type}{count}"
            continue
        low, high = v.bounds
        if v.is_number and low > high:
            yield v.line, f"{what}: min {low:g} is above max {high:g}"
        elif v.is_number:
            for value in values:
                if not math.isfinite(value):
                    yield v.line, f"{what}: its start is {value}"
                    break
                if value < low or value > high:
                    yield v.line, f"{what}: start {value:g} is outside of its range {low:g} to {high:g}"
                    break


@file_check(
    "description.types",
    "all types in use are defined, and enumerations have items",
    fmi2="2.2.3 Definition of Types",
    fmi3="2.4.4 Definition of Types",
    advice="Add the type to TypeDefinitions, or correct declaredType.",
)
def types(file: File) -> Found:
    path = "TypeDefinitions/SimpleType" if file.model.version == "2" else "TypeDefinitions/*"
    defined = yield from _defined(file, "type", path)
    for v in file.model.variables:
        declared = v.says.get("declaredType")
        if declared is not None and declared not in defined:
            yield v.line, f"variable {v.name!r}: there is no type {declared!r} among the TypeDefinitions"
        elif declared is not None:
            element = defined[declared]
            kind = (
                (element[0].tag if len(element) else "")
                if file.model.version == "2"
                else element.tag.removesuffix("Type")
            )
            if kind != v.type:
                yield v.line, f"variable {v.name!r} is {v.type}, but its type {declared!r} is of {kind or 'nothing'}"
        elif v.type == "Enumeration":
            yield v.line, f"variable {v.name!r} is an Enumeration without declaredType, so its items are undefined"


def _defined(file: File, kind: str, path: str) -> Generator[tuple[int, str], None, dict[str, Any]]:
    """Definitions by name; yields those that are there twice."""
    defined: dict[str, Any] = {}
    for element in file.root.iterfind(path):
        name = element.get("name", "")
        if name in defined:
            yield element.sourceline, f"{kind} {name!r} is defined twice"
        defined[name] = element
    return defined


@file_check(
    "description.units",
    "all units in use are defined and can be converted",
    fmi2="2.2.2 Definition of Units",
    fmi3="2.4.3 Definition of Units",
    advice="Add the unit to UnitDefinitions with its base unit, or correct the name.",
)
def units(file: File) -> Found:
    defined = yield from _defined(file, "unit", "UnitDefinitions/Unit")
    for name, unit in defined.items():
        base = unit.find("BaseUnit")
        if base is not None and number(base.get("factor")) == 0:
            yield unit.sourceline, f"unit {name!r}: its factor is 0, so it cannot be converted"
        displays = [d.get("name") for d in unit.iterfind("DisplayUnit")]
        if len(displays) != len(set(displays)):
            yield unit.sourceline, f"unit {name!r} has two display units of the same name"
        for display in unit.iterfind("DisplayUnit"):
            if number(display.get("factor")) == 0:
                yield (
                    display.sourceline,
                    f"display unit {display.get('name')!r}: its factor is 0, so it cannot be converted",
                )
    for v in file.model.variables:
        shown = v.says.get("displayUnit")
        if v.unit is not None and v.unit not in defined:
            yield v.line, f"variable {v.name!r}: there is no unit {one_line(v.unit, 60)!r} among the UnitDefinitions"
        elif shown is not None and v.unit is None:
            yield warning(f"variable {v.name!r} has a displayUnit, but no unit", v.line)
        elif (
            shown is not None
            and shown != v.unit
            and v.unit is not None
            and shown not in [d.get("name") for d in defined[v.unit].iterfind("DisplayUnit")]
        ):
            text = f"variable {v.name!r}: unit {v.unit!r} has no display unit {one_line(shown, 60)!r}"
            yield (v.line, text) if file.model.version == "3" else warning(text, v.line)


@file_check(
    "description.experiment",
    "the default experiment is valid",
    fmi2="2.2.5 Definition of a Default Experiment",
    fmi3="2.4.6 Definition of a Default Experiment",
    advice="Set stopTime above startTime, stepSize and tolerance above 0, and all to finite values.",
)
def experiment(file: File) -> Found:
    element = file.root.find("DefaultExperiment")
    if element is None:
        raise NotApplicable("there is no DefaultExperiment")
    e, line = file.model.experiment, element.sourceline
    for name in ("stepSize", "tolerance"):
        if name in e and not 0 < e[name] < math.inf:
            yield line, f"{name} is {e[name]:g}"
    for name in ("startTime", "stopTime"):
        if name in e and not math.isfinite(e[name]):
            yield line, f"{name} is {e[name]:g}"
    if e.get("stopTime", math.inf) < e.get("startTime", 0.0):
        yield line, f"stopTime {e['stopTime']:g} is before startTime {e.get('startTime', 0.0):g}"
    elif "stopTime" in e and e.get("stepSize", 0.0) > e["stopTime"] - e.get("startTime", 0.0) > 0:
        yield warning(f"stepSize {e['stepSize']:g} is longer than the whole experiment", line)


@file_check(
    "description.clocks",
    "clocks define when they tick, and clocked variables refer to existing clocks",
    fmi3="2.2.9 Clocks; 2.4.7 Definition of Model Variables",
    advice="Give constant clocks their interval, and clocked variables the value references of their clocks.",
)
def clocks(file: File) -> Found:
    m = file.model
    require(m.clocks, "there are no clocks")
    references = {v.reference for v in m.variables if v.type == "Clock"}
    for v in m.variables:
        if v.type == "Clock":
            yield from ((v.line, f"clock {v.name!r} {text}") for text in _of_clock(v))
        if not v.clocked:
            continue
        for word in v.says.get("clocks", "").split():
            if _reference(word) not in references:
                yield v.line, f"variable {v.name!r} belongs to clock {word}, which is not a clock"
        if v.variability != "discrete":
            yield v.line, f"variable {v.name!r} belongs to a clock and is {v.variability}; it must be discrete"


def _of_clock(v: Var) -> Iterator[str]:
    kind, interval = v.says.get("intervalVariability", ""), clock_seconds(v.says, "interval")
    if v.causality != "input" and kind != "triggered":
        yield f"is {kind} and of causality {v.causality}; clocks that tick by time are inputs"
    if kind == "constant" and interval is None:
        yield "is constant and has no interval"
    if interval is not None and interval <= 0:
        yield f"has the interval {interval:g} s"
    written = number(v.says.get("intervalDecimal"))
    if interval and written is not None and abs(written - interval) > 1e-5 * interval:
        yield f"has the interval {written:g} s, and as a fraction {interval:g} s"
    if (
        kind == "constant"
        and v.says.get("supportsFraction") in ("true", "1")
        and not ("resolution" in v.says and "intervalCounter" in v.says)
    ):
        yield "supports fractions, but has neither resolution nor intervalCounter"


def _reference(text: str) -> int | None:
    return int(text) if text.isascii() and text.isdecimal() else None


@file_check(
    "description.capabilities",
    "capability flags that require each other are consistent",
    fmi2="3.3.1 and 4.3.1 FMI Description Schema (capability flags)",
    fmi3="2.4.9, 3.3 and 4.3 (capability flags)",
    advice="Set the required flag too, or neither.",
    worst="error",
)
def capabilities(file: File) -> Found:
    m = file.model
    for i in m.interfaces.values():
        suffix = "state" if m.version == "2" else "State"
        if i.can(f"canSerializeFMU{suffix}") and not i.saves:
            yield i.line, f"canSerializeFMU{suffix} is true, but canGetAndSetFMU{suffix} is not"
        if m.version == "3" and i.kind == "cs":
            if i.can("canReturnEarlyAfterIntermediateUpdate") and not i.can("providesIntermediateUpdate"):
                yield warning(
                    "canReturnEarlyAfterIntermediateUpdate is true, but providesIntermediateUpdate is not", i.line
                )
            if m.clocks and not i.can("hasEventMode"):
                yield warning("it has clocks, but hasEventMode is not true", i.line)
    independent = m.of("independent")
    if m.version == "3" and len(independent) != 1:
        yield f"it has {len(independent)} independent variables; FMI 3.0 requires exactly one"
    elif len(independent) > 1:
        yield f"variables {names(v.name for v in independent)} are all independent; only one may be"
    floats = "Real" if m.version == "2" else "Float32 or Float64"
    for v in independent:
        if not v.is_float:
            yield v.line, f"the independent variable {v.name!r} is {v.type}; it must be {floats}"
    if "me" in m.interfaces and m.version == "2" and not m.listed("Derivative"):
        for v in m.variables:
            state = m.state_of(v)
            if state is not None and v.causality == state.causality == "local":
                yield warning(
                    f"{v.name!r} derives {state.name!r}, but ModelStructure lists no derivatives, so the state is"
                    " hidden from the integrator",
                    v.line,
                )
                break
