"""The runs behind the figures and claims of paper 001, on all cores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.experiments import hmmwv, hmmwv_preview, hmmwv_tracking
from cosim.experiments.cases import FmuSet
from cosim.experiments.hmmwv import CONTROLLERS, PREVIEW_STEPS, ROADS, Case, HmmwvBench, Row, over_variants
from cosim.experiments.hmmwv_preview import PreviewStudy
from cosim.experiments.hmmwv_tracking import TrackingStudy
from cosim.experiments.parallel import run_tasks
from cosim.experiments.provenance import salt
from cosim.experiments.store import RunStore

WITHOUT_PREVIEW = ("zero", "skyhook", "lqr")  # the published controllers that know no road, apart from MPC
PUBLISHED = ("passive", *WITHOUT_PREVIEW, "mpc", "mpc-preview")
ESTIMATED = ("lqr", "mpc", "mpc-preview")
LIMITED = (*WITHOUT_PREVIEW, "mpc", "mpc-preview")  # controllers that are also run with the pump's flow limit
NULL_OPENINGS_MM = (4.0, 5.0, 6.75)  # what is plausible for an unpowered spool
LENGTHS = (1, 2, 3, 4, 6, 8, 11, PREVIEW_STEPS)  # steps of preview; MPC has 0
ERRORS_MS = (-40, -30, -20, -10, -5, 0, 5, 10, 20, 30, 40)
OFF_ROAD_S = 20.0  # duration of a run off road, 18 s of them behind the ramp
SIDE_VARIANTS = 2  # places of the bump, or stretches, for what is beside the published runs


def estimated(controller: str, road: str, *, sensed: bool = False) -> Case:
    """A controller on the states of the Kalman filter; ``sensed``: with the preview of the range sensors."""
    return Case(road, controller, states="estimated", preview="sensed" if sensed else "generated")


@dataclass(frozen=True)
class Plan:
    """How much is run: ``variants`` per case (None: all) and seconds off road. Tests take less."""

    variants: int | None = None
    off_road_s: float = OFF_ROAD_S

    def expand(self, case: Case) -> list[Case]:
        """The runs that a case is averaged over."""
        if case.road == "off-road" and case.duration is None:
            case = replace(case, duration=self.off_road_s)
        beside = case.flow_limit or case.friction or not case.lift_off
        return over_variants(case, SIDE_VARIANTS if beside else self.variants)


@dataclass
class Study:
    """Metrics by run with the signals of some, and the studies of force tracking and of the preview chain by themselves."""

    plan: Plan = field(default_factory=Plan)
    rows: dict[Case, Row] = field(default_factory=dict)
    tracking: TrackingStudy | None = None
    preview: PreviewStudy | None = None

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

    def history(self, case: Case) -> dict[str, np.ndarray]:
        """Signals of the first variant of a case over time."""
        signals = self.rows[self.plan.expand(case)[0]]["history"]
        return {name: np.asarray(values) for name, values in signals.items()}


def averaged_cases() -> list[Case]:
    """What the study measures, each over all its variants."""
    cases = [Case(road, controller) for road in ROADS for controller in CONTROLLERS]
    cases += [Case(road, c, actuators="ideal") for road in ROADS for c in CONTROLLERS if c != "passive"]
    cases += [estimated(c, road) for road in ROADS for c in ESTIMATED]
    cases += [estimated("mpc-preview", road, sensed=True) for road in ROADS]
    cases += [replace(estimated(c, "bump"), lift_off=False) for c in ("mpc", "mpc-preview")]
    cases += [Case(road, c, flow_limit=True) for road in ROADS for c in LIMITED]
    cases += [Case("bump", "mpc-preview", preview_steps=n) for n in LENGTHS]
    cases += [Case("bump", "mpc-preview", preview_error_ms=ms) for ms in ERRORS_MS]
    for road in ("track", "bump"):
        cases += [Case(road, "passive", null_opening_mm=mm) for mm in NULL_OPENINGS_MM]
        cases += [Case(road, c, lift_off=False) for c in PUBLISHED]
        cases += [Case(road, c, friction=True) for c in PUBLISHED]
    return list(dict.fromkeys(cases))


def history_cases() -> list[Case]:
    """Cases of which the signals of the first variant are kept."""
    return [Case(road, controller) for road in ROADS for controller in PUBLISHED]


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
    kept = {result.plan.expand(case)[0] for case in history_cases()}
    runs = dict.fromkeys(run for case in averaged_cases() for run in result.plan.expand(case))
    tasks: list[tuple[Case | str, bool]] = [(run, run in kept) for run in runs]
    tasks += [("tracking", False), ("preview", False)]
    tasks.sort(key=lambda task: -_cost(task[0]))  # longest first
    done = 0
    progress(0, len(tasks))

    def keep(task: tuple[Case | str, bool], found: Any) -> None:
        nonlocal done
        case, _ = task
        if isinstance(case, Case):
            result.rows[case] = found
        else:
            setattr(result, case, found)
        done += 1
        progress(done, len(tasks))

    run_tasks(_work, tasks, initializer=_start, initargs=(fmus, cache), processes=processes, done=keep)
    return result


def _cost(case: Case | str) -> float:
    """Rough time of a run, in seconds of the simplest one; the studies of parts take longest."""
    if isinstance(case, str):
        return 100.0
    return case.stop_time * (0.4 if case.actuators == "ideal" else 1.6 if case.states == "estimated" else 1.0)


_bench: HmmwvBench  # of this worker process


def _start(fmus: FmuSet, cache: Path) -> None:
    global _bench  # noqa: PLW0603
    parts = [hmmwv.__file__, hmmwv_tracking.__file__, hmmwv_preview.__file__]
    _bench = HmmwvBench(fmus, RunStore(cache, salt(fmus.paths(hmmwv.all_fmus()), parts)))


def _work(task: tuple[Case | str, bool]) -> Any:
    case, history = task
    if isinstance(case, Case):
        return _bench.measure(case, history=history)
    part = hmmwv_tracking.tracking_study if case == "tracking" else hmmwv_preview.study
    return part(_bench.fmus, _bench.store)
