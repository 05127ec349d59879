"""Runs of the whole vehicle: road, car, actuators with their force tracking, controller; wired and measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from build_fmus.base import surface
from cosim import System
from cosim.core.signals import columns, peak, rms
from cosim.experiments.hmmwv import wiring
from cosim.experiments.hmmwv.wiring import BUMPS, CONTROL_PERIOD, FIRST_BUMP, LITRES_PER_MINUTE, SPEED_KMH, published
from cosim.experiments.options import AtSpeed, quantity, speed_option, terrain_option, tunable_option
from cosim.experiments.steps import Stepped, exchange_step, set_solver_step
from cosim.recording.peaks import peak_index
from cosim.study import CaseError, FmuSet, Metric, Row, Run, option
from fmu_sources.controllers.mpc.hmmwv import PREVIEW_POINTS, MpcHmmwvWeights
from fmu_sources.models.comfort import absorbed_power_peak, absorbed_power_series, absorbed_power_window, iso2631_rms
from fmu_sources.models.corners import CORNERS
from fmu_sources.roads.iso8608 import CLASSES

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
PREDICTIVE = tuple(c for c, fmu in CONTROLLERS.items() if fmu == "MpcHmmwv")
TUNABLE = "MpcHmmwvTunable"  # the MPC whose weights are parameters
ACTUATORS = ("hydraulic", "ideal")
STATES = ("true", "estimated")
PREVIEWS = ("generated", "sensed")  # a known profile at the distance traveled, or what the range sensors see
PREVIEW_STEPS = PREVIEW_POINTS - 1  # heights ahead of the one under the wheel, 30 ms apart
PLANT = "RideCarHmmwv"
FMUS = (
    *wiring.SPEEDS.values(),
    *dict.fromkeys(ROADS.values()),
    PLANT,
    "RideComfort",
    *dict.fromkeys(filter(None, CONTROLLERS.values())),
    TUNABLE,
    "HydraulicActuator",
    "ForceTracking",
    "SensorSuite",
    "KalmanHmmwv",
    "PreviewSensor",
    "PreviewBuffer",
)

SHIFTS = 6  # places of the first bump within one control period that are averaged over
STRETCHES = 5  # stretches of the off-road profile that do not overlap
STRETCH = 280.0  # m
FLAT, RAMP = 5.0, 10.0  # m, how an off-road run starts
OFF_ROAD_START = -2.0  # m, where the CG is then
RATE = 1000.0  # Hz, of all metrics
TRAVEL_LIMIT = MpcHmmwvWeights().max_travel  # m, either way: Table 1.3, and where the paper's suspension saturates

_PREVIEW = (lambda c: c.controller == "mpc-preview", "the controller mpc-preview")
_OFF_ROAD = (lambda c: c.road == "off-road", "runs off road")
_HYDRAULIC = (lambda c: c.actuators == "hydraulic", "hydraulic actuators")
_LIMITED = (lambda c: c.flow_limit, "runs with a flow limit")


@dataclass(frozen=True)
class Case(AtSpeed, Stepped):
    """One run. `variant` also seeds the noise of the sensors."""

    road: str = option("track", choices=ROADS, help="road under the wheels", always=True)
    controller: str = option(
        "mpc-preview", choices=CONTROLLERS, help="control law; zero: actuators whose desired force is zero", always=True
    )
    actuators: str = option("hydraulic", choices=ACTUATORS, help="ideal ones give the requested force at once")
    states: str = option(
        "true",
        choices=STATES,
        help="states that the controller gets; estimated: by the Kalman filter from noisy sensors",
    )
    preview: str = option(
        "generated",
        choices=PREVIEWS,
        only=_PREVIEW,
        help="where the preview is from: a known profile, or range sensors",
    )
    speed_kmh: float = speed_option(SPEED_KMH, (5, 100), "speed; the paper drives 20 mph", always=False)
    variant: int = option(
        0, label="variant{}", help="place of the bump between two control samples, or off-road stretch"
    )
    preview_steps: int = option(
        PREVIEW_STEPS,
        within=(1, PREVIEW_STEPS),
        only=_PREVIEW,
        label="{}steps",
        help="heights ahead that mpc-preview gets, 30 ms apart",
    )
    preview_error_ms: float = quantity(
        "preview error [ms]", 0.0, (-200, 200), "the preview shows the road this much too late", _PREVIEW, "{:+g}ms"
    )
    flow_limit: bool = option(False, only=_HYDRAULIC, help="limit the pump's flow to each actuator")
    friction: bool = option(False, help="dry friction in the suspensions")
    pump_l_min: float | None = quantity(
        "pump [l/min]",
        None,
        (1, 1000),
        "flow of the pump to each actuator; by default as in the actuator's FMU",
        _LIMITED,
    )
    shared_pump: bool = option(
        False, only=_LIMITED, help="four actuators share the pump: each gets a quarter of its flow"
    )
    lift_off: bool = option(True, help="tires lift off the road instead of taking tension")
    null_opening_mm: float | None = quantity(
        "null opening [mm]",
        None,
        (0.01, 50),
        "opening of a valve without power; by default as in the actuator's FMU",
        _HYDRAULIC,
    )
    density: float | None = quantity(
        "density [kg/m3]", None, (100, 10000), "density of the hydraulic fluid", _HYDRAULIC
    )
    terrain: str = terrain_option("E", CLASSES, "the road profile", _OFF_ROAD)
    tunable: bool = tunable_option((lambda c: c.controller in PREDICTIVE, "the controllers mpc and mpc-preview"))
    driven: bool = option(False, help="the speed is an input, speed.target.speed, for people and programs that drive")
    duration: float | None = option(
        None, unit="s", label="{:g}s", help="length; by default until 1.5 s after the last bump, off road 22 s"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.variant < self.variants:
            raise CaseError(f"variant {self.variant}: there are 0 to {self.variants - 1} on the road {self.road!r}")
        if self.controller == "passive" and self.actuators == "ideal":
            raise CaseError(
                "the passive car is its hydraulic actuators with the pump off, so it has no ideal ones; "
                f"the car without actuators is {surface.given(controller='zero', actuators='ideal')}"
            )
        if self.states == "estimated" and CONTROLLERS[self.controller] is None:
            raise CaseError(f"{self.controller} uses no states, so there is nothing to estimate")
        if self.states == "estimated" and self.actuators == "ideal":
            remedy = surface.given(actuators="hydraulic")
            raise CaseError(f"the estimator measures the force of the hydraulic actuators: give {remedy}")
        if self.preview == "sensed" and self.states == "true":
            remedy = surface.given(states="estimated")
            raise CaseError(f"the sensed preview is corrected by the estimated pose: give {remedy}")
        if self.preview == "sensed" and self.preview_error_ms:
            raise CaseError("a preview error is for the generated preview; the sensed one has its own")
        if self.driven and self.separate_map and self.states == "true":
            raise CaseError(
                "where somebody drives, a preview error needs states that are estimated: give"
                f" {surface.given(states='estimated')}"
            )
        if self.duration is not None and not 0.5 <= self.duration <= self.longest:
            raise CaseError(f"duration {self.duration:g} s: give 0.5 to {self.longest:.1f} s")

    @property
    def controller_fmu(self) -> str | None:
        """Name of the controller's FMU; None without one."""
        return TUNABLE if self.tunable else CONTROLLERS[self.controller]

    @property
    def variants(self) -> int:
        """How many variants this road has."""
        return STRETCHES if self.road == "off-road" else SHIFTS

    @property
    def longest(self) -> float:
        """Longest run [s]."""
        return (STRETCH - 10.0 - OFF_ROAD_START) / self.speed if self.road == "off-road" else 60.0

    @property
    def separate_map(self) -> bool:
        """Whether the generated preview comes from a road of its own, at another distance than the true one."""
        generated = self.controller == "mpc-preview" and self.preview == "generated"
        return generated and (self.states == "estimated" or self.preview_error_ms != 0)


