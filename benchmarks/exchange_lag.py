"""What the lag of one communication step does to a GPC run: this master beside a plain Jacobi loop with FMPy.

The run of `cosim run gpc --road sine --speed 50 --controller preview` with the gains that the FMU carries. The Jacobi
loop is that of most masters: at t all inputs are set to the outputs of t, all FMUs step to t + 1 ms, outputs are read.
Both loops initialize alike and exchange every 1 ms, so the order of exchange is all they differ in. The controller
decides every 10 ms.
"""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from itertools import product

import numpy as np
from fmpy.fmi3 import FMU3Slave

from benchmarks.master_cost import Wired, flatten, fmpy_slave
from cosim import Record
from cosim.core.signals import rms
from cosim.experiments.gpc.runs import TRAVEL, Case, wire
from cosim.study import FmuSet
from fmu_sources.models.corners import CORNERS

ROAD, SPEED_KMH, CONTROLLER = "sine", 50.0, "preview"
STEP, EVERY = 1e-3, 10  # s of exchange, steps from decision to decision
SETTLING = 4  # passes over all FMUs during initialization: more than their longest chain
COMMANDS = tuple(f"force.{k}" for k in CORNERS)
FELT = "body.az"


def by_master(fmus: FmuSet, duration: float) -> tuple[np.ndarray, list[Wired]]:
    """Commands as they act on the car from step to step, and its acceleration: (steps, 5) [N, m/s2].

    The wiring is given as flat lists.
    """
    names = [*(f"controller.{n}" for n in COMMANDS), f"car.{FELT}"]
    with wire(fmus, Case(ROAD, controller=CONTROLLER)) as system:
        system["speed"].set({"start.speed": SPEED_KMH / 3.6})
        interval = f"{1e3 * STEP:g} ms"
        system.allow_unconnected = True
        recording = system.run(duration, record=Record(names, interval))  # the driver keeps y = 0
        return np.column_stack([recording[n][:-1] for n in names]), flatten(system)


def by_fmpy(wired: list[Wired], duration: float, *, lag: bool = True) -> np.ndarray:
    """The same with FMPy's slaves: all step with what the others had shown at the beginning of the step.

    Without `lag` they step one after the other, the car last, and pass on at once what they have found: as this
    master.
    """
    with ExitStack() as stack:
        slaves = []
        for w in wired:
            slave, references = fmpy_slave(w, stack.enter_context(tempfile.TemporaryDirectory()))
            stack.callback(slave.freeInstance)
            if "start.speed" in references and w.name == "speed":
                slave.setFloat64([references["start.speed"]], [SPEED_KMH / 3.6])
            slave.enterInitializationMode()
            slaves.append(slave)
            if w.name == "controller":
                acting = [w.first + w.outputs.index(references[n]) for n in COMMANDS]
            if w.name == "car":
                felt = [references[FELT]]
        values = np.zeros(sum(len(w.outputs) for w in wired))

        def send(w: Wired, slave: FMU3Slave) -> None:
            if w.inputs:
                slave.setFloat64(w.inputs, values[w.sources].tolist())

        def receive(w: Wired, slave: FMU3Slave) -> None:
            values[w.first : w.first + len(w.outputs)] = slave.getFloat64(w.outputs)

        components = list(zip(wired, slaves, strict=True))
        for _ in range(SETTLING):
            for action, (w, slave) in product((receive, send), components):
                action(w, slave)
        for slave in slaves:
            slave.exitInitializationMode()
        for w, slave in components:
            receive(w, slave)
        seen = []
        for k in range(round(duration / STEP)):
            if lag:
                for w, slave in components:
                    send(w, slave)
            for w, slave in components:
                if w.name == "car":
                    seen.append([*values[acting], *slave.getFloat64(felt)])
                if not lag:
                    send(w, slave)
                slave.doStep(k * STEP, STEP)
                if not lag:
                    receive(w, slave)
            if lag:
                for w, slave in components:
                    receive(w, slave)
        return np.array(seen)


def measure(distance: float = TRAVEL) -> dict[str, float]:
    """Differences over `distance` [m].

    Those of commands are relative to the range from the least to the largest command.
    """
    duration = STEP * EVERY * round(distance / (SPEED_KMH / 3.6) / STEP / EVERY)  # whole periods of the controller
    recorded, wired = by_master(FmuSet(), duration)
    master, jacobi = recorded, by_fmpy(wired, duration)
    force, late = master[:, :-1], jacobi[:, :-1]
    span = np.ptp(force)
    decided, decided_late = force[::EVERY], late[1::EVERY]  # what is decided at t acts from t, or from t + 1 ms

    return {
        "range of the commands [N]": float(span),
        "command at an instant, largest difference [% of the range]": 100 * float(np.abs(late - force).max() / span),
        "command at an instant, rms difference [% of the range]": 100 * rms(late - force) / span,
        "decision of the controller, largest difference [% of the range]": (
            100 * float(np.abs(decided_late - decided).max() / span)
        ),
        "decision of the controller, rms difference [% of the range]": 100 * rms(decided_late - decided) / span,
        "rms of body.az, change [%]": 100 * (rms(jacobi[:, -1]) / rms(master[:, -1]) - 1),
    }
