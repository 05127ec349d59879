"""Quadratic programs: what can be declared, what follows from it, and where the solvers come from."""

from __future__ import annotations

import tarfile
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from oracles.qp import solve_reference

from build_fmus import generate, package, qp_sources
from build_fmus.base import safe_files
from build_fmus.component import Component, DeclarationError
from build_fmus.description_xml import model_description
from build_fmus.qp import Daqp, Osqp, ProgramError, generate_data
from build_fmus.qp_solve import CompiledPrograms
from build_fmus.reference import Evaluator

H = np.diag([1.0, 2.0])
A = np.array([[1.0, 0.0], [1.0, 1.0]])


def sampled(symbols: object = ca.SX) -> Component:
    return Component("Law", kind="discrete", sample_time=0.01, description="a law", source="none", symbols=symbols)


def declare(c: Component, name: str = "solver", **changes: object) -> object:
    arguments = {"hessians": [H], "constraints": [A], "linear": 0.0, "lower": -1.0, "upper": 1.0} | changes
    return c.quadratic_program(name, **arguments)  # type: ignore[arg-type]


def of_its_own_solution(c: Component) -> object:
    s = declare(c)
    return declare(c, "second", linear=s.z)  # type: ignore[attr-defined]


def undeclared(c: Component) -> object:
    declare(c, linear=ca.vertcat(ca.SX.sym("stranger"), 0))
    return c.model().functions


def start_from_a_solution(c: Component) -> object:
    s = declare(c)
    c.update(c.state("x", "1", start=s.z[0] + 1), 0)  # type: ignore[attr-defined]
    return c.model().functions


