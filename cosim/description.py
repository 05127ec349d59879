"""What a component says about itself: its variables, units, dependencies and capabilities.

`parse` reads a modelDescription.xml of FMI 2.0 or 3.0. FMI 3 arrays are expanded to their elements
(`preview.fl[3]`, `gain.y[2,3]`, 1-based, row major), so both versions wire by the same names.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

from lxml import etree

from cosim.errors import FmuError, WiringError, did_you_mean
from cosim.timebase import rational
from cosim.units import BASE_UNITS, Unit

TOOL = "suspension-fmus"  # our vendor annotation: kind and sample time, constants that source and target must share


@dataclass(frozen=True, slots=True, eq=False)
class Variable:
    """One scalar variable, or one element of an FMI 3 array (`index` in an array of `size` elements)."""

    name: str
    type: str  # "real", "integer", "boolean", "string", "other"
    fmi_type: str = "Real"  # the name in the FMI functions: Real, Integer, Float64, Int32, ...
    causality: str = "local"
    variability: str = "continuous"
    initial: str | None = None
    start: Any = None
    unit: Unit | None = None
    relative: bool = False
    description: str = ""
    minimum: float | None = None
    maximum: float | None = None
    reference: int = 0
    index: int = 0
    size: int = 1
    declared: str = ""  # name of the array, or the variable's own
    constant: float | None = None  # the value that an output always has
    must_equal: float | None = None  # of an input: the constant that its source must have
    tolerance: float = 0.0  # difference from `must_equal` that passes

    @property
    def unit_name(self) -> str:
        return self.unit.name if self.unit else ""

    def accepts(self, value: float) -> bool:
        """Whether an input may have this value: where it must equal a constant that one, or 0 (not connected)."""
        return self.must_equal is None or value == 0 or abs(value - self.must_equal) <= self.tolerance

    def refusal(self, value: float) -> str:
        """Why it may not, for messages."""
        unit = f" {self.unit_name}" if self.unit else ""
        return (
            f"must equal {self.must_equal:.9g}{unit}, not {value:.9g}{unit}: what this component was built for; build one of "
            "the two for the other's value"
        )


@dataclass
class Description:
    """A component's variables and capabilities. `dependencies` maps an output to the names of the variables
    it depends on directly; an output that is missing there depends on all inputs."""

    name: str
    variables: dict[str, Variable]
    fmi_version: str = ""
    token: str = ""
    identifier: str = ""
    text: str = ""
    tool: str = ""
    kind: str | None = None  # "discrete" or "continuous" if the component says so
    sample_time: Fraction | None = None
    default_step: Fraction | None = None
    tolerance: float | None = None
    can_save: bool = False
    can_serialize: bool = False
    only_once: bool = False
    variable_step: bool = False
    directional_derivatives: bool = False
    dependencies: dict[str, frozenset[str]] = field(default_factory=dict)
    states: list[Variable] = field(default_factory=list)
    derivatives: list[Variable] = field(default_factory=list)
    log_categories: list[str] = field(default_factory=list)
    model_exchange: bool = False

    def __post_init__(self) -> None:
        self.inputs = {v.name: v for v in self.variables.values() if v.causality == "input"}
        self.outputs = {v.name: v for v in self.variables.values() if v.causality == "output"}
        self.parameters = {
            v.name: v for v in self.variables.values() if v.causality in ("parameter", "structuralParameter")
        }
        self.arrays: dict[str, list[str]] = {}
        for name in self.variables:
            if name.endswith("]"):
                self.arrays.setdefault(name[: name.rindex("[")], []).append(name)

    def find(self, name: str, component: str = "") -> Variable:
        """The variable of that name; raises WiringError with the nearest match."""
        try:
            return self.variables[name]
        except KeyError:
            owner = f"component '{component}' ({self.name})" if component else f"'{self.name}'"
            raise WiringError(f"{owner} has no variable '{name}'{did_you_mean(name, self.variables)}") from None

    def depends(self, output: str) -> frozenset[str]:
        """Names of the inputs an output depends on directly."""
        known = self.dependencies.get(output)
        return frozenset(self.inputs) if known is None else known & self.inputs.keys()


_SCALAR_TYPES = {
    "Real": "real", "Float64": "real", "Float32": "real", "Boolean": "boolean", "String": "string",
    "Integer": "integer", "Enumeration": "integer", "Int8": "integer", "UInt8": "integer", "Int16": "integer",
    "UInt16": "integer", "Int32": "integer", "UInt32": "integer", "Int64": "integer", "UInt64": "integer",
}  # fmt: skip


def parse(xml: bytes, where: str) -> Description:
    """Description from modelDescription.xml; `where` names the file in errors. Raises FmuError."""
    try:
        root = etree.fromstring(xml, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True))
    except etree.XMLSyntaxError as error:
        raise FmuError(f"{where}: modelDescription.xml is not well-formed ({error})") from None
    version = root.get("fmiVersion", "")
    if root.tag != "fmiModelDescription" or not version.startswith(("2.", "3.")):
        raise FmuError(f"{where}: FMI version '{version or 'unknown'}'; FMI 2.0 and 3.0 are supported")
    simulation = root.find("CoSimulation")
    if simulation is None:
        kinds = [tag for tag in ("ModelExchange", "ScheduledExecution") if root.find(tag) is not None]
        raise FmuError(
            f"{where}: not a Co-Simulation FMU (it offers {' and '.join(kinds) or 'nothing'}); "
            "export it again for Co-Simulation"
        )
    try:
        read = _Fmi2(root) if version.startswith("2.") else _Fmi3(root)
        return read.description(simulation)
    except (KeyError, ValueError, TypeError, AttributeError) as error:
        raise FmuError(f"{where}: cannot understand modelDescription.xml ({type(error).__name__}: {error})") from error


class _Reader:
    """What FMI 2.0 and 3.0 have in common."""

    def __init__(self, root: Any):
        self.root = root
        self.units = {u.get("name"): _unit(u) for u in root.iterfind("UnitDefinitions/Unit")}
        self.variables: dict[str, Variable] = {}
        self.by_key: dict[int, list[Variable]] = {}  # FMI 2: 1-based position; FMI 3: value reference

    def description(self, simulation: Any) -> Description:
        root = self.root
        self.read_variables()
        own = self.annotation()
        if own is not None:
            self.annotate(own)
        structure = root.find("ModelStructure")
        result = Description(
            name=root.get("modelName", ""),
            variables=self.variables,
            fmi_version=root.get("fmiVersion"),
            token=root.get("guid") or root.get("instantiationToken") or "",
            identifier=simulation.attrib["modelIdentifier"],
            text=root.get("description", ""),
            tool=root.get("generationTool", ""),
            can_save=_flag(simulation, "canGetAndSetFMUstate", "canGetAndSetFMUState"),
            can_serialize=_flag(simulation, "canSerializeFMUstate", "canSerializeFMUState"),
            only_once=_flag(simulation, "canBeInstantiatedOnlyOncePerProcess"),
            variable_step=_flag(simulation, "canHandleVariableCommunicationStepSize"),
            directional_derivatives=_flag(
                simulation, "providesDirectionalDerivative", "providesDirectionalDerivatives"
            ),
            log_categories=[c.get("name") for c in root.iterfind("LogCategories/Category")],
            model_exchange=root.find("ModelExchange") is not None,
        )
        experiment = root.find("DefaultExperiment")
        if experiment is not None:
            if experiment.get("stepSize"):
                result.default_step = rational(experiment.get("stepSize"))
            if experiment.get("tolerance"):
                result.tolerance = float(experiment.get("tolerance"))
        if own is not None:
            result.kind = own.get("kind")
            if own.get("sampleTime"):
                result.sample_time = rational(own.get("sampleTime"))
        if structure is not None:
            self.read_structure(structure, result)
        return result

    def annotate(self, own: Any) -> None:
        """Constants that the annotation tells of outputs and wants of inputs."""
        changed: dict[str, Variable] = {}
        for element in own:
            variable = self.variables.get(element.get("name", ""))
            if variable is None:
                continue
            if element.tag == "Input":
                value, tolerance = (float(element.get(key)) for key in ("mustEqual", "tolerance"))
                changed[variable.name] = replace(variable, must_equal=value, tolerance=tolerance)
            elif element.tag == "Output":
                changed[variable.name] = replace(variable, constant=float(element.get("constant")))
        self.variables.update(changed)
        self.by_key = {key: [changed.get(v.name, v) for v in listed] for key, listed in self.by_key.items()}

    def dependencies(self, element: Any) -> frozenset[str] | None:
        listed = element.get("dependencies")
        if listed is None:
            return None
        return frozenset(v.name for key in listed.split() for v in self.by_key[int(key)])

    def unknowns(self, elements: Any, key: str, result: Description) -> list[Variable]:
        found = []
        for element in elements:
            variables = self.by_key[int(element.get(key))]
            found += variables
            depends = self.dependencies(element)
            if depends is not None:
                for variable in variables:
                    result.dependencies[variable.name] = depends
        return found

    def pair_states(self, pairs: list[tuple[Variable, Variable | None]], result: Description) -> None:
        result.states = [state for _, state in pairs if state is not None]
        result.derivatives = [derivative for derivative, state in pairs if state is not None]

    def read_variables(self) -> None:
        raise NotImplementedError

    def read_structure(self, structure: Any, result: Description) -> None:
        raise NotImplementedError

    def annotation(self) -> Any:
        raise NotImplementedError


class _Fmi2(_Reader):
    def read_variables(self) -> None:
        types = {t.get("name"): t[0] for t in self.root.iterfind("TypeDefinitions/SimpleType") if len(t)}
        self.derivative_of: dict[str, int] = {}
        for position, element in enumerate(self.root.iterfind("ModelVariables/ScalarVariable"), start=1):
            typed = next(c for c in element if c.tag in _SCALAR_TYPES)
            declared = types.get(typed.get("declaredType"))
            inherited: dict[str, str] = dict(declared.attrib) if declared is not None else {}
            variable = _variable(element, typed.tag, {**inherited, **typed.attrib}, self.units)
            self.variables[variable.name] = variable
            self.by_key[position] = [variable]
            if typed.get("derivative"):
                self.derivative_of[variable.name] = int(typed.get("derivative"))

    def read_structure(self, structure: Any, result: Description) -> None:
        self.unknowns(structure.iterfind("Outputs/Unknown"), "index", result)
        derivatives = self.unknowns(structure.iterfind("Derivatives/Unknown"), "index", result)
        pairs: list[tuple[Variable, Variable | None]] = []
        for derivative in derivatives:
            position = self.derivative_of.get(derivative.name)
            pairs.append((derivative, self.by_key[position][0] if position else None))
        self.pair_states(pairs, result)

    def annotation(self) -> Any:
        return self.root.find(f"VendorAnnotations/Tool[@name='{TOOL}']/Component")


class _Fmi3(_Reader):
    def read_variables(self) -> None:
        types = {t.get("name"): t for t in self.root.iterfind("TypeDefinitions/*")}
        elements = [e for e in self.root.iterfind("ModelVariables/*") if isinstance(e.tag, str)]
        sizes = {
            e.get("valueReference"): int(e.get("start").split()[0])
            for e in elements
            if e.get("causality") == "structuralParameter" and e.get("start")
        }
        self.derivative_of: dict[int, int] = {}
        for element in elements:
            declared = types.get(element.get("declaredType"))
            inherited: dict[str, str] = dict(declared.attrib) if declared is not None else {}
            inherited.pop("name", None)
            inherited.pop("description", None)
            attributes = {**inherited, **element.attrib}
            start = element.find("Start")
            if start is not None:
                attributes["start"] = start.get("value", "")
            shape = [
                int(d.get("start")) if d.get("start") is not None else sizes[d.get("valueReference")]
                for d in element.iterfind("Dimension")
            ]
            reference = int(element.get("valueReference"))
            expanded = _expand(_variable(element, element.tag, attributes, self.units, bool(shape)), shape)
            self.by_key[reference] = expanded
            self.variables.update((v.name, v) for v in expanded)
            if element.get("derivative"):
                self.derivative_of[reference] = int(element.get("derivative"))

    def read_structure(self, structure: Any, result: Description) -> None:
        self.unknowns(structure.iterfind("Output"), "valueReference", result)
        derivatives = self.unknowns(structure.iterfind("ContinuousStateDerivative"), "valueReference", result)
        pairs: list[tuple[Variable, Variable | None]] = []
        for derivative in derivatives:
            state = self.by_key.get(self.derivative_of.get(derivative.reference, -1))
            pairs.append((derivative, state[derivative.index] if state else None))
        self.pair_states(pairs, result)

    def annotation(self) -> Any:
        return self.root.find(f"Annotations/Annotation[@type='{TOOL}']/Component")


def _unit(element: Any) -> Unit:
    base = element.find("BaseUnit")
    if base is None:
        return Unit(element.get("name"))
    exponents = tuple(int(base.get(symbol, "0")) for symbol in BASE_UNITS)
    return Unit(element.get("name"), exponents, float(base.get("factor", "1")), float(base.get("offset", "0")))


def _flag(element: Any, *names: str) -> bool:
    return any(element.get(name) in ("true", "1") for name in names)


def _variable(element: Any, tag: str, attributes: Any, units: dict[str, Unit], array: bool = False) -> Variable:
    kind = _SCALAR_TYPES.get(tag, "other")
    unit = attributes.get("unit")
    start = attributes.get("start")
    numeric = kind in ("real", "integer")
    constant = numeric and not array and start is not None and element.get("variability") == "constant"
    return Variable(
        name=element.get("name"),
        type=kind,
        fmi_type=tag,
        causality=element.get("causality", "local"),
        variability=element.get("variability", "continuous" if kind == "real" else "discrete"),
        initial=element.get("initial"),
        start=start if array else _value(kind, start),
        unit=units.get(unit, Unit(unit)) if unit else None,
        relative=attributes.get("relativeQuantity") in ("true", "1"),
        description=element.get("description", ""),
        minimum=float(attributes["min"]) if numeric and "min" in attributes else None,
        maximum=float(attributes["max"]) if numeric and "max" in attributes else None,
        reference=int(element.get("valueReference")),
        declared=element.get("name"),
        constant=float(start) if constant else None,
    )


def _value(kind: str, text: str | None) -> Any:
    if text is None or kind in ("string", "other"):
        return text
    if kind == "boolean":
        return text.strip() in ("true", "1")
    return float(text) if kind == "real" else int(text)


def _expand(variable: Variable, shape: list[int]) -> list[Variable]:
    """The elements of an array variable, row major; a scalar gives itself."""
    if not shape:
        return [variable]
    values = str(variable.start).split() if variable.start is not None else []
    size = math.prod(shape)
    if len(values) == 1:
        values *= size
    common = {name: getattr(variable, name) for name in Variable.__slots__}  # type: ignore[attr-defined]
    elements = []
    for index, place in enumerate(itertools.product(*(range(1, n + 1) for n in shape))):
        start = _value(variable.type, values[index]) if index < len(values) else None
        name = f"{variable.name}[{','.join(map(str, place))}]"
        elements.append(Variable(**{**common, "name": name, "start": start, "index": index, "size": size}))
    return elements
