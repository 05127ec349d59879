"""What a component says about itself: its variables, units, dependencies and capabilities."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from math import inf
from typing import Any

from build_fmus.base.checks import did_you_mean
from build_fmus.base.units import DisplayUnit, Unit
from cosim.core.errors import WiringError

RECORDABLE = ("real", "integer", "boolean")  # types of what is a number: it can be recorded
TEXTS = ("String", "Binary")  # FMI types whose values are bytes
WIDE = ("Int64", "UInt64")  # FMI types that doubles may not hold
LONGEST_TEXT = 1024  # bytes of a String or Binary where nobody says more

SIZED_INTEGERS = {
    f"{sign}Int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for bits in (8, 16, 32, 64)
    for sign in ("", "U")
}
INTEGER_RANGE = {**SIZED_INTEGERS, "Integer": SIZED_INTEGERS["Int32"], "Enumeration": SIZED_INTEGERS["Int32"]}

_INDEX = re.compile(r"\d{1,18}(?:,\d{1,18})*")


def split_index(name: str) -> tuple[str, tuple[int, ...]]:
    """`gain.y[2,3]` -> (`gain.y`, (2, 3)); a name that is no element of an array -> itself and ()."""
    at = name.rfind("[")  # names are a stranger's: a pattern for all of one would look at it again from every bracket
    if at < 1 or not name.endswith("]") or not _INDEX.fullmatch(name, at + 1, len(name) - 1):
        return name, ()
    return name[:at], tuple(int(i) for i in name[at + 1 : -1].split(","))


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
    optional: bool = False  # an input that may stay unconnected, as its FMU says
    display: DisplayUnit | None = None  # the unit in which the FMU wants it displayed
    source: str | None = None  # where its value comes from, in words, if the FMU says so
    nominal: float = 1.0  # its typical size, positive
    mime_type: str = ""  # of a Binary
    max_size: int | None = None  # of a Binary: bytes, if the FMU says so
    clocks: tuple[int, ...] = ()  # value references of the clocks that it belongs to: it changes when one of them ticks
    follows: bool = False  # an input that may be set inside a step too (FMI 3.0, intermediate update)
    samples: int = 0  # of a series, whose `start` is an array of so many numbers over time

    @property
    def unit_name(self) -> str:
        """Name of the unit, "" for a variable without a unit."""
        return self.unit.name if self.unit else ""

    @property
    def start_as_set(self) -> Any:
        """The start value as it is set: bytes for a Binary, None if there is none."""
        if self.fmi_type != "Binary":
            return self.start
        with suppress(TypeError, ValueError):
            return bytes.fromhex(self.start)
        return None

    @property
    def is_stepwise(self) -> bool:
        """Whether it keeps its value between instants at which that may change."""
        return self.type != "real" or self.variability != "continuous"

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest value; infinite where it has no limit."""
        least, most = self.minimum, self.maximum
        return -inf if least is None else least, inf if most is None else most

    def accepts(self, value: float) -> bool:
        """Whether an input may have this value: where it must equal a constant that one, or 0 (not connected)."""
        return self.must_equal is None or value == 0 or abs(value - self.must_equal) <= self.tolerance

    def refusal(self, value: float) -> str:
        """Why it may not, for messages."""
        unit = f" {self.unit_name}" if self.unit else ""
        return (
            f"must equal {self.must_equal:.9g}{unit}, not {value:.9g}{unit}: what this component was built for; build"
            " one of the two for the other's value"
        )


@dataclass(frozen=True)
class Clock:
    """A clock of an FMI 3.0 FMU.

    `kind` is its intervalVariability; `interval` and `shift` [s] are given if modelDescription.xml has them;
    `fractions`: the FMU returns them as exact fractions.
    """

    name: str
    reference: int
    causality: str
    kind: str
    interval: Fraction | None = None
    shift: Fraction = Fraction(0)
    fractions: bool = False


