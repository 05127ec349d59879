"""Paper 001: a HMMWV on hydraulic actuators, from the servo valve to what the driver feels.

This module wires the FMUs and runs them; ``hmmwv_study`` lays out the runs behind the figures, ``hmmwv_claims`` judges them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim import Recording, System
from cosim.comfort import absorbed_power_peak, absorbed_power_series, absorbed_power_window, iso2631_rms, vdv
from cosim.experiments import hmmwv_preview, hmmwv_tracking
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from cosim.experiments.hmmwv_wiring import (
    BUMPS,
    CONTROL_PERIOD,
    EXCHANGE,
    FIRST_BUMP,
    FRONT,
    LITRES_PER_MINUTE,
    SPEED_KMH,
    add_actuators,
    add_car,
    add_preview_chain,
    add_sensors,
    bump_parameters,
)
from cosim.experiments.store import RunStore
from cosim.members import Member
from fmu_sources.controllers.hmmwv_states import CORNERS
from fmu_sources.controllers.mpc_hmmwv import PREVIEW_POINTS, MpcHmmwvWeights

Row = dict[str, Any]

ROADS = {"track": "RoadBumps", "bump": "RoadBumps", "off-road": "RoadOffroadHmmwv"}
CONTROLLERS = {
    "passive": None,
    "zero": None,
    "skyhook": "Skyhook",
    "lqr": "LqrHmmwv",
    "lqr-kilonewton": "LqrHmmwvKilonewton",
    "mpc": "MpcHmmwv",
    "mpc-preview": "MpcHmmwv",
}
ACTUATORS = ("hydraulic", "ideal")
STATES = ("true", "estimated")
PREVIEWS = ("generated", "sensed")  # a known profile at the distance travelled, or what the range sensors see
PREVIEW_STEPS = PREVIEW_POINTS - 1  # heights ahead of the one under the wheel, 30 ms apart

SPEED_RANGE_KMH = (5.0, 100.0)
SHIFTS = 6  # places of the first bump within one control period that are averaged over
STRETCHES = 5  # stretches of the off-road profile that do not overlap
STRETCH = 280.0  # m
FLAT, RAMP = 5.0, 10.0  # m, how an off-road run starts
RATE = 1000.0  # Hz, of all metrics
TRAVEL_LIMIT = MpcHmmwvWeights().max_travel  # m, either way: Table 1.3, and where the paper's suspension saturates


@dataclass(frozen=True)
class Case:
    """One run.

    ``variant`` is where the bump lies between two control samples (0..5), or the off-road stretch (0..4); it also seeds the
    noise of the sensors. ``preview``, ``preview_steps`` and ``preview_error_ms`` (positive: the preview shows the road too
    late) matter for MPC with preview only. With ``flow_limit`` the pump gives each actuator ``pump_l_min`` at most (None: what
    the actuator's file says). ``exchange`` is the step of car and actuators, ``solver_parts`` divides their solvers' steps.
    """

    road: str = "track"
    controller: str = "mpc-preview"
    actuators: str = "hydraulic"
    states: str = "true"
    preview: str = "generated"
    speed_kmh: float = SPEED_KMH
    variant: int = 0
    preview_steps: int = PREVIEW_STEPS
    preview_error_ms: float = 0.0
    flow_limit: bool = False
    friction: bool = False
    lift_off: bool = True
    null_opening_mm: float | None = None
    duration: float | None = None  # s; None: until the rear wheels are over the bumps and the car is at rest, or 22 s
    pump_l_min: float | None = None  # l/min, to each actuator
    exchange: str = EXCHANGE
    solver_parts: int = 1

    def __post_init__(self) -> None:
        choices: tuple[tuple[str, Collection[str]], ...] = (
            ("road", ROADS), ("controller", CONTROLLERS), ("actuators", ACTUATORS), ("states", STATES), ("preview", PREVIEWS),
        )  # fmt: skip
        for name, known in choices:
            check_choice(name, getattr(self, name), known)
        low, high = SPEED_RANGE_KMH
        if not low <= self.speed_kmh <= high:
            raise CaseError(f"speed {self.speed_kmh:g} km/h: give {low:g} to {high:g} km/h")
        if not 0 <= self.variant < self.variants:
            raise CaseError(f"variant {self.variant}: there are 0 to {self.variants - 1} on the road {self.road!r}")
        if self.controller == "passive" and self.actuators == "ideal":
            raise CaseError(
                "the passive car is its hydraulic actuators with the pump off, so it has no ideal ones; "
                "the car without actuators is --controller zero --actuators ideal"
            )
        if self.states == "estimated" and CONTROLLERS[self.controller] is None:
            raise CaseError(f"{self.controller} uses no states, so there is nothing to estimate")
        if self.states == "estimated" and self.actuators == "ideal":
            raise CaseError("the estimator measures the force of the hydraulic actuators: --actuators hydraulic")
        chosen = (self.preview, self.preview_steps, self.preview_error_ms)
        if self.controller != "mpc-preview" and chosen != ("generated", PREVIEW_STEPS, 0.0):
            raise CaseError(f"{self.controller} uses no preview; the options of the preview are for mpc-preview")
        if self.preview == "sensed" and self.states == "true":
            raise CaseError("the sensed preview is corrected by the estimated pose: --states estimated")
        if not 1 <= self.preview_steps <= PREVIEW_STEPS:
            raise CaseError(
                f"preview of {self.preview_steps} steps: give 1 to {PREVIEW_STEPS}, or the controller mpc for none"
            )
        if self.preview == "sensed" and self.preview_error_ms:
            raise CaseError("a preview error is for the generated preview; the sensed one has its own")
        if not abs(self.preview_error_ms) <= 200:
            raise CaseError(f"preview error {self.preview_error_ms:g} ms: give -200 to 200 ms")
        if self.null_opening_mm is not None and not 0 < self.null_opening_mm <= 50:
            raise CaseError(f"null opening {self.null_opening_mm:g} mm: give 0 to 50 mm")
        if self.pump_l_min is not None and not (self.flow_limit and 1 <= self.pump_l_min <= 1000):
            raise CaseError(
                f"pump of {self.pump_l_min:g} l/min per actuator: give 1 to 1000 l/min, and with flow_limit"
            )
        if self.solver_parts < 1:
            raise CaseError(f"solver steps in {self.solver_parts} parts: give 1 or more")
        if self.duration is not None and not 0.5 <= self.duration <= self.longest:
            raise CaseError(f"duration {self.duration:g} s: give 0.5 to {self.longest:.1f} s")

    @property
    def variants(self) -> int:
        """How many variants this road has."""
        return STRETCHES if self.road == "off-road" else SHIFTS

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return self.speed_kmh / 3.6

    @property
    def start(self) -> float:
        """Where the CG is at time 0 [m]: 0.6 s before the first bump, or at the start of the flat stretch."""
        return -2.0 if self.road == "off-road" else FIRST_BUMP - FRONT - 0.6 * self.speed

    @property
    def longest(self) -> float:
        """Longest run [s]."""
        return (STRETCH - 10.0 - self.start) / self.speed if self.road == "off-road" else 60.0

    @property
    def stop_time(self) -> float:
        """Length of the run [s]: bumps until 1.5 s behind the last one, off road 22 s unless the stretch is shorter."""
        if self.duration is not None:
            return self.duration
        if self.road == "off-road":
            return min(22.0, self.longest)
        last = FIRST_BUMP + max(BUMPS[self.road]) - 1 + FRONT + 0.5
        return round((last - self.start) / self.speed + 1.5, 1)

    @property
    def label(self) -> str:
        """What tells this run's files from those of others."""
        return "-".join(
            [
                self.road,
                self.controller,
                *["ideal"] * (self.actuators == "ideal"),
                *["estimated"] * (self.states == "estimated"),
                *["sensed"] * (self.preview == "sensed"),
                *[f"{self.preview_steps}steps"] * (self.preview_steps != PREVIEW_STEPS),
                *[f"{self.preview_error_ms:+g}ms"] * (self.preview_error_ms != 0),
                *[f"{self.speed_kmh:g}kmh"] * (self.speed_kmh != SPEED_KMH),
                *[f"variant{self.variant}"] * (self.variant != 0),
                *["flow-limit"] * self.flow_limit,
                *([] if self.pump_l_min is None else [f"{self.pump_l_min:g}lmin"]),
                *[f"exchange-{self.exchange.replace(' ', '')}"] * (self.exchange != EXCHANGE),
                *[f"solver-in-{self.solver_parts}"] * (self.solver_parts != 1),
                *["friction"] * self.friction,
                *["pulling-tyres"] * (not self.lift_off),
            ]
        )

    def fmus(self) -> list[str]:
        """Names of the FMUs of this run."""
        names = ["SpeedProfile", ROADS[self.road], "RideCarHmmwv", "RideComfort"]
        names += [name] if (name := CONTROLLERS[self.controller]) else []
        names += ["HydraulicActuator"] if self.actuators == "hydraulic" else []
        names += ["ForceTracking"] if self.actuators == "hydraulic" and self.controller != "passive" else []
        names += ["SensorSuite", "KalmanHmmwv"] if self.states == "estimated" else []
        names += ["PreviewSensor", "PreviewBuffer"] if self.preview == "sensed" else []
        return names

    @property
    def structure(self) -> tuple[object, ...]:
        """What decides how the system is wired; everything else is a parameter of its FMUs."""
        return (
            self.road, self.controller, self.actuators, self.states, self.preview, self.preview_steps,
            self.preview_error_ms != 0, self.exchange,
        )  # fmt: skip

    @property
    def separate_map(self) -> bool:
        """Whether the generated preview comes from a road of its own, at another distance than the true one."""
        generated = self.controller == "mpc-preview" and self.preview == "generated"
        return generated and (self.states == "estimated" or self.preview_error_ms != 0)


class HmmwvBench:
    """Systems wired once per structure, and run as often as needed."""

    def __init__(self, fmus: FmuSet, store: RunStore | None = None) -> None:
        self.fmus = fmus
        self.store = store
        self._systems: dict[tuple[object, ...], System] = {}

    def system(self, case: Case) -> System:
        """The wired system of a case, with the parameters of this case set."""
        if case.structure not in self._systems:
            self._systems[case.structure] = wire(self.fmus, case)
        system = self._systems[case.structure]
        configure(system, case)
        return system

    def record(self, case: Case, *, progress: bool = False, csv: Path | None = None) -> Recording:
        """Run a case and return its recording at 1 kHz.

        Raises:
            ComponentError: a component failed; ``error.recording`` holds what was recorded.
        """
        system = self.system(case)
        return system.run(case.stop_time, record=recorded(case), record_interval="1 ms", progress=progress, csv=csv)

    def measure(self, case: Case, *, history: bool = False) -> Row:
        """Metrics of a case as JSON values, with its signals over time under ``history`` if wanted; stored if possible."""

        def compute() -> Row:
            recording = self.record(case)
            row = evaluate(case, recording)
            return {**row, "history": signals(case, recording)} if history else row

        return self._stored(["history" if history else "metrics", asdict(case)], compute)

    def _stored(self, key: Any, compute: Callable[[], Row]) -> Row:
        return compute() if self.store is None else self.store.get(key, compute)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


# ---------------------------------------------------------------------- wiring


def wire(fmus: FmuSet, case: Case) -> System:
    """The vehicle of a case: road, car, actuators with their force tracking, controller, comfort."""
    system = System()
    add_car(system, fmus, ROADS[case.road], step=case.exchange)
    system.add("comfort", fmus.path("RideComfort"))
    system.connect_matching("car", "comfort", "body.az")
    controller = CONTROLLERS[case.controller]
    if controller is not None:
        system.add("controller", fmus.path(controller))
    if case.actuators == "ideal":
        if controller is not None:
            system.connect_matching("controller", "car", "force.*")
        else:
            system["car"].set({f"force.{k}": 0.0 for k in CORNERS})
    else:
        driven = case.controller != "passive"
        add_actuators(system, fmus, driven=driven, step=case.exchange)
        if driven:
            _wire_tracking(system, fmus, wanted=controller is not None)
    if case.states == "estimated":
        _wire_estimator(system, fmus)
    if controller is not None:
        system.connect_matching("kalman" if case.states == "estimated" else "car", "controller")
    if controller == "MpcHmmwv":
        _wire_preview(system, fmus, case)
    return system


def _wire_tracking(system: System, fmus: FmuSet, *, wanted: bool) -> None:
    """The force tracking of each actuator; ``wanted``: there is a controller that asks for forces."""
    for k in CORNERS:
        actuator, tracking = f"actuator_{k}", f"tracking_{k}"
        system.add(tracking, fmus.path("ForceTracking"))
        system.connect(f"{actuator}.force", f"{tracking}.force.measured")
        system.connect(f"{actuator}.spool.position", f"{tracking}.spool.position")
        system.connect(f"car.suspension.{k}.velocity", f"{tracking}.piston.velocity")
        system.connect(f"{tracking}.valve.voltage", f"{actuator}.valve.voltage")
        if wanted:
            system.connect(f"controller.force.{k}", f"{tracking}.force.desired")
        else:
            system[tracking].set({"force.desired": 0.0})


def _wire_estimator(system: System, fmus: FmuSet) -> None:
    """Sensors on car, actuators and road, and the Kalman filter behind them."""
    add_sensors(system, fmus)
    system.add("kalman", fmus.path("KalmanHmmwv"), parameters={"use_road": False})
    system.connect_matching("sensors", "kalman")
    system["kalman"].set({**{f"road.{k}.height": 0.0 for k in CORNERS}, "road.valid": False})


def _wire_preview(system: System, fmus: FmuSet, case: Case) -> None:
    """Where the MPC has its preview from. A preview that is cut short goes on at its last height."""
    if case.controller == "mpc":
        system["controller"].set({"use_preview": False, **_flat_preview(system)})
        return
    system["controller"].set({"use_preview": True})
    source = "road"
    if case.preview == "sensed":
        source = "buffer"
        add_preview_chain(system, fmus)
        system["kalman"].set({"use_road": True})
    elif case.separate_map:
        source = "map"
        system.add("map", fmus.path(ROADS[case.road]))
        if case.states == "estimated":
            system.connect("sensors.x.measured", "map.x")
            system.connect("sensors.speed.measured", "map.speed")
            system.connect_matching("map", "kalman", "road.*.height")  # a known road is known to the filter as well
            system["kalman"].set({"use_road": True, "road.valid": True})
        else:
            system.add("map_speed", fmus.path("SpeedProfile"))
            system.connect("map_speed.x", "map.x")
            system.connect("map_speed.speed", "map.speed")
    system.connect(f"{source}.preview.step", "controller.preview.step")
    for k in CORNERS:
        for i in range(1, PREVIEW_STEPS + 2):
            system.connect(f"{source}.preview.{k}[{min(i, case.preview_steps + 1)}]", f"controller.preview.{k}[{i}]")


def _flat_preview(system: System) -> dict[str, float]:
    """Start values of the preview inputs that nothing drives."""
    inputs = system["controller"].description.inputs
    return {n: float(v.start) for n, v in inputs.items() if n.startswith("preview.") and v.start is not None}  # type: ignore[arg-type]


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case in a system that was wired for its structure."""
    system["speed"].set({"start.speed": case.speed, "start.x": case.start})
    if "map_speed" in system.members:
        late = case.preview_error_ms / 1000 * case.speed
        system["map_speed"].set({"start.speed": case.speed, "start.x": case.start - late})
    for name in {"road", "map"} & set(system.members):
        if case.road == "off-road":
            system[name].set({"offset": case.variant * STRETCH, "flat": FLAT, "ramp": RAMP})
        else:
            shift = case.variant / SHIFTS * CONTROL_PERIOD * case.speed
            system[name].set(bump_parameters(BUMPS[case.road], FIRST_BUMP + shift))
    if "sensors" in system.members:
        late = case.preview_error_ms / 1000 * case.speed
        system["sensors"].set({"noise.seed": case.variant + 1, "x.offset": -late})
    system["car"].set({"tires.lift_off": case.lift_off})
    if case.friction or "friction.acting" in system["car"].description.parameters:  # a user's car may have no friction
        system["car"].set({"friction.acting": case.friction})
    _divide_solver_step(system["car"], case)
    if case.actuators == "hydraulic":
        for k in CORNERS:
            actuator = system[f"actuator_{k}"]
            published = actuator.description.parameters
            opening, pump = (float(published[n].start) for n in ("valve.null_opening", "supply.flow_limit"))  # type: ignore[arg-type]
            actuator.set(
                {
                    "supply.running": case.controller != "passive",
                    "supply.limited": case.flow_limit,
                    "supply.flow_limit": pump if case.pump_l_min is None else case.pump_l_min / LITRES_PER_MINUTE,
                    "valve.null_opening": opening if case.null_opening_mm is None else case.null_opening_mm / 1000,
                }
            )
            _divide_solver_step(actuator, case)


def _divide_solver_step(member: Member, case: Case) -> None:
    published = float(member.description.parameters["solver.step"].start)  # type: ignore[arg-type]
    member.set({"solver.step": published / case.solver_parts})


def recorded(case: Case) -> list[str]:
    """Variables that metrics and figures need."""
    names = ["speed.x", "car.body.az", "car.body.z", "comfort.absorbed_power"]
    for k in CORNERS:
        names += [f"car.suspension.{k}.deflection", f"car.tire.{k}.deflection", f"car.tire.{k}.force"]
        names.append(f"road.road.{k}.height")
        if case.actuators == "hydraulic":
            names += [f"actuator_{k}.force", f"actuator_{k}.flow", f"actuator_{k}.power"]
            if case.controller != "passive":
                names += [f"tracking_{k}.force.smoothed", f"tracking_{k}.valve.saturated"]
        if CONTROLLERS[case.controller] is not None:
            names.append(f"controller.force.{k}")
    if case.road != "off-road":
        names += [f"road.{flag}" for flag in ROAD_FLAGS]
    if CONTROLLERS[case.controller] == "MpcHmmwv":
        names += ["controller.solver.status", "controller.solver.iterations", "controller.solver.residual"]
    return names


ROAD_FLAGS = {
    "height_above_travel": "a bump is higher than the travel of the suspension",
    "bumps_beyond_end": "a bump lies beyond the end of the road",
}


def remarks(recording: Recording) -> list[str]:
    """What a road reports of its bumps."""
    return [
        text for flag, text in ROAD_FLAGS.items() if f"road.{flag}" in recording and recording[f"road.{flag}"].any()
    ]


# ---------------------------------------------------------------------- evaluating


def _columns(recording: Recording, pattern: str) -> np.ndarray:
    """Columns of the corners (samples, 4); zeros when they were not recorded."""
    names = [pattern.format(k) for k in CORNERS]
    if names[0] not in recording:
        return np.zeros((len(recording), len(CORNERS)))
    return np.column_stack([recording[n] for n in names])


def settled(case: Case, recording: Recording) -> np.ndarray:
    """Which samples count (boolean): off road those with all wheels behind the ramp, else all."""
    behind = FLAT + RAMP + FRONT if case.road == "off-road" else -math.inf
    return np.asarray(recording["speed.x"] > behind)


def evaluate(case: Case, recording: Recording) -> Row:
    """Metrics of one run.

    ``absorbed_power`` [W] is the published figure: over bumps the peak of a moving mean over 1 s, off road the mean of the run
    (behind the ramp). Both from the heave of the CG.
    """
    az, counts = recording["car.body.az"], settled(case, recording)
    power = absorbed_power_series(az, RATE)
    peak, mean = absorbed_power_peak(az, RATE), float(power[counts].mean())
    travel, tire, load = (
        _columns(recording, f"car.{signal}")[counts]
        for signal in ("suspension.{}.deflection", "tire.{}.deflection", "tire.{}.force")
    )
    row: Row = {
        "absorbed_power": mean if case.road == "off-road" else peak,
        "absorbed_power_peak": peak,
        "absorbed_power_mean": mean,
        "iso2631_rms": iso2631_rms(az, RATE),
        "vdv": vdv(az, RATE),
        "rms_az": float(np.sqrt(np.mean(az[counts] ** 2))),
        "travel_rms": float(np.sqrt(np.mean(travel**2))),
        "travel_peak": float(np.abs(travel).max()),
        "travel_over": float(np.mean(np.abs(travel).max(axis=1) > TRAVEL_LIMIT)),
        "tire_rms": float(np.sqrt(np.mean(tire**2))),
        "lift_off": float(np.mean(load <= 0)),
        "real_time_factor": recording.real_time_factor,
    }
    force = _columns(recording, "actuator_{}.force" if case.actuators == "hydraulic" else "controller.force.{}")[counts]
    row |= {"force_rms": float(np.sqrt(np.mean(force**2))), "force_peak": float(np.abs(force).max())}
    if "controller.solver.status" in recording:
        row |= {
            "solver_failures": int((recording["controller.solver.status"] != 0).sum()),
            "solver_residual": float(recording["controller.solver.residual"].max()),
        }
    if case.actuators == "hydraulic":
        flow = np.abs(_columns(recording, "actuator_{}.flow")).sum(axis=1) * LITRES_PER_MINUTE
        drawn = _columns(recording, "actuator_{}.power").sum(axis=1)
        window = np.convolve(flow, np.ones(int(RATE)) / RATE)[: len(flow)]
        row |= {
            "flow_peak": float(flow[counts].max()),
            "flow_mean": float(flow[counts].mean()) if case.road == "off-road" else float(window.max()),
            "power_mean": float(drawn[counts].mean()),
        }
        if case.controller != "passive":
            error = force - _columns(recording, "tracking_{}.force.smoothed")[counts]
            saturated = _columns(recording, "tracking_{}.valve.saturated")[counts]
            row |= {
                "tracking_error_rms": float(np.sqrt(np.mean(error**2))),
                "saturation": float(saturated.mean()),
                "saturated_time": float(saturated.any(axis=1).sum() / RATE),
            }
    return row


HISTORY_STEP = {"track": 2, "bump": 2, "off-road": 4}  # samples of 1 ms between points of a history


def signals(case: Case, recording: Recording) -> Row:
    """Signals of a run for figures by name, thinned and rounded."""
    chosen = {
        "time": recording.time,
        "x": recording["speed.x"],
        "az": recording["car.body.az"],
        "power_window": absorbed_power_window(recording["car.body.az"], RATE),
    }
    for name, column in (
        ("travel", "car.suspension.fl.deflection"),
        ("road", "road.road.fl.height"),
        ("force", "actuator_fl.force"),
        ("smoothed", "tracking_fl.force.smoothed"),
        ("saturated", "tracking_fl.valve.saturated"),
        ("command", "controller.force.fl"),
    ):
        if column in recording:
            chosen[name] = recording[column]
    return {k: [float(f"{x:.6g}") for x in v[:: HISTORY_STEP[case.road]]] for k, v in chosen.items()}


def over_variants(case: Case, count: int | None = None) -> list[Case]:
    """A case at every place of the bump between two control samples, or on every off-road stretch; ``count`` of them.

    Without a sampled controller the place of a bump does not matter, and there is one run.
    """
    if case.road != "off-road" and CONTROLLERS[case.controller] is None:
        count = 1
    chosen = range(case.variants) if count is None else _spread(case.variants, count)
    return [replace(case, variant=v) for v in chosen]


def _spread(total: int, count: int) -> list[int]:
    return sorted({(i * total) // count for i in range(min(count, total))})


def all_fmus() -> list[str]:
    """Names of all FMUs of the experiment."""
    tracking = {n for case in hmmwv_tracking.all_cases() for n in case.fmus()}
    cases = [Case(controller=c) for c in CONTROLLERS] + [Case(states="estimated", preview="sensed")]
    return sorted({n for case in cases for n in case.fmus()} | set(ROADS.values()) | tracking | set(hmmwv_preview.FMUS))
