"""Communication steps that follow the error of the exchange, instead of fixed ones.

The rule, where it differs from that of `exchange.py`. All continuous components take the same steps. A step begins at a
communication point, after the discrete components that are due there, and ends before or at the next instant of a
discrete component, so these run at their exact instants.

1. Outputs that depend directly on inputs are computed again from the inputs as they are now, and algebraic loops are
   solved; loops whose components repeat their steps only at the end of a step, which is then repeated.
2. The state of each continuous component is saved.
3. Every input that another continuous component drives is extrapolated along the parabola through its values at the
   last three communication points, except for discrete values. All components take the step in two halves (the
   smallest step in one), with two constant inputs that have the mean and the first moment of the parabola, so that the
   exchange is of third order: constants in the middle would leave an error of second order that no output shows. Where
   a reader computes outputs with direct dependencies in steps only, the second constant is the value at the end, which
   these outputs need, and both have the mean. An input that belongs to a clock has the value of the parabola at each
   tick. Then 1 is repeated at the end of the step. Where a loop has no solution there, a shorter step is tried.
4. The error is the largest difference, among the outputs that continuous components read, between the value that has
   arrived and the one that was extrapolated to the end, relative to SHARE * tolerance * max(FLOOR * nominal, largest
   magnitude so far). If it is above 1, the states are restored and a shorter step is tried. The parabolas go through
   the values of the step that was tried then, unless the shorter one has the least part of its length: a value that
   jumps has no slope. Otherwise it is accepted, and the error decides on the length of the next one,
   as it grows with the product of the distances to the values of the parabola. A value that is not finite has an
   infinite error, and tells no parabola.

FMUs with fixed internal steps (fixedInternalStepSize) take whole numbers of them: the smallest step is then the least
common multiple of these, and each half of the others is a multiple of it. Only where an instant of a discrete
component, the stop time or an input that is set lies between, a step ends there nevertheless.

Errors of steps add up over a run, and the coupling amplifies them: hence the share. A mathematical bound needs what the
master cannot know of the components: docs/reference/masters.md has measurements.

Values before an instant of a discrete component, or before an input was set from outside, tell slopes but no curves. A
value that jumps has a large error in a step of any length. The smallest step is accepted nevertheless, and the next one
begins without slopes. If its error is as large although it is a smallest step too, the value is steep, and those after
it have slopes again. After ten such steps in a row, or one with an infinite error, the run fails. Between two
communication points, outputs are interpolated along the parabola, for the recording and for everything else that reads
them.

`adaptive.c` executes the rule; tests/oracles/adaptive_rule.py states it once more, in Python.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
import numpy.typing as npt

from cosim.core.component import Array, Ports
from cosim.core.description import Variable
from cosim.core.errors import FmuWarning, LoopError, ToleranceExceeded, WiringError
from cosim.core.time import TimeBase, gcd, seconds_text
from cosim.engine.library import interface
from cosim.engine.loops import between_steps
from cosim.engine.saving import EngineStatePool
from cosim.engine.values import EXACT, Layout, PortLayout
from cosim.fmu.saved_states import SavedStates
from cosim.recording.recording import StepEffort
from cosim.system.components import Group, SystemComponent
from cosim.system.loops import AlgebraicLoop, declared
from cosim.system.schedule import Schedule, only_numbers

PARTS = 4096
"""The smallest step is at most this part of the smallest step that a continuous component has without a tolerance."""
JUMPS = 1000
"""It is also at most tolerance / JUMPS of that step: a value that jumps is late by up to the smallest step, and the
delays of jumps that follow from each other, as those of a relay, add up."""
RESOLUTION = 2**40
"""For the sake of JUMPS it is no shorter than this part of the stop time: times are doubles, also those of FMUs."""
UNKNOWN = 2**16
"""Where the stop time is not known, so many of the steps without a tolerance take its place."""
LARGEST = 64
"""The largest step is so many of these."""
SHARE = 0.03
"""The part of the tolerance that the error of one step may be: errors add up."""
FLOOR = 0.001
"""The part of its nominal value relative to which the error of a smaller output is measured."""
RESIDUAL = 0.01
"""The part of that error that the residual of an algebraic loop may be: it would be taken for an error of the step."""
EXACTEST = 1e-12
"""No loop is solved more exactly for that: FMUs that iterate, too, compute no better."""
SAVE, RESTORE = -2, -3
_READ, _LAST, _STEPWISE = 1, 2, 4
_Value = tuple[SystemComponent, str] | AlgebraicLoop
States = tuple[SavedStates | None, list[Any]]  # of the FMUs that C saves, and of all other continuous components
State = tuple[Array, npt.NDArray[np.int64], States | None]


def _tick(schedule: Schedule, tolerance: float, start: Fraction, stop: Fraction | None) -> Fraction:
    """The base tick of a run, which is the smallest step where there are no internal steps."""
    internal = _internal_steps(schedule.components)
    if internal is not None:
        return gcd([schedule.tick, internal])
    tick, declared = schedule.tick, _declared(schedule)
    latest = max(abs(start), UNKNOWN * declared if stop is None else abs(stop))
    least = latest / RESOLUTION
    most = EXACT / 8 / max(1.0, float(latest))  # a time is a quotient of integers below EXACT
    while tick > declared / PARTS or (
        tick > declared * (tolerance / JUMPS)
        and tick >= 2 * least
        and math.lcm(tick.denominator, start.denominator) < most
    ):
        tick /= 2
    return tick


def tolerance_of_loops(tolerance: float, given: float) -> float:
    """That of algebraic loops in a run with a tolerance: the `given` one, or a smaller one that the run needs."""
    return min(given, max(RESIDUAL * SHARE * FLOOR * tolerance, EXACTEST))


def _declared(schedule: Schedule) -> Fraction:
    """The smallest step of continuous components without a tolerance [s]."""
    return min(m.step for m in schedule.continuous)


def _internal_steps(components: Sequence[SystemComponent]) -> Fraction | None:
    """The least common multiple of fixed internal steps of FMUs [s]."""
    fixed = [m.description.internal_step for m in components if not m.discrete]
    found = [step for step in fixed if step is not None]
    whole = math.lcm(*(step.denominator for step in found))
    return Fraction(math.lcm(*(int(step * whole) for step in found)), whole) if found else None


def for_tolerance(schedule: Schedule, tolerance: float, start: Fraction, stop: Fraction | None) -> Schedule:
    """The schedule of a run with a tolerance, where groups and the option `extrapolate` have no meaning.

    `start`, `stop`: of the run [s]; the stop time if it is known.

    Raises:
        WiringError: a component cannot take steps of any length or go back to a saved state, or a connection or loop
            is of a kind that such a run does not have.
    """
    for m in schedule.continuous:
        about, why = m.description, ""
        if not about.can_save:
            why = "cannot save its state (canGetAndSetFMUState)"
        elif about.fmi_version and not about.variable_step:
            why = "cannot take steps of any length (canHandleVariableCommunicationStepSize)"
        elif m.offset:
            why = f"has an offset of {seconds_text(m.offset)}"
        if why:
            raise WiringError(f"'{m.name}' {why}: run the system without a tolerance")
    delayed = next((c for c in schedule.connections if c.delay and not c.source.discrete), None)
    if delayed is not None:
        raise WiringError(
            f"{delayed.source_name} -> {delayed.target_name} has a delay of one step, which has no length of its own in"
            " a run with a tolerance: leave the delay out, or run the system without a tolerance"
        )
    _check_instants(schedule)
    schedule = only_numbers(schedule, "a run with a tolerance", "run the system without a tolerance")
    return replace(
        schedule,
        tick=_tick(schedule, tolerance, start, stop),
        groups=tuple(Group("", (m,)) for m in schedule.continuous),
        connections=tuple(replace(c, extrapolate=False) for c in schedule.connections),
    )


def _check_instants(schedule: Schedule) -> None:
    """Issue a FmuWarning for instants that lie between internal steps of FMUs, and refuse steps that never meet."""
    internal = _internal_steps(schedule.components)
    if internal is None:
        return
    fixed = ", ".join(f"'{m.name}'" for m in schedule.continuous if m.description.internal_step is not None)
    if internal > LARGEST * _declared(schedule):
        raise WiringError(
            f"the fixed internal steps (fixedInternalStepSize) of {fixed} have no common multiple below"
            f" {seconds_text(internal)}, which is too long for a step: run the system without a tolerance"
        )
    for m in schedule.discrete:
        if any((time / internal).denominator != 1 for time in (m.step, m.offset)):
            warnings.warn(
                f"'{m.name}' runs every {seconds_text(m.step)}, which is not a multiple of {seconds_text(internal)},"
                f" the fixed internal step (fixedInternalStepSize) of {fixed}: steps that end at its instants may be"
                " refused",
                FmuWarning,
                stacklevel=3,
            )


class AdaptiveSteps:
    """The steps of one initialized system; where they stand can be saved and restored."""

    def __init__(
        self,
        schedule: Schedule,
        layout: Layout,
        base: TimeBase,
        ports: Mapping[SystemComponent, Ports],
        tolerance: float,
        stop: int,
        loops: Sequence[AlgebraicLoop] = (),
        repeated: Container[SystemComponent] = (),
    ):
        """`stop`: tick of the stop time, 0 if it is not known. `repeated`: components of `loops` that repeat steps.

        Raises:
            LoopError: there may be another algebraic loop.
        """
        self._schedule, self._base, self._tolerance, self._ffi = schedule, base, tolerance, interface()
        self._outputs = [(m, v) for m in schedule.continuous for v in layout.ports[m].outputs]
        n = len(self._outputs)
        self._keep: list[Any] = []
        self.in_steps, refreshed = _direct(schedule, layout, ports, loops, repeated)
        calls = {m: c for m in schedule.continuous if (c := ports[m].fmi) is not None and c.states is not None}
        self._others = [m for m in schedule.continuous if m not in calls]
        self._pool = EngineStatePool(calls) if calls else None
        self._states = self._save_states()  # at the begin of the step
        self._memory: Array = np.zeros((5, n))  # begin, size, slope, curve, back
        self._memory[1] = [FLOOR * v.nominal for _, v in self._outputs]
        self._steps: npt.NDArray[np.int64] = np.zeros(self._ffi.sizeof("EngineSteps") // 8, dtype=np.int64)
        declared, internal = _declared(schedule), _internal_steps(schedule.components)
        self.struct = a = self._ffi.new("EngineAdaptive*")
        a.n, a.tolerance, a.stop, a.largest = n, SHARE * tolerance, stop, LARGEST * base.count(declared)
        a.internal = 0 if internal is None else base.count(internal)
        first = self._outputs[0] if self._outputs else None
        a.published, a.computed = (layout.visible[first], layout.latest[first]) if first else (0, 0)
        a.use = self._pointer("uint8_t*", np.array([self._use(m, v) for m, v in self._outputs], dtype=np.uint8))
        numbers = {m: i for i, m in enumerate(schedule.components)}
        order = [-1 - loops.index(m) if isinstance(m, AlgebraicLoop) else numbers[m] for m in refreshed]
        a.refreshed = self._pointer("int32_t*", np.array(order, dtype=np.int32))
        a.n_refreshed, a.others = len(refreshed), bool(self._others)
        if self._pool is not None:
            self._use_states()
            a.fmus, a.n_fmus = self._pool.structs, len(calls)
            a.numbers = self._pointer("int32_t*", np.array([numbers[m] for m in calls], dtype=np.int32))
        a.begin, a.size, a.slope, a.curve, a.back = (self._pointer("double*", row) for row in self._memory)
        a.steps = self._pointer("EngineSteps*", self._steps)
        a.steps.next, a.steps.changed = base.count(declared), True

    def _use(self, component: SystemComponent, variable: Variable) -> int:
        readers = [
            c.target
            for c in self._schedule.connections
            if (c.source, c.output) == (component, variable) and not c.target.discrete
        ]
        last = any(m in self.in_steps for m in readers)
        return _READ * bool(readers) + _LAST * last + _STEPWISE * variable.is_stepwise

    def _pointer(self, of: str, array: npt.NDArray[Any]) -> Any:
        self._keep.append(array)
        return self._ffi.cast(of, array.ctypes.data)

    # Where they stand.

    @property
    def ticks(self) -> int:
        """Length of the step that was tried last [ticks]."""
        return int(self.struct.steps.tried)

    def within(self, tick: int) -> bool:
        """Whether a step is under way at a tick."""
        return int(self.struct.steps.begin) < tick < int(self.struct.steps.end)

    def changed(self) -> None:
        """Inputs or parameters were set from outside."""
        self.struct.steps.changed = True

    def move_others(self, what: int) -> None:
        """Save or restore the components whose states C does not save."""
        for m, state in zip(self._others, self._states[1], strict=True):
            if what == SAVE:
                m.implementation.forget(state)
            else:
                m.implementation.restore(state)
        if what == SAVE:
            self._states = self._states[0], [m.implementation.save() for m in self._others]

    def save(self, tick: int) -> State:
        """Where the steps stand at a tick; within a step with the states at its begin."""
        began = None
        if self.within(tick):
            present = self._save_states()
            self._restore_states(self._states)
            began = self._save_states()
            self._restore_states(present)
        return self._memory.copy(), self._steps.copy(), began

    def restore(self, state: State) -> None:
        """Go back to where they stood; the present states of the components are to be restored after that."""
        self._memory[:], self._steps[:], began = state
        if began is not None:
            self._restore_states(began)
            self._states = self._save_states()
            self._use_states()

    def _save_states(self) -> States:
        return None if self._pool is None else self._pool.save(), [m.implementation.save() for m in self._others]

    def _restore_states(self, states: States) -> None:
        if self._pool is not None and states[0] is not None:
            self._pool.restore(states[0])
        for m, state in zip(self._others, states[1], strict=True):
            m.implementation.restore(state)

    def _use_states(self) -> None:
        """C saves into the memory of these states."""
        if self._states[0] is not None:
            self.struct.states = self._states[0].pointers

    # What they tell.

    def failure(self, t: float) -> ToleranceExceeded:
        """Why they cannot continue at `t` [s]."""
        component, variable = self._outputs[self.struct.worst]
        most, smallest = float(self.struct.tolerance), self.ticks * float(self._base.tick)
        error = self.struct.error * most
        return ToleranceExceeded(component.name, variable.name, error, most, self._tolerance, smallest, t)

    @property
    def effort(self) -> StepEffort:
        """How many steps there were, and how long they were."""
        s, second = self.struct.steps, float(self._base.tick)
        ticks = (s.smallest, s.total / max(1, s.n_accepted), s.largest)
        lengths = dict(zip(("smallest", "mean", "largest"), (second * n for n in ticks), strict=True))
        least, why = second * (self.struct.internal or 1), ""
        if least > _declared(self._schedule) * (self._tolerance / JUMPS):
            why = "fixed internal steps (fixedInternalStepSize)" if self.struct.internal else "double-precision times"
        counts = s.n_accepted, s.n_rejected, s.n_beyond
        return StepEffort(self._tolerance, *counts, **lengths, least=least, limited_by=why)


def _direct(
    schedule: Schedule,
    layout: Layout,
    ports: Mapping[SystemComponent, Ports],
    loops: Sequence[AlgebraicLoop],
    repeated: Container[SystemComponent],
) -> tuple[list[SystemComponent], list[SystemComponent | AlgebraicLoop]]:
    """Components with outputs that depend directly on connected inputs.

    Returns those that compute them in steps only, and those that can compute them again without a step and loops, in
    the order in which they pass on values (a component may occur several times).
    """
    sources = {(c.target, c.input.name): c for c in schedule.connections}
    solved = {(c.source, c.output.name): loop for loop in loops for c in loop.connections}
    values: TopologicalSorter[_Value] = TopologicalSorter(dict.fromkeys(loops, ()))
    held: list[SystemComponent] = []
    direct: set[tuple[SystemComponent, str]] = set()
    for m in schedule.continuous:
        late = {v.name: sources[m, v.name].source.discrete for v in layout.ports[m].inputs if m.description.waits(v)}
        found = None if m in repeated else _dependencies(m, layout.ports[m], ports[m], late)
        if found is None:
            held.append(m)
            continue
        for output, inputs in found.items():
            value = solved.get((m, output), (m, output))
            direct.add((m, output))
            before = [(c.source, c.output.name) for c in (sources[m, i] for i in inputs) if not c.source.discrete]
            values.add(value, *(v for b in before if (v := solved.get(b, b)) not in loops or v is not value))
    order: list[SystemComponent | AlgebraicLoop] = []
    try:
        values.prepare()
    except CycleError as cycle:
        path = " -> ".join(v.names if isinstance(v, AlgebraicLoop) else f"{v[0].name}.{v[1]}" for v in cycle.args[1])
        raise LoopError(
            f"there may be an algebraic loop that is not declared: {path}. Declare on which inputs these outputs depend"
            " directly, or run the system without a tolerance."
        ) from None
    while values.is_active():
        ready = values.get_ready()
        values.done(*ready)
        due = {v[0] for v in ready if not isinstance(v, AlgebraicLoop) and v in direct}
        order += [*sorted(due, key=lambda m: m.name), *(loop for loop in loops if loop in ready)]
    return held, order


def _dependencies(
    component: SystemComponent, port: PortLayout, ports: Ports, late: Mapping[str, bool]
) -> dict[str, list[str]] | None:
    """Outputs with the connected inputs on which they depend directly; None if they may, but follow in steps only.

    `late`: inputs that wait for event mode, and whether they change at instants of a discrete component only.
    """
    about, every = component.description, [v.name for v in port.inputs if not late.get(v.name)]
    known = {v.name: declared(component, v.name) for v in port.outputs}
    possible = {v: every if on is None else [i for i in every if i in on] for v, on in known.items()}
    read = {i for inputs in possible.values() for i in inputs}
    if not read:
        return {}
    if not read.isdisjoint(late):
        return None
    inputs = [i for i in port.inputs if i.name in read]
    measured = between_steps(component, port, ports, inputs, port.outputs)
    own = about.kind is not None and about.fmi_version  # an FMU of this project
    if not any(measured.values()) and not own and about.interface != "me":
        exact: Any = component.implementation if about.directional_derivatives else None
        return None if exact is None or any(exact.measure_dependencies(inputs, port.outputs).values()) else {}
    found = {v: possible[v] if on is not None else [i for i in every if i in measured[v]] for v, on in known.items()}
    return {v: on for v, on in found.items() if on}
