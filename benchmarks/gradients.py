"""Cost of the derivatives of a run, as a multiple of the run: the full car under GPC with preview.

All components have derivatives of their own; those that are followed by differences cost two more instances for each
parameter.
"""

from __future__ import annotations

from benchmarks import spent
from cosim import Record
from cosim.experiments.gpc import EXPERIMENT
from cosim.experiments.gpc.runs import Case
from cosim.gradient import Rms
from cosim.study import FmuSet, Runner

ROUNDS = 3
STOP = 8.0  # s


def measure() -> dict[str, float]:
    """Processor time of gradients over that of the run, the best of some rounds: forward and by the adjoint."""
    system = Runner(EXPERIMENT, FmuSet()).system(Case())
    system.allow_unconnected = True
    gains = [f"controller.gain.preview[{i},{j}]" for i in range(1, 5) for j in range(1, 12)]
    names = ["car.body.mass", "car.tire.stiffness", *gains, "car.wheel.mass", "car.tire.damping"]
    metric, kept = {"ride": Rms("car.body.az")}, Record(["car.body.az"], "10 ms")
    names += ["car.body.pitch_inertia", "car.body.roll_inertia"]
    names += [f"controller.gain.{by}[{i},{j}]" for by in "yu" for i in range(1, 5) for j in range(1, 24)]

    def gradient(count: int, stop: float, mode: str) -> None:
        system.gradient(metric, names[:count], stop_time=stop, interval="10 ms", threads=1, mode=mode)

    run = min(spent(lambda: system.run(STOP, record=kept)) for _ in range(ROUNDS))
    found: dict[str, float] = {}
    for mode, counts in {"forward": (16, 50), "adjoint": (16, 50, 200)}.items():
        for count in counts:
            gradient(count, 0.01, mode)  # compiles
            begin = min(spent(gradient, count, 0.01, mode) for _ in range(ROUNDS))
            took = min(spent(gradient, count, STOP, mode) for _ in range(ROUNDS)) - begin
            found |= {
                f"{mode}, {count} parameters / run": took / run,
                f"{mode}, beginning of {count} / run": begin / run,
            }
    return found
