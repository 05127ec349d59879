"""Manoeuvres of the full cars: their inputs, the wiring, and what is measured of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi, radians

import numpy as np

from cosim import System
from cosim.core.signals import Array, peak
from cosim.experiments.handling.metrics import (
    delay,
    overshoot,
    response_time,
    rollover_index,
    settled,
    side_slip,
    understeer_gradient,
)
from cosim.study.case import Case as BaseCase
from cosim.study.case import option
from cosim.study.experiment import Metric, Row, Run
from cosim.study.fmus import FmuSet
from cosim.tables import Table
from fmu_sources.controllers.driver import POINTS

CARS = {
    "hmmwv": "FullCarHmmwv",
    "modified": "FullCarHmmwvModified",
    "tires": "FullCarHmmwvTires",
    "public": "FullCarHmmwvPublic",
}
DRIVER, ROUGH = "Driver", "RoadIso8608"
FMUS = (*CARS.values(), DRIVER, ROUGH)
CORNERS = ("fl", "fr", "rl", "rr")
START = 1.0  # s, where open-loop manoeuvres begin
PEDALS, WHEEL = 1, 2  # driver.mode of the cars


@dataclass(frozen=True)
class Manoeuvre:
    """What a driver does, open loop: inputs of the car over time for a unit of the steering wheel; or a path.

    Attributes:
        about: what it is, with the standard that has it.
        mode: `driver.mode` of the car.
        seconds: how long it takes.
        wheel: (time [s], part of the amplitude) points, linear between.
        brake: likewise, of the pedal.
        path: (x [m], y [m]) points of the path of a closed-loop manoeuvre.
    """

    about: str
    mode: int
    seconds: float
    wheel: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 0.0))
    brake: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 0.0))
    path: tuple[tuple[float, float], ...] = ()


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
_OBSTACLE = ((0, 0), (50, 0), (62, 0), (75.5, 3.0), (86.5, 3.0), (99, 0), (111, 0), (300, 0))
MANOEUVRES = {
    "steady": Manoeuvre("slowly rising steering wheel at constant speed (ISO 4138)", WHEEL, 32.0, _step(30.0)),
    "step": Manoeuvre("step of the steering wheel (ISO 7401)", WHEEL, 6.0, _step(0.15)),
    "sine": Manoeuvre("one sine of the steering wheel, 0.5 Hz (ISO 7401)", WHEEL, 6.0, _sine(0.5)),
    "lane-change": Manoeuvre("double lane change with a driver (as ISO 3888-1)", PEDALS, 12.0, path=_LANE),
    "obstacle": Manoeuvre("obstacle avoidance with a driver (as ISO 3888-2)", PEDALS, 12.0, path=_OBSTACLE),
    "brake-in-turn": Manoeuvre(
        "brakes while the steering wheel is held in a turn (as ISO 7975)",
        PEDALS,
        7.0,
        _step(0.3),
        ((0.0, 0.0), (4.0, 0.0), (4.1, 0.3)),
    ),
    "sine-with-dwell": Manoeuvre("sine of 0.7 Hz that dwells for 0.5 s (as ISO 19365)", PEDALS, 6.0, _sine(0.7, 0.5)),
    "j-turn": Manoeuvre("fast step of the steering wheel, no pedals: rollover", PEDALS, 6.0, _step(0.4)),
}
OPEN = tuple(n for n, m in MANOEUVRES.items() if not m.path)
_OPEN = (lambda c: c.manoeuvre in OPEN, "open-loop manoeuvres")


@dataclass(frozen=True)
class Case(BaseCase):
    """One run: a car in a manoeuvre on a road."""

    car: str = option("hmmwv", choices=CARS, help="car", always=True)
    manoeuvre: str = option("lane-change", choices=MANOEUVRES, help="manoeuvre", always=True)
    speed_kmh: float = option(
        60.0, name="speed", unit="km/h", within=(10, 150), label="{:g}kmh", help="speed at the start", always=True
    )
    wheel_deg: float = option(
        45.0,
        name="wheel",
        unit="deg",
        within=(-720, 720),
        only=_OPEN,
        label="{:g}deg",
        help="largest angle of the steering wheel, positive left",
    )
    rough: bool = option(False, help="ISO 8608 road instead of a flat one")


# ------------------------------------------------------------------------------------------------------------- wiring


def path_points(points: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Parameters of `Driver` for a path through these points [m], as many points as it has, evenly along x."""
    x, y = np.array(points, dtype=float).T
    places = np.linspace(x[0], x[-1], POINTS)
    rows = {"x": places, "y": np.interp(places, x, y)}
    return {f"path.{n}[{i}]": float(v) for n, row in rows.items() for i, v in enumerate(row, 1)}


def wire(fmus: FmuSet, case: Case) -> System:
    """The car with a table of inputs, or with a driver; on its road."""
    manoeuvre, speed = MANOEUVRES[case.manoeuvre], case.speed_kmh / 3.6
    system = System(allow_unconnected=True)  # no actuators; a flat road, and the pedals that a manoeuvre leaves alone
    system.add("car", fmus.path(CARS[case.car]))
    system["car"].set({"driver.mode": manoeuvre.mode, "target.speed": speed, "start.x": 0.0})
    if manoeuvre.path:
        system.add("driver", fmus.path(DRIVER))
        own = {"steering.ratio": steering_ratio(system), "wheelbase": wheelbase(system), "target.speed": speed}
        system["driver"].set({**own, **path_points(manoeuvre.path)})
        system.connect_matching("car", "driver")
        system.connect_matching("driver", "car")
    else:
        system.add(
            "driver", Table(table(manoeuvre, radians(case.wheel_deg)), units={"steering.wheel": "rad"}, after="hold")
        )
        for name in ("steering.wheel", "brake"):
            system.connect(f"driver.{name}", f"car.{name}")
    if case.rough:
        system.add("road", fmus.path(ROUGH))
        system.connect("car.x", "road.x")
        system.connect("car.speed", "road.speed")
        system.connect_matching("road", "car")
    return system


