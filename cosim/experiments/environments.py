"""The environments of gymnasium that the experiments have.

    import gymnasium
    import cosim.experiments.environments
    env = gymnasium.make("suspension/QuarterCar-v0")

or at once `gymnasium.make("cosim.experiments.environments:suspension/QuarterCar-v0")`. gymnasium does not find them
by itself: its plugins are imported whenever it is, and importing this project decides whose `cosim` a program gets.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

from build_fmus.base import extras
from cosim.gym import SystemEnv, SystemVectorEnv

with extras.needed("learning", "learning environments"):
    import gymnasium

NAMESPACE = "suspension"
ENVIRONMENTS = {
    "QuarterCar-v0": "cosim.experiments.bench.environment",
    "HmmwvOffRoad-v0": "cosim.experiments.hmmwv.environment",
    "TrenchCrossing-v0": "cosim.experiments.trench.environment",
}
"""Name in gymnasium -> module that makes it."""


def make(module: str, **options: Any) -> SystemEnv:
    """The environment of a module."""
    found: Callable[..., SystemEnv] = import_module(module).environment
    return found(**options)


def make_vector(module: str, num_envs: int = 1, **options: Any) -> SystemVectorEnv:
    """Several of them."""
    return SystemVectorEnv(partial(make, module, **options), num_envs)


def register() -> None:
    """Tell gymnasium of them, once."""
    for name, module in ENVIRONMENTS.items():
        full = f"{NAMESPACE}/{name}"
        if full not in gymnasium.registry:
            gymnasium.register(
                full,
                entry_point=f"{__name__}:make",
                vector_entry_point=f"{__name__}:make_vector",
                kwargs={"module": module},
            )


register()
