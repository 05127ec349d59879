"""How hard should a suspension be damped? A quarter car over one bump, short or long."""

from dataclasses import dataclass

import numpy as np

from cosim import System
from cosim.study import Case, ClaimList, Experiment, Finding, Measures, Metric, RunOptions, Study, Wiring, grid, option


@dataclass(frozen=True)
class Ride(Case):
    damping: float = option(12e3, unit="N.s/m", within=(0, 1e6), help="damping of the suspension", always=True)
    duration: float = option(0.5, unit="s", within=(0.02, 2), help="duration of the bump", always=True)


def wire(fmus, _):
    system = System()
    system.add("road", fmus.path("RoadBenchBump"), start={"bump.start": 0.1, "bump.height": 0.05})
    system.add("car", fmus.path("QuarterCarHmmwv"), step="1 ms", start={"force": 0.0})
    system.connect_matching("road", "car")
    return system


def configure(system, case):
    system["road"].set({"bump.duration": case.duration})
    system["car"].set({"suspension.damping": case.damping})


def measure(run):
    az, tire = run.recording["car.body.az"], run.recording["car.tire.deflection"]
    return {"comfort": float(np.sqrt(np.mean(az**2))), "grip": float(np.abs(tire).max())}


CLAIMS = ClaimList()


@CLAIMS.claim("soft", "Soft is comfortable over a short bump", published="the softer the better", source="folklore")
def soft(study):
    found = [study[Ride(d, 0.1)]["comfort"] for d in DAMPINGS]
    return Finding(f"{found[0]:.2f} to {found[-1]:.2f} m/s2", found == sorted(found), "the softest is not the best")


DAMPINGS = (3e3, 6e3, 12e3, 24e3)
EXPERIMENT = Experiment(
    "damping",
    Ride,
    title="Damping of a quarter car",
    wiring=Wiring(wire, configure=configure, fmus=("RoadBenchBump", "QuarterCarHmmwv")),
    measures=Measures(
        measure, {"comfort": Metric("rms acceleration", "m/s2"), "grip": Metric("tire deflection, largest", "mm", 1e3)}
    ),
    run=RunOptions(stop_time=3.0, record=["car.*"]),
    study=Study(grid(Ride, damping=DAMPINGS, duration=(0.1, 0.5)), claims=CLAIMS),
)
