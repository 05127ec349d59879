"""A system's scene with the values of its variables at one time."""

from __future__ import annotations

from typing import Any

from cosim import Record, System
from cosim.scenes.scene import Scene

Values = dict[str, float]


def values_at(system: System, scene: Scene, time: float, *more: str) -> Values:
    """Variables of the scene, and more, at a time [s] of a run with the system as it is."""
    found: Values = {}
    recorded = []
    for name in (*scene.variables, *more):
        component, own = system.components.split(name)
        variable = component.description.variables[own]
        if variable.causality == "parameter":
            found[name] = float(component.values.get(own, variable.start))
        else:
            recorded.append(name)
    system.allow_unconnected = True
    recording: Any = system.run(max(time, 0.001), record=Record(recorded, 0.001))
    row = round(time / 0.001)
    return found | {name: float(recording[name][row]) for name in recorded}
