"""What a modelDescription.xml says, taken at its word: nothing is refused, so that everything can be checked.

`cosim.fmu.model_description` reads for the master, which refuses what it cannot run. Here what is missing or nonsense
is None, for a check to find. Plain data without the XML tree, so that it can be handed to the process in which the FMU
runs.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from cosim.core.description import SIZED_INTEGERS
from cosim.fmu.calls import accessed_as
from cosim.fmu.interface import INTERFACES, Interface
from cosim.fmu.model_description import TYPES2, TYPES3, type_attributes

FLOATS = ("Real", "Float64", "Float32")
MOST_ELEMENTS = 2**48  # of an array: more than any memory holds, and little enough for sums and sizes in bytes

DEFAULT_INITIAL = {
    "exact": {
        ("constant", "output"),
        ("constant", "local"),
        *((v, c) for v in ("fixed", "tunable") for c in ("parameter", "structuralParameter")),
    },
    "calculated": {
        *((v, c) for v in ("fixed", "tunable") for c in ("calculatedParameter", "local")),
        *((v, c) for v in ("discrete", "continuous") for c in ("output", "local")),
    },
    "input": {("discrete", "input"), ("continuous", "input")},
    "none": {("continuous", "independent")},
}
"""(variability, causality) -> the default of `initial`; what is not here is not allowed."""


@dataclass(frozen=True, eq=False)
class Var:
    """One variable as it is declared, an array included.

    Attributes:
        type: name of its element (`Real`, `Float64`, ...); access: name in the functions that get and set it.
        variability, initial: as they count, defaults put in; `says` holds what is written.
        start: text, None without; size: number of elements, 1 for scalars; derivative: key of what it derives (FMI 2:
            position, FMI 3: reference).
    """

    name: str
    position: int
    line: int
    reference: int | None
    type: str
    access: str
    causality: str
    variability: str
    initial: str | None
    says: dict[str, str]
    start: str | None
    low: float | None
    high: float | None
    nominal: float | None
    unit: str | None
    derivative: int | None
    size: int = 1
    aliases: tuple[str, ...] = ()
    clocked: bool = False

    @property
    def is_float(self) -> bool:
        """Whether it is a floating-point variable."""
        return self.type in FLOATS

    @property
    def is_number(self) -> bool:
        """Whether it is a floating-point or integer variable."""
        return self.is_float or self.access == "Integer" or self.access in SIZED_INTEGERS

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest value; infinite where it has no limit."""
        return -math.inf if self.low is None else self.low, math.inf if self.high is None else self.high

    @property
    def passed_reference(self) -> int:
        """Value reference as it is passed: an invalid one as C would convert it."""
        return (self.reference or 0) & 0xFFFFFFFF

    @property
    def key(self) -> tuple[int | None, str]:
        """Value reference and type of access, which identify the value in FMI 2."""
        return self.reference, self.access

    def starts(self) -> list[Any] | None:
        """Start values of all elements; None: there are none, or they cannot be read."""
        if self.start is None or self.type in ("Binary", "Clock"):
            return None
        if self.access == "String":
            return [self.start] if self.size == 1 else None
        read = {"Boolean": _boolean}.get(self.access, float if self.is_float else int)
        try:
            values = [read(t) for t in self.start.split()]
        except ValueError:
            return None
        if len(values) == 1:
            values *= self.size
        return values if len(values) == self.size else None


@dataclass(frozen=True)
class Unknown:
    """An element of ModelStructure: the variable, and what it depends on (None: on everything)."""

    group: str  # Output, Derivative, InitialUnknown, EventIndicator, ClockedState
    line: int
    key: int | None
    depends: tuple[int, ...] | None
    kinds: tuple[str, ...] | None


