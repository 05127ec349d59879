"""The work of a sample is bounded.

Limits of iterations, what the MPC FMUs do there, and that published runs stay away from them.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from built import BuiltFmus

from benchmarks.mpc_worst import CONTROLLERS, PARAMETERS, Driven, extreme_inputs, make
from build_fmus.component import Model
from build_fmus.reference import Evaluator
from fmu_sources.controllers.mpc import bench, hmmwv

README = Path(__file__).parents[3] / "benchmarks" / "README.md"
BACKENDS = ("osqp", "daqp")
SOLVED, LIMIT = 0, 1
LARGEST_FORCE = {
    "MpcBench": bench.FORCE_LIMIT,
    "MpcBenchMoves": bench.FORCE_LIMIT,
    "MpcHmmwv": hmmwv.FORCE_LIMIT,
    "MpcThreeAxle": 150e3,
}
LARGEST_CHANGE = {"MpcHmmwv": hmmwv.MpcHmmwvWeights().max_force_step}  # N per sample


@cache
def component(name: str, backend: str) -> Model:
    c = make(name)
    c.choose_backend(backend)
    return c.model()


@cache
def documented() -> dict[tuple[str, str], int]:
    """Limits for which benchmarks/README.md shows that a sample ends within half the sample time."""
    section = README.read_text().split("## The longest sample")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (\w+), (OSQP|DAQP) \|(.*)\|$", section, re.MULTILINE)
    return {(name, solver.lower()): int(cells.split("|")[-1]) for name, solver, cells in rows}


def check(name: str, names: list[str], outputs: np.ndarray, limit: int) -> np.ndarray:
    """Iterations within the limit; commands finite, within force and rate, and kept after a failure.

    Returns the status.
    """
    column = {n: k for k, n in enumerate(names)}
    status = outputs[:, column["solver.status"]]
    forces = outputs[:, [k for n, k in column.items() if n.split(".")[0] == "force"]]
    assert np.isfinite(outputs).all()
    assert outputs[:, column["solver.iterations"]].max() <= limit
    assert np.abs(forces).max() <= LARGEST_FORCE[name]
    np.testing.assert_array_equal(outputs[:, column["command.held"]], status != SOLVED)
    before = np.vstack([np.zeros(forces.shape[1]), forces[:-1]])
    if name in LARGEST_CHANGE:
        assert np.abs(forces - before).max() <= LARGEST_CHANGE[name] * (1 + 1e-12)
    if name != "MpcThreeAxle":  # there the case may change the bounds
        np.testing.assert_array_equal(forces[status != SOLVED], before[status != SOLVED])
    return status


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", CONTROLLERS)
def test_no_input_takes_more_than_the_documented_iterations(name: str, backend: str) -> None:
    """In Python, with the C code of the FMU. What is finite and within 1e5 times the usual has a solution."""
    c = component(name, backend)
    solver, limit = c.programs[0].backend, documented()[name, backend]
    assert solver.most_iterations == limit
    names = [e.name for e in c.output_elements()]
    at_limit = 0
    for parameters in PARAMETERS.get(name, ({},)):
        for title, values in extreme_inputs(c, 8):
            run = Evaluator(c, parameters)
            slots = [e.slot for e in c.elements("input")]
            outputs = []
            for row in values:
                run.u[slots] = row
                run.step(c.sample_time)
                outputs.append(run.outputs())
            status = check(name, names, np.array(outputs), limit)
            iterations = np.array(outputs)[:, names.index("solver.iterations")]
            at_limit += np.count_nonzero(iterations > solver.max_iterations)
            if "decades" not in title and not re.search(r"1e\+(08|15|100)", title):
                assert set(status) == {SOLVED}, title
    assert bool(at_limit) == (backend == "osqp"), "the fallback had to take over"


@pytest.mark.parametrize("name", CONTROLLERS)
def test_the_fmu_keeps_to_them(built_fmus: BuiltFmus, name: str) -> None:
    c = make(name).model()  # with the back end of the catalog, as the FMU
    driven = Driven(built_fmus.path(name, 3), c)
    limit = documented()[name, c.programs[0].backend.name]
    try:
        for _, values in extreme_inputs(c, 6, seed=1):
            _, outputs = driven.run(values, {})
            check(name, driven.names, outputs, limit)
    finally:
        driven.close()
