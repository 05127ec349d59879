"""Optimization along derivatives: L-BFGS-B within limits, SLSQP where other numbers have bounds, fronts by weights.

    with PointSlopes(sweep, fmus) as evaluate:
        found = descend(evaluate, {"car.damping": (3e3, 24e3)}, {"comfort": "min"}, trials=20)

Each trial gives the objectives and their derivatives. A search ends at the nearest minimum of a smooth function;
`cosim.study.optimise.optimise` searches without derivatives, and over integers and texts.

A trial that fails, or whose numbers are not finite, halves the step: SciPy gets value and slopes of a parabola along
the step that begins with those of the last iterate and has its minimum halfway. With infinity it would end.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import optimize

from build_fmus.base.checks import short, unknown, whole_number
from cosim.core.errors import CosimError
from cosim.core.signals import Array
from cosim.study.optimise import Limits, OptimisationError, Outcome, Trial, Values, check_search
from cosim.study.slopes import Slopes

DIVISIONS = {1: 1, 2: 6, 3: 3}  # of a weight from 0 to 1 along a front, by number of objectives
SMALL = 1e-3  # weight of the other objectives where one alone is minimized, so that they do not drift
MET = 1e-6  # of a bound, relative, by which a number may miss it
TOLERANCE = {"L-BFGS-B": {"ftol": 1e-6, "gtol": 1e-4}, "SLSQP": {"ftol": 1e-6}}  # of scaled objectives


Point = tuple[Array, Array, Array, Array]  # objectives (m,), their slopes (m, n), bounds' margin (k,), its slopes


class _SpentError(Exception):
    """The trials of this search are used up."""


def descend(
    evaluate: Callable[[Values], Slopes],
    space: Mapping[str, Limits],
    objectives: Mapping[str, str],
    *,
    trials: int,
    first: Values | None = None,
    at_most: Mapping[str, float] | None = None,
    at_least: Mapping[str, float] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Outcome:
    """Follow derivatives to values that make the objectives small (or large).

    Args:
        evaluate: numbers and their derivatives for values by name, in the order of `space`.
        space: see `cosim.study.optimise.Limits`; ranges of real numbers.
        objectives: "min" or "max" by name of the number. Of several, each is optimized first, then weighted sums
            between these ends: points of the Pareto front where it is convex.
        trials: at most, in all.
        first: where the search begins; None: the middle of the limits.
        at_most: upper bounds of numbers, by name. Trials that miss one count as failed.
        at_least: lower bounds, likewise.
        progress: called with (done, total).

    Raises:
        OptimisationError: limits, objectives or names that do not fit; a number of the first trial is not finite.
        CosimError: the first trial fails.
    """
    bounds = [*((n, b, 1.0) for n, b in (at_most or {}).items()), *((n, b, -1.0) for n, b in (at_least or {}).items())]
    check_search(space, objectives, evaluate, [] if first is None else [first])
    for name, limits in space.items():
        if isinstance(limits[0], str) or (isinstance(limits[0], int) and isinstance(limits[1], int)):
            raise OptimisationError(f"{name} has no derivative along {limits!r}: give a range of real numbers")
    for name, b in (at_least or {}).items():
        if at_most and b > at_most.get(name, b):
            raise OptimisationError(f"{name} cannot be at most {short(at_most[name])} and at least {short(b)}")
    whole_number("trials", trials, error=OptimisationError)
    search = _Search(evaluate, space, objectives, bounds, trials, progress)
    begin = np.full(len(space), 0.5) if first is None else search.place(first)
    search.trial(begin)
    weights = list(_weights(len(objectives)))
    for k, weight in enumerate(weights):
        search.descend(weight, max(1, (trials - len(search.trials)) // (len(weights) - k)))
    progress(trials, trials)
    return Outcome(search.trials, dict(objectives))


def _weights(count: int) -> Iterator[Array]:
    """Each objective alone, then sums between."""
    yield from np.where(np.eye(count, dtype=bool), 1.0 - SMALL * (count > 1), SMALL)
    divisions = DIVISIONS.get(count, 2)
    for shares in itertools.product(range(divisions + 1), repeat=count):
        if sum(shares) == divisions and max(shares) < divisions:
            yield np.array(shares) / divisions + SMALL


@dataclass
class _Search:
    evaluate: Callable[[Values], Slopes]
    space: Mapping[str, Limits]
    objectives: Mapping[str, str]
    bounds: Sequence[tuple[str, float, float]]
    most: int
    progress: Callable[[int, int], None]
    trials: list[Trial] = field(default_factory=list)
    _seen: dict[bytes, Point | None] = field(default_factory=dict)
    _until: int = 0

    def values(self, u: Array) -> dict[str, float]:
        """Values at a place in the unit cube."""
        found = {}
        for x, (name, (low, high, *log)) in zip(u.tolist(), self.space.items(), strict=True):
            a, b = float(low), float(high)
            found[name] = min(b, max(a, a * (b / a) ** x if log else a + x * (b - a)))
        return found

    def place(self, values: Values) -> Array:
        """The place of values in the unit cube."""
        found = []
        for name, (low, high, *log) in self.space.items():
            if not float(low) <= float(values[name]) <= float(high):
                raise OptimisationError(f"{name} begins at {values[name]}, outside of {low} to {high}")
            a, b, x = (math.log(float(v)) if log else float(v) for v in (low, high, values[name]))
            found.append((x - a) / (b - a))
        return np.array(found)

    def trial(self, u: Array) -> Point | None:
        """Numbers at a place; None: it failed."""
        key = u.tobytes()
        if key in self._seen:
            return self._seen[key]
        if len(self.trials) >= self._until > 0:
            raise _SpentError
        self.progress(len(self.trials), self.most)
        values = self.values(u)
        try:
            found = self.evaluate(values)
        except CosimError as error:
            if not self.trials:
                raise
            self._failed(key, values, str(error))
            return None
        for name in (*self.objectives, *(n for n, *_ in self.bounds)):
            if name not in found.row:
                raise OptimisationError(unknown("number", name, found.row))
            if not (math.isfinite(found.row[name]) and np.isfinite(found.slopes[name]).all()):
                why = f"{name} is {found.row[name]:.6g} and has no derivative"
                if not self.trials:
                    raise OptimisationError(f"{why} at {values}, where the search begins")
                self._failed(key, values, why)
                return None
        per = np.array(
            [  # values by place
                values[n] * math.log(float(limits[1]) / float(limits[0])) if len(limits) == 3 else limits[1] - limits[0]  # type: ignore[operator]
                for n, limits in self.space.items()
            ]
        )
        signs = [-1.0 if d == "max" else 1.0 for d in self.objectives.values()]
        numbers = list(zip(self.objectives, signs, strict=True))
        f = np.array([s * found.row[n] for n, s in numbers])
        slopes = np.array([s * found.slopes[n] * per for n, s in numbers])
        size = [abs(b) or 1.0 for _, b, _ in self.bounds]
        rows = list(zip(self.bounds, size, strict=True))
        margin = np.array([s * (b - found.row[n]) / z for (n, b, s), z in rows])
        margin_slopes = np.array([-s * found.slopes[n] * per / z for (n, _, s), z in rows]).reshape(len(rows), len(per))
        missed = [
            f"{n} is {found.row[n]:.6g}, {'above' if sign > 0 else 'below'} {b:g}"
            for (n, b, sign), r in zip(self.bounds, margin, strict=True)
            if r < -MET
        ]
        self.trials.append(Trial(len(self.trials), values, dict(found.row), "; ".join(missed)))
        self._seen[key] = f, slopes, margin, margin_slopes
        return self._seen[key]

    def _failed(self, key: bytes, values: Values, why: str) -> None:
        self.trials.append(Trial(len(self.trials), values, {}, why))
        self._seen[key] = None

    def descend(self, weight: Array, most: int) -> None:
        """From the best trial for a weighted sum to its minimum, in at most so many trials."""
        known = [(np.frombuffer(k), *s[:3]) for k, s in self._seen.items() if s is not None]
        values = np.array([f for _, f, _, _ in known])
        size = np.ptp(values, axis=0)
        size = np.where(size > 0, size, np.where(values[0] != 0, np.abs(values[0]), 1.0))
        share = weight / size
        penalty = np.array([np.maximum(-margin, 0.0).sum() for *_, margin in known])
        begin = known[int(np.argmin(values @ share + 1e3 * penalty))][0]
        self._until = len(self.trials) + most
        first = self._seen[begin.tobytes()]
        assert first is not None
        iterate = first  # where the present step begins

        def at(u: Array) -> Point:
            f, slopes, margin, margin_slopes = iterate
            return self.trial(np.clip(u, 0.0, 1.0)) or (f, -slopes, margin, margin_slopes)

        def total(u: Array) -> tuple[float, Array]:
            nonlocal iterate
            found = at(u)
            if not self.bounds and (found[0] - iterate[0]) @ share < 0.0:  # L-BFGS-B: the best of its line search
                iterate = found
            return float(found[0] @ share), share @ found[1]

        def margin(u: Array) -> Array:
            return at(u)[2]

        def margin_slopes(u: Array) -> Array:
            nonlocal iterate
            iterate = self.trial(np.clip(u, 0.0, 1.0)) or iterate  # SLSQP: only iterates are asked for these
            return iterate[3]

        method = "SLSQP" if self.bounds else "L-BFGS-B"
        with contextlib.suppress(_SpentError):
            optimize.minimize(
                total,
                begin,
                jac=True,
                method=method,
                bounds=[(0.0, 1.0)] * len(begin),
                constraints=[{"type": "ineq", "fun": margin, "jac": margin_slopes}] if self.bounds else (),
                options=TOLERANCE[method],
            )
