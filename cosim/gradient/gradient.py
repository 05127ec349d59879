"""Derivatives of a whole run, carried forward through components, rates and the rule of exchange.

    found = system.gradient({"ride": Rms("car.seat.az"), "bump": Peak("car.seat.az")},
                            ["car.body.mass", "controller.gain.*"], stop_time=8.0, interval="10 ms")
    print(found)

What is differentiated is what was computed: the solver steps, samples and exchanges of the run itself, not equations
that they approximate. The run is bit-identical to one without derivatives (`cosim.batch`). FMUs of this project are
compiled over numbers that carry derivatives (`batch/runtime/numbers.h`); solutions of quadratic programs are
differentiated by their optimality conditions (`programs.h`). Third-party and isolated FMUs have no derivatives: two
more instances of them for each parameter go through the run on either side of it, and the differences of their outputs
take the place of derivatives.

A series, a column of a table, is as many parameters as it has samples, under one name.

There are two ways. Forward, numbers carry derivatives by the parameters, and the cost grows with their number. The
adjoint carries derivatives of the metrics from the end of the run to its beginning (`cosim.batch.adjoint`), at a cost
that does not depend on the number of parameters.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from build_fmus.base.checks import unknown
from cosim.batch import Batch, BatchRecording
from cosim.batch.adjoint import AdjointRun, NoAdjointError
from cosim.batch.copies import CopyFailedWarning
from cosim.batch.library import choose_target
from cosim.core.description import Variable
from cosim.core.errors import ComponentError, CosimError, UnconnectedInputsWarning
from cosim.core.signals import Array
from cosim.core.time import TimeLike, rational
from cosim.engine.execution import Record
from cosim.gradient.metrics import Metric
from cosim.recording.recording import Recording
from cosim.system.components import SystemComponent
from cosim.system.wiring import Wiring

DIRECTIONS = 16  # parameters that one copy of the system carries
MANY_DIRECTIONS = 52  # where there are more than two copies would carry: 13 vectors of AVX2 (tangents.h)
FORWARD = DIRECTIONS  # parameters up to which the forward way costs less than the adjoint (benchmarks/gradients.py)
_WHY = "a root, a quotient or a norm has no slope there, or a quadratic program was not solved"
STEP = 1e-4  # relative step of the differences that a gradient is compared with


class GradientError(CosimError, ValueError):
    """Parameters that nothing can be differentiated by, or a run that has no derivatives."""


@dataclass(frozen=True)
class Trust:
    """A gradient beside differences of neighboring runs.

    Attributes:
        near, far: central differences of the metrics by the parameters (metrics, parameters), from runs at relative
            steps of `step` and of twice that.
        smooth: time [s] up to which the runs of a parameter have taken the same sides of all comparisons (parameters,);
            a metric of samples until then is smooth there, and beyond it differences and derivatives may disagree. NaN
            where a component is followed by differences, since nothing is known of its comparisons.
        stop: time [s] at which the runs ended.
        deviation: difference of the gradient from the extrapolated differences, both times the parameter, relative to
            the largest of these products for each metric (metrics, parameters).
        parameters: names. A series is one of them: all its samples move at once, each up or down by the same step, in
            signs that are the same in each call (`signs_of`).
    """

    near: Array
    far: Array
    smooth: Array
    stop: float
    step: float
    deviation: Array
    parameters: Sequence[str]


@dataclass(frozen=True)
class Gradient:
    """Metrics of a run and their derivatives. `print()` it.

    Attributes:
        metrics, parameters: names. Each sample of a series is a parameter, `torque.u[1]` the first of `torque.u`.
        at: values of the parameters (parameters,).
        values: of the metrics (metrics,).
        jacobian: derivatives (metrics, parameters), each in the metric's unit by the parameter's.
        recording: what the metrics read.
        tangents: derivatives of the samples by the parameters (samples, variables, parameters), in the order of
            `recording.names`; the adjoint has none, so that it is empty then.
        by_difference: components whose derivatives are differences of two neighboring instances, and why.
        of_exact_solutions: components whose quadratic programs OSQP solves to a tolerance. The derivatives are those of
            the exact solutions.
        changes: by component, in how many steps a comparison that depends on the parameters had another outcome than in
            the step before: contacts, limits, pieces of tables. The derivative is that of the sides taken.
        ties: by component in which a change of a parameter by 1e-8 of its value, rounded up to a power of 2, gives a
            comparison another outcome, the time [s] of the first step with such a tie. A parameter that is 0 changes by
            1e-8, a sample by 1e-8 of the largest one. The derivative is that of one side, and may differ from that of
            the other. None of the adjoint.
        mode: "forward" or "adjoint".
    """

    metrics: Sequence[str]
    parameters: Sequence[str]
    at: Array
    values: Array
    jacobian: Array
    recording: Recording
    tangents: Array
    by_difference: Mapping[str, str]
    of_exact_solutions: Sequence[str]
    changes: Mapping[str, int]
    ties: Mapping[str, float]
    mode: str
    _run: GradientRun = field(repr=False)

    def __getitem__(self, metric: str) -> dict[str, Any]:
        """Derivatives of one metric, by the name of the parameter; by a series an array (samples,)."""
        if metric not in self.metrics:
            raise KeyError(f"there is no metric '{metric}'; there are: {', '.join(self.metrics)}")
        row = self.jacobian[list(self.metrics).index(metric)]
        return self._run.by_name(row)

    def trust(self, step: float = STEP) -> Trust:
        """Compare with central differences at two steps, relative to each parameter (to 1 where it is 0).

        Five runs for each parameter, and for each series, relative to its largest sample. Raises GradientError for a
        step that is no positive number, and for a parameter whose range ends within two steps.
        """
        if not (step > 0.0 and math.isfinite(step)):
            raise GradientError(f"step is {step}; give a positive number, such as {STEP}")
        with self._run.system.lock:
            return self._run.compare(self, step)

    def __str__(self) -> str:
        lines = []
        for metric, value, row in zip(self.metrics, self.values, self.jacobian, strict=True):
            lines.append(f"{metric} = {value:.9g}")
            width, at = max(map(len, self._run.by)), self._run.by_name(self.at)
            for name, slope in self._run.by_name(row).items():
                if isinstance(slope, float):
                    share = f"   {slope * at[name] / value:+.3g} relative" if value else ""
                    lines.append(f"    {name:{width}}  {slope:+.9e}{share}")
                else:
                    lines.append(f"    {name:{width}}  {slope.min():+.9e} to {slope.max():+.9e}, {len(slope)} samples")
        lines += [
            f"{name}: derivatives from differences of two neighboring instances ({why})"
            for name, why in self.by_difference.items()
        ]
        lines += [
            f"{name}: derivatives of the exact solutions of its quadratic programs, which OSQP solves to a tolerance"
            for name in self.of_exact_solutions
        ]
        lines += [
            f"{name}: in {n} steps other sides of comparisons than in the step before"
            for name, n in self.changes.items()
            if n
        ]
        lines += [
            f"{name}: at t = {t:.9g} s, a change of a parameter by 1e-8 of its value gives a comparison another"
            " outcome, so the derivative may be that of one side only"
            for name, t in self.ties.items()
        ]
        if self.mode == "adjoint":
            lines.append("the adjoint does not look for ties; mode='forward' does")
        return "\n".join(lines)


@dataclass
class GradientRun:
    """Arguments of `System.gradient`, and the runs that it makes."""

    system: Wiring
    metrics: Mapping[str, Metric]
    given: str | Iterable[str]
    stop_time: TimeLike
    interval: TimeLike | None
    threads: int | None
    mode: str | None = None

    def __post_init__(self) -> None:
        if self.mode not in (None, "forward", "adjoint"):
            raise GradientError(unknown("mode", str(self.mode), ("forward", "adjoint")))
        if rational(self.stop_time, "stop_time") <= self.system.experiment[0]:
            raise GradientError(f"stop_time is {self.stop_time}; a run needs time to depend on its parameters")
        if not self.metrics:
            raise GradientError("there is no metric to differentiate: give one, such as {'ride': Rms('car.seat.az')}")
        for name, metric in self.metrics.items():
            if isinstance(metric, type) or not (hasattr(metric, "names") and hasattr(metric, "of")):
                raise GradientError(
                    f"the metric '{name}' is {metric!r}; give one of cosim.gradient, such as Rms('car.seat.az'), or an"
                    " object with `names` and `of`"
                )
        self.parameters = _chosen(self.system, self.given)
        read = dict.fromkeys(name for metric in self.metrics.values() for name in metric.names)
        self.names = [f"{m.name}.{v.name}" for m, v in self.system.select(list(read))]
        self.order = {
            given: [f"{m.name}.{v.name}" for m, v in self.system.select([given])] for given in read
        }  # a metric may call a variable by another name than the recording
        self.by = [f"{m.name}.{v.name}" for m, v in self.parameters]
        self.samples = [v.samples for _, v in self.parameters]
        ends = np.cumsum([n or 1 for n in self.samples]).tolist()
        self._parts = [slice(end - (n or 1), end) for end, n in zip(ends, self.samples, strict=True)]
        self.elements = [
            each
            for name, n in zip(self.by, self.samples, strict=True)
            for each in ([f"{name}[{k}]" for k in range(1, n + 1)] if n else [name])
        ]
        for name, n in zip(self.by, self.samples, strict=True):
            if n and name not in self.names and all(c.source_name != name for c in self.system.connections.values()):
                raise GradientError(f"{name} is not connected, so that no metric depends on it: connect it to an input")
        self.at = self.present()

    def present(self) -> Array:
        """Values of the parameters in the system as it is now (parameters,)."""
        return np.concatenate([_start(m, v) for m, v in self.parameters])

    def by_name(self, values: Array) -> dict[str, Any]:
        """Of numbers (parameters,) those of each parameter: one, or an array of a series."""
        parts = zip(self.by, self.samples, self._parts, strict=True)
        return {name: values[part] if n else float(values[part][0]) for name, n, part in parts}

    def _sizes(self) -> Array:
        """The power of 2 from each parameter's magnitude on, or its series' largest, 1 for 0 (parameters,).

        Seeds of this size make a distance along a direction relative to the parameter, without rounding.
        """
        largest = np.concatenate(
            [np.full(n or 1, np.abs(self.at[part]).max()) for n, part in zip(self.samples, self._parts, strict=True)]
        )
        part, power = np.frexp(largest)
        return np.where(largest > 0.0, np.ldexp(1.0, np.clip(power - (part == 0.5), -300, 300)), 1.0)

    def gradient(self) -> Gradient:
        """In the mode that was given, else the one that costs less."""
        with self.system.lock:
            if self.mode == "adjoint" or (self.mode is None and len(self.elements) > FORWARD):
                try:
                    return self._adjoint()
                except NoAdjointError as error:
                    if self.mode is not None:
                        raise GradientError(str(error)) from error
            return self._forward()

    def _adjoint(self) -> Gradient:
        record = Record(self.names, self.interval)
        with _without_warnings(), closing(AdjointRun(self.system, self.by, record, self.stop_time)) as run:
            try:
                recording = run.forward(self.stop_time)
            except ComponentError as error:
                raise GradientError(f"the run has no derivatives, since it ends early: {error}") from error
            values, slopes = self._measure(recording)
            weights = np.zeros((len(slopes), len(recording.time), len(self.names)))
            for weight, each in zip(weights, slopes, strict=True):
                for k, w in each.items():
                    weight[:, k] = w
            jacobian = run.backward(list(weights))
            changes = run.side_changes
        bad = np.argwhere(~np.isfinite(jacobian))
        if len(bad):
            raise GradientError(
                f"the derivative of {list(self.metrics)[bad[0][0]]} by {self.elements[bad[0][1]]} is not finite, and"
                f" mode='forward' says where: {_WHY}"
            )
        nothing = np.empty((0, len(self.names), len(self.elements)))
        return Gradient(
            list(self.metrics),
            self.elements,
            self.at,
            values,
            jacobian,
            recording,
            nothing,
            {},
            run.of_exact_solutions,
            changes,
            {},
            "adjoint",
            self,
        )

    def _forward(self) -> Gradient:
        """All parameters, some by each copy."""
        n = len(self.elements)
        each = DIRECTIONS if n <= 2 * DIRECTIONS else MANY_DIRECTIONS
        copies, lanes = -(-n // each), choose_target().lanes
        seeds, sizes = np.zeros((n, copies, -(-each // lanes) * lanes)), self._sizes()
        seeds[range(n), np.arange(n) // each, np.arange(n) % each] = sizes
        own = {
            name: seeds[part] if samples else seeds[part.start]
            for name, samples, part in zip(self.by, self.samples, self._parts, strict=True)
        }
        recording, batch = self._advance(own, {}, copies)
        tangents = np.concatenate(list(recording.tangents[..., :each]), axis=-1)[..., :n] / sizes
        self._check(recording, tangents)
        one = recording.one(0)
        values, slopes = self._measure(one)
        jacobian = np.array([sum(np.tensordot(w, tangents[:, k], 1) for k, w in each.items()) for each in slopes])
        return Gradient(
            list(self.metrics),
            self.elements,
            self.at,
            values,
            jacobian,
            one,
            tangents,
            batch.by_difference,
            batch.of_exact_solutions,
            batch.side_changes,
            batch.ties,
            "forward",
            self,
        )

    def compare(self, found: Gradient, step: float) -> Trust:
        """The differences beside it."""
        if not np.array_equal(self.present(), self.at):
            raise GradientError(
                "the system has other parameters than when this gradient was computed: compute it again"
            )
        steps = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
        n, of = len(self.by), len(self.metrics)
        near, far, smooth = np.zeros((of, n)), np.zeros((of, n)), np.zeros(n)
        slopes, per = np.zeros((of, n)), np.zeros(n)
        for j, (name, samples, part) in enumerate(zip(self.by, self.samples, self._parts, strict=True)):
            at, signs = self.at[part], signs_of(samples) if samples else np.ones(1)
            per[j] = np.abs(at).max() or 1.0
            slopes[:, j] = found.jacobian[:, part] @ signs
            h = step * per[j]
            seeds = np.zeros((len(at), len(steps), DIRECTIONS))
            seeds[:, :, 0] = signs[:, None]
            start = at + h * steps[:, None] * signs
            if not samples:
                seeds, start = seeds[0], start[:, 0]
            try:
                recording, _ = self._advance({name: seeds}, {name: start}, len(steps))
            except CosimError as error:
                where = f"{at[0]:.9g} -+ {2.0 * h:.3g}" if not samples else f"samples -+ {2.0 * h:.3g}"
                raise GradientError(f"{name} cannot be compared with runs at {where}: {error}") from error
            value = np.array([self._measure(recording.one(c))[0] for c in range(len(steps))])
            near[:, j], far[:, j] = (value[3] - value[1]) / (2.0 * h), (value[4] - value[0]) / (4.0 * h)
            same = (recording.sides == recording.sides[2]).all(axis=(0, 2))
            smooth[j] = np.nan if found.by_difference else recording.time[same][-1] if same.any() else recording.time[0]
        exact = (4.0 * near - far) / 3.0
        size = np.abs(exact * per).max(axis=1, keepdims=True)
        deviation = (slopes - exact) * per / np.where(size == 0.0, 1.0, size)
        return Trust(near, far, smooth, float(found.recording.time[-1]), step, deviation, self.by)

    def _advance(
        self, seeds: Mapping[str, Array], start: Mapping[str, Array], copies: int
    ) -> tuple[BatchRecording, Batch]:
        with _without_warnings():
            batch = Batch(
                self.system,
                copies,
                start=start,
                seeds=seeds,
                record=Record(self.names, self.interval),
                stop_time=self.stop_time,
                threads=self.threads,
            )
            with batch:
                batch.advance(rational(self.stop_time, "stop_time"), final=True)
                if batch.failures:
                    raise GradientError(
                        f"the run has no derivatives, since it ends at t = {batch.failures[0].time:.9g} s:"
                        f" {batch.failures[0].message}"
                    )
                return batch.recording, batch

    def _measure(self, one: Recording) -> tuple[Array, list[dict[int, Array]]]:
        """Values of the metrics, and their derivatives by the samples of each variable."""
        values, slopes = [], []
        for name, metric in self.metrics.items():
            variables = [n for given in metric.names for n in self.order[given]]
            if len(variables) != len(metric.names):
                raise GradientError(f"the metric '{name}' reads a pattern: give full names, one metric for each")
            value, weights = metric.of([one[n] for n in variables])
            if not math.isfinite(value):
                raise GradientError(f"the metric '{name}' is {value}")
            if not all(np.isfinite(w).all() for w in weights):
                raise GradientError(f"the metric '{name}' is {value:.9g}, where it has no slope: use a QuadraticCost")
            values.append(value)
            of: dict[int, Array] = {}
            for variable, weight in zip(variables, weights, strict=True):
                k = list(one.names).index(variable)
                of[k] = of.get(k, 0.0) + weight
            slopes.append(of)
        return np.array(values), slopes

    def _check(self, recording: BatchRecording, tangents: Array) -> None:
        bad = np.argwhere(~np.isfinite(tangents))
        if len(bad):
            sample, variable, parameter = bad[0]
            raise GradientError(
                f"the derivative of {recording.names[variable]} by {self.elements[parameter]} is not finite at"
                f" t = {recording.time[sample]:.9g} s: {_WHY}"
            )


@contextmanager
def _without_warnings() -> Iterator[None]:
    """Without those of what an error tells, and a run has told."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CopyFailedWarning)
        warnings.simplefilter("ignore", UnconnectedInputsWarning)
        yield


