"""Paper 001, force tracking: one corner of the standing HMMWV follows forces that are given to it (Figures 1.4 and 1.8).

`TrackingBench` wires the FMUs and runs them, `tracking_study` makes all runs, `tracking_claims` judges them and
`tracking_section` lays them out for the report of the experiment ``hmmwv``.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from cosim import PythonComponent, Recording, System, UnconnectedInputsWarning
from cosim.component import Array
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from cosim.experiments.hmmwv_wiring import CONTROL_PERIOD, EXCHANGE, LITRES_PER_MINUTE
from cosim.experiments.store import RunStore
from cosim.report import Band, Claims, Figure, Panel, Section, Series, Table
from cosim.report.model import Color, Dash, Scalar
from fmu_sources.vehicles import load_actuator

Row = dict[str, Any]

NOISE = 50.0  # N, assumed noise of a load cell
AMPLITUDE = 2000.0  # N, of all signals
SQUARE_FREQUENCY = 1.0  # Hz
SWEEP = (1.0, 10.0)  # Hz
SWEEP_DURATION = 10.0  # s
SQUARE_DURATION = 4.0  # s
SETTLING = 0.5  # s at the start that do not count
EARLY, LATE = (0.5, 1.0), (3.5, 4.0)  # s, between which the error of a stable loop falls behind a step
QUIET = 0.01  # of the amplitude: error below which a loop is stable without falling any more
FILTER_TIME = 0.06  # s of Figure 1.4
DENSITIES = (0.7, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15, 1.2, 1.25, 1.3)  # in the controller, relative
LEAKAGES = (0.0, 1.0, 2.0, 5.0)  # in the controller, relative
ACTUATORS = {
    "paper": ("HydraulicActuator", "ForceTracking"),
    "physical": ("HydraulicActuatorPhysical", "ForceTrackingPhysical"),
}


def square(t: float) -> float:
    """+-2 kN at 1 Hz [N]."""
    return AMPLITUDE if math.floor(2 * SQUARE_FREQUENCY * t + 1e-9) % 2 == 0 else -AMPLITUDE


def sweep(t: float) -> float:
    """Sine of 2 kN [N] whose frequency rises from 1 to 10 Hz in 10 s."""
    low, high = SWEEP
    return AMPLITUDE * math.sin(2 * math.pi * (low * t + (high - low) * t * t / (2 * SWEEP_DURATION)))


def step(t: float) -> float:  # noqa: ARG001
    """2 kN from the start on [N]."""
    return AMPLITUDE


SIGNALS: dict[str, tuple[Callable[[float], float], float, float]] = {  # function of time, sample time [s], length [s]
    "square": (square, 1e-3, SQUARE_DURATION),
    "sweep": (sweep, 1e-3, SWEEP_DURATION),
    "discrete sweep": (sweep, CONTROL_PERIOD, SWEEP_DURATION),
    "step": (step, 1e-3, LATE[1]),
}
PUBLISHED = ("square", "sweep", "discrete sweep")  # signals of Figure 1.8
RISE_MS = 27.0  # of the filter (1.16), section 1.3
FOLLOWS = 0.10  # rms error over rms desired force; ours
NEEDLESS = 0.05  # larger rms error up to which the notches are not needed; ours


class ForceSignal(PythonComponent):
    """A desired force over time, sampled and held."""

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
class TrackingCase:
    """One run. ``controller`` are changed parameters of the force tracking FMU; densities and leakages in it are relative to
    the actuator's. ``order`` is how car and actuator exchange: "gauss-seidel" (car first) or "jacobi"."""

    signal: str = "square"
    controller: tuple[tuple[str, float | bool], ...] = ()
    actuator: str = "paper"
    friction: bool = True
    exchange: str = EXCHANGE
    extrapolate: bool = True
    order: str = "gauss-seidel"
    noise: float = 0.0  # N, standard deviation of the load cell's noise at 1 kHz

    def __post_init__(self) -> None:
        check_choice("signal", self.signal, SIGNALS)
        check_choice("actuator", self.actuator, ACTUATORS)
        check_choice("order", self.order, ("gauss-seidel", "jacobi"))
        if not self.noise >= 0:
            raise CaseError(f"noise {self.noise:g} N: give 0 or more")
        for name, value in self.controller:
            if name in _RELATIVE and not value >= 0:
                raise CaseError(f"{name} relative to the actuator's must be positive, it is {value:g}")

    @property
    def duration(self) -> float:
        """Length of the run [s]."""
        return SIGNALS[self.signal][2]

    def fmus(self) -> list[str]:
        """Names of the FMUs of this run."""
        return ["QuarterCarHmmwv", *ACTUATORS[self.actuator]]


