"""What the searches of a study found, by car, controller and course."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import Any

from cosim.experiments.ride.published import System
from cosim.experiments.ride.search import LIMITS, SpeedLimit
from cosim.study import Results, Row

NAMES = {
    "passive": "passive",
    "zero": "zero force",
    "skyhook": "skyhook",
    "skyhook-on-off": "skyhook, on-off",
    "groundhook": "groundhook",
    "add": "ADD",
    "sh-add": "SH-ADD",
    "lqr": "LQR",
    "lqr-kilonewton": "LQR, weight in kN",
    "mpc": "MPC",
    "mpc-preview": "MPC with preview",
    "comfort-active": "LQ comfort",
    "comfort-delay": "LQ comfort, rear wheels preview",
    "comfort-preview": "preview LQ comfort",
    "road-holding-active": "LQ road holding",
    "road-holding-delay": "LQ road holding, rear wheels preview",
    "road-holding-preview": "preview LQ road holding",
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


def name(system: System) -> str:
    """Controller and actuators for people: "MPC, hydraulic"."""
    car, controller, actuators = system
    if (car, controller, actuators) == ("hmmwv", "zero", "ideal"):
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


def speeds(study: Results, search: SpeedLimit, metric: str) -> Speeds:
    """Of a search that did not fail.

    Raises:
        RunFailed: it did.
    """
    found: Row = study.found(search)
    return Speeds(tuple(v for v in found["speeds"][metric] if v is not None), tuple(found["why"][metric]))


def runs(study: Results, search: SpeedLimit, seed: int = 1) -> list[Row]:
    """Rows of the runs of one seed that came to the end of the course, by rising speed."""
    found: list[Row] = study.found(search)["runs"]
    return [r for r in found if r["seed"] == seed and r["arrived"]]


def nearest(study: Results, search: SpeedLimit, metric: str) -> Row | None:
    """The run whose metric is nearest to its limit; None where no run came to the end."""
    rows = runs(study, search)
    return min(rows, key=lambda r: abs(r[metric] / LIMITS[metric] - 1)) if rows else None


def ran(study: Results) -> list[SpeedLimit]:
    """The searches of a study, in the order of its plan."""
    return [t for t in study.tasks if isinstance(t, SpeedLimit)]


def system_of(search: SpeedLimit) -> System:
    """Car, controller, actuators."""
    return search.case.car, search.case.controller, search.case.actuators


def on(study: Results, **fields: Any) -> list[SpeedLimit]:
    """Searches whose case has these values."""
    return [s for s in ran(study) if all(getattr(s.case, k) == v for k, v in fields.items())]
