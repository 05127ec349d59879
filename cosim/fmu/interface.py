"""An interface that an FMU offers, and what it can do."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

INTERFACES = {"cs": "CoSimulation", "me": "ModelExchange"}
NAMES = {"cs": "Co-Simulation", "me": "Model Exchange"}


@dataclass
class Interface:
    """A `CoSimulation` or `ModelExchange` element."""

    kind: str  # "cs" or "me"
    line: int
    says: dict[str, str]  # its attributes

    @classmethod
    def of(cls, kind: str, element: Any) -> Interface:
        """From its element."""
        return cls(kind, element.sourceline, dict(element.attrib))

    @property
    def identifier(self) -> str:
        """Value of modelIdentifier."""
        return self.says.get("modelIdentifier", "")

    def can(self, *flags: str) -> bool:
        """Whether any of these capability flags is true."""
        return any(self.says.get(f) in ("true", "1") for f in flags)

    @property
    def internal_step(self) -> float | None:
        """Value of fixedInternalStepSize of FMI 3.0 [s], if it is one; FMI 2.0 has no such attribute."""
        with suppress(ValueError):
            step = float(self.says.get("fixedInternalStepSize", ""))
            return step if 0 < step < math.inf else None
        return None

    @property
    def saves(self) -> bool:
        """Whether instances can save and restore their states."""
        return self.can("canGetAndSetFMUstate", "canGetAndSetFMUState")

    @property
    def serializes(self) -> bool:
        """Whether saved states can be serialized."""
        return self.can("canSerializeFMUstate", "canSerializeFMUState")

    @property
    def directional(self) -> bool:
        """Whether it provides directional derivatives."""
        return self.can("providesDirectionalDerivative", "providesDirectionalDerivatives")

    def wants_completed_steps(self, version: str) -> bool:
        """Whether it is to be told of every step of the integrator."""
        if version == "2":
            return not self.can("completedIntegratorStepNotNeeded")
        return self.can("needsCompletedIntegratorStep")

    @property
    def once(self) -> bool:
        """Whether it can be instantiated only once per process."""
        return self.can("canBeInstantiatedOnlyOncePerProcess")

    @property
    def needs_tool(self) -> bool:
        """Whether it needs the tool that made it."""
        return self.can("needsExecutionTool")

    @property
    def variable_step(self) -> bool:
        """Whether communication steps may vary."""
        return self.can("canHandleVariableCommunicationStepSize")
