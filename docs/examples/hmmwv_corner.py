"""One corner of the HMMWV of paper 001 on a bump: road, quarter car, hydraulic actuator, force tracking, ride comfort.

    build-fmus && python docs/examples/hmmwv_corner.py

The controller holds the actuator at zero force, so that the wheel is not held by the oil. Every box is an FMU with a
rate of its own. A SpeedProfile drives, and a controller of the vehicle would be connected to
`tracking.force.desired`.
"""

from __future__ import annotations

from pathlib import Path

from cosim import Record, Recording, System
from cosim.experiments.hmmwv.wiring import connect_corner

SPEED = 20 * 0.44704  # m/s, 20 mph


def corner(fmus: Path = Path("fmus/fmi3"), *, active: bool = True) -> System:
    """The wired system; passive: pump off, the valve at its null opening, the command without effect."""
    system = System()
    system.add("speed", fmus / "SpeedProfile.fmu", parameters={"start.speed": SPEED})
    system.add("road", fmus / "RoadBumps.fmu")
    system.add("car", fmus / "QuarterCarHmmwv.fmu", step="0.5 ms", parameters={"friction.acting": True})
    system.add(
        "actuator",
        fmus / "HydraulicActuator.fmu",
        step="0.5 ms",
        parameters={"supply.running": active},
        start={"bypass.area": 0.0},
    )
    system.add("tracking", fmus / "ForceTracking.fmu", start={"force.desired": 0.0})
    system.add("comfort", fmus / "RideComfort.fmu")
    system.connect("speed.x", "road.x")
    system.connect("speed.speed", "road.speed")
    system.connect("road.road.fl.height", "car.road.height")
    system.connect("road.road.fl.rate", "car.road.rate")
    connect_corner(system)
    system.connect("car.body.az", "comfort.body.az")
    return system


def run(*, active: bool, fmus: Path = Path("fmus/fmi3")) -> Recording:
    """Three seconds of driving over the first two bumps of the track."""
    with corner(fmus, active=active) as system:
        return system.run(3.0, record=Record(["car.*", "actuator.*", "comfort.*"], "1 ms"))


if __name__ == "__main__":
    for name, active in (("passive", False), ("zero force", True)):
        recording = run(active=active)
        peak = recording["comfort.absorbed_power.peak"][-1]
        print(f"{name}: absorbed power {peak:.1f} W at its peak, {recording.real_time_factor:.0f} times real time")
