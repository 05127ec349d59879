"""Numbers read off a study of paper 000: improvements, ratios at equal response, spreads over seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from typing import Any

from cosim.experiments.gpc import published
from cosim.experiments.gpc.published import HISTORIES, REFINEMENTS, WEIGHTS, Comparison, History
from cosim.experiments.gpc.runs import CONTROLLERS, R_PUBLISHED, ROADS, Case
from cosim.experiments.metrics import response as metrics
from cosim.study import Distribution, Row, RunFailed
from cosim.study import Results as Runs
from cosim.study.case import values


def select(rows: Iterable[Row], **where: Any) -> list[Row]:
    """Rows whose fields equal the given values."""
    return [r for r in rows if all(r[k] == v for k, v in where.items())]


class Results:
    """A study by road, speed, controller and seed. Reading a run that is not there raises RunFailed.

    The excitation of the identification is random, so the results of a controller exist once per seed.

    Attributes:
        seeds: of the identifications.
        speeds: of the study [km/h]; on the curb there is also CURB_SPEED.
        failures: messages of failed runs by label.
        sweep: rows of preview on the sine road over weights (figure 6): fields of a case, its metrics, and what a
            search adds. A run that failed has none.
        comparison: all controllers and roads, J matched to explicit (7, 9, 11).
        unmatched: the matched controllers at R = 1e-7 instead.
        open_loop: passive car on the sine road, finer speeds.
        refinement: solver step and exchange halved, first seed.
        histories: time histories, first seed (8, 10, 12).
    """

    def __init__(self, runs: Runs) -> None:
        planned = [t for t in runs.tasks if isinstance(t, Comparison)]
        self.seeds = tuple(dict.fromkeys(s.seed for s in planned))
        self.speeds = tuple(dict.fromkeys(s.speed_kmh for s in planned if s.road == "sine"))
        self.failures, ran = runs.failures, set(runs.ran)

        def found(kind: type[Comparison | History]) -> list[Any]:
            return [runs.found(t) for t in runs.tasks if isinstance(t, kind) and t.label not in self.failures]

        def rows(cases: Iterable[Case], more: Iterable[Row] = ()) -> list[Row]:
            return sorted([*more, *({**values(c), **runs[c]} for c in cases if c in ran)], key=_order)

        compared = found(Comparison)
        passive = (Case(road, v, "passive") for road in ROADS for v in published.on(road, self.speeds))
        refined = [published.refinements(*at, s).values() for s in self.seeds[:1] for at in HISTORIES]
        self.sweep = rows(published.swept(v, w, s) for v, s, w in product(self.speeds, self.seeds, WEIGHTS))
        self.comparison = rows(passive, (r for c in compared for r in c["compared"]))
        self.unmatched = rows((), (r for c in compared for r in c["unmatched"]))
        self.open_loop = rows(Case("sine", v, "passive") for v in published.OPEN_LOOP_SPEEDS_KMH)
        self.refinement = rows(c for cases in refined for c in cases)
        self.histories = rows((), (r for h in found(History) for r in h))
        self._passive = {(r["road"], r["speed_kmh"]): r for r in select(self.comparison, controller="passive")}
        self._matched = {_key(r): r for r in self.comparison if r["controller"] != "passive"}
        # Explicit is not matched to anything: it has R = 1e-7 in the comparison.
        self._published = {_key(r): r for r in (*select(self.comparison, controller="explicit"), *self.unmatched)}
        self._sweep = {(r["speed_kmh"], r["R"], r["seed"]): r for r in self.sweep}

    @property
    def rows(self) -> list[Row]:
        """All rows that are runs."""
        return [*self.sweep, *self.comparison, *self.unmatched, *self.open_loop, *self.refinement]

    def _row(self, rows: Mapping[Any, Row], key: Any) -> Row:
        if key not in rows:
            first = next(iter(self.failures.items()), ("", "it was not run"))
            raise RunFailed(f"there is no run {key}; {': '.join(filter(None, first))}")
        return rows[key]

    def passive(self, road: str, speed: float) -> Row:
        """The passive car's run."""
        return self._row(self._passive, (road, speed))

    def matched(self, road: str, speed: float, controller: str, seed: int) -> Row | None:
        """The controller at the weight at which its response equals explicit's; None where there is no such weight."""
        row = self._row(self._matched, (road, speed, controller, seed))
        return None if row["diverged"] or not row.get("matched", True) else row

    def published(self, road: str, speed: float, controller: str, seed: int) -> Row:
        """The controller at R = 1e-7."""
        return self._row(self._published, (road, speed, controller, seed))

    def swept(self, weight: float, speed: float, seed: int) -> Row:
        """Preview on the sine road with a weight of figure 6."""
        return self._row(self._sweep, (speed, weight, seed))

    def improvement(self, row: Row) -> float:
        """Response improvement (23) of a run; -inf where it diverged."""
        if row["diverged"]:
            return -math.inf
        return metrics.improvement(row["response"], self.passive(row["road"], row["speed_kmh"])["response"])

    def figures(self, row: Row) -> dict[str, float]:
        """Metrics of a run in the units of the figures, NaN where it diverged."""
        if row["diverged"]:
            return dict.fromkeys(("response", "improvement", "force", "power", "per_force", "per_power"), math.nan)
        gain, force, power = self.improvement(row), row["force"] / 1e3, row["power"] / 1e3
        return {
            "response": row["response"],
            "improvement": gain,
            "force": force,
            "power": row["power"],
            "per_force": metrics.force_normalized_effectiveness(gain, force) if force else math.nan,
            "per_power": metrics.power_normalized_effectiveness(gain, power) if power else math.nan,
        }

    def improvements(self, road: str, speed: float, controller: str) -> Distribution:
        """Improvement of a controller at R = 1e-7 [%], -inf where it diverged."""
        return Distribution(100 * self.improvement(self.published(road, speed, controller, s)) for s in self.seeds)

    def at_equal_response(
        self, road: str, speed: float, controllers: Sequence[str], value: Callable[..., float]
    ) -> Distribution | None:
        """`value(row of each controller ...)` over the seeds in which all these controllers have explicit's response.

        None if there is no such seed.
        """
        by_seed = ([self.matched(road, speed, c, seed) for c in controllers] for seed in self.seeds)
        found = [value(*rows) for rows in by_seed if None not in rows]
        of = "seeds" if len(found) == len(self.seeds) else f"seeds of {len(self.seeds)} that could be matched"
        return Distribution(found, of) if found else None

    def over_weights(self, speed: float, quantity: str, seed: int) -> list[float]:
        """A quantity of `figures` of preview on the sine road, the smallest weight first."""
        return [self.figures(self.swept(w, speed, seed))[quantity] for w in sorted(WEIGHTS)]

    def open_loop_peak(self) -> float:
        """Speed of the largest response of the passive car on the sine road [km/h], the lowest of several."""
        rows = [*select(self._passive.values(), road="sine"), *self.open_loop]
        if not rows:
            raise RunFailed("no run of the passive car on the sine road came to its end")
        return float(min(rows, key=lambda r: (-r["response"], r["speed_kmh"]))["speed_kmh"])

    def worst_speed(self, road: str) -> float:
        """Speed of the study with the largest open-loop response [km/h]."""
        return max(self.speeds, key=lambda v: self.passive(road, v)["response"])

    def moves(self) -> list[tuple[Row, str, dict[str, float]]]:
        """Refined runs in words, with the relative changes of their metrics; NaN where one diverged."""
        rows = {(r["road"], r["speed_kmh"], r["controller"], _words(r)): r for r in self.refinement}
        return [
            (r, words, _moves(r, self._row(rows, (*where, "as run"))))
            for (*where, words), r in rows.items()
            if words != "as run"
        ]

    def largest_move(self) -> float:
        """Largest relative change of a metric when steps are halved; inf where a run diverges."""
        moves = [abs(x) for _, _, changed in self.moves() for x in changed.values()]
        return max((math.inf if math.isnan(x) else x for x in moves), default=math.inf)

    def largest_force(self) -> float:
        """Largest force of an actuator at R = 1e-7 on any road [N]."""
        rows = [*self._published.values(), *(r for r in self.sweep if r["R"] == R_PUBLISHED)]
        forces = [r["peak_force"] for r in rows if not r["diverged"]]
        if not forces:
            raise RunFailed(f"no run at R = {R_PUBLISHED:g} came to its end")
        return max(forces)

    def diverged(self) -> list[Row]:
        """Diverged runs with R of at least 1e-7."""
        return [r for r in self.rows if r["diverged"] and r["R"] >= R_PUBLISHED]


def _key(row: Row) -> tuple[str, float, str, int]:
    return row["road"], row["speed_kmh"], row["controller"], row["seed"]


def _order(row: Row) -> tuple[Any, ...]:
    return row["road"], row["speed_kmh"], list(CONTROLLERS).index(row["controller"]), row["R"], row["seed"]


METRICS = {
    "response": "response",
    "force": "force",
    "power": "power",
    "peak_force": "peak force",
    "rms_az": "r.m.s. acceleration",
    "rms_pitch": "r.m.s. pitch",
}
"""Whose convergence is looked at, in words."""


def _words(row: Row) -> str:
    steps = {k: row[k] for k in ("solver_parts", "exchange_parts")}
    return next(words for words, finer in REFINEMENTS.items() if steps == {**dict.fromkeys(steps, 1), **finer})


def _moves(row: Row, as_run: Row) -> dict[str, float]:
    if row["diverged"] or as_run["diverged"]:
        return dict.fromkeys(METRICS, math.nan)
    return {k: row[k] / as_run[k] - 1 for k in METRICS if as_run[k]}
