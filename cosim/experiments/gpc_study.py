"""All runs behind the figures 6 to 12 of paper 000 and its claims, on all cores.

``gpc_results`` reads numbers off the rows, ``gpc_claims`` compares them with the paper, ``gpc_report`` lays them out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from cosim.experiments import gpc
from cosim.experiments.gpc import CONTROLLERS, ROADS, SPEEDS_KMH, GpcBench, GpcFmuSet, Refinement, Scenario
from cosim.experiments.parallel import run_tasks
from cosim.experiments.provenance import salt
from cosim.experiments.store import RunStore
from fmu_sources import controllers

Row = dict[str, Any]

SEEDS = tuple(range(8))
WEIGHTS = (1e-7, 5e-7, 1e-6, 5e-6)  # figure 6
OPEN_LOOP_SPEEDS_KMH = (42.5, 45.0, 47.5, 52.5, 55.0, 57.5)  # about the peak, besides SPEEDS_KMH
SINE_SPEED, CURB_SPEED, PERRYMAN_SPEED = 50.0, 72.0, 50.0  # km/h
HISTORIES = (("sine", SINE_SPEED), ("perryman3", PERRYMAN_SPEED), ("curb", CURB_SPEED))  # figures 8, 10, 12
LAWS = tuple(c for c in CONTROLLERS if c != "passive")
MATCHED = ("implicit", "preview")  # laws whose weight is chosen so that their response equals explicit's


@dataclass
class Study:
    """Everything the figures and claims are made of; rows are flat dictionaries of JSON values.

    The excitation of the identification is random, so whatever a law does is there once for each of ``seeds``.
    """

    seeds: tuple[int, ...] = SEEDS
    speeds: tuple[float, ...] = SPEEDS_KMH  # km/h; on the curb also CURB_SPEED
    sweep: list[Row] = field(default_factory=list)  # preview on the sine road over weights (figure 6)
    comparison: list[Row] = field(default_factory=list)  # all laws on all roads, J matched to explicit (7, 9, 11)
    unmatched: list[Row] = field(default_factory=list)  # the matched laws at R = 1e-7 instead
    open_loop: list[Row] = field(default_factory=list)  # passive car on the sine road, finer speeds
    refinement: list[Row] = field(default_factory=list)  # solver step and exchange halved, seed 0
    histories: list[Row] = field(default_factory=list)  # time histories, seed 0 (8, 10, 12)

    @property
    def rows(self) -> list[Row]:
        """All rows that are runs."""
        return [*self.sweep, *self.comparison, *self.unmatched, *self.open_loop, *self.refinement]


# ---------------------------------------------------------------------- running


def study(
    fmus: GpcFmuSet,
    cache: Path,
    *,
    seeds: tuple[int, ...] = SEEDS,
    speeds: tuple[float, ...] = SPEEDS_KMH,
    processes: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Study:
    """Run the whole study, or that of fewer seeds and speeds. Finished runs are kept in ``cache``, so an interrupted
    study continues where it stopped."""
    result = Study(seeds, speeds)
    done = 0
    tasks: list[tuple[Any, ...]] = [
        *(("comparison", road, v, seed) for road in ROADS for v in _speeds_on(road, speeds) for seed in seeds),
        *(("passive", road, v) for road in ROADS for v in _speeds_on(road, speeds)),
        *(("sweep", "sine", v, seed) for v in speeds for seed in seeds),
        *(("open_loop", "sine", v) for v in OPEN_LOOP_SPEEDS_KMH),
        *(("history", road, v, seeds[0]) for road, v in HISTORIES),
        *(("refinement", road, v, seeds[0]) for road, v in HISTORIES),
    ]
    tasks.sort(key=_cost, reverse=True)  # so that the cores finish together
    progress(0, len(tasks))

    def advance(_: Any, __: Any) -> None:
        nonlocal done
        done += 1
        progress(done, len(tasks))

    args = (fmus, cache)
    for kind_rows in run_tasks(_work, tasks, initializer=_start, initargs=args, processes=processes, done=advance):
        for kind, rows in kind_rows.items():
            getattr(result, kind).extend(rows)
    order = list(CONTROLLERS)
    for rows in (result.sweep, result.comparison, result.unmatched, result.open_loop, result.refinement):
        rows.sort(key=lambda r: (r["road"], r["speed_kmh"], order.index(r["controller"]), r["R"], r["seed"]))
    result.histories.sort(key=lambda r: (r["road"], order.index(r["controller"])))
    return result


def _speeds_on(road: str, speeds: tuple[float, ...]) -> tuple[float, ...]:
    return (*speeds, CURB_SPEED) if road == "curb" else speeds


_bench: GpcBench  # of this worker process


def _start(fmus: GpcFmuSet, cache: Path) -> None:
    global _bench  # noqa: PLW0603
    laws = Path(controllers.__path__[0]).glob("*.py")  # runs with other seeds design their laws
    _bench = GpcBench(fmus, RunStore(cache, salt(fmus.all_paths(), [gpc.__file__, *sorted(laws)])))


_RUNS = {"comparison": 8, "sweep": 3, "history": 12, "refinement": 16}  # of a task, roughly


def _cost(task: tuple[Any, ...]) -> float:
    """Rough simulated time of a task [s]."""
    return _RUNS.get(task[0], 1) * 540 / float(task[2])


def _work(task: tuple[Any, ...]) -> dict[str, list[Row]]:
    kind, *args = task
    work: dict[str, Callable[..., dict[str, list[Row]]]] = {
        "comparison": _comparison,
        "passive": _passive,
        "sweep": _sweep,
        "open_loop": _open_loop,
        "history": _history,
        "refinement": _refinement,
    }
    return work[kind](_bench, *args)


def _row(bench: GpcBench, scenario: Scenario) -> Row:
    return {**asdict(scenario), **bench.measure(scenario)}


def _comparison(bench: GpcBench, road: str, speed: float, seed: int) -> dict[str, list[Row]]:
    explicit = _row(bench, Scenario(road, speed, "explicit", seed=seed))
    laws = [Scenario(road, speed, c, seed=seed) for c in MATCHED]
    return {
        "comparison": [explicit, *(_matched_row(bench, law, explicit) for law in laws)],
        "unmatched": [_row(bench, law) for law in laws],
    }


def _matched_row(bench: GpcBench, scenario: Scenario, explicit: Row) -> Row:
    """The law at explicit's response. Where explicit does not lower the response there is nothing to be matched, so the
    row is that at R = 1e-7 and not matched."""
    passive = bench.measure(Scenario(scenario.road, scenario.speed_kmh, "passive"))
    if explicit["diverged"] or explicit["response"] >= passive["response"]:
        return {**_row(bench, scenario), "matched": False, "runs": 1}
    m = gpc.matched(bench, scenario, explicit["response"])
    return {**asdict(replace(scenario, R=m.R)), **m.metrics, "matched": m.found, "runs": m.runs}


def _passive(bench: GpcBench, road: str, speed: float) -> dict[str, list[Row]]:
    return {"comparison": [_row(bench, Scenario(road, speed, "passive"))]}


def _open_loop(bench: GpcBench, road: str, speed: float) -> dict[str, list[Row]]:
    return {"open_loop": [_row(bench, Scenario(road, speed, "passive"))]}


def _sweep(bench: GpcBench, road: str, speed: float, seed: int) -> dict[str, list[Row]]:
    return {"sweep": [_row(bench, Scenario(road, speed, "preview", R=w, seed=seed)) for w in WEIGHTS]}


def _refinement(bench: GpcBench, road: str, speed: float, seed: int) -> dict[str, list[Row]]:
    cases = [Scenario(road, speed, c, seed=seed, refinement=r) for c in CONTROLLERS for r in get_args(Refinement)]
    return {"refinement": [_row(bench, s) for s in cases]}


def _history(bench: GpcBench, road: str, speed: float, seed: int) -> dict[str, list[Row]]:
    explicit = Scenario(road, speed, "explicit", seed=seed)
    row = _row(bench, explicit)
    matched = [replace(explicit, controller=c) for c in MATCHED]
    matched = [replace(s, R=_matched_row(bench, s, row)["R"]) for s in matched]
    return {"histories": [_series(bench, s) for s in (replace(explicit, controller="passive"), explicit, *matched)]}


def _series(bench: GpcBench, scenario: Scenario) -> Row:
    recording = bench.record(scenario)
    signals = {
        "az": recording["car.body.az"],
        "pitch": np.degrees(recording["car.body.pitch"]),
        "roll": np.degrees(recording["car.body.roll"]),
        "force": gpc.forces(recording)[:, 0],
    }
    return {
        **asdict(scenario),
        "time": np.round(recording.time, 9).tolist(),
        **{k: [float(f"{x:.6g}") for x in v] for k, v in signals.items()},
    }
