"""What the vehicle and its parts wire alike: roads, actuators, force tracking, sensors and preview chain."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from cosim import System, SystemComponent
from cosim.study.fmus import FmuSet
from fmu_sources.models.corners import CORNERS
from fmu_sources.models.hmmwv_states import SAMPLE_TIME
from fmu_sources.roads.bumps import PLACES, START, TRACK

SPEED_KMH = 20 * 1.609344  # 20 mph, the speed of all published runs
CONTROL_PERIOD = SAMPLE_TIME  # s, of the controllers that ask for forces
EXCHANGE = Fraction(1, 2000)  # s, of car and actuators
LITRES_PER_MINUTE = 60000.0  # per m3/s
SIGNAL_POINTS = 6000  # at most, of each signal that is kept for figures
FIRST_BUMP = START  # m along the road
BUMPS = {"track": {i + 1: h for i, h in TRACK.items()}, "bump": {1: 0.076}}  # m by place, places 1 m apart


def published(component: SystemComponent, parameter: str) -> float:
    """A number that an FMU has by itself, whatever a run sets."""
    return float(component.description.parameters[parameter].start)  # type: ignore[arg-type]


def bump_parameters(heights: Mapping[int, float], first: float = FIRST_BUMP) -> dict[str, float]:
    """Parameters of RoadBumps for bumps of these heights [m] by place, the first place at `first` [m]."""
    return {**{f"bump.height[{i}]": heights.get(i, 0.0) for i in range(1, PLACES + 1)}, "bump.first": first}


SPEEDS = {False: "SpeedProfile", True: "SpeedCommand"}  # whether somebody drives


def add_car(
    system: System, fmus: FmuSet, road: str, *, step: Fraction, driven: bool = False, rig: bool = False
) -> None:
    """Speed, road and car.

    `driven`: the speed is an input of the system. `rig`: all wheels get the road of the front left one.
    """
    system.add("speed", fmus.path(SPEEDS[driven]))
    system.add("road", fmus.path(road))
    system.add("car", fmus.path("RideCarHmmwv"), step=step)
    system.connect_matching("speed", "road")
    if not rig:
        system.connect_matching("road", "car", "road.*")
        return
    for k in CORNERS:
        for what in ("height", "rate"):
            system.connect(f"road.road.fl.{what}", f"car.road.{k}.{what}")


def add_actuators(system: System, fmus: FmuSet, *, driven: bool, step: Fraction = EXCHANGE) -> None:
    """Four hydraulic actuators on the car, shut bypass as published; `driven`: something sets their valves.

    Car and actuators advance together every `step`, the car first (Gauss-Seidel): the oil column between them is too
    stiff for an exchange side by side. They see each other's values of the middle of each step; plain ones would lag by
    half of it.
    """
    for k in CORNERS:
        actuator = f"actuator_{k}"
        system.add(actuator, fmus.path("HydraulicActuator"), step=step, start={"bypass.area": 0.0})
        system.connect(f"car.suspension.{k}.velocity", f"{actuator}.piston.velocity", extrapolate=True)
        system.connect(f"{actuator}.force", f"car.force.{k}", extrapolate=True)
        if not driven:
            system[actuator].set({"valve.voltage": 0.0, "supply.running": False})
    system.group("vehicle", ["car", *(f"actuator_{k}" for k in CORNERS)])


def add_tracking(system: System, fmus: FmuSet, *, requested: bool) -> None:
    """The force tracking of each actuator; `requested`: there is a `controller`, which requests forces."""
    for k in CORNERS:
        actuator, tracking = f"actuator_{k}", f"tracking_{k}"
        system.add(tracking, fmus.path("ForceTracking"))
        system.connect(f"{actuator}.force", f"{tracking}.force.measured")
        system.connect(f"{actuator}.spool.position", f"{tracking}.spool.position")
        system.connect(f"car.suspension.{k}.velocity", f"{tracking}.piston.velocity")
        system.connect(f"{tracking}.valve.voltage", f"{actuator}.valve.voltage")
        if requested:
            system.connect(f"controller.force.{k}", f"{tracking}.force.desired")
        else:
            system[tracking].set({"force.desired": 0.0})


def connect_corner(system: System, order: str = "gauss-seidel", *, extrapolate: bool = True) -> None:
    """Wire `car` (a quarter car), `actuator` and `tracking`; the caller connects the source of the desired force.

    The oil column between car and actuator is stiff (44 MN/m): they advance one after the other, the car first. Values
    of the middle of each step (`extrapolate`) make the exchange of second order; without them the force lags by half of
    a communication step, which at 0.5 ms costs as much tracking error as the controller itself.
    """
    system.connect("actuator.force", "car.force", extrapolate=extrapolate)
    system.connect("car.suspension.velocity", "actuator.piston.velocity", extrapolate=extrapolate)
    system.connect("actuator.force", "tracking.force.measured")
    system.connect("actuator.spool.position", "tracking.spool.position")
    system.connect("car.suspension.velocity", "tracking.piston.velocity")
    system.connect("tracking.valve.voltage", "actuator.valve.voltage")
    system.group("strut", ["car", "actuator"], "jacobi" if order == "jacobi" else "gauss-seidel")


def add_sensors(system: System, fmus: FmuSet) -> None:
    """Sensors on car, road, speed and, where there are any, actuators."""
    system.add("sensors", fmus.path("SensorSuite"))
    for source in ("car", "road", "speed"):
        system.connect_matching(source, "sensors")
    for k in CORNERS:
        if f"actuator_{k}" in system.components:
            system.connect(f"actuator_{k}.force", f"sensors.actuator.{k}.force")
        else:
            system["sensors"].set({f"actuator.{k}.force": 0.0})


def add_preview_chain(system: System, fmus: FmuSet) -> None:
    """Wire the preview downstream of sensors and filter.

    The ranges are corrected by the estimated pose and buffered; the road is fed back to both.
    """
    system.add("preview_sensor", fmus.path("PreviewSensor"))
    system.add("buffer", fmus.path("PreviewBuffer"))
    system.connect_matching("sensors", "preview_sensor", "range.*")
    system.connect_matching("kalman", "preview_sensor", "body.*")
    system.connect_matching("preview_sensor", "buffer")
    for name in ("preview_sensor", "buffer"):
        system.connect("sensors.x.measured", f"{name}.x")
        system.connect("sensors.speed.measured", f"{name}.speed")
    for name in ("kalman", "preview_sensor"):
        system.connect_matching("buffer", name, "road.*", delay=True)
