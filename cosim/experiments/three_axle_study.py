"""The runs behind Table 5.1 and Figures 5.4 to 5.14 of paper 003, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from cosim import Recording
from cosim.experiments import three_axle
from cosim.experiments.cases import FmuSet
from cosim.experiments.parallel import run_tasks
from cosim.experiments.provenance import salt
from cosim.experiments.store import RunStore
from cosim.experiments.three_axle import DEPTHS, SPEEDS_KMH, SYSTEMS, Case, Row, ThreeAxleBench

Place = tuple[float, float]  # speed [km/h], depth [m]
PLACES: tuple[Place, ...] = tuple(product(SPEEDS_KMH, DEPTHS))
VARIANTS = {  # what else is run at each place -> what it is
    "height": ({"system": "mpc-preview", "hold_height": True}, "with preview, height of the body held"),
    "height, blind": ({"system": "mpc", "hold_height": True}, "without preview, height of the body held"),
    "measured": ({"system": "mpc-preview", "estimator": "measured"}, "with preview, all states measured"),
    "road": ({"system": "mpc", "estimator": "road"}, "without preview, estimator with road heights"),
}


REFINEMENTS: dict[str, dict[str, Any]] = {
    "solver step": {"solver_step": 2.5e-4},
    "exchange step": {"exchange_step": "0.5 ms"},
}
"""Steps of the vehicle at half of what the runs have, at the last place of a study (the hardest)."""


@dataclass
class Study:
    """Metrics by case, and signals over time of the published runs."""

    places: tuple[Place, ...] = PLACES
    variants: tuple[str, ...] = tuple(VARIANTS)
    rows: dict[Case, Row] = field(default_factory=dict)
    histories: dict[Case, Row] = field(default_factory=dict)
    refined: dict[tuple[str, str], Row] = field(default_factory=dict)  # (what is halved, system) -> metrics

    def value(self, key: str, place: Place, system: str) -> float:
        """A metric of a published run. KeyError when it was not run."""
        return float(self.rows[Case(*place, system)][key])

    def variant(self, key: str, place: Place, variant: str) -> float:
        """A metric of a variant."""
        return float(self.rows[variant_case(place, variant)][key])


def variant_case(place: Place, variant: str) -> Case:
    """The run of a variant at a place."""
    return Case(*place, **VARIANTS[variant][0])  # type: ignore[arg-type]


def published_cases(places: Sequence[Place] = PLACES) -> list[Case]:
    """Table 5.1 and the passive vehicle."""
    return [Case(*place, system) for place in places for system in SYSTEMS]


def study(
    fmus: FmuSet,
    cache: Path,
    *,
    places: Sequence[Place] = PLACES,
    variants: Sequence[str] = tuple(VARIANTS),
    processes: int | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Study:
    """Run everything. Finished runs are kept in ``cache``, so an interrupted study continues where it stopped."""
    cases = [*published_cases(places), *(variant_case(p, v) for p in places for v in variants)]
    finer = [(what, Case(*places[-1], system)) for what in REFINEMENTS for system in SYSTEMS]
    tasks: list[tuple[str, Case]] = [*(("", c) for c in cases), *finer]
    done = 0
    progress(0, len(tasks))

    def advance(_: Any, __: Any) -> None:
        nonlocal done
        done += 1
        progress(done, len(tasks))

    result = Study(tuple(places), tuple(variants))
    found = run_tasks(_work, tasks, initializer=_start, initargs=(fmus, cache), processes=processes, done=advance)
    published = set(published_cases(places))
    for (what, case), entry in zip(tasks, found, strict=True):
        if what:
            result.refined[what, case.system] = entry["metrics"]
            continue
        result.rows[case] = entry["metrics"]
        if case in published:
            result.histories[case] = entry["history"]
    return result


_bench: ThreeAxleBench  # of this worker process
_store: RunStore


def _start(fmus: FmuSet, cache: Path) -> None:
    global _bench, _store
    code = [three_axle.__file__, __file__]
    _bench, _store = ThreeAxleBench(fmus), RunStore(cache, salt(fmus.paths(three_axle.FMUS), code))


def _work(task: tuple[str, Case]) -> Row:
    what, case = task

    def compute() -> Row:
        recording = _bench.record(case, **REFINEMENTS.get(what, {}))
        return {"metrics": three_axle.metrics(recording, case), "history": history(recording)}

    found: Row = _store.get([what, asdict(case)], compute)
    return found


def history(recording: Recording) -> Row:
    """Signals over time for the figures, at 200 Hz: angles in degrees, forces in kN, the road in mm."""
    force = three_axle.forces(recording) / 1e3
    signals = {
        "time": recording.time,
        "pitch": np.degrees(recording["car.body.pitch"]),
        "reference": np.degrees(recording["reference.reference.pitch[1]"]),
        "road": 1e3 * recording["road.road.a1l.height"],
        **{f"force.{k}": force[:, i] for i, k in enumerate(three_axle.CORNERS) if k.endswith("l")},
    }
    return {k: [float(f"{x:.6g}") for x in v] for k, v in signals.items()}
