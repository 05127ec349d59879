"""What the checks that run an FMU have in common: short runs from its start values, and how two of them compare."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

from cosim.check.apart import run_apart
from cosim.check.calls import Ended, Fmu, Instance, Refused, bits
from cosim.check.model import Var
from cosim.check.rules import Finding, require, warning

STEPS = 10  # communication steps of a run
MOST_READ = 400  # variables that are compared after each
MOST_TRIED = 12  # variables that are tried individually
EQUAL = 1e-9  # of the largest value of a signal: up to which numbers of two equal runs are rounding, not another result
OTHER = 1e-4  # of the largest value of a signal: from which on fixed steps give another result
TOLERANCE = 1e-4  # relative tolerance of an integrator with error control, where the default experiment has none
SLACK = 20.0  # times the tolerance: what an integrator with error control that begins from scratch may change

Values = dict[Var, list[Any]]
T = TypeVar("T")


@dataclass
class Bench:
    """An FMU with one of its interfaces, and what has been measured of it.

    `model` is its modelDescription.xml, `version` "2" or "3", `interface` the one that is checked.
    """

    fmu: Fmu
    kind: str
    measures: dict[str, str] = field(default_factory=dict)
    _made: int = 0

    def __post_init__(self) -> None:
        self.model, self.version = self.fmu.model, self.fmu.version
        self.interface = self.model.interfaces[self.kind]

    @property
    def step(self) -> float:
        """Step of a run [s]: as the FMU would have it, with Model Exchange short enough for an explicit integrator."""
        step, internal = self.model.step, self.interface.internal_step
        if self.kind == "me":
            return min(step, 1e-3) / 10
        return max(1, round(step / internal)) * internal if internal else step

    @property
    def tells_step(self) -> bool:
        """Whether the FMU says what steps it takes, so that none of them passes without effect."""
        return self.interface.internal_step is not None or "stepSize" in self.model.experiment

    def instance(self, **options: Any) -> Instance:
        """An instance in this process: of some FMUs the only one (`alone`)."""
        self._made += 1
        require(self._made == 1 or not self.interface.once, "it can be instantiated only once per process")
        return Instance(self.fmu, self.kind, **options)

    def alone(self, work: Callable[..., T], *arguments: Any, **options: Any) -> T:
        """Call `work` with an instance of its own, then `arguments`, and return its result.

        If the FMU allows one instance per process, the instance gets a process.
        """

        def with_instance() -> T:
            with self.instance(**options) as a:
                return work(a, *arguments)

        if not self.interface.once:
            return with_instance()
        require(self._made == 0, "it can be instantiated only once per process")
        return run_apart(with_instance, self.model.variables)

    def several(self) -> None:
        """Raise NotApplicable where there may be one instance at a time only."""
        require(not self.interface.once, "it can be instantiated only once per process")

    def watched(self) -> list[Var]:
        """Variables whose values make up the result of a run: outputs first."""
        order = {"output": 0, "local": 1, "calculatedParameter": 2}
        found = [v for v in self.fmu.readable(self.model.variables) if v.causality in order]
        return sorted(found, key=lambda v: (order[v.causality], v.position))[:MOST_READ]

    def continuous(self) -> set[Var]:
        """Continuous variables that can be read."""
        readable = self.fmu.readable(self.model.variables)
        return {v for v in readable if v.is_float and v.variability == "continuous"}

    def settable(self, *causalities: str) -> list[Var]:
        """Numbers and Booleans among inputs or parameters that can be set at will."""
        found = [v for v in self.fmu.readable(self.model.of(*causalities)) if v.is_number or v.access == "Boolean"]
        return [v for v in found if v.variability != "constant" and v.starts() is not None]

    def continuous_inputs(self) -> list[Var]:
        """Inputs that can be set at will, as far as they are continuous."""
        return [v for v in self.settable("input") if v.is_float and v.variability == "continuous"]

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

    def fresh(
        self, values: Mapping[Var, Sequence[Any]] | None = None, steps: int = STEPS, **options: Any
    ) -> list[Values]:
        """A run of an instance of its own."""

        def run(a: Instance) -> list[Values]:
            try:
                a.initialize(values)
            except Ended:
                return []
            return self.run(a, steps)

        return self.alone(run, **options)

    def repeatable(self) -> list[Values]:
        """A run that a second one repeats. Raises NotApplicable."""
        first = self.fresh()
        require(not difference(first, self.fresh()), "identical runs already differ (see runs.repeat)")
        return first

    @cached_property
    def error_control(self) -> bool:
        """Whether the FMU has an integrator with error control: a tighter tolerance changes its results.

        Always false for Model Exchange.
        """
        if self.kind == "me":
            return False
        tighter = attempt(lambda: self.fresh(tolerance=self.tolerance / 100))
        return tighter is not None and bool(difference(self.fresh(), tighter))

    @property
    def tolerance(self) -> float:
        """Relative tolerance of an integrator with error control: that of the default experiment, which it is given."""
        declared = self.model.experiment.get("tolerance", math.nan)
        return declared if 0 < declared < 1 else TOLERANCE


def compared(
    bench: Bench, one: Sequence[Values], other: Sequence[Values], what: str, *, restarted: bool = False
) -> Finding | None:
    """Differences between two runs that must be the same.

    Fixed steps repeat their results to rounding: a larger difference is a warning, and an error from a relative
    difference of `OTHER`. An integrator with error control that begins from scratch changes its results by some
    tolerances: only a larger difference is an error.

    Args:
        bench: the bench of the FMU, which knows its tolerance.
        one: values of the first run at each communication point.
        other: those of the second run.
        what: what was done, as the beginning of the message.
        restarted: it was observed that an integrator begins from scratch; else a run with another tolerance shows
            whether there is one.
    """
    text = difference(one, other)
    if not text:
        return None
    if not (restarted or bench.error_control):
        beyond = difference(one, other, OTHER)
        return Finding(f"{what}: {beyond}", "error") if beyond else warning(f"{what}, slightly: {text}")
    floor = {v: 1.0 if v.nominal is None else abs(v.nominal) for v in bench.watched()}
    beyond = difference(_only(one, True), _only(other, True), SLACK * bench.tolerance, floor)
    if beyond:
        return Finding(f"{what}: {beyond}, which is more than its tolerance {bench.tolerance:g} explains", "error")
    text = difference(_only(one, False), _only(other, False))
    return warning(f"{what}: {text}") if text else None


def _only(run: Iterable[Values], floats: bool) -> list[Values]:
    return [{v: x for v, x in values.items() if v.is_float is floats} for values in run]


def difference(
    one: Sequence[Values], other: Sequence[Values], tolerance: float = EQUAL, floor: Mapping[Var, float] | None = None
) -> str:
    """First difference of two runs by more than `tolerance` of a signal's largest value (at least `floor`), in words.

    Empty if the runs agree.
    """
    if one == other:
        return ""
    scales = peaks([*one, *other], floor)
    for k, (a, b) in enumerate(zip(one, other, strict=False)):
        if text := differs(a, b, tolerance, scales):
            return f"{text} after {k} steps" if k else f"{text} at the start"
    return "" if len(one) == len(other) else f"one ended after {len(one) - 1} steps, the other after {len(other) - 1}"


def peaks(run: Iterable[Values], floor: Mapping[Var, float] | None = None) -> dict[Var, float]:
    """The largest value of each real signal in a run, at least `floor`."""
    found = dict(floor or {})
    for values in run:
        for v, xs in values.items():
            if v.is_float:
                found[v] = max(found.get(v, 0.0), *(abs(x) for x in xs if math.isfinite(x)), 0.0)
    return found


def differs(a: Values, b: Values, tolerance: float, scales: Mapping[Var, float]) -> str:
    """The first variable whose values differ by more than a part of its scale."""
    if a == b:
        return ""
    equal = bits(b)
    for v, raw in bits(a).items():
        if raw == equal.get(v):
            continue
        for x, y in zip(a[v], b[v], strict=True):
            if not same(x, y, tolerance) and not (v.is_float and abs(x - y) <= tolerance * scales[v]):
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
    """A value as text for a message, numbers to nine digits."""
    if isinstance(x, bytes):
        return repr(x.decode("utf-8", "replace")[:40])
    return f"{x:.9g}" if isinstance(x, float) else str(x)


def all_moved(variables: Iterable[Var], by: float = 1e-2) -> Values:
    """`moved` of all variables that have other values."""
    return {v: values for v in variables if (values := moved(v, by)) is not None}


def moved(v: Var, by: float = 1e-2) -> list[Any] | None:
    """Values within the range of a variable other than its start values; None: there are none."""
    values, (low, high) = v.starts() or [], v.bounds
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


def disturb(bench: Bench, a: Instance) -> None:
    """Other inputs, as far as the FMU takes them."""
    inputs = [
        v
        for v in tried(bench.settable("input"))
        if v.is_float and (bench.kind == "cs" or v.variability == "continuous")
    ]
    if values := all_moved(inputs):
        attempt(a.set, values)


def attempt(call: Callable[..., Any], *arguments: Any) -> Any:
    """The result, or None where the FMU refuses: what it does not want to do is its right."""
    try:
        return call(*arguments)
    except (Refused, Ended):
        return None
