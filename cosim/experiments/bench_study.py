"""Figures 6 to 10 of paper 002 and what they are to show, from runs of the FMUs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from cosim import Recording
from cosim.experiments import bench as experiment
from cosim.experiments.bench import BUMP_DURATIONS, SYSTEMS, Bench, Case
from cosim.experiments.cases import FmuSet

SCENARIOS = {f"bump {d:g} s": Case("passive", "bump", d) for d in BUMP_DURATIONS} | {
    "random": Case("passive", "random")
}
HEIGHTS = (0.01, 0.02, 0.03, 0.04, 0.05)  # m, bumps over which the limit comes into play
STRETCHES = tuple(10.0 * i for i in range(8))  # s, where the runs over the random road start in its motion
RANDOM = ("passive", "mpc")  # systems judged on the random road
REFINEMENTS: dict[str, dict[str, Any]] = {
    "solver step": {"solver_step": 2.5e-4},
    "exchange step": {"exchange_step": "0.5 ms"},
}
"""Steps at half of what the runs have, bump of 0.2 s."""
LIMITED = ("lqr-clipped", "mpc", "mpc-moves")


@dataclass
class Study:
    """Results of all runs."""

    metrics: dict[tuple[str, str], dict[str, float]] = field(default_factory=dict)  # (scenario, system)
    histories: dict[tuple[str, str], Recording] = field(default_factory=dict)
    encoders: dict[tuple[str, str], dict[str, float]] = field(default_factory=dict)
    heights: dict[tuple[float, str], list[dict[str, float]]] = field(default_factory=dict)  # (duration, system)
    solver: dict[tuple[str, str], dict[str, float]] = field(default_factory=dict)  # (scenario, system), of the MPC
    stretches: dict[str, list[dict[str, float]]] = field(default_factory=dict)  # system -> of the random road
    refined: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)  # what is halved -> system -> metrics


def study(fmus: FmuSet, progress: Callable[[int, int], None] = lambda done, total: None) -> Study:
    """Run everything (a few seconds)."""
    result = Study()
    bench = Bench(fmus)
    controlled = [s for s in SYSTEMS if s != "passive"]
    total = len(SCENARIOS) * (len(SYSTEMS) + len(controlled)) + len(BUMP_DURATIONS) * len(HEIGHTS) * len(LIMITED)
    total += len(STRETCHES) * len(RANDOM) + len(REFINEMENTS) * len(SYSTEMS)
    done = 0

    def run(scenario: Case, system: str, steps: Mapping[str, Any] = MappingProxyType({}), **more: Any) -> Recording:
        nonlocal done
        recording = bench.record(replace(scenario, system=system, **more), **steps)
        done += 1
        progress(done, total)
        return recording

    for name, scenario in SCENARIOS.items():
        for system in SYSTEMS:
            recording = run(scenario, system)
            result.histories[name, system] = recording
            result.metrics[name, system] = experiment.metrics(recording)
            if "controller.solver.status" in recording:
                result.solver[name, system] = solver(recording)
        for system in controlled:
            result.encoders[name, system] = experiment.metrics(run(scenario, system, encoders=True))
    for duration in BUMP_DURATIONS:
        for system in LIMITED:
            result.heights[duration, system] = [
                experiment.metrics(run(Case("passive", "bump", duration), system, height=h)) for h in HEIGHTS
            ]
    for system in RANDOM:
        result.stretches[system] = [experiment.metrics(run(SCENARIOS["random"], system, offset=at)) for at in STRETCHES]
    for what, steps in REFINEMENTS.items():
        shortest = SCENARIOS[f"bump {min(BUMP_DURATIONS):g} s"]
        result.refined[what] = {s: experiment.metrics(run(shortest, s, steps)) for s in SYSTEMS}
    bench.close()
    return result


def solver(recording: Recording) -> dict[str, float]:
    """Worst outcome of the solver over a run."""
    return {n: float(np.max(recording[f"controller.solver.{n}"])) for n in ("status", "iterations", "residual")}


def ratio(study: Study, scenario: str, metric: str, system: str, base: str) -> float:
    """A metric of one system over that of another."""
    return study.metrics[scenario, system][metric] / study.metrics[scenario, base][metric]
