"""The HMMWV off road as a learning environment: `gymnasium.make("suspension/HmmwvOffRoad-v0")`.

What the paper's MPC knows and may do: the relative states, the vertical acceleration and the road 0.45 s ahead, every
30 ms; four forces on ideal actuators. The reward is what the driver feels, and the travel that the suspension has.
"""

from __future__ import annotations

from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from cosim import Record
from cosim.experiments.hmmwv import runs
from cosim.experiments.hmmwv.wiring import CONTROL_PERIOD
from cosim.gym import Step
from fmu_sources.controllers.mpc.hmmwv import PREVIEW_POINTS, MpcHmmwvWeights
from fmu_sources.models.corners import CORNERS

CASE = runs.Case("off-road", "zero", actuators="ideal")
WEIGHTS = MpcHmmwvWeights()
RANGES = {
    "car.suspension.{}.deflection": (-0.2, 0.2),
    "car.tire.{}.deflection": (-0.1, 0.1),
    "car.wheel.{}.vz": (-5.0, 5.0),
}
BODY_RANGES = {
    "car.body.vz": (-2.0, 2.0),
    "car.body.roll_rate": (-1.5, 1.5),
    "car.body.pitch_rate": (-1.5, 1.5),
    "car.body.az": (-20.0, 20.0),
}
HEIGHT = (-0.5, 0.5)  # m, of the road
STEPS = 150  # of an episode: 4.5 s, about 40 m
OFFSETS = (0.0, 600.0)  # m, where on the road episodes start; what is beyond is for tests, to 1300 m
FAILED = -1e4  # of a step; one of the passive car costs about 10


def cost(step: Step) -> float:
    """Absorbed power [W] as a mean over a step, plus 1 W for each per cent of the travel that is exceeded; negative."""
    travel = np.column_stack([step.over(f"car.suspension.{k}.deflection") for k in CORNERS])
    beyond = np.maximum(0.0, np.abs(travel) / WEIGHTS.max_travel - 1.0)
    return -float(step.over("comfort.absorbed_power").mean() + 100.0 * beyond.max(axis=1).mean())


def somewhere(rng: np.random.Generator, within: tuple[float, float] = OFFSETS) -> dict[str, float]:
    """Where on the road an episode starts."""
    return {"road.offset": float(rng.uniform(*within))}


def settings(_: Any, offsets: tuple[float, float] = OFFSETS, preview: bool = True) -> dict[str, Any]:
    """Arguments of `SystemEnv`.

    Args:
        offsets: where on the road episodes start [m], within 0 to 1300.
        preview: the road ahead is observed, 16 heights under each wheel, 30 ms apart.
    """
    seen = {name.format(k): limits for name, limits in RANGES.items() for k in CORNERS} | BODY_RANGES
    if preview:
        seen |= {f"road.preview.{k}[{i}]": HEIGHT for k in CORNERS for i in range(1, PREVIEW_POINTS + 1)}
    return {
        "actions": {"car.force.*": (-WEIGHTS.max_force, WEIGHTS.max_force)},
        "observations": seen,
        "reward": cost,
        "step": CONTROL_PERIOD,
        "length": STEPS * Fraction(CONTROL_PERIOD).limit_denominator(1000),
        "failure_reward": FAILED,
        "scenario": partial(somewhere, within=offsets),
        "record": Record(["comfort.absorbed_power"], "1 ms"),
    }
