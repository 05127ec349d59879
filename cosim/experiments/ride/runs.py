"""Runs over the test courses: every car with every suitable controller, wired as in its own experiment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from build_fmus.base import surface
from cosim import StopWhen, System
from cosim.core.signals import Array, columns, peak, rms
from cosim.experiments.gpc import runs as gpc
from cosim.experiments.hmmwv import runs as hmmwv
from cosim.experiments.metrics.response import STANDARD_GRAVITY
from cosim.experiments.options import AtSpeed, quantity, speed_option
from cosim.experiments.preview_lq import runs as preview_lq
from cosim.experiments.ride.course import FileCourse, course_under
from cosim.experiments.semi_active import runs as semi_active
from cosim.experiments.three_axle import runs as three_axle
from cosim.study import Case as BaseCase
from cosim.study import CaseError, FmuSet, Metric, Row, Run, check_choice, option
from fmu_sources.catalog import PUBLISHED, wheel_radius
from fmu_sources.models.comfort import HUMAN_RESPONSE_NRMM, absorbed_power_series, weighted_acceleration
from fmu_sources.models.corners import CORNERS, SIX_CORNERS
from fmu_sources.roads import RoadLayout
from fmu_sources.roads.proving_ground import HALF_ROUND, POSITION
from fmu_sources.roads.rms_course import COURSES, LENGTH, RAMP, SEEDS
from fmu_sources.vehicles import load_vehicle

RATE = 1000.0  # Hz, of all metrics
AHEAD = 1.0  # m of level road between the front wheels and the course at the start
BEFORE = 3.0  # m before an obstacle, where its metrics begin
BEHIND = (1.0, 1.0)  # s and m by which a run continues when the last axle has left the obstacle
OBSTACLE = "half-round"
NUMBER = {**{n: i for i, n in enumerate(COURSES)}, OBSTACLE: HALF_ROUND}


@dataclass(frozen=True)
class Car:
    """A car of another experiment, and the road that stands in for the one of that experiment.

    Attributes:
        vehicle: name of its vehicle file.
        runs: the module of the other experiment that wires it.
        plant: name of the car's FMU.
        road: name of its courses.
        instead: name of the road that they stand in for.
        configure: sets what of a case of the other experiment concerns car and controller; None: nothing does.
        controllers: control laws that fit it -> fields of a case of the other experiment.
        fields: of all these cases.
        corners: of its wheels.
        wire: the wiring, if it is another than that of the module.
        driver: the car has one, who may not keep its speed; others move as their road does.
    """

    vehicle: str
    runs: Any
    plant: str
    road: str
    instead: str
    configure: Callable[[System, Any], None] | None
    controllers: dict[str, dict[str, Any]]
    fields: dict[str, Any] = field(default_factory=dict)
    corners: tuple[str, ...] = CORNERS
    wire: Callable[[FmuSet, Any], System] | None = None
    driver: bool = False

    @property
    def radius(self) -> float:
        """Radius of its wheels as they roll over a course [m]; 0: its tires envelop, and get the course as it is."""
        return wheel_radius(self.vehicle, self.vehicle)

    @property
    def size(self) -> tuple[float, float]:
        """Distance of its outermost wheels from the middle, and of its first from its last axle [m]."""
        wheels = RoadLayout.of(load_vehicle(self.vehicle)).wheels  # type: ignore[arg-type]
        axles = [w.x for w in wheels]
        return max(abs(w.y) for w in wheels), max(axles) - min(axles)


def _enveloping(fmus: FmuSet, case: Any) -> System:
    """The car with tires that envelop, wired as the other full car, with what its tires touch besides."""
    plant = CARS["public"].plant
    system = gpc.wire(replace(fmus, own={**fmus.own, gpc.PLANT: fmus.own.get(plant, (plant, ""))}), case)
    system.connect_matching("road", "car", "contact.*")
    return system


_LQ = {
    f"{w}-{mode}": {"weights": w, "controller": mode} for w in ("comfort", "road-holding") for mode in preview_lq.MODES
}


def _each(controllers: Iterable[str]) -> dict[str, dict[str, Any]]:
    return {c: {"controller": c} for c in controllers}


_PASSIVE = _each(["passive"])
_DAMPED = _each(c for c in semi_active.CONTROLLERS if c != "groundhook-on-off")  # which is the least comfortable
CARS = {
    "hmmwv": Car(
        *("ride_car_hmmwv", hmmwv, "RideCarHmmwv", "RoadProvingGroundHmmwv", hmmwv.ROADS["bump"]),
        hmmwv.configure_vehicle,
        _each(hmmwv.CONTROLLERS),
        {"road": "bump"},
        wire=partial(hmmwv.wire, comfort=False),  # absorbed power is measured at the seat, from the recording
    ),
    "sedan": Car(
        *("sedan", preview_lq, preview_lq.CAR, "RoadProvingGround5ms", preview_lq.ROAD),
        preview_lq.configure_controller,
        _PASSIVE | _LQ,
    ),
    "6x6": Car(
        *("three_axle", three_axle, "ThreeAxleRide", "RoadProvingGroundThreeAxle", "RoadShallowTrench"),
        three_axle.configure_controller,
        _each(three_axle.CONTROLLERS),
        corners=SIX_CORNERS,
    ),
    "full-car": Car(
        *("hmmwv_modified", gpc, gpc.PLANT, "RoadProvingGround", gpc.ROADS["sine"]),
        None,
        _each(gpc.CONTROLLERS),
        {"road": "sine"},
        driver=True,
    ),
    "public": Car(
        *("hmmwv_public", gpc, "FullCarHmmwvPublic", "RoadProvingGroundHmmwvPublic", gpc.ROADS["sine"]),
        None,
        _PASSIVE,
        {"road": "sine"},
        wire=_enveloping,
        driver=True,
    ),
    "hmmwv-dampers": Car(
        *("ride_car_hmmwv", semi_active, "RideCarHmmwv", "RoadProvingGroundHmmwv", semi_active.ROADS["random"]),
        semi_active.configure_vehicle,
        _DAMPED,
    ),
}
"""Cars by their names. Quarter cars are left out: no course is under one wheel only."""
CONTROLLERS = tuple(dict.fromkeys(controller for car in CARS.values() for controller in car.controllers))
ROADS = tuple(dict.fromkeys(car.road for car in CARS.values()))
FMUS = tuple(
    dict.fromkeys(
        [
            *ROADS,
            preview_lq.SPEED,
            "RideCarHmmwv",
            *filter(None, hmmwv.CONTROLLERS.values()),
            "HydraulicActuator",
            "ForceTracking",
            *(n for n in semi_active.FMUS if not n.startswith("Road")),
            preview_lq.CAR,
            *(preview_lq.WEIGHTED_CONTROLLERS[w][0] for w in ("comfort", "road-holding")),
            *(n for n in three_axle.FMUS if not n.startswith("Road")),
            gpc.PLANT,
            *filter(None, gpc.CONTROLLERS.values()),
            "FullCarHmmwvPublic",
        ]
    )
)
CarSystem = tuple[str, str, str]  # car, controller, actuators
SIDES = ("alike", "apart")
LIMIT_G = 2.5  # of the driver's seat, over obstacles
TRAVEL = 0.3  # m: more than any suspension of these cars has from its position at rest
STANDSTILL = 0.5  # of the speed that was set; below it on average a car has not driven the course

_HYDRAULIC = (lambda c: c.car == "hmmwv", "the hmmwv")
_RMS = (lambda c: c.course in COURSES, "the synthetic RMS courses")
_OVER = (lambda c: c.course == OBSTACLE, "the half-round")


@dataclass(frozen=True)
class Case(AtSpeed, BaseCase):
    """One run: a car under a controller over a course at a speed."""

    car: str = option("full-car", choices=CARS, help="car", always=True)
    controller: str = option(
        "passive", choices=CONTROLLERS, help="control law; each car has those of its own paper", always=True
    )
    actuators: str = option(
        "ideal", choices=hmmwv.ACTUATORS, only=_HYDRAULIC, help="ideal ones give the requested force at once"
    )
    course: str = option("1in", choices=NUMBER, files=".crg", help="course, or an OpenCRG file", always=True)
    speed_kmh: float = speed_option(20.0, (1, 200), label="{:.4g}kmh")
    seed: int = quantity("seed", 1, (1, SEEDS), "profile of an RMS course", _RMS, "seed{}")
    sides: str = option(
        "alike", choices=SIDES, only=_RMS, help="left and right of an RMS course: the same, as measured, or correlated"
    )
    height: float = quantity(
        "height [m]", 0.2032, (0.01, 1.0), "height of the half-round", _OVER, lambda m: f"{1e3 * m:.4g}mm"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice(f"controller of the {self.car}", self.controller, CARS[self.car].controllers)
        if self.controller == "passive" and self.car == "hmmwv" and self.actuators == "ideal":
            raise CaseError(
                "the passive hmmwv has its hydraulic actuators with the pump off: give"
                f" {surface.given(actuators='hydraulic')}; without any actuators: {surface.given(controller='zero')}"
            )

    @property
    def system(self) -> CarSystem:
        """What is driven."""
        return self.car, self.controller, self.actuators

    @property
    def other(self) -> Any:
        """The case of the experiment that this car is from."""
        more = {"actuators": self.actuators} if self.car == "hmmwv" else {}
        car = CARS[self.car]
        return car.runs.Case(**car.fields, **car.controllers[self.controller], **more)


def passive(case: Case) -> Case:
    """What a run is compared with."""
    return replace(case, controller="passive", actuators="hydraulic" if case.car == "hmmwv" else "ideal")


def own_baseline(case: Case, fmus: FmuSet) -> Case:
    """What a run with a user's vehicle is compared with: that vehicle without actuators."""
    if case.car == "hmmwv" and hmmwv.PLANT in fmus.own:
        return replace(case, controller="zero", actuators="ideal")
    return passive(case)