@dataclass
class Model:
    """A modelDescription.xml. Keys of variables are positions from 1 on in FMI 2, value references in FMI 3."""

    version: str  # "2" or "3"
    fmi: str  # as it is written
    name: str
    token: str
    tool: str
    says: dict[str, str]
    variables: list[Var]
    structure: list[Unknown]
    interfaces: dict[str, Interface]
    experiment: dict[str, float]
    categories: list[str] = field(default_factory=list)
    indicators: int = 0
    scheduled: bool = False
    structural: bool = False
    clocks: bool = False
    # periodic input clocks: reference, interval, shift [s]; NaN: the FMU says it
    ticking: tuple[tuple[int, float, float], ...] = ()

    def __post_init__(self) -> None:
        self.by_key: dict[int, Var] = {}
        for v in self.variables:
            key = v.position if self.version == "2" else v.reference
            if key is not None:
                self.by_key.setdefault(key, v)

    def key(self, v: Var) -> int | None:
        """Key of a variable: its position from 1 on in FMI 2, its value reference in FMI 3."""
        return v.position if self.version == "2" else v.reference

    def of(self, *causalities: str) -> list[Var]:
        """Variables of these causalities."""
        return [v for v in self.variables if v.causality in causalities]

    def unknowns(self, *groups: str) -> list[tuple[Unknown, Var]]:
        """Elements of ModelStructure that are of these groups (default: of all), with their variables, in order."""
        of = [u for u in self.structure if not groups or u.group in groups]
        return [(u, self.by_key[u.key]) for u in of if u.key in self.by_key]

    def listed(self, group: str) -> list[Var]:
        """Variables of a group of ModelStructure, in order."""
        return [v for _, v in self.unknowns(group)]

    def state_of(self, derivative: Var) -> Var | None:
        """The state of which a variable is the derivative; None if it is not a derivative."""
        return None if derivative.derivative is None else self.by_key.get(derivative.derivative)

    @property
    def states(self) -> list[Var]:
        """Continuous states in the order of their derivatives."""
        found = (self.state_of(d) for d in self.listed("Derivative"))
        return [s for s in found if s is not None]

    @property
    def n_states(self) -> int:
        """Number of continuous states, with all elements of arrays."""
        return sum(v.size for v in self.listed("Derivative"))

    @property
    def n_indicators(self) -> int:
        """Number of event indicators."""
        return self.indicators if self.version == "2" else sum(v.size for v in self.listed("EventIndicator"))

    @property
    def start_time(self) -> float:
        """Start time of the default experiment [s], by default 0."""
        return self.experiment.get("startTime", 0.0)

    @property
    def step(self) -> float:
        """A communication step [s]: that of the default experiment, or a thousandth of it."""
        step = self.experiment.get("stepSize", math.nan)
        if step > 0 and math.isfinite(step):
            return step
        stop = self.experiment.get("stopTime", math.nan) - self.start_time
        return stop / 1000 if 0 < stop < math.inf else 1e-3


def read(root: Any) -> Model:
    """From the root element of modelDescription.xml."""
    version = "3" if root.get("fmiVersion", "").startswith("3") else "2"
    variables = _variables(root, version)
    interfaces = {}
    for kind, tag in INTERFACES.items():
        element = root.find(tag)
        if element is not None:
            interfaces[kind] = Interface.of(kind, element)
    experiment = root.find("DefaultExperiment")
    numbers = {} if experiment is None else {k: number(v) for k, v in experiment.attrib.items()}
    return Model(
        version=version,
        fmi=root.get("fmiVersion", ""),
        name=root.get("modelName", ""),
        token=root.get("guid" if version == "2" else "instantiationToken", ""),
        tool=root.get("generationTool", ""),
        says=dict(root.attrib),
        variables=variables,
        structure=list(_structure(root, version)),
        interfaces=interfaces,
        experiment={k: v for k, v in numbers.items() if v is not None},
        categories=[c.get("name", "") for c in root.iterfind("LogCategories/Category")],
        indicators=max(0, _whole(root.get("numberOfEventIndicators")) or 0),
        scheduled=root.find("ScheduledExecution") is not None,
        structural=any(v.causality == "structuralParameter" for v in variables),
        clocks=any(v.type == "Clock" for v in variables),
        ticking=tuple(_ticking(variables)),
    )


def clock_seconds(says: dict[str, str], what: str) -> float | None:
    """`interval` or `shift` of a clock [s], as far as it is written: exactly as a counter, else as a decimal number."""
    resolution, counter = _whole(says.get("resolution")), _whole(says.get(f"{what}Counter"))
    return counter / resolution if resolution and counter is not None else number(says.get(f"{what}Decimal"))


