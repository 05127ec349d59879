"""Calibration of the assumed values of the HMMWV: run-equivalents by differences and by derivatives.

The fits of docs/examples/calibrate_hmmwv.py. A run-equivalent is the processor time of one run with the values that the
fit starts from, which is measured before and after it. All work of a fit counts, after one evaluation that loads what
was compiled. Runs for differences are scalar, as in a fit of less than 10 s, or in lanes from the start.
"""

from __future__ import annotations

import runpy
from pathlib import Path

from benchmarks import spent
from cosim.study.calibration import Calibration, calibrate

EXAMPLE = Path(__file__).parents[1] / "docs" / "examples" / "calibrate_hmmwv.py"
ROUNDS = 10
SEEDS, OFF = 30, (1.1, 1.3)  # of noise, and by what factor a fit starts from other values
WAYS = {"differences": (False, "off"), "differences in lanes": (False, "auto"), "derivatives": (True, "off")}


def measure() -> dict[str, dict[str, float]]:
    """By drive and way: runs, run-equivalents, and how many times fewer these are by derivatives."""
    found: dict[str, dict[str, float]] = {}
    for drive, speed in runpy.run_path(str(EXAMPLE))["SPEEDS_KMH"].items():
        fits = {way: _fit(speed, gradient, lanes) for way, (gradient, lanes) in WAYS.items()}
        exact, best = fits["derivatives"]
        for way, (fit, row) in fits.items():
            wider = [a / b for a, b in zip(exact.deviations.tolist(), fit.deviations.tolist(), strict=True) if b < 1.0]
            found[f"{drive}, {way}"] = row | {
                "over derivatives": row["run-equivalents"] / best["run-equivalents"],
                "intervals by derivatives / these, least": min(wider),
                "most": max(wider),
            }
        for off in OFF:
            found[f"{drive}, {SEEDS} seeds, {off} times the values"] = _seeds(speed, off)
    return found


def _seeds(speed: float, off: float) -> dict[str, float]:
    """Of fits by derivatives to data with other noise: runs, and the share of intervals that contain the true value."""
    example = runpy.run_path(str(EXAMPLE))
    counts, held = [], []
    with example["vehicle"](speed) as system:
        for seed in range(1, SEEDS + 1):
            given, ranges, truth = example["drive"](system, off=off, seed=seed)
            model = example["response"](system)
            fit = calibrate(model, given, ranges, noise=list(example["SENSORS"].values()))
            counts.append((model.runs, model.runs_with_slopes))
            intervals = zip(truth.values(), fit.intervals, fit.deviations.tolist(), strict=True)
            held += [low <= true <= high for true, (low, high), deviation in intervals if deviation < 1.0]
    runs, exact = zip(*counts, strict=True)
    return {
        "runs": sum(runs) / SEEDS,
        "runs with derivatives": sum(exact) / SEEDS,
        "most runs": max(runs),
        "most with derivatives": max(exact),
        "intervals that hold": sum(held) / len(held),
    }


def _fit(speed: float, gradient: bool, lanes: str) -> tuple[Calibration, dict[str, float]]:
    example = runpy.run_path(str(EXAMPLE))
    with example["vehicle"](speed) as system:
        given, ranges, _ = example["drive"](system)
        first = {name: of[0] for name, of in ranges.items()}
        model, again = (example["response"](system, gradient=gradient, lanes=lanes) for _ in range(2))
        if gradient:
            again.with_slopes(first)
        again.together([first, first])
        runs = [spent(again, first) for _ in range(ROUNDS)]
        fits: list[Calibration] = []
        noise = list(example["SENSORS"].values())
        took = spent(lambda: fits.append(calibrate(model, given, ranges, noise=noise)))
        run = min(*runs, *(spent(again, first) for _ in range(ROUNDS)))
    if model.by_difference:
        raise RuntimeError(f"build the FMUs again: {model.by_difference}")
    return fits[0], {"runs": model.runs, "runs with derivatives": model.runs_with_slopes, "run-equivalents": took / run}