def table(manoeuvre: Manoeuvre, amplitude: float) -> dict[str, Array]:
    """Inputs of a car over time; `amplitude` [rad] of the steering wheel."""
    time = np.unique(np.concatenate([np.arange(0.0, manoeuvre.seconds, 0.01), [t for t, _ in manoeuvre.wheel]]))
    wheel, brake = (np.interp(time, *np.array(points).T) for points in (manoeuvre.wheel, manoeuvre.brake))
    return {"time": time, "steering.wheel": amplitude * wheel, "brake": brake}


def _parameter(system: System, name: str) -> float:
    component = system["car"]
    return float(component.values.get(name, component.description.parameters[name].start))


def steering_ratio(system: System) -> float:
    """Angle of the steering wheel per steer angle."""
    return _parameter(system, "steering.ratio")


def wheelbase(system: System) -> float:
    """Distance between the axles [m]."""
    if "body.wheelbase" in system["car"].description.parameters:
        return _parameter(system, "body.wheelbase")
    front, rear = (_parameter(system, f"suspension.{axle}.wheel[1]") for axle in ("front", "rear"))
    return front - rear


def stop_time(_: System, case: Case) -> float:
    """Length of a run [s]; with a driver, until the path is behind the car."""
    manoeuvre = MANOEUVRES[case.manoeuvre]
    return 200.0 / (case.speed_kmh / 3.6) if manoeuvre.path else manoeuvre.seconds


_BODY = ("x", "y", "speed", "body.vx", "body.vy", "body.ax", "body.ay", "body.yaw", "body.yaw_rate", "body.roll")


def recorded(_: Case) -> Sequence[str]:
    """What is recorded."""
    return [f"car.{n}" for n in (*_BODY, *(f"tire.{k}.force" for k in CORNERS))] + ["driver.*"]


# ---------------------------------------------------------------------------------------------------------- measuring

METRICS: Mapping[str, Metric] = {
    "understeer": Metric("understeer gradient", "deg.s2/m", 180 / pi, "{:.3f}"),
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
    "rollover": Metric("largest rollover index", "-", form="{:.3f}"),
    "offset": Metric("largest distance from the path", "m", form="{:.2f}"),
    "speed_end": Metric("speed at the end", "km/h", 3.6, "{:.1f}"),
}


def signals(run: Run) -> Row:
    """Signals over time that figures show, every 10 ms [SI]."""
    return {n: v[::10].tolist() for n, v in _signals(run).items()}


def _signals(run: Run) -> dict[str, Array]:
    r = run.recording
    left, right = (sum(r[f"car.tire.{axle}{side}.force"] for axle in "fr") for side in "lr")
    return {
        "time": r.time,
        "wheel": r["driver.steering.wheel"],
        "yaw_rate": r["car.body.yaw_rate"],
        "ax": r["car.body.ax"],
        "ay": r["car.body.ay"],
        "roll": r["car.body.roll"],
        "slip": side_slip(r["car.body.vx"], r["car.body.vy"], r["car.body.yaw"]),
        "rollover": rollover_index(left, right),
        "speed": r["car.speed"],
        "x": r["car.x"],
        "y": r["car.y"],
    }


def measure(run: Run) -> Row:
    """`METRICS` in SI units, as far as the manoeuvre has them."""
    s = _signals(run)
    row: Row = {
        "ay_peak": peak(s["ay"]),
        "yaw_rate_peak": peak(s["yaw_rate"]),
        "slip_peak": peak(s["slip"]),
        "roll_peak": peak(s["roll"]),
        "rollover": peak(s["rollover"]),
        "speed_end": float(s["speed"][-1]),
    }
    return {**row, **_OF.get(run.case.manoeuvre, lambda *_: {})(run, s)}


def failed(_: Case, error: Exception) -> Row:
    """A car that has turned over ends the run: an outcome."""
    return {"reason": str(error)}


def _steady(run: Run, s: dict[str, Array]) -> Row:
    steer = s["wheel"] / steering_ratio(run.system)
    k = understeer_gradient(steer, s["yaw_rate"], s["speed"], s["ay"], wheelbase(run.system))
    return {"understeer": k} if np.isfinite(k) else {}


def _stepped(_: Run, s: dict[str, Array]) -> Row:
    wheel = settled(s["wheel"])
    found = {
        "yaw_gain": settled(s["yaw_rate"]) / wheel,
        "ay_gain": settled(s["ay"]) / wheel,
        "response_time": response_time(s["time"], s["wheel"], s["yaw_rate"]),
        "overshoot": overshoot(s["yaw_rate"]),
    }
    return {n: v for n, v in found.items() if np.isfinite(v)}


def _sines(_: Run, s: dict[str, Array]) -> Row:
    return {f"{of}_delay": delay(s["time"], s["wheel"], s[n]) for of, n in (("yaw", "yaw_rate"), ("ay", "ay"))}


def _followed(run: Run, _: dict[str, Array]) -> Row:
    return {"offset": float(run.recording["driver.path.offset"].max())}


_OF: dict[str, Callable[[Run, dict[str, Array]], Row]] = {
    "steady": _steady,
    "step": _stepped,
    "sine": _sines,
    "lane-change": _followed,
    "obstacle": _followed,
}
