"""Paper 001: a HMMWV on hydraulic actuators, from the servo valve to what the driver feels.

This module wires the FMUs and runs them; ``hmmwv_study`` lays out the runs behind the figures, ``hmmwv_claims`` judges them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from cosim import Recording, System
from cosim.comfort import absorbed_power_peak, absorbed_power_series, absorbed_power_window, iso2631_rms, vdv
from cosim.experiments.cases import CaseError, FmuSet, check_choice
from cosim.experiments.store import RunStore, content_hash
from fmu_sources.controllers.hmmwv_states import CORNERS

Row = dict[str, Any]

ROADS = {"track": "RoadBumps", "bump": "RoadBumps", "off-road": "RoadOffroadHmmwv"}
BUMPS = {"track": {1: 0.057, 7: 0.038}, "bump": {1: 0.076}}  # m by place, places 1 m apart
CONTROLLERS = {
    "passive": None,
    "zero": None,
    "skyhook": "Skyhook",
    "lqr": "LqrHmmwv",
    "lqr-kilonewton": "LqrHmmwvKilonewton",
}
ACTUATORS = ("hydraulic", "ideal")

SPEED_KMH = 20 * 1.609344  # 20 mph, the speed of all published runs
SPEED_RANGE_KMH = (5.0, 100.0)
CONTROL_PERIOD = 0.030  # s
SHIFTS = 6  # places of the first bump within one control period that are averaged over
STRETCHES = 5  # stretches of the off-road profile that do not overlap
STRETCH = 280.0  # m
FIRST_BUMP, WHEELBASE = 10.0, 3.302  # m
FLAT, RAMP = 5.0, 10.0  # m, how an off-road run starts
EXCHANGE = "0.5 ms"  # of car and actuators
RATE = 1000.0  # Hz, of all metrics
LITRES_PER_MINUTE = 60000.0  # per m3/s
LIFT_OFF = 8191.0 / 500e3  # m, tyre deflection at which the static load is gone


@dataclass(frozen=True)
class Case:
    """One run. ``variant`` is where the bump lies between two control samples (0..5), or the off-road stretch (0..4)."""

    road: str = "track"
    controller: str = "lqr"
    actuators: str = "hydraulic"
    speed_kmh: float = SPEED_KMH
    variant: int = 0
    flow_limit: bool = False
    null_opening_mm: float | None = None
    duration: float | None = None  # s; None: until the rear wheels are over the bumps and the car is at rest, or 22 s

    def __post_init__(self) -> None:
        choices = (("road", ROADS), ("controller", CONTROLLERS), ("actuators", ACTUATORS))
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
        if self.null_opening_mm is not None and not 0 < self.null_opening_mm <= 50:
            raise CaseError(f"null opening {self.null_opening_mm:g} mm: give 0 to 50 mm")
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
        return -2.0 if self.road == "off-road" else FIRST_BUMP - WHEELBASE / 2 - 0.6 * self.speed

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
        last = FIRST_BUMP + max(BUMPS[self.road]) - 1 + WHEELBASE / 2 + 0.5
        return round((last - self.start) / self.speed + 1.5, 1)

    @property
    def label(self) -> str:
        """What tells this run's files from those of others."""
        return "-".join(
            [
                self.road,
                self.controller,
                *["ideal"] * (self.actuators == "ideal"),
                *[f"{self.speed_kmh:g}kmh"] * (self.speed_kmh != SPEED_KMH),
                *[f"variant{self.variant}"] * (self.variant != 0),
                *["flow-limit"] * self.flow_limit,
            ]
        )

    def fmus(self) -> list[str]:
        """Names of the FMUs of this run."""
        names = ["SpeedProfile", ROADS[self.road], "RideCarHmmwv", "RideComfort"]
        names += [name] if (name := CONTROLLERS[self.controller]) else []
        names += ["HydraulicActuator"] if self.actuators == "hydraulic" else []
        names += ["ForceTracking"] if self.actuators == "hydraulic" and self.controller != "passive" else []
        return names


