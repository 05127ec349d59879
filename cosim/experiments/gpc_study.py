"""The published figures 6 to 12 of paper 000 and its claims, from runs of the FMUs.

``study`` runs everything on all cores; ``claims`` compares with the paper; ``report`` lays it out.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim import metrics
from cosim.experiments import gpc
from cosim.experiments.gpc import CONTROLLERS, ROADS, SPEEDS_KMH, GpcBench, GpcFmuSet, Scenario
from cosim.experiments.parallel import run_tasks
from cosim.experiments.provenance import salt
from cosim.experiments.store import RunStore
from fmu_sources import controllers
from fmu_sources.controllers.gpc import FORCE_LIMIT

Row = dict[str, Any]

SEEDS = tuple(range(8))
WEIGHTS = (1e-7, 5e-7, 1e-6, 5e-6)  # figure 6
OPEN_LOOP_SPEEDS_KMH = (42.5, 45.0, 47.5, 52.5, 55.0, 57.5)  # about the peak, besides SPEEDS_KMH
SINE_SPEED, CURB_SPEED, PERRYMAN_SPEED, POWER_SPEED = 50.0, 72.0, 50.0, 60.0  # km/h
HISTORIES = (("sine", SINE_SPEED), ("perryman3", PERRYMAN_SPEED), ("curb", CURB_SPEED))  # figures 8, 10, 12
LAWS = tuple(c for c in CONTROLLERS if c != "passive")


@dataclass
class Study:
    """Everything the figures and claims are made of; rows are flat dictionaries of JSON values."""

    sweep: list[Row] = field(default_factory=list)  # preview on the sine road over weights (figure 6)
    comparison: list[Row] = field(default_factory=list)  # all laws on all roads, J matched to explicit (7, 9, 11)
    open_loop: list[Row] = field(default_factory=list)  # passive car on the sine road, finer speeds
    seeds: list[Row] = field(default_factory=list)  # R = 1e-7 at the speeds of the claims, seeds 0-7
    power: list[Row] = field(default_factory=list)  # implicit matched to explicit on the sine road, seeds 0-7
    histories: list[Row] = field(default_factory=list)  # time histories (8, 10, 12)

    @property
    def rows(self) -> list[Row]:
        """All rows that are runs."""
        return [*self.sweep, *self.comparison, *self.open_loop, *self.seeds, *self.power]


def passive_rows(study: Study, road: str) -> list[Row]:
    """Open-loop rows of a road, by speed."""
    rows = [r for r in (*study.comparison, *study.open_loop) if r["controller"] == "passive" and r["road"] == road]
    return sorted(rows, key=lambda r: r["speed_kmh"])


def worst_speed(study: Study, road: str) -> float:
    """Speed of :data:`SPEEDS_KMH` with the largest open-loop response [km/h]."""
    rows = [r for r in study.comparison if r["controller"] == "passive" and r["road"] == road]
    return float(max(rows, key=lambda r: r["response"])["speed_kmh"])


# ---------------------------------------------------------------------- running


def study(
    fmus: GpcFmuSet,
    cache: Path,
    *,
    processes: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Study:
    """Run the whole study. Finished runs are kept in ``cache``, so an interrupted study continues where it stopped."""
    result = Study()
    done = 0
    # Slow speeds take longest: first, so that the cores finish together.
    first = sorted(
        [
            *(("comparison", road, v) for road in ROADS for v in SPEEDS_KMH),
            *(("sweep", w, v) for w in WEIGHTS for v in SPEEDS_KMH),
            *(("open_loop", "sine", v) for v in OPEN_LOOP_SPEEDS_KMH),
            *(("history", *h) for h in HISTORIES),
            *(("power", seed) for seed in SEEDS),
        ],
        key=_cost,
        reverse=True,
    )
    second_count = len(SEEDS) * 3
    progress(0, len(first) + second_count)

    def advance(_: Any, __: Any) -> None:
        nonlocal done
        done += 1
        progress(done, len(first) + second_count)

    def run(tasks: list[tuple[Any, ...]]) -> None:
        args = (fmus, cache)
        for kind_rows in run_tasks(_work, tasks, initializer=_start, initargs=args, processes=processes, done=advance):
            for kind, rows in kind_rows.items():
                getattr(result, kind).extend(rows)

    run(first)
    perryman = worst_speed(result, "perryman3")
    cases = (("sine", SINE_SPEED), ("perryman3", perryman), ("curb", CURB_SPEED))
    run([("seeds", road, v, seed) for seed in SEEDS for road, v in cases])
    for rows in (result.sweep, result.comparison, result.open_loop, result.seeds, result.power):
        rows.sort(key=lambda r: (r["road"], r["controller"], r["R"], r["speed_kmh"], r["seed"]))
    result.histories.sort(key=lambda r: (r["road"], list(CONTROLLERS).index(r["controller"])))
    return result


_bench: GpcBench  # of this worker process


def _start(fmus: GpcFmuSet, cache: Path) -> None:
    global _bench  # noqa: PLW0603
    laws = Path(controllers.__path__[0]).glob("*.py")  # runs with other seeds design their laws
    _bench = GpcBench(fmus, RunStore(cache, salt(fmus.all_paths(), [gpc.__file__, *sorted(laws)])))


def _cost(task: tuple[Any, ...]) -> float:
    """Rough simulated time of a task [s]."""
    kind = task[0]
    if kind == "comparison":
        return 12 * 540 / task[2]
    if kind in ("sweep", "open_loop"):
        return 540 / float(task[2])
    return 100.0


def _work(task: tuple[Any, ...]) -> dict[str, list[Row]]:
    kind, *args = task
    work: dict[str, Callable[..., dict[str, list[Row]]]] = {
        "comparison": _comparison,
        "sweep": _sweep,
        "open_loop": _open_loop,
        "seeds": _seeds,
        "power": _power,
        "history": _history,
    }
    return work[kind](_bench, *args)


def _row(scenario: Scenario, m: Row, **more: Any) -> Row:
    return {**asdict(scenario), **m, **more}


def _comparison(bench: GpcBench, road: str, speed: float) -> dict[str, list[Row]]:
    passive = Scenario(road, speed, "passive")
    explicit = replace(passive, controller="explicit")
    rows = [_row(s, bench.measure(s)) for s in (passive, explicit)]
    rows += [_matched_row(bench, replace(passive, controller=c), rows[1]) for c in ("implicit", "preview")]
    return {"comparison": rows}


def _matched_row(bench: GpcBench, scenario: Scenario, explicit: Row) -> Row:
    m = gpc.matched(bench, scenario, explicit["response"])
    return _row(replace(scenario, R=m.R), m.metrics, matched=m.found, runs=m.runs)


def _sweep(bench: GpcBench, weight: float, speed: float) -> dict[str, list[Row]]:
    s = Scenario("sine", speed, "preview", R=weight)
    return {"sweep": [_row(s, bench.measure(s))]}


def _open_loop(bench: GpcBench, road: str, speed: float) -> dict[str, list[Row]]:
    s = Scenario(road, speed, "passive")
    return {"open_loop": [_row(s, bench.measure(s))]}


def _seeds(bench: GpcBench, road: str, speed: float, seed: int) -> dict[str, list[Row]]:
    passive = bench.measure(Scenario(road, speed, "passive"))
    rows = []
    for controller in LAWS:
        s = Scenario(road, speed, controller, seed=seed)
        m = bench.measure(s)
        gain = float("nan") if m["diverged"] else metrics.improvement(m["response"], passive["response"])
        rows.append(_row(s, m, improvement=gain))
    return {"seeds": rows}


def _power(bench: GpcBench, seed: int) -> dict[str, list[Row]]:
    explicit = Scenario("sine", POWER_SPEED, "explicit", seed=seed)
    row = _row(explicit, bench.measure(explicit))
    return {"power": [row, _matched_row(bench, replace(explicit, controller="implicit"), row)]}


def _history(bench: GpcBench, road: str, speed: float) -> dict[str, list[Row]]:
    passive = Scenario(road, speed, "passive")
    explicit = replace(passive, controller="explicit")
    target = bench.measure(explicit)["response"]
    scenarios = [passive, explicit]
    for controller in ("implicit", "preview"):
        s = replace(passive, controller=controller)
        scenarios.append(replace(s, R=gpc.matched(bench, s, target).R))
    return {"histories": [_series(bench, s) for s in scenarios]}


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


# ---------------------------------------------------------------------- reading results


def select(rows: Iterable[Row], **where: Any) -> list[Row]:
    """Rows whose fields equal the given values."""
    return [r for r in rows if all(r[k] == v for k, v in where.items())]


def one(rows: Iterable[Row], **where: Any) -> Row:
    """The single row with these values; LookupError otherwise."""
    found = select(rows, **where)
    if len(found) != 1:
        raise LookupError(f"{len(found)} rows with {where}")
    return found[0]


def median(rows: Iterable[Row], value: str | Callable[[Row], float]) -> float:
    """Median over rows of a field or a function of the row."""
    return statistics.median(r[value] if isinstance(value, str) else value(r) for r in rows)


def figure_metrics(study: Study, row: Row) -> dict[str, float]:
    """Metrics of a run in the units of the figures, NaN where it diverged."""
    if row["diverged"]:
        return dict.fromkeys(("response", "improvement", "force", "power", "per_force", "per_power"), float("nan"))
    passive = one(select(study.comparison, controller="passive"), road=row["road"], speed_kmh=row["speed_kmh"])
    gain = metrics.improvement(row["response"], passive["response"])
    return {
        "response": row["response"],
        "improvement": gain,
        "force": row["force"] / 1e3,
        "power": row["power"],
        "per_force": metrics.force_normalised_effectiveness(gain, row["force"] / 1e3) if row["force"] else float("nan"),
        "per_power": metrics.power_normalised_effectiveness(gain, row["power"] / 1e3) if row["power"] else float("nan"),
    }


def improvement_at(study: Study, road: str, controller: str, speed: float) -> float:
    """Improvement (23) of a law in the comparison."""
    rows = select(study.comparison, road=road, speed_kmh=speed)
    passive, law = one(rows, controller="passive"), one(rows, controller=controller)
    return float("nan") if law["diverged"] else metrics.improvement(law["response"], passive["response"])


def open_loop_peak(study: Study) -> float:
    """Speed of the largest open-loop response on the sine road [km/h], on the finest speeds run."""
    return float(max(passive_rows(study, "sine"), key=lambda r: r["response"])["speed_kmh"])


def seed_medians(study: Study) -> dict[str, float]:
    """The numbers of the published claims as medians over the identification seeds."""
    perryman = next(r["speed_kmh"] for r in study.seeds if r["road"] == "perryman3")
    sine = {c: select(study.seeds, road="sine", controller=c) for c in LAWS}
    rough = {c: select(study.seeds, road="perryman3", controller=c) for c in LAWS}
    curb = {c: select(study.seeds, road="curb", controller=c) for c in LAWS}
    lower = sum(one(curb["preview"], seed=s)["peak_force"] < one(curb["explicit"], seed=s)["peak_force"] for s in SEEDS)
    ratios = [
        one(study.power, seed=s, controller="implicit")["power"]
        / one(study.power, seed=s, controller="explicit")["power"]
        for s in SEEDS
        if one(study.power, seed=s, controller="implicit")["matched"]
    ]
    return {
        "open_loop_peak_kmh": open_loop_peak(study),
        "sine_improvement_explicit": median(sine["explicit"], "improvement"),
        "sine_improvement_preview": median(sine["preview"], "improvement"),
        "sine_force_ratio": median(
            sine["preview"], lambda r: r["force"] / one(sine["explicit"], seed=r["seed"])["force"]
        ),
        "perryman_speed_kmh": perryman,
        "perryman_improvement_implicit": median(rough["implicit"], "improvement"),
        "perryman_improvement_explicit": median(rough["explicit"], "improvement"),
        "perryman_improvement_preview": median(rough["preview"], "improvement"),
        "curb_seeds_preview_lower_peak": lower,
        "curb_peak_implicit": median(curb["implicit"], "peak_force"),
        "curb_peak_explicit": median(curb["explicit"], "peak_force"),
        "curb_peak_preview": median(curb["preview"], "peak_force"),
        "power_ratio_implicit_60": statistics.median(ratios) if ratios else float("nan"),
        "power_seeds_matched": len(ratios),
        "diverged_runs": sum(bool(r["diverged"]) for r in study.rows if r["R"] >= gpc.R_PUBLISHED),
        "largest_force_share": max((r["peak_force"] for r in study.sweep if not r["diverged"]), default=float("nan"))
        / FORCE_LIMIT,
    }
