"""What an environment does with a system of which everything is known; what users can do wrong."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable

import numpy as np
import pytest
from point import BOUNDS, Point, Wind, play, point

from cosim import ComponentError, CosimError, Record, System, TimeError, UnconnectedInputsWarning, WiringError
from cosim.gym import ActionError, EpisodeOver, Step, SystemEnv

Make = Callable[..., SystemEnv]


def action_of(force: float) -> np.ndarray:
    """The action that is a force [N] between -2 and 4."""
    return np.array([(force - 1.0) / 3.0])


def test_a_step_is_that_of_the_mass_and_ranges_are_its_units(make: Make) -> None:
    env = make(scenario=None)
    observed, info = env.reset()
    assert (observed == 0).all()
    assert info == {"scenario": {}}
    observed, reward, terminated, truncated, info = env.step(action_of(3.0))
    x, v = 3.0 * 0.01**2 / 2, 3.0 * 0.01
    np.testing.assert_allclose(observed, [x / 2.0, v / 4.0], rtol=1e-12)
    assert (reward, terminated, truncated, info) == (pytest.approx(-x), False, False, {})
    assert env.time == 0.01


@pytest.mark.parametrize(("end", "force"), [(-1.0, -2.0), (1.0, 4.0)])
def test_the_ends_of_the_space_are_those_of_the_range_exactly(make: Make, end: float, force: float) -> None:
    env = make()
    env.reset()
    env.step(np.array([end]))
    assert env.recording["point.force"][-1] == force


def test_units_of_ranges_are_converted(make: Make) -> None:
    env = make(actions={"point.force": (-1.0, 1.0, "kN")}, observations={"point.x": (-5.0, 5.0, "mm")}, scenario=None)
    env.reset()
    observed = env.step(np.array([0.05]))[0]  # 50 N for 10 ms: 2.5 mm
    assert observed[0] == pytest.approx(0.5)


def test_without_a_range_a_variable_has_its_own_unit_and_no_bound(make: Make) -> None:
    env = make(observations=["point.*"], actions="point.force", scenario=None)
    assert np.isinf(env.observation_space.high).all()
    env.reset()
    assert env.step(np.array([700.0]))[0] == pytest.approx([0.035, 7.0])


def test_an_observation_beyond_its_range_is_shown_at_its_end_and_named(make: Make) -> None:
    env = make(observations={"point.x": (-2.0, 2.0), "point.v": (-0.01, 0.01)}, scenario=None)
    env.reset()
    observed, *_, info = env.step(action_of(2.0))
    assert observed[1] == 1.0
    assert info == {"beyond": ["point.v"]}
    assert observed in env.observation_space


def test_an_episode_is_truncated_at_its_length(make: Make, raises) -> None:
    env = make()
    env.reset(seed=1)
    ends = [env.step(action_of(0.0))[2:4] for _ in range(10)]
    assert ends == [(False, False)] * 9 + [(False, True)]
    with raises(EpisodeOver):
        env.step(action_of(0.0))


def test_a_condition_terminates_at_its_instant_within_a_step(make: Make) -> None:
    env = make(terminated=BOUNDS, length=None, scenario=None)
    env.reset(options={"point.x0": 0.499})
    for _ in range(100):
        observed, _, terminated, truncated, info = env.step(action_of(4.0))
        if terminated:
            break
    assert not truncated
    assert info["ended_by"] == "point.x > 0.5"
    last = math.ceil(math.sqrt(2 * 0.001 / 4.0) * 1000) / 1000
    assert env.time == pytest.approx(last)
    assert observed[0] == pytest.approx((0.499 + 4.0 * last**2 / 2) / 2)


def test_a_condition_may_be_a_function(make: Make) -> None:
    env = make(terminated=[lambda view: view.time >= 0.025], length=None)
    env.reset()
    assert [env.step(action_of(0.0))[2] for _ in range(3)] == [False, False, True]
    assert env.time == 0.025


def test_rewards_see_the_whole_step(make: Make, raises) -> None:
    seen: list[Step] = []

    def reward(step: Step) -> float:
        seen.append(step)
        with raises(KeyError):
            step.over("point.y")
        return float(step.over("point.v").mean())

    env = make(reward=reward, scenario=None)
    env.reset()
    rewards = [env.step(action_of(2.0))[1] for _ in range(3)]
    mean = np.mean(2.0 * 0.001 * np.arange(1, 11))
    np.testing.assert_allclose(rewards, [mean, mean + 0.02, mean + 0.04], rtol=1e-12)
    assert [len(s.over("point.v")) for s in seen] == [10, 10, 10]
    assert [(s.action, s.time, s.duration) for s in seen[:2]] == [
        ({"point.force": 2.0}, 0.01, pytest.approx(0.01)),
        ({"point.force": 2.0}, 0.02, pytest.approx(0.01)),
    ]
    assert seen[-1]["point.v"] == pytest.approx(0.06)


def test_the_steps_are_those_of_a_run_by_hand(make: Make) -> None:
    """Against `advance` and `set`, which the environment does not call."""
    env = make(scenario=None)
    forces = [1.0, -2.0, 3.0, 0.5]
    play(env, [action_of(f) for f in forces])
    with point() as system:
        system.allow_unconnected = True
        simulation = system.initialize(record=["point.x", "point.v"])
        for k, force in enumerate(forces, start=1):
            simulation.set("point.force", float(env.actions.values(action_of(force))[0]))
            simulation.advance(k / 100)
        by_hand = simulation.recording
    for name in ("point.x", "point.v"):
        assert env.recording[name].tobytes() == by_hand[name].tobytes()
    assert env.recording.time.tobytes() == by_hand.time.tobytes()


# -------------------------------------------------------------------------------------------------- seeds and scenarios


def test_seeds_choose_scenarios_and_options_come_after_them(make: Make) -> None:
    env = make()
    one, two = (env.reset(seed=s)[1]["scenario"] for s in (1, 2))
    assert one != two
    assert env.reset(seed=1)[1]["scenario"] == one
    assert env.reset()[1]["scenario"] not in (one, two)
    observed, info = env.reset(seed=1, options={"point.x0": 0.25})
    assert info["scenario"] == {"point.x0": 0.25}
    assert observed[0] == 0.125
    assert env.reset(seed=1)[1]["scenario"] == one  # options are for one episode


def test_the_same_actions_give_the_same_bits(make: Make) -> None:
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 1))
    env = make()
    first = play(env, actions, seed=7)
    assert play(env, actions, seed=8) != first
    assert play(env, actions, seed=7) == first == play(make(), actions, seed=7)


# -------------------------------------------------------------------------------------------------------- looking ahead


def test_back_to_a_saved_state_and_on_with_the_same_bits(make: Make) -> None:
    env = make()
    actions = np.random.default_rng(0).uniform(-1, 1, (10, 1))
    whole = play(env, actions, seed=3)
    env.reset(seed=3)
    for a in actions[:4]:
        before, *_ = env.step(a)
    state = env.save()
    drawn = env.np_random.random()

    def on(env: SystemEnv) -> list[object]:
        return [(o.tobytes(), np.float64(r).tobytes(), *e) for o, r, *e, _ in (env.step(a) for a in actions[4:])]

    assert on(env) == whole[5:]
    for back in (env, make()):  # where the episode was over, and in another environment
        assert back.restore(state if back is env else pickle.loads(pickle.dumps(state))).tobytes() == before.tobytes()
        assert back.np_random.random() == drawn
        assert on(back) == whole[5:]
    env.reset(seed=9)
    env.restore(state)  # in another episode
    assert on(env) == whole[5:]


def test_a_fork_goes_its_own_way(make: Make) -> None:
    env = make(length=None, scenario=None)
    env.reset()
    env.step(action_of(1.0))
    fork = env.fork()
    try:
        for _ in range(3):
            fork.step(action_of(4.0))
        assert env.time == 0.01
        assert fork.time == 0.04
        a, b = env.step(action_of(0.0))[0], env.fork()
        there, here = (e.save().system for e in (b, env))
        assert dict(zip(there.keys, there.values, strict=True)) == dict(zip(here.keys, here.values, strict=True))
        assert a[1] == pytest.approx(0.01 / 4)
        b.close()
    finally:
        fork.close()


def test_planning_leaves_no_trace(make: Make) -> None:
    """An episode in which every action is chosen by trying three has the bits of one with the actions alone."""
    env = make()
    env.reset(seed=1)
    chosen, played = [], []
    for _ in range(10):
        state = env.save()
        worth = []
        for a in (-1.0, 0.0, 1.0):
            worth.append(env.step(np.array([a]))[1])
            env.restore(state)
        chosen.append([(-1.0, 0.0, 1.0)[int(np.argmax(worth))]])
        observed, reward, *ended, _ = env.step(np.array(chosen[-1]))
        played.append((observed.tobytes(), np.float64(reward).tobytes(), *ended))
    assert play(env, chosen, seed=1)[1:] == played


# ------------------------------------------------------------------------------------------------------------- failures

FAILURES = {"raises_at": "it broke", "nan_at": "(x|v) is nan at t = "}


@pytest.mark.parametrize("parameter", FAILURES)
def test_a_failure_raises_unless_it_has_a_worth(make: Make, parameter: str, raises) -> None:
    at = {f"point.{parameter}": 0.015}
    env = make()
    env.reset(options=at)
    env.step(action_of(0.0))
    with pytest.raises(ComponentError, match=FAILURES[parameter]):
        env.step(action_of(0.0))
    with raises(EpisodeOver):
        env.step(action_of(0.0))
    env.reset()
    env.step(action_of(0.0))

    env = make(failure_reward=-50)
    env.reset(options=at)
    before = env.step(action_of(1.0))[0]
    observed, reward, terminated, truncated, info = env.step(action_of(0.0))
    assert (observed.tobytes(), reward, terminated, truncated) == (before.tobytes(), -50.0, True, False)
    assert info["component"] == "point"
    assert "point" in info["error"]
    with pytest.raises(EpisodeOver):
        env.step(action_of(0.0))


@pytest.mark.parametrize("worth", [math.nan, "much"])
def test_a_reward_that_is_none(make: Make, worth: object, raises) -> None:
    env = make(reward=lambda step: worth)
    env.reset()
    with raises(CosimError):
        env.step(action_of(0.0))


# -------------------------------------------------------------------------------------------------- what users do wrong


@pytest.mark.parametrize("action", [[math.nan], [math.inf], [1.2], [0.0, 0.0], 0.0, ["up"]])
def test_actions_that_are_none(make: Make, action: object, raises) -> None:
    env = make()
    env.reset()
    with raises(ActionError):
        env.step(action)  # type: ignore[arg-type]
    env.step(action_of(0.0))  # nothing has happened


def test_a_step_before_the_first_reset(make: Make) -> None:
    for call in (lambda e: e.step(np.zeros(1)), lambda e: e.save(), lambda e: e.recording):
        with pytest.raises(EpisodeOver, match="reset"):
            call(make())


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({"actions": {"point.fource": (-1, 1)}}, WiringError),
        ({"actions": {"pint.force": (-1, 1)}}, WiringError),
        ({"actions": {"point.x*": (-1, 1)}}, WiringError),
        ({"actions": {"point.x": (-1, 1)}}, WiringError),
        ({"actions": {"point.force": (1, -1)}}, WiringError),
        ({"actions": {"point.force": (1, 1)}}, WiringError),
        ({"actions": {"point.force": (-math.inf, 1)}}, WiringError),
        ({"actions": {"point.force": (-1, 1, "m")}}, WiringError),
        ({"actions": {"point.force": (-1, 1, "kn")}}, WiringError),
        ({"actions": {"point.force": 3}}, WiringError),
        ({"actions": {}}, WiringError),
        ({"actions": 3}, WiringError),
        ({"actions": ["point.force", "point.f*"]}, WiringError),
        ({"observations": {"point.y": (-1, 1)}}, WiringError),
        ({"observations": {"point.x": (2, -2)}}, WiringError),
        ({"observations": []}, WiringError),
        ({"observations": ["point.x", "point.x"]}, WiringError),
        ({"record": ["point.z"]}, WiringError),
        ({"step": "1.5 ms"}, TimeError),
        ({"step": 0}, TimeError),
        ({"length": "15 ms"}, TimeError),
        ({"record": Record(interval="3 ms")}, TimeError),
        ({"render_mode": "human"}, CosimError),
    ],
)
def test_settings_that_do_not_fit(make: Make, changes: dict[str, object], kind: type[Exception], raises) -> None:
    with raises(kind):
        make(**changes)


def test_an_action_on_an_input_that_is_driven(make: Make, raises) -> None:
    with point() as system:
        system.add("wind", Wind())
        system.connect("wind.force", "point.force")
        with raises(WiringError):
            make(system)


def test_inputs_that_no_action_sets_are_named(make: Make, warns) -> None:
    system = System()
    system.add("point", Point())
    with warns(UnconnectedInputsWarning):
        make(system)
    allowed = System(allow_unconnected=True)
    allowed.add("point", Point())
    make(allowed)


def test_scenarios_and_options_of_unknown_parameters(make: Make) -> None:
    env = make(scenario=lambda rng: {"point.x1": 0.0})
    with pytest.raises(WiringError, match="no variable 'x1'"):
        env.reset()
    env = make()
    for options, said in (({"point.x1": 0.0}, "no variable 'x1'"), ({"x0": 0.0}, "write component.variable")):
        with pytest.raises(WiringError, match=said):
            env.reset(options=options)
        with pytest.raises(EpisodeOver):
            env.step(action_of(0.0))
    env.reset()


def test_a_fork_needs_a_function(make: Make, raises) -> None:
    env = make(point())
    env.reset()
    with raises(CosimError):
        env.fork()


def test_a_state_of_another_system_is_refused(make: Make, raises) -> None:
    def two() -> System:
        system = point()
        system.add("second", Point(), start={"force": 0.0, "wind": 0.0})
        return system

    env, other = make(), make(two)
    env.reset()
    other.reset()
    with raises(CosimError):
        env.restore(other.save())


def test_closed_twice_is_closed(make: Make) -> None:
    env = make()
    env.reset()
    env.close()
    env.close()


def test_an_episode_as_a_picture(make: Make) -> None:
    env = make(render_mode="plotly")
    env.reset()
    env.step(action_of(1.0))
    figure = env.render()
    assert {t.name for t in figure.data} == {"point.force", "point.x", "point.v"}
    assert make().render() is None
