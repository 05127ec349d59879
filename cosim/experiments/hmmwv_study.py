"""The runs behind the figures and claims of paper 001, on all cores."""

from __future__ import annotations

import math
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
from cosim.experiments.hmmwv_wiring import LITRES_PER_MINUTE
from cosim.experiments.parallel import run_tasks
from cosim.experiments.provenance import salt
from cosim.experiments.store import RunStore
from cosim.report import Distribution
from fmu_sources.vehicles import load_actuator

WITHOUT_PREVIEW = ("zero", "skyhook", "lqr")  # the published controllers that know no road, apart from MPC
PUBLISHED = ("passive", *WITHOUT_PREVIEW, "mpc", "mpc-preview")
ESTIMATED = ("lqr", "mpc", "mpc-preview")
ACTIVE = tuple(c for c in CONTROLLERS if c != "passive")
PUMP_L_MIN = load_actuator("actuator_hmmwv").supply.flow_limit.value * LITRES_PER_MINUTE  # Table 1.4
SHARED_L_MIN = PUMP_L_MIN / 4  # to each actuator, where one pump feeds all four alike
PUMPS_L_MIN = {"track": (60.0, 75.0, 90.0, 120.0), "bump": (60.0, 120.0), "off-road": (120.0, 180.0, 240.0)}
"""Larger pumps that are tried, to each actuator, by road."""
PUMPED = {"track": ("skyhook", "lqr", "mpc"), "bump": ("mpc", "mpc-preview"), "off-road": ("mpc",)}
"""Controllers for which they are tried."""
FINER_EXCHANGE, FINER_SOLVERS = "0.25 ms", 2  # half of what every other run has
REFINED_APART = ("passive", "lqr", "mpc", "mpc-preview")  # over bumps also with one of the two finer, not both
NULL_OPENINGS_MM = (4.0, 5.0, 6.75)  # what is plausible for an unpowered spool
LENGTHS = (1, 2, 3, 4, 6, 8, 11, PREVIEW_STEPS)  # steps of preview; MPC has 0
ERRORS_MS = (-40, -30, -20, -10, -5, 0, 5, 10, 20, 30, 40)
OFF_ROAD_S = 20.0  # duration of a run off road, 18 s of them behind the ramp
VARIANTS = {"track": "places of the bumps", "bump": "places of the bump", "off-road": "stretches"}  # what varies
SIDE_VARIANTS = 2  # places of the bump, or stretches, for what is beside the published runs


def estimated(controller: str, road: str, *, sensed: bool = False) -> Case:
    """A controller on the states of the Kalman filter; ``sensed``: with the preview of the range sensors."""
    return Case(road, controller, states="estimated", preview="sensed" if sensed else "generated")


def with_pump(case: Case, pump_l_min: float = PUMP_L_MIN) -> Case:
    """The case with a pump that gives each actuator no more than this [l/min]."""
    return replace(case, flow_limit=True, pump_l_min=None if pump_l_min == PUMP_L_MIN else pump_l_min)


def finer(case: Case, *, exchange: bool = True, solver: bool = True) -> Case:
    """The case with half the exchange step of car and actuators, half the steps of their solvers, or both."""
    return replace(
        case, exchange=FINER_EXCHANGE if exchange else case.exchange, solver_parts=FINER_SOLVERS if solver else 1
    )


