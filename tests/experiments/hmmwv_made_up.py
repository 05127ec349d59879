"""Studies of paper 001 in which nothing was run: numbers that are given, to judge the judging."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial
from typing import Any

import made_up
import numpy as np

from cosim.experiments.hmmwv import EXPERIMENT, preview, tracking
from cosim.experiments.hmmwv.runs import CONTROLLERS, Case
from cosim.experiments.hmmwv.tracking.published import VARIANTS
from cosim.experiments.hmmwv.tracking.runs import FILTER
from cosim.study import Results, Row

METRICS = (
    "absorbed_power_peak",
    "absorbed_power_mean",
    "iso2631_rms",
    "travel_peak",
    "travel_over",
    "lift_off",
    "force_rms",
    "force_peak",
    "flow_peak",
    "flow_mean",
    "power_mean",
    "tracking_error_rms",
)

AS_PUBLISHED = {
    road: dict(zip(CONTROLLERS, powers, strict=True))
    for road, powers in {
        "track": (12.0, 5.1, 5.3, 5.2, 5.2, 4.8, 4.0),
        "bump": (12.0, 6.0, 6.0, 6.0, 6.0, 4.7, 4.0),
        "off-road": (20.0, 8.0, 8.0, 8.0, 8.0, 5.0, 3.0),
    }.items()
}
"""Absorbed powers [W] with which the whole paper is right."""

Change = Callable[[Case, Row], None]


def made_up_study(*changes: Change, worse: Collection[str] = ()) -> Results:
    """The vehicle as the paper has it, and parts with nothing remarkable.

    `changes` are made to the metrics of the vehicle's runs; the named variants of the force tracking have ten times
    the error.
    """

    def metrics(case: Any) -> Row:
        row = PARTS[type(case)](case)[0]
        for change in changes if isinstance(case, Case) else ():
            change(case, row)
        if "error" in row and any(replace(VARIANTS[n], signal=case.signal) == case for n in worse):
            row["error"] *= 10
        return row

    return made_up.study(EXPERIMENT, metrics, lambda case: PARTS[type(case)](case)[1])


def vehicle(run: Case) -> tuple[Row, Row]:
    """Metrics and signals of a run of the vehicle."""
    row = dict.fromkeys(METRICS, 0.05)
    row["absorbed_power"] = AS_PUBLISHED[run.road][run.controller] * (1 + 1e-3 * run.variant)
    row |= {"travel_rms": 0.01 if run.controller.startswith("mpc") else 0.012, "solver_residual": 1e-9}
    row |= {"saturation": 0.02 if run.controller == "mpc-preview" else 0.03, "solver_failures": 0}
    row |= {"flow_limit": 45.0, "null_opening": 0.005}
    row["absorbed_power"] *= 0.8 if run.preview == "sensed" and run.road == "track" else 1.0
    signal = np.arange(0, 3, 0.01).tolist()
    return row, dict.fromkeys(("x", "power_window", "travel", "force", "smoothed", "saturated"), signal)


def corner(case: tracking.runs.Case) -> tuple[Row, Row]:
    """Metrics and signals as of a good law.

    The loop is unstable above a density of 1.1; the filter is at 1 after 23 ms.
    """
    if case.signal == FILTER:
        t = np.arange(0, 1.0, 1e-3)
        y = 1.01 * (1 - np.exp(-t / 5e-3))
        return tracking.runs.measure_filter(t, y), {"time": t.tolist(), "smoothed": y.tolist()}
    row = {
        "error": 0.02 if case == tracking.runs.Case(case.signal) else 0.03,
        "early": 0.1,
        "late": 2.0 if case.density > 1.1 else 0.01,
        "flow_peak": 44.0,
        "voltage_peak": 3.0,
        "voltage_jumps": 0.05,
        "saturated": 0.0,
        "flow_limit": 45.0,
        "friction_force": 120.0,
    }
    t = np.arange(0, 10, 0.004)
    return row, {"time": t.tolist(), **{n: np.sin(t).tolist() for n in ("smoothed", "force")}}


def chain(case: preview.runs.Case) -> tuple[Row, Row]:
    """Metrics and signals of the preview chain on a flat road."""
    t = np.arange(0, 3, 0.005)
    if case.preview == "generated":
        signals = {n: t.tolist() for n in ("x", "map", "road", "load")}
        return {"front": 1.651, "offsets": [0.0, 0.0]}, signals
    row = {
        "front": 1.651,
        "ahead": 2.1,
        "resolution": 0.01,
        "lowest": 0.0,
        "highest": 0.0,
        "spread": [1e-3] * 5,
        "rate_error": 0.01,
    }
    names = ("time", "x", "range", "true", "true rate", "buffered", "rate", "preview valid")
    return row, {n: t.tolist() for n in names}


PARTS: dict[type, Callable[[Any], tuple[Row, Row]]] = {
    Case: vehicle,
    tracking.runs.Case: corner,
    preview.runs.Case: chain,
}


def metric(name: str, value: float, **where: object) -> Change:
    """Another metric of runs whose case has these fields."""

    def change(run: Case, row: Row) -> None:
        if all(getattr(run, field) == value for field, value in where.items()):
            row[name] = value

    return change


watts = partial(metric, "absorbed_power")
"""The absorbed power [W] of runs whose case has these fields."""


def is_finer(run: Case) -> bool:
    return run.exchange_parts != 1 or run.solver_parts != 1
