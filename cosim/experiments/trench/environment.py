"""Crossing a trench as a learning environment: `gymnasium.make("suspension/TrenchCrossing-v0")`.

The 6x6 before a trench of a length that differs from episode to episode, at a speed that does: six forces every 5 ms.
What its limits are (Table 5.3 of the thesis behind the paper) is what the reward is made of, weighted as its cost
function weights them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim import StopWhen, System
from cosim.experiments.metrics.crossing import LIMITS, WEIGHTS
from cosim.experiments.trench import runs
from cosim.gym import Step
from cosim.study import Run
from fmu_sources.controllers.mpc.three_axle import FORCE_LIMIT, SAMPLE_TIME
from fmu_sources.models.corners import SIX_CORNERS

LENGTHS, SPEEDS_KMH = (0.8, 1.6), (3.0, 9.0)  # m, km/h, of an episode
SIDES = ("a1", "a2", "a3")
OBSERVED: dict[str, tuple[float, float]] = {
    "car.body.z": (-0.5, 0.5),
    "car.body.vz": (-2.0, 2.0),
    "car.body.pitch": (-0.5, 0.5),
    "car.body.pitch_rate": (-2.0, 2.0),
    "car.body.roll": (-0.2, 0.2),
    "car.body.roll_rate": (-1.0, 1.0),
    "car.speed": (0.0, 5.0),
    "car.lidar.start.dx": (-10.0, 10.0),
    "car.lidar.finish.dx": (-10.0, 10.0),
    "car.lidar.start.dz": (-3.0, 3.0),
    "car.lidar.finish.dz": (-3.0, 3.0),
    **{f"car.suspension.{k}.deflection": (-0.3, 0.3) for k in SIX_CORNERS},
    **{f"car.suspension.{k}.velocity": (-5.0, 5.0) for k in SIX_CORNERS},
}
TOUCHED = 5.0  # of a second with the belly on the ground, in parts of the cost at all limits
FAILED = -1e3  # of a step
CASE = runs.Case(LENGTHS[1], SPEEDS_KMH[1], "passive")
"""Decides where the trench begins, and where the last axle is clear of it."""


def cost(step: Step) -> float:
    """Cost per second: the negative of the weighted squares of quantities over their limits.

    The quantities are accelerations, pitch and hub forces; contact of the belly with the ground is added.
    """
    used = {
        "az": step.over("car.body.az") / LIMITS.az,
        "ax": step.over("car.body.ax") / LIMITS.ax,
        "pitch": np.degrees(step.over("car.body.pitch")) / LIMITS.pitch,
    }
    for name, axle in zip(("hub_front", "hub_middle", "hub_rear"), SIDES, strict=True):
        pair = np.maximum(*(np.abs(step.over(f"car.hub.{axle}{side}.fx")) for side in "lr"))
        used[name] = pair / 1e3 / getattr(LIMITS, name)
    total = sum(WEIGHTS[name] / 100 * float(np.mean(part**2)) for name, part in used.items())
    touching = float(np.mean(step.over("car.belly.force") > runs.TOUCH))
    return -(total + TOUCHED * touching) * step.duration


def trench(rng: np.random.Generator) -> dict[str, float]:
    """Length of the trench and speed of an episode."""
    return {
        "car.trench.length": float(rng.uniform(*LENGTHS)),
        "car.target.speed": float(rng.uniform(*SPEEDS_KMH)) / 3.6,
    }


def settings(system: Callable[[], System]) -> dict[str, Any]:
    """Arguments of `SystemEnv` for an environment whose course follows from the vehicle of its system."""
    with system() as made:
        course = runs.Course.of(Run(CASE, None, made))
    slowest = course.end / (SPEEDS_KMH[0] / 3.6)
    hubs = [f"car.hub.{k}.fx" for k in SIX_CORNERS]
    return {
        "actions": {"car.force.*": (-FORCE_LIMIT, FORCE_LIMIT)},
        "observations": OBSERVED,
        "reward": cost,
        "step": SAMPLE_TIME,
        "length": round(1.25 * slowest + 2.0, 1),
        "terminated": [StopWhen("car.x", ">=", course.end)],
        "failure_reward": FAILED,
        "scenario": trench,
        "record": ["car.body.az", "car.body.ax", "car.belly.force", *hubs],
    }
