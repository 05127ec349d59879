"""What the MPC of the HMMWV should do when OSQP reaches its limit of iterations: closed loops, by choice.

`hold`: the last command, clipped to the bounds of now. `iterate`: the first move of the unfinished iterate, clipped
likewise. `fallback`: DAQP solves the program from scratch. All three are compared with DAQP without a limit, on roads
and
sensor faults that no paper has and that bring OSQP to its limit: the car of the published runs with ideal actuators at
20 mph, bumps several times as high as published, and glitches that replace all measurements in one of ten samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.mpc_solvers import make
from build_fmus.qp import Backend, Daqp
from build_fmus.reference import Evaluator
from cosim.experiments.hmmwv.wiring import BUMPS, SPEED_KMH, bump_parameters
from fmu_sources.controllers.mpc import hmmwv
from fmu_sources.models.comfort import absorbed_power
from fmu_sources.models.hmmwv_states import FORCES, RELATIVE_STATES, SUSPENSION, TIRE

SECONDS, MILLISECOND = 3.0, 1e-3
GLITCH = {n: 0.1 if n.endswith("deflection") else 1.0 for n in RELATIVE_STATES}  # m, m/s and rad/s
EXACT = "exact"
_OSQP = hmmwv.BACKENDS[0]
CHOICES: dict[str, Backend] = {
    EXACT: Daqp(),
    "hold": replace(_OSQP, fallback=None),
    "iterate": replace(_OSQP, fallback=None),
    "fallback": _OSQP,
}


@dataclass(frozen=True)
class Loop:
    """One scenario: bumps `scale` times as high as on the published track.

    In `glitches` [part of the samples] every measured state is at plus or minus 0.1 m, 1 m/s or 1 rad/s.
    """

    scale: float
    preview: bool
    glitches: float = 0.0

    @property
    def title(self) -> str:
        """For the table."""
        text = f"bumps {self.scale:g} times, {'with' if self.preview else 'without'} preview"
        return text + (", glitches" if self.glitches else "")


LOOPS = tuple(
    Loop(scale, preview, glitches)
    for (scale, glitches), preview in product(((4.0, 0.0), (8.0, 0.0), (1.0, 0.1)), (False, True))
)


class _Component:
    """A component that is stepped in Python."""

    def __init__(self, evaluator: Evaluator) -> None:
        self.evaluator = evaluator
        self.slots = {e.name: e.slot for e in evaluator.component.elements("input")}
        self.names = [e.name for e in evaluator.component.output_elements()]

    def take(self, values: dict[str, float]) -> None:
        """Inputs of these names."""
        for name in self.slots.keys() & values.keys():
            self.evaluator.u[self.slots[name]] = values[name]

    def give(self) -> dict[str, float]:
        """All outputs."""
        return dict(zip(self.names, self.evaluator.outputs().tolist(), strict=True))


class _Watched:
    """The solver of a controller: counts the samples at OSQP's limit.

    It calls an unfinished iterate a solution if it should.
    """

    def __init__(self, law: Evaluator, choice: str) -> None:
        program = law.component.programs[0]
        assert law._programs is not None
        self._solver, self._status = law._programs, program.n + program.m
        self._choice, self._limit = choice, _OSQP.max_iterations
        self.reached = 0

    def solve(self, data: np.ndarray, *, commit: bool = True) -> np.ndarray:
        """The solution, in the layout of the solver."""
        solution = self._solver.solve(data, commit=commit)
        status, iterations = solution[self._status], solution[self._status + 1]
        if self._choice != EXACT and (status == 1 or iterations > self._limit):
            self.reached += 1
            if self._choice == "iterate":
                solution[self._status] = 0
        return solution


def drive(loop: Loop, choice: str) -> dict[str, float]:
    """One closed loop: what the passengers, suspension and tires get, and how often OSQP reached its limit."""
    plant = make("RideCarHmmwv")
    heights = {place: loop.scale * h for place, h in BUMPS["track"].items()}
    road = _Component(Evaluator(make("RoadBumps").model(), bump_parameters(heights)))
    law = _Component(Evaluator(hmmwv.mpc_hmmwv(plant, backend=CHOICES[choice]).model()))
    car = _Component(Evaluator(plant.model()))
    watched = _Watched(law.evaluator, choice)
    law.evaluator._programs = watched  # type: ignore[assignment]
    law.take({"use_preview": float(loop.preview)})
    random = np.random.default_rng(4)
    speed, every = SPEED_KMH / 3.6, round(hmmwv.SAMPLE_TIME / MILLISECOND)
    az, command, largest = [], dict[str, float](), dict.fromkeys((*SUSPENSION, *TIRE), 0.0)
    for k in range(round(SECONDS / MILLISECOND)):
        road.take({"x": speed * k * MILLISECOND, "speed": speed})
        road.evaluator.step(MILLISECOND)
        ahead, felt = road.give(), car.give()  # as the car got there, with the road of the step before
        if k % every == 0:
            glitches = random.random() < loop.glitches
            wrong = {n: size * random.choice([-1, 1]) for n, size in GLITCH.items()} if glitches else {}
            law.take(ahead | felt | wrong)
            law.evaluator.step(hmmwv.SAMPLE_TIME)
            said = law.give()
            command = {f: said[f] for f in FORCES}
        car.take(ahead | command)
        az.append(felt["body.az"])
        largest = {n: max(v, abs(felt[n])) for n, v in largest.items()}
        car.evaluator.step(MILLISECOND)
    return {
        "samples at the limit": float(watched.reached),
        "absorbed power [W]": absorbed_power(np.array(az), 1 / MILLISECOND),
        "largest travel [mm]": 1e3 * max(largest[n] for n in SUSPENSION),
        "largest tire deflection [mm]": 1e3 * max(largest[n] for n in TIRE),
    }


def measure() -> dict[str, dict[str, float]]:
    """Every loop under every choice."""
    return {f"{loop.title}: {choice}": drive(loop, choice) for loop, choice in product(LOOPS, CHOICES)}
