"""Metrics of an experiment with their derivatives by parameters of its system, each point in one run.

`System.gradient` carries derivatives to every sample that is recorded. `measure` is a function of these samples: it is
applied to the recording, and to the recording moved along the derivatives of each parameter by a small step, forward
and backward. So any experiment has derivatives, with as many runs as points.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any

import numpy as np

from cosim import Execution
from cosim.core.signals import Array
from cosim.gradient import GradientError, Mean
from cosim.study.driver import refuse_tolerance
from cosim.study.experiment import Row, Run
from cosim.study.fmus import FmuSet
from cosim.study.runner import Runner
from cosim.study.sweep import Sweep
from cosim.study.swept import swept

Values = Mapping[str, Any]

DESIGN_STEP = 1e-5  # of what a design takes, relative, for its differences
STEP = 1e-6  # of a parameter, relative (absolute where it is 0), by which a recording is moved


@dataclass(frozen=True)
class Slopes:
    """Metrics of a run and their derivatives.

    Attributes:
        row: numbers by name.
        slopes: derivatives (parameters,) of each number, in its unit by that of the parameter.
    """

    row: Mapping[str, float]
    slopes: Mapping[str, Array]


@dataclass
class PointSlopes:
    """Points of a sweep as a function of values by name: `Slopes` of its metrics by its axes.

    Args:
        sweep: any of this experiment, whose axes are parameters of components.
        fmus: its FMUs.
        execution: how systems are executed.
        threads: of a run with derivatives; None: all cores.
        names: axes by which derivatives are taken; None: all.

    Raises:
        GradientError: an axis is an option of the cases.
    """

    sweep: Sweep
    fmus: FmuSet
    execution: Execution = field(default_factory=Execution)
    threads: int | None = None
    names: Sequence[str] | None = None
    points: int = field(default=0, init=False)
    """How many were computed."""
    remarks: list[str] = field(default_factory=list, init=False)
    """Of the last point: components that are followed by differences, comparisons that changed sides, a run that ended
    before its stop time."""
    _spent: float = field(default=0.0, init=False)
    _run: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        refuse_tolerance(self.execution)
        self._axes = [a.name for a in self.sweep.design.axes]
        self._names = self._axes if self.names is None else list(self.names)
        own = {name for name, _ in self.sweep.parameters}
        for name in self._names:
            if name not in own:
                raise GradientError(
                    f"{name} has no derivative: it is an option of the cases; vary COMPONENT.PARAMETER of the system,"
                    " or search without derivatives"
                )
        made = swept(self.sweep.experiment, self.sweep.parameters)
        self._runner = Runner(made, self.fmus, execution=self.execution)

    def __enter__(self) -> PointSlopes:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._runner.close()

    @property
    def run_equivalents(self) -> float:
        """Processor time of all runs with derivatives over that of a run without; compilers are not counted."""
        return self._spent / self._run if self._run else 0.0

    @property
    def run_time(self) -> float:
        """Processor time of a run without derivatives [s]."""
        return self._run

    def case(self, values: Mapping[str, Any]) -> Any:
        """The case of a point."""
        named = {a: values[n] for a, n in zip(self.sweep.attributes, self._axes, strict=True)}
        return self.sweep.case(**{**self.sweep.base, **named})

    def present(self) -> dict[str, float]:
        """The axes' values in the system as it is, where nothing varies."""
        system = self._runner.system(self.case(dict.fromkeys(self._names)))
        return {n: float(Run(None, None, system).start(n) or 0.0) for n in self._names}

    def __call__(self, values: Mapping[str, Any]) -> Slopes:
        """Metrics of a point and their derivatives.

        Raises:
            GradientError: a parameter has no derivative.
            CosimError: the run fails.
        """
        case = self.case(values)
        options, system = self._runner.experiment.run, self._runner.system(case)
        end, ended = options.end(system, case), ""
        if not self._run or (options.stop_when and options.stop_when(system, case)):
            run, took = _timed(lambda: self._runner.run(case))
            again = took if self._run else _timed(lambda: self._runner.run(case))[1]
            self._run = min(took, again, self._run or took)
            if run.recording.stopped_by is not None:
                end = float(run.recording.time[-1])
                ended = f"the run ends at t = {end:.9g} s ({run.recording.stopped_by}), a time that is held"
        outputs = [f"{m.name}.{v.name}" for m, v in system.select(options.recorded(case))]
        found, took = _timed(
            lambda: system.gradient(
                {n: Mean(n) for n in outputs},
                self._names,
                stop_time=end,
                interval=options.interval_of(case),
                threads=self.threads,
                mode="forward",  # derivatives of the samples
            )
        )
        self._spent, self.points = self._spent + took, self.points + 1
        row = self._measured(case, found.recording, system)
        columns = [self._along(values, k, found) for k in range(len(self._names))]
        self.remarks = [
            *filter(None, [ended]),
            *(f"{n}: derivatives from differences of two neighboring instances" for n in found.by_difference),
            *(f"{n}: comparisons changed sides in {c} steps" for n, c in found.changes.items() if c),
        ]
        return Slopes(row, {n: np.array([c.get(n, np.nan) for c in columns]) for n in row})

    def _along(self, values: Mapping[str, Any], k: int, found: Any) -> dict[str, float]:
        """Derivatives of all metrics by one parameter."""
        name, at = self._names[k], float(found.at[k])
        component, _, variable = name.partition(".")
        least, most = self._runner.system(self.case(values))[component].description.find(variable, component).limits
        h = STEP * (abs(at) or 1.0)
        low, high = max(at - h, least), min(at + h, most)
        rows = []
        for x in (low, high):
            case = self.case({**values, name: x})
            moved = replace(found.recording, data=found.recording.data + (x - at) * found.tangents[:, :, k])
            rows.append(self._measured(case, moved, self._runner.system(case)))
        return {n: (rows[1][n] - rows[0][n]) / (high - low) for n in rows[0] if n in rows[1]}

    def _measured(self, case: Any, recording: Any, system: Any) -> dict[str, float]:
        row: Row = self._runner.experiment.measured(Run(case, recording, system))
        return {n: float(v) for n, v in row.items() if isinstance(v, int | float)}


