"""Derivatives of one step: the step is the FMU's own, bit by bit; the derivatives are those of its differences."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from built import FMUS
from click.testing import CliRunner
from fmpy.validation import validate_fmu

from build_fmus.compile import find_toolchain, host
from cosim import System
from cosim.cli import app
from cosim.core.errors import CosimError
from cosim.fmu.own_states import VALUES_AT
from cosim.gradient.step import FOLDER, StepDerivatives

pytestmark = pytest.mark.usefixtures("built_fmus")

CASES = [
    ("QuarterCarBench", 1e-3, 3),
    ("RideCarHmmwv", 1e-3, 2),
    ("FullCarHmmwvModified", 2e-3, 2),
    ("HydraulicActuator", 1e-3, 3),
    ("LqrBench", 0.05, 2),
    ("LqrBench", 5e-4, 1),  # a step without a sample
    ("SemiActiveSkyhook", 0.01, 2),
    ("MpcHmmwv", 0.03, 2),
    ("MpcHmmwv", 0.01, 1),  # a step without a sample
]
"""Name, length of a step [s], and how many were taken before."""
CONSTANT = ("solver.step", "solver.residual", "solver.iterations")  # which are not differentiated


def states_of(path: Path, h: float, steps: int) -> list[bytes]:
    """Serialized states of an FMU from 0.5 s on, before and after each of so many steps, with inputs that are not 0."""
    rng = np.random.default_rng(3)
    with System(allow_unconnected=True) as system:
        one = system.add("one", path, step=h)
        inputs = [v for v in one.description.variables.values() if v.causality == "input" and v.type == "real"]
        for v, x in zip(inputs, rng.standard_normal(len(inputs)), strict=True):
            if v.must_equal is None:
                one.set({v.name: v.nominal * (abs(x) if v.limits[0] == 0.0 else 1e-3 * x)})
        with system.initialize(0.5, record="one.*") as simulation:
            go, found = simulation.stepper(h), []
            for _ in range(steps):
                found.append(one.implementation.serialize())
                go()
            return [*found, one.implementation.serialize()]


def values(state: bytes) -> np.ndarray:
    return np.frombuffer(state, dtype=float, offset=VALUES_AT)


def moved(state: bytes, k: int, by: float) -> bytes:
    numbers = values(state).copy()
    numbers[k] += by
    return state[:VALUES_AT] + numbers.tobytes()


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(("name", "h", "before"), CASES)
def test_a_step_is_the_fmus_own(name: str, h: float, before: int, fmi: int) -> None:
    path = FMUS / f"fmi{fmi}" / f"{name}.fmu"
    step = StepDerivatives(path)
    *_, state, following = states_of(path, h, before + 1)
    found, after = step(state, h), values(following)
    n_states = len(step.states)
    states, outputs = after[len(step.knowns) - n_states :], after[len(step.knowns) + n_states :]
    assert found.after.tolist() == [*states[:n_states], *outputs[: len(step.unknowns) - n_states]]


@pytest.mark.parametrize(("name", "h", "before"), CASES)
def test_derivatives_are_those_of_neighboring_steps(name: str, h: float, before: int) -> None:
    path = FMUS / "fmi3" / f"{name}.fmu"
    step, state = StepDerivatives(path), states_of(path, h, before)[-1]
    found = step(state, h)
    x = np.abs(values(state)[: len(step.knowns)])
    magnitude = np.abs(found.jacobian) @ x  # of the terms that are summed
    smooth, exact = 0, name != "MpcHmmwv"  # its solver stops at a residual; between changes of rows it is linear
    for k, known in enumerate(step.knowns):
        size, along = (1e-5 if exact else 0.5) * (x[k] or 1e-3), np.eye(1, len(x), k)
        here, *near = (step(moved(state, k, i * size), h, along) for i in (0, -2, -1, 1, 2))
        np.testing.assert_array_equal(here.jacobian[:, 0], found.jacobian[:, k])
        if known in CONSTANT or len({here.sides, *(s.sides for s in near)}) > 1:
            continue
        smooth += 1
        change = (8 * (near[2].after - near[1].after) - (near[3].after - near[0].after)) / 12
        right = size * found.jacobian[:, k]
        compared = [u not in CONSTANT for u in step.unknowns]
        allowed = 1e-6 * np.abs(right) + (1e-13 if exact else 1e-5) * (magnitude + np.abs(found.after)) + 1e-18
        assert (np.abs(change - right) <= allowed)[compared].all(), known
    assert smooth > 0.9 * len(x)


def test_directions_are_followed_together() -> None:
    path = FMUS / "fmi3" / "QuarterCarBench.fmu"
    step, (state,) = StepDerivatives("QuarterCarBench"), states_of(path, 1e-3, 0)
    seeds = np.random.default_rng(1).standard_normal((20, len(step.knowns)))  # more than go together
    found = step(state, 1e-3, seeds)
    np.testing.assert_allclose(found.jacobian, step(state, 1e-3).jacobian @ seeds.T, rtol=1e-12, atol=1e-12)


def test_directions_may_be_of_any_length() -> None:
    """Squares of these are 0."""
    path, h, small = FMUS / "fmi3" / "FullCarHmmwvModified.fmu", 2e-3, 2.0**-600
    step, (state,) = StepDerivatives(path), states_of(path, h, 0)
    found, scaled = step(state, h), step(state, h, small * np.eye(len(step.knowns)))
    np.testing.assert_array_equal(scaled.jacobian, small * found.jacobian)
    assert scaled.sides == found.sides


def test_a_copied_fmu_carries_the_library_for_c(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["fmu", "LqrBench", "--copy", str(tmp_path), "--step-derivatives"])
    assert result.exit_code == 0, result.output
    path = tmp_path / "LqrBench.fmu"
    folder = Path(fmpy.extract(path, tmp_path / "in"))
    assert validate_fmu(str(path)) == []
    (library,) = (folder / FOLDER).glob("*/*.*")
    program = """
    #include <stdio.h>
    #include "step_derivatives.h"
    int main(void) {
        StepSizes s;
        step_derivatives_sizes(&s);
        printf("%u %u %u %u", s.parameters, s.inputs, s.states, s.outputs);
        return 0;
    }
    """
    (tmp_path / "main.c").write_text(program)
    compiler, out = find_toolchain(host()), tmp_path / "main"
    command = [*compiler.command, "-I", str(folder / FOLDER), str(tmp_path / "main.c"), str(library), "-o", str(out)]
    subprocess.run(command, check=True)
    said = subprocess.run(
        [out], check=True, env={"LD_LIBRARY_PATH": str(library.parent)}, capture_output=True, text=True
    )
    assert said.stdout == "5 4 0 1"


@pytest.mark.parametrize(
    "change",
    [
        lambda state: (b"", "1 ms", None),
        lambda state: (state[:-8], "1 ms", None),
        lambda state: (state[:16] + b"12345678" + state[24:], "1 ms", None),
        lambda state: (moved(state, 0, np.nan), "1 ms", None),
        lambda state: (state, 1e-3, np.zeros((1, 3))),
        lambda state: (state, 1e-3, np.full((1, 14), np.inf)),
        lambda state: (state, -1e-3, None),
    ],
)
def test_what_is_wrong_is_said(change: Callable[[bytes], Any], raises) -> None:
    step = StepDerivatives("QuarterCarBench")
    given = change(states_of(FMUS / "fmi3" / "QuarterCarBench.fmu", 1e-3, 0)[0])
    with raises(CosimError):
        step(*given)
