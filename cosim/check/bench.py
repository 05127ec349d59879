"""What the checks that run an FMU have in common: short runs from its start values, and how two of them compare."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from cosim.check.calls import OK, WARNING, Ended, Fmu, Instance, Refused, bits
from cosim.check.model import Interface, Model, Var
from cosim.check.rules import Finding, NotApplicable, warning

STEPS = 10  # communication steps of a run
MOST_READ = 400  # variables that are compared after each
MOST_TRIED = 12  # variables that are tried one by one
RESTART = 1e-4  # relative difference that an integrator with error control may make when it begins anew
EQUAL = 1e-9  # relative difference up to which numbers of two equal runs are rounding, not another result

Values = dict[Var, list[Any]]
T = TypeVar("T")


@dataclass
class Bench:
    """An FMU with one of its interfaces, and what has been measured of it."""

    fmu: Fmu
    kind: str
    measures: dict[str, str] = field(default_factory=dict)

    @property
    def model(self) -> Model:
        return self.fmu.model

    @property
    def version(self) -> str:
        return self.fmu.version

    @property
    def interface(self) -> Interface:
        return self.fmu.model.interfaces[self.kind]

    @property
    def step(self) -> float:
        """Step of a run [s]: as the FMU would have it, with Model Exchange short enough for an explicit integrator."""
        fixed = self.interface.says.get("fixedInternalStepSize")
        step = self.model.step
        if self.kind == "me":
            return min(step, 1e-3) / 10
        try:
            internal = float(fixed) if fixed else 0.0
        except ValueError:
            internal = 0.0
        return max(1, round(step / internal)) * internal if internal > 0 else step

    def instance(self, **options: Any) -> Instance:
        return self.fmu.instance(self.kind, **options)

    def require(self, capability: bool, reason: str) -> None:
        """Raise NotApplicable without a capability."""
        if not capability:
            raise NotApplicable(reason)

    def several(self) -> None:
        """Raise NotApplicable where there may be one instance only."""
        self.require(not self.interface.once, "it can be instantiated only once per process")

    def watched(self) -> list[Var]:
        """Variables whose values make up the result of a run: outputs first."""
        order = {"output": 0, "local": 1, "calculatedParameter": 2}
        found = [v for v in self.fmu.readable(self.model.variables) if v.causality in order]
        return sorted(found, key=lambda v: (order[v.causality], v.position))[:MOST_READ]

    def settable(self, *causalities: str, numbers: bool = True) -> list[Var]:
        """Inputs or parameters that can be set at will."""
        found = self.fmu.readable(self.model.of(*causalities))
        return [v for v in found if v.variability != "constant" and (not numbers or v.is_number or v.access == "Boolean") and v.starts() is not None]

    def run(self, instance: Instance, steps: int = STEPS, step: float | None = None) -> list[Values]:
        """Results before the first and after each step. Ends early where the FMU wants to end."""
        watched = self.watched()
        found = [instance.get(watched)]
        try:
            for _ in range(steps):
                instance.step(self.step if step is None else step)
                found.append(instance.get(watched))
        except Ended:
            pass
        return found

    def fresh(self, values: Mapping[Var, Sequence[Any]] | None = None, steps: int = STEPS) -> list[Values]:
        """A run of an instance of its own."""
        with self.instance() as a:
            try:
                a.initialize(values)
            except Ended:
                return []
            return self.run(a, steps)

    def repeatable(self) -> list[Values]:
        """A run that a second one repeats. Raises NotApplicable."""
        first = self.fresh()
        self.several()
        if difference(first, self.fresh()):
            raise NotApplicable("two runs from the same start differ anyway (see runs.repeat)")
        return first


def compared(one: Sequence[Values], other: Sequence[Values], what: str) -> Finding | None:
    """What is wrong with two runs that must be the same: an error, or a warning where a solver that begins anew may be the reason."""
    if text := difference(one, other, RESTART):
        return Finding(f"{what}: {text}", "error")
    text = difference(one, other)
    return warning(f"{what}, slightly: {text}") if text else None


def difference(one: Sequence[Values], other: Sequence[Values], tolerance: float = EQUAL) -> str:
    """Where two runs differ by more than rounding, in words; empty: they do not."""
    for k, (a, b) in enumerate(zip(one, other, strict=False)):
        if text := differs(a, b, tolerance):
            return f"{text} after {k} steps" if k else f"{text} at the start"
    return "" if len(one) == len(other) else f"one ended after {len(one) - 1} steps, the other after {len(other) - 1}"


def differs(a: Values, b: Values, tolerance: float = EQUAL) -> str:
    """The first variable whose values differ by more than rounding."""
    equal = bits(b)
    for v, raw in bits(a).items():
        if raw == equal.get(v):
            continue
        for x, y in zip(a[v], b[v], strict=True):
            if not same(x, y, tolerance):
                return f"{v.name!r} is {shown(x)} and {shown(y)}"
    return ""


def same(x: Any, y: Any, tolerance: float = EQUAL) -> bool:
    """Equal, or equal but for rounding; NaN equals NaN."""
    if isinstance(x, float) and isinstance(y, float):
        if math.isnan(x) or math.isnan(y):
            return math.isnan(x) and math.isnan(y)
        return x == y or abs(x - y) <= tolerance * max(abs(x), abs(y), 1e-6)
    return bool(x == y)


def shown(x: Any) -> str:
    if isinstance(x, bytes):
        return repr(x.decode("utf-8", "replace")[:40])
    return f"{x:.9g}" if isinstance(x, float) else str(x)


def moved(v: Var, values: Sequence[Any], by: float = 1e-2) -> list[Any] | None:
    """Other values within the range of a variable; None: there are none."""
    low, high = (-math.inf if v.low is None else v.low), (math.inf if v.high is None else v.high)
    if v.access == "Boolean":
        return [not x for x in values]
    if not v.is_number or not values:
        return None
    found: list[Any] = []
    for x in values:
        if v.is_float:
            size = by * max(abs(x), (v.nominal or 0.0) if x == 0 else 0.0) or by
            options = [x + size, x - size, x + size / 100, x - size / 100]
        else:
            options = [x + 1, x - 1]
        fits = [o for o in options if low <= o <= high and o != x]
        if v.access.startswith("UInt"):
            fits = [o for o in fits if o >= 0]
        if not fits:
            return None
        found.append(fits[0])
    return found


def tried(candidates: Sequence[T], most: int = MOST_TRIED) -> list[T]:
    """Some of many, spread over all."""
    stride = max(1, math.ceil(len(candidates) / most))
    return list(candidates)[::stride]


def attempt(call: Callable[[], Any]) -> Any:
    """The result, or None where the FMU refuses: what it does not want to do is its right."""
    try:
        return call()
    except (Refused, Ended):
        return None


def good(status: int) -> bool:
    return status in (OK, WARNING)


Found = Iterator[Any]
