"""Several environments of one kind, stepped together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from build_fmus.base import extras
from build_fmus.base.checks import whole_number
from cosim import CosimError
from cosim.core.signals import Array
from cosim.gym.environment import EnvState, SystemEnv
from cosim.gym.signals import ActionError

with extras.needed("learning", "cosim.gym"):
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space

Flags = npt.NDArray[np.bool_]


class SystemVectorEnv(VectorEnv[Array, Array, npt.NDArray[Any]]):
    """`count` environments made by one function, run in turn in this process, each bit-identical to a single one.

    An environment whose episode has ended begins the next one at the following step, with reward 0 (gymnasium's
    NEXT_STEP). Seeds of `reset` are `seed`, `seed + 1`, ... or a list of seeds. `envs` are the environments. For
    processes: `gymnasium.vector.AsyncVectorEnv([make] * count)`.

    Raises:
        CosimError: an environment with different spaces.
        ActionError: actions of another shape than (count, n).
    """

    def __init__(self, make: Callable[[], SystemEnv], count: int):
        whole_number("count", count, error=CosimError)
        self.envs: list[SystemEnv] = []
        try:
            for _ in range(count):
                self.envs.append(make())
        except BaseException:
            self._close_all()
            raise
        first = self.envs[0]
        for env in self.envs[1:]:
            if (env.action_space, env.observation_space) != (first.action_space, first.observation_space):
                self._close_all()
                raise CosimError("the environments differ from the first one in their action or observation space")
        self.num_envs = count
        self.metadata = {**first.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}
        self.render_mode = first.render_mode
        self.single_action_space, self.single_observation_space = first.action_space, first.observation_space
        self.action_space = batch_space(first.action_space, count)
        self.observation_space = batch_space(first.observation_space, count)
        self._ended: Flags = np.ones(count, dtype=np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode in each environment; returns observations (count, n) and infos.

        `options` are those of `SystemEnv.reset`, for all.
        """
        if seed is None or isinstance(seed, int | np.integer):
            seeds: Sequence[int | None] = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = seed
        if len(seeds) != self.num_envs:
            raise CosimError(f"{len(seeds)} seeds for {self.num_envs} environments")
        infos: dict[str, Any] = {}
        observed = np.empty(self.observation_space.shape or ())
        for i, (env, one) in enumerate(zip(self.envs, seeds, strict=True)):
            observed[i], info = env.reset(seed=one, options=options)
            infos = self._add_info(infos, info, i)
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        return observed, infos

    def step(
        self, actions: Array
    ) -> tuple[Array, npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], dict[str, Any]]:
        """One step of each with its row of `actions` (count, n)."""
        given = np.asarray(actions)
        if given.shape != self.action_space.shape:
            raise ActionError(
                f"the actions have shape {given.shape}; give {self.action_space.shape}, a row for each environment"
            )
        observed, rewards = np.empty(self.observation_space.shape or ()), np.zeros(self.num_envs)
        terminated, truncated = (np.zeros(self.num_envs, dtype=np.bool_) for _ in range(2))
        infos: dict[str, Any] = {}
        for i, env in enumerate(self.envs):
            if self._ended[i]:
                observed[i], info = env.reset()
            else:
                observed[i], rewards[i], terminated[i], truncated[i], info = env.step(given[i])
            if info:
                infos = self._add_info(infos, info, i)
        self._ended = terminated | truncated
        return observed, rewards, terminated, truncated, infos

    # Looking ahead.

    def save(self) -> list[EnvState]:
        """Where each stands, see `SystemEnv.save`."""
        return [env.save() for env in self.envs]

    def restore(self, states: Sequence[EnvState]) -> Array:
        """Go back to saved states, one for each environment; returns the observations (count, n) there.

        An episode that had ended there begins from scratch with the next step.
        """
        if len(states) != self.num_envs:
            raise CosimError(f"{len(states)} states for {self.num_envs} environments")
        observed = np.stack([env.restore(state) for env, state in zip(self.envs, states, strict=True)])
        self._ended = np.array([state.over for state in states])
        return observed

    def render(self) -> tuple[Any, ...] | None:
        """A picture of each, see `SystemEnv.render`."""
        return None if self.render_mode is None else tuple(env.render() for env in self.envs)

    def close_extras(self, **_: Any) -> None:
        """Free the FMUs of all."""
        self._close_all()

    def _close_all(self) -> None:
        for env in self.envs:
            env.close()
