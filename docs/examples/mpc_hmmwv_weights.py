"""Weights of the HMMWV's predictive control for the off-road course: absorbed power against travel against force.

    python docs/examples/mpc_hmmwv_weights.py

`MpcHmmwvTunable` has the weights as parameters, and its quadratic programs are differentiated by them. So SLSQP follows
the derivatives of whole runs on the hydraulic HMMWV over one stretch of the course: to the least absorbed power within
the travel and the force that the published weights take, and with more of both. What it finds then drives another
stretch, which the search has not seen.
"""

from __future__ import annotations

import argparse

from cosim.experiments.hmmwv import EXPERIMENT
from cosim.study import FmuSet
from cosim.study.descent import descend
from cosim.study.design import Axis, Design
from cosim.study.slopes import PointSlopes
from cosim.study.sweep import prepare
from fmu_sources.controllers.mpc.hmmwv import MpcHmmwvWeights

PUBLISHED = MpcHmmwvWeights()
RANGES = {"absorbed_power": (1.0, 500.0), "velocity": (1.0, 5000.0), "force": (1e-8, 1e-4)}
SPACE = {f"controller.weight.{name}": (*ends, "log") for name, ends in RANGES.items()}
FIRST = {f"controller.weight.{name}": getattr(PUBLISHED, name) for name in RANGES}
BOUNDS = {  # times what the published weights take
    "published": {},
    "as much": {"travel_rms": 1.002, "force_rms": 1.002},
    "more": {"travel_rms": 1.25, "force_rms": 1.12},
}
TRIALS = 12
SEEN, OTHER = 0, 3  # stretches of the course


def course(stretch: int, seconds: float) -> PointSlopes:
    """Metrics of a run over a stretch, and their derivatives by the weights."""
    axes = tuple(Axis(name, numbers=ends) for name, ends in zip(SPACE, RANGES.values(), strict=True))
    case = {"road": "off-road", "controller": "mpc-preview", "tunable": True, "variant": stretch, "duration": seconds}
    return PointSlopes(prepare(EXPERIMENT, FmuSet(), Design(axes), case), FmuSet())


def table(seconds: float) -> list[str]:
    """The published weights and what the search finds, with what they do on both stretches."""
    weights = " ".join(f"{name:>9}" for name in RANGES)
    lines = [f"{'':<9} {weights}  power [W]  travel [mm]  force [N]  other: [W]    [mm]  runs"]
    with course(SEEN, seconds) as seen, course(OTHER, seconds) as other:
        published = seen(FIRST).row
        for name, factors in BOUNDS.items():
            values, runs = FIRST, 0
            if factors:
                within = {metric: published[metric] * factor for metric, factor in factors.items()}
                goal = {"absorbed_power": "min"}
                found = descend(seen, SPACE, goal, at_most=within, first=FIRST, trials=TRIALS)
                values, runs = found.best.values, len(found.trials)
            here, there = seen(values).row, other(values).row
            travel, far = (1e3 * row["travel_rms"] for row in (here, there))
            weighed = " ".join(f"{values[f'controller.weight.{n}']:{max(9, len(n))}.4g}" for n in RANGES)
            lines.append(
                f"{name:<9} {weighed}  {here['absorbed_power']:9.3f}  {travel:11.2f}"
                f"  {here['force_rms']:9.0f}  {there['absorbed_power']:11.3f}  {far:5.2f}  {runs:4d}"
            )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description="Weights of MpcHmmwvTunable for the off-road course.")
    parser.add_argument("--seconds", type=float, default=10.0)
    print("\n".join(table(parser.parse_args().seconds)))


if __name__ == "__main__":
    main()
