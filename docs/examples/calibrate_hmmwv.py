"""Which of the assumed values of the HMMWV would a drive with four sensors tell?

    python docs/examples/calibrate_hmmwv.py

The data are given, not measured: this very model drives over Perryman 3 with the values of its FMU, and noise is added.
So the fit must find these values where the data tell them, and says where they do not. With data of a car, replace
`given` by the table that was measured.
"""

from __future__ import annotations

import argparse

import numpy as np

from cosim import System
from cosim.study.calibration import Range, SystemResponse, calibrate

SENSORS = {"car.body.az": 0.1, "car.body.roll_rate": 0.005, "car.body.pitch_rate": 0.005, "car.wheel.fl.az": 1.0}
"""Outputs and the standard deviation of their noise [SI]."""
ASSUMED = (
    "body.roll_inertia",
    "body.pitch_inertia",
    "body.cg_height",
    "wheel.mass",
    "suspension.motion_ratio",
    "suspension.front.spring",
    "tire.stiffness",
    "tire.damping",
    "suspension.stop.stiffness",
    "tire.cornering_stiffness",
)
"""What is looked for: what the vehicle file says is assumed, and the front spring, which the paper gives."""
SPEEDS_KMH = {"slow": 20.0, "fast": 45.0}
SECONDS, INTERVAL = 4.0, "5 ms"


def vehicle(speed_kmh: float) -> System:
    system = System()
    system.add("speed", "fmus/fmi3/SpeedProfile.fmu", parameters={"start.speed": speed_kmh / 3.6})
    system.add("road", "fmus/fmi3/RoadPerryman3.fmu")
    system.add(
        "car",
        "fmus/fmi3/FullCarHmmwv.fmu",
        start={"target.y": 0.0, **{f"force.{k}": 0.0 for k in ("fl", "fr", "rl", "rr")}},
    )
    system.connect("speed.speed", "car.target.speed")
    system.connect("car.x", "road.x")
    system.connect("car.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    return system


def response(system: System, *, gradient: bool = True, lanes: str | None = None) -> SystemResponse:
    outputs = list(SENSORS)
    return SystemResponse(system, outputs, stop_time=SECONDS, interval=INTERVAL, gradient=gradient, lanes=lanes)


def drive(system: System, *, off: float = 1.1, seed: int = 1) -> tuple[np.ndarray, dict[str, Range], dict[str, float]]:
    """Noisy data of one drive, the ranges of the parameters, and their true values.

    A fit starts from values that are wrong by the factor `off`, up and down in turn.
    """
    declared = system["car"].description.parameters
    truth = {f"car.{n}": float(declared[n].start) for n in ASSUMED}
    given = response(system)(truth)
    given += list(SENSORS.values()) * np.random.default_rng(seed).standard_normal(given.shape)
    return given, {n: (v * off ** (-1) ** i, v / 3, v * 3) for i, (n, v) in enumerate(truth.items())}, truth


def main() -> None:
    parser = argparse.ArgumentParser(description="Which of the assumed values of the HMMWV would a drive tell?")
    parser.add_argument("--drive", choices=SPEEDS_KMH, default="fast")
    parser.add_argument("--differences", action="store_true", help="follow differences of runs, not derivatives")
    options = parser.parse_args()
    speed = SPEEDS_KMH[options.drive]
    with vehicle(speed) as system:
        given, ranges, truth = drive(system)
        model = response(system, gradient=not options.differences)
        found = calibrate(model, given, ranges, noise=list(SENSORS.values()))
    print(f"{SECONDS:g} s of Perryman 3 at {speed:g} km/h\n{found.text()}")
    inside = [low <= v <= high for v, (low, high) in zip(truth.values(), found.intervals, strict=True)]
    print(f"{sum(inside)} of {len(truth)} true values lie in their intervals")
    print(f"{model.runs} runs and {model.runs_with_slopes} with derivatives")


if __name__ == "__main__":
    main()
