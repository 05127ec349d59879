"""Studies of paper 001 in which nothing was run: numbers that are given, to judge the judging."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cosim.experiments import hmmwv_preview as preview
from cosim.experiments import hmmwv_tracking as tracking
from cosim.experiments.hmmwv import EXCHANGE, Case
from cosim.experiments.hmmwv_study import Plan, Study, averaged_cases, history_cases
from cosim.experiments.hmmwv_tracking import VARIANTS, TrackingStudy

METRICS = (
    "absorbed_power_peak", "absorbed_power_mean", "iso2631_rms", "vdv", "rms_az", "travel_peak", "travel_over",
    "tire_rms", "lift_off", "force_rms", "force_peak", "flow_peak", "flow_mean", "power_mean", "tracking_error_rms",
    "saturated_time",
)  # fmt: skip
HISTORY = ("x", "power_window", "travel", "road", "force", "smoothed", "saturated", "load_cell")

AS_PUBLISHED = {
    "track": {"passive": 12.0, "zero": 5.1, "skyhook": 5.3, "lqr": 5.2, "lqr-kilonewton": 5.2, "mpc": 4.8, "mpc-preview": 4.0},
    "bump": {"passive": 12.0, "zero": 6.0, "skyhook": 6.0, "lqr": 6.0, "lqr-kilonewton": 6.0, "mpc": 4.7, "mpc-preview": 4.0},
    "off-road": {"passive": 20.0, "zero": 8.0, "skyhook": 8.0, "lqr": 8.0, "lqr-kilonewton": 8.0, "mpc": 5.0, "mpc-preview": 3.0},
}  # fmt: skip
"""Absorbed powers [W] with which the whole paper is right."""

Change = Callable[[Case, dict[str, float]], None]


def made_up_study(*changes: Change) -> Study:
    """The paper as it stands; ``changes`` are made to the metrics of every run that they know."""
    study = Study(Plan())
    for case in averaged_cases():
        for run in study.plan.expand(case):
            row = dict.fromkeys(METRICS, 0.05)
            row["absorbed_power"] = AS_PUBLISHED[run.road][run.controller] * (1 + 1e-3 * run.variant)
            row |= {"travel_rms": 0.01 if run.controller.startswith("mpc") else 0.012, "solver_residual": 1e-9}
            row |= {"saturation": 0.02 if run.controller == "mpc-preview" else 0.03, "solver_failures": 0}
            row["absorbed_power"] *= 0.8 if run.preview == "sensed" and run.road == "track" else 1.0
            for change in changes:
                change(run, row)
            study.rows[run] = row
    signal = np.arange(0, 3, 0.01).tolist()
    for case in history_cases():
        study.rows[study.plan.expand(case)[0]]["history"] = dict.fromkeys(HISTORY, signal)
    return study


def watts(value: float, **where: object) -> Change:
    """The absorbed power [W] of runs whose case has these fields."""

    def change(run: Case, row: dict[str, float]) -> None:
        if all(getattr(run, name) == wanted for name, wanted in where.items()):
            row["absorbed_power"] = value

    return change


def metric(name: str, value: float, **where: object) -> Change:
    """Another metric of runs whose case has these fields."""

    def change(run: Case, row: dict[str, float]) -> None:
        if all(getattr(run, field) == wanted for field, wanted in where.items()):
            row[name] = value

    return change


def is_finer(run: Case) -> bool:
    return run.exchange != EXCHANGE or run.solver_parts != 1


def made_up_tracking(worse: tuple[str, ...] = ()) -> TrackingStudy:
    """Rows as of a good law; those of the named variants are ten times worse. The loop is unstable above 1.1."""
    study = TrackingStudy()
    for case in tracking.all_cases():
        names = [n for n, v in VARIANTS.items() if replace(v, signal=case.signal) == case]
        error = 0.02 * (10 if set(names) & set(worse) else 1.5 if case != tracking.TrackingCase(case.signal) else 1)
        density = dict(case.controller).get("fluid.density", 1.0)
        study.rows[case] = {
            "error": error, "error_peak": 100.0, "early": 0.1, "late": 2.0 if density > 1.1 else 0.01,
            "flow_peak": 44.0, "voltage_peak": 3.0, "voltage_jumps": 0.05, "saturated": 0.0,
        }  # fmt: skip
    t = np.arange(0, 10, 0.004)
    wave = {n: np.sin(t).tolist() for n in ("tracking.force.smoothed", "actuator.force")}
    study.histories = {s: {"time": t.tolist(), **wave} for s in tracking.PUBLISHED}
    t = np.arange(0, 1.0, 1e-3)
    study.filter_step = {"time": t.tolist(), "force": (1.01 * (1 - np.exp(-t / 5e-3))).tolist()}
    return study


def made_up_preview(row: preview.Row | None = None) -> preview.PreviewStudy:
    """The same run of the chain, a flat road unless given, in every place of the study."""
    t = np.arange(0, 20, 0.005)
    flat = {n: (0 * t).tolist() for n in ("range", "sensed", "true", "true rate", "buffered", "rate")}
    flat |= {"buffered": (1e-3 * np.sin(50 * t)).tolist(), "rate": (0.01 * np.cos(50 * t)).tolist()}
    flat |= {n: (1 + 0 * t).tolist() for n in ("range valid", "preview valid", "road valid")}
    row = row or {"t": t.tolist(), "x": (9 * t).tolist(), "sensed x": (9 * t).tolist(), **flat}
    generated = {
        "x": [8.0, 8.5, 9.0, 14.5],
        "map": [0.0, 0.05, 0.0, 0.03],
        "road": [0.0] * 4,
        "load": [0.0, 1e3, 0.0, 5e2],
    }
    return preview.PreviewStudy(
        {(c, h): row for c in preview.CHAINS for h in preview.HEIGHTS},
        dict.fromkeys(preview.DRIFTING, row),
        dict.fromkeys(preview.SHOWN, row),
        row,
        dict.fromkeys(preview.SPEEDOMETER_ERRORS, generated),
    )