@dataclass
class Description:
    """A component's variables and capabilities.

    `dependencies` maps an output to the names of the variables it depends on directly; an output that is missing there
    depends on all inputs. `aliases` maps further names of variables and arrays (FMI 3.0) to their names; they are
    accepted wherever names are. Clocks are neither among the inputs nor among the outputs; `triggered` are the input
    clocks that tick when another FMU's clock does.
    """

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
    internal_step: Fraction | None = None  # FMI 3.0: communication steps should be multiples of it
    default_stop: Fraction | None = None
    tolerance: float | None = None
    can_save: bool = False
    can_serialize: bool = False
    only_once: bool = False
    variable_step: bool = False
    directional_derivatives: bool = False
    dependencies: dict[str, frozenset[str]] = field(default_factory=dict)
    states: list[Variable] = field(default_factory=list)
    derivatives: list[Variable] = field(default_factory=list)
    model_exchange: bool = False
    co_simulation: bool = True
    interface: str = "cs"  # of the two, the one that is used
    event_indicators: int = 0  # Model Exchange
    completed_steps: bool = False  # Model Exchange: it must be told when a step of the integrator is completed
    unpaired: str = ""  # name of a derivative without a state
    native: bool = False  # no FMU, but with calls that are functions of C too: the engine need not call Python back
    needs_tool: bool = False  # the FMU is a door to a tool that must be installed
    aliases: dict[str, str] = field(default_factory=dict)
    event_mode: bool = False  # FMI 3.0, Co-Simulation: it can be told when events happen
    early_return: bool = False  # FMI 3.0, Co-Simulation: its steps may end early by themselves
    clocks: list[Clock] = field(default_factory=list)
    # dependencies of outputs on inputs in initialization, where they are declared
    initial_dependencies: dict[str, frozenset[str]] = field(default_factory=dict)
    initial_unknowns: frozenset[str] = frozenset()  # declared names of what initialization computes

    def __post_init__(self) -> None:
        values = [v for v in self.variables.values() if v.fmi_type != "Clock"]
        self.inputs = {v.name: v for v in values if v.causality == "input"}
        self.outputs = {v.name: v for v in values if v.causality == "output"}
        self.triggered = [c.name for c in self.clocks if c.causality == "input" and c.kind == "triggered"]
        self.parameters = {
            v.name: v for v in self.variables.values() if v.causality in ("parameter", "structuralParameter")
        }
        self.arrays: dict[str, list[str]] = {}
        for name in self.variables:
            base, index = split_index(name)
            if index:
                self.arrays.setdefault(base, []).append(name)
        self._alias_arrays()
        self._aliases: dict[str, list[str]] = {}
        for alias, name in self.aliases.items():
            self._aliases.setdefault(name, []).append(alias)

    def _alias_arrays(self) -> None:
        """Arrays that are declared element by element have another name if all elements have it."""
        bases: dict[tuple[str, str], int] = {}
        for alias, name in self.aliases.items():
            (further, index), (base, own) = split_index(alias), split_index(name)
            if index and index == own:
                bases[further, base] = bases.get((further, base), 0) + 1
        whole = {further: base for (further, base), n in bases.items() if n == len(self.arrays[base])}
        self.aliases = {**whole, **self.aliases}

    def find(self, name: str, component: str = "") -> Variable:
        """The variable of that name or alias; raises WiringError with the nearest match."""
        try:
            return self.variables[self.canonical(name)]
        except KeyError:
            owner = f"component '{component}' ({self.name})" if component else f"'{self.name}'"
            near = did_you_mean(name, [*self.variables, *self.aliases])
            raise WiringError(f"{owner} has no variable '{name}'{near}") from None

    def canonical(self, name: str) -> str:
        """The variable's own name where `name` is an alias, of it or of the array that it is an element of."""
        base = split_index(name)[0]
        if name in self.variables or base not in self.aliases:
            return name if name in self.variables else self.aliases.get(name, name)
        return self.aliases[base] + name[len(base) :]

    def names(self, variable: Variable) -> list[str]:
        """The variable's name and its aliases."""
        index = variable.name[len(variable.declared) :]
        return [variable.name, *(alias + index for alias in self._aliases.get(variable.declared, ()))]

    def waits(self, variable: Variable) -> bool:
        """Whether an input is set in event mode only once initialization is over: a discrete one, where it is used."""
        return (
            self.event_mode and self.interface == "cs" and bool(variable.clocks or variable.variability == "discrete")
        )

    @property
    def begins_with_events(self) -> bool:
        """Whether the master does a first event iteration after initialization; no FMU of this project needs one."""
        return self.kind is None and (self.interface == "me" or self.event_mode)

    def feeds(self, input_: str, output: str) -> bool:
        """Whether an output depends on an input directly."""
        known = self.dependencies.get(output)
        return known is None or input_ in known

    def depends(self, output: str) -> frozenset[str]:
        """Names of the inputs an output depends on directly."""
        known = self.dependencies.get(output)
        return frozenset(self.inputs) if known is None else known & self.inputs.keys()