@dataclass(frozen=True)
class Plan:
    """How much is run: ``variants`` per case (None: all) and seconds off road. Tests take less."""

    variants: int | None = None
    off_road_s: float = OFF_ROAD_S

    def expand(self, case: Case) -> list[Case]:
        """The runs that a case is averaged over."""
        if case.road == "off-road" and case.duration is None:
            case = replace(case, duration=self.off_road_s)
        if case.exchange != hmmwv.EXCHANGE or case.solver_parts != 1:
            return over_variants(case, 1)
        beside = case.friction or not case.lift_off or case.pump_l_min == SHARED_L_MIN
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

    def distribution(self, key: str, case: Case) -> Distribution:
        """A metric over the variants of a case."""
        return Distribution((r[key] for r in self.runs(case)), of=VARIANTS[case.road])

    def ratio(self, above: Case, below: Case, key: str = "absorbed_power") -> Distribution:
        """A metric of one case over that of another, variant by variant; one without variants stands for all of them.

        Raises:
            ValueError: the cases were not run over the same variants.
        """
        tops, bottoms = ([r[key] for r in self.runs(c)] for c in (above, below))
        count = max(len(tops), len(bottoms))
        if {len(tops), len(bottoms)} - {1, count}:
            raise ValueError(f"{above.label} has {len(tops)} variants, {below.label} {len(bottoms)}")
        pairs = zip(tops * (count // len(tops)), bottoms * (count // len(bottoms)), strict=True)
        return Distribution((a / b if b else math.inf if a else math.nan for a, b in pairs), of=VARIANTS[above.road])

    def power(self, case: Case) -> float:
        """Absorbed power [W], the published figure: median over the variants of a case."""
        return self.distribution("absorbed_power", case).median

    def largest(self, key: str, case: Case) -> float:
        """Largest of a metric over the variants of a case."""
        return self.distribution(key, case).high

    def refined(self) -> Study:
        """This study as it would be with half the steps of exchange and solvers.

        Each metric of a case that was also run so is multiplied by what halving does to it in the case's first variant.
        """
        rows = {}
        for run, row in self.rows.items():
            fine = self.rows.get(finer(replace(run, variant=0)))
            coarse = self.rows.get(replace(run, variant=0))
            if fine is None or coarse is None:
                rows[run] = row
                continue
            moved = (k for k, v in row.items() if k in fine and isinstance(v, int | float) and coarse.get(k))
            rows[run] = {**row, **{k: row[k] * fine[k] / coarse[k] for k in moved}}
        return replace(self, rows=rows)

    def history(self, case: Case) -> dict[str, np.ndarray]:
        """Signals of the first variant of a case over time."""
        signals = self.rows[self.plan.expand(case)[0]]["history"]
        return {name: np.asarray(values) for name, values in signals.items()}


def averaged_cases() -> list[Case]:
    """What the study measures, each over all its variants."""
    cases = published_cases()
    cases += [Case(road, c, actuators="ideal") for road in ROADS for c in ACTIVE]
    cases += [estimated(c, road) for road in ROADS for c in ESTIMATED]
    cases += [estimated("mpc-preview", road, sensed=True) for road in ROADS]
    cases += [replace(estimated(c, "bump"), lift_off=False) for c in ("mpc", "mpc-preview")]
    cases += [with_pump(Case(road, c), SHARED_L_MIN) for road in ROADS for c in PUBLISHED if c != "passive"]
    cases += [with_pump(Case(road, c), pump) for road in ROADS for c in PUMPED[road] for pump in PUMPS_L_MIN[road]]
    cases += refined_cases()
    cases += [Case("bump", "mpc-preview", preview_steps=n) for n in LENGTHS]
    cases += [Case("bump", "mpc-preview", preview_error_ms=ms) for ms in ERRORS_MS]
    for road in ("track", "bump"):
        cases += [Case(road, "passive", null_opening_mm=mm) for mm in NULL_OPENINGS_MM]
        cases += [Case(road, c, lift_off=False) for c in PUBLISHED]
        cases += [Case(road, c, friction=True) for c in PUBLISHED]
    return list(dict.fromkeys(cases))


def published_cases() -> list[Case]:
    """What the claims on the whole vehicle rest on: every controller on every road, without and with the pump's limit."""
    cases = [Case(road, c) for road in ROADS for c in CONTROLLERS]
    return cases + [with_pump(Case(road, c)) for road in ROADS for c in ACTIVE]


def refined_cases() -> list[Case]:
    """Runs with finer steps, one variant each."""
    cases = [finer(case) for case in published_cases()]
    for road in ("track", "bump"):
        for c in REFINED_APART:
            cases += [finer(Case(road, c), solver=False), finer(Case(road, c), exchange=False)]
    return cases


def history_cases() -> list[Case]:
    """Cases of which the signals of the first variant are kept."""
    return [Case(road, c) for road in ROADS for c in PUBLISHED] + [Case("off-road", "lqr-kilonewton")]


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
    work = 1.5 if case.exchange != hmmwv.EXCHANGE or case.solver_parts != 1 else 1.0
    return work * case.stop_time * (0.4 if case.actuators == "ideal" else 1.6 if case.states == "estimated" else 1.0)


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
