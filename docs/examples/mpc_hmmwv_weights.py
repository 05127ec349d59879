"""Weights of the HMMWV's predictive control for the off-road course: absorbed power against travel against force.

    python docs/examples/mpc_hmmwv_weights.py

MpcHmmwv has no parameters: its quadratic program is made when the FMU is built. So every trial builds the law with its
weights, and drives the hydraulic HMMWV over one stretch of the course with it. What is on the front, and what is
published, then drives another stretch, which the search has not seen.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

from build_fmus.compile import ObjectCache, resolve_platforms
from build_fmus.package import build_fmu
from cosim.experiments.hmmwv import EXPERIMENT
from cosim.experiments.hmmwv.runs import Case
from cosim.report import Report, write_report
from cosim.report.fronts import front_section
from cosim.study import FmuSet, Runner
from cosim.study.optimise import Outcome, optimise
from fmu_sources.controllers.mpc.hmmwv import MpcHmmwvWeights, mpc_hmmwv
from fmu_sources.plants.ride_car import ride_car
from fmu_sources.vehicles import load_vehicle

PUBLISHED = MpcHmmwvWeights()
SPACE = {"absorbed_power": (1.0, 500.0, "log"), "velocity": (1.0, 5000.0, "log"), "force": (1e-8, 1e-4, "log")}
OBJECTIVES = {"absorbed_power": "min", "travel_rms": "min", "force_rms": "min"}
LABELS = {"absorbed_power": "absorbed power [W]", "travel_rms": "rms travel [m]", "force_rms": "rms force [N]"}
SEEN, UNSEEN = 0, 3  # stretches of the course


def drive(values: Mapping[str, float], stretch: int = SEEN, seconds: float = 10.0) -> dict[str, float]:
    """The law with these weights, built, and driven over a stretch: the metrics of the experiment."""
    weights = replace(PUBLISHED, **values)
    law = mpc_hmmwv(ride_car(load_vehicle("ride_car_hmmwv"), "RideCarHmmwv"), weights)
    with tempfile.TemporaryDirectory() as folder:
        beside = Path(folder) / "fmi3"
        beside.mkdir()
        for fmu in Path("fmus/fmi3").resolve().glob("*.fmu"):
            if fmu.stem != law.name:
                (beside / fmu.name).symlink_to(fmu)
        built = build_fmu(law, 3, resolve_platforms("host"), ObjectCache(Path("results/objects")))
        (beside / f"{law.name}.fmu").write_bytes(built)
        case = Case("off-road", "mpc-preview", variant=stretch, duration=seconds)
        with Runner(EXPERIMENT, FmuSet(Path(folder))) as runner:
            found = runner.metrics(case)
    return {name: float(found[name]) for name in OBJECTIVES}


def search(trials: int, processes: int, storage: str | None, seconds: float) -> Outcome:
    first = [{name: getattr(PUBLISHED, name) for name in SPACE}]
    with ProcessPoolExecutor(processes) as pool:
        evaluate = partial(drive, seconds=seconds)
        return optimise(evaluate, SPACE, OBJECTIVES, trials=trials, storage=storage, executor=pool, first=first)


def main() -> None:
    parser = argparse.ArgumentParser(description="Weights of MpcHmmwv for the off-road course.")
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--storage", default="results/mpc-hmmwv-weights/trials.log")
    options = parser.parse_args()
    found = search(options.trials, options.processes, options.storage, options.seconds)
    published = found.trials[0].row
    done = found.done
    section = front_section(
        "Weights of MpcHmmwv",
        LABELS,
        OBJECTIVES,
        [t.row for t in done],
        [t.values for t in done],
        {"published": published},
    )
    print("published: " + ", ".join(f"{LABELS[n]} {v:.4g}" for n, v in published.items()))
    better = [t for t in done if all(t.row[n] < published[n] for n in OBJECTIVES)]
    print(
        f"{len(found.front)} of {len(done)} trials are Pareto-optimal; {len(better)} are better than the published"
        " weights in all three"
    )
    calmest = min(done, key=lambda t: t.row["absorbed_power"])
    for name, values in (("published", found.trials[0].values), ("least absorbed power", calmest.values)):
        row = drive(values, UNSEEN, options.seconds)
        print(
            f"{name}, on a stretch that the search has not seen: "
            + ", ".join(f"{LABELS[n]} {v:.4g}" for n, v in row.items())
        )
    report = Report(
        "mpc-hmmwv-weights", "Weights of MpcHmmwv", "Every trial is a law that was built.", sections=[section]
    )
    print(f"report: {write_report(report, Path('results/mpc-hmmwv-weights'))}")


if __name__ == "__main__":
    main()
