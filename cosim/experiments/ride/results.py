"""What the searches of a study found, by car, controller and course."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import Any

from cosim.experiments.hmmwv.statements import NAMES as HMMWV_NAMES
from cosim.experiments.ride.runs import CARS, NUMBER, CarSystem, Case
from cosim.experiments.ride.search import LIMITS, SpeedLimit
from cosim.experiments.semi_active.published import NAMES as DAMPER_NAMES
from cosim.study import Results, Row

NAMES = {
    **DAMPER_NAMES,
    **HMMWV_NAMES,
    "lqr-kilonewton": "LQR, weight in kN",
    **{
        f"{weights}-{mode}": text.format(weights.replace("-", " "))
        for weights in ("comfort", "road-holding")
        for mode, text in (("active", "LQ {}"), ("delay", "LQ {}, rear wheels preview"), ("preview", "preview LQ {}"))
    },
    "implicit": "GPC implicit",
    "explicit": "GPC explicit",
    "preview": "GPC with preview",
}
CAR_NAMES = {
    "hmmwv": "HMMWV (001)",
    "sedan": "sedan (004)",
    "6x6": "6x6 (003)",
    "full-car": "full car (000)",
    "public": "full car, public model",
    "hmmwv-dampers": "HMMWV, semi-active",
}
WORDS = {"never": "never", "always": "at any speed"}


def name(system: CarSystem) -> str:
    """Controller and actuators for people: "MPC, hydraulic"."""
    _, controller, actuators = system
    if system == ("hmmwv", "zero", "ideal"):
        return "no actuators"
    return NAMES[controller] + (", hydraulic" if actuators == "hydraulic" else "")


@dataclass(frozen=True)
class Speeds:
    """Speeds [km/h] at which a limit was reached, of the seeds that reach it; `why`: what was found of each seed."""

    found: tuple[float, ...]
    why: tuple[str, ...]

    @property
    def median(self) -> float | None:
        """Of the seeds; None unless most of them reach the limit."""
        return median(self.found) if 2 * len(self.found) > len(self.why) else None

    @property
    def words(self) -> str:
        """The speed in words, "13.2 (12.6 to 13.5)", with the number of profiles outside.

        These never reached the limit, or were always above it; if all are so, the text says only that.
        """
        if self.median is None:
            return next(WORDS[w] for w in self.why if w != "found")
        if len(self.why) == 1:
            return f"{self.median:.1f}"
        others = [f"; {self.why.count(w)} {words}" for w, words in WORDS.items() if w in self.why]
        return f"{self.median:.1f} ({min(self.found):.1f} to {max(self.found):.1f}{''.join(others)})"


@dataclass(frozen=True)
class Driven:
    """A search of a study. Reading the result of a failed search raises `RunFailed`."""

    search: SpeedLimit
    results: Results

    @property
    def case(self) -> Case:
        """What was driven, at any speed."""
        return self.search.case

    @property
    def words(self) -> str:
        """Car, controller and actuators."""
        return f"{CAR_NAMES[self.case.car]}, {name(self.case.system)}"

    @property
    def found(self) -> Row:
        """See `SpeedLimit`."""
        found: Row = self.results.found(self.search)
        return found

    def speeds(self, metric: str) -> Speeds:
        """Where the limit of a metric is reached."""
        speeds = (v for v in self.found["speeds"][metric] if v is not None)
        return Speeds(tuple(speeds), tuple(self.found["why"][metric]))

    def runs(self, seed: int = 1) -> list[Row]:
        """Rows of the runs of one seed that came to the end of the course, by rising speed."""
        return [r for r in self.found["runs"] if r["seed"] == seed and r["arrived"]]

    def nearest(self, metric: str) -> Row | None:
        """The run whose metric is nearest to its limit; None where no run came to the end."""
        return min(self.runs(), key=lambda r: abs(r[metric] / LIMITS[metric] - 1), default=None)


class Searches:
    """The searches of a study, in the order of its plan.

    Attributes:
        every: all of them, by case.
        cars: that were driven.
        file: the course file that was driven; empty for the synthetic courses.
    """

    def __init__(self, results: Results) -> None:
        self.results = results
        self.every = {t.case: Driven(t, results) for t in results.tasks if isinstance(t, SpeedLimit)}
        self.cars = [c for c in CARS if any(case.car == c for case in self.every)]
        self.file = next((case.course for case in self.every if case.course not in NUMBER), "")

    def on(self, **fields: Any) -> list[Driven]:
        """Searches whose case has these values."""
        return [d for case, d in self.every.items() if all(getattr(case, k) == v for k, v in fields.items())]

    def known(self, **fields: Any) -> list[Driven]:
        """Those of them that did not fail."""
        return [d for d in self.on(**fields) if d.search.label not in d.results.failures]

    def systems(self, car: str) -> list[CarSystem]:
        """Car, controller and actuators of all that was driven of a car."""
        return list(dict.fromkeys(d.case.system for d in self.on(car=car)))
