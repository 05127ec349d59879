"""Any system as an environment of gymnasium: a policy drives what nothing else drives.

    from cosim.gym import SystemEnv

`signals`: what a policy sees and does, with ranges and units, as spaces; `environment`: one environment;
`vector`: several that are stepped together; `picture`: an episode as a figure. Nothing here knows a vehicle. Needs
the extra [learning].
"""

from cosim.gym.environment import EnvState, EpisodeOver, Step, SystemEnv
from cosim.gym.signals import ActionError
from cosim.gym.vector import SystemVectorEnv

__all__ = ["ActionError", "EnvState", "EpisodeOver", "Step", "SystemEnv", "SystemVectorEnv"]
