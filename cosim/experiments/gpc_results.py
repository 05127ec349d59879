"""Numbers read off the rows of a study of paper 000: improvements, ratios at equal response, spreads over seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

from cosim import metrics
from cosim.experiments.gpc import R_PUBLISHED
from cosim.experiments.gpc_study import WEIGHTS, Row, Study
from cosim.report import Distribution

NAN = float("nan")


def select(rows: Iterable[Row], **where: Any) -> list[Row]:
    """Rows whose fields equal the given values."""
    return [r for r in rows if all(r[k] == v for k, v in where.items())]


def one(rows: Iterable[Row], **where: Any) -> Row:
    """The single row with these values; LookupError otherwise."""
    found = select(rows, **where)
    if len(found) != 1:
        raise LookupError(f"{len(found)} rows with {where}")
    return found[0]


class Results:
    """A study by road, speed, law and seed."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.seeds = study.seeds
        self.speeds = study.speeds
        self._passive = {(r["road"], r["speed_kmh"]): r for r in study.comparison if r["controller"] == "passive"}
        self._matched = self._by_law(study.comparison)
        # Explicit is not matched to anything: it has R = 1e-7 in the comparison.
        self._published = self._by_law([*select(study.comparison, controller="explicit"), *study.unmatched])
        self._sweep = {(r["speed_kmh"], r["R"], r["seed"]): r for r in study.sweep}

    @staticmethod
    def _by_law(rows: Iterable[Row]) -> dict[tuple[str, float, str, int], Row]:
        return {
            (r["road"], r["speed_kmh"], r["controller"], r["seed"]): r for r in rows if r["controller"] != "passive"
        }

    # ------------------------------------------------------------------ rows

    def passive(self, road: str, speed: float) -> Row:
        """The passive car's run; LookupError if it is not there."""
        return self._passive[road, speed]

    def matched(self, road: str, speed: float, law: str, seed: int) -> Row | None:
        """The law at the weight at which its response equals explicit's; None where there is no such weight."""
        row = self._matched[road, speed, law, seed]
        return None if row["diverged"] or not row.get("matched", True) else row

    def published(self, road: str, speed: float, law: str, seed: int) -> Row:
        """The law at R = 1e-7."""
        return self._published[road, speed, law, seed]

    def swept(self, weight: float, speed: float, seed: int) -> Row:
        """Preview on the sine road with a weight of figure 6."""
        return self._sweep[speed, weight, seed]

    # ------------------------------------------------------------------ one run

    def improvement(self, row: Row) -> float:
        """Response improvement (23) of a run; -inf where it diverged."""
        if row["diverged"]:
            return -math.inf
        return metrics.improvement(row["response"], self.passive(row["road"], row["speed_kmh"])["response"])

    def figures(self, row: Row) -> dict[str, float]:
        """Metrics of a run in the units of the figures, NaN where it diverged."""
        if row["diverged"]:
            return dict.fromkeys(("response", "improvement", "force", "power", "per_force", "per_power"), NAN)
        gain, force, power = self.improvement(row), row["force"] / 1e3, row["power"] / 1e3
        return {
            "response": row["response"],
            "improvement": gain,
            "force": force,
            "power": row["power"],
            "per_force": metrics.force_normalised_effectiveness(gain, force) if force else NAN,
            "per_power": metrics.power_normalised_effectiveness(gain, power) if power else NAN,
        }

    # ------------------------------------------------------------------ over seeds

    def improvements(self, road: str, speed: float, law: str) -> Distribution:
        """Improvement of a law at R = 1e-7 [%], -inf where it diverged."""
        return Distribution(100 * self.improvement(self.published(road, speed, law, s)) for s in self.seeds)

    def at_equal_response(
        self, road: str, speed: float, laws: Iterable[str], value: Callable[..., float]
    ) -> Distribution | None:
        """``value(row of each law ...)`` over the seeds in which all these laws have explicit's response; None without any."""
        laws = tuple(laws)
        found = []
        for seed in self.seeds:
            rows = [self.matched(road, speed, law, seed) for law in laws]
            if all(row is not None for row in rows):
                found.append(value(*rows))
        of = "seeds" if len(found) == len(self.seeds) else f"seeds of {len(self.seeds)} that could be matched"
        return Distribution(found, of) if found else None

    def ratios(self, road: str, speed: float, quantity: str, law: str, to: str) -> Distribution | None:
        """A metric of one law over that of another at equal response."""
        return self.at_equal_response(road, speed, (law, to), lambda a, b: a[quantity] / b[quantity])

    def changes(self, road: str, speed: float, quantity: str, law: str) -> Distribution | None:
        """Change of a metric against the passive car [%], at explicit's response."""
        base = self.passive(road, speed)[quantity]
        return self.at_equal_response(road, speed, (law,), lambda row: 100 * (row[quantity] / base - 1))

    def matched_seeds(self, road: str, speed: float, law: str) -> int:
        """In how many seeds a weight gives the law explicit's response."""
        return sum(self.matched(road, speed, law, s) is not None for s in self.seeds)

    def over_weights(self, speed: float, quantity: str, seed: int) -> list[float]:
        """A quantity of :meth:`figures` of preview on the sine road, the smallest weight first."""
        return [self.figures(self.swept(w, speed, seed))[quantity] for w in sorted(WEIGHTS)]

    # ------------------------------------------------------------------ single numbers

    def open_loop(self) -> dict[float, float]:
        """Response of the passive car on the sine road by speed [km/h], finer about the peak."""
        rows = [*select(self._passive.values(), road="sine"), *self.study.open_loop]
        return {r["speed_kmh"]: r["response"] for r in sorted(rows, key=lambda r: r["speed_kmh"])}

    def open_loop_peak(self) -> float:
        """Speed of the largest of :meth:`open_loop` [km/h]."""
        responses = self.open_loop()
        return max(responses, key=responses.__getitem__)

    def worst_speed(self, road: str) -> float:
        """Speed of the study with the largest open-loop response [km/h]."""
        return max(self.speeds, key=lambda v: self.passive(road, v)["response"])

    def refinement(self) -> list[tuple[Row, dict[str, float]]]:
        """Refined runs, each with the relative changes of its metrics against the run as it is; NaN where one diverged."""
        found = []
        for row in self.study.refinement:
            if row["refinement"] != "as run":
                same = {k: row[k] for k in ("road", "speed_kmh", "controller", "seed")}
                found.append((row, _moves(row, one(self.study.refinement, refinement="as run", **same))))
        return found

    def largest_move(self) -> float:
        """Largest relative change of a metric when steps are halved; inf where a run diverges."""
        moves = [abs(x) for _, changed in self.refinement() for x in changed.values()]
        return max((math.inf if math.isnan(x) else x for x in moves), default=math.inf)

    def largest_force(self) -> float:
        """Largest force of an actuator at R = 1e-7 on any road [N]."""
        rows = [*self._published.values(), *(r for r in self.study.sweep if r["R"] == R_PUBLISHED)]
        return max((r["peak_force"] for r in rows if not r["diverged"]), default=NAN)

    def diverged(self) -> int:
        """Number of diverged runs with R of at least 1e-7."""
        return sum(bool(r["diverged"]) for r in self.study.rows if r["R"] >= R_PUBLISHED)


METRICS = ("response", "force", "power", "peak_force", "rms_az", "rms_pitch")  # whose convergence is looked at


def _moves(row: Row, as_run: Row) -> dict[str, float]:
    if row["diverged"] or as_run["diverged"]:
        return dict.fromkeys(METRICS, NAN)
    return {k: row[k] / as_run[k] - 1 for k in METRICS if as_run[k]}
