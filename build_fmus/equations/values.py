"""How values are written in C: nodes of a graph element by element, and constant arrays."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from build_fmus.equations.names import WIDTH, identifier
from build_fmus.equations.operators import Text, constant


class Index(NamedTuple):
    """A position in a vector: `step * variable + start`; variable "" for a number."""

    variable: str
    step: int = 1
    start: int = 0

    def through(self, places: range) -> Index:
        """This one of the given positions."""
        return Index(self.variable, self.step * places.step, places.start + places.step * self.start)

    @property
    def code(self) -> str:
        """The C expression."""
        if not self.variable or not self.step:
            return str(self.start)
        variable = f"({self.variable})" if " " in self.variable and self.step != 1 else self.variable
        text = variable if abs(self.step) == 1 else f"{abs(self.step)} * {variable}"
        if self.step < 0:
            return f"{self.start} - {text}"
        return text if not self.start else f"{text} + {self.start}" if self.start > 0 else f"{text} - {-self.start}"


@dataclass(frozen=True)
class Value:
    """How a node is written in C.

    `at` gives the code of one element; `pointer` that of the first where all lie in a row. `length` is the
    approximate number of characters; `reads` are the work arrays, named numbers and fields that it is read from. A
    plain value is stored and needs no calculation. A smooth one is computed from named numbers and fields, which are no
    elements of arrays, by operations whose slopes are finite.
    """

    at: Callable[[Index], Text]
    length: int
    pointer: str = ""
    reads: frozenset[str] = frozenset()
    plain: bool = False
    smooth: bool = False


@dataclass
class Tables:
    """Constant arrays of a file, each different one once."""

    names: dict[tuple[str, bytes], str] = field(default_factory=dict)
    code: list[str] = field(default_factory=list)

    def numbers(self, values: np.ndarray, name: str = "") -> str:
        """Name of the array of these numbers."""
        return self._table("double", values, [constant(v).code for v in values.tolist()], name or "table")

    def positions(self, places: Sequence[int]) -> str:
        """Name of the array of these positions."""
        return self._table("int", np.array(places), [str(k) for k in places], "positions")

    def _table(self, kind: str, values: np.ndarray, texts: list[str], stem: str) -> str:
        key = (kind, values.tobytes())
        if key not in self.names:
            name = identifier(
                stem if stem not in ("table", "positions") else f"{stem}_{len(self.code) + 1}", self.names.values()
            )
            self.names[key] = name
            rows = textwrap.wrap(", ".join(texts), WIDTH - 4, break_on_hyphens=False)
            body = "\n    ".join(rows)
            self.code.append(f"static const {kind} {name}[{len(texts)}] = {{\n    {body}}};\n")
        return self.names[key]
