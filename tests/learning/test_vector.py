"""Several environments together are several single ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from point import BOUNDS, SETTINGS, point

from cosim import CosimError
from cosim.gym import ActionError, SystemEnv, SystemVectorEnv

Make = Callable[..., SystemEnv]
COUNT, STEPS = 3, 25


def one(**changes: object) -> SystemEnv:
    return SystemEnv(point, **{**SETTINGS, "terminated": BOUNDS, **changes})


def test_bit_for_bit_and_over_the_ends_of_episodes() -> None:
    """Episodes end at different times.

    A single one is reset where it has ended, as the vector does at its next step.
    """
    actions = np.random.default_rng(1).uniform(0, 1, (STEPS, COUNT, 1))
    vector = SystemVectorEnv(one, COUNT)
    observed, infos = vector.reset(seed=5)
    found = [[observed[i].tobytes()] for i in range(COUNT)]
    assert infos["scenario"]["point.x0"].shape == (COUNT,)
    ends = np.zeros(COUNT, dtype=int)
    for row in actions:
        observed, rewards, terminated, truncated, infos = vector.step(row)
        assert observed in vector.observation_space
        ends += terminated | truncated
        assert all(infos["ended_by"][i] == "point.x > 0.5" for i in np.flatnonzero(terminated))
        for i in range(COUNT):
            found[i].append((observed[i].tobytes(), rewards[i].tobytes(), bool(terminated[i]), bool(truncated[i])))
    vector.close()
    assert len(set(ends)) > 1
    for i in range(COUNT):
        env = one()
        alone, over = [env.reset(seed=5 + i)[0].tobytes()], False
        for row in actions:
            if over:
                alone.append((env.reset()[0].tobytes(), np.float64(0).tobytes(), False, False))
                over = False
                continue
            seen, reward, terminated_, truncated_, _ = env.step(row[i])
            alone.append((seen.tobytes(), np.float64(reward).tobytes(), terminated_, truncated_))
            over = terminated_ or truncated_
        env.close()
        assert alone == found[i]


def test_saved_together_and_restored(raises) -> None:
    vector = SystemVectorEnv(one, COUNT)
    vector.reset(seed=[1, None, 3])
    vector.step(np.full((COUNT, 1), 0.5))
    states = vector.save()
    after = vector.step(np.full((COUNT, 1), 0.5))[0].tobytes()
    vector.step(np.full((COUNT, 1), -0.5))
    vector.restore(states)
    assert vector.step(np.full((COUNT, 1), 0.5))[0].tobytes() == after
    with raises(CosimError):
        vector.restore(states[:2])
    vector.close()


def test_what_users_do_wrong(raises, refused) -> None:
    vector = SystemVectorEnv(one, COUNT)
    with raises(CosimError):
        vector.reset(seed=[1, 2])
    vector.reset(seed=np.int64(4))
    refused(ActionError, lambda: vector.step(np.zeros(COUNT)), lambda: vector.step(np.full((COUNT, 1), np.nan)))
    vector.close()
    with raises(CosimError):
        SystemVectorEnv(one, 0)
    different = iter([one(), one(observations=["point.x"])])
    with raises(CosimError):
        SystemVectorEnv(lambda: next(different), 2)
