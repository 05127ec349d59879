"""The environments of gymnasium that the experiments have.

    import gymnasium
    import cosim.experiments.environments
    env = gymnasium.make("suspension/QuarterCar-v0")

or at once `gymnasium.make("cosim.experiments.environments:suspension/QuarterCar-v0")`. gymnasium does not find them
by itself: its plugins are imported whenever it is, and importing this project decides whose `cosim` a program gets.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from build_fmus.base import extras
from build_fmus.base.layout import FMUS
from cosim.gym import SystemEnv, SystemVectorEnv
from cosim.study.fmus import FmuSet

with extras.needed("learning", "learning environments"):
    import gymnasium

NAMESPACE = "suspension"
ENVIRONMENTS = {
    "QuarterCar-v0": "cosim.experiments.bench.environment",
    "HmmwvOffRoad-v0": "cosim.experiments.hmmwv.environment",
    "TrenchCrossing-v0": "cosim.experiments.trench.environment",
}
"""Name in gymnasium -> module that makes it."""


def make(
    module: str, fmus: str | Path = FMUS, *, fmi: int = 3, render_mode: str | None = None, **options: Any
) -> SystemEnv:
    """The environment of a module.

    Args:
        module: has `system`, of the FMUs, and `settings` of a `SystemEnv`, of FMUs and options.
        fmus: folder of the FMUs, with `fmi2` and `fmi3` in it.
        fmi: version of FMI.
        render_mode: see `SystemEnv`.
        options: of `settings`.
    """
    made, files = import_module(module), FmuSet(Path(fmus), fmi)
    return SystemEnv(partial(made.system, files), render_mode=render_mode, **made.settings(files, **options))


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