_RELATIVE = ("fluid.density", "cylinder.leakage")


class TrackingBench:
    """Runs of one corner; finished ones are taken from the store, if there is one."""

    def __init__(self, fmus: FmuSet, store: RunStore | None = None) -> None:
        self.fmus = fmus
        self.store = store

    def wire(self, case: TrackingCase) -> System:
        """Quarter car on a flat road at rest, actuator, force tracking, and the signal."""
        actuator, tracking = ACTUATORS[case.actuator]
        function, period, _ = SIGNALS[case.signal]
        system = System()
        system.add("signal", ForceSignal(function), step=period)
        system.add(
            "car", self.fmus.path("QuarterCarHmmwv"), step=case.exchange,
            parameters={"friction.acting": case.friction}, start={"road.height": 0.0, "road.rate": 0.0},
        )  # fmt: skip
        system.add("actuator", self.fmus.path(actuator), step=case.exchange, start={"bypass.area": 0.0})
        system.add("tracking", self.fmus.path(tracking))
        believed = system["tracking"].description.parameters
        for name, value in case.controller:
            system["tracking"].set({name: value * believed[name].start if name in _RELATIVE else value})
        system.connect("signal.force", "tracking.force.desired")
        connect_corner(system, case.order, extrapolate=case.extrapolate)
        if case.noise:
            system.add("cell", LoadCell(), parameters={"noise": case.noise})
            system.disconnect("tracking.force.measured")
            system.connect("actuator.force", "cell.force")
            system.connect("cell.measured", "tracking.force.measured")
        return system

    def record(self, case: TrackingCase) -> Recording:
        """Run a case; signals at 1 kHz."""
        with self.wire(case) as system:
            return system.run(case.duration, record=_RECORDED, record_interval="1 ms")

    def measure(self, case: TrackingCase) -> Row:
        """Metrics of a case as JSON values; stored if possible."""
        return self._stored(["tracking", asdict(case)], lambda: evaluate(self.record(case)))

    def history(self, case: TrackingCase) -> Row:
        """Desired force, force and flow over time as JSON values; stored if possible."""

        def signals() -> Row:
            recording = self.record(case)
            columns = {"time": recording.time, **{n: recording[n] for n in _RECORDED}}
            return {n: [float(f"{x:.6g}") for x in v[::4]] for n, v in columns.items()}

        return self._stored(["tracking history", asdict(case)], signals)

    def filter_step(self) -> Row:
        """Answer of the smoothing filter (1.16) to a unit step, from the force tracking FMU alone; JSON values."""

        def response() -> Row:
            system = System()
            system.add("tracking", self.fmus.path("ForceTracking"), start={"force.desired": 1.0})
            with system, warnings.catch_warnings():
                warnings.simplefilter("ignore", UnconnectedInputsWarning)
                recording = system.run(1.0, record=["tracking.force.smoothed"], record_interval="1 ms")
            return {"time": recording.time.tolist(), "force": recording["tracking.force.smoothed"].tolist()}

        return self._stored(["filter step"], response)

    def _stored(self, key: list[Any], compute: Callable[[], Row]) -> Row:
        return compute() if self.store is None else self.store.get(key, compute)


_RECORDED = [
    "tracking.force.smoothed",
    "actuator.force",
    "actuator.flow",
    "tracking.valve.voltage",
    "tracking.saturated",
]


