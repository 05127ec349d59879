"""The best that four actuators can do on a road that is known in advance, beside the preview LQ controller.

    python docs/examples/open_loop_forces.py

The forces of the sedan's actuators are columns of a table, one sample every 5 ms. `System.gradient` differentiates the
index of paper 004 by all samples in one run and a way back, and L-BFGS-B of SciPy lowers it. The car is linear and the
index quadratic, so there is one minimum. It knows the whole road, the controller 0.12 s of it; both lie below the car
without forces. Within a limit of the forces there is a minimum too, which is not that of a linear controller.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping

import numpy as np
from scipy import optimize

from cosim import System, Table
from cosim.gradient import Metric, QuadraticCost, Rms
from fmu_sources.controllers.lq.preview import WEIGHTED
from fmu_sources.controllers.lq.preview_weights import load_weights
from fmu_sources.models.corners import CORNERS

SPEED = 75 / 3.6  # m/s
STOP, INTERVAL = 2.0, 0.005  # s
SCALE = 1000.0  # N, of the forces in the search
FORCES = [f"forces.force.{k}" for k in CORNERS]
WEIGHTS = load_weights("comfort")
WEIGHTED_OUTPUTS = zip((f"car.{n}" for n in WEIGHTED), WEIGHTS.outputs(CORNERS), strict=True)
METRICS: Mapping[str, Metric] = {
    "index": QuadraticCost({**dict(WEIGHTED_OUTPUTS), **dict(zip(FORCES, WEIGHTS.controls(CORNERS), strict=True))}),
    "acceleration": Rms("car.body.az"),
}


def make_ride() -> System:
    """The sedan on the hole and bump of paper 004; its forces are to be connected."""
    system = System()
    system.add("speed", "fmus/fmi3/SpeedProfile.fmu", parameters={"start.speed": SPEED})
    system.add("road", "fmus/fmi3/RoadHoleBump.fmu")
    system.add("car", "fmus/fmi3/RideCarSedan.fmu", step="1 ms")
    system.connect("speed.x", "road.x")
    system.connect("speed.speed", "road.speed")
    system.connect_matching("road", "car", "road.*")
    return system


def with_preview_lq() -> System:
    """The ride under preview LQ control, with the published weights."""
    system = make_ride()
    system.add("forces", "fmus/fmi3/PreviewLqComfort.fmu", parameters={"mode": 2})
    system.connect("speed.speed", "forces.speed")
    for source, target in (("road", "forces"), ("car", "forces"), ("forces", "car")):
        system.connect_matching(source, target, "*")
    return system


class OpenLoop:
    """The ride with forces from a table, whose samples are searched."""

    def __init__(self) -> None:
        time = np.arange(round(STOP / INTERVAL) + 1) * INTERVAL
        self.shape = len(CORNERS), len(time)
        columns = {f"force.{k} [N]": np.zeros(len(time)) for k in CORNERS}
        self.system = make_ride()
        self.system.add("forces", Table({"time": time, **columns}, after="hold"))
        self.system.connect_matching("forces", "car", "force.*")
        self.runs = 0

    def index(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Index of forces (corners * samples,) in units of `SCALE`, and its derivatives."""
        self.set(SCALE * x.reshape(self.shape))
        found = self.system.gradient({"index": METRICS["index"]}, FORCES, stop_time=STOP)
        self.runs += 1
        return float(found.values[0]), SCALE * found.jacobian[0]

    def set(self, forces: np.ndarray) -> None:
        """Put forces (corners, samples) [N] into the table."""
        self.system["forces"].set({f"force.{k}": row for k, row in zip(CORNERS, forces, strict=True)})

    def search(self, limit: float = np.inf) -> np.ndarray:
        """Forces (corners, samples) [N] within a limit [N] that make the index as small as possible."""
        begin = np.zeros(self.shape[0] * self.shape[1])
        bounds = optimize.Bounds(-limit / SCALE, limit / SCALE)
        options = {"maxcor": 30, "ftol": 1e-9, "gtol": 1e-6}
        found = optimize.minimize(self.index, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        return SCALE * found.x.reshape(self.shape)


def measure(system: System) -> dict[str, float]:
    """Metrics of a run, and the largest force [N]."""
    names = list(dict.fromkeys(n for metric in METRICS.values() for n in metric.names))
    recording = system.run(STOP, record=names)
    row = {name: m.of([recording[n] for n in m.names])[0] for name, m in METRICS.items()}
    return row | {"force": max(float(np.abs(recording[n]).max()) for n in FORCES)}


def main() -> None:
    parser = argparse.ArgumentParser(description="Forces of four actuators on a road that is known in advance.")
    parser.add_argument("--limit", type=float, default=1000.0, help="of the forces [N], for the last row")
    limit = parser.parse_args().limit
    open_loop = OpenLoop()
    rows = {"passive": (measure(open_loop.system), 0), "preview LQ": (measure(with_preview_lq()), 0)}
    for name, most in {"open loop": np.inf, f"within {limit:g} N": limit}.items():
        open_loop.runs = 0
        open_loop.set(open_loop.search(most))
        rows[name] = measure(open_loop.system), open_loop.runs
    print(" " * 15 + "index  acceleration [m/s2]  largest force [N]  runs")
    for name, (row, runs) in rows.items():
        relative = row["index"] / rows["passive"][0]["index"]
        print(f"{name:14} {relative:5.3f}  {row['acceleration']:19.3f}  {row['force']:17.0f}  {runs:4}")


if __name__ == "__main__":
    main()
