"""A policy of four gains, trained through the simulator by derivatives of its runs, beside one trained without.

    python docs/examples/learn_by_gradients.py --with jax

The policy sets the force on the quarter-car bench from its four states, every 2 ms and within 8 N: the law of
`LqrBench`, whose gains begin at 0. Its cost is the index of the LQR over some stretches of the random road. JAX or
PyTorch differentiate the cost, and SciPy's L-BFGS-B follows; the evolution strategy of learn_bench.py only looks at the
cost. All are compared with the LQR on stretches that none of them has seen.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy import optimize

from cosim.experiments.bench.runs import Case, configure, wire
from cosim.gradient import QuadraticCost
from cosim.gradient.frameworks import jax_function, torch_function
from cosim.study import FmuSet
from fmu_sources.controllers.lq.bench import FORCE_WEIGHT, WEIGHTS
from fmu_sources.models.bench_states import STATES

GAINS = [f"controller.gain[{k}]" for k in range(1, 5)]
SCALE = 20.0  # of the gains
SEEN, UNSEEN = [1e3, 2e3, 3e3, 4e3], [6e4 + 4e3 * k for k in range(10)]  # s, where in the road's motion
SECONDS = 5.0  # of each stretch
INDEX = QuadraticCost(
    {**{f"plant.{s}": w for s, w in zip(STATES, WEIGHTS, strict=True)}, "controller.force": FORCE_WEIGHT}
)
OPTIONS: dict[str, Any] = {"stop_time": SECONDS, "interval": "1 ms"}


class Bench:
    """The bench under its policy, on one stretch of the road after the other."""

    def __init__(self) -> None:
        self.system = wire(FmuSet(), Case("lqr-clipped", "random"))
        configure(self.system, Case("lqr-clipped", "random"))
        self.published = np.array([float(self.system["controller"].start(g.partition(".")[2])) for g in GAINS])

    def mean(self, cost: Callable[[Any], Any], x: Any, stretches: list[float]) -> Any:
        """Of the cost over some stretches, in the numbers of any framework."""
        total = 0.0
        for offset in stretches:
            self.system["road"].set({"offset": offset})
            total = total + cost(SCALE * x)[0] / len(stretches)
        return total

    def index(self, gains: np.ndarray, stretches: list[float]) -> float:
        """The index with these gains."""
        for name, gain in zip(GAINS, gains.tolist(), strict=True):
            self.system["controller"].set({name.partition(".")[2]: gain})
        found = []
        for offset in stretches:
            self.system["road"].set({"offset": offset})
            recording = self.system.run(SECONDS, record=list(INDEX.names))
            found.append(INDEX.of([recording[n] for n in INDEX.names])[0])
        return float(np.mean(found))


def with_jax(bench: Bench) -> Callable[[np.ndarray], tuple[float, np.ndarray]]:
    import jax

    jax.config.update("jax_enable_x64", True)
    cost = jax_function(bench.system, {"index": INDEX}, GAINS, **OPTIONS)
    both = jax.value_and_grad(lambda x: bench.mean(cost, x, SEEN))
    return lambda x: tuple(np.asarray(a, dtype=float) for a in both(x))  # type: ignore[return-value]


def with_torch(bench: Bench) -> Callable[[np.ndarray], tuple[float, np.ndarray]]:
    import torch

    cost = torch_function(bench.system, {"index": INDEX}, GAINS, **OPTIONS)

    def both(x: np.ndarray) -> tuple[float, np.ndarray]:
        at = torch.tensor(x, dtype=torch.float64, requires_grad=True)
        loss = bench.mean(cost, at, SEEN)
        loss.backward()
        return loss.item(), at.grad.numpy()

    return both


def follow(both: Callable[[np.ndarray], tuple[float, np.ndarray]]) -> tuple[np.ndarray, int]:
    """Gains at the minimum of a cost with its derivatives, and evaluations."""
    found = optimize.minimize(both, np.zeros(len(GAINS)), jac=True, method="L-BFGS-B", options={"ftol": 1e-6})
    return SCALE * found.x, found.nfev


def evolve(bench: Bench, generations: int, seed: int = 0, population: int = 8) -> tuple[np.ndarray, int]:
    """Gains after some generations of an evolution strategy, and evaluations."""
    random, center = np.random.default_rng(seed), np.zeros(len(GAINS))
    best = population // 4
    for generation in range(generations):
        spread = 0.5 * 0.04 ** (generation / generations)
        noise = random.standard_normal((population // 2, len(GAINS)))
        tried = center + spread * np.concatenate([noise, -noise])
        costs = [bench.index(SCALE * x, SEEN) for x in tried]
        center = tried[np.argsort(costs)[:best]].mean(axis=0)
    return SCALE * center, generations * population


def main() -> None:
    parser = argparse.ArgumentParser(description="A policy trained by derivatives of its runs, and one without.")
    parser.add_argument("--with", dest="framework", choices=("jax", "torch"), default="jax")
    parser.add_argument("--generations", type=int, default=40)
    options = parser.parse_args()
    bench = Bench()
    both = {"jax": with_jax, "torch": with_torch}[options.framework](bench)
    both(np.zeros(len(GAINS)))  # compiles
    rows = {"no force": (np.zeros(len(GAINS)), 0, 0.0), "LQR": (bench.published, 0, 0.0)}
    for name, train in (
        (options.framework, lambda: follow(both)),
        ("evolution", lambda: evolve(bench, options.generations)),
    ):
        begin = time.process_time()
        gains, evaluations = train()
        rows[name] = gains, evaluations * len(SEEN), time.process_time() - begin
    lqr = bench.index(bench.published, UNSEEN)
    print(f"{'':10} {'index / LQR':>11} {'runs':>5} {'processor time [s]':>19}  gains")
    for name, (gains, runs, seconds) in rows.items():
        ratio = bench.index(gains, UNSEEN) / lqr
        print(f"{name:10} {ratio:11.4f} {runs:5d} {seconds:19.1f}  {' '.join(f'{g:.2f}' for g in gains)}")
    bench.system.close()


if __name__ == "__main__":
    main()
