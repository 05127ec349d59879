"""Force tracking as published in paper 001: the runs behind Figures 1.4 and 1.8, their variants, and its robustness."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from cosim.experiments.hmmwv.tracking.runs import FILTER, SIGNALS, Case
from cosim.study.experiment import Row, Task

NOISE = 50.0  # N, assumed noise of a load cell
QUIET = 0.01  # of the amplitude: error below which a loop is stable without falling any more
DENSITIES = (0.7, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15, 1.2, 1.25, 1.3)  # in the controller, relative
LEAKAGES = (0.0, 1.0, 2.0, 5.0)  # in the controller, relative
PUBLISHED = ("square", "sweep", "discrete sweep")  # signals of Figure 1.8
VARIANTS: dict[str, Case] = {
    "as published: difference (1.15), no average": Case(),
    "rate by the filter (1.13)": Case(rate_filter=True),
    "average (1.14) on": Case(average=True),
    "load cell with noise": Case(noise=NOISE),
    "load cell with noise, average (1.14) on": Case(average=True, noise=NOISE),
    "no integral term": Case(integral=0.0),
    "integral term 1/s": Case(integral=1.0),
    "notches at heave/pitch and roll on": Case(notches=True),
    "density of real oil, plant and controller": Case(actuator="physical"),
    "suspension without friction": Case(friction=False),
    "plain exchange, 0.5 ms": Case(extrapolate=False),
    "plain exchange, 0.25 ms": Case(extrapolate=False, exchange_parts=2),
    "exchange 0.25 ms": Case(exchange_parts=2),
}


def robustness_case(signal: str, density: float, leakage: float) -> Case:
    """The controller assumes another density and leakage (relative) than the actuator has."""
    return Case(signal, density=density, leakage=leakage)


def plan() -> list[Task]:
    """Every run of one corner."""
    drawn = [Case(signal) for signal in (*PUBLISHED, FILTER)]
    cases = [replace(case, signal=signal) for case in VARIANTS.values() for signal in PUBLISHED]
    cases += [robustness_case(s, d, k) for s in ("square", "step") for d in DENSITIES for k in LEAKAGES]
    return [
        Task(case, signals=case in drawn, cost=0.4 * SIGNALS[case.signal][2])
        for case in dict.fromkeys([*drawn, *cases])
    ]


def error(study: Mapping[Case, Row], case: Case) -> float:
    """Relative rms error of a case."""
    return float(study[case]["error"])


def is_stable(study: Mapping[Case, Row], density: float, leakage: float) -> bool:
    """Whether the error after a step decays (at least halves), with another density and leakage in the controller."""
    row = study[robustness_case("step", density, leakage)]
    return bool(row["late"] < max(QUIET, row["early"] / 2))


def largest_stable_density(study: Mapping[Case, Row], leakage: float = 1.0) -> float | None:
    """Largest relative density of the study up to which the loop is stable; None when the lowest is not."""
    stable = [d for i, d in enumerate(DENSITIES) if all(is_stable(study, x, leakage) for x in DENSITIES[: i + 1])]
    return stable[-1] if stable else None
