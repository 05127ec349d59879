"""Force tracking as a section of the report: text, figures and tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.experiments.hmmwv.tracking.claims import errors
from cosim.experiments.hmmwv.tracking.published import (
    DENSITIES,
    LEAKAGES,
    NOISE,
    PUBLISHED,
    VARIANTS,
    error,
    largest_stable_density,
    robustness_case,
)
from cosim.experiments.hmmwv.tracking.runs import FILTER, Case
from cosim.experiments.hmmwv.wiring import EXCHANGE
from cosim.report import Figure, Panel, Section, Series, Table
from cosim.report.model import Color, Dash, Scalar
from cosim.study import Results

FILTER_TIME = 0.06  # s of Figure 1.4


def section(study: Results) -> Section:
    """Force tracking."""
    limits = {k: largest_stable_density(study, k) for k in LEAKAGES}
    words = {0.0: "no leakage", 1.0: "the right leakage"}
    margins = ", ".join(
        f"{'none' if d is None else f'{d:g}'} with {words.get(k, f'{k:g} times the leakage')}"
        for k, d in limits.items()
    )
    off = [error(study, robustness_case("square", d, 1.0)) for d in (0.95, 1.05)]
    flows = {s: study[Case(s)]["flow_peak"] for s in PUBLISHED}
    plain, finer, fine = (
        errors(study, n)["square"] for n in ("plain exchange, 0.5 ms", "plain exchange, 0.25 ms", "exchange 0.25 ms")
    )
    base, step, about = errors(study)["square"], study[Case(FILTER)], study[Case()]
    return Section(
        "Force tracking",
        [
            (
                f"One corner of the standing vehicle: quarter car with {about['friction_force']:g} N of friction,"
                " hydraulic actuator, and the force tracking controller every millisecond. It knows neither the car"
                " nor the friction."
            ),
            (
                f"The filter of the desired force rises from 10 to 90 % in {1e3 * step['rise']:.1f} ms, is first at its"
                f" final value after {1e3 * step['crossing']:.1f} ms, and lets half of the power through at"
                f" {step['bandwidth']:.1f} Hz."
            ),
            (
                f"The flow peaks at {flows['square']:.0f} l/min under the square wave and {flows['sweep']:.0f} l/min"
                f" under the sweep; the pump has {about['flow_limit']:g} l/min."
            ),
            (
                "The controller inverts the actuator and takes the motion of the piston out by its flow, so it must"
                " know the actuator. Too high a density (or too small a valve) in the controller takes"
                " out too much, which feeds the motion of the car: negative damping. Too high a leakage"
                " is positive feedback of the force."
                " Largest density in the controller, relative to the actuator's, of those tried, with which the error"
                f" after a step dies away: {margins}. Being 5 % off costs a lot already: {100 * off[0]:.0f} % rms below"
                f" and {100 * off[1]:.0f} % above instead of {100 * base:.1f} %."
            ),
            (
                f"Car and actuator exchange the values of the middle of each step of {1e3 * EXCHANGE:g} ms. Halving the"
                f" step moves the error from {100 * base:.2f} to {100 * fine:.2f} %. In a plain exchange, each with the"
                f" other's last value, the force lags by half of a step: {100 * plain:.1f} % at {1e3 * EXCHANGE:g} ms,"
                f" {100 * finer:.1f} % at half of it."
            ),
        ],
        figures=[_filter_figure(study), _tracking_figure(study), _robustness_figure(study)],
        tables=[_variants(study)],
    )


def _variants(study: Results) -> Table:
    rows: list[list[Scalar]] = [
        [
            name,
            *(round(100 * error(study, replace(case, signal=s)), 1) for s in PUBLISHED),
            round(study[case]["flow_peak"], 1),
            round(study[case]["voltage_peak"], 2),
            round(1e3 * study[case]["voltage_jumps"], 0),
        ]
        for name, case in VARIANTS.items()
    ]
    return Table(
        "force-tracking",
        "Force tracking and its variants",
        [
            "variant",
            "square [% rms]",
            "sweep [% rms]",
            "discrete sweep [% rms]",
            "flow peak, square [l/min]",
            "voltage peak, square [V]",
            "voltage jumps, square [mV]",
        ],
        rows,
        "Error: rms of force minus smoothed desired force, over the rms of the latter, without the first 0.5 s. Noise"
        f" of the load cell: {NOISE:g} N, assumed. Jumps: standard deviation of the change of the command per"
        " millisecond.",
    )


def _filter_figure(study: Results) -> Figure:
    t, y = (np.asarray(study.signals(Case(FILTER))[k]) for k in ("time", "smoothed"))
    shown = t <= FILTER_TIME
    curves = [
        Series("requested", [0, 1e3 * FILTER_TIME], [1, 1], color="gray", dash="dash"),
        Series("desired, smoothed", 1e3 * t[shown], y[shown], color="black"),
    ]
    return Figure(
        "figure-1-4",
        "Step response of the filter of the desired force (figure 1.4 of the paper)",
        "From the force tracking FMU.",
        [Panel("", "time [ms]", "force over desired force [-]", curves)],
    )


def _tracking_figure(study: Results) -> Figure:
    panels = []
    for signal in PUBLISHED:
        t, desired, force = (np.asarray(study.signals(Case(signal))[k]) for k in ("time", "smoothed", "force"))
        shown = (t >= 1.0) & (t <= 2.5) if signal == "square" else t >= 0
        curves = [
            Series("desired, smoothed", t[shown], desired[shown], color="black"),
            Series("actuator", t[shown], force[shown], color="vermilion"),
        ]
        panels.append(Panel(signal, "time [s]", "force [N]", curves))
    return Figure(
        "figure-1-8",
        "Force tracking (figure 1.8 of the paper)",
        "Filtered square wave, sweep from 1 to 10 Hz, and the same sweep sampled every 30 ms.",
        panels,
    )


def _robustness_figure(study: Results) -> Figure:
    looks: list[tuple[Color, Dash]] = [("black", "solid"), ("blue", "dash"), ("orange", "dot"), ("green", "dashdot")]

    def curve(signal: str, key: str, leakage: float, look: tuple[Color, Dash]) -> Series:
        rows = [study[robustness_case(signal, d, leakage)] for d in DENSITIES]
        name = "no leakage" if leakage == 0 else f"leakage x {leakage:g}"
        return Series(name, DENSITIES, [100 * r[key] for r in rows], color=look[0], dash=look[1], mode="line+markers")

    return Figure(
        "tracking-robustness",
        "Robustness of the force tracking",
        "Another density and leakage in the controller than in the actuator. Left: the square wave. Right: what is left"
        " of the error 3.5 s after a step; in an unstable loop it grows until the valve saturates.",
        [
            Panel(
                title,
                "density in the controller over that of the actuator [-]",
                label,
                [curve(signal, key, leakage, look) for leakage, look in zip(LEAKAGES, looks, strict=True)],
                y_scale="log",
            )
            for title, label, signal, key in (
                ("square wave", "error [% rms]", "square", "error"),
                ("after a step", "late error [% of 2 kN]", "step", "late"),
            )
        ],
        columns=2,
    )
