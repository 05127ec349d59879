"""Learning environments over systems, for gymnasium: see `cosim.study.gym`, of which this is the name for users."""

from cosim.study.gym import (
    ActionError,
    EnvState,
    EpisodeOver,
    Step,
    SystemEnv,
    SystemVectorEnv,
)

__all__ = ["ActionError", "EnvState", "EpisodeOver", "Step", "SystemEnv", "SystemVectorEnv"]
