"""Calibration of parameters against a response, and what the response tells of them.

    model = SystemResponse(system, ["car.body.az"], stop_time=5.0, interval="10 ms")
    found = calibrate(model, measured, {"car.body.mass": (2800.0, 1000.0, 6000.0)})
    print(found.text())

Nonlinear least squares in the logarithms of the parameters, which are positive. What the data do not tell is found from
the Jacobian of the response there, by central differences, or exact (`gradient=True`): with noise of standard deviation
s its Fisher information is J'J / s^2, whose inverse bounds the covariance of every unbiased estimate (Cramer and
Rao), and whose smallest eigenvalues belong to combinations of parameters that move nothing one could measure.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import combinations as pairs_of

import numpy as np
import numpy.typing as npt
from scipy import optimize, stats

from build_fmus.base.checks import finite
from cosim import Record, System
from cosim.batch import Batch
from cosim.core.errors import CosimError
from cosim.core.signals import Array
from cosim.core.time import TimeLike, rational
from cosim.gradient.metrics import Mean
from cosim.study.lanes import LANES_PAY, quiet_batch
from cosim.study.least_squares import Minimum, minimize_squares

Response = Callable[[Mapping[str, float]], npt.ArrayLike]
Range = tuple[float, float, float]
"""Where a parameter is looked for: first value, lowest, highest; all positive."""

VAGUE = 0.5  # relative standard deviation beyond which the data do not tell a parameter
CORRELATED = 0.95  # correlation beyond which the data tell a combination of two parameters, and hardly either
CONFIDENCE = 0.95
# of the logarithm of a parameter, for differences: first across kinks of the response, then for the result
STEPS = (1e-2, 1e-4)


class CalibrationError(CosimError, ValueError):
    """Parameters or data with which there is nothing to calibrate."""


class SystemResponse:
    """What a system shows for values of its parameters, by full name: (samples, outputs), reset and run again for each.

    Args:
        system: put together; it stays the caller's.
        outputs: full names.
        stop_time, interval: of a run, and between samples [s].
        lanes: as in `cosim.Execution`.
        gradient: derivatives are those of the run (`System.gradient`), not differences of runs. They are exact where
            the response is smooth. Where single samples jump, as at touch-downs of a tire, differences take the jump
            for a slope, and their intervals are too narrow.
    """

    def __init__(
        self,
        system: System,
        outputs: Sequence[str],
        *,
        stop_time: TimeLike,
        interval: TimeLike,
        lanes: str | None = None,
        gradient: bool = False,
    ) -> None:
        self.gradient = gradient
        self.outputs = [f"{m.name}.{v.name}" for m, v in system.select(list(outputs))]
        self._system, self._stop, self._record = system, stop_time, Record(self.outputs, interval)
        self._lanes, self._seconds = lanes, 0.0
        self._batches: list[Batch | None] = []  # one, when it is needed; None: nothing is vectorizable
        self.runs = self.runs_with_slopes = self.in_lanes = 0
        """How many runs so far were without and with derivatives, and how many of the former were copies in lanes."""
        self.by_difference: dict[str, str] = {}
        """Components whose derivatives were differences of two neighboring instances, and why."""

    def _set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            component, variable = self._system.components.split(name)
            component.set({variable: value})

    def with_slopes(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Outputs (samples, outputs) of a run, and their derivatives (samples, outputs, parameters) by these values."""
        self._set(values)
        found = self._system.gradient(
            {n: Mean(n) for n in self.outputs},
            list(values),
            stop_time=self._stop,
            interval=self._record.interval,
            mode="forward",
        )
        self.by_difference |= found.by_difference
        self.runs_with_slopes += 1
        tangents = found.tangents[:, [found.recording.names.index(n) for n in self.outputs]]
        return np.column_stack([found.recording[n] for n in self.outputs]), tangents

    def __call__(self, values: Mapping[str, float]) -> Array:
        """Outputs (samples, outputs) of a run with these parameters, by full name."""
        self._set(values)
        begin = time.perf_counter()
        recording = self._system.run(self._stop, record=self._record)
        self._seconds += time.perf_counter() - begin
        self.runs += 1
        return np.column_stack([recording[n] for n in self.outputs])

    def together(self, several: Sequence[Mapping[str, float]]) -> list[Array]:
        """Outputs of several runs, which are copies in lanes where that is possible and saves time."""
        vectors = self._lanes or ("auto" if self._seconds > LANES_PAY else "off")
        found: dict[int, Array] = {}
        if vectors != "off" and len(several) > 1:
            end = float(rational(self._stop, "stop_time"))
            self._batches = self._batches or [quiet_batch(self._system, self._record, end, vectors)]
            if (batch := self._batches[0]) is not None:
                batch.reset({name: [values[name] for values in several] for name in several[0]}, copies=len(several))
                batch.advance(end, final=True)
                ran = [k for k in range(len(several)) if k not in batch.recording.failed]
                found = {k: np.column_stack([batch.recording.one(k)[n] for n in self.outputs]) for k in ran}
                self.in_lanes += len(found)
                self.runs += len(found)
        return [found[k] if k in found else self(values) for k, values in enumerate(several)]


