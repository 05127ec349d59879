"""Variables of a component as they were declared, and what can be wrong with a declaration."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Literal

from build_fmus.base.escape import NO_XML

Kind = Literal["continuous", "discrete"]
Role = Literal["time", "parameter", "constant", "input", "state", "derivative", "output"]
Solver = Literal["rk4", "am2", "ros2", "semi_implicit"]
BaseType = Literal["Float64", "Int32", "Boolean"]


LONGEST_SOURCE = 4096  # characters; the FMU reader of cosim accepts no longer text
_ESCAPED = re.compile("[\udc80-\udcff]")  # bytes of a name that the locale could not decode
_SAME = 1e-6  # relative difference at which two constants count as one: they may pass through text and other units


class DeclarationError(ValueError):
    """A component declaration that cannot become an FMU; the message names the component and the variable."""


def source_fault(source: str) -> str:
    """What is wrong with the text that says where a value comes from, with the remedy; empty when nothing is."""
    if not (source and source.strip()):
        return 'empty; say where the value comes from, or "assumed"'
    return text_fault(source)


def text_fault(text: str) -> str:
    """What is wrong with a text that FMUs are to hold, with the remedy; empty when nothing is."""
    if len(text) > LONGEST_SOURCE:
        return f"has {len(text)} characters; shorten it to {LONGEST_SOURCE}"
    if _ESCAPED.search(text):
        return "names a file that this locale has no characters for; set PYTHONUTF8=1"
    if bad := NO_XML.search(text):
        return f"contains the character {bad[0]!a}, which XML cannot hold; remove it"
    return ""


@dataclass(frozen=True, eq=False)
class Variable:
    """One declared variable (scalar, vector or matrix).

    `slot` is the position of its first element in the vector of its role (`p`, `u`, `x` or `y`).
    `start` is flat and row-major, or None when the value is calculated. `must_equal` is the constant that the
    source of an input must have, None where any value will do. `source` says where the value of a parameter comes
    from. `rows` and `columns`: units of an array whose elements differ, see `Component.parameter`.
    """

    name: str
    role: Role
    unit: str | None
    description: str
    shape: tuple[int, ...] = ()
    type: BaseType = "Float64"
    start: tuple[float, ...] | None = None
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    display_unit: str | None = None
    tunable: bool = False
    source: str = ""
    output: bool = False
    exposed: bool = True
    slot: int = 0
    symbol: Any = field(default=None, repr=False)
    derivative_of: str | None = None
    must_equal: float | None = None
    optional: bool = False
    rows: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of scalar elements."""
        return math.prod(self.shape)

    @property
    def tolerance(self) -> float:
        """Difference from `must_equal` that passes, in the variable's unit."""
        return math.inf if self.must_equal is None else _SAME * abs(self.must_equal)

    def element_names(self) -> list[str]:
        """Scalar names in slot order: `gain.y[2,3]`; row-major and 1-based as FMI's structured naming has it."""
        if not self.shape:
            return [self.name]
        indices = product(*(range(1, n + 1) for n in self.shape))
        if self.role == "derivative":  # der(x)[2] is not a legal name, der(x[2]) is
            return [f"der({self.derivative_of}[{','.join(map(str, i))}])" for i in indices]
        return [f"{self.name}[{','.join(map(str, i))}]" for i in indices]


@dataclass(frozen=True)
class Element:
    """One scalar of a variable, as FMI sees it by default."""

    name: str
    variable: Variable
    index: int

    @property
    def slot(self) -> int:
        """Position in the vector of the variable's role."""
        return self.variable.slot + self.index

    @property
    def start(self) -> float | None:
        """Start value of this element, None when calculated."""
        return None if self.variable.start is None else self.variable.start[self.index]
