"""Algebraic loops with undeclared dependencies, which are measured during initialization: an error or a warning."""

from __future__ import annotations

import warnings
from collections.abc import Collection

from cosim.core.dependencies import Dependencies
from cosim.core.errors import AlgebraicLoopWarning, CallFailed, CosimError, IsolationCrashed
from cosim.system.components import SystemComponent
from cosim.system.loops import Loop, components, declared, find_loops, path_of, refuse_loops
from cosim.system.schedule import Schedule


def check_loops(schedule: Schedule, initializing: Collection[SystemComponent]) -> None:
    """Raise LoopError for an algebraic loop; issue an AlgebraicLoopWarning for a possible one.

    A loop is certain if its dependencies are declared, or measured on components that are `initializing`.
    """
    measured: dict[SystemComponent, Dependencies] = {}

    def depends(component: SystemComponent, output: str) -> frozenset[str] | None:
        known = declared(component, output)
        return known if known is not None or component not in measured else measured[component].get(output, frozenset())

    while schedule.possible_loops:
        loops = find_loops(schedule.connections, depends)
        unknown = {c.source.name: c.source for loop in loops for c in loop if depends(c.source, c.output.name) is None}
        if not unknown:
            refuse_loops(loops, " (what is not declared was measured at the initial values)")
            break
        for component in unknown.values():
            measured[component] = _measured(schedule, component) if component in initializing else {}
    for loop in schedule.possible_loops:
        warnings.warn(_warning(loop), AlgebraicLoopWarning, stacklevel=9)


def _warning(loop: Loop) -> str:
    silent = dict.fromkeys(repr(c.source.name) for c in loop if declared(c.source, c.output.name) is None)
    return (
        f"the components {', '.join(repr(n) for n in components(loop))} may form an algebraic loop, which the master"
        f" does not solve: {', '.join(silent)} {'does' if len(silent) == 1 else 'do'} not declare on which inputs"
        f" outputs depend directly\n{path_of(loop)}\nIf these do, each value of the loop is computed from one of the"
        " step before. delay=True on one of these connections says that it is meant so."
    )


def _measured(schedule: Schedule, component: SystemComponent) -> Dependencies:
    """Undeclared direct dependencies of connected outputs on connected inputs; none if they cannot be measured."""
    measure = getattr(component.implementation, "measure_dependencies", None)
    if measure is None:
        return {}
    inputs = [c.input for c in schedule.connections if c.target is component]
    outputs = dict.fromkeys(c.output for c in schedule.connections if c.source is component)
    try:
        found: Dependencies = measure(inputs, [v for v in outputs if declared(component, v.name) is None])
    except CosimError as error:
        if isinstance(error, IsolationCrashed) or (isinstance(error, CallFailed) and error.status == "Fatal"):
            raise  # nothing of it can be called any more
        return {}
    return found