def called(case: Case) -> str:
    """The controller; ideal actuators of the HMMWV whose force is zero are none."""
    return hmmwv.called(case) if case.car == "hmmwv" else case.controller


def about(case: Case) -> str:
    """What a baseline is."""
    return hmmwv.BASELINES[called(case)] if case.car == "hmmwv" else "the same car without control forces"


# ------------------------------------------------------------------------------------------------------------- wiring


def structure(case: Case) -> tuple[object, ...]:
    """What decides the wiring: courses of an FMU are chosen by its parameters."""
    return case.car, case.controller, case.actuators, case.course if case.course not in NUMBER else ""


def wire(fmus: FmuSet, case: Case) -> System:
    """The car as its own experiment wires it, on these courses."""
    car = CARS[case.car]
    if (
        car.plant in fmus.own
        and case.car == "sedan"
        and case.controller != "passive"
        and preview_lq.WEIGHTED_CONTROLLERS[case.other.weights][0] not in fmus.own
    ):
        raise CaseError(
            f"{fmus.name(car.plant)} has no controllers of the sedan: its tires have damping, and preview LQ"
            " controllers are for tires without"
        )
    name, build = fmus.own.get(car.road, (car.road, ""))
    make = car.wire or car.runs.wire
    if case.course in NUMBER:
        return make(replace(fmus, own={**fmus.own, car.instead: (name, build)}), case.other)
    file = course_under(fmus, case.course, car.plant, PUBLISHED[car.vehicle].preview, car.radius)
    place = str(fmus.directory / f"fmi{fmus.fmi}" / f"{file.fmu.name}")
    made = replace(fmus, own={**fmus.own, car.instead: (file.fmu.stem, "")}, at={**fmus.at, place: str(file.fmu)})
    system = make(made, case.other)
    _files[system] = file
    return system


