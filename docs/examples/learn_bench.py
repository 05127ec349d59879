"""A policy that is learned, beside the LQR and the MPC of the quarter-car bench, on roads that it has not seen.

    python docs/examples/learn_bench.py

An evolution strategy in NumPy (no gradients of the plant, no deep-learning framework) adjusts the 24 weights of a small
network that sees what the published controllers see, the four states, and sets the force every 10 ms. The cost is their
index, and so is what is compared.
"""

from __future__ import annotations

import argparse

import gymnasium
import numpy as np

import cosim.experiments.environments  # noqa: F401  # so that gymnasium knows them
from cosim import Record
from cosim.experiments.bench.environment import OFFSETS
from cosim.experiments.bench.runs import Case, configure, wire
from cosim.study import FmuSet
from fmu_sources.controllers.lq.bench import FORCE_WEIGHT, WEIGHTS
from fmu_sources.models.bench_states import STATES

HIDDEN, POPULATION = 4, 16
SPREAD, LAST_SPREAD = 0.3, 0.02  # of the candidates, at the beginning and in the end
UNSEEN = [
    OFFSETS[1] + 5e3 * i for i in range(10)
]  # s, where in the road's motion the comparison starts; training stays below
SECONDS = 10.0  # of each comparison


class Policy:
    """A network with one layer of tanh; of several at once where the parameters have a leading axis."""

    size = 4 * HIDDEN + HIDDEN + HIDDEN  # weights, their biases, weights of the sum: odd in the states at rest

    def __init__(self, parameters: np.ndarray):
        shape = parameters.shape[:-1]
        first, bias, last = np.split(parameters, [4 * HIDDEN, 5 * HIDDEN], axis=-1)
        self._first, self._bias, self._last = first.reshape(*shape, HIDDEN, 4), bias, last

    def __call__(self, states: np.ndarray) -> np.ndarray:
        hidden = np.tanh(10 * np.einsum("...ij,...j->...i", self._first, states) + self._bias)
        still = np.tanh(self._bias)  # at rest there is no force
        return np.clip(np.einsum("...i,...i->...", self._last, hidden - still), -1, 1)[..., None]


def train(generations: int, seed: int = 0) -> np.ndarray:
    """Parameters after so many generations.

    All of a generation drive the same road, and the next center is their weighted mean.
    """
    random = np.random.default_rng(seed)
    envs = gymnasium.make_vec("suspension/QuarterCar-v0", num_envs=POPULATION, vectorization_mode="vector_entry_point")
    center = np.concatenate([0.1 * random.standard_normal(5 * HIDDEN), np.zeros(HIDDEN)])
    best = POPULATION // 4
    ranks = np.log(best + 0.5) - np.log(np.arange(1, best + 1))  # weights of the best, as usual in evolution strategies
    ranks /= ranks.sum()
    for generation in range(generations):
        spread = SPREAD * (LAST_SPREAD / SPREAD) ** (generation / generations)
        noise = random.standard_normal((POPULATION // 2, Policy.size))
        noise = np.concatenate([noise, -noise])
        policy, total = Policy(center + spread * noise), np.zeros(POPULATION)
        states, _ = envs.reset(options={"road.offset": float(random.uniform(*OFFSETS))})
        running = np.ones(POPULATION, dtype=bool)
        while running.any():
            states, rewards, terminated, truncated, _ = envs.step(policy(states))
            total += running * rewards
            running &= ~(terminated | truncated)
        center = center + spread * ranks @ noise[np.argsort(-total)[:best]]
        if generation % 20 == 19:
            print(f"generation {generation + 1}: mean cost {-total.mean() / 500:.4f}", flush=True)
    envs.close()
    return center


def index(states: np.ndarray, force: np.ndarray) -> float:
    """The index of LQR and MPC, a mean over time, from states (samples, 4) and forces (samples,)."""
    return float(np.mean(states**2 @ np.array(WEIGHTS)) + FORCE_WEIGHT * np.mean(force**2))


def published(controller: str) -> list[float]:
    """The index of a published controller on each of the unseen roads."""
    found = []
    with wire(FmuSet(), Case(controller, "random")) as system:
        for offset in UNSEEN:
            configure(system, Case(controller, "random", offset=offset))
            names = [f"plant.{s}" for s in STATES]
            force = [] if controller == "passive" else ["controller.force"]
            system.allow_unconnected = True
            r = system.run(SECONDS, record=Record([*names, *force], "1 ms"))
            states = np.column_stack([r[n] for n in names])
            found.append(index(states, r[force[0]] if force else np.zeros(len(r))))
    return found


def learned(parameters: np.ndarray) -> list[float]:
    """The index of a policy on each of the unseen roads."""
    env, policy, found = gymnasium.make("suspension/QuarterCar-v0").unwrapped, Policy(parameters), []
    env.steps = round(SECONDS / float(env.step_size))
    for offset in UNSEEN:
        states, _ = env.reset(options={"road.offset": offset})
        over = False
        while not over:
            states, _, terminated, truncated, _ = env.step(policy(states))
            over = terminated or truncated
        r = env.recording
        found.append(index(np.column_stack([r[f"plant.{s}"] for s in STATES]), r["plant.force"]))
    env.close()
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description="A learned policy beside LQR and MPC, on roads it has not seen.")
    parser.add_argument("--generations", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    costs = {c: published(c) for c in ("passive", "lqr-clipped", "mpc")}
    costs["learned"] = learned(train(options.generations, options.seed))
    reference = np.array(costs["lqr-clipped"])
    print(f"{'':12} {'index':>8} {'/ LQR, median':>14} {'lowest':>7} {'highest':>8}")
    for name, cost in costs.items():
        ratio = np.array(cost) / reference
        print(f"{name:12} {np.mean(cost):8.4f} {np.median(ratio):14.3f} {ratio.min():7.3f} {ratio.max():8.3f}")


if __name__ == "__main__":
    main()
