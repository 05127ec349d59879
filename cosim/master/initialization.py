"""Brings the components of an exchange into their initial state, or into a saved one."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from cosim.errors import CosimError, NotFinite, WiringError
from cosim.master.exchange import Exchange, Phase
from cosim.master.state import SystemState
from cosim.master.timetable import Clock
from cosim.system.members import Member


def initialize(exchange: Exchange, stop: Fraction | None = None, state: SystemState | None = None) -> None:
    """All components into initialization mode; inputs and outputs settle; out of it again. Components that are in
    `state` continue from there, and the others settle to them."""
    members = exchange.schedule.members
    restored = [] if state is None else _continued(exchange, state)
    for m in members:
        m.component.instantiate(m.name)
        if m.values:
            m.component.set({m.description.variables[n]: v for n, v in m.values.items()})
    for m in members:
        begin = exchange.base.start + m.offset
        met = stop is not None and stop > begin and ((stop - begin) / m.step).denominator == 1
        m.component.enter_initialization(float(begin), float(stop) if stop is not None and met else None)
    for m in members:
        place = exchange.layout.places[m]
        exchange.ports[m] = m.component.bind(place.inputs, place.outputs, place.u, place.y)
    for (m, variable), slot in exchange.layout.constants.items():
        exchange.values[slot] = float(m.component.get([variable])[0])
    for m in restored:
        m.component.exit_initialization()
        m.component.restore(state.components[m.name])  # type: ignore[union-attr]
        exchange.ports[m].get_outputs()
    exchange.layout.show_everything()
    fresh = [m for m in members if m not in restored]
    _settle(exchange, fresh)
    _check_constants(exchange, fresh)
    for m in fresh:
        m.component.exit_initialization()
        exchange.ports[m].get_outputs()
    exchange.layout.show_everything()
    _check_initial_values(exchange)
    if state is not None:
        exchange.layout.take_previous(state.owner.layout, state.values)


def _check_initial_values(exchange: Exchange) -> None:
    if exchange.allow_nan:
        return
    culprit = exchange.layout.not_finite(exchange.schedule.members)
    for (member, variable), slot in exchange.layout.constants.items():
        if culprit is None and not np.isfinite(exchange.values[slot]):
            culprit = NotFinite(member.name, variable.name, float(exchange.values[slot]))
    if culprit is not None:
        raise culprit


def _continued(exchange: Exchange, state: SystemState) -> list[Member]:
    """The members that are in a saved state, checked to be at the end of a step there."""
    owner = state.owner
    if not set(owner.schedule.members) <= set(exchange.schedule.members):  # members are never taken out of a system
        raise CosimError("this state was saved in another system; FMU states belong to their instances")
    if state.phase is not Phase.ARRIVED:
        raise CosimError("this state was saved at a stop condition; save it after an advance that reached its time")
    restored = [m for m in exchange.schedule.members if m in owner.schedule.members and m.name in state.components]
    for m in restored:
        clock = Clock(owner.base.count(m.step), owner.base.count(m.offset))
        if m.offset or not clock.due(state.tick):
            raise CosimError(
                f"'{m.name}' is within a step (or has an offset) at t = {state.time:.9g} s: save the state at a "
                "common multiple of all steps"
            )
    return restored


def _settle(exchange: Exchange, members: Sequence[Member]) -> None:
    """Pass outputs to inputs, in order of execution, until nothing changes any more, but for rounding."""
    gather = {m: exchange.layout.gather(m) for m in members}
    for _ in range(20 + len(members)):
        before = exchange.values.copy()
        for m in members:
            gather[m](0.0)
            exchange.ports[m].set_inputs()
            exchange.ports[m].get_outputs()
            exchange.layout.show_everything()
        with np.errstate(invalid="ignore"):
            moved = np.abs(exchange.values - before) > 1e-12 * np.maximum(1.0, np.abs(before))
        if not moved.any():
            return
    names = [n for n, (slot, _, _) in exchange.layout.readable.items() if moved[slot]]
    warnings.warn(f"initial values do not settle, there is a loop among them: {', '.join(names[:10])}", stacklevel=6)


def _check_constants(exchange: Exchange, members: Sequence[Member]) -> None:
    """Refuse sources that do not have the constant which an input must equal, where only now they show it."""
    connections = {(c.target, c.input): c for c in exchange.schedule.connections}
    for m in members:
        place = exchange.layout.places[m]
        for variable, value in zip(place.inputs, place.u, strict=True):
            if not variable.accepts(float(value)):
                connection = connections[m, variable]
                raise WiringError(f"{connection}: the input {variable.refusal(float(value))}")
