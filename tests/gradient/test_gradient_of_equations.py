"""Derivatives of quadratic programs at the rows that hold their solutions: equations, and limits that come and go."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from built import OBJECTS
from components import MISJUDGED

from build_fmus.compile import resolve_platforms
from build_fmus.component import Component
from build_fmus.package import build_fmu
from build_fmus.qp import Backend, Daqp, Osqp
from cosim import System, Table
from cosim.gradient import Final, GradientError

METRICS = {"first": Final("law.command[1]"), "price": Final("law.price[1]")}
INPUTS = ["law.total[1]", "law.total[2]", "law.wanted[1]", "law.wanted[2]"]
BACKENDS = [Daqp(), Osqp(rho=1.0, eps=1e-10), Osqp(rho=1.0, eps=1e-3, fallback=Daqp())]
H = np.array([[3.0, 0.7, 0.3], [0.7, 2.0, -0.4], [0.3, -0.4, 1.0]])
ROWS = np.array([[0.3, 0.7, 0.1], [0.0, 0.0, 0.0]])


def law(folder: Path, rows: np.ndarray, backend: Backend) -> System:
    """Commands of which some sums are given."""
    c = Component("Sums", kind="discrete", description="sums", source="none", sample_time=0.01)
    total, wanted = (c.input(n, "1", n, shape=(3,), min=-9.0, max=9.0) for n in ("total", "wanted"))
    sums = ca.mtimes(ca.DM(rows), total)
    s = c.quadratic_program(
        "solver", hessians=[H], constraints=[rows], linear=-(H @ wanted), lower=sums, upper=sums, backend=backend
    )
    c.output("command", s.z, "1", "commands")
    c.output("price", s.multipliers, "1", "multipliers")
    return alone(folder, c)


def alone(folder: Path, c: Component) -> System:
    path = folder / f"{c.name}.fmu"
    path.write_bytes(build_fmu(c, 3, resolve_platforms("host"), OBJECTS))
    system = System(allow_unconnected=True)
    system.add("law", path, step="10 ms")
    return system


def limited(folder: Path, backend: Backend) -> System:
    """Commands within limits on sums of them, some of which hold until 0.03 s and none afterwards."""
    rng = np.random.default_rng(1)
    rows, root = rng.normal(size=(6, 4)), rng.normal(size=(4, 4))
    hessian, each = root @ root.T + np.eye(4), np.ones(6)
    c = Component("Limits", kind="discrete", description="limits", source="none", sample_time=0.01)
    wanted, limit = c.input("wanted", "1", "wanted", shape=(4,), min=-9.0, max=9.0), c.input("limit", "1", "limit")
    s = c.quadratic_program(
        "solver",
        hessians=[hessian],
        constraints=[rows / np.linalg.norm(rows, axis=1, keepdims=True)],
        linear=-(hessian @ wanted),
        lower=-limit * each,
        upper=limit * each,
        backend=backend,
    )
    c.output("command", s.z, "1", "commands")
    c.output("price", s.multipliers, "1", "multipliers")
    system = alone(folder, c)
    system["law"].set({f"wanted[{i}]": x for i, x in enumerate((0.3, -0.5, 0.4, 0.2), start=1)})
    system.add("table", Table({"time": np.array([0.0, 0.03, 0.04, 1.0]), "limit": np.array([0.2, 0.2, 5.0, 5.0])}))
    system.connect("table.limit", "law.limit")
    return system


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_equation_holds_whatever_its_multiplier(tmp_path: Path, backend: Backend) -> None:
    """At rest, and with a multiplier."""
    with law(tmp_path, ROWS, backend) as system:
        for wanted, mode in product((0.0, 0.5), ("forward", "adjoint")):
            system["law"].set({"wanted[1]": wanted})
            found = system.gradient(METRICS, INPUTS, stop_time="20 ms", mode=mode)
            np.testing.assert_allclose(found.jacobian, found.trust().near, atol=1e-6, err_msg=f"{wanted}, {mode}")


@pytest.mark.parametrize("seed", range(3))
def test_equations_that_depend_on_each_other_have_no_derivative(tmp_path: Path, seed: int) -> None:
    """Also where their dependence is only found up to rounding."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(2, 3))
    with law(tmp_path, np.vstack([rows, rng.normal(size=2) @ rows]), Osqp(rho=1.0, eps=1e-10)) as system:
        system["law"].set({"wanted[1]": 0.5, "total[1]": 0.1})
        for mode in ("forward", "adjoint"):
            with pytest.raises(GradientError, match="is not finite"):
                system.gradient(METRICS, INPUTS, stop_time="20 ms", mode=mode)


@pytest.mark.parametrize("backend", BACKENDS, ids=lambda b: b.name)
def test_a_limit_that_held_in_an_earlier_sample_holds_nothing(tmp_path: Path, backend: Backend) -> None:
    """OSQP leaves multipliers of 1e-16 at such rows."""
    inputs = [f"law.wanted[{i}]" for i in range(1, 5)]
    with limited(tmp_path, backend) as system:
        price = system.run(0.08, record=["law.price*"])
        held = [np.abs(price[f"law.price[{i}]"]) for i in range(1, 7)]
        assert sum(p[0] > 0.1 for p in held) == 2
        assert all(p[-1] < 1e-12 for p in held)
        for mode in ("forward", "adjoint"):
            metrics = {f"{i}": Final(f"law.command[{i}]") for i in range(1, 5)}
            found = system.gradient(metrics, inputs, stop_time=0.08, mode=mode)
            np.testing.assert_allclose(found.jacobian, np.eye(4), atol=1e-12)
            approximate = isinstance(backend, Osqp) and backend.fallback is None
            assert found.of_exact_solutions == ["law"] * approximate
            assert str(found).count("law: derivatives of the exact solutions") == approximate
        assert (found.trust().smooth == found.recording.time[-1]).all()


