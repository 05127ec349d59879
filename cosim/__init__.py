"""How FMUs run together: the co-simulation master, its experiments and reports."""

# isort: off
from build_fmus.base import run_as_module  # noqa: F401 (before all others)
# isort: on

import logging
from importlib import metadata

from cosim.core.component import Component, Ports, PythonComponent
from cosim.core.description import Description, Variable
from cosim.core.errors import (
    AlgebraicLoopWarning,
    ComponentError,
    CosimError,
    FmuError,
    FmuWarning,
    Interrupted,
    IsolationCrashedWarning,
    LoopError,
    SspError,
    SspWarning,
    StabilityWarning,
    TimeError,
    UnconnectedInputsWarning,
    WiringError,
)
from cosim.engine.execution import Execution, Record
from cosim.engine.simulation import Simulation
from cosim.engine.state import SystemState
from cosim.engine.stops import StopWhen, View
from cosim.fmu.describe import describe, wiring
from cosim.fmu.limits import Limits
from cosim.fmu.model_exchange import ModelExchange
from cosim.linear.stability import Stability
from cosim.recording.formats import FormatError
from cosim.recording.recording import Recording
from cosim.session import Fmu, System
from cosim.system.components import Connection, Group, SystemComponent
from cosim.system.schedule import Schedule
from cosim.tables import Table, TableError

logging.getLogger("cosim").addHandler(logging.NullHandler())  # silent unless a program listens

__all__ = [
    "AlgebraicLoopWarning",
    "Component",
    "ComponentError",
    "Connection",
    "CosimError",
    "Description",
    "Execution",
    "Fmu",
    "FmuError",
    "FmuWarning",
    "FormatError",
    "Group",
    "Interrupted",
    "IsolationCrashedWarning",
    "Limits",
    "LoopError",
    "ModelExchange",
    "Ports",
    "PythonComponent",
    "Record",
    "Recording",
    "Schedule",
    "Simulation",
    "SspError",
    "SspWarning",
    "Stability",
    "StabilityWarning",
    "StopWhen",
    "System",
    "SystemComponent",
    "SystemState",
    "Table",
    "TableError",
    "TimeError",
    "UnconnectedInputsWarning",
    "Variable",
    "View",
    "WiringError",
    "describe",
    "wiring",
]


def __getattr__(name: str) -> str:
    if name == "__version__":  # looked up when somebody asks
        return metadata.version("suspension-fmus")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