def _ticking(variables: Iterable[Var]) -> Iterator[tuple[int, float, float]]:
    for v in variables:
        periodic = (
            v.type == "Clock"
            and v.causality == "input"
            and v.says.get("intervalVariability") in ("constant", "fixed", "tunable")
        )
        interval = clock_seconds(v.says, "interval")
        if periodic and v.reference is not None and (interval is None or 0 < interval < math.inf):
            yield v.passed_reference, math.nan if interval is None else interval, clock_seconds(v.says, "shift") or 0.0


def default_initial(variability: str, causality: str) -> str | None:
    """Default of `initial`: "exact", "calculated", "input" or "none"; None if the combination is not allowed."""
    return next((d for d, pairs in DEFAULT_INITIAL.items() if (variability, causality) in pairs), None)


def _variables(root: Any, version: str) -> list[Var]:
    """All variables. Only FMI 3.0 has elements `Start`, `Dimension` and `Alias`."""
    types = type_attributes(root, version)
    if version == "2":
        scalars = root.iterfind("ModelVariables/ScalarVariable")
        elements = [(e, next((c for c in e if c.tag in TYPES2), None)) for e in scalars]
    else:
        elements = [(e, e) for e in root.iterfind("ModelVariables/*") if e.tag in TYPES3]
    sizes = {
        e.get("valueReference"): e.get("start") for e, _ in elements if e.get("causality") == "structuralParameter"
    }
    found = []
    for position, (element, typed) in enumerate(elements, start=1):
        if typed is None:
            continue
        type_, causality = typed.tag, element.get("causality", "local")
        variability = element.get("variability", "continuous" if version == "2" or type_ in FLOATS else "discrete")
        default = default_initial(variability, causality)
        says = {**typed.attrib, **element.attrib}
        attributes = {**types.get(typed.get("declaredType"), {}), **typed.attrib}
        if starts := [s.get("value", "") for s in element.iterfind("Start")]:
            attributes["start"] = " ".join(starts)
        low, high, nominal = (number(attributes.get(k)) for k in ("min", "max", "nominal"))
        found.append(
            Var(
                name=element.get("name", ""),
                position=position,
                line=element.sourceline,
                reference=_whole(element.get("valueReference")),
                type=type_,
                access=accessed_as(version, type_),
                causality=causality,
                variability=variability,
                initial=element.get("initial") or {"input": "exact", "none": None}.get(default or "none", default),
                says=says,
                start=attributes.get("start"),
                low=low,
                high=high,
                nominal=nominal,
                unit=attributes.get("unit"),
                derivative=_whole(attributes.get("derivative")),
                size=min(math.prod(_size(d, sizes) for d in element.iterfind("Dimension")), MOST_ELEMENTS),
                aliases=tuple(a.get("name", "") for a in element.iterfind("Alias")),
                clocked="clocks" in says,
            )
        )
    return found


def _size(dimension: Any, sizes: dict[str, str]) -> int:
    text = dimension.get("start")
    return _whole(sizes.get(dimension.get("valueReference")) if text is None else text) or 0


_GROUPS = {
    "2": (
        ("Output", "Outputs/Unknown"),
        ("Derivative", "Derivatives/Unknown"),
        ("InitialUnknown", "InitialUnknowns/Unknown"),
    ),
    "3": (
        ("Output", "Output"),
        ("Derivative", "ContinuousStateDerivative"),
        ("InitialUnknown", "InitialUnknown"),
        ("EventIndicator", "EventIndicator"),
        ("ClockedState", "ClockedState"),
    ),
}


def _structure(root: Any, version: str) -> Iterable[Unknown]:
    for group, path in _GROUPS[version]:
        for element in root.iterfind(f"ModelStructure/{path}"):
            depends, kinds = element.get("dependencies"), element.get("dependenciesKind")
            yield Unknown(
                group,
                element.sourceline,
                _whole(element.get("index" if version == "2" else "valueReference")),
                None if depends is None else tuple(-1 if (k := _whole(d)) is None else k for d in depends.split()),
                None if kinds is None else tuple(kinds.split()),
            )


def number(text: str | None) -> float | None:
    """The number that a text states; None without a text, or where it states no number."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


def _whole(text: str | None) -> int | None:
    return int(text) if text is not None and re.fullmatch(r"\s*[+-]?\d{1,19}\s*", text) else None


def _boolean(text: str) -> bool:
    if text not in ("true", "false", "1", "0"):
        raise ValueError(text)
    return text in ("true", "1")
