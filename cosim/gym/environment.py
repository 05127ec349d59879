"""One system as an environment of gymnasium."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from build_fmus.base import extras
from build_fmus.base.checks import did_you_mean
from cosim import (
    ComponentError,
    CosimError,
    Record,
    Recording,
    Simulation,
    StopWhen,
    System,
    SystemState,
    TimeError,
    UnconnectedInputsWarning,
    View,
)
from cosim.core.signals import Array
from cosim.core.time import TimeLike, positive, seconds_text
from cosim.gym.signals import Ranges, Signals, actions, observations

with extras.needed("learning", "cosim.gym"):
    import gymnasium
    from gymnasium.error import ResetNeeded

StopCondition = StopWhen | Callable[[View], bool]
Scenario = Mapping[str, Any]
"""Parameters and start values of an episode, by full name."""


class EpisodeOver(CosimError, ResetNeeded):  # noqa: N818
    """There is no episode, or it has ended: `reset` begins one."""


class Step:
    """One step of an environment, as a reward sees it.

    `step["car.body.az"]` is the present value of a variable that is observed, set or recorded,
    `step.over("car.body.az")` (m,) what it was since the step before, the present value last; `step.action` what
    was set, in the variables' units, by name. `time` [s] is where the simulation stands, `duration` [s] how long
    the step took of it.
    """

    __slots__ = ("_columns", "_rows", "_simulation", "_since", "action", "duration", "time")

    def __init__(
        self, simulation: Simulation, columns: Mapping[str, int], since: int, action: Mapping[str, float], begin: float
    ):
        self._simulation, self._columns, self._since = simulation, columns, since
        self._rows: Array | None = None
        self.action, self.time = action, simulation.time
        self.duration = self.time - begin

    def __getitem__(self, name: str) -> float:
        return self._simulation[name]

    def over(self, name: str) -> Array:
        """Samples (m,) of a variable in this step, in its unit; the present one is the last.

        Raises KeyError for one that is not recorded.
        """
        column = self._columns.get(name)
        if column is None:
            raise KeyError(f"'{name}' is not recorded{did_you_mean(name, self._columns)}; name it in record=[...]")
        if self._rows is None:
            self._rows = self._simulation.exchange.recorder.since(self._since)[1]
        found: Array = self._rows[:, column]
        return found


@dataclass(frozen=True)
class EnvState:
    """State of an environment, from `SystemEnv.save`: system, number of steps, random numbers.

    It can be pickled.
    """

    system: SystemState = field(repr=False)
    steps: int
    over: bool
    random: Mapping[str, Any] = field(repr=False)
    scenario: Scenario


class SystemEnv(gymnasium.Env[Array, Array]):
    """A system whose undriven inputs a policy drives.

    Args:
        system: a `cosim.System`, which the environment owns from then on, or a function that puts one together
            (needed for `fork`).
        actions: inputs that nothing drives, or tunable parameters, with their ranges: `{"car.force": (-8, 8)}`,
            `{"car.force.*": (-2, 2, "kN")}`. -1 and 1 of the action space are the ends of a range.
        observations: outputs, with their ranges alike; one that is beyond its range is shown at its end, and named in
            `info["beyond"]`. Without a range (`["car.body.*"]`) it has its own unit and no bound.
        reward: a function of a `Step`.
        step: time between two actions [s], a multiple of the system's tick; an action is held in between.
        length: of an episode [s], after which it is truncated; a multiple of `step`. None: it has no end.
        terminated: conditions that end an episode, as `stop_when` of `cosim.System.run`: at the instant of the
            system's own tick that fulfills one, within a step too. `info["ended_by"]` says which.
        failure_reward: what a step is worth in which a component fails, or shows a value that is not finite: the
            episode is terminated, with the message in `info["error"]` and the observation before. None:
            ComponentError, since what a failure is worth to a policy only you can say.
        scenario: a function of the environment's random numbers, seeded by `reset(seed=...)`: parameters and start
            values of the next episode by full name, such as a road's seed. `reset(options={...})` sets some by hand,
            after these. `info["scenario"]` has them.
        record: further variables that reward and `recording` need, names and patterns or a `cosim.Record`; what is
            observed or set is recorded.
        render_mode: None, or "plotly": `render` gives a plotly figure of the episode so far (needs the extra
            [reports]).

    The same actions after the same `reset(seed=...)` give bit-identical values. `reset` uses loaded FMUs and their
    instances again. A system of its own is needed for each of two environments.

    Raises:
        WiringError: names, ranges, units or connections that do not fit, see `signals`; a scenario with an unknown
            parameter.
        TimeError: a step or length that does not fit.
        EpisodeOver: a step before the first `reset`, or after the end.
        ActionError: an action that is not finite, of another shape or beyond -1 to 1.
    """

    metadata: dict[str, Any] = {"render_modes": ["plotly"], "render_fps": 1}  # noqa: RUF012

    def __init__(
        self,
        system: System | Callable[[], System],
        *,
        actions: Ranges,
        observations: Ranges,
        reward: Callable[[Step], float],
        step: TimeLike,
        length: TimeLike | None = None,
        terminated: Sequence[StopCondition] = (),
        failure_reward: float | None = None,
        scenario: Callable[[np.random.Generator], Scenario] | None = None,
        record: Record | Sequence[str] = (),
        render_mode: str | None = None,
    ):
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise CosimError(f"render_mode is {render_mode!r}; there are: None, 'plotly'")
        self._settings: dict[str, Any] = {
            "actions": actions,
            "observations": observations,
            "reward": reward,
            "step": step,
            "length": length,
            "terminated": terminated,
            "failure_reward": failure_reward,
            "scenario": scenario,
            "record": record,
            "render_mode": render_mode,
        }
        self._make = None if isinstance(system, System) else system
        self.system = system if isinstance(system, System) else system()
        self.render_mode = render_mode
        try:
            self._prepare(actions, observations, step, length, Record.of(record), terminated)
        except BaseException:
            if self._make is not None:
                self.system.close()
            raise
        self.action_space, self.observation_space = self.actions.space, self.observations.space
        self._reward, self._scenario = reward, scenario
        self._stops = list(terminated)
        self._failure_reward = None if failure_reward is None else float(failure_reward)
        self._base = {m.name: dict(m.values) for m in self.system.components.values()}
        self._simulation: Simulation | None = None
        self._steps = 0
        self._over = True
        self._given: Scenario = {}
        self._seen: Array = np.zeros(self.observation_space.shape)

    def _prepare(
        self,
        set_: Ranges,
        seen: Ranges,
        step: TimeLike,
        length: TimeLike | None,
        record: Record,
        terminated: Sequence[StopCondition],
    ) -> None:
        """Names, spaces and times, checked."""
        system = self.system
        self.actions: Signals = actions(system, set_)
        self.observations: Signals = observations(system, seen)
        free = [n for n in system.unconnected() if n not in self.actions.names]
        if free and not system.allow_unconnected:
            shown = ", ".join(free[:10]) + (f" and {len(free) - 10} more" if len(free) > 10 else "")
            text = f"inputs that no action sets keep their start values: {shown} ({UnconnectedInputsWarning.remedy})"
            warnings.warn(text, UnconnectedInputsWarning, stacklevel=4)
        system.allow_unconnected = True  # the others have been named
        interval = record.interval
        self.record_interval = None if interval is None else positive(interval, "the interval of the record")
        extra = [] if self.record_interval is None else [self.record_interval]
        tick = system.schedule(*extra).tick
        self.step_size: Fraction = positive(step, "step")
        if (self.step_size / tick).denominator != 1:
            raise TimeError(f"a step of {step} is not a multiple of the system's tick of {seconds_text(tick)}")
        if extra and (self.step_size / extra[0]).denominator != 1:
            raise TimeError(f"a step of {step} is not a multiple of the interval of the record, {interval}")
        self.steps: int | None = None
        if length is not None:
            count = positive(length, "length") / self.step_size
            if count.denominator != 1:
                raise TimeError(
                    f"an episode of {length} is not a multiple of its step of {seconds_text(self.step_size)}"
                )
            self.steps = int(count)
        recorded = system.select(
            [
                *self.observations.names,
                *self.actions.names,
                *record.names,
                *(c.name for c in terminated if isinstance(c, StopWhen)),
            ]
        )
        self._recorded = list(dict.fromkeys(f"{m.name}.{v.name}" for m, v in recorded))
        self._columns = {name: i for i, name in enumerate(self._recorded)}

    # An episode.

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: of the random numbers that `scenario` gets, from now on; None: they go on as they were.
            options: parameters and start values of this episode by full name, in place of those of the scenario.

        Returns:
            The observation, and `{"scenario": ...}`.
        """
        super().reset(seed=seed)
        given = dict(self._scenario(self.np_random)) if self._scenario is not None else {}
        given.update(options or {})
        self._begin(given)
        return self._observe()[0], {"scenario": dict(given)}

    def _begin(self, given: Scenario, state: SystemState | None = None) -> None:
        components = self.system.components
        for name, values in self._base.items():
            components[name].values = dict(values)
        for name, value in given.items():
            component, variable = components.split(name)
            component.set({variable: value})
        self._over, self._steps, self._given = True, 0, given
        self._simulation = simulation = self.system.initialize(
            record=Record(self._recorded, self.record_interval), state=state
        )
        self._set = simulation.setter(self.actions.names)
        self._advance = simulation.stepper(self.step_size, stop_when=self._stops)
        self._read = simulation.reader(self.observations.names)
        self._over = False

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Hold an action for one step.

        Returns:
            Observation, reward, whether the episode is terminated, whether it is truncated, and what is to be said:
            `ended_by` (the condition, or the component that asked for the end), `error` and `component` (of a
            failure), `beyond` (observations outside of their ranges).
        """
        simulation = self._simulation
        if simulation is None or self._over:
            raise EpisodeOver(
                "the environment was not reset: call reset() first"
                if simulation is None
                else f"the episode ended after {self._steps} steps: call reset() for the next one"
            )
        values = self.actions.values(action)
        begin, since = simulation.time, simulation.exchange.recorder.count
        try:
            self._set(values)
            ended_by = self._advance()
        except ComponentError as error:
            self._over = True
            if self._failure_reward is None:
                raise
            self._steps += 1
            info = {"error": str(error), "component": error.component}
            return self._seen.copy(), self._failure_reward, True, False, info
        self._steps += 1
        observed, info = self._observe()
        if ended_by is not None:
            info["ended_by"] = ended_by
        done = dict(zip(self.actions.names, values.tolist(), strict=True))
        reward = self._worth(Step(simulation, self._columns, since, done, begin))
        terminated = ended_by is not None
        truncated = not terminated and self._steps == self.steps
        self._over = terminated or truncated
        return observed, reward, terminated, truncated, info

    def _observe(self) -> tuple[Array, dict[str, Any]]:
        values = self._read()
        self._seen = observed = self.observations.scaled(values)
        info: dict[str, Any] = {}
        if np.abs(observed).max() >= 1.0:
            beyond = self.observations.beyond(values)
            if beyond:
                info["beyond"] = beyond
        return observed.copy(), info

    def _worth(self, step: Step) -> float:
        reward = self._reward(step)
        try:
            found = float(reward)
        except (TypeError, ValueError):
            self._over = True
            raise CosimError(f"the reward at t = {step.time:.9g} s is {reward!r}, which is not a number") from None
        if not math.isfinite(found):
            self._over = True
            raise CosimError(f"the reward at t = {step.time:.9g} s is {found}; rewards are finite")
        return found

    # Looking ahead.

    def save(self) -> EnvState:
        """Save the state, for `restore` here or in an environment made in the same way, also in another process."""
        if self._simulation is None:
            raise EpisodeOver("there is nothing to save before the first reset()")
        return EnvState(
            self._simulation.save(), self._steps, self._over, self.np_random.bit_generator.state, dict(self._given)
        )

    def restore(self, state: EnvState) -> Array:
        """Go back to a saved state, or to that of another environment; returns the observation there.

        The following steps are bit-identical to those after the `save`.
        """
        simulation = self._simulation
        owner = state.system.owner
        if simulation is not None and not simulation.finished and owner is not None and owner() is simulation.exchange:
            simulation.restore(state.system)
        else:
            self._begin(state.scenario, state.system)
        self._steps, self._over, self._given = state.steps, state.over, dict(state.scenario)
        self.np_random.bit_generator.state = state.random
        return self._observe()[0]

    def fork(self) -> SystemEnv:
        """Another environment that stands where this one stands, and goes its own way from there."""
        if self._make is None:
            raise CosimError(
                "fork needs a second system: give SystemEnv a function that returns a new System, instead of a System"
            )
        other = SystemEnv(self._make, **self._settings)
        if self._simulation is not None:
            state = self.save()
            other.restore(EnvState(SystemState.from_bytes(state.system.to_bytes()), *_rest(state)))
        return other

    # Looking at it.

    @property
    def time(self) -> float:
        """Simulated time [s] of the episode."""
        return 0.0 if self._simulation is None else self._simulation.time

    @property
    def recording(self) -> Recording:
        """What was recorded of the episode so far."""
        if self._simulation is None:
            raise EpisodeOver("there is no recording before the first reset()")
        return self._simulation.recording

    def render(self) -> Any:
        """A plotly figure of the episode so far with `render_mode="plotly"`, else None."""
        if self.render_mode is None:
            return None
        from cosim.gym.picture import picture

        return picture(self.recording, self.actions, self.observations)

    def close(self) -> None:
        """Free the FMUs."""
        self._over = True
        self._simulation = None
        self.system.close()


def _rest(state: EnvState) -> tuple[int, bool, Mapping[str, Any], Scenario]:
    return state.steps, state.over, state.random, state.scenario