def connect_corner(system: System, order: str = "gauss-seidel", *, extrapolate: bool = True) -> None:
    """Wire ``car`` (a quarter car), ``actuator`` and ``tracking``; what asks for the force is up to the caller.

    The oil column between car and actuator is stiff (44 MN/m): they advance one after the other, the car first. Values
    of the middle of each step (``extrapolate``) make the exchange of second order; without them the force lags by half of an exchange
    step, which at 0.5 ms costs as much tracking error as the law itself.
    """
    system.connect("actuator.force", "car.force", extrapolate=extrapolate)
    system.connect("car.suspension.velocity", "actuator.piston.velocity", extrapolate=extrapolate)
    system.connect("actuator.force", "tracking.force.measured")
    system.connect("actuator.spool.position", "tracking.spool.position")
    system.connect("car.suspension.velocity", "tracking.piston.velocity")
    system.connect("tracking.valve.voltage", "actuator.valve.voltage")
    system.group("strut", ["car", "actuator"], "jacobi" if order == "jacobi" else "gauss-seidel")


def evaluate(recording: Recording) -> Row:
    """Metrics of a run, without its first half second.

    ``error`` is the rms of force minus smoothed desired force over the rms of the latter. ``early`` and ``late`` are the rms of
    the error from 0.5 to 1 s and from 3.5 to 4 s, over the amplitude: behind a step they tell whether it dies away.
    ``voltage_jumps`` is the standard deviation of the change [V] of the valve's command from sample to sample.
    """
    time = recording.time
    counts = time >= SETTLING
    desired, force = recording["tracking.force.smoothed"], recording["actuator.force"]
    error = force - desired

    def within(span: tuple[float, float]) -> float:
        return _rms(error[(time >= span[0]) & (time <= span[1])]) / AMPLITUDE

    return {
        "error": _rms(error[counts]) / _rms(desired[counts]),
        "error_peak": float(np.abs(error[counts]).max()),
        "early": within(EARLY),
        "late": within(LATE),
        "flow_peak": float(np.abs(recording["actuator.flow"][counts]).max() * LITRES_PER_MINUTE),
        "voltage_peak": float(np.abs(recording["tracking.valve.voltage"][counts]).max()),
        "voltage_jumps": float(np.std(np.diff(recording["tracking.valve.voltage"][counts]))),
        "saturated": float(recording["tracking.saturated"][counts].mean()),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


# ------------------------------------------------------------------------------------------------------------- study

VARIANTS: dict[str, TrackingCase] = {
    "as published: difference (1.15), no average": TrackingCase(),
    "rate by the filter (1.13)": TrackingCase(controller=(("rate.numerical", False),)),
    "average (1.14) on": TrackingCase(controller=(("average.enabled", True),)),
    "load cell with noise": TrackingCase(noise=NOISE),
    "load cell with noise, average (1.14) on": TrackingCase(controller=(("average.enabled", True),), noise=NOISE),
    "no integral term": TrackingCase(controller=(("lambda_1", 0.0),)),
    "integral term 1/s": TrackingCase(controller=(("lambda_1", 1.0),)),
    "notches at heave/pitch and roll on": TrackingCase(
        controller=(("notch.heave_pitch.enabled", True), ("notch.roll.enabled", True))
    ),
    "density of real oil, plant and controller": TrackingCase(actuator="physical"),
    "suspension without friction": TrackingCase(friction=False),
    "plain exchange, 0.5 ms": TrackingCase(extrapolate=False),
    "plain exchange, 0.25 ms": TrackingCase(extrapolate=False, exchange="0.25 ms"),
    "exchange 0.25 ms": TrackingCase(exchange="0.25 ms"),
}


@dataclass
class TrackingStudy:
    """All runs: metrics by case, signals over time of the published law, and the filter's step response."""

    rows: dict[TrackingCase, Row] = field(default_factory=dict)
    histories: dict[str, Row] = field(default_factory=dict)  # by signal
    filter_step: Row = field(default_factory=dict)

    def error(self, case: TrackingCase) -> float:
        """Relative rms error of a case."""
        return float(self.rows[case]["error"])


def robustness_case(signal: str, density: float, leakage: float) -> TrackingCase:
    """The controller believes in another density and leakage (relative) than the actuator has."""
    changes = (("fluid.density", density), ("cylinder.leakage", leakage))
    return TrackingCase(signal, tuple((n, v) for n, v in changes if v != 1.0))


def all_cases() -> list[TrackingCase]:
    """What the study measures."""
    cases = [replace(case, signal=signal) for case in VARIANTS.values() for signal in PUBLISHED]
    cases += [robustness_case(s, d, k) for s in ("square", "step") for d in DENSITIES for k in LEAKAGES]
    return list(dict.fromkeys(cases))


def tracking_study(
    fmus: FmuSet,
    store: RunStore | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    cases: Sequence[TrackingCase] | None = None,
) -> TrackingStudy:
    """Make all runs (or those of ``cases``); ``progress`` is told how many are done."""
    bench, study = TrackingBench(fmus, store), TrackingStudy()
    wanted = all_cases() if cases is None else list(cases)
    total = len(wanted) + len(PUBLISHED) + 1
    progress(0, total)
    study.filter_step = bench.filter_step()
    progress(1, total)
    for done, signal in enumerate(PUBLISHED, start=2):
        study.histories[signal] = bench.history(TrackingCase(signal))
        progress(done, total)
    for done, case in enumerate(wanted, start=2 + len(PUBLISHED)):
        study.rows[case] = bench.measure(case)
        progress(done, total)
    return study


def filter_figures(study: TrackingStudy) -> dict[str, float]:
    """Rise from 10 to 90 % [s], first time at 1 [s] and frequency of half the power [Hz] of the smoothing filter."""
    t, y = (np.asarray(study.filter_step[k]) for k in ("time", "force"))

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


def is_stable(study: TrackingStudy, density: float, leakage: float) -> bool:
    """Whether the error behind a step dies away (at least halves), with another density and leakage in the controller."""
    row = study.rows[robustness_case("step", density, leakage)]
    return bool(row["late"] < max(QUIET, row["early"] / 2))


def largest_stable_density(study: TrackingStudy, leakage: float = 1.0) -> float | None:
    """Largest relative density of the study up to which the loop is stable; None when the lowest is not."""
    stable = [d for i, d in enumerate(DENSITIES) if all(is_stable(study, x, leakage) for x in DENSITIES[: i + 1])]
    return stable[-1] if stable else None


# ------------------------------------------------------------------------------------------------------------ report


def tracking_claims(study: TrackingStudy) -> Claims:
    """What the paper says of its force tracking, judged by these runs."""
    claims = Claims()
    claim = claims.judge

    figures = filter_figures(study)
    crossing, rise = 1e3 * figures["crossing"], Band.around(RISE_MS)
    claim(
        "tracking-filter",
        "The filter of the desired force rises in about 27 ms",
        "approximately 27 ms",
        f"first at its final value after {crossing:.1f} ms; 10 to 90 % in {1e3 * figures['rise']:.1f} ms",
        crossing in rise,
        "more than 10 % off",
        "Figure 1.4",
        crossing,
        "ms",
        band=rise,
        criterion="time until the step response is first at its final value",
        fitted="the paper does not define its rise time; of the usual definitions this one is the nearest to its figure",
    )
    base = {s: study.error(TrackingCase(s)) for s in PUBLISHED}
    for signal in PUBLISHED:
        claims.check(
            f"tracking-{signal.replace(' ', '-')}",
            f"The force follows a {'filtered square wave' if signal == 'square' else signal + ' from 1 to 10 Hz'}",
            "follows; the paper shows curves and gives no error",
            f"{100 * base[signal]:.1f} % rms of the smoothed desired force",
            base[signal] <= FOLLOWS,
            f"above {100 * FOLLOWS:g} % rms",
            "Figure 1.8",
            100 * base[signal],
            "%",
            criterion=f"rms of force minus smoothed desired force at most {100 * FOLLOWS:g} % of the rms of the latter, without the first 0.5 s",
        )
    filtered = {s: study.error(TrackingCase(s, (("rate.numerical", False),))) for s in PUBLISHED}
    claim(
        "tracking-difference",
        "The difference (1.15) works better than the filter (1.13)",
        "better",
        ", ".join(f"{s} {100 * base[s]:.1f} against {100 * filtered[s]:.1f} %" for s in PUBLISHED),
        all(base[s] < filtered[s] for s in PUBLISHED),
        "it does not for every signal",
        "section 1.3",
        filtered["square"] / base["square"],
        "-",
        criterion="smaller rms error under every signal of Figure 1.8; the paper gives no size",
    )
    averaged = {s: study.error(TrackingCase(s, (("average.enabled", True),))) for s in PUBLISHED}
    noisy = [study.rows[VARIANTS["load cell with noise" + also]] for also in ("", ", average (1.14) on")]
    claim(
        "tracking-average",
        "The averaging filter (1.14) improves the performance of the controller",
        "improved",
        ", ".join(f"{s} {100 * averaged[s]:.0f} instead of {100 * base[s]:.1f} %" for s in PUBLISHED),
        all(averaged[s] <= base[s] for s in PUBLISHED),
        "it adds 1.5 ms of delay, too much for these gains. It does what it is there for: with a load cell whose noise is "
        f"{NOISE:g} N the command's jumps fall from {1e3 * noisy[0]['voltage_jumps']:.0f} to "
        f"{1e3 * noisy[1]['voltage_jumps']:.0f} mV from sample to sample; without it that noise costs little "
        f"({100 * noisy[0]['error']:.1f} % on the square wave)",
        "section 1.3",
        averaged["square"] / base["square"],
        "-",
        criterion="no larger rms error under any signal of Figure 1.8",
    )
    notched = {s: study.error(replace(VARIANTS["notches at heave/pitch and roll on"], signal=s)) for s in PUBLISHED}
    claim(
        "tracking-notches",
        "Filters at the modes of the body turn out to be unnecessary",
        "not needed",
        ", ".join(f"{s} {100 * base[s]:.1f} without, {100 * notched[s]:.1f} % with" for s in PUBLISHED),
        all(base[s] <= (1 + NEEDLESS) * notched[s] for s in PUBLISHED),
        f"they improve the tracking by more than {100 * NEEDLESS:g} %",
        "section 1.3",
        notched["square"] / base["square"],
        "-",
        criterion=f"rms error without them at most {100 * NEEDLESS:g} % above that with them, under every signal of Figure 1.8: half of the 10 % that "
        "count as the same figure",
    )
    return claims


def tracking_section(study: TrackingStudy) -> Section:
    """Text, figures and tables of the force tracking for the report."""
    figures = filter_figures(study)
    limits = {k: largest_stable_density(study, k) for k in LEAKAGES}
    words = {0.0: "no leakage", 1.0: "the right leakage"}
    margins = ", ".join(
        f"{'none' if d is None else f'{d:g}'} with {words.get(k, f'{k:g} times the leakage')}"
        for k, d in limits.items()
    )
    off = {d: study.error(robustness_case("square", d, 1.0)) for d in (0.95, 1.05)}
    flows = {s: study.rows[TrackingCase(s)]["flow_peak"] for s in PUBLISHED}
    plain, finer, base, fine = (
        study.error(VARIANTS[n])
        for n in ("plain exchange, 0.5 ms", "plain exchange, 0.25 ms", next(iter(VARIANTS)), "exchange 0.25 ms")
    )
    rows: list[list[Scalar]] = [
        [
            name,
            *(round(100 * study.error(replace(case, signal=s)), 1) for s in PUBLISHED),
            round(study.rows[case]["flow_peak"], 1),
            round(study.rows[case]["voltage_peak"], 2),
            round(1e3 * study.rows[case]["voltage_jumps"], 0),
        ]
        for name, case in VARIANTS.items()
    ]
    pump = load_actuator("actuator_hmmwv").supply.flow_limit.value * LITRES_PER_MINUTE
    return Section(
        "Force tracking",
        [
            "One corner of the standing vehicle: quarter car with 120 N of friction, hydraulic actuator, and the force tracking "
            "controller every millisecond. It knows neither the car nor the friction.",
            f"The filter of the desired force rises from 10 to 90 % in {1e3 * figures['rise']:.1f} ms, is first at its final value "
            f"after {1e3 * figures['crossing']:.1f} ms, and lets half of the power through at {figures['bandwidth']:.1f} Hz.",
            f"The flow peaks at {flows['square']:.0f} l/min under the square wave and {flows['sweep']:.0f} l/min under the sweep; the pump "
            f"has {pump:g} l/min.",
            "The law inverts the actuator and takes the motion of the piston out by its flow, so it must know the actuator. Too high a density (or too "
            "small a valve) in the controller takes out too much, which feeds the motion of the car: negative damping. Too "
            "high a leakage is positive feedback of the force. Largest density in the controller, relative to the actuator's, "
            f"of those tried, with which the error behind a step dies away: {margins}. Being 5 % off costs a lot already: "
            f"{100 * off[0.95]:.0f} % rms below and {100 * off[1.05]:.0f} % above instead of {100 * base:.1f} %.",
            f"Car and actuator exchange the values of the middle of each step of {EXCHANGE}. Halving the step moves the error from "
            f"{100 * base:.2f} to {100 * fine:.2f} %. In a plain exchange, each with the other's last value, the force lags by half of a step: "
            f"{100 * plain:.1f} % at {EXCHANGE}, {100 * finer:.1f} % at half of it.",
        ],
        figures=[_filter_figure(study), _tracking_figure(study), _robustness_figure(study)],
        tables=[
            Table(
                "force-tracking",
                "Force tracking and its variants",
                [
                    "variant", "square [% rms]", "sweep [% rms]", "discrete sweep [% rms]", "flow peak, square [l/min]",
                    "voltage peak, square [V]", "voltage jumps, square [mV]",
                ],
                rows,
                "Error: rms of force minus smoothed desired force, over the rms of the latter, without the first 0.5 s. "
                f"Noise of the load cell: {NOISE:g} N, assumed. Jumps: standard deviation of the change of the command per millisecond.",
            )
        ],
    )  # fmt: skip


def _filter_figure(study: TrackingStudy) -> Figure:
    t, y = (np.asarray(study.filter_step[k]) for k in ("time", "force"))
    shown = t <= FILTER_TIME
    return Figure(
        "figure-1-4",
        "Figure 1.4: step response of the filter of the desired force",
        "From the force tracking FMU.",
        [
            Panel(
                "",
                "time [ms]",
                "force over desired force [-]",
                [
                    Series("asked for", [0, 1e3 * FILTER_TIME], [1, 1], color="grey", dash="dash"),
                    Series("desired, smoothed", 1e3 * t[shown], y[shown], color="black"),
                ],
            )
        ],
    )


def _tracking_figure(study: TrackingStudy) -> Figure:
    panels = []
    for signal in PUBLISHED:
        h = study.histories[signal]
        t = np.asarray(h["time"])
        shown = (t >= 1.0) & (t <= 2.5) if signal == "square" else t >= 0
        panels.append(
            Panel(
                signal,
                "time [s]",
                "force [N]",
                [
                    Series(
                        "desired, smoothed", t[shown], np.asarray(h["tracking.force.smoothed"])[shown], color="black"
                    ),
                    Series("actuator", t[shown], np.asarray(h["actuator.force"])[shown], color="vermilion"),
                ],
            )
        )
    return Figure(
        "figure-1-8",
        "Figure 1.8: force tracking",
        "Filtered square wave, sweep from 1 to 10 Hz, and the same sweep sampled every 30 ms.",
        panels,
    )


def _robustness_figure(study: TrackingStudy) -> Figure:
    looks: list[tuple[Color, Dash]] = [("black", "solid"), ("blue", "dash"), ("orange", "dot"), ("green", "dashdot")]

    def curve(signal: str, key: str, leakage: float, i: int) -> Series:
        rows = [study.rows[robustness_case(signal, d, leakage)] for d in DENSITIES]
        name = "no leakage" if leakage == 0 else f"leakage x {leakage:g}"
        color, dash = looks[i]
        return Series(name, DENSITIES, [100 * r[key] for r in rows], color=color, dash=dash, mode="line+markers")

    return Figure(
        "tracking-robustness",
        "Robustness of the force tracking",
        "Another density and leakage in the controller than in the actuator. Left: the square wave. Right: what is left of the error "
        "3.5 s behind a step; in an unstable loop it grows until the valve saturates.",
        [
            Panel(
                title,
                "density in the controller over that of the actuator [-]",
                label,
                [curve(signal, key, leakage, i) for i, leakage in enumerate(LEAKAGES)],
                y_scale="log",
            )
            for title, label, signal, key in (
                ("square wave", "error [% rms]", "square", "error"),
                ("behind a step", "late error [% of 2 kN]", "step", "late"),
            )
        ],
        columns=2,
    )