class HmmwvBench:
    """Systems wired once per structure, and run as often as needed."""

    def __init__(self, fmus: FmuSet, store: RunStore | None = None) -> None:
        self.fmus = fmus
        self.store = store
        self._systems: dict[tuple[str, ...], System] = {}

    def system(self, case: Case) -> System:
        """The wired system of a case, with the parameters of this case set."""
        key = (case.road, case.controller, case.actuators)
        if key not in self._systems:
            self._systems[key] = wire(self.fmus, case)
        system = self._systems[key]
        configure(system, case)
        return system

    def record(self, case: Case, *, progress: bool = False, csv: Path | None = None) -> Recording:
        """Run a case and return its recording at 1 kHz.

        Raises:
            ComponentError: a component failed; ``error.recording`` holds what was recorded.
        """
        system = self.system(case)
        return system.run(case.stop_time, record=recorded(case), record_interval="1 ms", progress=progress, csv=csv)

    def measure(self, case: Case) -> Row:
        """Metrics of a case as JSON values; stored if possible."""
        return self._stored(case, "metrics", lambda: evaluate(case, self.record(case)))

    def history(self, case: Case) -> Row:
        """Signals of a case over time as JSON values; stored if possible."""
        return self._stored(case, "history", lambda: history(case, self.record(case)))

    def _stored(self, case: Case, what: str, compute: Callable[[], Row]) -> Row:
        return compute() if self.store is None else self.store.get([what, asdict(case)], compute)

    def close(self) -> None:
        """Free all FMUs."""
        for system in self._systems.values():
            system.close()
        self._systems.clear()


# ---------------------------------------------------------------------- wiring


