"""What a policy sees and does: variables with ranges, as a space of gymnasium and back.

A range becomes -1 to 1, as learning algorithms expect it; a variable without one keeps its own unit and is unbounded.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.base.checks import did_you_mean
from build_fmus.base.units import KNOWN, UnitMismatchError, conversion
from cosim import CosimError, System, SystemComponent, Variable, WiringError
from cosim.core.signals import Array

with extras.needed("learning", "cosim.gym"):
    from gymnasium.spaces import Box

Range = tuple[float, float] | tuple[float, float, str] | None
"""Lowest and highest value, in the variable's unit or in the one that is given; None: unbounded."""
Ranges = Mapping[str, Range] | Sequence[str] | str


class ActionError(CosimError, ValueError):
    """An invalid action: of another shape, not finite, or outside of its range."""


class Signals:
    """Variables in their order, with what -1 and 1 stand for.

    Attributes:
        names: full names; `units`: of each, by name.
        space: their space, (n,).
    """

    def __init__(
        self, chosen: Sequence[tuple[SystemComponent, Variable]], ranges: Sequence[tuple[float, float] | None]
    ):
        self.names = [f"{m.name}.{v.name}" for m, v in chosen]
        self.units = {n: v.unit_name for n, (_, v) in zip(self.names, chosen, strict=True)}
        self.ranges = dict(zip(self.names, ranges, strict=True))
        middle = [0.0 if r is None else (r[0] + r[1]) / 2 for r in ranges]
        half = [1.0 if r is None else (r[1] - r[0]) / 2 for r in ranges]
        self._middle, self._half = np.array(middle), np.array(half)
        self._per = 1 / self._half
        self._lowest = np.array([-math.inf if r is None else r[0] for r in ranges])
        self._highest = np.array([math.inf if r is None else r[1] for r in ranges])
        high = np.array([math.inf if r is None else 1.0 for r in ranges])
        self.space = Box(-high, high, dtype=np.float64)
        self._low, self._high = self.space.low, self.space.high
        self._bounds = high.tolist()

    def scaled(self, values: Array) -> Array:
        """Values (n,) in their units as an element of the space.

        Values beyond its range are shown at its end, as by a sensor.
        """
        found: Array = (values - self._middle) * self._per
        return np.maximum(self._low, np.minimum(self._high, found))

    def beyond(self, values: Array) -> list[str]:
        """Names of the values (n,) that `scaled` shows at the ends of their ranges although they are beyond."""
        off = np.abs((values - self._middle) * self._per) > self._high
        return [n for n, is_off in zip(self.names, off.tolist(), strict=True) if is_off]

    def values(self, action: Any) -> Array:
        """An element of the space (n,) as values in their units.

        Raises:
            ActionError: the action is invalid; the message names the variable, and what it may be.
        """
        try:
            given = np.asarray(action, dtype=float)
        except (TypeError, ValueError):
            raise ActionError(f"the action is {action!r}; give {self._expected}") from None
        if given.shape != self._middle.shape:
            raise ActionError(f"the action has shape {given.shape}; give {self._expected}")
        for name, value, bound in zip(self.names, given.tolist(), self._bounds, strict=True):
            if not -bound <= value <= bound or math.isinf(value):  # NaN is in no range
                limits = f"from -1 to 1, which are {self._text(name)}" if bound == 1 else "that is finite"
                hint = "; gymnasium.wrappers.ClipAction clips" if math.isfinite(value) else ""
                raise ActionError(f"the action for {name} is {value:g}; give a number {limits}{hint}")
        found: Array = self._middle + self._half * given
        return np.maximum(self._lowest, np.minimum(self._highest, found))  # not beyond by rounding

    @property
    def _expected(self) -> str:
        return f"{len(self.names)} number{'s' * (len(self.names) != 1)}: {', '.join(self.names)}"

    def _text(self, name: str) -> str:
        low, high = self.ranges[name] or (-math.inf, math.inf)
        return f"{low:g} to {high:g} {self.units[name]}".rstrip()


