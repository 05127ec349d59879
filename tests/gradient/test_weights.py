"""Derivatives by the weights of controllers: of predictive ones, and of one that solves linear equations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from built import OBJECTS, BuiltFmus
from rides import system_of

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from build_fmus.qp import Daqp
from cosim import System
from cosim.experiments.bench import EXPERIMENT as BENCH
from cosim.experiments.bench.runs import Case as BenchCase
from cosim.experiments.hmmwv import EXPERIMENT as HMMWV
from cosim.experiments.hmmwv.runs import Case as HmmwvCase
from cosim.experiments.preview_lq import EXPERIMENT as RIDE
from cosim.experiments.preview_lq.runs import Case as RideCase
from cosim.gradient import Final, QuadraticCost, Rms

pytestmark = [
    pytest.mark.filterwarnings("ignore::cosim.UnconnectedInputsWarning"),
    pytest.mark.usefixtures("built_fmus"),
]


@pytest.mark.parametrize(
    ("experiment", "case", "plant", "force", "stop"),
    [
        (BENCH, BenchCase(road="random", tunable=True), "plant", "force", 1.0),
        (HMMWV, HmmwvCase("off-road", actuators="ideal", tunable=True), "car", "force.fl", 1.5),
    ],
    ids=["bench", "hmmwv"],
)
def test_weights_of_an_mpc_in_closed_loop(experiment: Any, case: Any, plant: str, force: str, stop: float) -> None:
    """Forward and adjoint, beside differences of runs with other weights; the runs reach the limit of the force."""
    system = system_of(experiment, case)
    metrics = {"ride": Rms(f"{plant}.body.az"), "effort": QuadraticCost({f"controller.{force}": 1e-3})}
    weights = [f"controller.weight.{n}" for n in ("body.vz", "tire.deflection", "force")]
    if plant == "car":
        weights = [f"controller.weight.{n}" for n in ("absorbed_power", "velocity", "force")]
    found = system.gradient(metrics, weights, stop_time=stop, interval="10 ms")
    assert not found.by_difference
    assert found.changes["controller"] > 0
    assert np.abs(found.trust(1e-5).deviation).max() < 1e-7
    assert np.abs(found.jacobian * found.at).min(axis=1).max() > 0.0
    back = system.gradient(metrics, weights, stop_time=stop, interval="10 ms", mode="adjoint")
    np.testing.assert_allclose(back.jacobian, found.jacobian, rtol=1e-9)


def test_weights_of_a_law_that_is_designed_during_initialization(built_fmus: BuiltFmus) -> None:  # noqa: ARG001
    """Its Riccati equations solve linear equations."""
    system = system_of(RIDE, RideCase(tunable=True))
    metrics = {"ride": Rms("car.body.az"), "force": Rms("controller.force.rl")}
    weights = ["controller.weight.acceleration.heave", "controller.weight.tire.front", "controller.weight.force.rear"]
    arguments = {"stop_time": 0.4, "interval": "2 ms"}
    found = system.gradient(metrics, weights, **arguments)
    assert not found.by_difference
    assert np.abs(found.trust().deviation).max() < 1e-6
    assert (np.abs(found.jacobian * found.at) > 1e-4 * found.values[:, None]).all()


def law(folder: Path, solve: str) -> System:
    """A law with linear equations, or with a quadratic program whose Hessian has terms, in one FMU."""
    c = Component("Law", kind="discrete", description="a law", source="none", sample_time=0.01, symbols=ca.MX)
    x = c.input("x", "1", "x", shape=(3,), min=-9.0, max=9.0)
    p = c.parameter("p", 0.7, "1", "p", min=0.0, tunable=True, source="none")
    still = ca.MX(ca.DM([[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 3.0]]))
    if solve == "equations":
        turned = ca.vertcat(ca.horzcat(0, p, x[0]), ca.horzcat(x[1] * p, 0.1, 1), ca.horzcat(1, x[2], p * p))
        c.output("moving", ca.solve(turned, ca.horzcat(x, still @ x), "qr")[:, 1], "1", "matrix and right side move")
        c.output("right", ca.solve(still, x * p, "qr"), "1", "the right side moves")
        c.output("left", ca.solve(still + p * (x @ x.T), ca.MX(ca.DM([1.0, 2.0, 3.0])), "qr"), "1", "the matrix moves")
    else:
        terms = [(p, np.diag([1.0, 0.0, 2.0])), (x[0] ** 2, np.ones((3, 3)))]
        rows = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        s = c.quadratic_program(
            "solver",
            hessians=[np.array(ca.DM([[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 3.0]]))],
            constraints=[rows],
            linear=-3.0 * x,
            lower=-1.0,
            upper=0.3,
            terms=terms,
            backend=Daqp(),
        )
        for name, value in (("moving", s.z), ("right", s.multipliers), ("left", p * s.z)):
            c.output(name, value, "1", name)
    path = folder / "Law.fmu"
    path.write_bytes(build_fmu(c, 3, resolve_platforms("host"), OBJECTS))
    system = System(allow_unconnected=True)
    system.add("law", path, step="10 ms", start={"x[1]": 0.4, "x[2]": 1.3, "x[3]": -0.8})
    return system


@pytest.mark.parametrize("solve", ["equations", "a program"])
def test_by_what_moves_the_matrix_and_the_right_side(tmp_path: Path, solve: str) -> None:
    with law(tmp_path, solve) as system:
        names = [f"{n}[{k}]" for n in ("moving", "right", "left") for k in (1, 2)]
        metrics = {n: Final(f"law.{n}") for n in names}
        for mode in ("forward", "adjoint"):
            found = system.gradient(metrics, ["law.p", "law.x*"], stop_time="20 ms", mode=mode)
            assert not found.by_difference
            assert np.abs(found.trust().deviation).max() < 1e-7, mode
            assert np.count_nonzero(found.jacobian.any(axis=1)) >= 5, mode  # one multiplier may be 0


def test_the_solution_of_linear_equations_is_that_of_numpy(tmp_path: Path) -> None:
    """With a pivot of zero, so that rows are exchanged."""
    with law(tmp_path, "equations") as system:
        run = system.run("20 ms", record=["law.*"])
        x, p = np.array([0.4, 1.3, -0.8]), 0.7
        still = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 3.0]])
        turned = np.array([[0, p, x[0]], [x[1] * p, 0.1, 1], [1, x[2], p * p]])
        expected = {
            "moving": np.linalg.solve(turned, still @ x),
            "right": np.linalg.solve(still, x * p),
            "left": np.linalg.solve(still + p * np.outer(x, x), [1.0, 2.0, 3.0]),
        }
        for name, values in expected.items():
            np.testing.assert_allclose([run[f"law.{name}[{k}]"][-1] for k in (1, 2, 3)], values, rtol=1e-12)