def passive(case: Case) -> Case:
    """What a run is compared with."""
    of_controllers = ("actuators", "states", "preview", "preview_steps", "preview_error_ms", "tunable")
    of_pumps = ("flow_limit", "pump_l_min", "shared_pump")
    return replace(case, controller="passive", **{name: getattr(Case, name) for name in (*of_controllers, *of_pumps)})


def without_actuators(case: Case) -> Case:
    """The car on its springs and dampers alone."""
    return replace(passive(case), controller="zero", actuators="ideal", null_opening_mm=None, density=None)


def own_baseline(case: Case, fmus: FmuSet) -> Case:
    """Baseline of a run with a user's vehicle: that vehicle without actuators.

    The paper's hydraulic actuators, which resist when their pump is off, belong to the HMMWV.
    """
    return without_actuators(case) if PLANT in fmus.own else passive(case)


NO_ACTUATORS = "no actuators"
BASELINES = {
    "passive": "the car on its hydraulic actuators with the pump off, as in paper 001",
    NO_ACTUATORS: "the same car on its springs and dampers alone",
}


def about(case: Case) -> str:
    """What a baseline is."""
    return BASELINES[called(case)]


def called(case: Any) -> str:
    """The controller; ideal actuators whose force is zero are none."""
    return NO_ACTUATORS if (case.controller, case.actuators) == ("zero", "ideal") else case.controller


