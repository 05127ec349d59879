"""How FMUs run together: the co-simulation master, its experiments and reports."""

from cosim.component import Component, Ports, PythonComponent
from cosim.describe import describe, wiring
from cosim.description import Description, Variable
from cosim.errors import (
    ComponentError,
    CosimError,
    FmuError,
    Interrupted,
    LoopError,
    StabilityWarning,
    TimeError,
    UnconnectedInputsWarning,
    WiringError,
)
from cosim.fmu import Fmu
from cosim.master import Simulation, SystemState
from cosim.members import Connection, Group, Member
from cosim.recording import Recording
from cosim.schedule import Schedule
from cosim.stability import Stability
from cosim.stops import StopWhen, View
from cosim.system import System

__all__ = [
    "Component",
    "ComponentError",
    "Connection",
    "CosimError",
    "Description",
    "Fmu",
    "FmuError",
    "Group",
    "Interrupted",
    "LoopError",
    "Member",
    "Ports",
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
