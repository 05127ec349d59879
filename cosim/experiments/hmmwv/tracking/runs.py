"""Runs of one corner: quarter car, hydraulic actuator and force tracking follow a signal; wired and measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cosim import PythonComponent, System
from cosim.core.component import Array
from cosim.core.signals import peak, rms
from cosim.experiments.hmmwv import wiring
from cosim.experiments.hmmwv.wiring import LITRES_PER_MINUTE
from cosim.experiments.options import quantity
from cosim.experiments.steps import Stepped, exchange_step, set_solver_step
from cosim.recording.peaks import peak_index
from cosim.study import CaseError, FmuSet, Metric, Row, Run, fields, option

AMPLITUDE = 2000.0  # N, of all signals
SQUARE_FREQUENCY = 1.0  # Hz
SWEEP = (1.0, 10.0)  # Hz
SWEEP_DURATION = 10.0  # s
SQUARE_DURATION = 4.0  # s
SETTLING = 0.5  # s at the start that do not count
EARLY, LATE = (0.5, 1.0), (3.5, 4.0)  # s, between which the error of a stable loop falls after a step
ACTUATORS = {
    "paper": ("HydraulicActuator", "ForceTracking"),
    "physical": ("HydraulicActuatorPhysical", "ForceTrackingPhysical"),
}
FMUS = ("QuarterCarHmmwv", *(f for pair in ACTUATORS.values() for f in pair))


def square(t: float) -> float:
    """+-2 kN at 1 Hz [N]."""
    return AMPLITUDE if math.floor(2 * SQUARE_FREQUENCY * t + 1e-9) % 2 == 0 else -AMPLITUDE


def sweep(t: float) -> float:
    """Sine of 2 kN [N] whose frequency rises from 1 to 10 Hz in 10 s."""
    low, high = SWEEP
    return AMPLITUDE * math.sin(2 * math.pi * (low * t + (high - low) * t * t / (2 * SWEEP_DURATION)))


FILTER = "filter"  # the filter of the desired force (1.16) alone, without actuator and car
SIGNALS: dict[str, tuple[Callable[[float], float], float, float]] = {  # function of time, sample time [s], length [s]
    "square": (square, 1e-3, SQUARE_DURATION),
    "sweep": (sweep, 1e-3, SWEEP_DURATION),
    "discrete sweep": (sweep, wiring.CONTROL_PERIOD, SWEEP_DURATION),
    "step": (lambda _: AMPLITUDE, 1e-3, LATE[1]),
    FILTER: (lambda _: 1.0, 1e-3, 1.0),
}


class ForceSignal(PythonComponent):
    """A desired force over time, in a zero-order hold."""

    outputs = ("force [N]",)
    kind = "discrete"

    def __init__(self, function: Callable[[float], float]) -> None:
        super().__init__()
        self.function = function

    def start(self, u: Array, y: Array) -> None:  # noqa: ARG002
        y[0] = self.function(0.0)

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        y[0] = self.function(t)


class LoadCell(PythonComponent):
    """A measured force with white noise of a given standard deviation [N]; fixed seed."""

    inputs = ("force [N]",)
    outputs = ("measured [N]",)
    parameters: ClassVar[Mapping[str, Any]] = {"noise": 0.0}
    kind = "discrete"
    default_step = "1 ms"
    noise: float

    def begin(self) -> None:
        self.random = np.random.default_rng(1)

    def start(self, u: Array, y: Array) -> None:
        y[0] = u[0]

    def step(self, t: float, h: float, u: Array, y: Array) -> None:  # noqa: ARG002
        y[0] = u[0] + self.noise * self.random.standard_normal()


@dataclass(frozen=True)
class Case(Stepped):
    """One run: a signal, and what is changed in controller, actuator and exchange."""

    signal: str = option("square", choices=SIGNALS, help="desired force", always=True)
    rate_filter: bool = option(False, help="rate of the force by the filter (1.13) instead of the difference (1.15)")
    average: bool = option(False, help="averaging filter (1.14) on")
    notches: bool = option(False, help="notches at heave/pitch and roll on")
    integral: float | None = quantity(
        "integral [1/s]", None, (0, 100), "integral term lambda_1; by default as in the FMU", label="integral-{:g}"
    )
    density: float = quantity(
        "density", 1.0, (0, 10), "density in the controller over that of the actuator", label="density-{:g}"
    )
    leakage: float = quantity(
        "leakage", 1.0, (0, 100), "leakage in the controller over that of the actuator", label="leakage-{:g}"
    )
    actuator: str = option("paper", choices=ACTUATORS, help="as printed, or with the density of real oil")
    friction: bool = option(True, help="dry friction in the suspension")
    extrapolate: bool = option(True, help="car and actuator see values of the middle of each step")
    order: str = option("gauss-seidel", choices=("gauss-seidel", "jacobi"), help="car before actuator, or both at once")
    noise: float = quantity("noise [N]", 0.0, (0, 1e6), "noise of the load cell at 1 kHz", label="noise-{:g}N")

    def __post_init__(self) -> None:
        super().__post_init__()
        others = [f for f in fields(type(self)) if f.attribute != "signal"]
        if self.signal == FILTER and any(getattr(self, f.attribute) != f.default for f in others):
            raise CaseError(f"the signal {FILTER} runs the filter of the desired force alone, without other options")


def wire(fmus: FmuSet, case: Case) -> System:
    """Quarter car on a flat road at rest, actuator, force tracking, and the signal."""
    actuator, tracking = ACTUATORS[case.actuator]
    function, period, _ = SIGNALS[case.signal]
    system = System(allow_unconnected=True)  # the filter of the desired force runs without actuator and car
    if case.signal == FILTER:
        system.add("tracking", fmus.path(tracking), start={"force.desired": function(0.0)})
        return system
    step = exchange_step(wiring.EXCHANGE, case)
    system.add("signal", ForceSignal(function), step=period)
    system.add(
        "car",
        fmus.path("QuarterCarHmmwv"),
        step=step,
        parameters={"friction.acting": case.friction},
        start={"road.height": 0.0, "road.rate": 0.0},
    )
    system.add("actuator", fmus.path(actuator), step=step, start={"bypass.area": 0.0})
    controller = system.add("tracking", fmus.path(tracking))
    for name, relative in (("fluid.density", case.density), ("cylinder.leakage", case.leakage)):
        controller.set({name: relative * wiring.published(controller, name)})
    for chosen, parameters in (
        (case.integral is not None, {"lambda_1": case.integral}),
        (case.rate_filter, {"rate.numerical": False}),
        (case.average, {"average.enabled": True}),
        (case.notches, {"notch.heave_pitch.enabled": True, "notch.roll.enabled": True}),
    ):
        controller.set(parameters if chosen else {})
    system.connect("signal.force", "tracking.force.desired")
    wiring.connect_corner(system, case.order, extrapolate=case.extrapolate)
    for plant in ("car", "actuator"):
        set_solver_step(system[plant], case)
    if case.noise:
        system.add("cell", LoadCell(), parameters={"noise": case.noise})
        system.disconnect("tracking.force.measured")
        system.connect("actuator.force", "cell.force")
        system.connect("cell.measured", "tracking.force.measured")
    return system


def stop_time(_: System, case: Case) -> float:
    """Length of the run [s]."""
    return SIGNALS[case.signal][2]


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    plant = ["actuator.force", "actuator.flow", "tracking.valve.voltage", "tracking.saturated"]
    return ["tracking.force.smoothed"] + plant * (case.signal != FILTER)


METRICS = {
    "error": Metric("force error, rms over rms of the desired force", "%", 100.0, "{:.2f}"),
    "early": Metric("error from 0.5 to 1 s", "% of 2 kN", 100.0, "{:.2f}"),
    "late": Metric("error from 3.5 to 4 s", "% of 2 kN", 100.0, "{:.2f}"),
    "flow_peak": Metric("flow, largest", "l/min", form="{:.1f}"),
    "voltage_peak": Metric("voltage of the valve, largest", "V", form="{:.2f}"),
    "voltage_jumps": Metric("jumps of the voltage", "mV", 1e3, "{:.0f}"),
    "saturated": Metric("valve saturated", "% of the time", 100.0, "{:.1f}"),
    "rise": Metric("rise of the filter from 10 to 90 %", "ms", 1e3, "{:.1f}"),
    "crossing": Metric("filter first at its final value", "ms", 1e3, "{:.1f}"),
    "bandwidth": Metric("frequency of half the power of the filter", "Hz", form="{:.1f}"),
}


def measure(run: Run) -> Row:
    """Metrics of a run, without its first half second.

    `error` is the rms of force minus smoothed desired force over the rms of the latter. `early` and `late` are
    the rms of the error from 0.5 to 1 s and from 3.5 to 4 s, over the amplitude: after a step they tell whether it dies
    away. `voltage_jumps` is the standard deviation of the change [V] of the valve's command from sample to sample.
    `flow_limit` [l/min] and `friction_force` [N] are those of the FMUs. Of the filter alone see
    `measure_filter`.
    """
    r = run.recording
    desired = r["tracking.force.smoothed"]
    if run.case.signal == FILTER:
        return measure_filter(r.time, desired)
    counts = r.time >= SETTLING
    error = r["actuator.force"] - desired
    voltage = r["tracking.valve.voltage"][counts]

    def within(span: tuple[float, float]) -> float:
        return rms(error[(r.time >= span[0]) & (r.time <= span[1])]) / AMPLITUDE

    return {
        "error": rms(error[counts]) / rms(desired[counts]),
        "early": within(EARLY),
        "late": within(LATE),
        "flow_peak": float(np.abs(r["actuator.flow"][counts]).max() * LITRES_PER_MINUTE),
        "voltage_peak": peak(voltage),
        "voltage_jumps": float(np.std(np.diff(voltage))),
        "saturated": float(r["tracking.saturated"][counts].mean()),
        "flow_limit": LITRES_PER_MINUTE * run.start("actuator.supply.flow_limit"),
        "friction_force": run.start("car.suspension.friction.force"),
    }


def measure_filter(t: np.ndarray, y: np.ndarray) -> Row:
    """Rise from 10 to 90 % [s], first time at 1 [s] and frequency of half the power [Hz] of a step response."""

    def reaches(level: float) -> float:
        i = int(np.argmax(y >= level))
        return float(t[i - 1] + (level - y[i - 1]) / (y[i] - y[i - 1]) * (t[i] - t[i - 1]))

    gain = np.abs(np.fft.rfft(np.diff(y), n=2**16))
    frequencies = np.fft.rfftfreq(2**16, t[1] - t[0])
    return {
        "rise": reaches(0.9) - reaches(0.1),
        "crossing": reaches(1.0),
        "bandwidth": float(frequencies[np.argmax(gain < math.sqrt(0.5))]),
    }


def signals(run: Run) -> Row:
    """Desired force after smoothing, and force, over time [s, N], rounded, and thinned so that peaks are kept.

    The output of the filter keeps every sample.
    """
    r = run.recording
    if run.case.signal == FILTER:
        return {"time": r.time.tolist(), "smoothed": r["tracking.force.smoothed"].tolist()}
    shown = {"time": r.time, "smoothed": r["tracking.force.smoothed"], "force": r["actuator.force"]}
    kept = peak_index([shown["smoothed"], shown["force"]], wiring.SIGNAL_POINTS)
    return {name: [float(f"{x:.6g}") for x in signal[kept]] for name, signal in shown.items()}
