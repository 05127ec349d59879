"""Calibration of the assumed values of the HMMWV: run-equivalents by differences and by derivatives.

The fits of docs/examples/calibrate_hmmwv.py. A run-equivalent is the processor time of one run with the values that the
fit starts from, which is measured before and after it. All work of a fit counts, after one run with derivatives that
loads what was compiled.
"""

from __future__ import annotations

import runpy
from pathlib import Path

from benchmarks import spent
from cosim.study.calibration import Calibration, calibrate

EXAMPLE = Path(__file__).parents[1] / "docs" / "examples" / "calibrate_hmmwv.py"
ROUNDS = 10


def measure() -> dict[str, dict[str, float]]:
    """By drive and way: runs, run-equivalents, and how many times fewer these are by derivatives."""
    found: dict[str, dict[str, float]] = {}
    for drive, speed in runpy.run_path(str(EXAMPLE))["SPEEDS_KMH"].items():
        (old, before), (new, after) = (_fit(speed, gradient=g) for g in (False, True))
        ratios = [b / a for a, b in zip(old.deviations.tolist(), new.deviations.tolist(), strict=True) if a < 1.0]
        after |= {
            "times fewer": before["run-equivalents"] / after["run-equivalents"],
            "narrowest interval / by differences": min(ratios),
            "widest interval / by differences": max(ratios),
        }
        found |= {f"{drive}, by differences": before, f"{drive}, by derivatives": after}
    return found


def _fit(speed: float, *, gradient: bool) -> tuple[Calibration, dict[str, float]]:
    example = runpy.run_path(str(EXAMPLE))
    with example["vehicle"](speed) as system:
        given, ranges, _ = example["drive"](system)
        first = {name: of[0] for name, of in ranges.items()}
        model, again = (example["response"](system, gradient=gradient) for _ in range(2))
        if gradient:
            again.with_slopes(first)
        runs = [spent(again, first) for _ in range(ROUNDS)]
        fits: list[Calibration] = []
        noise = list(example["SENSORS"].values())
        took = spent(lambda: fits.append(calibrate(model, given, ranges, noise=noise)))
        run = min(*runs, *(spent(again, first) for _ in range(ROUNDS)))
    if model.by_difference:
        raise RuntimeError(f"build the FMUs again: {model.by_difference}")
    return fits[0], {
        "runs": model.runs,
        "runs with derivatives": model.runs_with_slopes,
        "run-equivalents": took / run,
    }
