"""The solvers of quadratic programs as compiled into FMUs, against quadprog and at their limits."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from components import MISJUDGED
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles.qp import solve_reference

from build_fmus.component import Component
from build_fmus.qp import Backend, Daqp, Osqp
from build_fmus.qp_solve import CompiledPrograms

INFINITE = np.inf
BACKENDS = {
    "daqp": Daqp(),
    "osqp": Osqp(rho=30.0, eps=1e-8, max_iterations=10_000),
    "osqp, then daqp": Osqp(rho=30.0, eps=1e-8, max_iterations=30, fallback=Daqp()),
}
SOLVED, LIMIT, INFEASIBLE, BAD = range(4)


def definite(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.normal(size=(n, n))
    return root @ root.T / n + 0.3 * np.eye(n)


def _problems() -> dict[str, tuple[list[np.ndarray], list[np.ndarray]]]:
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(5, 3))
    slack = np.hstack([rng.normal(size=(12, 4)), -np.ones((12, 1))])
    return {
        "one": ([np.array([[2.0]])], [np.array([[1.0]])]),
        "two cases": ([definite(rng, 4), definite(rng, 4)], [rng.normal(size=(9, 4)), rng.normal(size=(9, 4))]),
        # the same row four times, twice at another scale and once reversed; a row of zeros
        "degenerate": (
            [definite(rng, 3)],
            [np.vstack([rows, rows[0], rows[0], 5e3 * rows[0], -1e-3 * rows[0], np.zeros(3)])],
        ),
        "soft": ([np.diag([1.0, 3.0, 2.0, 0.5, 1e3])], [np.vstack([slack, np.eye(5)])]),
    }


PROBLEMS = _problems()


@cache
def compiled(problem: str, backend: Backend) -> CompiledPrograms:
    """A program whose data are given from outside; its warm start is that of whoever used it last."""
    H, A = PROBLEMS[problem]
    c = Component("Program", kind="discrete", sample_time=0.01, description="a program", source="none", symbols=ca.MX)
    n, m = len(H[0]), len(A[0])
    q, lo, up = (c.input(k, "1", k, shape=(s,)) for k, s in (("q", n), ("l", m), ("u", m)))
    case = c.input("case", "1", "case")
    c.quadratic_program("solver", hessians=H, constraints=A, linear=q, lower=lo, upper=up, case=case, backend=backend)
    return CompiledPrograms(c.model())


class Solved:
    """The outcome by names."""

    def __init__(self, solution: np.ndarray, n: int, m: int) -> None:
        self.z, self.y = solution[:n], solution[n : n + m]
        self.status, self.iterations, self.residual = int(solution[-3]), int(solution[-2]), solution[-1]


def solve(problem: str, backend: Backend, q, lower, upper, case: float = 0.0, *, commit: bool = True) -> Solved:  # type: ignore[no-untyped-def]
    n, m = len(PROBLEMS[problem][0][0]), len(PROBLEMS[problem][1][0])
    parts = (np.broadcast_to(x, s) for x, s in ((q, n), (lower, m), (upper, m), (case, 1)))
    return Solved(compiled(problem, backend).solve(np.concatenate([*parts]), commit=commit), n, m)


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> Backend:
    return BACKENDS[request.param]


@pytest.fixture(params=PROBLEMS)
def problem(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(autouse=True)
def cold() -> None:
    """Every test begins with cold solvers."""
    for b in BACKENDS.values():
        for p in PROBLEMS:
            compiled(p, b).memory[:] = 0


def kkt(problem: str, case: int, q: np.ndarray, lower: np.ndarray, upper: np.ndarray, s: Solved) -> float:
    """The residual as the documentation defines it, by numpy."""
    H, A = PROBLEMS[problem][0][case], PROBLEMS[problem][1][case]
    az, hz, ay = A @ s.z, H @ s.z, A.T @ s.y
    bound = np.where(s.y > 0, upper, lower)
    free = np.isinf(bound) | (np.abs(bound) >= 1e30)
    price = np.where(free, 0.0, s.y)
    bound = np.where(free, 0.0, bound)
    parts = [
        (max(0.0, (lower - az).max(), (az - upper).max()), [az]),
        (max(np.abs(hz + q + ay).max(), np.abs(np.where(free, s.y, 0)).max()), [hz, q, ay]),
        (np.abs(price * (bound - az)).max(), [price * az, price * bound]),
    ]
    return max(r / max(1.0, *(np.abs(t).max() for t in terms)) for r, terms in parts)


numbers = st.floats(-20, 20).map(lambda x: round(x, 3))
widths = st.sampled_from([0.01, 0.3, 2.0, 50.0, INFINITE])


@pytest.mark.parametrize("name", BACKENDS)
@pytest.mark.parametrize("problem", PROBLEMS)
@given(data=st.data())
def test_random_programs_agree_with_quadprog(problem: str, name: str, data: st.DataObject) -> None:
    """Feasible by construction; each solve starts from whatever the one before it left."""
    H, A = PROBLEMS[problem]
    n, m = len(H[0]), len(A[0])
    q = data.draw(arrays(float, n, elements=numbers))
    inside = data.draw(arrays(float, n, elements=numbers)) / 10
    below, above = (data.draw(arrays(float, m, elements=widths)) for _ in range(2))
    case = data.draw(st.integers(0, len(H) - 1))
    lower, upper = A[case] @ inside - below, A[case] @ inside + above
    s = solve(problem, BACKENDS[name], q, lower, upper, case)
    reference = solve_reference(H[case], q, A[case], lower, upper)
    exact = name != "osqp"  # DAQP makes solutions of OSQP exact
    assert s.status == SOLVED or (s.status == LIMIT and name == "osqp")  # its steps can be small: then it says so
    assert reference.status == 0
    if s.status == SOLVED:
        tolerance = 1e-9 if exact else 2e-6
        np.testing.assert_allclose(s.z, reference.z, atol=tolerance * max(1, np.abs(reference.z).max()))
        assert s.residual < (1e-10 if exact else 1e-3)  # OSQP stops by its scaled rows, 5000 times smaller
    assert s.residual == pytest.approx(kkt(problem, case, q, lower, upper, s), abs=1e-12)


def test_both_solvers_succeed_nearly_always(backend: Backend, problem: str) -> None:
    (H, *_), (A, *_) = PROBLEMS[problem]
    n, m = len(H), len(A)
    rng = np.random.default_rng(3)
    statuses = []
    for _ in range(50):
        inside, below, above = rng.uniform(-2, 2, n), *rng.choice([0.3, 2.0, np.inf], (2, m))
        statuses.append(solve(problem, backend, rng.uniform(-20, 20, n), A @ inside - below, A @ inside + above).status)
    assert statuses.count(SOLVED) >= (48 if backend == BACKENDS["osqp"] else 50)


@pytest.mark.parametrize("name", BACKENDS)
@given(inside=arrays(float, 4, elements=numbers), q=arrays(float, 4, elements=numbers), equations=st.integers(1, 4))
@example(inside=np.zeros(4), q=np.ones(4), equations=4)
def test_equations(name: str, inside: np.ndarray, q: np.ndarray, equations: int) -> None:
    H, A = (p[0] for p in PROBLEMS["two cases"])
    lower, upper = A @ inside - 3.0, A @ inside + 3.0
    lower[:equations] = upper[:equations] = (A @ inside)[:equations]
    s = solve("two cases", BACKENDS[name], q, lower, upper)
    reference = solve_reference(H, q, A, lower, upper)
    assert s.status == SOLVED
    np.testing.assert_allclose(s.z, reference.z, atol=1e-5 if name == "osqp" else 1e-9)


def test_the_multiplier_tells_the_side(backend: Backend) -> None:
    for q, bound in ((-8.0, 1.0), (8.0, -1.0)):
        s = solve("one", backend, q, -1.0, 1.0)
        assert s.z[0] == pytest.approx(bound)
        assert s.y[0] == pytest.approx(-q - 2 * bound)


def test_infeasible_keeps_the_last_solution(backend: Backend, problem: str) -> None:
    m = len(PROBLEMS[problem][1][0])
    good = solve(problem, backend, -1.0, -1.0, 1.0)
    assert good.status == SOLVED
    crossed = solve(problem, backend, -1.0, 1.0, np.r_[np.ones(m - 1), 0.9])
    assert crossed.status == INFEASIBLE
    assert crossed.z.tobytes() == good.z.tobytes()
    assert not crossed.y.any()
    again = solve(problem, backend, -1.0, -1.0, 1.0)
    assert again.status == SOLVED
    np.testing.assert_allclose(again.z, good.z, atol=1e-7)


def test_rows_that_exclude_each_other(backend: Backend) -> None:
    """No pair of bounds crosses; only the solver can find out."""
    m = len(PROBLEMS["degenerate"][1][0])
    lower, upper = np.full(m, -1.0), np.full(m, 1.0)
    lower[5], upper[5] = 2.0, 3.0  # row 5 is row 0
    s = solve("degenerate", backend, 1.0, lower, upper)
    assert (s.status, s.z.any()) == (INFEASIBLE, False)
    assert s.residual > 0.1
    lower[5], upper[5] = -1.0, 1.0
    lower[9] = 0.5  # the row of zeros
    assert solve("degenerate", backend, 1.0, lower, upper).status == INFEASIBLE
    lower[9] = -0.5
    assert solve("degenerate", backend, 1.0, lower, upper).status == SOLVED


def test_equations_that_contradict_each_other(backend: Backend) -> None:
    m = len(PROBLEMS["degenerate"][1][0])
    lower, upper = np.full(m, -1.0), np.full(m, 1.0)
    lower[[0, 5]] = upper[[0, 5]] = 1e-4, 2e-4
    assert solve("degenerate", backend, 1.0, lower, upper).status == INFEASIBLE
    lower[5] = upper[5] = 1e-4
    s = solve("degenerate", backend, 1.0, lower, upper)
    assert s.status == SOLVED
    assert PROBLEMS["degenerate"][1][0][0] @ s.z == pytest.approx(1e-4, abs=1e-7)


@pytest.mark.parametrize("limited", [Daqp(max_iterations=3), Osqp(rho=100.0, max_iterations=20)], ids=["daqp", "osqp"])
def test_iteration_limit(limited: Backend) -> None:
    q = np.array([-20.0, 15.0, 9.0, -30.0, 1.0])
    programs = compiled("soft", limited)
    programs.memory[:] = 0
    samples = 0
    while samples < 1000:
        samples += 1
        s = solve("soft", limited, q, -0.1, 0.1)
        assert np.all(np.isfinite(s.z))
        assert s.iterations <= 20
        if s.status == SOLVED:
            break
        assert s.status == LIMIT
    assert 1 < samples < 1000, "each sample continues where the last one stopped"


def test_the_fallback_takes_over_at_the_limit() -> None:
    """Its solution is exact and the next start.

    The solver in front of it is done with the same data at its first check.
    """
    limited = Osqp(rho=100.0, max_iterations=20, fallback=Daqp())
    q = np.array([-20.0, 15.0, 9.0, -30.0, 1.0])
    (H,), (A,) = PROBLEMS["soft"]
    first, again = (solve("soft", limited, q, -0.1, 0.1) for _ in range(2))
    np.testing.assert_allclose(
        first.z, solve_reference(H, q, A, np.full(len(A), -0.1), np.full(len(A), 0.1)).z, atol=1e-9
    )
    assert (first.status, again.status) == (SOLVED, SOLVED)
    assert first.residual < 1e-12
    assert 20 < first.iterations <= limited.most_iterations
    assert again.iterations == limited.check_interval + 1
    np.testing.assert_allclose(again.z, first.z, atol=1e-12)


ROUGH = Osqp(rho=30.0, eps=1e-4, max_iterations=10_000)
LINEAR = np.random.default_rng(1).normal(size=4) * 20


def test_the_fallback_starts_from_the_rows_that_osqp_found_active() -> None:
    """It needs one iteration, where it needs several from scratch; a rough solution is exact then."""
    H, A = (p[0] for p in PROBLEMS["two cases"])
    bounds = np.full(len(A), -0.5), np.full(len(A), 0.5)
    alone, polished = (
        solve("two cases", b, LINEAR, *bounds, commit=False) for b in (ROUGH, replace(ROUGH, fallback=Daqp()))
    )
    assert alone.residual > 1e-9
    assert polished.residual < 1e-12
    assert polished.iterations == alone.iterations + 1
    assert solve("two cases", Daqp(), LINEAR, *bounds, commit=False).iterations > 3
    reference = solve_reference(H, LINEAR, A, *bounds)
    np.testing.assert_allclose(polished.z, reference.z, atol=1e-12 * np.abs(reference.z).max())


def test_a_fallback_at_its_limit_leaves_the_solution_of_osqp() -> None:
    alone, limited = (
        solve("two cases", b, LINEAR, -0.5, 0.5, commit=False)
        for b in (ROUGH, replace(ROUGH, fallback=Daqp(max_iterations=1)))
    )
    assert limited.status == SOLVED
    assert limited.z.tobytes() == alone.z.tobytes()
    assert limited.y.tobytes() == alone.y.tobytes()


def test_the_limit_of_the_fallback() -> None:
    """Where it gives up as well, the outcome is a limit reached; no sample does more than both limits together."""
    limited = Osqp(rho=100.0, max_iterations=20, fallback=Daqp(max_iterations=3))
    q = np.array([-20.0, 15.0, 9.0, -30.0, 1.0])
    (H,), (A,) = PROBLEMS["soft"]
    statuses = []
    for _ in range(1000):
        s = solve("soft", limited, q, -0.1, 0.1)
        assert np.all(np.isfinite(s.z))
        assert s.iterations <= limited.most_iterations == 23
        statuses.append(s.status)
        if s.status == SOLVED:
            break
    assert set(statuses[:-1]) == {LIMIT}, "each sample continues where the last one stopped"
    assert statuses[-1] == SOLVED
    np.testing.assert_allclose(s.z, solve_reference(H, q, A, np.full(len(A), -0.1), np.full(len(A), 0.1)).z, atol=1e-5)


@pytest.fixture(params=[4000, 150], ids=["before its limit", "at its limit"])
def mistaken(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> tuple[Osqp, Osqp]:
    """OSQP, which finds the program infeasible, alone and with a fallback."""
    monkeypatch.setitem(PROBLEMS, "misjudged", ([MISJUDGED.hessian], [MISJUDGED.rows]))
    alone = Osqp(max_iterations=request.param)
    both = replace(alone, fallback=Daqp())
    compiled("misjudged", both).memory[:] = 0
    return alone, both


def right(s: Solved, q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> bool:
    """Whether the outcome is the solution of the misjudged program with these data."""
    reference = solve_reference(MISJUDGED.hessian, q, MISJUDGED.rows, lower, upper)
    return s.status == SOLVED and np.allclose(s.z, reference.z, 1e-9) and np.allclose(s.y, reference.multipliers, 1e-6)


def test_the_fallback_solves_what_osqp_finds_infeasible(mistaken: tuple[Osqp, Osqp]) -> None:
    """From there OSQP finds the solution of the same program, the next program is right, and so is a restored state."""
    alone, both = mistaken
    data = MISJUDGED[2:]
    claim = solve("misjudged", alone, *data, commit=False)
    first = solve("misjudged", both, *data)
    assert claim.status == INFEASIBLE
    assert right(first, *data)
    assert claim.iterations < first.iterations < claim.iterations + 9
    assert first.residual < 1e-10
    assert first.residual == pytest.approx(kkt("misjudged", 0, *data, first), abs=1e-12)
    memory = compiled("misjudged", both).memory
    kept = memory.copy()
    again = solve("misjudged", both, *data)
    assert right(again, *data)
    assert again.iterations == both.check_interval + 1
    memory[:] = kept
    following = [-MISJUDGED.linear, MISJUDGED.lower - 50.0, MISJUDGED.upper + 50.0]
    after = solve("misjudged", both, *following)
    assert right(after, *following)
    memory[:] = kept
    assert solve("misjudged", both, *following).z.tobytes() == after.z.tobytes()
    memory[:] = 0
    assert solve("misjudged", both, *data).z.tobytes() == first.z.tobytes()


def test_what_the_fallback_finds_infeasible_too_is_infeasible(mistaken: tuple[Osqp, Osqp]) -> None:
    """The last solution stays, and the next solve is a cold start."""
    alone, both = mistaken
    data = MISJUDGED[2:]
    contrary = MISJUDGED.linear, MISJUDGED.lower, MISJUDGED.upper - [0.0, 0.0, 0.5]
    first = solve("misjudged", both, *data)
    compiled("misjudged", alone).memory[:] = compiled("misjudged", both).memory
    claim, failed = (solve("misjudged", b, *contrary) for b in mistaken)
    assert (claim.status, failed.status) == (INFEASIBLE, INFEASIBLE)
    assert claim.iterations < failed.iterations < both.most_iterations
    assert failed.z.tobytes() == first.z.tobytes()
    assert not failed.y.any()
    assert failed.residual > 0.1
    again = solve("misjudged", both, *data)
    assert (again.z.tobytes(), again.iterations) == (first.z.tobytes(), first.iterations)


def test_a_fallback_at_its_limit_leaves_open_what_osqp_finds_infeasible(mistaken: tuple[Osqp, Osqp]) -> None:
    """The next solve begins at the same start, with the same bits as if this one had not been."""
    alone, both = mistaken
    limited = replace(alone, fallback=Daqp(max_iterations=2))
    data = MISJUDGED[2:]
    contrary = MISJUDGED.linear, MISJUDGED.lower, MISJUDGED.upper - [0.0, 0.0, 0.5]
    memory = compiled("misjudged", limited).memory
    memory[:] = 0
    assert solve("misjudged", limited, *data).status == LIMIT
    assert not memory.any()
    solve("misjudged", both, *data)
    memory[:] = start = compiled("misjudged", both).memory.copy()
    expected = solve("misjudged", limited, *data, commit=False)
    s = solve("misjudged", limited, *contrary)
    assert s.status == LIMIT
    assert np.isfinite(s.z).all()
    assert memory.tobytes() == start.tobytes()
    again = solve("misjudged", limited, *data)
    assert (again.z.tobytes(), again.iterations) == (expected.z.tobytes(), expected.iterations)
    assert again.status == SOLVED


@pytest.mark.parametrize(
    ("where", "value"),
    [
        ("q", np.nan),
        ("q", np.inf),
        ("lower", np.nan),
        ("upper", np.nan),
        ("lower", np.inf),
        ("upper", -np.inf),
        ("case", np.nan),
        ("case", np.inf),
    ],
)
def test_data_that_are_not_finite(backend: Backend, problem: str, where: str, value: float) -> None:
    n, m = len(PROBLEMS[problem][0][0]), len(PROBLEMS[problem][1][0])
    good = solve(problem, backend, -1.0, -1.0, 1.0)
    data = {"q": np.full(n, -1.0), "lower": np.full(m, -1.0), "upper": np.ones(m), "case": 0.0}
    if where == "case":
        data["case"] = value
    else:
        data[where][-1] = value  # type: ignore[index]
    s = solve(problem, backend, **data)  # type: ignore[arg-type]
    assert s.status == BAD
    assert s.z.tobytes() == good.z.tobytes()
    assert (s.residual, s.iterations) == (1e30, 0)
    assert solve(problem, backend, -1.0, -1.0, 1.0).status == SOLVED


def test_bounds_that_do_not_bind(backend: Backend, problem: str) -> None:
    H = PROBLEMS[problem][0][0]
    free = [solve(problem, backend, -1.0, -x, x, commit=False) for x in (1e30, 1e40, np.inf)]
    assert len({s.z.tobytes() for s in free}) == 1
    np.testing.assert_allclose(free[0].z, np.linalg.solve(H, np.ones(len(H))), atol=1e-7)
    assert not free[0].y.any()


def test_the_case_is_rounded_and_clipped(backend: Backend) -> None:
    q = np.array([1.0, -2.0, 3.0, -4.0])
    z = {c: solve("two cases", backend, q, -0.3, 0.3, c, commit=False).z.tobytes() for c in (0.0, 1.0)}
    assert z[0.0] != z[1.0]
    for case, same in ((0.49, 0.0), (-7.0, 0.0), (0.51, 1.0), (99.0, 1.0), (1e300, 1.0)):
        assert solve("two cases", backend, q, -0.3, 0.3, case, commit=False).z.tobytes() == z[same]


def test_a_solve_depends_on_memory_alone(backend: Backend, problem: str) -> None:
    """Scratch carries nothing from solve to solve, so a restored state continues with the same bits."""
    programs = compiled(problem, backend)
    rng = np.random.default_rng(1)
    n, m = len(PROBLEMS[problem][0][0]), len(PROBLEMS[problem][1][0])

    def data() -> np.ndarray:
        return np.concatenate([rng.normal(size=n) * 9, -rng.uniform(0.1, 3, m), rng.uniform(0.1, 3, m), [0]])

    for _ in range(3):
        programs.solve(data())
    kept, tests = programs.memory.copy(), [data() for _ in range(4)]
    first = [programs.solve(d).tobytes() for d in tests]
    for _ in range(5):
        programs.solve(data())
    programs.memory[:] = kept
    assert [programs.solve(d).tobytes() for d in tests] == first


@pytest.mark.parametrize("name", ["daqp", "osqp"])
def test_warm_start_saves_iterations(name: str) -> None:
    backend = BACKENDS[name]
    q = np.array([-20.0, 15.0, 9.0, -30.0, 1.0])
    cold = solve("soft", backend, q, -1.0, 1.0)
    warm = solve("soft", backend, q * 1.001, -1.0, 1.0)
    assert warm.iterations < cold.iterations


def test_no_heap_in_the_solvers(backend: Backend) -> None:
    library = compiled("soft", backend)._library._name
    with open(library, "rb") as file:
        code = file.read()
    assert not any(f in code for f in (b"malloc", b"calloc", b"realloc", b"printf", b"clock"))


@pytest.mark.parametrize("big", [Daqp(), Osqp(rho=100.0, max_iterations=300)], ids=["daqp", "osqp"])
def test_a_three_axle_vehicle_fits(big: Backend) -> None:
    """19 variables, 970 rows, four cases: sizes that must carry, with one matrix of rows for all cases."""
    rng = np.random.default_rng(0)
    n, m = 19, 970
    H = [definite(rng, n) + np.diag(np.r_[np.zeros(n - 1), 100.0]) for _ in range(4)]
    A = np.hstack([rng.normal(size=(m, n - 1)) * 0.98 ** np.arange(m)[:, None], -np.ones((m, 1))])
    q, upper = 10 * rng.normal(size=n), np.full(m, 2.0)
    PROBLEMS["three axles"] = (H, [A] * 4)
    for case in range(4):
        s = solve("three axles", big, q, -1e30, upper, case)
        reference = solve_reference(H[case], q, A, np.full(m, -1e30), upper)
        if big.name == "daqp":
            assert s.status == SOLVED
            np.testing.assert_allclose(s.z, reference.z, atol=1e-9)
        else:  # too hard for a fixed step size in so few iterations
            assert s.status == LIMIT
            assert np.all(np.isfinite(s.z))
    del PROBLEMS["three axles"]