def signs_of(samples: int) -> Array:
    """Which samples of a series go up (1) and down (-1) where it moves as a whole (samples,)."""
    return np.where(np.random.default_rng(0).integers(2, size=samples), 1.0, -1.0)


def _start(m: SystemComponent, v: Variable) -> Array:
    """What a parameter or a series starts with, (1,) or (samples,)."""
    found = m.start(v.name)
    return np.atleast_1d(0.0 if found is None else np.asarray(found, dtype=float))


def _chosen(system: Wiring, names: str | Iterable[str]) -> list[tuple[SystemComponent, Variable]]:
    """The parameters and start values, which all have derivatives."""
    found: dict[tuple[SystemComponent, Variable], None] = {}
    for name in [names] if isinstance(names, str) else names:
        pattern = "*" in name or "?" in name
        fitting = [
            pair
            for causality in ("parameter", "input", "output", "local")
            for pair in system.components.fitting(name, causality)
            if _refusal(system, *pair) is None or not pattern
        ]
        if not fitting:
            raise GradientError(f"'{name}' fits no parameter, start value, series or unconnected input of real numbers")
        for m, v in fitting:
            if why := _refusal(system, m, v):
                raise GradientError(f"{m.name}.{v.name} has no derivative: {why}")
            found[m, v] = None
    if not found:
        raise GradientError("there is no parameter to differentiate by: name one, such as car.body.mass")
    return list(found)


def _refusal(system: Wiring, m: SystemComponent, v: Variable) -> str | None:
    if v.type != "real":
        return f"it is of type {v.fmi_type}, and only real numbers vary continuously"
    if v.causality == "structuralParameter":
        return "it is a structural parameter"
    if v.name == "solver.step":
        return "it sets the number of solver steps"
    if v.causality == "input":
        source = system.connections.get(f"{m.name}.{v.name}")
        return None if source is None else f"{source.source_name} drives it"
    if v.causality != "parameter" and v.initial != "exact":
        return "it is calculated, so no start value can be given"
    return None
