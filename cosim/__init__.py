"""How FMUs run together: the co-simulation master, its experiments and reports."""

from cosim.component import Component, Ports, PythonComponent
from cosim.description import Description, Variable
from cosim.engine.choice import EngineChoice
from cosim.errors import (
    ComponentError,
    CosimError,
    FmuError,
    FmuWarning,
    Interrupted,
    LoopError,
    ProcessLostWarning,
    StabilityWarning,
    TimeError,
    UnconnectedInputsWarning,
    WiringError,
)
from cosim.fmu.describe import describe, wiring
from cosim.fmu.limits import Limits
from cosim.master.simulation import Simulation
from cosim.master.stability import Stability
from cosim.master.state import SystemState
from cosim.master.stops import StopWhen, View
from cosim.recording import Recording
from cosim.session import Fmu, System
from cosim.system.members import Connection, Group, Member
from cosim.system.schedule import Schedule

__all__ = [
    "Component",
    "ComponentError",
    "Connection",
    "CosimError",
    "Description",
    "EngineChoice",
    "Fmu",
    "FmuError",
    "FmuWarning",
    "Group",
    "Interrupted",
    "Limits",
    "LoopError",
    "Member",
    "Ports",
    "ProcessLostWarning",
    "PythonComponent",
    "Recording",
    "Schedule",
    "Simulation",
    "Stability",
    "StabilityWarning",
    "StopWhen",
    "System",
    "SystemState",
    "TimeError",
    "UnconnectedInputsWarning",
    "Variable",
    "View",
    "WiringError",
    "describe",
    "wiring",
]
