"""Tables 2 and 3 and figures 3 to 7 of paper 004, from runs of the FMUs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import linalg

from cosim import Recording
from cosim.experiments import preview_lq as experiment
from cosim.experiments.cases import FmuSet
from cosim.experiments.preview_lq import INPUTS, SYSTEMS, Case, PreviewLqBench
from fmu_sources.controllers.preview_lq import CORNERS, WEIGHTED, ride_plant
from fmu_sources.controllers.preview_lq_design import continuous_lq, output_index
from fmu_sources.controllers.preview_lq_weights import load_weights
from fmu_sources.plants import ride_car
from fmu_sources.vehicles import load_ride_car

PAPER_CORNERS = ("fl", "rl", "fr", "rr")  # LF, LR, RF, RR
PAPER_COLUMNS = (
    "body.az", "body.pitch_acceleration", "body.roll_acceleration",
    *(f"suspension.{k}.deflection" for k in PAPER_CORNERS), *(f"tire.{k}.deflection" for k in PAPER_CORNERS),
)  # fmt: skip
WEIGHT_SETS = ("comfort", "road-holding")
PREVIEW_TIMES = tuple(round(0.01 * i, 2) for i in range(21))  # s
PLATEAU = 0.05  # m, of the offset road
REFINEMENTS: dict[str, dict[str, Any]] = {
    "solver step": {"solver_step": 2.5e-4},
    "exchange step": {"exchange_step": "0.5 ms"},
}
"""Steps at half of what the runs have, ride comfort with the same input on both sides."""

PRINTED_EIGENVALUES = (
    -28.22 + 72.25j, -10.77 + 67.53j, -9.23 + 70.13j, -8.59 + 67.64j, -5.31 + 6.14j, -4.00 + 5.07j, -3.51 + 4.52j,
)  # fmt: skip
"""Table 2, ride comfort (upper half plane), 1/s."""

PRINTED = {
    ("both", "active"): (49.6, 47.5, 100, 111.0, 141.0, 111.0, 1370.0, 149.0, 245.0, 159.0, 245.0, 72.7),
    ("both", "delay"): (21.1, 52.4, 100, 108.0, 103.0, 114.0, 105.0, 156.0, 96.2, 159.0, 101.0, 58.9),
    ("both", "preview"): (20.3, 39.4, 100, 78.3, 98.3, 84.6, 100.0, 66.6, 93.3, 65.7, 100.0, 48.3),
    ("left", "active"): (50.7, 47.9, 31.2, 101.0, 123.0, 212.0, 154.0, 126.0, 140.0, 550, 482, 62.8),
    ("left", "delay"): (21.4, 53.0, 12.0, 99.4, 109.0, 99.3, 71.4, 131.0, 64.8, 263, 221, 48.8),
    ("left", "preview"): (20.9, 39.6, 10.2, 79.2, 104.0, 127.0, 48.6, 64.1, 64.2, 335, 141, 40.8),
}
"""Table 3, ride comfort, per cent of passive, as printed: (input, system) -> columns of the paper and J."""

CORRECTED = {
    ("both", "active", 6): 137.0,
    **{("left", s, c): None for s in ("active", "delay", "preview") for c in (9, 10)},
}
"""Misprints of Table 3: a factor of ten in one cell of a), and in t3 and t4 of c) (None: ten times the printed value).
Roll with both sides equal is 0/0."""


@dataclass
class Study:
    """Results of all runs."""

    index: dict[tuple[str, str, str], float] = field(default_factory=dict)  # (input, weights, system) -> J
    components: dict[tuple[str, str, str], dict[str, float]] = field(default_factory=dict)
    forces: dict[tuple[str, str, str], np.ndarray] = field(default_factory=dict)  # rms by corner [N]
    preview: dict[tuple[str, str], list[dict[str, float]]] = field(default_factory=dict)  # figure 3, by preview time
    held: dict[tuple[str, str], list[dict[str, float]]] = field(default_factory=dict)  # the same with hold_tail
    refined: dict[str, dict[str, float]] = field(default_factory=dict)  # what is halved -> J of each system
    histories: dict[tuple[str, str, str], Recording] = field(default_factory=dict)
    offset: dict[bool, Recording] = field(default_factory=dict)  # driving onto a plateau; key: hold_tail
    coarse: float = float("nan")  # J of ride comfort with preview at 5 ms, both sides
    eigenvalues: dict[str, np.ndarray] = field(default_factory=dict)  # upper half plane, by weights


def corrected(input_: str, system: str) -> list[float | None]:
    """A row of Table 3 with its misprints corrected; None for 0/0."""
    row: list[float | None] = []
    for column, value in enumerate(PRINTED[input_, system]):
        key = (input_, system, column)
        if key in CORRECTED:
            row.append(CORRECTED[key] or 10.0 * value)
        else:
            row.append(None if column == 2 and input_ == "both" else float(value))
    return row


def relative(study: Study, input_: str, weights: str, system: str) -> list[float | None]:
    """Components in the paper's order and J, per cent of passive; None for 0/0."""
    now, base = study.components[input_, weights, system], study.components[input_, weights, "passive"]
    row: list[float | None] = [100 * now[n] / base[n] if base[n] > 1e-20 else None for n in PAPER_COLUMNS]
    return [*row, relative_index(study, input_, weights, system)]


