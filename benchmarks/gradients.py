"""Cost of the derivatives of a run, as a multiple of the run, and how much they deviate from differences.

The full car under GPC with preview; the HMMWV with hydraulic actuators under preview MPC; and the sedan with four
forces from a table, by the mass of its body and by the samples of the forces (docs/examples/open_loop_forces.py).

Deviations are those of `Gradient.trust` at a relative step of 1e-6, from parameters by which the run is smooth: where
runs on either side have taken the same sides of all comparisons to the end. The MPC has OSQP, whose solutions DAQP
makes exact, or DAQP (MpcHmmwvTunable).

All components have derivatives of their own; those that are followed by differences cost two more instances for each
parameter.
"""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np

from benchmarks import spent
from cosim import Record, System, Table
from cosim.experiments.gpc import EXPERIMENT as GPC
from cosim.experiments.gpc.runs import Case as GpcCase
from cosim.experiments.hmmwv import EXPERIMENT as HMMWV
from cosim.experiments.hmmwv.runs import Case as HmmwvCase
from cosim.gradient import QuadraticCost
from cosim.study import FmuSet, Runner

ROUNDS, RUNS = 3, 20  # the first runs of a process take up to four times as long
STOP = 8.0  # s
STEP = 1e-6  # relative; at wider ones more runs on either side take other sides of a comparison
RIDE = {"ride": QuadraticCost({"car.body.az": 1.0})}


def measure() -> dict[str, float]:
    """Processor time of gradients over that of the run, the best of some rounds: forward and by the adjoint."""
    gains = [f"controller.gain.preview[{i},{j}]" for i in range(1, 5) for j in range(1, 12)]
    names = ["car.body.mass", "car.tire.stiffness", *gains, "car.wheel.mass", "car.tire.damping"]
    names += ["car.body.pitch_inertia", "car.body.roll_inertia"]
    names += [f"controller.gain.{by}[{i},{j}]" for by in "yu" for i in range(1, 5) for j in range(1, 24)]
    gpc = Runner(GPC, FmuSet()).system(GpcCase())
    found = _costs("GPC", gpc, names, (16, 50, 200)) | _deviations("GPC", gpc, names[:50])
    system = Runner(HMMWV, FmuSet()).system(HmmwvCase())
    owners = [system[m] for m in ("car", "actuator_fl", "actuator_fr", "tracking_fl", "tracking_fr")]
    names = [
        f"{m.name}.{v.name}"
        for m in owners
        for v in m.description.variables.values()
        if v.causality == "parameter" and v.type == "real" and v.name != "solver.step" and m.start(v.name)
    ]
    found |= _costs("preview MPC", system, names, (16, 50))
    for solver, tunable in (("OSQP", False), ("DAQP", True)):
        system = Runner(HMMWV, FmuSet()).system(HmmwvCase(tunable=tunable))
        found |= _deviations(f"preview MPC, {solver}", system, names[:50])
    return found | _series()


def _deviations(what: str, system: System, names: list[str]) -> dict[str, float]:
    """How many parameters the run is smooth by, for how long in the mean, and the largest deviation of these."""
    system.allow_unconnected = True
    trust = system.gradient(RIDE, names, stop_time=STOP, interval="10 ms", mode="forward").trust(STEP)
    smooth = trust.smooth == trust.stop
    return {
        f"{what}, smooth parameters / {len(names)}": float(smooth.mean()),
        f"{what}, smooth time / run": float(trust.smooth.mean()) / trust.stop,
        f"{what}, largest deviation of smooth parameters": float(np.abs(trust.deviation[0, smooth]).max()),
    }


def _costs(what: str, system: System, names: list[str], counts: tuple[int, ...]) -> dict[str, float]:
    system.allow_unconnected = True
    kept = Record(["car.body.az"], "10 ms")

    def gradient(count: int, stop: float, mode: str) -> None:
        system.gradient(RIDE, names[:count], stop_time=stop, interval="10 ms", threads=1, mode=mode)

    run = min(spent(lambda: system.run(STOP, record=kept)) for _ in range(RUNS))
    found: dict[str, float] = {}
    for mode in ("forward", "adjoint"):
        for count in counts[:2] if mode == "forward" else counts:
            gradient(count, 0.01, mode)  # compiles
            begin = min(spent(gradient, count, 0.01, mode) for _ in range(ROUNDS))
            took = min(spent(gradient, count, STOP, mode) for _ in range(ROUNDS)) - begin
            found |= {
                f"{what}, {mode}, {count} parameters / run": took / run,
                f"{what}, {mode}, beginning of {count} / run": begin / run,
            }
    return found


def _series() -> dict[str, float]:
    example = runpy.run_path(str(Path(__file__).parents[1] / "docs" / "examples" / "open_loop_forces.py"))
    metric, found = {"index": example["METRICS"]["index"]}, {}
    for rows in (101, 1001, 8001):
        system, columns = example["make_ride"](), {n.removeprefix("forces."): np.zeros(rows) for n in example["FORCES"]}
        system.add("forces", Table({"time": np.linspace(0.0, STOP, rows), **columns}, after="hold"))
        system.connect_matching("forces", "car", "force.*")
        kept = Record(metric["index"].names, "1 ms")

        def gradient(by: list[str], stop: float, system: System = system) -> None:
            system.gradient(metric, by, stop_time=stop, interval="1 ms", threads=1, mode="adjoint")

        gradient(["car.body.mass"], 0.01)
        run = min(spent(system.run, STOP, record=kept) for _ in range(RUNS))
        for what, by in (("one parameter", ["car.body.mass"]), (f"{4 * rows} samples", example["FORCES"])):
            took = min(spent(gradient, by, STOP) for _ in range(ROUNDS)) - min(
                spent(gradient, by, 0.01) for _ in range(ROUNDS)
            )
            found[f"sedan, table of {rows} rows, adjoint, {what} / run"] = took / run
    return found