MISTAKES = {
    "continuous": lambda c: declare(Component("Mass", kind="continuous", description="a mass", source="none")),
    "no Hessian": lambda c: declare(c, hessians=[]),
    "not square": lambda c: declare(c, hessians=[np.ones((2, 3))]),
    "not symmetric": lambda c: declare(c, hessians=[np.array([[1.0, 1.0], [0.0, 2.0]])]),
    "indefinite": lambda c: declare(c, hessians=[H, np.diag([1.0, -1.0])], case=0),
    "semidefinite": lambda c: declare(c, hessians=[np.diag([1.0, 0.0])]),
    "infinite": lambda c: declare(c, hessians=[np.diag([1.0, np.inf])]),
    "rows": lambda c: declare(c, constraints=[np.ones((2, 3))]),
    "nan": lambda c: declare(c, constraints=[A * np.nan]),
    "matrices": lambda c: declare(c, constraints=[A, A]),
    "case": lambda c: declare(c, hessians=[H, 2 * H]),
    "linear": lambda c: declare(c, linear=np.ones(3)),
    "lower": lambda c: declare(c, lower=ca.SX(3, 1)),
    "a matrix": lambda c: declare(c, upper=ca.SX(2, 2)),
    "solution": of_its_own_solution,
    "undeclared": undeclared,
    "start": start_from_a_solution,
    "twice": lambda c: [declare(c), declare(c)],
    "terms of another size": lambda c: declare(c, terms=[(1.0, np.eye(3))]),
    "terms without symmetry": lambda c: declare(c, terms=[(1.0, np.array([[0.0, 1.0], [0.0, 0.0]]))]),
    "weights": lambda c: declare(c, terms=[(ca.SX(2, 1), H)]),
    "terms for OSQP": lambda c: declare(c, terms=[(1.0, H)], backend=Osqp()),
    "no back end": lambda c: declare(c, backend=[]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes(mistake: str, raises) -> None:
    with raises(DeclarationError):
        MISTAKES[mistake](sampled())


@pytest.mark.parametrize(
    "make", [lambda: Daqp(tolerance=0), lambda: Osqp(rho=-1), lambda: Osqp(eps=np.nan), lambda: Osqp(scaling="ruiz")]
)
def test_settings_are_checked(make: object) -> None:
    with pytest.raises(ProgramError):
        make()  # type: ignore[operator]


@pytest.mark.parametrize("symbols", [ca.SX, ca.MX], ids=["SX", "MX"])
def test_dependencies_go_through_the_solver(symbols: object) -> None:
    c = sampled(symbols)
    names = ["linear", "lower", "upper", "case", "beside", "later"]
    inputs = {n: c.input(n, "1", n) for n in names}
    held = c.state("held", "1", start=inputs["upper"])
    s = declare(
        c, hessians=[H, 3 * H], linear=inputs["linear"], lower=inputs["lower"] - 1, upper=held, case=inputs["case"]
    )
    c.update(held, inputs["later"])
    c.output("u", s.z[0] + inputs["beside"], "1", "command")  # type: ignore[attr-defined]
    c.output("aside", inputs["beside"], "1", "not solved for")
    solved = ["linear", "lower", "case"]
    assert c.model().dependencies["solver.status"] == solved
    assert c.model().dependencies["u"] == [*solved, "beside"]
    assert c.model().dependencies["aside"] == ["beside"]
    at_first = c.model().initial_dependencies
    assert at_first["solver.residual"] == ["linear", "lower", "upper", "case"]
    assert at_first["aside"] == ["beside"]
    assert b'name="solver.iterations"' in model_description(c.model(), 2, token="", sources=[])


def test_two_programs_with_two_solvers() -> None:
    c = sampled()
    q = c.input("q", "1", "linear term", shape=(2,), start=[3.0, -5.0])
    first = declare(c, "first", linear=q, backend=Daqp())
    second = declare(c, "second", linear=-2 * q, backend=Osqp(rho=1.0, eps=1e-10), upper=[0.5, 2.0])
    c.output("u", ca.vertcat(first.z, second.z), "1", "commands")  # type: ignore[attr-defined]
    run = Evaluator(c.model())
    run.step(0.01)
    u = run.outputs()[-4:]
    np.testing.assert_allclose(u[:2], solve_reference(H, run.u, A, -np.ones(2), np.ones(2)).z, atol=1e-12)
    np.testing.assert_allclose(u[2:], solve_reference(H, -2 * run.u, A, -np.ones(2), [0.5, 2.0]).z, atol=1e-8)
    assert {n.split("/")[0] for n in generate.solver_files(c.model()) if "/" in n} == {"daqp", "osqp"}


def test_cases_that_differ_in_bounds_alone_share_their_constants() -> None:
    c = sampled()
    hessians = [np.eye(2), 2 * np.eye(2), np.eye(2), 2 * np.eye(2), 3 * np.eye(2)]
    case = c.input("case", None, "case", type=int)
    c.quadratic_program(
        "solver",
        hessians=hessians,
        constraints=np.eye(2),
        linear=[-8.0, 8.0],
        lower=-1.0 - case,
        upper=1.0 + case,
        case=case,
    )
    code = generate_data(c.programs)
    assert code.count("static const double qp0_hessian") == 3
    assert code.count("static const double qp0_constraints") == 1
    run = Evaluator(c.model())
    for k in range(5):
        run.u[run.component.size("input") - 1] = k
        data = np.asarray(c.model().functions["programs"](0.0, run.x, run.u, run.p)).ravel()
        z = CompiledPrograms(c.model()).solve(data)[:2]
        weight = hessians[k][0, 0]
        np.testing.assert_allclose(z, np.array([1.0, -1.0]) * min(8.0 / weight, 1.0 + k), atol=1e-9)


def test_initialization_does_not_commit() -> None:
    """Reading outputs before the first sample leaves the warm start cold."""
    c = sampled()
    q = c.input("q", "1", "linear term", shape=(2,), start=[3.0, -5.0])
    declare(c, linear=q, backend=Osqp())
    looked, blind = Evaluator(c.model()), Evaluator(c.model())
    cold = looked.outputs()
    assert looked.outputs().tobytes() == cold.tobytes()
    for run in (looked, blind):
        run.step(0.01)
    assert looked.outputs().tobytes() == blind.outputs().tobytes() == cold.tobytes()
    looked.step(0.01)
    assert looked.outputs()[1] < cold[1]  # iterations


def test_solvers_are_selectable_at_build_time() -> None:
    def make() -> Component:
        c = sampled()
        declare(c, backend=(Daqp(), Osqp(rho=7.0)))
        declare(c, "other", backend=Osqp())
        return c

    declared, chosen, plain = make(), make(), make()
    chosen.choose_backend("osqp")
    plain.choose_backend("daqp")
    assert [p.backend for p in declared.programs] == [Daqp(), Osqp()]
    assert [p.backend for p in chosen.programs] == [Osqp(rho=7.0), Osqp()]
    assert [p.backend for p in plain.programs] == [Daqp(), Daqp()]
    assert len({generate.identity(c.model(), arrays=False) for c in (declared, chosen, plain)}) == 3


def test_sources_and_licences_go_into_the_fmu() -> None:
    c = sampled()
    declare(c, backend=Osqp())
    files = package.source_files(c.model(), 3)
    assert b"Apache License" in generate.third_party(c.model())[0].license
    assert b"CHANGED by suspension-fmus" in files["osqp/osqp_configure.h"]  # section 4b of that license
    assert {"qp.c", "qp_osqp.c", "qp_data.c", "osqp/osqp_api.c", "osqp/osqp_configure.h"} <= files.keys()
    assert not any(n.startswith(("daqp/", "qp_daqp")) for n in files)


# ---------------------------------------------------------------------- where DAQP comes from


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A user who has built nothing yet."""
    monkeypatch.setenv("BUILD_FMUS_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv(qp_sources.DAQP_VARIABLE, raising=False)
    qp_sources.daqp.cache_clear()
    yield tmp_path
    qp_sources.daqp.cache_clear()


def test_daqp_from_a_folder_and_from_the_sdist(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    qp_sources.daqp.cache_clear()
    monkeypatch.delenv("BUILD_FMUS_CACHE")
    original = qp_sources.daqp()  # downloaded, or kept from before
    sdist = safe_files.cache_directory() / f"daqp-{qp_sources.DAQP_VERSION}.tar.gz"
    monkeypatch.setenv("BUILD_FMUS_CACHE", str(fresh / "cache"))
    with tarfile.open(sdist) as tar:
        tar.extractall(fresh, filter="data")
    for chosen in (sdist, fresh / f"daqp-{qp_sources.DAQP_VERSION}"):
        monkeypatch.setenv(qp_sources.DAQP_VARIABLE, str(chosen))
        qp_sources.daqp.cache_clear()
        assert qp_sources.daqp() == original
    before = qp_sources.identity()
    (fresh / f"daqp-{qp_sources.DAQP_VERSION}" / "csrc" / "src" / "daqp.c").write_text("/* changed */")
    assert qp_sources.identity() != before


def test_what_is_said_when_daqp_is_missing(fresh: Path, monkeypatch: pytest.MonkeyPatch, raises) -> None:
    def offline(*_: object, **__: object) -> SimpleNamespace:
        return SimpleNamespace(returncode=1, stderr="ERROR: No matching distribution found for daqp==0.11.0")

    monkeypatch.setattr(qp_sources.subprocess, "run", offline)
    with raises(qp_sources.SourceError):
        qp_sources.daqp()
    monkeypatch.setenv(qp_sources.DAQP_VARIABLE, str(fresh / "nowhere"))
    with raises(qp_sources.SourceError):
        qp_sources.daqp()
    (fresh / "wrong.tar.gz").write_bytes(b"not it")
    monkeypatch.setenv(qp_sources.DAQP_VARIABLE, str(fresh / "wrong.tar.gz"))
    with raises(qp_sources.SourceError):
        qp_sources.daqp()
    monkeypatch.setenv(qp_sources.DAQP_VARIABLE, str(fresh))
    with pytest.raises(qp_sources.SourceError, match=r"has no daqp\.c"):
        qp_sources.daqp()


def test_a_damaged_download_is_fetched_again(fresh: Path, monkeypatch: pytest.MonkeyPatch, raises) -> None:
    asked = []

    def offline(command: list[str], **_: object) -> SimpleNamespace:
        asked.append(command)
        return SimpleNamespace(returncode=1, stderr="")

    kept = fresh / "cache" / f"daqp-{qp_sources.DAQP_VERSION}.tar.gz"
    kept.parent.mkdir()
    kept.write_bytes(b"half of it")
    monkeypatch.setattr(qp_sources.subprocess, "run", offline)
    with raises(qp_sources.SourceError):
        qp_sources.daqp()
    assert "--require-hashes" in asked[0]