@dataclass(frozen=True)
class Calibration:
    """What was found, and how well the data tell it.

    Attributes:
        names: of the parameters; `values` (n,): at the smallest sum of squares; `bounds`: where they were looked
            for.
        residuals: (samples, outputs), data less response.
        jacobian: (samples * outputs, n), of the response over its noise, by the logarithms of the parameters.
        noise: standard deviation of each output (outputs,), as given, or estimated from the residuals.
        estimated: the noise is an estimate.
        inflation: factor on variances for residuals that are not independent from sample to sample.
        converged: the fit ended where the sum of squares no longer falls.
        by_difference: components whose derivatives were differences of neighboring instances, and why, of a fit that
            follows derivatives of the run.
    """

    names: Sequence[str]
    values: Array
    bounds: Sequence[tuple[float, float]]
    residuals: Array
    jacobian: Array
    noise: Array
    estimated: bool
    inflation: float
    converged: bool
    by_difference: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def information(self) -> Array:
        """Fisher information (n, n) of the logarithms of the parameters."""
        found: Array = self.jacobian.T @ self.jacobian / self.inflation
        return found

    @cached_property
    def _spectrum(self) -> tuple[Array, Array]:
        """Eigenvalues of the information, largest first, and its eigenvectors as columns (see `_by_parameter`)."""
        _, singular, rows = np.linalg.svd(self.jacobian, full_matrices=False)
        return singular**2 / self.inflation, _by_parameter(singular, rows.T)

    @cached_property
    def covariance(self) -> Array:
        """Of the logarithms (n, n), the bound of Cramer and Rao; infinite entries where the data tell nothing."""
        size, axes = self._spectrum
        told = size > np.finfo(float).eps * max(size[0], 1e-300) * len(self.jacobian)
        found: Array = (axes[:, told] / size[told]) @ axes[:, told].T
        lost = np.linalg.norm(axes[:, ~told], axis=1) > 1e-6
        found[lost, :] = found[:, lost] = 0.0
        found[lost, lost] = np.inf
        return found

    @cached_property
    def deviations(self) -> Array:
        """Relative standard deviations of the parameters (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """Of each parameter, at 95 % in the logarithms; (0, inf) where the data tell nothing."""
        free = max(1, self.jacobian.shape[0] - len(self.names))
        width = (stats.t.ppf if self.estimated else lambda q, _: stats.norm.ppf(q))((1 + CONFIDENCE) / 2, free)
        with np.errstate(over="ignore"):
            return [
                (v * float(np.exp(-width * d)), v * float(np.exp(width * d)))
                for v, d in zip(self.values.tolist(), self.deviations.tolist(), strict=True)
            ]

    @property
    def not_identifiable(self) -> list[str]:
        """Parameters that are not identifiable from these data.

        Their relative standard deviation is beyond one half, or their fit ended at a bound.
        """
        return [
            n for n, d, at in zip(self.names, self.deviations.tolist(), self.at_bounds, strict=True) if d > VAGUE or at
        ]

    @property
    def at_bounds(self) -> list[bool]:
        """Which parameters the fit left at an end of their range: there the value is the range's, not the data's."""
        return [
            abs(math.log(v / low)) < 1e-4 or abs(math.log(v / high)) < 1e-4
            for v, (low, high) in zip(self.values.tolist(), self.bounds, strict=True)
        ]

    @property
    def correlated(self) -> list[tuple[str, str, float]]:
        """Pairs of which the data tell a combination, and hardly either: names and correlation, strongest first."""
        d, c = self.deviations, self.covariance
        found = [
            (self.names[i], self.names[j], float(c[i, j] / (d[i] * d[j])))
            for i, j in pairs_of(range(len(self.names)), 2)
            if np.isfinite(d[i]) and np.isfinite(d[j]) and d[i] > 0 and d[j] > 0
        ]
        return sorted((p for p in found if abs(p[2]) > CORRELATED), key=lambda p: -abs(p[2]))

    @property
    def combinations(self) -> list[tuple[float, dict[str, float]]]:
        """Combinations of parameters, best identified first.

        Each is the relative standard deviation of a product of powers of the parameters, and the powers. Only powers
        above 0.1 are listed.
        """
        size, axes = self._spectrum
        with np.errstate(divide="ignore"):
            return [
                (
                    float(1 / np.sqrt(s)),
                    {n: round(float(p), 2) for n, p in zip(self.names, axis, strict=True) if abs(p) > 0.1},
                )
                for s, axis in zip(size, axes.T, strict=True)
            ]

    @property
    def misfit(self) -> float:
        """Mean square of the residuals over that of the given noise.

        It is 1 for a complete model at the right minimum, and 1 by definition if the noise was estimated.
        """
        return float(np.mean((self.residuals / self.noise) ** 2))

    @property
    def underfits(self) -> bool:
        """Whether the residuals are larger than noise as given would be in one of a thousand cases."""
        free = self.residuals.size - len(self.names)
        return not self.estimated and self.misfit * self.residuals.size > float(stats.chi2.ppf(0.999, free))

    def text(self) -> str:
        """For people: values with their intervals, then what the data do not tell."""
        lines = []
        for name, value, (low, high), d in zip(
            self.names, self.values.tolist(), self.intervals, self.deviations.tolist(), strict=True
        ):
            lines.append(f"{name:32} {value:11.5g}   {low:.4g} to {high:.4g} ({100 * d:.2g} %)")
        if not self.converged:
            lines.append("The fit did not converge: these values are not a result.")
        for name, at in zip(self.names, self.at_bounds, strict=True):
            if at:
                lines.append(f"{name} ended at a bound of its range: the data would move it further; check the range.")
        if self.not_identifiable:
            lines.append(f"Not identifiable from these data: {', '.join(self.not_identifiable)}.")
        lines += [
            f"Identifiable only in combination: {a} and {b} (correlation {r:+.3f})." for a, b, r in self.correlated
        ]
        kind = "estimated from the residuals" if self.estimated else "as given"
        lines.append(f"Noise {kind}: {', '.join(f'{s:.3g}' for s in self.noise.tolist())}.")
        if self.underfits:
            lines.append(
                f"The residuals are larger than the noise (mean square {self.misfit:.3f} of it): the model"
                " underfits, or this is a local minimum (others=... tries more initial values). The intervals do not"
                " account for that."
            )
        if self.inflation > 1.5:
            lines.append(
                f"Residuals are autocorrelated (variances times {self.inflation:.3g}): the model underfits, and the"
                " intervals do not account for that."
            )
        lines += [
            f"{name}: derivatives from differences of two neighboring instances ({why})"
            for name, why in self.by_difference.items()
        ]
        return "\n".join(lines)


def _by_parameter(singular: Array, axes: Array) -> Array:
    """The same axes with signs that follow from the parameters, and directions too for axes of equal length.

    In each subspace the first axis is nearest to the parameter that has the largest part in it, and positive there.
    LAPACK's own choice differs by processor.
    """
    chosen, begin = np.empty_like(axes), 0
    rounding = len(axes) * np.finfo(float).eps * singular[0]
    while begin < len(singular):
        end = begin + int(np.count_nonzero(singular[begin:] >= singular[begin] * (1 - 1e-9) - rounding))
        space = axes[:, begin:end] @ axes[:, begin:end].T
        for k in range(begin, end):
            part = np.diag(space)
            nearest = int(np.argmax(part >= part.max() * (1 - 1e-6)))  # the first of equal ones
            chosen[:, k] = space[:, nearest] / np.sqrt(part[nearest])
            space = space - np.outer(chosen[:, k], chosen[:, k])
        begin = end
    return chosen


def calibrate(
    response: Response,
    measured: npt.ArrayLike,
    parameters: Mapping[str, Range],
    *,
    noise: npt.ArrayLike | None = None,
    others: int = 0,
    seed: int = 0,
) -> Calibration:
    """Fit parameters to a measured response, and look at what it tells of them.

    Args:
        response: values by name -> (samples, outputs) or (samples,).
        measured: of the same shape.
        parameters: first value, lowest and highest of each, all positive.
        noise: standard deviation of each output, or one for all; None: outputs count by their own size, and the noise
            is estimated from the residuals.
        others: further first values, at random within the ranges; the best fit counts.
        seed: of these.

    Raises:
        CalibrationError: ranges upside down or not positive, data of another shape or not finite, a parameter that is
            none, fewer data than parameters.
    """
    names = list(parameters)
    start, low, high = _ranges(parameters)
    data = np.atleast_2d(np.asarray(measured, dtype=float).T).T
    finite("the measured response", data, sampled=True, error=CalibrationError)
    if data.size <= len(names):
        raise CalibrationError(f"{data.size} measured values for {len(names)} parameters")
    scale = _scale(data) if noise is None else np.broadcast_to(np.asarray(noise, dtype=float), data.shape[1:]).copy()
    if not (scale > 0).all():
        raise CalibrationError(f"the noise is {noise!r}; give positive standard deviations")

    def of_response(shown: npt.ArrayLike) -> Array:
        found = np.asarray(shown, dtype=float)
        if np.atleast_2d(found.T).T.shape != data.shape:
            raise CalibrationError(f"the response has shape {found.shape}, what was measured {np.shape(measured)}")
        found = found.reshape(data.shape)
        finite("the response", found, sampled=True, error=CalibrationError)
        return ((found - data) / scale).ravel()

    def within(logs: Array) -> Array:
        return np.clip(np.exp(logs), low, high)  # rounding leads beyond bounds, which may be those of variables

    def at(logs: Array) -> dict[str, float]:
        return dict(zip(names, within(logs).tolist(), strict=True))

    def residuals(logs: Array) -> Array:
        return of_response(response(at(logs)))

    def with_jacobian(logs: Array) -> tuple[Array, Array]:
        shown, slopes = response.with_slopes(at(logs))  # type: ignore[attr-defined]
        return of_response(shown), (slopes * np.exp(logs) / scale[:, None]).reshape(data.size, -1)

    def differences(logs: Array, step: float) -> Array:
        pairs = []
        for i in range(len(logs)):
            a, b = logs.copy(), logs.copy()
            a[i], b[i] = min(logs[i] + step, math.log(high[i])), max(logs[i] - step, math.log(low[i]))
            pairs += [a, b]
        values = [at(p) for p in pairs]
        shown = response.together(values) if isinstance(response, SystemResponse) else [response(v) for v in values]
        found = [of_response(y) for y in shown]
        width = [a[i] - b[i] for i, (a, b) in enumerate(zip(pairs[::2], pairs[1::2], strict=True))]
        return np.column_stack([(a - b) / w for a, b, w in zip(found[::2], found[1::2], width, strict=True)])

    exact = isinstance(response, SystemResponse) and response.gradient
    bounds = np.log(low), np.log(high)
    random = np.random.default_rng(seed)
    begins = [np.log(start), *(random.uniform(*bounds) for _ in range(others))]

    def fit(logs: Array) -> Minimum:
        if exact:
            return minimize_squares(residuals, with_jacobian, logs, *bounds)
        for step in STEPS:
            found = optimize.least_squares(
                residuals, logs, jac=partial(differences, step=step), bounds=bounds, x_scale="jac", xtol=1e-10
            )
            logs = found.x
        return Minimum(found.x, found.fun, found.jac, found.status > 0)

    best = min((fit(b) for b in begins), key=lambda f: float(f.residuals @ f.residuals))
    left = (-best.residuals.reshape(data.shape)) * scale
    final, sigma = best.jacobian if exact else differences(best.x, STEPS[-1]), scale
    if noise is None:
        free = max(1, len(data) - len(names) / data.shape[1])
        sigma = np.maximum(np.sqrt((left**2).sum(axis=0) / free), 1e-12 * scale)
        final = (final.reshape(*data.shape, -1) * (scale / sigma)[:, None]).reshape(data.size, -1)
    return Calibration(
        names,
        within(best.x),
        list(zip(low.tolist(), high.tolist(), strict=True)),
        left,
        final,
        sigma,
        noise is None,
        _inflation(left) if noise is None else 1.0,
        bool(best.converged),
        response.by_difference if isinstance(response, SystemResponse) else {},
    )


def _ranges(parameters: Mapping[str, Range]) -> tuple[Array, Array, Array]:
    if not parameters:
        raise CalibrationError("no parameter to calibrate")
    for name, given in parameters.items():
        try:
            start, low, high = (float(v) for v in given)
        except (TypeError, ValueError):
            raise CalibrationError(f"the range of {name} is {given!r}; give (initial, lowest, highest)") from None
        if not 0 < low < start < high < math.inf:
            raise CalibrationError(
                f"{name} starts at {start:g} in the range {low:g} to {high:g}; give positive numbers, the initial"
                " one between the others"
            )
    columns = np.array([tuple(map(float, v)) for v in parameters.values()])
    return columns[:, 0], columns[:, 1], columns[:, 2]


def _scale(data: Array) -> Array:
    """Size of each output, so that none counts more for its unit."""
    size = data.std(axis=0)
    return np.where(size > 0, size, np.maximum(np.abs(data).max(axis=0), 1.0))


def _inflation(residuals: Array) -> float:
    """Factor (1 + r) / (1 - r) on variances for a correlation r of residuals between samples, of the worst output."""
    found = 1.0
    for column in _columns(residuals):
        power = float(column @ column)
        if power > 0:
            r = min(0.999, max(0.0, float(column[1:] @ column[:-1]) / power))
            found = max(found, (1 + r) / (1 - r))
    return found


def _columns(table: Array) -> Iterable[Array]:
    return (c - c.mean() for c in table.T)
