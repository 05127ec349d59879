"""The Python evaluation of a component, with its inputs and outputs by name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

from build_fmus.reference import Evaluator


class Named(Evaluator):
    """As `Evaluator`; keywords have `__` for the dot of a name."""

    @cached_property
    def slots(self) -> dict[str, int]:
        """Places of inputs in `u`."""
        return {e.name: e.slot for e in self.component.elements("input")}

    @cached_property
    def names(self) -> list[str]:
        """Names of outputs."""
        return [e.name for e in self.component.output_elements()]

    def put(self, values: Mapping[str, Any] | None = None, **more: Any) -> Named:
        """Set inputs; the others stay. Returns itself."""
        for name, value in {**(values or {}), **more}.items():
            self.u[self.slots[name.replace("__", ".")]] = value
        return self

    def shown(self) -> dict[str, float]:
        """Outputs by name."""
        return dict(zip(self.names, self.outputs(), strict=True))