def wire(fmus: FmuSet, case: Case) -> System:
    """The vehicle of a case: road, car, actuators with their force tracking, controller, comfort.

    Car and actuators advance together every 0.5 ms, the car first (Gauss-Seidel): the oil column between them is too stiff
    for an exchange side by side.
    """
    system = System()
    system.add("speed", fmus.path("SpeedProfile"))
    system.add("road", fmus.path(ROADS[case.road]))
    system.add("car", fmus.path("RideCarHmmwv"), step=EXCHANGE)
    system.add("comfort", fmus.path("RideComfort"))
    system.connect("speed.x", "road.x")
    system.connect("speed.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    system.connect_matching("car", "comfort", "body.az")
    controller = CONTROLLERS[case.controller]
    if controller is not None:
        system.add("controller", fmus.path(controller))
        system.connect_matching("car", "controller")
    if case.actuators == "ideal":
        if controller is not None:
            system.connect_matching("controller", "car", "force.*")
        else:
            system["car"].set({f"force.{k}": 0.0 for k in CORNERS})
        return system
    for k in CORNERS:
        actuator, tracking = f"actuator_{k}", f"tracking_{k}"
        system.add(
            actuator, fmus.path("HydraulicActuator"), step=EXCHANGE, start={"bypass.area": 0.0}
        )  # shut, as published
        system.connect(f"car.suspension.{k}.velocity", f"{actuator}.piston.velocity")
        system.connect(f"{actuator}.force", f"car.force.{k}")
        if case.controller == "passive":
            system[actuator].set({"valve.voltage": 0.0})
            continue
        system.add(tracking, fmus.path("ForceTracking"))
        system.connect(f"{actuator}.force", f"{tracking}.force.measured")
        system.connect(f"{actuator}.spool.position", f"{tracking}.spool.position")
        system.connect(f"car.suspension.{k}.velocity", f"{tracking}.piston.velocity")
        system.connect(f"{tracking}.valve.voltage", f"{actuator}.valve.voltage")
        if controller is not None:
            system.connect(f"controller.force.{k}", f"{tracking}.force.desired")
        else:
            system[tracking].set({"force.desired": 0.0})
    system.group("vehicle", ["car", *(f"actuator_{k}" for k in CORNERS)])
    return system


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case in a system that was wired for its road, controller and actuators."""
    system["speed"].set({"start.speed": case.speed, "start.x": case.start})
    if case.road == "off-road":
        system["road"].set({"offset": case.variant * STRETCH, "flat": FLAT, "ramp": RAMP})
    else:
        heights = {f"bump.height[{i}]": BUMPS[case.road].get(i, 0.0) for i in range(1, 11)}
        shift = case.variant / SHIFTS * CONTROL_PERIOD * case.speed
        system["road"].set({**heights, "bump.first": FIRST_BUMP + shift})
    if case.actuators == "hydraulic":
        for k in CORNERS:
            actuator = system[f"actuator_{k}"]
            opening = actuator.description.parameters["valve.null_opening"].start
            chosen = opening if case.null_opening_mm is None else case.null_opening_mm / 1000
            actuator.set(
                {
                    "supply.running": case.controller != "passive",
                    "supply.limited": case.flow_limit,
                    "valve.null_opening": chosen,
                }
            )


def recorded(case: Case) -> list[str]:
    """Variables that metrics and figures need."""
    names = ["speed.x", "car.body.az", "car.body.z", "comfort.absorbed_power"]
    for k in CORNERS:
        names += [f"car.suspension.{k}.deflection", f"car.tire.{k}.deflection", f"road.road.{k}.height"]
        if case.actuators == "hydraulic":
            names += [f"actuator_{k}.force", f"actuator_{k}.flow", f"actuator_{k}.power"]
            if case.controller != "passive":
                names += [f"tracking_{k}.force.smoothed", f"tracking_{k}.valve.saturated"]
        if CONTROLLERS[case.controller] is not None:
            names.append(f"controller.force.{k}")
    return names


# ---------------------------------------------------------------------- evaluating


def _columns(recording: Recording, pattern: str) -> np.ndarray:
    """Columns of the corners (samples, 4); zeros when they were not recorded."""
    names = [pattern.format(k) for k in CORNERS]
    if names[0] not in recording:
        return np.zeros((len(recording), len(CORNERS)))
    return np.column_stack([recording[n] for n in names])


def settled(case: Case, recording: Recording) -> np.ndarray:
    """Which samples count (boolean): off road those with all wheels behind the ramp, else all."""
    behind = FLAT + RAMP + WHEELBASE / 2 if case.road == "off-road" else -math.inf
    return np.asarray(recording["speed.x"] > behind)


def evaluate(case: Case, recording: Recording) -> Row:
    """Metrics of one run.

    ``absorbed_power`` [W] is the published figure: over bumps the peak of a moving mean over 1 s, off road the mean of the run
    (behind the ramp). Both from the heave of the CG.
    """
    az, counts = recording["car.body.az"], settled(case, recording)
    power = absorbed_power_series(az, RATE)
    peak, mean = absorbed_power_peak(az, RATE), float(power[counts].mean())
    travel, tire = (_columns(recording, p)[counts] for p in ("car.suspension.{}.deflection", "car.tire.{}.deflection"))
    row: Row = {
        "absorbed_power": mean if case.road == "off-road" else peak,
        "absorbed_power_peak": peak,
        "absorbed_power_mean": mean,
        "iso2631_rms": iso2631_rms(az, RATE),
        "vdv": vdv(az, RATE),
        "rms_az": float(np.sqrt(np.mean(az[counts] ** 2))),
        "travel_rms": float(np.sqrt(np.mean(travel**2))),
        "travel_peak": float(np.abs(travel).max()),
        "tire_rms": float(np.sqrt(np.mean(tire**2))),
        "lift_off": float(np.mean(tire > LIFT_OFF)),
        "real_time_factor": recording.real_time_factor,
    }
    force = _columns(recording, "actuator_{}.force" if case.actuators == "hydraulic" else "controller.force.{}")[counts]
    row |= {"force_rms": float(np.sqrt(np.mean(force**2))), "force_peak": float(np.abs(force).max())}
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


HISTORY_STEP = 4  # samples of 1 ms between points of a history


def history(case: Case, recording: Recording) -> Row:
    """Signals of a run for figures, thinned to every 4 ms; rounded, as JSON values."""
    thin = slice(None, None, HISTORY_STEP)
    signals = {
        "time": recording.time,
        "x": recording["speed.x"],
        "az": recording["car.body.az"],
        "power_window": absorbed_power_window(recording["car.body.az"], RATE),
        "travel_fl": recording["car.suspension.fl.deflection"],
        "road_fl": recording["road.road.fl.height"],
    }
    for name, column in (
        ("force", "actuator_fl.force"),
        ("smoothed", "tracking_fl.force.smoothed"),
        ("saturated", "tracking_fl.valve.saturated"),
        ("command", "controller.force.fl"),
    ):
        if column in recording:
            signals[name] = recording[column]
    return {**asdict(case), **{k: [float(f"{x:.6g}") for x in v[thin]] for k, v in signals.items()}}


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
    names = {n for c in CONTROLLERS for n in Case(controller=c).fmus()}
    return sorted(names | set(ROADS.values()))


def salt(fmus: FmuSet) -> str:
    """What all stored runs depend on: the FMUs, the code between FMU and metric, and the libraries it computes with."""
    import cosim

    code = [*sorted(Path(cosim.__file__).parent.glob("*.py")), Path(__file__)]
    libraries = "|".join(f"{n}={metadata.version(n)}" for n in ("numpy", "scipy"))
    return content_hash([*(fmus.path(n) for n in all_fmus()), *code]) + libraries
