"""The runs behind figures 6 to 12 of paper 000 and its claims."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from cosim.experiments.gpc.matching import match_weight
from cosim.experiments.gpc.runs import CONTROLLERS, ROADS, Assumed, Case, assume, structure
from cosim.study.case import values
from cosim.study.experiment import Row, Search, Task

SPEEDS_KMH = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)
SEEDS = tuple(range(8))
WEIGHTS = (1e-7, 5e-7, 1e-6, 5e-6)  # figure 6
OPEN_LOOP_SPEEDS_KMH = (42.5, 45.0, 47.5, 52.5, 55.0, 57.5)  # about the peak, besides SPEEDS_KMH
SINE_SPEED, CURB_SPEED, PERRYMAN_SPEED = 50.0, 72.0, 50.0  # km/h
HISTORIES = (("sine", SINE_SPEED), ("perryman3", PERRYMAN_SPEED), ("curb", CURB_SPEED))  # figures 8, 10, 12
ACTIVE_CONTROLLERS = tuple(c for c in CONTROLLERS if c != "passive")
MATCHED = ("implicit", "preview")  # controllers whose weight is chosen so that their response equals explicit's
REFINEMENTS: dict[str, dict[str, Any]] = {  # words -> fields of a case
    "as run": {},
    "solver step halved": {"solver_parts": 2},
    "exchange halved": {"exchange_parts": 2},
    "both halved": {"solver_parts": 2, "exchange_parts": 2},
}


def plan(seeds: Sequence[int] = SEEDS, speeds: Sequence[float] = SPEEDS_KMH) -> list[Task | Search]:
    """The whole study, or that of fewer seeds and speeds; on the curb also `CURB_SPEED`."""
    histories = [History(road, v, seeds[0]) for road, v in HISTORIES]
    refined = [c for road, v in HISTORIES for c in refinements(road, v, seeds[0]).values()]
    return [*searches(seeds, speeds), *histories, *tasks([*cases(seeds, speeds), *refined])]


def searches(seeds: Sequence[int], speeds: Sequence[float]) -> list[Comparison]:
    """Comparisons of the controllers on every road at every speed, with every identification seed."""
    return [Comparison(road, v, seed) for road in ROADS for v in on(road, speeds) for seed in seeds]


def cases(seeds: Sequence[int], speeds: Sequence[float]) -> list[Case]:
    """What the claims need besides: the passive car, and preview over the weights."""
    found = [Case(road, v, "passive") for road in ROADS for v in on(road, speeds)]
    found += [swept(v, w, seed) for v in speeds for seed in seeds for w in WEIGHTS]
    return found + [Case("sine", v, "passive") for v in OPEN_LOOP_SPEEDS_KMH]


def tasks(cases: Iterable[Case]) -> list[Task]:
    """A task for every case, once."""
    return [Task(c, cost=_seconds(c.speed_kmh)) for c in dict.fromkeys(cases)]


def on(road: str, speeds: Sequence[float]) -> tuple[float, ...]:
    """Speeds on a road [km/h]."""
    return (*speeds, CURB_SPEED) if road == "curb" else tuple(speeds)


def _seconds(speed: float) -> float:
    """Rough simulated time of a run [s]."""
    return 540 / speed


def swept(speed: float, weight: float, seed: int) -> Case:
    """Preview on the sine road with a weight of figure 6."""
    return Case("sine", speed, "preview", R=weight, seed=seed)


def refinements(road: str, speed: float, seed: int) -> dict[tuple[str, str], Case]:
    """Runs with halved steps: (controller, words of `REFINEMENTS`) -> case."""
    return {
        (c, words): Case(road, speed, c, seed=seed, **finer)
        for c in CONTROLLERS
        for words, finer in REFINEMENTS.items()
    }


@dataclass(frozen=True)
class Comparison:
    """The controllers at one speed on one road from one identification: explicit, then the others matched to it.

    Finds `compared`, rows of the three controllers (the others at the weights that give explicit's response), and
    `unmatched`, the others at R = 1e-7. If explicit does not lower the response, there is nothing to match: the row is
    that at R = 1e-7, and not matched.
    """

    road: str
    speed_kmh: float
    seed: int
    assumed: Assumed = ()

    @property
    def label(self) -> str:
        """For people."""
        assumed = "".join(f"-{name.replace('_', '-')}-{value}" for name, value in self.assumed)
        return f"comparison-{self.road}-{self.speed_kmh:g}kmh-seed{self.seed}{assumed}"

    @property
    def cost(self) -> float:
        """Rough time."""
        return 8 * _seconds(self.speed_kmh)

    @property
    def beside(self) -> tuple[Any, ...]:
        """Comparisons whose systems are the same, and whose runs last as long."""
        return *structure(self.case("preview")), self.speed_kmh

    def case(self, controller: str) -> Case:
        """The case of a controller at R = 1e-7."""
        return assume(self.assumed, Case(self.road, self.speed_kmh, controller, seed=self.seed))

    def __call__(self, runner: Any) -> dict[str, list[Row]]:
        """Run the controllers at their weights."""
        explicit, *controllers = (self.case(c) for c in ("explicit", *MATCHED))
        return {
            "compared": [row(runner, explicit), *(matched_row(runner, c, explicit) for c in controllers)],
            "unmatched": [row(runner, controller) for controller in controllers],
        }


@dataclass(frozen=True)
class History:
    """Time histories (figures 8, 10, 12) of the passive car and the controllers, matched ones at their weights."""

    road: str
    speed_kmh: float
    seed: int

    @property
    def label(self) -> str:
        """For people."""
        return f"history-{self.road}-{self.speed_kmh:g}kmh"

    @property
    def cost(self) -> float:
        """Rough time."""
        return 12 * _seconds(self.speed_kmh)

    def __call__(self, runner: Any) -> list[Row]:
        """Signals and values of the case of each car."""
        explicit = Case(self.road, self.speed_kmh, "explicit", seed=self.seed)
        controllers = [replace(explicit, controller=c) for c in MATCHED]
        cases = [replace(explicit, controller="passive"), explicit]
        cases += [replace(c, R=matched_row(runner, c, explicit)["R"]) for c in controllers]
        return [{**values(c), **runner.entry(c, signals=True)["signals"]} for c in cases]


def row(runner: Any, case: Case) -> Row:
    """A case and its metrics."""
    return {**values(case), **runner.metrics(case)}


def matched_row(runner: Any, case: Case, explicit: Case) -> Row:
    """The controller of a case at the weight at which its response equals explicit's; see `Comparison`."""
    of_explicit, of_passive = runner.metrics(explicit), runner.metrics(explicit.passive())
    if of_explicit["diverged"] or of_explicit["response"] >= of_passive["response"]:
        return {**row(runner, case), "matched": False, "runs": 1}
    m = match_weight(lambda R: runner.metrics(replace(case, R=R)), of_explicit["response"])
    return {**values(replace(case, R=m.R)), **m.metrics, "matched": m.found, "runs": m.runs}
