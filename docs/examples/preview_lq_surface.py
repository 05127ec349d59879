"""The front of the preview LQ controller as a surface over its weights, from few runs with derivatives.

    python docs/examples/preview_lq_surface.py

`preview_lq_front.py` builds a controller for each trial. `PreviewLqTunable` has the weights as parameters, so that runs
of one system have derivatives by them. The objectives are functions of the weights of tires and forces (that of the
suspension only adds a compromise, so it stays at its lower end). They are interpolated in logarithms, such that values
and derivatives are those of the runs, and compared with runs between. A finer lattice of runs without derivatives is
interpolated, too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from cosim import System
from cosim.experiments.preview_lq.runs import DURATION, Case, configure, wire
from cosim.gradient import QuadraticCost
from cosim.study import FmuSet
from fmu_sources.models.corners import CORNERS

CASE = Case(tunable=True)
SUSPENSION = 10.0  # weight, 1/m2
LOW, HIGH = np.log([1e2, 1e-8]), np.log([1e6, 1e-4])  # weights of tires [1/m2] and forces [1/N2]
LATTICE = (3, 4)
PLAIN = 6  # places of a lattice of runs without derivatives, by weight
LENGTH = 0.4  # of the Gaussian functions, in units of the ranges
SQUARES = {
    "comfort": QuadraticCost({"car.body.az": 1.0}),
    "grip": QuadraticCost({f"car.tire.{k}.deflection": 0.25e6 for k in CORNERS}),  # mm
    "force": QuadraticCost({f"controller.force.{k}": 0.25 for k in CORNERS}),
}
NAMES = [f"controller.weight.{n}.{end}" for n in ("tire", "force") for end in ("front", "rear")]
Surface = Callable[[np.ndarray], np.ndarray]


def wired() -> System:
    """The sedan under `PreviewLqTunable` on the hole and the bump, as the experiment `preview-lq` has it."""
    system = wire(FmuSet(), CASE)
    configure(system, CASE)
    return system


def weigh(system: System, place: np.ndarray) -> None:
    """Set the weights at a place (2,) in the unit square."""
    tire, force = np.exp(LOW + place * (HIGH - LOW)).tolist()
    for name, weight in {"suspension": SUSPENSION, "tire": tire, "force": force}.items():
        system["controller"].set({f"weight.{name}.{end}": weight for end in ("front", "rear")})


def run(system: System, place: np.ndarray) -> np.ndarray:
    """Logarithms of the objectives (3,)."""
    weigh(system, place)
    recording = system.run(DURATION, record=[n for m in SQUARES.values() for n in m.names])
    return np.array([0.5 * np.log(m.of([recording[n] for n in m.names])[0]) for m in SQUARES.values()])


def slopes(system: System, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of the objectives (3,) and their derivatives (3, 2) by the place."""
    weigh(system, place)
    found = system.gradient(SQUARES, NAMES, stop_time=DURATION, interval="1 ms")
    relative = 0.5 * found.jacobian * found.at / found.values[:, None]
    return 0.5 * np.log(found.values), relative.reshape(len(SQUARES), 2, 2).sum(axis=2) * (HIGH - LOW)


def interpolated(places: np.ndarray, values: np.ndarray, derivatives: np.ndarray) -> Surface:
    """Sums of Gaussian functions and their derivatives at the places, with these values and derivatives there.

    Places (n, d), values (n, m), derivatives (n, m, d).
    """
    d = places.shape[1]

    def blocks(at: np.ndarray, order: int) -> np.ndarray:
        """Values at (k, d) of all functions, then with order 1 their derivatives by each coordinate."""
        apart = (at[:, None] - places[None]) / LENGTH
        bell = np.exp(-0.5 * (apart**2).sum(axis=-1))
        rows = [np.hstack([bell, *(bell * apart[..., j] for j in range(d))])]
        for i in range(d if order else 0):
            more = [bell * ((i == j) - apart[..., i] * apart[..., j]) for j in range(d)]
            rows.append(np.hstack([-bell * apart[..., i], *more]) / LENGTH)
        return np.vstack(rows)

    mean = values.mean(axis=0)
    right = np.vstack([values - mean, *(derivatives[..., j] for j in range(d))])
    system = blocks(places, 1)
    weights = np.linalg.solve(system, right)
    return lambda at: mean + blocks(at, 0) @ weights


def surface(system: System) -> tuple[Surface, int]:
    """The objectives over the unit square, and how many runs with derivatives it took."""
    places = np.array([[a, b] for a in np.linspace(0, 1, LATTICE[0]) for b in np.linspace(0, 1, LATTICE[1])])
    found = [slopes(system, p) for p in places]
    return interpolated(places, np.array([f for f, _ in found]), np.array([s for _, s in found])), len(places)


def plain(system: System) -> Surface:
    """The objectives over the unit square, from runs without derivatives."""
    ends = np.linspace(0, 1, PLAIN)
    values = np.array([[run(system, np.array([a, b])) for b in ends] for a in ends])
    return RegularGridInterpolator((ends, ends), values, method="cubic")


def errors(system: System, of: Surface, count: int = 20, seed: int = 0) -> Mapping[str, tuple[float, float]]:
    """Median and largest relative error of each objective at random places, by runs."""
    places = np.random.default_rng(seed).uniform(size=(count, 2))
    off = np.abs(np.expm1(of(places) - [run(system, p) for p in places]))
    return {n: (float(np.median(e)), float(e.max())) for n, e in zip(SQUARES, off.T, strict=True)}


def timed(call: Callable[[], Any]) -> tuple[float, Any]:
    """Processor time [s] of a call, and its result."""
    begin = time.process_time()
    found = call()
    return time.process_time() - begin, found


def report(system: System, of: Surface) -> None:
    for name, (median, largest) in errors(system, of).items():
        print(f"{name:8} error {100 * median:.1f} % in the median, {100 * largest:.1f} % at most")


def main() -> None:
    with wired() as system:
        slopes(system, np.zeros(2))  # compiles
        alone, _ = timed(lambda: run(system, np.full(2, 0.5)))
        took, (of, count) = timed(lambda: surface(system))
        print(f"{count} runs with derivatives: {took:.3g} s, the processor time of {took / alone:.0f} runs without")
        report(system, of)
        took, of = timed(lambda: plain(system))
        print(f"{PLAIN**2} runs without: {took:.3g} s")
        report(system, of)


if __name__ == "__main__":
    main()