def actions(system: System, ranges: Ranges) -> Signals:
    """What a policy sets: inputs that nothing drives, and tunable parameters; real ones.

    Raises:
        WiringError: a name that does not exist, an input that is connected, a variable that cannot be set while a
            simulation runs, an invalid range.
    """
    listed = _named(ranges)
    if not listed:
        raise WiringError("no action: name an unconnected input or a tunable parameter")
    found: dict[str, tuple[SystemComponent, Variable, tuple[float, float] | None]] = {}
    for pattern, limits in listed:
        for component, variable in _inputs(system, pattern):
            name = f"{component.name}.{variable.name}"
            if name in found:
                raise WiringError(f"the action {name} is named twice")
            found[name] = component, variable, _range(name, variable, limits)
    return Signals([(m, v) for m, v, _ in found.values()], [r for *_, r in found.values()])


def _inputs(system: System, pattern: str) -> list[tuple[SystemComponent, Variable]]:
    """The inputs and parameters that a name or pattern of an action stands for."""
    chosen = system.components.fitting(pattern, "input")
    if "*" in pattern or "?" in pattern:
        chosen = [(m, v) for m, v in chosen if f"{m.name}.{v.name}" not in system.connections]
    if not chosen:
        free = ", ".join(system.unconnected()) or "none"
        raise WiringError(f"the action '{pattern}' fits no unconnected input; there are: {free}")
    for component, variable in chosen:
        name = f"{component.name}.{variable.name}"
        driven = system.connections.get(name)
        if driven is not None:
            raise WiringError(f"the action {name} is driven by {driven.source_name}: system.disconnect('{name}') first")
        if variable.causality != "input" and variable.variability != "tunable":
            raise WiringError(
                f"the action {name} is neither an input nor a tunable parameter, but {variable.causality},"
                f" {variable.variability}"
            )
        if variable.type != "real":
            raise WiringError(f"the action {name} is of type {variable.fmi_type}; actions are real")
    return chosen


def observations(system: System, ranges: Ranges) -> Signals:
    """What a policy sees: outputs (or other variables that can be recorded).

    Raises:
        WiringError: a name that does not exist, an invalid range.
    """
    listed = _named(ranges)
    found: dict[str, tuple[SystemComponent, Variable, tuple[float, float] | None]] = {}
    for pattern, limits in listed:
        for component, variable in system.select([pattern]):
            name = f"{component.name}.{variable.name}"
            if name in found:
                raise WiringError(f"the observation {name} is named twice")
            found[name] = component, variable, _range(name, variable, limits)
    if not found:
        raise WiringError("no observation: name at least one output")
    return Signals([(m, v) for m, v, _ in found.values()], [r for *_, r in found.values()])


def _named(ranges: Ranges) -> list[tuple[str, Range]]:
    if isinstance(ranges, str):
        return [(ranges, None)]
    if isinstance(ranges, Mapping):
        return list(ranges.items())
    if not isinstance(ranges, Iterable) or not all(isinstance(name, str) for name in ranges):
        raise WiringError(f"{ranges!r} names no variables; give names, or a dict with the range of each")
    return [(name, None) for name in ranges]


def _range(name: str, variable: Variable, limits: Range) -> tuple[float, float] | None:
    """A range in the variable's unit, or what the variable declares."""
    if limits is None:
        low, high = variable.minimum, variable.maximum
        return None if low is None or high is None or not high > low else (float(low), float(high))
    try:
        low, high = (float(limit) for limit in limits[:2])
        (unit,) = limits[2:] or ("",)
    except (TypeError, ValueError):
        raise WiringError(
            f"the range of {name} is {limits!r}; give (lowest, highest) or (lowest, highest, unit)"
        ) from None
    if unit:
        if unit not in KNOWN:
            raise WiringError(f"the range of {name} is in {unit!r}, which is not a unit{did_you_mean(unit, KNOWN)}")
        try:
            scale, offset = conversion(KNOWN[unit], variable.unit)
        except UnitMismatchError as error:
            raise WiringError(f"the range of {name} [{variable.unit_name}] is in {unit}: {error}") from None
        low, high = scale * low + offset, scale * high + offset
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise WiringError(
            f"the range of {name} is from {limits[0]} to {limits[1]}; the lowest value must be below the highest"
        )
    for bound, value in ((variable.minimum, low), (variable.maximum, high)):
        if bound is not None and variable.causality != "output" and (low < bound if value == low else high > bound):
            raise WiringError(f"the range of {name} reaches {value:g} {variable.unit_name}; its limit is {bound:g}")
    return low, high
