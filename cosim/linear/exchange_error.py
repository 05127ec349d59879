"""How large the error of the exchange is: the same run with communication steps of a half and a quarter.

Coupled continuous components read each other's outputs once per communication step. The error that this makes falls
with a power of the step, so runs with steps h, h/2 and h/4 tell its order and, by Richardson's extrapolation, its size:
with d1 = y(h) - y(h/2), d2 = y(h/2) - y(h/4) and 2^p = |d1| / |d2|,

    error of y(h) = d1 + d2 + d2 / (2^p - 1).

Only continuous components that exchange values with others have their steps divided; discrete components keep their
sample times, which are part of what they are. FMUs with an internal step of their own (`solver.step`) integrate with at
most h/4 in these runs, and the run without that change tells the error of the solvers apart.

What one coupling contributes, from one component to another, is what changes in the run with h/2 if its values alone
are read at steps of h still.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.core.component import Array, PythonComponent
from cosim.core.errors import CosimError
from cosim.recording.recording import Recording
from cosim.system.components import Connection, SystemComponent
from cosim.system.loops import numeric

if TYPE_CHECKING:
    from cosim.system.wiring import Wiring

SOLVER_STEP = "solver.step"
"""Parameter of FMUs of this project: the largest step of their solver [s]."""
ROUNDING = 1e-12
"""Differences between runs below this share of the largest value are rounding."""
_ORDERS = 0.4, 4.5  # what the differences of an exchange can show: first order, or second where it is extrapolated
_GROWTH = 10.0  # beyond it values grow

Run = Callable[[], Recording]


@dataclass(frozen=True)
class SignalError:
    """Error of one recorded variable, in its unit: the largest of the run.

    `size`: its largest magnitude; `order`: with which power of the step the error of the exchange falls, None where it
    is rounding or does not fall; `solver`: error of the FMUs' own solvers, as far as they can be told to use smaller
    steps; `contributions`: what each coupling adds, `source -> target`, the largest first;
    `unstable`: its values grow from step to step, and how far depends on the step.
    """

    name: str
    unit: str
    size: float
    exchange: float
    order: float | None
    solver: float
    contributions: Mapping[str, float]
    unstable: bool = False

    @property
    def relative(self) -> float:
        """Error of the exchange as a share of the largest magnitude."""
        return self.exchange / self.size if self.size else 0.0


@dataclass(frozen=True)
class ExchangeError:
    """Errors of the recorded variables of a run, the relatively largest first, flags last; print it.

    `steps`: communication steps of the coupled continuous components [s], by name; `fixed`: names of those whose steps
    cannot be divided, so that the error that they make is not known.
    """

    signals: tuple[SignalError, ...]
    steps: Mapping[str, Fraction]
    fixed: tuple[str, ...] = ()

    def advice(self, tolerance: float = 1e-3) -> str:
        """Which step brings the error of the exchange to `tolerance`, relative to the largest magnitude of a variable.

        The largest error, what makes it, and the step that would do; and what is not known.
        """
        if not self.fixed:
            return self._advice(tolerance)
        names = ", ".join(map(repr, self.fixed))
        return (
            f"{self._advice(tolerance)} The error made by the steps of {names} is not contained: the internal steps of"
            f" {'its FMU' if len(self.fixed) == 1 else 'their FMUs'} (fixedInternalStepSize) do not allow a quarter of"
            " the communication step."
        )

    def _advice(self, tolerance: float) -> str:
        if not self.steps:
            return "No continuous components are coupled, so the exchange makes no error."
        worst = self.signals[0]
        if not worst.exchange:
            return (
                "No variable changes with the communication steps: the exchange makes no error, or FMUs have internal"
                " steps that are longer."
            )
        text = f"The exchange makes an error of {worst.relative:.2g} of the largest value of {worst.name}"
        most = next(iter(worst.contributions), None)
        if most is not None and worst.contributions[most] > 0.5 * worst.exchange:
            text += f", most of it by {most}"
        if worst.relative <= tolerance:
            return f"{text}; it is within {tolerance:g}."
        if unstable := next((s.name for s in self.signals if s.unstable), ""):
            return (
                f"The exchange is unstable at these communication steps: the values of {unstable} grow from step to"
                " step, differently with each step size, so the error cannot be told; use much smaller ones."
            )
        if worst.order is None:
            return f"{text}; it does not fall with the step, as where events or sampling decide."
        factor = (tolerance / worst.relative) ** (1.0 / worst.order)
        chosen = dict.fromkeys(most.split(" -> ") if most else self.steps)
        by_step: dict[str, list[str]] = {}
        for name in chosen:
            by_step.setdefault(f"{1e3 * float(self.steps[name]) * factor:.2g} ms", []).append(name)
        steps = " and ".join(f"{step} ({', '.join(names)})" for step, names in by_step.items())
        return f"{text}. For {tolerance:g}, communication steps of about {steps} would do."

    def __str__(self) -> str:
        return self.table()

    def table(self, tolerance: float = 1e-3) -> str:
        """One line for each variable, and the advice."""
        lines = [f"{'variable':32} {'exchange':>10} {'relative':>9} {'order':>5} {'solvers':>10}  most by"]
        for s in self.signals:
            order = "-" if s.order is None else f"{s.order:.1f}"
            most = next(iter(s.contributions), "")
            name = f"{s.name} [{s.unit}]" if s.unit else s.name
            lines.append(f"{name:32} {s.exchange:10.3g} {s.relative:9.2g} {order:>5} {s.solver:10.3g}  {most}")
        return "\n".join([*lines, self.advice(tolerance)])


class _Hold(PythonComponent):
    """Passes values on at its own sample times."""

    kind = "discrete"

    def __init__(self, n: int):
        self.inputs, self.outputs = tuple(f"u{i}" for i in range(n)), tuple(f"y{i}" for i in range(n))  # type: ignore[misc]
        super().__init__()

    def start(self, u: Array, y: Array) -> None:
        y[:] = u

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        y[:] = u


def exchange_error(
    wiring: Wiring, run: Run, *, contributions: bool = True, progress: Callable[[int, int], None] | None = None
) -> ExchangeError:
    """Error of the exchange of a system; see `System.exchange_error`.

    Args:
        wiring: the system, whose steps are changed for the runs and restored after them.
        run: runs it and returns the recording, with an interval of its own choice that does not follow the steps.
        contributions: one more run for each coupling of two continuous components.
        progress: called with the number of runs that are done, and of all.

    Raises:
        CosimError: a run ends before the others.
    """
    coupled = [
        m
        for m in wiring.components.values()
        if not m.discrete and any(m in (c.source, c.target) for c in _couplings(wiring))
    ]
    divisible = [m for m in coupled if _is_divisible(m)]
    couplings = _pairs(wiring) if contributions else {}
    total, done = (4 + len(couplings) if coupled else 1), 0

    def measured() -> Recording:
        nonlocal done
        found = run()
        done += 1
        if progress is not None:
            progress(done, total)
        return found

    with warnings.catch_warnings():
        given = measured()
        if not coupled:
            signals = [SignalError(n, given.units.get(n, ""), _size(given[n]), 0.0, None, 0.0, {}) for n in given.names]
            return ExchangeError(tuple(signals), {})
        warnings.simplefilter("ignore")  # said by the first run
        with _fine_solvers(coupled):
            runs = []
            for divisor in (1, 2, 4):
                with _divided(divisible, divisor):
                    runs.append(measured())
            held = {}
            with _divided(divisible, 2):
                for name, connections in couplings.items():
                    with _held(wiring, connections, coupled):
                        held[name] = measured()
    _require_same_times([given, *runs, *held.values()])
    signals = [_signal(n, given, runs, held) for n in given.names]
    signals.sort(key=lambda s: (not _is_real(wiring, s.name), -s.relative, s.name))
    fixed = tuple(m.name for m in coupled if m not in divisible)
    return ExchangeError(tuple(signals), {m.name: m.step for m in coupled}, fixed)


def _is_real(wiring: Wiring, name: str) -> bool:
    owner, variable = wiring.components.parts(name)
    return wiring.components[owner].description.find(variable, owner).type == "real"


def _couplings(wiring: Wiring) -> list[Connection]:
    return [c for c in numeric(wiring.connections.values()) if not (c.source.discrete or c.target.discrete)]


def _pairs(wiring: Wiring) -> dict[str, list[Connection]]:
    """Couplings by the names of their components; extrapolated and delayed ones cannot be held apart."""
    found: dict[str, list[Connection]] = {}
    for c in _couplings(wiring):
        if not (c.extrapolate or c.delay or c.source is c.target):
            found.setdefault(f"{c.source.name} -> {c.target.name}", []).append(c)
    return found


def _signal(name: str, given: Recording, runs: Sequence[Recording], held: Mapping[str, Recording]) -> SignalError:
    whole, half, quarter = (r[name] for r in runs)
    size = _size(given[name])
    first, second = whole - half, half - quarter
    large, small = _size(first), _size(second)
    order = math.log2(large / small) if small > ROUNDING * size and large > 0.0 else None
    if order is not None and not _ORDERS[0] <= order <= _ORDERS[1]:
        order = None
    rest = second / (2.0**order - 1.0) if order is not None else np.zeros_like(second)
    error = _size(first + second + rest)
    share = error / large if large > ROUNDING * size else 0.0
    parts = {pair: share * _size(r[name] - half) for pair, r in held.items()}
    return SignalError(
        name,
        given.units.get(name, ""),
        size,
        error if error > ROUNDING * size else 0.0,
        order,
        _size(given[name] - whole),
        dict(sorted(parts.items(), key=lambda item: (-item[1], item[0]))),
        _diverges(runs, name),
    )


def _diverges(runs: Sequence[Recording], name: str) -> bool:
    """Whether values grow within the run in which they are largest, and far less in another."""
    values = sorted((r[name] for r in runs), key=_size)
    half = len(values[-1]) // 2
    return _size(values[-1]) > _GROWTH * max(_size(values[0]), _size(values[-1][:half]))


def _size(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _require_same_times(runs: Sequence[Recording]) -> None:
    ends = [r.time[-1] if len(r) else math.nan for r in runs]
    if any(not np.array_equal(r.time, runs[0].time) for r in runs):
        raise CosimError(
            f"the runs end at {min(ends):.9g} to {max(ends):.9g} s, so they cannot be compared: give a stop time at"
            " which none of them has ended"
        )


def _is_divisible(component: SystemComponent) -> bool:
    """Whether a quarter of its communication step is a multiple of the internal step of its FMU."""
    internal = component.description.internal_step
    return internal is None or (component.step / 4 / internal).denominator == 1


@contextmanager
def _divided(components: Sequence[SystemComponent], divisor: int) -> Iterator[None]:
    """Divides the steps of the components."""
    before = {m: m.step for m in components}
    try:
        for m in components:
            m.step /= divisor
        yield
    finally:
        for m, step in before.items():
            m.step = step


@contextmanager
def _fine_solvers(components: Sequence[SystemComponent]) -> Iterator[None]:
    """Solver steps of at most a quarter of the communication step, where an FMU has them as a parameter."""
    before = {m: dict(m.values) for m in components}
    try:
        for m in components:
            if SOLVER_STEP in m.description.parameters:
                m.set({SOLVER_STEP: min(float(m.start(SOLVER_STEP)), float(m.step) / 4)})
        yield
    finally:
        for m, values in before.items():
            m.values = values


@contextmanager
def _held(wiring: Wiring, connections: Sequence[Connection], coupled: Sequence[SystemComponent]) -> Iterator[None]:
    """These connections deliver values at twice the present step of their source."""
    source = connections[0].source
    name = f"{source.name}-held"
    before: dict[str, Any] = dict(wiring.connections)
    assert source in coupled
    try:
        hold = wiring.add(name, _Hold(len(connections)), step=2 * source.step, offset=source.offset)
        inputs, outputs = (list(x.values()) for x in (hold.description.inputs, hold.description.outputs))
        for i, c in enumerate(connections):
            into = Connection(source, c.output, hold, inputs[i])
            wiring.connections[into.target_name] = into
            wiring.connections[c.target_name] = Connection(
                hold, outputs[i], c.target, c.input, scale=c.scale, offset=c.offset
            )
        yield
    finally:
        wiring.connections.clear()
        wiring.connections.update(before)
        if name in wiring.components:
            del wiring.components[name]