@pytest.mark.parametrize("fallback", [None, Daqp()], ids=("alone", "with fallback"))
def test_a_solution_is_exact_where_its_own_program_has_a_fallback(tmp_path: Path, fallback: Daqp | None) -> None:
    """The solver of another program of the component changes nothing."""
    c = Component("Two", kind="discrete", description="two programs", source="none", sample_time=0.01)
    wanted = c.input("wanted", "1", "wanted", min=-9.0, max=9.0)
    for name, backend in (("osqp", Osqp(fallback=fallback)), ("daqp", Daqp())):
        s = c.quadratic_program(
            name, hessians=[np.eye(1)], constraints=[np.eye(1)], linear=-wanted, lower=-1.0, upper=1.0, backend=backend
        )
        c.output(f"command.{name}", s.z, "1", "command")
    with alone(tmp_path, c) as system:
        found = system.gradient({"z": Final("law.command.osqp")}, ["law.wanted"], stop_time="20 ms")
        assert found.of_exact_solutions == ([] if fallback else ["law"])


def test_a_program_that_only_the_fallback_solves(tmp_path: Path) -> None:
    """The rows at their upper bounds hold the solution; the run is that of the FMU bit for bit."""
    c = Component("Misjudged", kind="discrete", description="limits", source="none", sample_time=0.01)
    limit = c.input("limit", "1", "limits", shape=(2,), min=-1e3, max=1e3)
    s = c.quadratic_program(
        "solver",
        hessians=[MISJUDGED.hessian],
        constraints=[MISJUDGED.rows],
        linear=MISJUDGED.linear,
        lower=MISJUDGED.lower,
        upper=ca.vertcat(MISJUDGED.upper[0], limit),
        backend=Osqp(fallback=Daqp()),
    )
    c.output("command", s.z, "1", "commands")
    with alone(tmp_path, c) as system:
        system["law"].set(dict(zip(("limit[1]", "limit[2]"), MISJUDGED.upper[1:], strict=True)))
        run = system.run(0.05, record=["law.command*", "law.solver.status"])
        assert not run["law.solver.status"].any()
        for mode in ("forward", "adjoint"):
            found = system.gradient(
                {f"{i}": Final(f"law.command[{i}]") for i in (1, 2)},
                ["law.limit[1]", "law.limit[2]"],
                stop_time=0.05,
                mode=mode,
            )
            np.testing.assert_allclose(found.jacobian, [[-0.1, -0.4], [0.0, 1.0]], atol=1e-9)
            assert found.of_exact_solutions == []
            assert list(found.values) == [run[f"law.command[{i}]"][-1] for i in (1, 2)]


NONE = 1e31  # no bound
HELD = {  # Hessian, rows; of given numbers p: linear term, lower and upper bounds; these numbers, derivatives of z[0]
    "another unit": (
        [1.0, 1.0],
        [[1.0, 0.0]],
        lambda p: (ca.vertcat(-p[1], -p[0]), -NONE, p[2]),
        ([1e6, 1.001, 1.0], [0.0, 0.0, 1.0]),
    ),
    "newton beside meter": (
        [1e-6, 1e6],
        np.eye(2),
        lambda p: (ca.vertcat(-1e-6 * p[0], -1e6 * p[1]), ca.vertcat(-p[2], -1.0), ca.vertcat(p[2], 1.0)),
        ([1100.0, 0.02, 1000.0], [0.0, 0.0, 1.0]),
    ),
    "beside an equation": (
        [1.0, 1.0, 1.0],
        [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]],
        lambda p: (ca.vertcat(-p[0], 0.0, 0.0), ca.vertcat(-NONE, p[1]), ca.vertcat(p[2], p[1])),
        ([1.01, 1e7, 1.0], [0.0, 0.0, 1.0]),
    ),
    "the lower of two that are one": (
        [1.0, 1.0],
        [[1.0, 1.0]],
        lambda p: (ca.vertcat(-p[0], -p[0]), p[1], p[2]),
        ([0.5, 2.0, 2.0], [0.0, 0.5, 0.0]),
    ),
}


@pytest.mark.parametrize("backend", BACKENDS, ids=lambda b: b.name)
@pytest.mark.parametrize("held", HELD)
def test_a_limit_holds_whatever_the_units(tmp_path: Path, held: str, backend: Backend) -> None:
    diagonal, rows, program, (given, expected) = HELD[held]
    c = Component("Held", kind="discrete", description="a limit", source="none", sample_time=0.01)
    linear, lower, upper = program(c.input("given", "1", "given", shape=(3,), min=-1e9, max=1e9))
    s = c.quadratic_program(
        "solver",
        hessians=[np.diag(diagonal)],
        constraints=[np.array(rows)],
        linear=linear,
        lower=lower,
        upper=upper,
        backend=backend,
    )
    c.output("command", s.z, "1", "commands")
    names = [f"given[{i}]" for i in (1, 2, 3)]
    with alone(tmp_path, c) as system:
        system["law"].set(dict(zip(names, given, strict=True)))
        for mode in ("forward", "adjoint"):
            found = system.gradient(
                {"z": Final("law.command[1]")}, [f"law.{n}" for n in names], stop_time=0.02, mode=mode
            )
            np.testing.assert_allclose(found.jacobian, [expected], atol=1e-9)
