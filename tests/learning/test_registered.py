"""The environments of the experiments, as a user gets them from gymnasium."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from built import FMUS, BuiltFmus
from gymnasium.utils.env_checker import check_env
from point import play

from cosim import CosimError, Record
from cosim.experiments.environments import ENVIRONMENTS, NAMESPACE
from cosim.gym import SystemEnv, SystemVectorEnv

NAMES = [f"{NAMESPACE}/{name}" for name in ENVIRONMENTS]


@pytest.fixture(params=NAMES)
def name(
    request: pytest.FixtureRequest,
    built_fmus: BuiltFmus,  # noqa: ARG001
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[str]:
    (tmp_path / "fmus").symlink_to(FMUS, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield request.param


def made(name: str, **options: Any) -> SystemEnv:
    env = gymnasium.make(name, **options).unwrapped
    assert isinstance(env, SystemEnv)
    return env


def test_gymnasium_finds_nothing_wrong(name: str) -> None:
    """Warnings are errors here."""
    env = made(name)
    check_env(env)
    env.close()


def test_an_option_that_there_is_not_is_named(name: str) -> None:
    with pytest.raises(CosimError, match="no option 'offset'"):
        made(name, offset=1.0)


def test_same_actions_same_bits_alone_and_together(name: str) -> None:
    vector = gymnasium.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
    assert isinstance(vector.unwrapped, SystemVectorEnv)
    actions = np.random.default_rng(0).uniform(-1, 1, (12, *vector.single_action_space.shape))  # type: ignore[misc]
    env = made(name)
    alone = [play(env, actions, seed=s) for s in (4, 5)]
    assert play(env, actions, seed=4) == alone[0] != alone[1]
    together = [[o.tobytes()] for o in vector.reset(seed=4)[0]]
    for a in actions:
        observed, rewards, terminated, truncated, _ = vector.step(np.stack([a, a]))
        for i in range(2):
            together[i].append((observed[i].tobytes(), rewards[i].tobytes(), bool(terminated[i]), bool(truncated[i])))  # type: ignore[arg-type]
    assert together == alone
    env.close()
    vector.close()


def test_both_versions_of_fmi(name: str) -> None:
    """To the last bit, since the FMUs are the same code."""
    actions = np.random.default_rng(1).uniform(-1, 1, (5, *made(name).action_space.shape))  # type: ignore[misc]
    env = made(name)
    expected = play(env, actions, seed=1)
    assert play(made(name, fmi=2), actions, seed=1) == expected


def test_without_action_it_is_the_passive_run_and_an_action_matters(name: str) -> None:
    env = made(name)
    still = np.zeros(env.action_space.shape)
    passive = play(env, [still] * 20, seed=2)
    assert play(env, [still + 0.2] * 20, seed=2)[5] != passive[5]
    env.reset(seed=2)
    for _ in range(20):
        env.step(still)
    by_env = env.recording
    with env.system.initialize(record=Record(by_env.names, env.record_interval)) as simulation:
        simulation.advance(env.time)
        np.testing.assert_array_equal(by_env.data, simulation.recording.data)
    env.close()


def test_a_state_in_another_environment(name: str) -> None:
    env = made(name)
    actions = np.random.default_rng(2).uniform(-1, 1, (8, *env.action_space.shape))  # type: ignore[misc]
    whole = play(env, actions, seed=6)
    env.reset(seed=6)
    for a in actions[:3]:
        env.step(a)
    fork = env.fork()
    env.step(-actions[0])
    rest = [(o.tobytes(), np.float64(r).tobytes(), *e) for o, r, *e, _ in (fork.step(a) for a in actions[3:])]
    assert rest == whole[4:]
    fork.close()
    env.close()
