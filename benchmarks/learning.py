"""Cost of a step of a learning environment.

As a multiple of simulating the same time with the same recording in one run.
"""

from __future__ import annotations

import time

import gymnasium
import numpy as np

from benchmarks import spent
from cosim import Record
from cosim.experiments.environments import ENVIRONMENTS, NAMESPACE
from cosim.gym import SystemEnv

ROUNDS = 3


def processor_time(env: SystemEnv, steps: int) -> tuple[float, float, float]:
    """Of a step, of the bare simulation of its time, of a reset [s], the best of some rounds."""
    still = np.zeros(env.action_space.shape or ())

    def once() -> tuple[float, float, float]:
        reset = spent(lambda: env.reset(seed=1))
        begin, done, over = time.process_time(), 0, False
        while done < steps and not over:
            *_, terminated, truncated, _ = env.step(still)
            done, over = done + 1, terminated or truncated
        stepped = time.process_time() - begin
        names, interval = env.recording.names, env.record_interval
        env.system.allow_unconnected = True
        with env.system.initialize(record=Record(names, interval)) as simulation:
            bare = spent(simulation.advance, done * env.step_size)
        return stepped / done, bare / done, reset

    return tuple(np.min([once() for _ in range(ROUNDS)], axis=0).tolist())


def measure(steps: int = 400) -> dict[str, float]:
    """Ratios by environment."""
    found: dict[str, float] = {}
    for name in ENVIRONMENTS:
        made = gymnasium.make(f"{NAMESPACE}/{name}").unwrapped
        assert isinstance(made, SystemEnv)
        step, bare, reset = processor_time(made, steps)
        made.close()
        found |= {f"{name}, step / bare simulation": step / bare, f"{name}, reset / step": reset / step}
    return found
