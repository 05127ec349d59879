"""A system so small that what an environment does with it is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cosim import PythonComponent, StopWhen, System
from cosim.gym import Step, SystemEnv


class Point(PythonComponent):
    """A mass of 1 kg on a line, x'' = force, exactly for a constant force. At times it raises or shows NaN."""

    inputs = ("force [N]", "wind [N]")
    outputs = ("x [m]", "v [m/s]")
    parameters = {"x0 [m]": 0.0, "raises_at [s]": 1e9, "nan_at [s]": 1e9}  # noqa: RUF012
    default_step = "1 ms"

    def begin(self) -> None:
        self.state = np.array([self.x0, 0.0])

    def start(self, u: np.ndarray, y: np.ndarray) -> None:  # noqa: ARG002
        y[:] = self.state

    def step(self, t: float, h: float, u: np.ndarray, y: np.ndarray) -> None:
        if t >= self.raises_at:
            raise ValueError("it broke")
        x, v = self.state
        a = u[0] + u[1]
        self.state = np.array([x + v * h + a * h * h / 2, v + a * h])
        y[:] = np.nan if t >= self.nan_at else self.state


class Wind(PythonComponent):
    """A force."""

    outputs = ("force [N]",)
    default_step = "1 ms"

    def start(self, u: np.ndarray, y: np.ndarray) -> None:  # noqa: ARG002
        y[:] = 1.0

    def step(self, t: float, h: float, u: np.ndarray, y: np.ndarray) -> None:
        """Nothing changes."""


def point() -> System:
    system = System()
    system.add("point", Point(), start={"wind": 0.0})
    return system


def minus_x(step: Step) -> float:
    return -abs(step["point.x"])


def random_start(rng: np.random.Generator) -> dict[str, float]:
    return {"point.x0": float(rng.uniform(-1, 1))}


SETTINGS: dict[str, Any] = {
    "actions": {"point.force": (-2.0, 4.0)},
    "observations": {"point.x": (-2.0, 2.0), "point.v": (-4.0, 4.0)},
    "reward": minus_x,
    "step": "10 ms",
    "length": "100 ms",
    "scenario": random_start,
}


def play(env: SystemEnv, actions: Sequence[Sequence[float]], **reset: Any) -> list[Any]:
    """An episode as numbers whose bits can be compared."""
    observed, _ = env.reset(**reset)
    found: list[Any] = [observed.tobytes()]
    for action in actions:
        observed, reward, *ended, _ = env.step(np.array(action))
        found.append((observed.tobytes(), np.float64(reward).tobytes(), *ended))
        if any(ended):
            break
    return found


BOUNDS = [StopWhen("point.x", ">", 0.5)]
