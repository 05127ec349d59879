"""Manoeuvres of the full cars: their inputs, the wiring, and what is measured of them.

Controllers of the suspension are those of papers 000 and 001 as published: GPC was identified on the modified HMMWV,
the others were designed on the linear ride car of paper 001, or are designed here on the car that is driven. None gets
the steering or the lateral acceleration.

All runs set `wheel.rigid_body` to 1 in cars that have it, so that the mass of the wheels acts at the hubs. With 0, the
default of other studies, it acts at the CG of the body, and the yaw gain is up to a tenth too large.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import pi, radians
from pathlib import Path

import numpy as np

from build_fmus.base import surface
from cosim import System
from cosim.core.signals import Array, columns, peak, rms
from cosim.experiments.gpc import runs as gpc
from cosim.experiments.handling import metrics
from cosim.experiments.handling.design import DESIGNED, RIGID, designed_mpc, lqr_parameters
from cosim.experiments.hmmwv import runs as hmmwv
from cosim.experiments.hmmwv.wiring import EXCHANGE, add_actuators, add_tracking
from cosim.experiments.options import AtSpeed, quantity, speed_option, terrain_option
from cosim.experiments.ride import runs as ride
from cosim.experiments.semi_active import runs as semi_active
from cosim.study import Case as BaseCase
from cosim.study import CaseError, FmuSet, Metric, Row, Run, option
from cosim.tables import Table
from fmu_sources.controllers.driver import POINTS
from fmu_sources.models.corners import CORNERS
from fmu_sources.roads.iso8608 import CLASSES
from fmu_sources.roads.rms_course import COURSES, LENGTH, RAMP, SEEDS

CARS = {
    "hmmwv": "FullCarHmmwv",
    "modified": "FullCarHmmwvModified",
    "tires": "FullCarHmmwvTires",
    "public": "FullCarHmmwvPublic",
}
NAMES = {
    "hmmwv": "HMMWV",
    "modified": "modified HMMWV",
    "tires": "modified HMMWV, tires by file",
    "public": "public HMMWV",
}
DRIVER, RANDOM = "Driver", "RoadIso8608"
COURSE = {car: ride.CARS["public" if car == "public" else "full-car"].road for car in CARS}
MAP = ride.CARS["hmmwv"].road  # the same courses with the preview of the MPC
ROADS = ("flat", "iso8608", *COURSES)
CONTROLLERS = {**{n: c for n, c in hmmwv.CONTROLLERS.items() if n != "zero"}, **gpc.CONTROLLERS}
REDESIGNED = ("lqr", "lqr-kilonewton", "mpc", "mpc-preview")  # whose design needs a linear car
DESIGNS = ("paper", "car")
PREVIEWING = ("mpc-preview", "preview")
FMUS = (
    *(*CARS.values(), DRIVER, RANDOM, *dict.fromkeys(COURSE.values()), MAP),
    *(*dict.fromkeys(filter(None, CONTROLLERS.values())), "HydraulicActuator", "ForceTracking"),
)
START = 1.0  # s, where open-loop manoeuvres begin
KEEP, PEDALS, WHEEL = 0, 1, 2  # driver.mode of the cars


@dataclass(frozen=True)
class Manoeuvre:
    """What a driver does, open loop: inputs of the car over time for a unit of the steering wheel; or a path.

    Attributes:
        about: what it is, with the standard that has it.
        mode: `driver.mode` of the car.
        seconds: how long it takes.
        wheel: (time [s], part of the amplitude) points, linear between.
        brake: likewise, of the pedal.
        path: (x [m], y [m]) points of the path of a closed-loop manoeuvre; it is level in the lanes, before and after.
        widths: of each lane [m], (part of the car's width, more than that), as quoted of the standard.
    """

    about: str
    mode: int
    seconds: float
    wheel: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 0.0))
    brake: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 0.0))
    path: tuple[tuple[float, float], ...] = ()
    widths: tuple[tuple[float, float], ...] = ()

    @property
    def lanes(self) -> list[tuple[float, float, float]]:
        """First and last x and the y of the middle [m] of each lane between cones."""
        inner = list(pairwise(self.path))[1:-1]  # without the ways there and away
        return [(x1, x2, y1) for (x1, y1), (x2, y2) in inner if y1 == y2]


def _sine(hertz: float, dwell: float = 0.0) -> tuple[tuple[float, float], ...]:
    """One period of a sine from `START` on, which holds at three quarters for `dwell` [s]."""
    phases = np.linspace(0.0, 1.0, 81)
    held = phases > 0.75
    times = START + phases / hertz + dwell * held
    points = [(0.0, 0.0), *zip(times.tolist(), np.sin(2 * pi * phases).tolist(), strict=True)]
    if dwell:
        points.insert(int(np.argmax(held)) + 1, (START + 0.75 / hertz + dwell, -1.0))
    return tuple(points)


def _step(rise: float) -> tuple[tuple[float, float], ...]:
    return ((0.0, 0.0), (START, 0.0), (START + rise, 1.0))


_LANE = ((0, 0), (50, 0), (65, 0), (95, 3.5), (120, 3.5), (145, 0), (160, 0), (300, 0))
_LANE_WIDTHS = ((1.1, 0.25), (1.2, 0.25), (1.3, 0.25))
_OBSTACLE = ((0, 0), (50, 0), (62, 0), (75.5, 3.0), (86.5, 3.0), (99, 0), (111, 0), (300, 0))
_OBSTACLE_WIDTHS = ((1.1, 0.25), (1.0, 1.0), (0.0, 3.0))
_BRAKE = ((0.0, 0.0), (4.0, 0.0), (4.1, 0.3))
MANOEUVRES = {
    "steady": Manoeuvre("slowly rising steering wheel at constant speed (ISO 4138)", WHEEL, 32.0, _step(30.0)),
    "step": Manoeuvre("step of the steering wheel (ISO 7401)", WHEEL, 6.0, _step(0.15)),
    "sine": Manoeuvre("one sine of the steering wheel, 0.5 Hz (ISO 7401)", WHEEL, 6.0, _sine(0.5)),
    "lane-change": Manoeuvre(
        "double lane change with a driver (as ISO 3888-1)", PEDALS, 12.0, path=_LANE, widths=_LANE_WIDTHS
    ),
    "obstacle": Manoeuvre(
        "obstacle avoidance with a driver (as ISO 3888-2)", PEDALS, 12.0, path=_OBSTACLE, widths=_OBSTACLE_WIDTHS
    ),
    "brake-in-turn": Manoeuvre(
        "brakes while the steering wheel is held in a turn (as ISO 7975)", PEDALS, 7.0, _step(0.3), _BRAKE
    ),
    "sine-with-dwell": Manoeuvre("sine of 0.7 Hz that dwells for 0.5 s (as ISO 19365)", PEDALS, 6.0, _sine(0.7, 0.5)),
    "straight": Manoeuvre("straight ahead at constant speed: comfort", KEEP, 12.0),
    "j-turn": Manoeuvre("fast step of the steering wheel, no pedals: rollover", PEDALS, 6.0, _step(0.4)),
}
OPEN = tuple(n for n, m in MANOEUVRES.items() if any(part for _, part in m.wheel))
_OPEN = (lambda c: c.manoeuvre in OPEN, "open-loop manoeuvres")
_CLOSED = (lambda c: bool(MANOEUVRES[c.manoeuvre].path), "manoeuvres with a driver")


@dataclass(frozen=True)
class Case(AtSpeed, BaseCase):
    """One run: a car in a manoeuvre on a road, under a controller of its suspension."""

    car: str = option("hmmwv", choices=CARS, help="car", always=True)
    manoeuvre: str = option("lane-change", choices=MANOEUVRES, help="manoeuvre", always=True)
    speed_kmh: float = speed_option(60.0, (10, 150), "speed at the start")
    wheel_deg: float = quantity(
        "wheel [deg]", 45.0, (-720, 720), "largest angle of the steering wheel, positive left", _OPEN
    )
    road: str = option("flat", choices=ROADS, help="flat, random (ISO 8608), or an RMS course of the study ride")
    terrain: str = terrain_option("C", CLASSES, "the random road", (lambda c: c.road == "iso8608", "the random road"))
    seed: int = quantity(
        "seed", 1, (1, SEEDS), "profile of an RMS course", (lambda c: c.road in COURSES, "the RMS courses"), "seed{}"
    )
    controller: str = option("passive", choices=CONTROLLERS, help="control law of the suspension")
    design: str = option(
        "paper",
        choices=DESIGNS,
        only=(lambda c: c.controller in REDESIGNED, "LQR and MPC"),
        label="designed-on-the-{}",
        help="car that the control law is designed on: that of paper 001, or the one that is driven, near rest",
    )
    actuators: str = option(
        "ideal",
        choices=hmmwv.ACTUATORS,
        help="ideal ones give the requested force at once; hydraulic ones of the passive car have their pump off",
    )
    driven: bool = option(
        False,
        only=_CLOSED,
        help="steering wheel and pedals are inputs, car.steering.wheel, car.throttle and car.brake, for people and"
        " programs that drive",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.road == "iso8608" and self.controller in PREVIEWING:
            raise CaseError(
                f"the random road has no preview for {self.controller}: give {surface.given(road='1in')} or another"
                " RMS course"
            )

        if self.design == "car" and self.car not in DESIGNED:
            raise CaseError(
                f"no control law is designed on the car {self.car}: {', '.join(DESIGNED)} can be linearized"
            )


def passive(case: Case) -> Case:
    """What a run is compared with: the same car on its springs and dampers alone."""
    return replace(case, controller="passive", actuators="ideal", design="paper")


def called(case: Case) -> str:
    """The control law; the passive car on hydraulic actuators has their pump off."""
    return "pump off" if (case.controller, case.actuators) == ("passive", "hydraulic") else case.controller


# ------------------------------------------------------------------------------------------------------------- wiring


def path_points(points: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Parameters of `Driver` for a path through these points [m], as many points as it has, evenly along x."""
    x, y = np.array(points, dtype=float).T
    places = np.linspace(x[0], x[-1], POINTS)
    rows = {"x": places, "y": np.interp(places, x, y)}
    return {f"path.{n}[{i}]": float(v) for n, row in rows.items() for i, v in enumerate(row, 1)}


def wire(fmus: FmuSet, case: Case) -> System:
    """The car with a table of inputs, with a driver, or without; on its road; with the controller of its suspension."""
    manoeuvre = MANOEUVRES[case.manoeuvre]
    system = System(allow_unconnected=True)  # no actuators; a flat road, and the pedals that a manoeuvre leaves alone
    system.add("car", fmus.path(CARS[case.car]), step=EXCHANGE if case.actuators == "hydraulic" else None)
    system["car"].set({"driver.mode": manoeuvre.mode, "target.speed": case.speed, "start.x": start(system, case)})
    if RIGID in system["car"].description.parameters:
        system["car"].set({RIGID: 1})
    if manoeuvre.path and not case.driven:
        system.add("driver", fmus.path(DRIVER))
        own = {"steering.ratio": steering_ratio(system), "wheelbase": wheelbase(system), "target.speed": case.speed}
        system["driver"].set({**own, **path_points(manoeuvre.path)})
        system.connect_matching("car", "driver")
        system.connect_matching("driver", "car")
    elif not case.driven:
        system.add(
            "driver", Table(table(manoeuvre, radians(case.wheel_deg)), units={"steering.wheel": "rad"}, after="hold")
        )
        for name in ("steering.wheel", "brake"):
            system.connect(f"driver.{name}", f"car.{name}")
    if case.road != "flat":
        _add_road(system, fmus.path(RANDOM if case.road == "iso8608" else COURSE[case.car]), case)
        system.connect_matching("road", "car")
    _add_control(system, fmus, case)
    return system


def _add_road(system: System, file: Path, case: Case, name: str = "road") -> None:
    """A road under the wheels of the car."""
    system.add(name, file)
    course = {"course": ride.NUMBER.get(case.road), "seed": case.seed}
    own = {"class": CLASSES.index(case.terrain)} if case.road == "iso8608" else course
    system[name].set({**own, **_wheels(system)})
    system.connect("car.x", f"{name}.x")
    system.connect("car.speed", f"{name}.speed")


def _wheels(system: System) -> dict[str, float]:
    """Parameters of roads and skyhook: where the wheels of the car are."""
    return {f"wheel.{k}.x": axles(system)[k.startswith("r")] for k in CORNERS}


def _add_control(system: System, fmus: FmuSet, case: Case) -> None:
    """Controller and actuators. On courses, the preview of the MPC is from a map of the road that it drives on."""
    controller = CONTROLLERS[case.controller]
    if controller is not None:
        own = case.design == "car" and controller == hmmwv.CONTROLLERS["mpc"]
        car = case.car, fmus.path(CARS[case.car])
        system.add("controller", designed_mpc(*car, fmus.fmi) if own else fmus.path(controller))
        if case.design == "car" and not own:
            system["controller"].set(lqr_parameters(*car, cheap=controller != hmmwv.CONTROLLERS["lqr"]))
        if controller == hmmwv.CONTROLLERS["skyhook"]:
            system["controller"].set(_wheels(system))
        system.connect_matching("car", "controller")
    if case.actuators == "hydraulic":
        add_actuators(system, fmus, driven=controller is not None)
        if controller is not None:
            add_tracking(system, fmus, requested=True)
    elif controller is not None:
        system.connect_matching("controller", "car", "force.*")
    if controller == hmmwv.CONTROLLERS["mpc"]:
        system["controller"].set({"use_preview": case.controller in PREVIEWING})
    if case.road == "flat":
        return
    if case.controller in ("explicit", "preview"):
        system.connect_matching("road", "controller", "road.*.height")
    if case.controller in PREVIEWING:
        source = "road" if case.controller == "preview" else "map"
        if source == "map":
            _add_road(system, fmus.path(MAP), case, source)
        system.connect_matching(source, "controller", "preview.*")


def start(system: System, case: Case) -> float:
    """Where the CG is at time 0 [m]: on courses, the front wheels are before the ramp."""
    return -(RAMP + ride.AHEAD + axles(system)[0]) if case.road in COURSES else 0.0


def table(manoeuvre: Manoeuvre, amplitude: float) -> dict[str, Array]:
    """Inputs of a car over time; `amplitude` [rad] of the steering wheel."""
    time = np.unique(np.concatenate([np.arange(0.0, manoeuvre.seconds, 0.01), [t for t, _ in manoeuvre.wheel]]))
    wheel, brake = (np.interp(time, *np.array(points).T) for points in (manoeuvre.wheel, manoeuvre.brake))
    return {"time": time, "steering.wheel": amplitude * wheel, "brake": brake}


def steering_ratio(system: System) -> float:
    """Angle of the steering wheel per steer angle."""
    return float(system["car"].start("steering.ratio"))


def axles(system: System) -> tuple[float, float]:
    """Position of the front and the rear axle ahead of the CG [m]."""
    car = system["car"]
    if "body.wheelbase" in car.description.parameters:
        base, part = float(car.start("body.wheelbase")), float(car.start("body.cg_position"))
        return base * part, base * (part - 1.0)
    return float(car.start("suspension.front.wheel[1]")), float(car.start("suspension.rear.wheel[1]"))


def wheelbase(system: System) -> float:
    """Distance between the axles [m]."""
    front, rear = axles(system)
    return front - rear


def stop_time(system: System, case: Case) -> float:
    """Length of a run [s]; with a driver, until the path is behind the car; straight on a course, until its end."""
    manoeuvre = MANOEUVRES[case.manoeuvre]
    if manoeuvre.mode == KEEP and case.road in COURSES:
        end = LENGTH - axles(system)[0]
    elif manoeuvre.path:
        end = 200.0
    else:
        return manoeuvre.seconds
    return (end - start(system, case)) / case.speed


_BODY = (
    *("x", "y", "speed", "seat.az"),
    *(f"body.{n}" for n in ("vx", "vy", "ax", "ay", "yaw", "yaw_rate", "roll", "roll_rate", "az")),
)


def force_name(case: Case) -> str:
    """The forces of actuators, or those that a controller requests."""
    return "actuator_{}.force" if case.actuators == "hydraulic" else "controller.force.{}"


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    names = [f"car.{n}" for n in (*_BODY, *(f"tire.{k}.force" for k in CORNERS))]
    names.append("car.steering.wheel" if case.driven else "driver.*")
    if case.controller != "passive" or case.actuators == "hydraulic":
        names += [n.format(k) for k in CORNERS for n in ("car.actuator.{}.power", force_name(case))]
    if CONTROLLERS[case.controller] == hmmwv.CONTROLLERS["mpc"]:
        names.append("controller.command.held")
    return names


# ---------------------------------------------------------------------------------------------------------- measuring

METRICS: Mapping[str, Metric] = {
    "understeer": Metric("understeer gradient", "deg.s2/m", 180 / pi, "{:.3f}"),
    "circle_end": Metric("follows the circle until", "s", form="{:.1f}"),
    "yaw_gain": Metric("yaw rate per steering wheel angle", "1/s", form="{:.3f}"),
    "ay_gain": Metric("lateral acceleration per steering wheel angle", "(m/s2)/rad", form="{:.2f}"),
    "response_time": Metric("response time of the yaw rate", "s", form="{:.3f}"),
    "overshoot": Metric("overshoot of the yaw rate", "%", 100.0, "{:.1f}"),
    "yaw_delay": Metric("delay of the yaw rate", "ms", 1e3, "{:.0f}"),
    "ay_delay": Metric("delay of the lateral acceleration", "ms", 1e3, "{:.0f}"),
    "ay_peak": Metric("largest lateral acceleration", "m/s2", form="{:.2f}"),
    "yaw_rate_peak": Metric("largest yaw rate", "deg/s", 180 / pi, "{:.1f}"),
    "slip_peak": Metric("largest side slip angle", "deg", 180 / pi, "{:.2f}"),
    "roll_peak": Metric("largest roll angle", "deg", 180 / pi, "{:.2f}"),
    "roll_rate_peak": Metric("largest roll rate", "deg/s", 180 / pi, "{:.1f}"),
    "roll_gradient": Metric("roll gradient", "deg.s2/m", 180 / pi, "{:.3f}"),
    "transfer_front": Metric("largest load transfer in front", "% of the load", 100.0, "{:.1f}"),
    "transfer_rear": Metric("largest load transfer at the rear", "% of the load", 100.0, "{:.1f}"),
    "rollover": Metric("largest rollover index", "-", form="{:.3f}"),
    "offset": Metric("largest distance from the path", "m", form="{:.2f}"),
    "speed_end": Metric("speed at the end", "km/h", 3.6, "{:.1f}"),
    "force_peak": Metric("largest actuator force", "kN", 1e-3, "{:.2f}"),
    "force_rms": ride.METRICS["force_rms"],
    "power_peak": Metric("largest power of the actuators", "kW", 1e-3, "{:.2f}"),
    "power_rms": Metric("power of the actuators, rms", "kW", 1e-3, "{:.2f}"),
    **{n: ride.METRICS[n] for n in ("seat_rms", "iso2631_rms", "absorbed_power_nrmm", "absorbed_power")},
    "iso2631_rms_cg": Metric("ISO 2631-1 weighted rms of the CG", "m/s2", form="{:.3f}"),
}


def signals(run: Run) -> Row:
    """Signals over time that figures show, every 10 ms [SI]."""
    return {n: v[::10].tolist() for n, v in _signals(run).items()}


def _signals(run: Run) -> dict[str, Array]:
    r = run.recording
    load = {k: r[f"car.tire.{k}.force"] for k in CORNERS}
    found = {
        "time": r.time,
        "wheel": r["car.steering.wheel" if run.case.driven else "driver.steering.wheel"],
        **{n: r[f"car.body.{n}"] for n in ("yaw_rate", "ax", "ay", "roll", "roll_rate")},
        "slip": metrics.side_slip(r["car.body.vx"], r["car.body.vy"], r["car.body.yaw"]),
        "transfer_front": metrics.load_transfer(load["fl"], load["fr"]),
        "transfer_rear": metrics.load_transfer(load["rl"], load["rr"]),
        "rollover": metrics.rollover_index(load["fl"] + load["rl"], load["fr"] + load["rr"]),
        **{n: r[f"car.{n}"] for n in ("speed", "x", "y")},
    }
    steady = run.case.manoeuvre == "steady"
    end = metrics.follows_until(found["ay"], found["yaw_rate"], found["speed"]) if steady else len(r.time)
    return {n: v[:end] for n, v in found.items()}


def measure(run: Run) -> Row:
    """`METRICS` in SI units, as far as the manoeuvre has them.

    Forces are those of all actuators, rms over time and corners; powers are those that all actuators together give to
    the car, P = sum of F_k v_k with the velocities v_k at which the suspensions extend. Steady cornering counts as long
    as the car follows its circle (`follows_until`).
    """
    s, r = _signals(run), run.recording
    row: Row = {f"{n}_peak": peak(s[n]) for n in ("ay", "yaw_rate", "slip", "roll", "roll_rate")}
    row |= {n: peak(s[n]) for n in ("transfer_front", "transfer_rear", "rollover")}
    row["speed_end"] = float(s["speed"][-1])
    if "car.actuator.fl.power" in r:
        force = columns(r, force_name(run.case), CORNERS)
        power = sum(r[f"car.actuator.{k}.power"] for k in CORNERS)
        row |= {"force_peak": peak(force), "force_rms": rms(force), "power_peak": peak(power), "power_rms": rms(power)}
    return {**row, **_OF.get(run.case.manoeuvre, lambda *_: {})(run, s)}


FLAGS = semi_active.FLAGS


def failed(_: Case, error: Exception) -> Row:
    """A car that has turned over ends the run: an outcome."""
    return {"reason": str(error)}


def _steady(run: Run, s: dict[str, Array]) -> Row:
    steer = s["wheel"] / steering_ratio(run.system)
    k = metrics.understeer_gradient(steer, s["yaw_rate"], s["speed"], s["ay"], wheelbase(run.system))
    return {"circle_end": float(s["time"][-1])} | ({"understeer": k} if np.isfinite(k) else {})


def _stepped(_: Run, s: dict[str, Array]) -> Row:
    wheel, yaw_rate, ay, roll = (metrics.settled(s[n]) for n in ("wheel", "yaw_rate", "ay", "roll"))
    found = {
        "yaw_gain": yaw_rate / wheel,
        "ay_gain": ay / wheel,
        "response_time": metrics.response_time(s["time"], s["wheel"], s["yaw_rate"]),
        "overshoot": metrics.overshoot(s["yaw_rate"]),
        "roll_gradient": roll / ay,
    }
    return {n: v for n, v in found.items() if np.isfinite(v)}


def _sines(_: Run, s: dict[str, Array]) -> Row:
    return {f"{of}_delay": metrics.delay(s["time"], s["wheel"], s[n]) for of, n in (("yaw", "yaw_rate"), ("ay", "ay"))}


def _followed(run: Run, _: dict[str, Array]) -> Row:
    return {} if run.case.driven else {"offset": float(run.recording["driver.path.offset"].max())}


def _straight(run: Run, s: dict[str, Array]) -> Row:
    """Comfort of the driver's seat, and of the CG, from where the road has its full height under all wheels."""
    if run.case.road == "flat":
        return {}
    begin = 0.0 if run.case.road in COURSES else run.start("road.flat") + run.start("road.ramp")
    counts = s["x"] >= begin - run.start("road.wheel.rl.x")
    seat, cg = (ride.comfort(run.recording[f"car.{at}.az"], counts) for at in ("seat", "body"))
    return {**seat, "iso2631_rms_cg": cg["iso2631_rms"]}


_OF: dict[str, Callable[[Run, dict[str, Array]], Row]] = {
    "steady": _steady,
    "step": _stepped,
    "sine": _sines,
    "lane-change": _followed,
    "obstacle": _followed,
    "straight": _straight,
}
