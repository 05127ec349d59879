"""Comfort against road holding against force: what the preview LQ law of the sedan can do with other weights.

    python docs/examples/preview_lq_front.py

The weights are fixed when the law's FMU is built (its gains follow from them), so every trial builds one, in about a
second, into a folder of its own, and drives over the hole and the bump of paper 004 with it. The published laws stand
beside the front.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from build_fmus.compile import ObjectCache, resolve_platforms
from build_fmus.package import build_fmu
from cosim import Record, System
from cosim.report import Report, write_report
from cosim.report.fronts import front_section
from cosim.study.optimise import Outcome, optimise
from fmu_sources.controllers.lq.preview import preview_lq
from fmu_sources.controllers.lq.preview_weights import PreviewLqWeights, load_weights
from fmu_sources.models.corners import CORNERS
from fmu_sources.plants.ride_car import ride_car
from fmu_sources.vehicles import load_vehicle

PUBLISHED = {name: load_weights(name) for name in ("comfort", "road_holding")}
SPACE = {"suspension": (1e1, 1e5, "log"), "tire": (1e2, 1e6, "log"), "force": (1e-8, 1e-4, "log")}
OBJECTIVES = {"comfort": "min", "grip": "min", "force": "min"}
LABELS = {"comfort": "rms acceleration [m/s2]", "grip": "rms tire deflection [mm]", "force": "rms force [N]"}
SPEED = 75 / 3.6  # m/s, as published


def with_weights(values: Mapping[str, float]) -> PreviewLqWeights:
    """The published weights, with other weights of deflections [1/m2] and forces [1/N2], the same at both axles.

    Those of the accelerations are as published.
    """
    changed = {n: {"front": values[n], "rear": values[n]} for n in SPACE}
    return PreviewLqWeights.model_validate(
        {**PUBLISHED["comfort"].as_dict(), "name": "tried", "source": "tried", **changed}
    )


def drive(weights: PreviewLqWeights) -> dict[str, float]:
    """The law with these weights, built and driven: the objectives."""
    law = preview_lq(ride_car(load_vehicle("sedan"), "RideCarSedan"), weights, name="Tried", period=1e-3)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "Tried.fmu"
        path.write_bytes(build_fmu(law, 3, resolve_platforms("host"), ObjectCache(Path("results/objects"))))
        with System() as system:
            system.add("speed", "fmus/fmi3/SpeedProfile.fmu", parameters={"start.speed": SPEED, "start.x": 0.0})
            system.add("road", "fmus/fmi3/RoadHoleBump.fmu")
            system.add("car", "fmus/fmi3/RideCarSedan.fmu", step="1 ms")
            system.add("law", path, parameters={"mode": 2})
            system.connect("speed.x", "road.x")
            system.connect("speed.speed", "road.speed")
            system.connect("speed.speed", "law.speed")
            for source, target, names in (
                ("road", "car", "road.*"),
                ("road", "law", "*"),
                ("car", "law", "*"),
                ("law", "car", "*"),
            ):
                system.connect_matching(source, target, names)
            r = system.run(1.2, record=Record(["car.body.az", "car.tire.*.deflection", "law.force.*"], "1 ms"))

    def rms(names: list[str]) -> float:
        return float(np.sqrt(np.mean([np.mean(r[n] ** 2) for n in names])))

    return {
        "comfort": rms(["car.body.az"]),
        "grip": 1e3 * rms([f"car.tire.{k}.deflection" for k in CORNERS]),
        "force": rms([f"law.force.{k}" for k in CORNERS]),
    }


def evaluate(values: Mapping[str, float]) -> dict[str, float]:
    return drive(with_weights(values))


def search(trials: int, processes: int, storage: str | None) -> Outcome:
    with ProcessPoolExecutor(processes) as pool:
        return optimise(evaluate, SPACE, OBJECTIVES, trials=trials, storage=storage, executor=pool)


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Comfort against road holding against force, over the weights of the preview LQ law."
    )
    parser.add_argument("--trials", type=int, default=64)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--storage", default="results/preview-lq-front/trials.log")
    options = parser.parse_args()
    found = search(options.trials, options.processes, options.storage)
    published = {name.replace("_", " "): drive(weights) for name, weights in PUBLISHED.items()}
    section = front_section(
        "Comfort, road holding and force",
        LABELS,
        OBJECTIVES,
        [t.row for t in found.done],
        [t.values for t in found.done],
        published,
    )
    for name, row in published.items():
        better = sum(all(t.row[n] < row[n] for n in OBJECTIVES) for t in found.done)
        print(
            f"{name}: "
            + ", ".join(f"{LABELS[n]} {v:.4g}" for n, v in row.items())
            + f"; {better} trials are better in all three"
        )
    print(f"{len(found.front)} of {len(found.done)} trials are Pareto-optimal")
    report = Report(
        "preview-lq-front", "Weights of the preview LQ law", "Every trial is a law that was built.", sections=[section]
    )
    print(f"report: {write_report(report, Path('results/preview-lq-front'))}")


if __name__ == "__main__":
    main()