def over_variants(case: Case, count: int | None = None) -> list[Case]:
    """A case at every place of the bump between two control samples, or on every off-road stretch; `count` of them.

    Without a sampled controller the place of a bump does not matter, and there is one run.
    """
    total = case.variants
    if case.road != "off-road" and CONTROLLERS[case.controller] is None:
        count = 1
    chosen = range(total) if count is None else sorted({(i * total) // count for i in range(min(count, total))})
    return [replace(case, variant=v) for v in chosen]


# ------------------------------------------------------------------------------------------------------------- wiring


def structure(case: Case) -> tuple[object, ...]:
    """What decides the wiring."""
    names = ("road", "controller", "actuators", "states", "preview", "driven", "tunable", "exchange_parts")
    return (*(getattr(case, name) for name in names), case.preview_error_ms != 0)


def wire(fmus: FmuSet, case: Case, *, comfort: bool = True) -> System:
    """The vehicle of a case: road, car, actuators with their force tracking, controller, and `comfort`."""
    system = System()
    step = exchange_step(wiring.EXCHANGE, case)
    wiring.add_car(system, fmus, ROADS[case.road], step=step, driven=case.driven)
    if comfort:
        system.add("comfort", fmus.path("RideComfort"))
        system.connect_matching("car", "comfort", "body.az")
    controller = case.controller_fmu
    if controller is not None:
        system.add("controller", fmus.path(controller))
    if case.actuators == "ideal":
        if controller is not None:
            system.connect_matching("controller", "car", "force.*")
        else:
            system["car"].set({f"force.{k}": 0.0 for k in CORNERS})
    else:
        driven = case.controller != "passive"
        wiring.add_actuators(system, fmus, driven=driven, step=step)
        if driven:
            wiring.add_tracking(system, fmus, requested=controller is not None)
    if case.states == "estimated":
        wiring.add_sensors(system, fmus)
        system.add("kalman", fmus.path("KalmanHmmwv"), parameters={"use_road": False})
        system.connect_matching("sensors", "kalman")
        system["kalman"].set({**{f"road.{k}.height": 0.0 for k in CORNERS}, "road.valid": False})
    if controller is not None:
        system.connect_matching("kalman" if case.states == "estimated" else "car", "controller")
    if case.controller in PREDICTIVE:
        _wire_preview(system, fmus, case)
    return system


def _wire_preview(system: System, fmus: FmuSet, case: Case) -> None:
    """Where the MPC gets its preview from."""
    if case.controller == "mpc":
        inputs = system["controller"].description.inputs
        flat = {n: float(v.start) for n, v in inputs.items() if n.startswith("preview.") and v.start is not None}  # type: ignore[arg-type]
        system["controller"].set({"use_preview": False, **flat})
        return
    system["controller"].set({"use_preview": True})
    source = "road"
    if case.preview == "sensed":
        source = "buffer"
        wiring.add_preview_chain(system, fmus)
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
            system.connect_matching("map_speed", "map")
    system.connect_matching(source, "controller", "preview.*")


def start(system: System, case: Case) -> float:
    """Where the CG is at time 0 [m]: 0.6 s before the first bump, or at the start of the flat stretch."""
    if case.road == "off-road":
        return OFF_ROAD_START
    return FIRST_BUMP - published(system["car"], "wheel.fl.x") - 0.6 * case.speed


def stop_time(system: System, case: Case) -> float:
    """Length of the run [s]: bumps until 1.5 s after the last one, off road 22 s unless the stretch is shorter."""
    if case.duration is not None:
        return case.duration
    if case.road == "off-road":
        return min(22.0, case.longest)
    last = FIRST_BUMP + max(BUMPS[case.road]) - 1 - published(system["car"], "wheel.rl.x") + 0.5
    return round((last - start(system, case)) / case.speed + 1.5, 1)


def begin(system: System, case: Case) -> float:
    """When metrics begin [s]: off road where all wheels are beyond the ramp, elsewhere at once."""
    if case.road != "off-road":
        return 0.0
    return (FLAT + RAMP - published(system["car"], "wheel.rl.x") - OFF_ROAD_START) / case.speed


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case in a system that was wired for its structure."""
    at, late = start(system, case), case.preview_error_ms / 1000 * case.speed
    system["speed"].set({"target.speed" if case.driven else "start.speed": case.speed, "start.x": at})
    if "map_speed" in system.components:
        system["map_speed"].set({"start.speed": case.speed, "start.x": at - late})
    for name in {"road", "map"} & set(system.components):
        if case.road == "off-road":
            profile = {"class": CLASSES.index(case.terrain), "offset": case.variant * STRETCH}
            system[name].set({**profile, "flat": FLAT, "ramp": RAMP})
        else:
            shift = case.variant / SHIFTS * CONTROL_PERIOD * case.speed
            system[name].set(wiring.bump_parameters(BUMPS[case.road], FIRST_BUMP + shift))
    if case.controller == "mpc-preview":
        system["controller"].set({"preview.used": case.preview_steps})
    if "sensors" in system.components:
        system["sensors"].set({"noise.seed": case.variant + 1, "x.offset": -late})
    configure_vehicle(system, case)


def configure_vehicle(system: System, case: Case) -> None:
    """What of a case concerns car and actuators, on any road."""
    system["car"].set({"tires.lift_off": case.lift_off})
    if case.friction or "friction.acting" in system["car"].description.parameters:  # a user's car may have no friction
        system["car"].set({"friction.acting": case.friction})
    set_solver_step(system["car"], case)
    if case.actuators == "hydraulic":
        for k in CORNERS:
            actuator = system[f"actuator_{k}"]
            opening, pump = (published(actuator, n) for n in ("valve.null_opening", "supply.flow_limit"))
            limit = pump if case.pump_l_min is None else case.pump_l_min / LITRES_PER_MINUTE
            actuator.set(
                {
                    "supply.running": case.controller != "passive",
                    "supply.limited": case.flow_limit,
                    "supply.flow_limit": limit / 4 if case.shared_pump else limit,
                    "valve.null_opening": opening if case.null_opening_mm is None else case.null_opening_mm / 1000,
                }
            )
            set_solver_step(actuator, case)
            for name in {f"actuator_{k}", f"tracking_{k}"} & set(system.components):
                own = published(system[name], "fluid.density")
                system[name].set({"fluid.density": own if case.density is None else case.density})


FLAGS = {
    "road.height_above_travel": "a bump is higher than the travel of the suspension",
    "road.bumps_beyond_end": "a bump lies beyond the end of the road",
}


def recorded(case: Case) -> Sequence[str]:
    """Variables that metrics and figures need, and those that people look at."""
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
        names += FLAGS
    if case.controller in PREDICTIVE:
        names += ["controller.solver.status", "controller.solver.iterations", "controller.solver.residual"]
    return names


# ---------------------------------------------------------------------------------------------------------- measuring

METRICS = {
    "absorbed_power": Metric("absorbed power (published figure)", "W", form="{:.2f}"),
    "absorbed_power_peak": Metric("absorbed power, peak over 1 s", "W", form="{:.2f}"),
    "absorbed_power_mean": Metric("absorbed power, mean", "W", form="{:.2f}"),
    "iso2631_rms": Metric("ISO 2631 weighted rms", "m/s2", form="{:.3f}"),
    "travel_rms": Metric("suspension travel, rms", "mm", 1e3, "{:.1f}"),
    "travel_peak": Metric("suspension travel, largest", "mm", 1e3, "{:.1f}"),
    "lift_off": Metric("tire off the ground", "% of the time", 100.0, "{:.1f}"),
    "force_rms": Metric("actuator force, rms", "N", form="{:.0f}"),
    "force_peak": Metric("actuator force, largest", "N", form="{:.0f}"),
    "tracking_error_rms": Metric("force error, rms", "N", form="{:.0f}"),
    "saturation": Metric("valve saturated", "% of the time", 100.0, "{:.1f}"),
    "flow_mean": Metric("flow of the pump, mean", "l/min", form="{:.0f}"),
}


def measure(run: Run) -> Row:
    """Metrics of one run.

    `absorbed_power` [W] is the published figure: over bumps the peak of a moving mean over 1 s, off road the mean of
    the run (after the ramp). Both from the heave of the CG. `flow_limit` [l/min] and `null_opening` [m] are those
    of its actuators.
    """
    case, r = run.case, run.recording
    az = r["car.body.az"]
    ramp = FLAT + RAMP - run.start("car.wheel.rl.x") if case.road == "off-road" else -math.inf
    counts = np.asarray(r["speed.x"] > ramp)  # off road with all wheels beyond the ramp
    worst, mean = absorbed_power_peak(az, RATE), float(absorbed_power_series(az, RATE)[counts].mean())
    travel, load = (columns(r, f"car.{of}", CORNERS)[counts] for of in ("suspension.{}.deflection", "tire.{}.force"))
    source = "actuator_{}.force" if case.actuators == "hydraulic" else "controller.force.{}"
    force = columns(r, source, CORNERS, optional=True)[counts]
    row: Row = {
        "absorbed_power": mean if case.road == "off-road" else worst,
        "absorbed_power_peak": worst,
        "absorbed_power_mean": mean,
        "iso2631_rms": iso2631_rms(az, RATE),
        "travel_rms": rms(travel),
        "travel_peak": peak(travel),
        "travel_over": float(np.mean(np.abs(travel).max(axis=1) > TRAVEL_LIMIT)),
        "lift_off": float(np.mean(load <= 0)),
        "force_rms": rms(force),
        "force_peak": peak(force),
    }
    if "controller.solver.status" in r:
        row["solver_failures"] = int((r["controller.solver.status"] != 0).sum())
        row["solver_residual"] = float(r["controller.solver.residual"].max())
    if case.actuators == "hydraulic":
        flow = np.abs(columns(r, "actuator_{}.flow", CORNERS)).sum(axis=1) * LITRES_PER_MINUTE
        window = np.convolve(flow, np.ones(int(RATE)) / RATE)[: len(flow)]
        row |= {
            "flow_limit": LITRES_PER_MINUTE * run.start("actuator_fl.supply.flow_limit"),
            "null_opening": run.start("actuator_fl.valve.null_opening"),
            "flow_peak": float(flow[counts].max()),
            "flow_mean": float(flow[counts].mean()) if case.road == "off-road" else float(window.max()),
            "power_mean": float(columns(r, "actuator_{}.power", CORNERS).sum(axis=1)[counts].mean()),
        }
        if case.controller != "passive":
            row["tracking_error_rms"] = rms(force - columns(r, "tracking_{}.force.smoothed", CORNERS)[counts])
            row["saturation"] = float(columns(r, "tracking_{}.valve.saturated", CORNERS)[counts].mean())
    return row


SIGNALS = {
    "x": "speed.x",
    "travel": "car.suspension.fl.deflection",
    "force": "actuator_fl.force",
    "smoothed": "tracking_fl.force.smoothed",
    "saturated": "tracking_fl.valve.saturated",
}


def signals(run: Run) -> Row:
    """Signals of a run for figures by name, rounded, and thinned so that peaks are kept.

    These are `SIGNALS` [SI units] and the absorbed power of the last second [W].
    """
    r = run.recording
    shown = {name: r[column] for name, column in SIGNALS.items() if column in r}
    shown["power_window"] = absorbed_power_window(r["car.body.az"], RATE)
    kept = peak_index([v for name, v in shown.items() if name != "x"], wiring.SIGNAL_POINTS)
    return {name: [float(f"{x:.6g}") for x in signal[kept]] for name, signal in shown.items()}
