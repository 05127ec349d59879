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
from cosim.study.calibration import Calibration, SystemResponse, calibrate

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


def fitted(speed_kmh: float, *, off: float = 1.1, seed: int = 1) -> tuple[Calibration, np.ndarray]:
    """The fit to noisy data of one drive, and the true values.

    The fit starts from values that are wrong by the factor `off`, up and down in turn.
    """
    with vehicle(speed_kmh) as system:
        declared = system["car"].description.parameters
        truth = {f"car.{n}": float(declared[n].start) for n in ASSUMED}
        model = SystemResponse(system, list(SENSORS), stop_time=SECONDS, interval=INTERVAL, gradient=True)
        noise = np.array(list(SENSORS.values()))
        given = model(truth) + noise * np.random.default_rng(seed).standard_normal((801, len(SENSORS)))
        ranges = {n: (v * off ** (-1) ** i, v / 3, v * 3) for i, (n, v) in enumerate(truth.items())}
        return calibrate(model, given, ranges, noise=noise), np.array(list(truth.values()))


def main() -> None:
    parser = argparse.ArgumentParser(description="Which of the assumed values of the HMMWV would a drive tell?")
    parser.add_argument("--drive", choices=SPEEDS_KMH, default="fast")
    drive = parser.parse_args().drive
    found, truth = fitted(SPEEDS_KMH[drive])
    print(f"{SECONDS:g} s of Perryman 3 at {SPEEDS_KMH[drive]:g} km/h\n{found.text()}")
    inside = [low <= v <= high for v, (low, high) in zip(truth.tolist(), found.intervals, strict=True)]
    print(f"{sum(inside)} of {len(truth)} true values lie in their intervals")


if __name__ == "__main__":
    main()
