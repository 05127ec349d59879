"""Runs of the preview chain: road, car, sensors, filter, correction and buffer; wired and measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from operator import attrgetter

import numpy as np

from cosim import Recording, System
from cosim.core.signals import rms
from cosim.experiments.hmmwv import wiring
from cosim.experiments.hmmwv.wiring import BUMPS, CONTROL_PERIOD, EXCHANGE, FIRST_BUMP, SPEED_KMH, bump_parameters
from cosim.experiments.options import quantity
from cosim.study import Case as AnyCase
from cosim.study import FmuSet, Metric, Row, Run, option
from fmu_sources.models.corners import CORNERS
from fmu_sources.roads.bumps import BUMP_LENGTH

SPEED, TRACK = SPEED_KMH / 3.6, BUMPS["track"]
FILTERS = {"printed": "KalmanHmmwvPrinted", "relative": "KalmanHmmwv"}
FMUS = (
    "SpeedProfile",
    "RoadBumps",
    "RideCarHmmwv",
    "SensorSuite",
    *FILTERS.values(),
    "PreviewSensor",
    "PreviewBuffer",
    "HydraulicActuator",
)
AFTER = 6.0  # m after a bump in which a dip counts
WINDOW = 4.0  # s, in which the spread of the buffered road's error is taken

_SENSED = (lambda c: c.preview == "sensed", "the sensed preview")


@dataclass(frozen=True)
class Case(AnyCase):
    """A run of the range sensors on a car without control forces, or of a known profile.

    The known profile is compared with the loads of the passive hydraulic car. `noise` scales all sensors' noise; with 0
    the ranges are not rounded either.
    """

    preview: str = option("sensed", choices=("sensed", "generated"), help="where the preview is from", always=True)
    filter: str = option("relative", choices=FILTERS, only=_SENSED, help="states of the filter", always=True)
    use_road: bool = option(True, only=_SENSED, help="feed the buffered road back to filter and correction")
    compensation: bool = option(False, only=_SENSED, help="add quarter cars on the buffered road, as the paper does")
    road: str = option("bump", choices=BUMPS, help="road under the wheels", always=True)
    height_mm: float = quantity(
        "height [mm]", 30.0, (0, 200), "height of the bump", (lambda c: c.road == "bump", "one bump")
    )
    noise: float = quantity("noise", 0.0, (0, 100), "scale of the sensors' noise", _SENSED, "noise-{:g}")
    duration: float = quantity("duration [s]", 2.6, (1, 60), "length")
    dropout: float = quantity("dropout [s]", 0.0, (0, 60), "how long the range sensors fail", _SENSED, "dropout-{:g}s")
    dropout_start: float = quantity(
        "dropout start [s]", 0.0, (0, 60), "when the range sensors fail", _SENSED, "from-{:g}s"
    )
    speedometer_error: float = quantity(
        "speedometer error [%]",
        0.0,
        (-50, 50),
        "error of the speedometer (positive: it reads too high)",
        (lambda c: c.preview == "generated", "the generated preview"),
        "speedometer{:+g}",
    )


# ------------------------------------------------------------------------------------------------------------- wiring


structure = attrgetter("preview", "filter")
"""What of a case decides the wiring."""


def wire(fmus: FmuSet, case: Case) -> System:
    """Wire road, car, sensors and preview, which is sensed or known beforehand.

    A sensed road is fed back to filter and correction; a known one is placed at the measured distance.
    """
    system = System(allow_unconnected=True)  # there are no actuators on the chain's car
    sensed = case.preview == "sensed"
    wiring.add_car(system, fmus, "RoadBumps", step=Fraction(1, 1000) if sensed else EXCHANGE)
    if sensed:
        system["car"].set({f"force.{k}": 0.0 for k in CORNERS})
        wiring.add_sensors(system, fmus)
        system.add("kalman", fmus.path(FILTERS[case.filter]))
        system.connect_matching("sensors", "kalman")
        wiring.add_preview_chain(system, fmus)
        return system
    system.add("map", fmus.path("RoadBumps"))
    wiring.add_actuators(system, fmus, driven=False)
    wiring.add_sensors(system, fmus)
    system.connect("sensors.x.measured", "map.x")
    system.connect("sensors.speed.measured", "map.speed")
    return system


def configure(system: System, case: Case) -> None:
    """Set the parameters of a case."""
    bumps = bump_parameters(TRACK if case.road == "track" else {1: case.height_mm / 1000})
    system["speed"].set({"start.speed": SPEED, "start.x": 0.0})
    if case.preview == "generated":
        for name in ("road", "map"):
            system[name].set(bumps)
        system["sensors"].set({"speed.gain": 1.0 + case.speedometer_error / 100})
        return
    system["road"].set({**bumps, "length": 1000.0})
    sensors = system["sensors"]
    resolutions = [n for n in sensors.description.parameters if n.startswith("range.resolution")]
    sensors.set(
        {
            **{n: wiring.published(sensors, n) if case.noise else 0.0 for n in resolutions},
            "noise.scale": case.noise,
            "range.dropout.start": case.dropout_start,
            "range.dropout.duration": case.dropout,
        }
    )
    system["kalman"].set({"use_road": case.use_road})
    system["preview_sensor"].set({"compensation": int(case.compensation)})


def stop_time(_: System, case: Case) -> float:
    """Length of the run [s]."""
    return case.duration


def recorded(case: Case) -> Sequence[str]:
    """What is recorded."""
    return list((SENSED if case.preview == "sensed" else GENERATED).values())


# ---------------------------------------------------------------------------------------------------------- measuring

SENSED = {
    "x": "speed.x",
    "range": "sensors.range.left",
    "range valid": "sensors.range.left.valid",
    "sensed x": "preview_sensor.sensed.left.x",
    "sensed": "preview_sensor.sensed.left.height",
    "true": "road.road.fl.height",
    "true rate": "road.road.fl.rate",
    "buffered": "buffer.preview.fl[1]",
    "next": "buffer.preview.fl[2]",
    "preview valid": "buffer.preview.valid",
    "road valid": "buffer.road.valid",
}
GENERATED = {"x": "speed.x", "map": "map.road.fl.height", "road": "road.road.fl.height", "load": "sensors.loadcell.fl"}

METRICS = {
    "lowest": Metric("lowest sensed height after the bump", "mm", 1e3, "{:.1f}"),
    "highest": Metric("highest sensed height after the bump", "mm", 1e3, "{:.1f}"),
    "rate_error": Metric("error of the buffered road's rate, rms", "m/s", form="{:.3f}"),
}


def signals(run: Run) -> Row:
    """Signals over time, 5 ms apart and rounded [SI units].

    `rate` is that of the buffered road, from two neighboring preview heights; `true rate` is that of the true road
    as the mean over the 30 ms ahead, which is what two neighboring heights give.
    """
    r = run.recording
    if run.case.preview == "generated":
        return {name: _rounded(r[column]) for name, column in GENERATED.items()}
    rows = {name: _rounded(r[column]) for name, column in SENSED.items()}
    rate = np.array(rows["true rate"])
    rows["true rate"] = np.convolve(rate, np.ones(6) / 6, "full")[5:].tolist()
    del rows["next"]
    return {"time": _rounded(r.time), **rows, "rate": _rounded(_rate(r))}


def _rate(r: Recording) -> np.ndarray:
    rate: np.ndarray = (r[SENSED["next"]] - r[SENSED["buffered"]]) / CONTROL_PERIOD
    return rate


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{v:.6g}") for v in values]


def measure(run: Run) -> Row:
    """Metrics of a run, from the signals as they are kept.

    Sensed: `lowest` and `highest` sensed height [m] on the flat road after the first bump, `spread` [m] of the
    buffered road about the true one in successive windows, `rate_error` [m/s] from where road is known under all
    wheels, `ahead` [m] of the front axle that the sensors see, their `resolution` [m]. Generated: `offsets` [m],
    how far after the known profile's bumps the car meets them. `front` [m] is the front axle ahead of the CG.
    """
    kept = {name: np.array(values) for name, values in signals(run).items()}
    front = run.start("car.wheel.fl.x")
    if run.case.preview == "generated":
        return {"front": front, "offsets": [_offset(kept, place, front) for place in TRACK]}
    sensor = f"[{1 + run.start('sensors.range.sensor')}]"
    x, sensed, t = kept["sensed x"], kept["sensed"], kept["time"]
    begin = FIRST_BUMP + BUMP_LENGTH + run.start(f"sensors.range.spot{sensor}") / 2
    flat = sensed[(x > begin) & (x < begin + AFTER)]
    error, known = kept["buffered"] - kept["true"], kept["road valid"] > 0.5
    starts = np.arange(0.0, t[-1] - WINDOW / 2, WINDOW)
    return {
        "front": front,
        "ahead": float(np.median(x - kept["x"])) - front,
        "resolution": run.start(f"sensors.range.resolution{sensor}"),
        "lowest": float(flat.min()),
        "highest": float(flat.max()),
        "spread": [float(np.std(error[(t >= s) & (t < s + WINDOW)])) for s in starts],
        "rate_error": rms((kept["rate"] - kept["true rate"])[known]),
    }


def _offset(kept: dict[str, np.ndarray], place: int, front: float) -> float:
    """Distance [m] from the crest of the known profile to the largest load of the front left wheel, near one bump."""
    at = FIRST_BUMP + (place - 1) + BUMP_LENGTH / 2 - front  # the CG with the front wheels on the crest
    near = np.abs(kept["x"] - at) < 1.0
    x, shown = kept["x"][near], kept["map"][near]
    crest = float(np.sum(x * shown) / max(np.sum(shown), 1e-12))
    return float(x[np.argmax(np.abs(kept["load"][near]))]) - crest
