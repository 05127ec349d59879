"""Brings the components of an exchange into their initial state, or into a saved one."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from contextlib import suppress
from fractions import Fraction
from typing import Any

import numpy as np

from cosim.core.component import EndRequested
from cosim.core.errors import CosimError, NotFinite, WiringError
from cosim.engine.adaptive import AdaptiveSteps
from cosim.engine.clock_networks import clock_networks
from cosim.engine.exchange import Ending, Exchange, Phase
from cosim.engine.loops import loops_of, measure, repeated_steps, undeclared
from cosim.engine.state import Packed, SystemState, difference, unpack
from cosim.fmu.clocked_steps import ClockNetwork
from cosim.system.components import Connection, SystemComponent
from cosim.system.loops import sampled_loops
from cosim.system.renewal import renewed


def initialize(exchange: Exchange, stop: Fraction | None = None, state: SystemState | None = None) -> None:
    """Initialize all components: enter initialization mode, iterate inputs and outputs until they settle, and leave.

    Components that are in `state` continue from there, and the others settle to them. If the system is that of the
    state, it is restored exactly as it was, to the last bit, also within steps.
    """
    components = exchange.schedule.components
    exchange.values[:] = 0.0
    exchange.tick, exchange.phase, exchange.ending, exchange.adaptive = 0, Phase.ARRIVED, None, None
    _renew(components)
    restored = [] if state is None else _continued(exchange, state)
    for m in components:
        m.implementation.instantiate(m.name)
        if m.values:
            m.implementation.set({m.description.variables[n]: v for n, v in m.values.items()})
    for m in components:
        begin = exchange.base.start + m.offset
        told = None
        if stop is not None and stop > begin and ((stop - begin) / m.step).denominator == 1:
            # A discrete component runs at the stop time, and an FMU refuses a step beyond the stop time it is given.
            told = float(stop + m.step if m.discrete and m.description.fmi_version else stop)
        m.implementation.enter_initialization(float(begin), told)
    for m in components:
        if not _still_bound(exchange, m):
            port = exchange.layout.ports[m]
            wide = {"sizes": port.sizes} if port.sizes else {}
            exchange.ports[m] = m.implementation.bind(port.inputs, port.outputs, port.u, port.y, **wide)
            exchange.forget()
    _read_constants(exchange)
    possible = undeclared(exchange.schedule)
    measured = measure(exchange.schedule, [m for m in possible if m in restored])
    for m in restored:
        with suppress(EndRequested):  # the state says whether the run has ended
            m.implementation.exit_initialization()
        saved = state.components[m.name]  # type: ignore[union-attr]
        if isinstance(saved, Packed):
            unpack(m, saved)
        else:
            m.implementation.restore(saved)
        exchange.ports[m].get_outputs()
    fresh = [m for m in components if m not in restored]
    _pass_parameters([c for c in exchange.schedule.parameters if c.target in fresh])
    _read_constants(exchange)
    exchange.engine.publish()
    if possible:
        _settle(exchange, [m for m in fresh if m not in possible])
        measured |= measure(exchange.schedule, [m for m in possible if m in fresh])
        exchange.loops, exchange.measured = loops_of(exchange.schedule, measured), measured
        exchange.forget()
    unsettled = _settle(exchange, fresh)
    if unsettled and not (restored or exchange.late_loops):
        exchange.late_loops = sampled_loops(exchange.schedule.connections)
        exchange.forget()
        unsettled = _settle(exchange, fresh, late=True) if exchange.late_loops else unsettled
    if unsettled:
        warnings.warn(
            f"initial values do not settle, there is a loop among them: {', '.join(unsettled[:10])}", stacklevel=6
        )
    _check_constants(exchange, fresh)
    networks = [
        ClockNetwork([m.implementation.clocked for m in p.components], p.ticks, p.wires)  # type: ignore[attr-defined]
        for p in clock_networks(exchange.schedule, lambda m: m.implementation.clocked.values)  # type: ignore[attr-defined]
    ]
    before = exchange.values.copy()
    for begin_events in (*(m.implementation.exit_initialization for m in fresh), *(n.begin for n in networks)):
        try:
            begin_events()
        except EndRequested as request:  # the run ends with the first row
            exchange.ending = exchange.ending or Ending(exchange.tick, request.component, str(request))
    for m in fresh:
        exchange.ports[m].get_outputs()
    exchange.repeated = repeated_steps(exchange.schedule, exchange.loops, exchange.layout.ports, exchange.ports)
    if exchange.repeated:
        exchange.ports |= {m: step.ports for m, step in exchange.repeated.items()}
        exchange.forget()
    if restored:
        exchange.engine.publish()
    else:
        exchange.engine.follow_events(before)
    _check_initial_values(exchange)
    if state is not None:
        _take(exchange, state)
    if exchange.tolerance is not None:
        last = 0 if stop is None else exchange.base.at_or_after(stop)
        exchange.adaptive = AdaptiveSteps(
            exchange.schedule,
            exchange.layout,
            exchange.base,
            exchange.ports,
            exchange.tolerance,
            last,
            exchange.loops,
            exchange.repeated,
        )
        exchange.forget()


def _read_constants(exchange: Exchange) -> None:
    """Read the parameters and unconnected inputs that are recorded or watched."""
    for (m, variable), slot in exchange.layout.constants.items():
        exchange.values[slot] = float(m.implementation.get([variable])[0])


def _pass_parameters(connections: Sequence[Connection]) -> None:
    """Set parameters to the values that other components calculate, until none changes: one may follow from another.

    Raises WiringError for values that a parameter cannot have, and for parameters that follow from each other.
    """
    known: dict[str, Any] = {}
    for _ in range(len(connections) + 1):
        before = dict(known)
        for c in connections:
            (value,) = c.source.implementation.get([c.output])
            if known.get(c.target_name) == value:  # never None
                continue
            known[c.target_name] = value
            given = value if (c.scale, c.offset) == (1.0, 0.0) else c.scale * value + c.offset
            try:
                (given,) = c.target.expand(c.input.name, given).values()
            except WiringError as error:
                raise WiringError(f"{c.source_name} -> {c.target_name}: {error}") from None
            c.target.implementation.set({c.input: given})
        if known == before:
            return
    named = ", ".join(c.target_name for c in connections)
    raise WiringError(
        f"calculated parameters do not settle: some of {named} follow from each other; take one connection out"
    )


def _still_bound(exchange: Exchange, component: SystemComponent) -> bool:
    """Whether its ports of an initialization before still serve: an FMU whose instance was only reset."""
    ports = exchange.ports.get(component)
    calls = None if ports is None else ports.fmi
    return calls is not None and calls.states is not None and calls.instance == component.implementation.address  # type: ignore[attr-defined]


def _renew(components: Sequence[SystemComponent]) -> None:
    """Components written in Python as they were added, whatever an earlier run has left."""
    sources = {m.name: m.source for m in components if m.source is not None}
    if not sources:
        return
    made = renewed(sources)
    for m in components:
        if m.source is not None and m.implementation is not made[m.name]:
            if m.implementation is not m.source.added:
                m.implementation.close()
            m.implementation = made[m.name]


def _take(exchange: Exchange, state: SystemState) -> None:
    """The exchanged values of a state: all of them where the system continues as it was, else what was shown before."""
    stored, continues = dict(zip(state.keys, state.values.tolist(), strict=True)), state.continues(exchange.schedule)
    if continues:
        tick = exchange.base.at_or_after(state.base.exact(state.tick))
        exchange.tick, exchange.phase = tick, state.phase
        if state.ending is not None:
            tick = exchange.base.at_or_after(state.base.exact(state.ending.tick))
            exchange.ending = state.ending._replace(tick=tick)
    within = {m.name for m in exchange.schedule.continuous if continues and _within(state, m.name)}
    for slot, key in enumerate(exchange.layout.keys):
        part, component, variable = key
        name = f"{component}.{variable}" if variable else f"the time of {component}"
        if key in stored and (
            (continues and part != "constant") or (part == "previous" and component in state.components)
        ):
            exchange.values[slot] = stored[key]
        elif continues and (part in ("previous", "sample_time") or (part == "visible" and component in within)):
            raise CosimError(
                f"the state does not hold what {name} shows until the step of '{component}' ends: record or watch it "
                "where the state is saved"
            )
        if not exchange.allow_nan and not math.isfinite(exchange.values[slot]):
            value = float(exchange.values[slot])
            raise CosimError(
                f"the state's value of {name} is {value}; give execution=Execution(allow_nan=True) to let it pass"
            )


def _within(state: SystemState, component: str) -> bool:
    """Whether a component was within a step."""
    clock = state.clock(component)
    return state.tick > clock.offset and not clock.due(state.tick)


def _check_initial_values(exchange: Exchange) -> None:
    if exchange.allow_nan:
        return
    culprit = exchange.layout.not_finite(exchange.schedule.components)
    for (component, variable), slot in exchange.layout.constants.items():
        if culprit is None and not np.isfinite(exchange.values[slot]):
            culprit = NotFinite(component.name, variable.name, float(exchange.values[slot]))
    if culprit is not None:
        raise culprit


def _continued(exchange: Exchange, state: SystemState) -> list[SystemComponent]:
    """Components that are in a saved state.

    If the system is not that of the state, they must be at the end of a step.
    """
    schedule = exchange.schedule
    if not set(state.instances.values()) <= set(schedule.components):  # components are never taken out of a system
        raise CosimError(
            "this state was saved in another system; FMU states belong to their instances: give it as bytes, "
            "SystemState.from_bytes(state.to_bytes()), or in a file"
        )
    restored = [m for m in schedule.components if m.name in state.components]
    if state.continues(schedule):
        return restored
    why = f"; {difference(state, schedule)}, so it does not simply continue"
    strange = sorted({*state.components} - {m.name for m in restored})
    if strange:
        raise CosimError(f"this state was saved in another system: '{strange[0]}' is not in this one")
    if state.phase is not Phase.ARRIVED:
        raise CosimError(
            f"this state was saved at a stop condition; save it after an advance that reached its time{why}"
        )
    for m in restored:
        clock, (kind, *_) = state.clock(m.name), state.wiring["components"][m.name]
        if kind != m.kind:
            raise CosimError(f"'{m.name}' is {m.kind} here, and {kind} in the state")
        if clock.offset or not clock.due(state.tick):
            raise CosimError(
                f"'{m.name}' is within a step (or has an offset) at t = {state.time:.9g} s: save the state at a "
                f"common multiple of all steps{why}"
            )
    return restored


def _settle(exchange: Exchange, components: Sequence[SystemComponent], *, late: bool = False) -> list[str]:
    """Pass outputs to inputs until nothing changes except for rounding; returns the values that still change."""
    changes = exchange.engine.settle(components, late=late)
    return [
        f"{component}.{variable}"
        for (part, component, variable), changed in zip(exchange.layout.keys, changes, strict=True)
        if part == "visible" and changed
    ]


def _check_constants(exchange: Exchange, components: Sequence[SystemComponent]) -> None:
    """Refuse sources that do not have the constant which an input must equal, where only now they show it."""
    for m in components:
        port = exchange.layout.ports[m]
        for variable, value in port.numbers(port.inputs, port.u):
            if not variable.accepts(value):
                connection = next(c for c in exchange.schedule.connections if (c.target, c.input) == (m, variable))
                raise WiringError(f"{connection}: the input {variable.refusal(value)}")
