"""The longest sample of the MPC FMUs: random and extreme inputs, every controller with every back end.

What is timed is a whole `doStep` of the compiled FMU: data of the program, solver with its fallback, outputs. Each
run is repeated from the start and each sample counts with its fastest repetition, in processor time of its thread, so
that other work on the machine does not show. The inputs are made by `extreme_inputs`, which the tests use as
well.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.mpc_solvers import BACKENDS, REPETITIONS, make
from build_fmus.builder import Options
from build_fmus.compile import ObjectCache, resolve_platforms
from build_fmus.component import Component, Model
from build_fmus.package import build_fmu
from build_fmus.qp import Daqp, Osqp
from cosim import Fmu
from cosim.experiments.trench.runs import MPC as TRENCH_MPC
from cosim.fmu.component import FmuComponent
from cosim.study import FmuSet

CONTROLLERS = ("MpcBench", "MpcBenchMoves", "MpcHmmwv", "MpcThreeAxle")
PARAMETERS: dict[str, tuple[dict[str, float], ...]] = {
    "MpcThreeAxle": ({}, {k: float(v) for k, v in TRENCH_MPC.items()})  # with and without the printed limits
}
SAMPLES, SEEDS = 40, 1
SCALES = (1e-3, 1.0, 3.0, 10.0, 30.0, 100.0, 1e3, 1e5, 1e8, 1e15, 1e100)
"""Factors on the reference inputs of the component, which reach its bounds."""


def extreme_inputs(c: Model, samples: int, seed: int = 0) -> Iterator[tuple[str, np.ndarray]]:
    """Titles and inputs (samples, input elements), within the declared limits of each input.

    Noise and random corners from far below to far above what the component is made for, its reference inputs enlarged,
    magnitudes mixed over 24 and over 600 decades, a kick followed by nothing and by numbers below the smallest normal
    one.
    """
    random = np.random.default_rng(seed)
    inputs = c.elements("input")
    times = np.arange(samples) * (c.sample_time or 0.0)
    waves = np.array(
        [[c.reference_inputs[e.name](t) if e.name in c.reference_inputs else 0.0 for e in inputs] for t in times]
    )
    usual = np.maximum(np.abs(waves).max(axis=0), 1e-9)
    shape = samples, len(inputs)

    def corners() -> np.ndarray:
        return random.choice([-1.0, 1.0], shape)

    kick = corners() * usual * 10
    later = np.arange(samples)[:, None] >= 5
    tiny = np.nextafter(0, 1) * 2.0**20
    for title, values in (
        *((f"noise, {s:g} times", random.uniform(-1, 1, shape) * usual * s) for s in SCALES),
        *((f"corners, {s:g} times", corners() * usual * s) for s in (1.0, 10.0, 100.0, 1e3)),
        *((f"reference inputs, {s:g} times", waves * s) for s in (1.0, 10.0, 100.0, 1e3)),
        ("24 decades", corners() * 10 ** random.uniform(-12, 12, shape)),
        ("600 decades", corners() * 10 ** random.uniform(-300, 300, shape)),
        ("kick, then 0", np.where(later, 0.0, kick)),
        ("kick, then subnormal", np.where(later, kick * tiny, kick)),
    ):
        for j, e in enumerate(inputs):
            v = e.variable
            if v.type == "Boolean":
                values[:, j] = random.integers(0, 2, samples)
            elif v.type == "Int32":
                values[:, j] = random.integers(int(v.min or 0), int(v.max or 0) + 1, samples)
            low, high = (-np.inf if v.min is None else v.min), (np.inf if v.max is None else v.max)
            values[:, j] = np.clip(values[:, j], low, high)
        yield title, values


def build(c: Component, folder: Path) -> Path:
    """The FMU of a component, for this machine."""
    path = folder / f"{c.name}.fmu"
    objects = ObjectCache(Options(FmuSet().directory).cache / "objects")
    path.write_bytes(build_fmu(c, 3, resolve_platforms("host"), objects))
    return path


class Driven:
    """One compiled controller, sample by sample."""

    def __init__(self, path: Path, c: Model) -> None:
        self._fmu = Fmu(path)
        self._instance = FmuComponent(self._fmu)
        self._period = c.sample_time or 0.0
        variables = self._fmu.description.variables
        self._inputs = [variables[e.name] for e in c.elements("input")]
        self.names = [e.name for e in c.output_elements()]
        self._outputs = [variables[n] for n in self.names]

    def run(self, values: np.ndarray, parameters: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Processor time of each step [s] (samples,), outputs (samples, output elements)."""
        one, u, y = self._instance, np.zeros(len(self._inputs)), np.zeros(len(self._outputs))
        one.instantiate(self._fmu.description.name)
        one.set({self._fmu.description.variables[n]: v for n, v in parameters.items()})
        one.enter_initialization(0.0, None)
        one.exit_initialization()
        ports = one.bind(self._inputs, self._outputs, u, y)
        seconds, outputs = np.zeros(len(values)), np.zeros((len(values), len(y)))
        for k, row in enumerate(values):
            u[:] = row
            ports.set_inputs()
            begin = time.thread_time_ns()
            ports.step(k * self._period, self._period)
            seconds[k] = 1e-9 * (time.thread_time_ns() - begin)
            ports.get_outputs()
            outputs[k] = y
        one.close()
        return seconds, outputs

    def close(self) -> None:
        """Remove the unpacked files."""
        self._fmu.close()


def longest(name: str, backend: str, samples: int = SAMPLES, seeds: int = SEEDS) -> dict[str, float]:
    """Worst and 99th percentile of the samples, iterations, and how the samples ended."""
    c = make(name)
    c.choose_backend(backend)
    solver = c.programs[0].backend
    assert isinstance(solver, Daqp | Osqp)
    period = c.sample_time or 0.0
    found = []
    with tempfile.TemporaryDirectory() as tmp:
        driven = Driven(build(c, Path(tmp)), c.model())
        status, iterations = (driven.names.index(f"solver.{n}") for n in ("status", "iterations"))
        for seed, parameters in product(range(seeds), PARAMETERS.get(name, ({},))):
            for _, values in extreme_inputs(c.model(), samples, seed):
                runs = [driven.run(values, parameters) for _ in range(REPETITIONS)]
                outputs = runs[0][1]
                if not np.isfinite(outputs).all():
                    raise ArithmeticError(f"{name} with {backend}: an output is not finite")
                seconds = np.min([r[0] for r in runs], axis=0)
                found.append(np.column_stack([seconds, outputs[:, [status, iterations]]]))
        driven.close()
    seconds, ended, count = np.concatenate(found).T
    return {
        "samples": len(seconds),
        "p99 [ms]": float(1e3 * np.quantile(seconds, 0.99)),
        "worst [ms]": float(1e3 * seconds.max()),
        "worst / half the sample time": float(2 * seconds.max() / period),
        "iterations, most": float(count.max()),
        "more than OSQP's limit [%]": float(100 * np.mean(count > solver.max_iterations)),
        "limit reached [%]": float(100 * np.mean(ended == 1)),
        "infeasible [%]": float(100 * np.mean(ended == 2)),
        "bad data [%]": float(100 * np.mean(ended == 3)),
        "iterations, limit": float(solver.most_iterations),
    }


def measure() -> dict[str, dict[str, float]]:
    """All controllers with all back ends."""
    return {f"{n}, {b}": longest(n, b) for n, b in product(CONTROLLERS, BACKENDS)}
