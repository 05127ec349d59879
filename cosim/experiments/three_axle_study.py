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
HISTORY_STEP = 2  # samples of 5 ms


@dataclass
class Study:
    """Metrics by case, and signals over time of the published runs."""

    places: tuple[Place, ...] = PLACES
    variants: tuple[str, ...] = tuple(VARIANTS)
    rows: dict[Case, Row] = field(default_factory=dict)
    histories: dict[Case, Row] = field(default_factory=dict)

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
    done = 0
    progress(0, len(cases))

    def advance(_: Any, __: Any) -> None:
        nonlocal done
        done += 1
        progress(done, len(cases))

    result = Study(tuple(places), tuple(variants))
    found = run_tasks(_work, cases, initializer=_start, initargs=(fmus, cache), processes=processes, done=advance)
    published = set(published_cases(places))
    for case, entry in zip(cases, found, strict=True):
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


def _work(case: Case) -> Row:
    def compute() -> Row:
        recording = _bench.record(case)
        return {"metrics": three_axle.metrics(recording, case), "history": history(recording)}

    found: Row = _store.get(asdict(case), compute)
    return found


def history(recording: Recording) -> Row:
    """Signals over time for the figures, every 10 ms: angles in degrees, forces in kN, the road in mm."""
    keep = slice(None, None, HISTORY_STEP)
    force = three_axle.forces(recording) / 1e3
    signals = {
        "time": recording.time,
        "pitch": np.degrees(recording["car.body.pitch"]),
        "reference": np.degrees(recording["reference.reference.pitch[1]"]),
        "road": 1e3 * recording["road.road.a1l.height"],
        **{f"force.{k}": force[:, i] for i, k in enumerate(three_axle.CORNERS) if k.endswith("l")},
    }
    return {k: [float(f"{x:.6g}") for x in v[keep]] for k, v in signals.items()}
