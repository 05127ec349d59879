"""The runs behind the figures and claims of paper 001, on all cores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.experiments import hmmwv
from cosim.experiments.cases import FmuSet
from cosim.experiments.hmmwv import CONTROLLERS, ROADS, Case, HmmwvBench, Row, over_variants
from cosim.experiments.parallel import run_tasks
from cosim.experiments.store import RunStore

NULL_OPENINGS_MM = (4.0, 5.0, 6.75)  # what is plausible for an unpowered spool
LIMITED = ("zero", "skyhook", "lqr")  # controllers that are also run with the pump's flow limit
HISTORY_VARIANT = 0


@dataclass(frozen=True)
class Plan:
    """How much is run: ``variants`` per road (None: all) and seconds off road (None: all). Tests take less."""

    variants: int | None = None
    off_road_duration: float | None = None

    def expand(self, case: Case) -> list[Case]:
        """The runs that a case is averaged over."""
        if case.road == "off-road" and case.duration is None and self.off_road_duration is not None:
            case = replace(case, duration=self.off_road_duration)
        return over_variants(case, self.variants)


@dataclass
class Study:
    """Metrics by run, and signals over time of some runs."""

    plan: Plan = field(default_factory=Plan)
    rows: dict[Case, Row] = field(default_factory=dict)
    histories: dict[Case, Row] = field(default_factory=dict)

    def runs(self, case: Case) -> list[Row]:
        """Metrics of every variant of a case.

        Raises:
            KeyError: it was not run.
        """
        return [self.rows[c] for c in self.plan.expand(case)]

    def mean(self, key: str, case: Case) -> float:
        """Mean of a metric over the variants of a case."""
        return float(np.mean([r[key] for r in self.runs(case)]))

    def spread(self, key: str, case: Case) -> tuple[float, float]:
        """Smallest and largest of a metric over the variants of a case."""
        values = [r[key] for r in self.runs(case)]
        return min(values), max(values)

    def power(self, case: Case) -> float:
        """Absorbed power [W], the published figure."""
        return self.mean("absorbed_power", case)


def averaged_cases() -> list[Case]:
    """What the study measures, each over all its variants."""
    cases = [Case(road, controller) for road in ROADS for controller in CONTROLLERS]
    cases += [
        Case(road, controller, actuators="ideal")
        for road in ROADS
        for controller in CONTROLLERS
        if controller != "passive"
    ]
    cases += [Case(road, controller, flow_limit=True) for road in ROADS for controller in LIMITED]
    cases += [Case(road, "passive", null_opening_mm=mm) for road in ("track", "bump") for mm in NULL_OPENINGS_MM]
    return cases


def history_cases() -> list[Case]:
    """Runs whose signals are kept."""
    return [Case(road, controller, variant=HISTORY_VARIANT) for road in ROADS for controller in CONTROLLERS]


def study(
    fmus: FmuSet,
    cache: Path,
    plan: Plan | None = None,
    *,
    processes: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Study:
    """Run everything. Finished runs are kept in ``cache``, so an interrupted study goes on where it stopped."""
    result = Study(plan or Plan())
    tasks = [("metrics", run) for case in averaged_cases() for run in result.plan.expand(case)]
    tasks += [("history", case) for case in history_cases()]
    tasks = sorted(dict.fromkeys(tasks), key=lambda task: -task[1].stop_time)  # longest first
    done = 0
    progress(0, len(tasks))

    def keep(task: tuple[str, Case], row: Row) -> None:
        nonlocal done
        kind, case = task
        (result.rows if kind == "metrics" else result.histories)[case] = row
        done += 1
        progress(done, len(tasks))

    run_tasks(_work, tasks, initializer=_start, initargs=(fmus, cache), processes=processes, done=keep)
    return result


_bench: HmmwvBench  # of this worker process


def _start(fmus: FmuSet, cache: Path) -> None:
    global _bench  # noqa: PLW0603
    _bench = HmmwvBench(fmus, RunStore(cache, hmmwv.salt(fmus)))


def _work(task: tuple[str, Case]) -> dict[str, Any]:
    kind, case = task
    return _bench.measure(case) if kind == "metrics" else _bench.history(case)
