"""Algebraic loops of a system that is being initialized: which there are, and what their components need for them."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cosim.core.component import EndRequested, Ports
from cosim.core.dependencies import Dependencies, by_perturbation
from cosim.core.description import Variable
from cosim.core.errors import AlgebraicLoopWarning, CallFailed, CosimError, IsolationCrashed, LoopError
from cosim.engine.values import PortLayout
from cosim.system.components import SystemComponent
from cosim.system.loops import AlgebraicLoop, Depends, declared, find_loops, numeric, require_solvable
from cosim.system.schedule import Schedule


def undeclared(schedule: Schedule) -> dict[SystemComponent, None]:
    """Components of possible loops that do not declare all direct dependencies, in order of execution."""
    return dict.fromkeys(
        c.source
        for loop in schedule.possible_loops
        for c in loop.connections
        if declared(c.source, c.output.name) is None
    )


def measure(schedule: Schedule, components: Iterable[SystemComponent]) -> dict[SystemComponent, Dependencies]:
    """Direct dependencies that these components do not declare, measured while they are being initialized."""
    return {m: _measured(schedule, m) for m in components}


def declared_or(measured: Mapping[SystemComponent, Dependencies]) -> Depends:
    """Direct dependencies as far as they are declared or measured."""

    def depends(component: SystemComponent, output: str) -> frozenset[str] | None:
        known = declared(component, output)
        return measured.get(component, {}).get(output) if known is None else known

    return depends


def loops_of(schedule: Schedule, measured: Mapping[SystemComponent, Dependencies]) -> tuple[AlgebraicLoop, ...]:
    """The loops that are declared or measured; issues an AlgebraicLoopWarning for each that is only possible.

    Raises:
        LoopError: a loop cannot be solved.
    """
    if not schedule.possible_loops:
        return schedule.loops

    found = tuple(find_loops(schedule.connections, declared_or(measured)))
    solved = {c for loop in found for c in loop.connections}
    for loop in found:
        require_solvable(loop)
    for loop in schedule.possible_loops:
        if not solved.issuperset(loop.connections):
            warnings.warn(_warning(loop), AlgebraicLoopWarning, stacklevel=9)
    return found


def _warning(loop: AlgebraicLoop) -> str:
    silent = dict.fromkeys(repr(c.source.name) for c in loop.connections if declared(c.source, c.output.name) is None)
    return (
        f"the components {loop.names} may form an algebraic loop, which is not solved: {', '.join(silent)}"
        f" {'does' if len(silent) == 1 else 'do'} not declare on which inputs outputs depend directly, and"
        f" initialization has not measured it\n{loop}\nIf these do, each value of the loop is computed from one of the"
        " step before. delay=True on one of these connections says that it is meant so."
    )


def _measured(schedule: Schedule, component: SystemComponent) -> Dependencies:
    """Undeclared direct dependencies of connected outputs on connected inputs; none if they cannot be measured."""
    measure = getattr(component.implementation, "measure_dependencies", None)
    connections = numeric(schedule.connections)
    inputs = [c.input for c in connections if c.target is component]
    connected = dict.fromkeys(c.output for c in connections if c.source is component)
    outputs = [v for v in connected if declared(component, v.name) is None]
    none = {v.name: frozenset[str]() for v in outputs}
    if measure is None:
        return none
    try:
        found: Dependencies = measure(inputs, outputs)
    except CosimError as error:
        if _lost(error):
            raise  # nothing of it can be called any more
        return none
    return {**none, **found}


def _lost(error: CosimError) -> bool:
    return isinstance(error, IsolationCrashed) or (isinstance(error, CallFailed) and error.status == "Fatal")


class RepeatedStep:
    """A component of a loop that computes its outputs in steps only: its last step is repeated with other inputs.

    What it computes at the end of a step then belongs to the inputs at that end: an implicit exchange.
    """

    def __init__(self, component: SystemComponent, ports: Ports):
        """`ports` of the component, which repeats nothing until its first step."""
        self._implementation, self._ports = component.implementation, ports
        self._last: tuple[object, float, float] | None = None  # state at its begin, time and length [s]
        self.ports = Ports(ports.set_inputs, ports.step, self._get_outputs, self._run)

    def forget(self) -> None:
        """There is no last step to repeat."""
        if self._last is not None:
            self._implementation.forget(self._last[0])
            self._last = None

    def _run(self, t: float, h: float) -> None:
        self.forget()
        self._last = self._implementation.save(), t, h
        self._ports.run(t, h)

    def _get_outputs(self) -> None:
        if self._last is not None:
            state, t, h = self._last
            self._implementation.restore(state)
            self._ports.set_inputs()
            with contextlib.suppress(EndRequested):  # as when the step was done first
                self._ports.step(t, h)
        self._ports.get_outputs()


def repeated_steps(
    schedule: Schedule,
    loops: Sequence[AlgebraicLoop],
    layouts: Mapping[SystemComponent, PortLayout],
    ports: Mapping[SystemComponent, Ports],
) -> dict[SystemComponent, RepeatedStep]:
    """The components of loops, all of them initialized, whose outputs do not follow their inputs between steps.

    Raises:
        LoopError: one of them cannot save its state, or takes its steps together with others.
    """
    found: dict[SystemComponent, RepeatedStep] = {}
    for loop in loops:
        for m in loop.components:
            if _follows(loop, m, layouts[m], ports[m]):
                continue
            together = any(m in (c.source, c.target) for c in schedule.ticks)
            if together or not m.description.can_save:
                why = "takes its steps together with those whose clocks it is connected to"
                raise LoopError(
                    f"'{m.name}' is part of an algebraic loop, computes its outputs in steps only, and"
                    f" {why if together else 'cannot save its state'}, so the loop cannot be solved:\n{loop}\nGive one"
                    " of these connections delay=True (one step of delay) to break the loop."
                )
            found[m] = RepeatedStep(m, ports[m])
    return found


def _follows(loop: AlgebraicLoop, component: SystemComponent, layout: PortLayout, ports: Ports) -> bool:
    """Whether outputs change with inputs without a step: all inputs must be passed on between steps."""
    inputs = [c.input for c in loop.connections if c.target is component]
    outputs = list(dict.fromkeys(c.output for c in loop.connections if c.source is component))
    if any(map(component.description.waits, inputs)):
        return False
    try:
        return any(between_steps(component, layout, ports, inputs, outputs).values())
    except CosimError as error:
        if _lost(error):
            raise
        return False


def between_steps(
    component: SystemComponent,
    layout: PortLayout,
    ports: Ports,
    inputs: Sequence[Variable],
    outputs: Sequence[Variable],
) -> Dependencies:
    """Direct dependencies of outputs on inputs as the engine finds them between steps: through the ports."""
    exchanged = _Exchanged(component.implementation, layout, ports)
    kept = layout.u.copy(), layout.y.copy()
    try:
        exchanged.take([v for v in layout.inputs if not component.description.waits(v)])
        return by_perturbation(exchanged, inputs, outputs)
    finally:
        layout.u[:], layout.y[:] = kept


class _Exchanged:
    """The values of a component as its ports move them; those of several slots as it moves them itself."""

    def __init__(self, implementation: Any, layout: PortLayout, ports: Ports):
        self._implementation, self._ports = implementation, ports
        sides = (layout.inputs, layout.u), (layout.outputs, layout.y)
        self._slots = {
            v: array[k : k + 1] for vs, array in sides for v, k in layout.places(vs) if v not in layout.sizes
        }

    def take(self, inputs: Sequence[Variable]) -> None:
        """The buffer of these inputs gets what the component has."""
        single = [v for v in inputs if v in self._slots]
        for v, value in zip(single, self._implementation.get(single), strict=True):
            self._slots[v][0] = value

    def get(self, variables: Sequence[Variable]) -> list[Any]:
        self._ports.get_outputs()
        return [self._slots[v][0] if v in self._slots else self._implementation.get([v])[0] for v in variables]

    def set(self, values: Mapping[Variable, Any]) -> None:
        for v, value in values.items():
            if v in self._slots:
                self._slots[v][0] = value
            else:
                self._implementation.set({v: value})
        self._ports.set_inputs()
