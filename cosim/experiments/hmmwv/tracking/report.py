"""Force tracking as a section of the report: text, figures and tables."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cosim.experiments.hmmwv.tracking import published
from cosim.experiments.hmmwv.tracking.claims import errors
from cosim.experiments.hmmwv.tracking.published import DENSITIES, LEAKAGES, PUBLISHED, error, robustness_case
from cosim.experiments.hmmwv.tracking.runs import FILTER, Case
from cosim.experiments.hmmwv.wiring import EXCHANGE
from cosim.report import Figure, Panel, Series, Table, curve
from cosim.study import Content, Results

FILTER_TIME = 0.06  # s of Figure 1.4


def section(study: Results) -> Content:
    """Force tracking."""
    words = {0.0: "no leakage", 1.0: "the right leakage"}
    limits = {words.get(k, f"{k:g} times the leakage"): published.largest_stable_density(study, k) for k in LEAKAGES}
    margins = ", ".join(f"{'none' if d is None else f'{d:g}'} with {leakage}" for leakage, d in limits.items())
    below, above = (100 * error(study, robustness_case("square", d, 1.0)) for d in (0.95, 1.05))
    flows = {s: study[Case(s)]["flow_peak"] for s in PUBLISHED}
    base = 100 * errors(study)["square"]
    plain, finer, fine = (
        100 * errors(study, n)["square"]
        for n in ("plain exchange, 0.5 ms", "plain exchange, 0.25 ms", "exchange 0.25 ms")
    )
    step, about = study[Case(FILTER)], study[Case()]
    yield f"""One corner of the standing vehicle: quarter car with {about["friction_force"]:g} N of friction, hydraulic
    actuator, and the force tracking controller every millisecond. It knows neither the car nor the friction.

    The filter of the desired force rises from 10 to 90 % in {1e3 * step["rise"]:.1f} ms, is first at its final value
    after {1e3 * step["crossing"]:.1f} ms, and lets half of the power through at {step["bandwidth"]:.1f} Hz.

    The flow peaks at {flows["square"]:.0f} l/min under the square wave and {flows["sweep"]:.0f} l/min under the sweep;
    the pump has {about["flow_limit"]:g} l/min.

    The controller inverts the actuator and takes the motion of the piston out by its flow, so it must know the
    actuator. Too high a density (or too small a valve) in the controller takes out too much, which feeds the motion of
    the car: negative damping. Too high a leakage is positive feedback of the force. Largest density in the controller,
    relative to the actuator's, of those tried, with which the error after a step dies away: {margins}. Being 5 % off
    costs a lot already: {below:.0f} % rms below and {above:.0f} % above instead of {base:.1f} %.

    Car and actuator exchange the values of the middle of each step of {1e3 * EXCHANGE:g} ms. Halving the step moves the
    error from {base:.2f} to {fine:.2f} %. In a plain exchange, each with the other's last value, the force lags by half
    of a step: {plain:.1f} % at {1e3 * EXCHANGE:g} ms, {finer:.1f} % at half of it."""
    end = 1e3 * FILTER_TIME
    response = {k: [1e3 * t for t in v] if k == "time" else v for k, v in study.signals(Case(FILTER)).items()}
    curves = [
        Series("requested", [0, end], [1, 1], color="gray", dash="dash"),
        curve("desired, smoothed", response, "smoothed", end=end, color="black"),
    ]
    title = "Step response of the filter of the desired force (figure 1.4 of the paper)"
    panel = Panel("", "time [ms]", "force over desired force [-]", curves)
    yield Figure("figure-1-4", title, "From the force tracking FMU.", [panel])
    panels = []
    for signal in PUBLISHED:
        signals = study.signals(Case(signal))
        window: dict[str, Any] = {"start": 1.0, "end": 2.5} if signal == "square" else {}
        curves = [
            curve("desired, smoothed", signals, "smoothed", color="black", **window),
            curve("actuator", signals, "force", color="vermilion", **window),
        ]
        panels.append(Panel(signal, "time [s]", "force [N]", curves))
    caption = "Filtered square wave, sweep from 1 to 10 Hz, and the same sweep sampled every 30 ms."
    yield Figure("figure-1-8", "Force tracking (figure 1.8 of the paper)", caption, panels)
    yield Figure(
        "tracking-robustness",
        "Robustness of the force tracking",
        "Another density and leakage in the controller than in the actuator. Left: the square wave. Right: what is left"
        " of the error 3.5 s after a step; in an unstable loop it grows until the valve saturates.",
        [
            _robustness(study, "square wave", "error [% rms]", "square", "error"),
            _robustness(study, "after a step", "late error [% of 2 kN]", "step", "late"),
        ],
        columns=2,
    )
    rows = [
        {
            "variant": name,
            **{f"{s} [% rms]": round(100 * error(study, replace(case, signal=s)), 1) for s in PUBLISHED},
            "flow peak, square [l/min]": round(study[case]["flow_peak"], 1),
            "voltage peak, square [V]": round(study[case]["voltage_peak"], 2),
            "voltage jumps, square [mV]": round(1e3 * study[case]["voltage_jumps"], 0),
        }
        for name, case in published.VARIANTS.items()
    ]
    yield Table.of(
        "force-tracking",
        "Force tracking and its variants",
        rows,
        "Error: rms of force minus smoothed desired force, over the rms of the latter, without the first 0.5 s. Noise"
        f" of the load cell: {published.NOISE:g} N, assumed. Jumps: standard deviation of the change of the command per"
        " millisecond.",
    )


def _robustness(study: Results, title: str, label: str, signal: str, metric: str) -> Panel:
    curves = []
    looks = (("black", "solid"), ("blue", "dash"), ("orange", "dot"), ("green", "dashdot"))
    for leakage, (color, dash) in zip(LEAKAGES, looks, strict=True):
        name = "no leakage" if leakage == 0 else f"leakage x {leakage:g}"
        errors = [100 * study[robustness_case(signal, d, leakage)][metric] for d in DENSITIES]
        curves.append(Series(name, DENSITIES, errors, color=color, dash=dash, mode="line+markers"))  # type: ignore[arg-type]
    return Panel(title, "density in the controller over that of the actuator [-]", label, curves, y_scale="log")
