"""Reads modelDescription.xml of FMI 2.0 and 3.0 into a `Description`.

FMI 3 arrays are expanded to their elements (`preview.fl[3]`, `gain.y[2,3]`, 1-based, row major), so both versions are
connected by the same names. The file is validated: an error names the variable and its line, and sizes are compared
with limits first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any, ClassVar

from build_fmus.base.checks import one_line
from build_fmus.base.units import BASE_UNITS, DisplayUnit, Unit
from cosim.core.description import SIZED_INTEGERS, Clock, Description, Variable, split_index
from cosim.core.errors import FmuError, TimeError
from cosim.core.time import rational
from cosim.fmu.interface import INTERFACES, NAMES, Interface
from cosim.fmu.limits import Limits
from cosim.fmu.xml import tree

TOOL = (  # our vendor annotation: kind and sample time, constants that source and target must share, sources of values
    "suspension-fmus"
)
LONGEST_IDENTIFIER = 200  # bytes of a library's name without its ending; file systems take some fifty more
LONGEST_SOURCE = 4096  # characters that say where a value comes from

OCTETS = "application/octet-stream"  # mimeType of a Binary that has none
LARGEST_BINARY = 2**30  # bytes that maxSize may say

TYPES2 = {"Real": "real", "Integer": "integer", "Enumeration": "integer", "Boolean": "boolean", "String": "string"}
TYPES3 = {
    "Float64": "real",
    "Float32": "real",
    "Boolean": "boolean",
    "String": "string",
    "Enumeration": "integer",
    **dict.fromkeys(SIZED_INTEGERS, "integer"),
    "Binary": "other",
    "Clock": "other",
}


class _Unreadable(ValueError):  # noqa: N818
    """Something in a modelDescription.xml, as a sentence."""


def parse(xml: bytes, where: str, limits: Limits | None = None) -> Description:
    """Description from modelDescription.xml; `where` names the file in errors. Raises FmuError."""
    return read(tree(xml, where, limits or Limits()), where, limits or Limits())


def read(
    root: Any, where: str, limits: Limits, interface: str | None = None, structure: Mapping[str, Any] | None = None
) -> Description:
    """Description from the root element of modelDescription.xml, as of an interface, "cs" or "me". Raises FmuError.

    Without `interface` it is Co-Simulation where the FMU offers it. `structure`: values of structural parameters, by
    name, instead of their start values.
    """
    for element in root.iterfind("ModelVariables/*") if structure else ():
        if element.get("name") in (structure or {}):
            element.set("start", str((structure or {})[element.get("name")]).lower())
    version = root.get("fmiVersion", "")
    if root.tag != "fmiModelDescription" or not version.startswith(("2.", "3.")):
        raise FmuError(f"{where}: FMI version '{one_line(version, 40) or 'unknown'}'; FMI 2.0 and 3.0 are supported")
    tags = [interface] if interface else list(INTERFACES)
    simulation = next((root.find(INTERFACES[t]) for t in tags if root.find(INTERFACES[t]) is not None), None)
    if simulation is None:
        offered = {**{tag: NAMES[i] for i, tag in INTERFACES.items()}, "ScheduledExecution": "Scheduled Execution"}
        kinds = [name for tag, name in offered.items() if root.find(tag) is not None]
        raise FmuError(
            f"{where}: it does not offer {NAMES[tags[0]]}, but {' and '.join(kinds)}; choose"
            " another interface or export it again"
            if kinds and interface and kinds != ["Scheduled Execution"]
            else f"{where}: neither a Co-Simulation nor a Model Exchange FMU (it offers"
            f" {' and '.join(kinds) or 'nothing'}); export it again for Co-Simulation"
        )
    reader = (_Fmi2 if version.startswith("2.") else _Fmi3)(root, limits)
    try:
        return reader.description(simulation)
    except (_Unreadable, TimeError) as error:
        why = f": {one_line(str(error))}"
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        why = f" ({type(error).__name__}: {one_line(str(error))})"
    line = "" if reader.at is None else f", line {reader.at.sourceline}"
    raise FmuError(f"{where}: invalid modelDescription.xml{line}{why}")


def type_attributes(root: Any, version: str) -> dict[str | None, dict[str, str]]:
    """What variables of a defined type have from it, by its name."""
    if version == "2":
        return {t.get("name"): dict(t[0].attrib) for t in root.iterfind("TypeDefinitions/SimpleType") if len(t)}
    own = ("name", "description")
    types = root.iterfind("TypeDefinitions/*")
    return {t.get("name"): {k: v for k, v in t.attrib.items() if k not in own} for t in types}


def _integer(element: Any, attribute: str, what: str, low: int = 0, high: int = 2**63 - 1) -> int:
    """An attribute as a whole number within limits."""
    return _whole(element.get(attribute), f"{what}: {attribute}", low, high)


def _whole(text: str | None, what: str, low: int, high: int) -> int:
    if text is None:
        raise _Unreadable(f"{what} is missing")
    try:
        value = int(text)
    except ValueError:
        raise _Unreadable(f"{what} is {_short(text)}, which is not a whole number") from None
    if not low <= value <= high:
        raise _Unreadable(f"{what} is {_short(text)}; it must be within {low} and {high}")
    return value


def _number(text: str, what: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise _Unreadable(f"{what} is {_short(text)}, which is not a number") from None


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")


class _Reader:
    """What FMI 2.0 and 3.0 have in common."""

    version: ClassVar[str]

    def __init__(self, root: Any, limits: Limits):
        self.root = root
        self.limits = limits
        self.at: Any = None  # the element that is being read
        self.lines: dict[str, int] = {}  # of each name
        self.listed: dict[str, frozenset[str]] = {}  # dependencies by their text
        self.count = 0  # of names in them
        self.units: dict[str, Unit] = {}
        self.displays: dict[tuple[str, str], DisplayUnit | None] = {}  # by the names of both units
        self.variables: dict[str, Variable] = {}
        self.by_key: dict[int, list[Variable]] = {}  # FMI 2: 1-based position; FMI 3: value reference
        self.aliases: dict[str, str] = {}
        self.clocks: list[Clock] = []
        self.updates = False  # it calls back inside its steps

    def description(self, simulation: Any) -> Description:
        root = self.root
        for unit in self.each(root.iterfind("UnitDefinitions/Unit")):
            self.units[unit.get("name")] = _unit(unit)
            self.displays |= {(unit.get("name"), d.get("name")): _display(d) for d in unit.iterfind("DisplayUnit")}
        clocked = root.find("ModelVariables/Clock") is not None  # by `event_mode.py`, without intermediate update
        exchanged = simulation.tag == INTERFACES["me"]
        offered = Interface.of("me" if exchanged else "cs", simulation)
        self.updates = offered.can("providesIntermediateUpdate") and not clocked
        self.read_variables()
        own = self.annotation()
        if own is not None:
            self.annotate(own)
        structure = root.find("ModelStructure")
        self.at = simulation
        result = Description(
            name=root.get("modelName", ""),
            variables=self.variables,
            fmi_version=root.get("fmiVersion"),
            token=root.get("guid") or root.get("instantiationToken") or "",
            identifier=_identifier(simulation),
            text=root.get("description", ""),
            tool=root.get("generationTool", ""),
            can_save=offered.saves,
            can_serialize=offered.serializes,
            only_once=offered.once,
            variable_step=exchanged or offered.variable_step,
            directional_derivatives=offered.directional,
            model_exchange=root.find("ModelExchange") is not None,
            co_simulation=root.find("CoSimulation") is not None,
            interface=offered.kind,
            completed_steps=exchanged and offered.wants_completed_steps(self.version),
            needs_tool=offered.needs_tool,
            aliases=self.aliases,
            event_mode=offered.can("hasEventMode"),
            early_return=offered.can("mightReturnEarlyFromDoStep", "canReturnEarlyAfterIntermediateUpdate"),
            clocks=self.clocks,
        )
        with suppress(TimeError):  # a hint, of which the schema has said what is wrong
            internal = _seconds(simulation.get("fixedInternalStepSize") or "0", "fixedInternalStepSize")
            result.internal_step = internal if internal > 0 else None
        experiment = root.find("DefaultExperiment")
        if experiment is not None:
            self.at = experiment
            if experiment.get("stepSize"):
                step = _seconds(experiment.get("stepSize"), "DefaultExperiment: stepSize")
                result.default_step = step if step > 0 else None  # some tools write 0 for "none"
            with suppress(TimeError):  # a hint, too
                stop = experiment.get("stopTime")
                result.default_stop = _seconds(stop, "DefaultExperiment: stopTime") if stop else None
            if experiment.get("tolerance"):
                result.tolerance = _number(experiment.get("tolerance"), "DefaultExperiment: tolerance")
                if not 0 < result.tolerance < math.inf:
                    result.tolerance = None
        result.default_step = result.default_step or result.internal_step
        if own is not None:
            self.at = own
            result.kind = own.get("kind")
            if result.kind not in (None, "discrete", "continuous"):
                raise _Unreadable(f"Component: kind is {_short(result.kind)}; it must be discrete or continuous")
            if own.get("sampleTime"):
                result.sample_time = _seconds(own.get("sampleTime"), "Component: sampleTime")
        self.at = structure
        if structure is not None:
            self.read_structure(structure, result)
        return result

    def each(self, elements: Iterable[Any]) -> Iterator[Any]:
        """The elements; messages tell the line of the one that is being read."""
        for self.at in elements:
            yield self.at
        self.at = None

    def take(self, name: str) -> None:
        """Note a name, which no other variable may have."""
        line = self.at.sourceline
        if name in self.lines:
            raise _Unreadable(f"variable '{one_line(name, 80)}' is already defined in line {self.lines[name]}")
        self.lines[name] = line

    def check_count(self, more: int, what: str) -> None:
        """Raise when so many variables more are too many."""
        count = len(self.variables) + more
        if count > self.limits.variables:
            raise _Unreadable(f"{what}, {count} variables in all; {self.limits.remedy('variables', count)}")

    def annotate(self, own: Any) -> None:
        """Constants that the annotation tells of outputs and wants of inputs, and sources of values."""
        changed: dict[str, Variable] = {}
        sources: dict[str, str] = {}  # of variables and whole arrays
        for element in self.each(own):
            if element.tag == "Variable":
                sources[element.get("name", "")] = _source(element)
                continue
            variable = self.variables.get(element.get("name", ""))
            if variable is None:
                continue
            if element.tag == "Input":
                what = f"Input '{variable.name}'"
                if element.get("optional") == "true":
                    changed[variable.name] = replace(variable, optional=True)
                    continue
                value, tolerance = (_number(element.get(k, ""), f"{what}: {k}") for k in ("mustEqual", "tolerance"))
                changed[variable.name] = replace(variable, must_equal=value, tolerance=tolerance)
            elif element.tag == "Output":
                changed[variable.name] = replace(
                    variable, constant=_number(element.get("constant", ""), f"Output '{variable.name}': constant")
                )
        for variable in self.variables.values() if sources else ():
            if source := sources.get(variable.name) or sources.get(split_index(variable.name)[0]):
                changed[variable.name] = replace(changed.get(variable.name, variable), source=source)
        self.variables.update(changed)
        self.by_key = {key: [changed.get(v.name, v) for v in listed] for key, listed in self.by_key.items()}

    def dependencies(self, element: Any) -> frozenset[str] | None:
        listed = element.get("dependencies")
        if listed is None:
            return None
        if listed not in self.listed:
            self.check_dependencies(listed.count(" ") + 1)
            keys = dict.fromkeys(listed.split())
            named = [self.named(key, "dependencies") for key in keys]
            self.count += sum(map(len, named))
            self.check_dependencies(0)
            names = [v.name for variables in named for v in variables]
            self.listed[listed] = frozenset(names)
        return self.listed[listed]

    def named(self, key: str | None, what: str) -> list[Variable]:
        """What a number of the model structure, or of a derivative, stands for."""
        number = _whole(key, f"ModelStructure: {what}", 0, 2**32 - 1)
        if number not in self.by_key:
            raise _Unreadable(f"ModelStructure: {what} is {number}, and there is no such variable")
        return self.by_key[number]

    def check_dependencies(self, more: int) -> None:
        """Raise when so many names more in lists of dependencies are too many."""
        count = self.count + more
        if count > self.limits.dependencies:
            remedy = self.limits.remedy("dependencies", count)
            raise _Unreadable(f"ModelStructure: its dependencies have {count} names; {remedy}")

    def unknowns(self, elements: Any, key: str, result: Description) -> list[Variable]:
        found = []
        for element in self.each(elements):
            variables = self.named(element.get(key), key)
            found += variables
            depends = self.dependencies(element)
            if depends is not None:
                for variable in variables:
                    result.dependencies[variable.name] = depends
        return found

    def initial_dependencies(self, elements: Any, key: str, result: Description) -> None:
        """Read on which inputs outputs depend in initialization."""
        inputs, outputs = (
            {
                str(k): [v.name for v in found]
                for k, found in self.by_key.items()
                if found and found[0].causality == kind
            }
            for kind in ("input", "output")
        )
        for element in elements:
            of, on = outputs.get(element.get(key), ()), element.get("dependencies")
            if of and on is not None:
                names = frozenset(name for k in on.split() for name in inputs.get(k, ()))
                result.initial_dependencies.update(dict.fromkeys(of, names))

    def pair_states(self, pairs: list[tuple[Variable, Variable | None]], result: Description) -> None:
        result.states = [state for _, state in pairs if state is not None]
        result.derivatives = [derivative for derivative, state in pairs if state is not None]
        result.unpaired = next((derivative.name for derivative, state in pairs if state is None), "")

    def read_variables(self) -> None:
        raise NotImplementedError

    def read_structure(self, structure: Any, result: Description) -> None:
        raise NotImplementedError

    def annotation(self) -> Any:
        raise NotImplementedError


class _Fmi2(_Reader):
    version = "2"

    def read_variables(self) -> None:
        types = type_attributes(self.root, self.version)
        self.derivative_of: dict[str, int] = {}
        scalars = self.each(self.root.iterfind("ModelVariables/ScalarVariable"))
        for position, element in enumerate(scalars, start=1):
            name = _name(element, f"variable number {position}")
            self.take(name)
            self.check_count(1, f"with variable '{one_line(name, 80)}'")
            typed = next((c for c in element if c.tag in TYPES2), None)
            if typed is None:
                others = [c.tag for c in element if c.tag in TYPES3]
                raise _Unreadable(
                    f"variable '{name}' is {others[0]}, a type of FMI 3.0; this file declares FMI 2.0"
                    if others
                    else f"variable '{name}' has no type; it needs one of {', '.join(TYPES2)}"
                )
            attributes = {**types.get(typed.get("declaredType"), {}), **typed.attrib}
            variable = _variable(element, (typed.tag, TYPES2[typed.tag]), attributes, self)
            self.variables[variable.name] = variable
            self.by_key[position] = [variable]
            if typed.get("derivative"):
                self.derivative_of[variable.name] = _integer(typed, "derivative", f"variable '{variable.name}'")

    def read_structure(self, structure: Any, result: Description) -> None:
        self.unknowns(structure.iterfind("Outputs/Unknown"), "index", result)
        derivatives = self.unknowns(structure.iterfind("Derivatives/Unknown"), "index", result)
        self.initial_dependencies(structure.iterfind("InitialUnknowns/Unknown"), "index", result)
        pairs: list[tuple[Variable, Variable | None]] = []
        for derivative in derivatives:
            position = self.derivative_of.get(derivative.name)
            pairs.append((derivative, self.named(str(position), "derivative")[0] if position else None))
        self.pair_states(pairs, result)
        result.event_indicators = _whole(
            self.root.get("numberOfEventIndicators", "0"), "numberOfEventIndicators", 0, self.limits.variables
        )

    def annotation(self) -> Any:
        return self.root.find(f"VendorAnnotations/Tool[@name='{TOOL}']/Component")


class _Fmi3(_Reader):
    version = "3"

    def read_variables(self) -> None:
        types = type_attributes(self.root, self.version)
        elements = [e for e in self.root.iterfind("ModelVariables/*") if isinstance(e.tag, str)]
        sizes = {
            e.get("valueReference"): e.get("start")
            for e in elements
            if e.get("causality") == "structuralParameter" and e.get("start")
        }
        self.derivative_of: dict[int, int] = {}
        self.declared: dict[int, str] = {}  # names by reference
        for position, element in enumerate(self.each(elements), start=1):
            name = _name(element, f"variable number {position}")
            if element.tag not in TYPES3:
                kind = (
                    f"{element.tag}, a type of FMI 2.0; this file declares FMI 3.0"
                    if element.tag in TYPES2
                    else element.tag
                )
                raise _Unreadable(f"variable '{name}' is {kind}; the types are {', '.join(TYPES3)}")
            attributes: dict[str, Any] = {**types.get(element.get("declaredType"), {}), **element.attrib}
            shape = [self.dimension(d, name, sizes) for d in element.iterfind("Dimension")]
            starts = [s.get("value", "") for s in element.iterfind("Start")]
            if starts:
                attributes["start"] = starts if shape else starts[0]
            if len(shape) > self.limits.dimensions:
                remedy = self.limits.remedy("dimensions", len(shape))
                raise _Unreadable(f"array '{name}' has {len(shape)} dimensions; {remedy}")
            what = f"array '{name}' has {' x '.join(map(str, shape))} elements" if shape else f"with variable '{name}'"
            self.check_count(math.prod(shape), what)
            if shape and len(name) * math.prod(shape) > self.limits.xml_bytes:
                raise _Unreadable(f"the names of {math.prod(shape)} elements of {_short(name)} are too long")
            typed = element.tag, TYPES3[element.tag]
            variable = _variable(element, typed, attributes, self, bool(shape))
            reference, expanded = variable.reference, _expand(variable, shape)
            if reference in self.by_key:
                other = self.declared[reference]
                raise _Unreadable(f"variable '{name}' has the value reference {reference}, which '{other}' has already")
            self.by_key[reference], self.declared[reference] = expanded, name
            for one in dict.fromkeys([name, *(v.name for v in expanded)]):
                self.take(one)
            self.variables.update((v.name, v) for v in expanded)
            if element.get("derivative"):
                self.derivative_of[reference] = _integer(element, "derivative", f"variable '{name}'")
            if element.tag == "Clock":
                self.clocks.append(_clock(variable, attributes))
            for alias in element.iterfind("Alias"):
                further = _name(alias, f"an Alias of '{name}'")
                self.take(further)
                self.aliases[further] = name

    def dimension(self, element: Any, name: str, sizes: dict[str, str]) -> int:
        text = element.get("start")
        if text is None:
            text = sizes.get(element.get("valueReference"))
            if text is None:
                raise _Unreadable(
                    f"array '{name}': its Dimension has neither a start nor a structural parameter with one"
                )
        return _whole(text.strip(), f"array '{name}': Dimension", 0, 2**63 - 1)

    def read_structure(self, structure: Any, result: Description) -> None:
        self.unknowns(structure.iterfind("Output"), "valueReference", result)
        self.initial_dependencies(structure.iterfind("InitialUnknown"), "valueReference", result)
        if self.clocks:  # otherwise nobody asks
            listed = [
                self.named(e.get("valueReference"), "valueReference")
                for e in self.each(structure.iterfind("InitialUnknown"))
            ]
            result.initial_unknowns = frozenset(v.declared for variables in listed for v in variables)
        derivatives = self.unknowns(structure.iterfind("ContinuousStateDerivative"), "valueReference", result)
        pairs: list[tuple[Variable, Variable | None]] = []
        for derivative in derivatives:
            state = self.by_key.get(self.derivative_of.get(derivative.reference, -1))
            if state and derivative.index >= len(state):
                raise _Unreadable(f"'{derivative.declared}' has more elements than its state '{state[0].declared}'")
            pairs.append((derivative, state[derivative.index] if state else None))
        self.pair_states(pairs, result)
        indicators = self.each(structure.iterfind("EventIndicator"))
        result.event_indicators = sum(len(self.named(e.get("valueReference"), "valueReference")) for e in indicators)

        if result.event_indicators > self.limits.variables:
            raise _Unreadable(f"ModelStructure has {result.event_indicators} event indicators, more than variables")

    def annotation(self) -> Any:
        return self.root.find(f"Annotations/Annotation[@type='{TOOL}']/Component")


def _identifier(simulation: Any) -> str:
    """modelIdentifier: the name of a library without its ending."""
    name: str = simulation.get("modelIdentifier", "")
    if not name or set(name) & set("/\\:") or name.startswith(".") or len(name.encode()) > LONGEST_IDENTIFIER:
        raise _Unreadable(f"modelIdentifier is {_short(name)}; it must be the name of the library without its ending")
    return name


def _name(element: Any, what: str) -> str:
    name: str | None = element.get("name")
    if not name:
        raise _Unreadable(f"{what} has no name")
    return name


def _seconds(text: str, what: str) -> Fraction:
    """A time as tools write it: 0.0333333333333333 means 1/30 s, to the last digit that was printed."""
    exact = rational(text, what)
    near = exact.limit_denominator(10**6)
    return near if abs(near - exact) <= abs(exact) / 10**14 else exact


def _unit(element: Any) -> Unit:
    name = _name(element, "a unit")
    base = element.find("BaseUnit")
    if base is None:
        return Unit(name)
    what = f"unit '{name}'"
    exponents = tuple(_whole(base.get(symbol, "0"), f"{what}: {symbol}", -100, 100) for symbol in BASE_UNITS)
    factor, offset = (_number(base.get(a, d), f"{what}: {a}") for a, d in (("factor", "1"), ("offset", "0")))
    if factor == 0 or not math.isfinite(factor + offset):
        return Unit(name)  # nothing can be converted into it
    return Unit(name, exponents, factor, offset)


def _display(element: Any) -> DisplayUnit | None:
    """A unit for people; None where no number can be shown in it, which keeps nobody from running the FMU."""
    try:
        factor, offset = (float(element.get(a, d)) for a, d in (("factor", "1"), ("offset", "0")))
    except ValueError:
        return None
    usable = factor and math.isfinite(factor) and math.isfinite(offset) and not _flag(element, "inverse")
    return DisplayUnit(element.get("name", ""), factor, offset) if usable else None


def _source(element: Any) -> str:
    source: str = element.get("source", "")
    if len(source) > LONGEST_SOURCE:
        name = _short(element.get("name", ""))
        raise _Unreadable(f"Variable {name}: source has {len(source)} characters; it may have {LONGEST_SOURCE}")
    return source.strip()


def _flag(element: Any, *names: str) -> bool:
    return any(element.get(name) in ("true", "1") for name in names)


_CLOCKS = ("constant", "fixed", "tunable", "changing", "countdown", "triggered")


def _clock(variable: Variable, attributes: dict[str, str]) -> Clock:
    """Interval and shift are exact where they are counted: counter / resolution."""
    what, kind = f"clock '{variable.name}'", attributes.get("intervalVariability", "")
    if kind not in _CLOCKS:
        raise _Unreadable(f"{what}: intervalVariability is {_short(kind)}; it is one of {', '.join(_CLOCKS)}")
    resolution = (
        _whole(attributes["resolution"], f"{what}: resolution", 1, 2**64 - 1) if "resolution" in attributes else None
    )

    def seconds(which: str) -> Fraction | None:
        if resolution is not None and f"{which}Counter" in attributes:
            return Fraction(_whole(attributes[f"{which}Counter"], f"{what}: {which}Counter", 0, 2**64 - 1), resolution)
        text = attributes.get(f"{which}Decimal")
        return None if text is None else _seconds(text, f"{what}: {which}Decimal")

    fractions = attributes.get("supportsFraction") in ("true", "1")
    return Clock(
        variable.name,
        variable.reference,
        variable.causality,
        kind,
        seconds("interval"),
        seconds("shift") or Fraction(0),
        fractions,
    )


def _references(text: str | None, what: str) -> tuple[int, ...]:
    return tuple(_whole(word, f"{what}: clocks", 0, 2**32 - 1) for word in (text or "").split())


def _variable(element: Any, typed: tuple[str, str], attributes: Any, known: _Reader, array: bool = False) -> Variable:
    fmi_type, kind = typed
    name = element.get("name")
    what = f"variable '{name}'"
    unit = attributes.get("unit")
    start = attributes.get("start")
    numeric = kind in ("real", "integer")
    relative = attributes.get("relativeQuantity") in ("true", "1")
    display = known.displays.get((unit, attributes.get("displayUnit")))
    constant = numeric and not array and start is not None and element.get("variability") == "constant"
    return Variable(
        name=name,
        type=kind,
        fmi_type=fmi_type,
        causality=element.get("causality", "local"),
        variability=element.get("variability", "continuous" if kind == "real" else "discrete"),
        initial=element.get("initial"),
        start=start if array else _value(kind, start, what),
        unit=known.units.get(unit, Unit(unit)) if unit else None,
        display=replace(display, offset=0.0) if display and relative else display,
        relative=relative,
        description=element.get("description", ""),
        minimum=_number(attributes["min"], f"{what}: min") if numeric and "min" in attributes else None,
        maximum=_number(attributes["max"], f"{what}: max") if numeric and "max" in attributes else None,
        reference=_integer(element, "valueReference", what, high=2**32 - 1),
        declared=name,
        constant=_number(start, f"{what}: start") if constant else None,
        nominal=nominal_size(_number(attributes.get("nominal", "1"), f"{what}: nominal")),
        mime_type=attributes.get("mimeType", OCTETS) if fmi_type == "Binary" else "",
        max_size=_whole(attributes["maxSize"], f"{what}: maxSize", 0, LARGEST_BINARY)
        if "maxSize" in attributes
        else None,
        clocks=_references(element.get("clocks"), what),
        follows=known.updates and fmi_type == "Float64" and _flag(element, "intermediateUpdate"),
    )


def nominal_size(given: float) -> float:
    """A size of a variable by its nominal value; 1 instead of zero, infinity and NaN, which are none."""
    return abs(given) if 0 < abs(given) < math.inf else 1.0


def _value(kind: str, text: str | None, what: str) -> Any:
    if text is None or kind in ("string", "other"):
        return text
    if kind == "boolean":
        return text.strip() in ("true", "1")
    return _number(text, f"{what}: start") if kind == "real" else _whole(text, f"{what}: start", -(2**63), 2**64 - 1)


def _expand(variable: Variable, shape: list[int]) -> list[Variable]:
    """The elements of an array variable, row major; a scalar gives itself."""
    if not shape:
        return [variable]
    size = math.prod(shape)
    if not size:  # whatever the other dimensions are
        return []
    start = variable.start  # a list of texts: of elements `Start`
    values = [] if start is None else (start if isinstance(start, list) else str(start).split(None, size))[:size]
    if len(values) == 1:
        values *= size
    common = {name: getattr(variable, name) for name in Variable.__slots__}  # type: ignore[attr-defined]
    elements = []
    for index, place in enumerate(itertools.product(*(range(1, n + 1) for n in shape))):
        what = f"variable '{variable.name}'"
        start = _value(variable.type, values[index], what) if index < len(values) else None
        name = f"{variable.name}[{','.join(map(str, place))}]"
        elements.append(Variable(**{**common, "name": name, "start": start, "index": index, "size": size}))
    return elements