def relative_index(study: Study, input_: str, weights: str, system: str) -> float:
    """J, per cent of passive."""
    return 100 * study.index[input_, weights, system] / study.index[input_, weights, "passive"]


MISSING_ENTRY = ("body.roll_rate", "force.rl")  # of N; without it the design has the printed poles


def design_eigenvalues(weights: str, *, without: tuple[str, str] | None = None) -> np.ndarray:
    """Closed-loop eigenvalues of the continuous design, upper half plane, by falling magnitude [1/s].

    ``without`` (state, control) leaves one entry of the cross weight N out of the index.
    """
    plant = ride_plant(ride_car(load_ride_car("sedan"), name="RideCarSedan"))
    chosen = load_weights(experiment.WEIGHTS[weights])
    index = output_index(plant, chosen.outputs(CORNERS), chosen.controls(CORNERS))
    if without is None:
        eigenvalues = continuous_lq(plant, index).eigenvalues
    else:  # no longer an index (it is not nonnegative), so the design functions refuse it: the bare Riccati equation
        N = index.N.copy()
        N[plant.states.index(without[0]), plant.controls.index(without[1])] = 0.0
        P = linalg.solve_continuous_are(plant.A, plant.B, index.Q1, index.R, s=N)
        eigenvalues = linalg.eigvals(plant.A - plant.B @ linalg.solve(index.R, plant.B.T @ P + N.T))
    upper = eigenvalues[eigenvalues.imag > 0]
    return upper[np.argsort(-np.abs(upper))]


def study(fmus: FmuSet, progress: Callable[[int, int], None] = lambda done, total: None) -> Study:
    """Run everything (a few seconds)."""
    result = Study()
    bench = PreviewLqBench(fmus)
    cases = [Case(i, w, s) for i in INPUTS for w in WEIGHT_SETS for s in SYSTEMS]
    sweeps = [
        Case(i, w, "preview", preview_time=t, hold_tail=hold)
        for hold in (False, True) for i in INPUTS for w in WEIGHT_SETS for t in PREVIEW_TIMES
    ]  # fmt: skip
    total, done = len(cases) + len(sweeps) + 3 + len(REFINEMENTS) * len(SYSTEMS), 0

    def run(case: Case, **more: Any) -> Recording:
        nonlocal done
        recording = bench.record(case, **more)
        done += 1
        progress(done, total)
        return recording

    for case in cases:
        key = (case.input, case.weights, case.system)
        recording = run(case)
        result.components[key] = experiment.components(recording)
        result.index[key] = experiment.index(recording, experiment.weights_of(case))
        result.forces[key] = np.sqrt(np.mean(experiment.forces(recording) ** 2, axis=0))
        result.histories[key] = recording
    for case in sweeps:
        recording = run(case)
        parts = experiment.components(recording)
        row = {"preview_time": case.preview_time, "index": experiment.index(recording, experiment.weights_of(case))}
        row["heave"] = parts["body.az"]
        row["suspension"] = sum(parts[f"suspension.{k}.deflection"] for k in CORNERS)
        row["tire"] = sum(parts[f"tire.{k}.deflection"] for k in CORNERS)
        curves = result.held if case.hold_tail else result.preview
        curves.setdefault((case.input, case.weights), []).append(row)
    coarse = Case("both", "comfort-5ms", "preview")
    result.coarse = experiment.index(run(coarse), experiment.weights_of(coarse))
    plateau = Case("both", "comfort", "preview", shape="step")
    road = {"hole.depth": 0.0, "bump.height": PLATEAU, "bump.length": 1e4}
    for hold in (False, True):
        result.offset[hold] = run(replace(plateau, hold_tail=hold), road=road, duration=3.0)
    for what, steps in REFINEMENTS.items():
        finer = [Case("both", "comfort", s) for s in SYSTEMS]
        result.refined[what] = {c.system: experiment.index(run(c, **steps), experiment.weights_of(c)) for c in finer}
    result.eigenvalues = {w: design_eigenvalues(w) for w in WEIGHT_SETS}
    result.eigenvalues["comfort, one entry missing"] = design_eigenvalues("comfort", without=MISSING_ENTRY)
    bench.close()
    return result


def matched_eigenvalues(ours: np.ndarray, printed: tuple[complex, ...]) -> list[tuple[complex, complex, float]]:
    """Pairs (printed, ours, |difference| / |printed|), each of ours used once, nearest first."""
    left = list(ours)
    pairs = []
    for p in printed:
        best = min(left, key=lambda e: abs(e - p))
        left.remove(best)
        pairs.append((p, complex(best), float(abs(best - p) / abs(p))))
    return pairs


__all__ = [
    "PRINTED",
    "WEIGHTED",
    "Study",
    "corrected",
    "design_eigenvalues",
    "matched_eigenvalues",
    "relative",
    "study",
]