_files: WeakKeyDictionary[System, FileCourse] = WeakKeyDictionary()  # what the courses from files are


def stretch(system: System, case: Case) -> tuple[float, float]:
    """Where the course begins and ends for a wheel [m]: where it is of full height, or the middle of the half-round."""
    if case.course in COURSES:
        return 0.0, LENGTH
    return (POSITION, POSITION) if case.course == OBSTACLE else (_files[system].begin, _files[system].end)


def axles(run: Run) -> tuple[float, float]:
    """Position of the first and the last axle ahead of the CG [m]."""
    places = [float(run.start(f"road.wheel.{k}.x")) for k in CARS[run.case.car].corners]
    return max(places), min(places)


def window(run: Run) -> tuple[float, float]:
    """Positions of the CG [m] between which metrics are taken: all wheels on the course.

    If the course is shorter than the car: from before the course until the last axle is behind it.
    """
    (begin, end), (first, last) = stretch(run.system, run.case), axles(run)
    if end - begin < first - last:
        return begin - first - BEFORE, end - last + BEHIND[0] * run.case.speed + BEHIND[1]
    return begin - last, end - first


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case."""
    level = RAMP if case.course in COURSES else BEFORE
    start = stretch(system, case)[0] - level - AHEAD - axles(Run(case, None, system))[0]
    system["speed"].set({"start.speed": case.speed, "start.x": start})
    if CARS[case.car].driver:
        system["car"].set({"start.x": start})
    if case.course in NUMBER:
        own = {
            "course": NUMBER[case.course],
            "seed": case.seed,
            "alike": case.sides == "alike",
            "half_round.height": case.height,
        }
        system["road"].set(own)
    if "reference" in system.components:
        system["reference"].set({"pitch": 0.0})  # level, all the way
    if set_other := CARS[case.car].configure:
        set_other(system, case.other)


def distance(case: Case) -> str:
    """Variable with the position of the CG."""
    return "car.x" if CARS[case.car].driver else "speed.x"


def stop_time(system: System, case: Case) -> float:
    """Longest run [s]: cars with a driver may be slowed down."""
    begin = float(system["speed"].values["start.x"])
    needed = (window(Run(case, None, system))[1] - begin) / case.speed
    return float(np.ceil(1e3 * (needed / STANDSTILL if CARS[case.car].driver else needed)) / 1e3)


def stop_when(system: System, case: Case) -> list[StopWhen]:
    """A car with a driver has arrived."""
    return [StopWhen("car.x", ">=", window(Run(case, None, system))[1])] if CARS[case.car].driver else []


def force_name(case: Case) -> str:
    """The forces between body and wheels that a control law decides: of actuators or dampers, or requested."""
    if case.actuators == "hydraulic":
        return "actuator_{}.force"
    return "damper_{}.force" if case.car == "hmmwv-dampers" else "controller.force.{}"


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    names = [distance(case), "car.seat.az", "car.body.az"]
    for k in CARS[case.car].corners:
        names += [f"car.suspension.{k}.deflection", f"car.suspension.{k}.velocity"]
        if case.actuators == "hydraulic" or case.controller not in ("passive", "zero"):
            names.append(force_name(case).format(k))
        if case.actuators == "hydraulic":
            names.append(f"actuator_{k}.power")
    return names


# ---------------------------------------------------------------------------------------------------------- measuring

METRICS = {
    "absorbed_power_nrmm": Metric("absorbed power, third order", "W", form="{:.2f}"),
    "absorbed_power": Metric("absorbed power, second order", "W", form="{:.2f}"),
    "iso2631_rms": Metric("ISO 2631-1 weighted rms", "m/s2", form="{:.3f}"),
    "seat_peak": Metric("largest acceleration of the seat", "g", 1 / STANDARD_GRAVITY, "{:.2f}"),
    "seat_rms": Metric("rms acceleration of the seat", "m/s2", form="{:.3f}"),
    "body_rms": Metric("rms acceleration of the CG", "m/s2", form="{:.3f}"),
    "travel_rms": Metric("suspension travel, rms", "mm", 1e3, "{:.1f}"),
    "travel_peak": Metric("suspension travel, largest", "mm", 1e3, "{:.0f}"),
    "force_rms": Metric("actuator force, rms", "kN", 1e-3, "{:.2f}"),
    "power_given": Metric("power that actuators give to the car", "kW", 1e-3, "{:.2f}"),
    "power_supply": Metric("power drawn from the hydraulic supply", "kW", 1e-3, "{:.2f}"),
}


def comfort(az: Array, counts: np.ndarray) -> Row:
    """Comfort of a seat whose vertical acceleration is `az` (samples,) [m/s2] at `RATE`.

    Where `counts` (samples,) is true; the filters run over the whole signal. Absorbed power [W] is a mean, by third and
    second order; `iso2631_rms` is the rms after the weighting W_k of ISO 2631-1 [m/s2].
    """
    return {
        "absorbed_power_nrmm": float(absorbed_power_series(az, RATE, HUMAN_RESPONSE_NRMM)[counts].mean()),
        "absorbed_power": float(absorbed_power_series(az, RATE)[counts].mean()),
        "iso2631_rms": rms(weighted_acceleration(az, RATE)[counts]),
        "seat_peak": peak(az[counts]),
        "seat_rms": rms(az[counts]),
    }


def measure(run: Run) -> Row:
    """`METRICS` in SI units, of the driver's seat where nothing else is said.

    `power_given` counts what the actuators of all corners together give while they give; what they take back is lost.
    A run whose car did not arrive has `arrived` false.
    """
    case, r = run.case, run.recording
    x = r[distance(case)]
    begin, end = window(run)
    counts = (x >= begin) & (x <= end)
    arrived = bool(x[-1] >= end - 2 * case.speed / RATE)
    if not arrived or not counts.any():
        return {"arrived": False, "speed": float(np.mean(np.diff(x)) * RATE)}
    az = r["car.seat.az"]
    corners = CARS[case.car].corners
    travel = columns(r, "car.suspension.{}.deflection", corners)[counts]
    row: Row = {
        "arrived": True,
        "speed": float((x[counts][-1] - x[counts][0]) / ((counts.sum() - 1) / RATE)),
        **comfort(az, counts),
        "body_rms": rms(r["car.body.az"][counts]),
        "travel_rms": rms(travel),
        "travel_peak": peak(travel),
    }
    source = force_name(case)
    if source.format(corners[0]) in r:
        force = columns(r, source, corners)[counts]
        rate = columns(r, "car.suspension.{}.velocity", corners)[counts]
        row["force_rms"] = rms(force)
        row["power_given"] = float(np.maximum((force * rate).sum(axis=1), 0.0).mean())
    if case.actuators == "hydraulic":
        row["power_supply"] = float(sum(r[f"actuator_{k}.power"][counts] for k in corners).mean())
    return row


def failed(_: Case, error: Exception) -> Row:
    """Metrics of a run that a component ended: a closed loop that diverges is an outcome."""
    return {"arrived": False, "reason": str(error)}


def remarks(run: Run) -> list[str]:
    """What should be said of a run."""
    row = measure(run)
    if not row["arrived"]:
        return ["the car did not come to the end of the course"]
    if row["travel_peak"] <= TRAVEL:
        return []
    return [
        f"the suspension moves by up to {1e3 * row['travel_peak']:.0f} mm, further than that of a real car can: the"
        " model has no stops there, and a controller that holds the body level or at a height works against a slope"
    ]
