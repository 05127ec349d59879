"""The bench as a learning environment: `gymnasium.make("suspension/QuarterCar-v0")`.

What its LQR and its MPC know and may do: the four states every 10 ms, 8 N, and their index as the cost.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from cosim import Record, StopWhen
from cosim.experiments.bench import runs
from cosim.gym import Step
from fmu_sources.controllers.lq.bench import FORCE_WEIGHT, WEIGHTS
from fmu_sources.controllers.mpc.bench import FORCE_LIMIT, MPC_PERIOD
from fmu_sources.models.bench_states import STATES

CASE = runs.Case("passive", "random")
FORCE = "plant.force"
RANGES = {
    "suspension.deflection": (-0.04, 0.04),
    "body.vz": (-0.5, 0.5),
    "tire.deflection": (-0.04, 0.04),
    "wheel.vz": (-1.0, 1.0),
}
"""Of the states [SI]: some three times what the passive bench reaches on the random road."""
LENGTH = 5.0  # s, of an episode
LIFTED = 0.15  # m, of suspension travel: the bench would be broken
OFFSETS = (0.0, 5e4)  # s, where in the random motion episodes start; what is beyond is for tests
FAILED = -1000.0  # of a step, where an undisturbed one costs 0 and a passive one about 0.1


def cost(step: Step) -> float:
    """The index of LqrBench, negative, as a mean over a step."""
    states = np.column_stack([step.over(f"plant.{name}") for name in STATES])
    return -float(np.mean(states**2 @ np.array(WEIGHTS)) + FORCE_WEIGHT * step.action[FORCE] ** 2)


def somewhere(rng: np.random.Generator, within: tuple[float, float] = OFFSETS) -> dict[str, float]:
    """Where in the random motion an episode starts."""
    return {"road.offset": float(rng.uniform(*within))}


def settings(_: Any, offsets: tuple[float, float] = OFFSETS) -> dict[str, Any]:
    """Arguments of `SystemEnv`; `offsets`: where in the random motion episodes start [s], within 0 to 1e5."""
    travel = "plant.suspension.deflection"
    return {
        "actions": {FORCE: (-FORCE_LIMIT, FORCE_LIMIT)},
        "observations": {f"plant.{name}": RANGES[name] for name in STATES},
        "reward": cost,
        "step": MPC_PERIOD,
        "length": LENGTH,
        "terminated": [StopWhen(travel, ">", LIFTED), StopWhen(travel, "<", -LIFTED)],
        "failure_reward": FAILED,
        "scenario": partial(somewhere, within=offsets),
        "record": Record(["plant.body.az"], "1 ms"),
    }