@dataclass(frozen=True)
class LocalSlopes:
    """Derivatives at the medians of the axes of a sweep, beside the deviations of these.

    Attributes:
        at: medians, by axis.
        deviations: standard deviations of the axes' distributions, by axis that has a derivative.
        slopes: numbers there and their derivatives, in the order of `deviations`.
    """

    at: Values
    deviations: Mapping[str, float]
    slopes: Slopes

    def relative(self, metric: str, axis: str) -> float | None:
        """Relative change of a number by relative change of a parameter; None where one is 0 or has no derivative."""
        if axis not in self.deviations or not self.slopes.row[metric] or not self.at[axis]:
            return None
        slope = float(self.slopes.slopes[metric][list(self.deviations).index(axis)])
        return slope * float(self.at[axis]) / self.slopes.row[metric]

    def spread(self, metric: str, axis: str) -> float | None:
        """Standard deviation of a number from that of one parameter; None where there is no derivative."""
        if axis not in self.deviations:
            return None
        slope = float(self.slopes.slopes[metric][list(self.deviations).index(axis)])
        return abs(slope) * self.deviations[axis]

    def covariance(self, metrics: Sequence[str]) -> Array:
        """Of numbers (n, n), from independent deviations of the parameters: J diag(deviation^2) J'."""
        size = list(self.deviations.values())
        scaled = np.array([self.slopes.slopes[m] for m in metrics]).reshape(len(metrics), len(size)) * size
        found: Array = scaled @ scaled.T
        return found


QUANTILES = (np.arange(1000) + 0.5) / 1000


def local_slopes(sweep: Sweep, fmus: FmuSet, execution: Execution | None = None) -> LocalSlopes:
    """Derivatives at the medians of a sweep's axes, by those that are parameters of components with real values.

    Raises:
        GradientError: no axis is such a parameter, or one has no derivative.
        CosimError: the run at the medians fails.
    """
    kinds = dict(sweep.parameters)
    axes = [a for a in sweep.design.axes if kinds.get(a.name) == "real"]
    if not axes:
        raise GradientError(
            "no parameter of this sweep has a derivative: vary COMPONENT.PARAMETER of the system with real values"
        )
    at = {a.name: a.at(np.array([0.5]))[0] for a in sweep.design.axes}
    deviations = {a.name: float(np.std(a.at(QUANTILES))) for a in axes}
    with PointSlopes(sweep, fmus, execution or Execution(), names=list(deviations)) as evaluate:
        return LocalSlopes(at, deviations, evaluate(at))


def through(evaluate: Callable[[Values], Slopes], design: Callable[[Values], Values]) -> Callable[[Values], Slopes]:
    """Slopes by what a design takes, such as weights, from those by what it gives, such as the gains of a controller.

    The derivatives of `design`, which should be quick and smooth, are central differences; no run is needed for them.
    What it gives is what `evaluate` takes, in the same order.
    """

    def evaluated(values: Values) -> Slopes:
        given = design(values)
        found = evaluate(given)
        columns = []
        for name, at in values.items():
            h = DESIGN_STEP * (abs(at) or 1.0)
            up, down = (design({**values, name: at + s * h}) for s in (1.0, -1.0))
            columns.append([(up[n] - down[n]) / (2.0 * h) for n in given])
        chain = np.array(columns).T
        return Slopes(found.row, {n: slopes @ chain for n, slopes in found.slopes.items()})

    return evaluated


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call gives, and the processor time of this process that it takes [s]."""
    begin = time.process_time()
    found = call()
    return found, time.process_time() - begin
