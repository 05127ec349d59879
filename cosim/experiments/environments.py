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
from inspect import signature
from pathlib import Path
from typing import Any

from build_fmus.base import extras
from build_fmus.base.checks import unknown
from build_fmus.base.layout import FMUS
from cosim import CosimError, System
from cosim.gym import SystemEnv, SystemVectorEnv
from cosim.study import FmuSet

with extras.needed("learning", "learning environments"):
    import gymnasium

NAMESPACE = "suspension"
ENVIRONMENTS = {
    "QuarterCar-v0": "cosim.experiments.bench.environment",
    "HmmwvOffRoad-v0": "cosim.experiments.hmmwv.environment",
    "TrenchCrossing-v0": "cosim.experiments.trench.environment",
}
"""Name in gymnasium -> module that declares it: `runs` and `CASE` of its system, and `settings` of a `SystemEnv`."""


def make(
    module: str, fmus: str | Path = FMUS, *, fmi: int = 3, render_mode: str | None = None, **options: Any
) -> SystemEnv:
    """The environment of a module.

    Args:
        module: its name.
        fmus: folder of the FMUs, with `fmi2` and `fmi3` in it.
        fmi: version of FMI.
        render_mode: see `SystemEnv`.
        options: of the `settings` of the module.

    Raises CosimError for other options.
    """
    given, files = import_module(module), FmuSet(Path(fmus), fmi)
    taken = ["fmus", "fmi", "render_mode", *[*signature(given.settings).parameters][1:]]
    for name in options:
        if name not in taken:
            raise CosimError(f"{module}: {unknown('option', name, taken)}")
    made = partial(system, given.runs, given.CASE, files)
    return SystemEnv(made, render_mode=render_mode, **given.settings(made, **options))


def system(runs: Any, case: Any, fmus: FmuSet) -> System:
    """The system of a case, wired and configured."""
    made: System = runs.wire(fmus, case)
    runs.configure(made, case)
    return made


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
