"""An integer mapping between two components, as a component executed with its source, without delay."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import ClassVar

from cosim.core.component import PythonComponent
from cosim.core.description import Description, Variable
from cosim.core.signals import Array


class IntegerTable(PythonComponent):
    """y is what the table has for u. A value that it does not have ends the run."""

    kind: ClassVar[str] = "discrete"

    def __init__(self, table: Mapping[int, int], step: Fraction):
        super().__init__()
        self.table = dict(table)
        u, y = (
            Variable(n, "integer", "Int64", causality=c, variability="discrete", start=s, declared=n)
            for n, c, s in (("u", "input", next(iter(table))), ("y", "output", None))
        )
        self.description = Description(
            name=type(self).__name__,
            variables={"u": u, "y": y},
            kind=self.kind,
            default_step=step,
            can_save=True,
            dependencies={"y": frozenset({"u"})},
        )
        self._inputs, self._outputs = {u: 0}, {y: 0}

    def start(self, u: Array, y: Array) -> None:
        y[0] = self._mapped(u[0])

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        y[0] = self._mapped(u[0])

    def _mapped(self, value: float) -> int:
        if value not in self.table:
            raise ValueError(f"{value:g} is not in the mapping of {', '.join(map(str, self.table))}")
        return self.table[int(value)]
